"""A campaign: recordings of one bench, what is known of it, and what the simulation has.

The records are made from the parsed ``campaign.yaml`` by
:func:`impactscope.discrepancy.campaign_description.parse_campaign`; the samples are put in
afterwards by whoever reads the files. SI units; angles in degrees only where a name
says so. What is not known may be left out wherever something can still be answered without it.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError, MissingChannelError
from impactscope.physics.pendulum import STANDARD_GRAVITY, Orientation
from impactscope.records import ImpactEvent

__all__ = [
    'IMPACT_CHANNELS',
    'BaselineItem',
    'Campaign',
    'CampaignKind',
    'CampaignRecording',
    'ChannelSamples',
    'Quantity',
    'Role',
]

IMPACT_CHANNELS = ('force', 'acceleration.plate', 'acceleration.impactor', 'acceleration.base')
_NO_INPUT = ('', 'none', 'null')  # as the file may say it
DEFAULT_GAIN_STD = {'force': 0.003, 'acceleration': 0.005}
DEFAULT_ANGLE_STD_DEG = 0.1
DEFAULT_STD = {'effective_mass': 0.02, 'speed': 0.02, 'drop_height': 0.04}  # relative


class CampaignKind(enum.Enum):
    """How the machine was excited."""

    IMPACT = 'impact'
    DRIVEN = 'driven'
    PRESCRIBED_MOTION = 'prescribed_motion'
    CHAIN = 'chain'


class Role(enum.Enum):
    """Whether a recording may be fitted, or is only predicted."""

    FIT = 'fit'
    HOLD_OUT = 'hold_out'


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number that is known: ``std`` 0 is stated as exact; NaN value is to be estimated."""

    value: float = math.nan
    std: float = 0.0

    @property
    def known(self) -> bool:
        """Whether a value is stated."""
        return math.isfinite(self.value)


@dataclass(frozen=True, slots=True, eq=False)
class ChannelSamples:
    """Samples of one channel at a uniform rate; NaN where samples are missing. Shape (n,)."""

    name: str
    unit: str
    sample_rate: float  # Hz
    start: float  # s after the recording's first sample of any channel
    values: NDArray[np.float64]
    range_min: float = math.nan
    range_max: float = math.nan

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of each sample, s, shape (n,)."""
        return self.start + np.arange(self.values.size) / self.sample_rate


@dataclass(frozen=True, slots=True, eq=False)
class CampaignRecording:
    """One recording: what was done, and the samples."""

    file: str
    kind: str = ''
    role: Role = Role.FIT
    mass_distance: float = math.nan  # m, of the pendulum's moving mass
    release_angle_deg: float = math.nan
    damper: bool = True  # whether the damper layer lay on the plate
    effective_mass: float = math.nan  # kg, of a robot or a falling mass
    speed: float = math.nan  # m/s, at impact
    drop_height: float = math.nan  # m
    std: Mapping[str, float] = field(default_factory=dict)  # of these three, where stated
    start: float = math.nan  # s, part of the recording to look at
    end: float = math.nan
    channels: Mapping[str, ChannelSamples] = field(default_factory=dict)

    def uncertainty(self, name: str) -> float:
        """Standard deviation of ``effective_mass``, ``speed`` or ``drop_height``."""
        return self.std.get(name, DEFAULT_STD[name] * float(getattr(self, name)))

    def channel(self, name: str) -> ChannelSamples:
        """A channel by its name; MissingChannelError names those that are there instead."""
        try:
            return self.channels[name]
        except KeyError:
            there = ', '.join(sorted(self.channels)) or 'none'
            raise MissingChannelError(
                f'{self.file} has no channel {name!r}; it has {there}'
            ) from None

    def inside(self, time: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which moments, s, are of the part to look at, shape as ``time``."""
        begin = self.start - 1e-9 if math.isfinite(self.start) else -math.inf
        end = self.end if math.isfinite(self.end) else math.inf
        return np.asarray((time >= begin) & (time < end))

    def part(self) -> CampaignRecording:
        """The recording with the samples of the part to look at alone; times stay as they are."""
        if not math.isfinite(self.start) and not math.isfinite(self.end):
            return self
        cut = {}
        for name, channel in self.channels.items():
            inside = np.flatnonzero(self.inside(channel.time))
            if inside.size:
                first, last = int(inside[0]), int(inside[-1]) + 1
                cut[name] = dataclasses.replace(
                    channel,
                    start=channel.start + first / channel.sample_rate,
                    values=channel.values[first:last],
                )
        return dataclasses.replace(self, channels=cut)

    @property
    def duration(self) -> float:
        """Length of the longest channel, s."""
        return max(
            (c.start + c.values.size / c.sample_rate for c in self.channels.values()), default=0.0
        )


@dataclass(frozen=True, slots=True)
class BaselineItem:
    """A mechanism that the simulation has, with the values that are stated for it."""

    name: str
    values: Mapping[str, float] = field(default_factory=dict)
    channel: str = ''


@dataclass(frozen=True, slots=True, eq=False)
class Campaign:
    """A campaign. ``sensor``, ``damper`` and ``pendulum`` hold what is stated, by name.

    ``gravity``: of the site, m/s². ``bench`` and ``model`` are the mappings of the file, for what
    only some kinds have: input, outputs, reference, controller, motion, output; modes, restoring,
    and so on.
    """

    name: str
    kind: CampaignKind
    recordings: tuple[CampaignRecording, ...]
    baseline: tuple[BaselineItem, ...]
    orientation: Orientation | None = None
    gravity: float = STANDARD_GRAVITY
    sensor: Mapping[str, Quantity] = field(default_factory=dict)
    damper: Mapping[str, Any] | None = None  # parallel_stiffness: Quantity, branches: [...]
    pendulum: Mapping[str, Quantity] = field(default_factory=dict)
    release_angle_std_deg: float = DEFAULT_ANGLE_STD_DEG
    gain_std: Mapping[str, float] = field(default_factory=dict)  # by channel or quantity, stated
    noise_std: Mapping[str, float] = field(default_factory=dict)  # by channel, where stated
    bench: Mapping[str, Any] = field(default_factory=dict)
    model: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def baseline_names(self) -> tuple[str, ...]:
        """Names of the mechanisms that the simulation has."""
        return tuple(item.name for item in self.baseline)

    def of_role(self, role: Role) -> tuple[CampaignRecording, ...]:
        """Recordings of a role, in the order of the file."""
        return tuple(r for r in self.recordings if r.role is role)

    def gain_std_of(self, channel: str) -> float:
        """Relative calibration uncertainty of a channel, presumed where it is not stated."""
        stated = self.stated_gain_std_of(channel)
        return DEFAULT_GAIN_STD.get(channel.split('.', 1)[0], 0.0) if stated is None else stated

    def stated_gain_std_of(self, channel: str) -> float | None:
        """Relative calibration uncertainty: a channel's own, or that of its quantity."""
        quantity = channel.split('.', 1)[0]
        stated = self.gain_std.get(channel, self.gain_std.get(quantity))
        return None if stated is None else float(stated)

    def with_samples(
        self,
        load: Callable[[str], Mapping[str, ChannelSamples]],
        progress: Callable[[float], None] | None = None,
    ) -> Campaign:
        """The campaign with samples in its recordings; ``load`` takes the file's name."""
        filled = []
        for i, recording in enumerate(self.recordings):
            filled.append(dataclasses.replace(recording, channels=load(recording.file)))
            if progress is not None:
                progress((i + 1) / len(self.recordings))
        return dataclasses.replace(self, recordings=tuple(filled))

    @property
    def input_channel(self) -> str:
        """Channel of what drives the machine; empty where it swings freely."""
        named = str(self.bench.get('input') or '')
        return '' if named.lower() in _NO_INPUT else named

    @property
    def named_channels(self) -> tuple[str, ...]:
        """Channels that the bench names, of which every recording must have each."""
        if self.kind is CampaignKind.IMPACT:
            return ()
        outputs = self.bench.get('outputs', ())
        single = [self.input_channel, *(self.bench.get(key) for key in ('motion', 'output'))]
        named = [*single, *(outputs if isinstance(outputs, list) else ())]
        return tuple(str(name) for name in named if name)

    def uses(self, channel: str) -> bool:
        """Whether a channel is one that a search looks at."""
        if self.kind is CampaignKind.IMPACT:
            return channel in IMPACT_CHANNELS
        return channel in self.named_channels

    def check_recordings(self) -> None:
        """Hold the samples against the description.

        Raises MissingChannelError where a recording lacks what the bench names, ConfigurationError
        where the part of it to look at begins behind its end.
        """
        for i, recording in enumerate(self.recordings):
            for name in self.named_channels:
                recording.channel(name)
            if recording.start >= recording.duration > 0.0:
                raise ConfigurationError(
                    f'{self.name}: recordings[{i}].start is {recording.start:g} s; '
                    f'{recording.file} ends at {recording.duration:.4g} s'
                )

    def with_events(self, events: Sequence[ImpactEvent]) -> Campaign:
        """The campaign as far as blows were taken: the n-th recording is the n-th event.

        Raises ConfigurationError where there are more events than recordings.
        """
        if len(events) > len(self.recordings):
            raise ConfigurationError(
                f'{len(events)} blows were taken, but {self.name} describes {len(self.recordings)}'
            )
        filled = tuple(
            dataclasses.replace(recording, channels=_channels_of(event))
            for recording, event in zip(self.recordings, events, strict=False)
        )
        return dataclasses.replace(self, recordings=filled)


def _channels_of(event: ImpactEvent) -> dict[str, ChannelSamples]:
    return {
        channel.name: ChannelSamples(
            channel.name,
            channel.unit,
            event.sample_rate,
            0.0,
            event.values[row].astype(np.float64),
            channel.range_min,
            channel.range_max,
        )
        for row, channel in enumerate(event.channels)
    }
