"""A campaign: recordings of one bench, what is known of it, and what the simulation has.

The records are made from the parsed ``campaign.yaml`` by :func:`parse_campaign`; the samples
are put in afterwards by whoever reads the files. SI units; angles in degrees only where a name
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

from impactscope.errors import ConfigurationError
from impactscope.physics.pendulum import Orientation
from impactscope.records import ImpactEvent

__all__ = [
    'BaselineItem',
    'Campaign',
    'CampaignKind',
    'CampaignRecording',
    'ChannelSamples',
    'Quantity',
    'Role',
    'parse_campaign',
]

CAMPAIGN_VERSION = 1

BLOW_KINDS = ('tap', 'pendulum', 'robot', 'drop', 'driven')

DEFAULT_GAIN_STD = {'force': 0.003, 'acceleration': 0.005}
DEFAULT_ANGLE_STD_DEG = 0.1


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
    start: float = math.nan  # s, part of the recording to look at
    end: float = math.nan
    channels: Mapping[str, ChannelSamples] = field(default_factory=dict)

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

    ``bench`` and ``model`` are the mappings of the file, for what only some kinds have:
    input, outputs, reference, controller, motion, output; modes, restoring, ...
    """

    name: str
    kind: CampaignKind
    recordings: tuple[CampaignRecording, ...]
    baseline: tuple[BaselineItem, ...]
    orientation: Orientation | None = None
    sensor: Mapping[str, Quantity] = field(default_factory=dict)
    damper: Mapping[str, Any] | None = None  # parallel_stiffness: Quantity, branches: [...]
    pendulum: Mapping[str, Quantity] = field(default_factory=dict)
    release_angle_std_deg: float = DEFAULT_ANGLE_STD_DEG
    clock_std: float = 0.0  # s, between devices
    gain_std: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_GAIN_STD))
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
        """Relative calibration uncertainty of a channel: its own, or that of its quantity."""
        quantity = channel.split('.', 1)[0]
        return float(self.gain_std.get(channel, self.gain_std.get(quantity, 0.0)))

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


def parse_campaign(data: Any, name: str = 'campaign') -> Campaign:
    """A campaign from the parsed ``campaign.yaml``, without samples.

    Raises ConfigurationError for what is wrong or of the wrong type; what is merely absent
    leaves a note where an answer is still possible without it.
    """
    top = _Mapping(data, name)
    version = top.take('version')
    if version != CAMPAIGN_VERSION:
        raise ConfigurationError(
            f'{name}: version is {version!r}; this software reads version {CAMPAIGN_VERSION}'
        )
    bench = top.mapping('bench')
    kind_text = bench.data.get('kind')
    try:
        kind = CampaignKind(kind_text)
    except ValueError:
        known = ', '.join(k.value for k in CampaignKind)
        raise ConfigurationError(
            f'{name}: bench.kind is {kind_text!r}; it must be one of {known}'
        ) from None
    notes: list[str] = []
    _check_roles(bench, kind)
    orientation = _orientation(bench, kind, notes)
    sensor = _quantities(top.mapping('sensor', optional=True))
    damper = _damper(top.take('damper', None), name)
    pendulum_map = top.mapping('pendulum', optional=True)
    angle_std = _positive(
        pendulum_map.take('release_angle_std_deg', DEFAULT_ANGLE_STD_DEG),
        f'{name}: pendulum.release_angle_std_deg',
    )
    pendulum = _quantities(pendulum_map)
    baseline = _baseline(top.take('baseline', []), name)
    recordings = _recordings(top.take('recordings', None), kind, name, notes)
    if kind is CampaignKind.IMPACT:
        _note_what_is_missing(recordings, pendulum, damper, notes)
    gain_std = dict(DEFAULT_GAIN_STD)
    gain_std.update(_floats(top.mapping('gain_std', optional=True)))
    result = Campaign(
        name=name,
        kind=kind,
        recordings=recordings,
        baseline=baseline,
        orientation=orientation,
        sensor=sensor,
        damper=damper,
        pendulum=pendulum,
        release_angle_std_deg=angle_std,
        clock_std=_positive(top.take('clock_std', 0.0), f'{name}: clock_std'),
        gain_std=gain_std,
        noise_std=_floats(top.mapping('noise_std', optional=True)),
        bench=dict(bench.data),
        model=dict(top.mapping('model', optional=True).data),
        notes=tuple(notes),
    )
    top.refuse_rest()
    return result


# --- parts of the file ---------------------------------------------------------------------------


class _Mapping:
    """A mapping of the file that remembers which of its entries were read."""

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, Mapping):
            raise ConfigurationError(f'{where} must be a mapping, not {type(data).__name__}')
        self.data: Mapping[str, Any] = data
        self.where = where
        self._read: set[str] = set()

    def take(self, key: str, *default: Any) -> Any:
        self._read.add(key)
        if key not in self.data and not default:
            raise ConfigurationError(f'{self.where}: {key!r} is missing')
        return self.data.get(key, *default)

    def mapping(self, key: str, *, optional: bool = False) -> _Mapping:
        value = self.take(key, None) if optional else self.take(key)
        return _Mapping({} if optional and value is None else value, f'{self.where}: {key}')

    def refuse_rest(self) -> None:
        rest = sorted(str(key) for key in set(self.data) - self._read)
        if rest:
            raise ConfigurationError(f'{self.where}: {rest[0]!r} is not known here')


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigurationError(f'{where} is {value!r}; it must be a finite number')
    return float(value)


def _positive(value: Any, where: str) -> float:
    number = _number(value, where)
    if number < 0:
        raise ConfigurationError(f'{where} is {number!r}; it must not be negative')
    return number


def _quantity(value: Any, where: str) -> Quantity:
    if value is None:
        return Quantity()
    if isinstance(value, Mapping):
        item = _Mapping(value, where)
        number = _number(item.take('value'), f'{where}.value')
        std = _positive(item.take('std', 0.0), f'{where}.std')
        item.take('unit', '')
        item.refuse_rest()
        return Quantity(number, std)
    return Quantity(_number(value, where))


def _quantities(mapping: _Mapping) -> dict[str, Quantity]:
    found = {}
    for key, value in mapping.data.items():
        if not str(key).endswith('_std_deg'):
            found[str(key)] = _quantity(value, f'{mapping.where}.{key}')
    return found


def _floats(mapping: _Mapping) -> dict[str, float]:
    return {str(k): _positive(v, f'{mapping.where}.{k}') for k, v in mapping.data.items()}


def _check_roles(bench: _Mapping, kind: CampaignKind) -> None:
    needed = {
        CampaignKind.DRIVEN: ('input', 'outputs'),
        CampaignKind.PRESCRIBED_MOTION: ('motion', 'output'),
        CampaignKind.CHAIN: ('input', 'output'),
        CampaignKind.IMPACT: (),
    }[kind]
    for key in needed:
        value = bench.take(key)
        names = value if key == 'outputs' else [value]
        if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
            raise ConfigurationError(
                f'{bench.where}.{key} is {value!r}; it must name '
                f'{"channels" if key == "outputs" else "a channel"}'
            )


def _orientation(bench: _Mapping, kind: CampaignKind, notes: list[str]) -> Orientation | None:
    value = bench.data.get('orientation')
    if value is None:
        if kind is CampaignKind.IMPACT:
            notes.append(
                'The bench states no orientation: vertical is presumed, so that the weight of '
                'the pendulum rests on the plate.'
            )
        return None
    try:
        return Orientation(value)
    except ValueError:
        raise ConfigurationError(
            f"{bench.where}.orientation is {value!r}; it must be 'vertical' or 'horizontal'"
        ) from None


def _damper(data: Any, name: str) -> Mapping[str, Any] | None:
    if data is None:
        return None
    damper = _Mapping(data, f'{name}: damper')
    where = damper.where
    parallel = _quantity(damper.take('parallel_stiffness'), f'{where}.parallel_stiffness')
    branches = []
    listed = damper.take('branches', [])
    if not isinstance(listed, list):
        raise ConfigurationError(f'{where}.branches must be a list')
    for i, entry in enumerate(listed):
        branch = _Mapping(entry, f'{where}.branches[{i}]')
        branches.append(
            {
                key: _quantity(branch.take(key), f'{branch.where}.{key}')
                for key in ('stiffness', 'damping')
            }
        )
        branch.refuse_rest()
    damper.take('name', '')
    damper.refuse_rest()
    return {'parallel_stiffness': parallel, 'branches': branches}


def _baseline(data: Any, name: str) -> tuple[BaselineItem, ...]:
    if not isinstance(data, list):
        raise ConfigurationError(f'{name}: baseline must be a list of names')
    items = []
    for entry in data:
        if isinstance(entry, str):
            items.append(BaselineItem(entry))
            continue
        mapping = _Mapping(entry, f'{name}: baseline entry')
        item = mapping.take('name')
        values = {
            key: _number(value, f'{name}: baseline {item}.{key}')
            for key, value in mapping.mapping('values', optional=True).data.items()
        }
        items.append(BaselineItem(str(item), values, str(mapping.take('channel', ''))))
        mapping.refuse_rest()
    return tuple(items)


_RECORDING_NUMBERS = (
    'mass_distance',
    'release_angle_deg',
    'effective_mass',
    'speed',
    'drop_height',
    'start',
    'end',
)


def _recordings(
    data: Any, kind: CampaignKind, name: str, notes: list[str]
) -> tuple[CampaignRecording, ...]:
    if not isinstance(data, list) or not data:
        raise ConfigurationError(f'{name}: recordings must be a list of at least one recording')
    found = []
    for i, entry in enumerate(data):
        item = _Mapping(entry, f'{name}: recordings[{i}]')
        file = item.take('file')
        if not isinstance(file, str) or not file:
            raise ConfigurationError(f'{item.where}.file is {file!r}; it must be a file name')
        blow = item.take('kind', '')
        if kind is CampaignKind.IMPACT and blow not in BLOW_KINDS:
            raise ConfigurationError(
                f'{item.where}.kind is {blow!r}; it must be one of {", ".join(BLOW_KINDS)}'
            )
        role = item.take('role', 'fit')
        if role not in ('fit', 'hold_out'):
            raise ConfigurationError(
                f"{item.where}.role is {role!r}; it must be 'fit' or 'hold_out'"
            )
        numbers = {
            key: _number(item.take(key), f'{item.where}.{key}')
            for key in _RECORDING_NUMBERS
            if item.data.get(key) is not None
        }
        damper = item.take('damper', True)
        if not isinstance(damper, bool):
            raise ConfigurationError(
                f'{item.where}.damper is {damper!r}; it must be true or false'
            )
        item.take('notes', '')
        for key in _RECORDING_NUMBERS:
            item.take(key, None)
        item.refuse_rest()
        recording = CampaignRecording(file, str(blow), Role(role), damper=damper)
        found.append(dataclasses.replace(recording, **numbers))  # type: ignore[arg-type]
    names = [r.file for r in found]
    double = next((n for n in names if names.count(n) > 1), None)
    if double is not None and kind is CampaignKind.IMPACT:
        raise ConfigurationError(f'{name}: recording {double!r} is listed more than once')
    if all(r.role is Role.HOLD_OUT for r in found):
        raise ConfigurationError(f'{name}: every recording is held out; none is left to fit')
    if not any(r.role is Role.HOLD_OUT for r in found):
        notes.append(
            'No recording is held out: predictions of recordings that were not fitted are not '
            'available.'
        )
    return tuple(found)


def _note_what_is_missing(
    recordings: Sequence[CampaignRecording],
    pendulum: Mapping[str, Quantity],
    damper: Mapping[str, Any] | None,
    notes: list[str],
) -> None:
    swings = [r for r in recordings if r.kind == 'pendulum']
    if swings and not pendulum:
        notes.append(
            "The pendulum's geometry is not stated: its effective mass and speed are estimated "
            'for each blow, and effects on speed and mass cannot be told.'
        )
    for recording in swings:
        for value, what in (
            (recording.release_angle_deg, 'release angle'),
            (recording.mass_distance, 'mass distance'),
        ):
            if pendulum and not math.isfinite(value):
                notes.append(f'{recording.file}: the {what} is not stated and is estimated.')
    if damper is None and any(r.damper for r in swings):
        notes.append('Blows are marked as on a damper, but no damper is described.')
    if len(recordings) == 1:
        notes.append(
            'One recording only: what changes with strength or conditions cannot be told.'
        )
