"""A campaign as one long recording: blows at given times, all channels, all devices."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError
from impactscope.physics.twin.assembly import Effect, Effects, normalise
from impactscope.physics.twin.bench import Bench, Blow
from impactscope.physics.twin.measurement import (
    DEFAULT_CHAIN,
    ChannelChain,
    device_times,
    read,
)
from impactscope.physics.twin.simulate import Simulation, simulate_at
from impactscope.records import NANOSECONDS, Quality, SampleBlock, TestPoint

__all__ = ['Campaign', 'ChannelStream', 'ScheduledBlow', 'Stream', 'record', 'stream']

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ScheduledBlow:
    """A blow with first contact at ``time`` s of the campaign.

    ``bench`` None: the campaign's; ``mechanisms`` None: the campaign's, or what bench and blow
    imply.
    """

    time: float
    blow: Blow
    bench: Bench | None = None
    mechanisms: Effects | None = None


@dataclass(frozen=True, slots=True)
class Campaign:
    """Blows in a row on one bench, with its measuring chain and its test points.

    ``mechanisms``: in addition to those that bench and blow imply. Test points carry their
    start and end in ns after the campaign's beginning.
    """

    name: str
    description: str
    blows: tuple[ScheduledBlow, ...]
    duration: float  # s
    bench: Bench = field(default_factory=Bench)
    chain: Mapping[str, ChannelChain] = field(default_factory=lambda: dict(DEFAULT_CHAIN))
    mechanisms: tuple[Effect, ...] = ()
    test_points: tuple[TestPoint, ...] = ()

    def __post_init__(self) -> None:
        times = [b.time for b in self.blows]
        if any(b <= a for a, b in itertools.pairwise(times)) or any(
            not 0 <= t < self.duration for t in times
        ):
            raise ConfigurationError(
                f'campaign {self.name!r}: blow times {times!r} must rise within 0 to '
                f'{self.duration!r} s'
            )


@dataclass(frozen=True, slots=True, eq=False)
class ChannelStream:
    """All samples of one channel; ``values`` float32, shape (n_samples,)."""

    chain: ChannelChain
    values: NDArray[np.float32]
    start_ns: int

    @property
    def duration(self) -> float:
        """Length by the device's clock, s."""
        return self.values.size / self.chain.sample_rate

    def block(self, first: int, count: int, epoch: int = 0) -> SampleBlock:
        """Samples ``first`` to ``first + count`` as a block; empty at the end of the stream."""
        values = self.values[first : first + count]
        rate, limit = self.chain.sample_rate, self.chain.limit
        quality = Quality.NONE
        if values.size and np.abs(values).max() >= np.float32(limit):
            quality |= Quality.CLIPPED
        time_ns = round(first / rate * NANOSECONDS)
        finite = math.isfinite(limit)
        return SampleBlock(
            channel=self.chain.channel,
            unit=self.chain.unit,
            sample_rate=rate,
            stamp_ns=self.start_ns + time_ns,
            first_index=first,
            values=values,
            epoch=epoch,
            device_time_ns=time_ns,
            received_ns=self.start_ns + round((first + values.size) / rate * NANOSECONDS),
            quality=quality,
            range_min=-limit if finite else math.nan,
            range_max=limit if finite else math.nan,
            frame_id=self.chain.frame_id,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """A simulated campaign: channels, test points, and the truth of each blow."""

    channels: dict[str, ChannelStream]
    test_points: tuple[TestPoint, ...]
    simulations: tuple[Simulation, ...]

    def blocks(self, block_duration: float = 0.02, epoch: int = 0) -> Iterator[SampleBlock]:
        """All blocks in the order in which they would arrive, then each channel's end mark."""
        pending: list[tuple[int, int, SampleBlock]] = []
        for order, channel in enumerate(self.channels.values()):
            count = max(1, round(block_duration * channel.chain.sample_rate))
            for first in range(0, channel.values.size, count):
                block = channel.block(first, count, epoch)
                pending.append((block.received_ns, order, block))
        pending.sort(key=lambda item: item[:2])
        for _, _, block in pending:
            yield block
        for channel in self.channels.values():
            yield channel.block(channel.values.size, 0, epoch)


def _effects(campaign: Campaign, scheduled: ScheduledBlow, bench: Bench) -> tuple[Effect, ...]:
    """All mechanisms of one blow; those that it cannot have (no damper) are left out."""
    own = normalise(scheduled.mechanisms, bench, scheduled.blow)
    if scheduled.mechanisms is not None:
        return own
    there = {'impactor'} if normalise(None, bench, scheduled.blow) else set()
    there |= {'damper'} if bench.damper is not None else {'bare'}
    names = {effect.name for effect in campaign.mechanisms}
    extra = (e for e in campaign.mechanisms if e.mechanism.needs <= there)
    return (
        *(e for e in own if e.name not in names),
        *normalise(tuple(extra), bench, scheduled.blow),
    )


def _clean(
    campaign: Campaign, times: Mapping[str, Array]
) -> tuple[dict[str, Array], list[Simulation]]:
    """Noise-free values of every channel at its true sample times, and the simulations."""
    values = {name: np.zeros(t.size) for name, t in times.items()}
    simulations = []
    # each blow rules from the middle of the quiet before it: the impactor's swing belongs to it
    begins = [-math.inf]
    for before, after in zip(campaign.blows, campaign.blows[1:], strict=False):
        begins.append(after.time - min(0.5, 0.5 * (after.time - before.time)))
    begins.append(math.inf)
    for i, scheduled in enumerate(campaign.blows):
        spans = {name: slice(*np.searchsorted(t, begins[i : i + 2])) for name, t in times.items()}
        union = np.unique(np.concatenate([t[spans[name]] for name, t in times.items()]))
        bench = campaign.bench if scheduled.bench is None else scheduled.bench
        simulation = simulate_at(
            bench,
            scheduled.blow,
            union,
            mechanisms=_effects(campaign, scheduled, bench),
            contact_time=scheduled.time,
        )
        simulations.append(simulation)
        for name, t in times.items():
            span = spans[name]
            values[name][span] = simulation[name][np.searchsorted(union, t[span])]
    return values, simulations


def stream(campaign: Campaign, seed: int = 0, start_ns: int = 0) -> Stream:
    """Simulate a campaign; the same seed gives the same samples.

    ``start_ns`` is the host time of the first sample. Raises ConfigurationError and
    SimulationError as :func:`simulate` does.
    """
    rngs = np.random.default_rng(seed).spawn(len(campaign.chain))
    times = {}
    for name, chain in campaign.chain.items():
        count = round(campaign.duration * chain.sample_rate)
        times[name] = device_times(chain, count, campaign.mechanisms)
    clean, simulations = _clean(campaign, times)
    channels = {}
    for rng, (name, chain) in zip(rngs, campaign.chain.items(), strict=True):
        samples = read(clean[name], chain, rng, campaign.mechanisms)
        channels[name] = ChannelStream(chain, samples.astype(np.float32), start_ns)
    points = tuple(
        dataclasses.replace(p, start_ns=p.start_ns + start_ns, end_ns=p.end_ns + start_ns)
        for p in campaign.test_points
    )
    return Stream(channels, points, tuple(simulations))


def record(
    bench: Bench,
    blow: Blow,
    *,
    chain: Mapping[str, ChannelChain] | None = None,
    mechanisms: Effects | None = None,
    duration: float = 1.0,
    contact_time: float = 0.1,
    seed: int = 0,
) -> Stream:
    """Simulate and measure one blow."""
    effects = normalise(mechanisms, bench, blow)
    campaign = Campaign(
        name='blow',
        description='one blow',
        blows=(ScheduledBlow(contact_time, blow, bench, effects),),
        duration=duration,
        bench=bench,
        chain=dict(DEFAULT_CHAIN) if chain is None else chain,
        mechanisms=tuple(e for e in effects if e.mechanism.on_channel),
    )
    return stream(campaign, seed)
