"""The measuring chain: from what a channel would read to the samples that a device delivers.

In the order in which they occur: the device's clock decides when a sample is taken; filters,
coupling, hum, drift and offset act; noise is added; the range cuts off; the converter rounds.

There is no anti-alias filter before the sampling: a channel shows what its quantity is at the
instants of sampling. What is shorter than a few samples, such as the contact force of a bare
contact in the plate's acceleration, is under-read as by a device without such a filter; true
peaks stand in :class:`~impactscope.physics.twin.simulate.ContactSpan`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError
from impactscope.physics.mechanisms.registry import mechanism
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.simulate import CHANNELS

__all__ = ['DEFAULT_CHAIN', 'ChannelChain', 'coloured_noise', 'device_times', 'read']

Array = NDArray[np.float64]

_AFTER_NOISE = ('saturation', 'quantisation')


@dataclass(frozen=True, slots=True)
class ChannelChain:
    """What stands between one quantity and its samples; in the channel's unit.

    ``pink_noise`` is the standard deviation of noise whose power falls with 1/f, over the
    length that is read. ``limit``: the range is +-limit. ``resolution``: step of the converter.
    """

    channel: str
    sample_rate: float = 10_000.0  # Hz
    noise: float = 0.0  # standard deviation, white
    pink_noise: float = 0.0  # standard deviation
    limit: float = math.inf
    resolution: float = 0.0
    gain: float = 1.0
    frame_id: str = ''
    effects: tuple[Effect, ...] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        if self.channel not in CHANNELS:
            raise ConfigurationError(
                f'channel {self.channel!r} is not simulated; known are {", ".join(CHANNELS)}'
            )
        values = (self.noise, self.pink_noise, self.resolution, self.limit)
        if not 0 < self.sample_rate <= 1e7 or not all(v >= 0 for v in values):
            raise ConfigurationError(
                f'channel {self.channel}: sample_rate {self.sample_rate!r} Hz must be above zero '
                f'and noise, resolution and limit {values!r} not negative'
            )

    @property
    def unit(self) -> str:
        """SI unit of the channel."""
        return CHANNELS[self.channel][0]


DEFAULT_CHAIN: Mapping[str, ChannelChain] = {
    'force': ChannelChain('force', 10_000.0, 0.4, limit=500.0, resolution=0.02, frame_id='sensor'),
    'acceleration.plate': ChannelChain(
        'acceleration.plate', 10_000.0, 0.08, limit=500.0, resolution=0.002, frame_id='plate'
    ),
    'acceleration.impactor': ChannelChain(
        'acceleration.impactor', 10_000.0, 0.08, limit=500.0, resolution=0.002, frame_id='impactor'
    ),
    'acceleration.base': ChannelChain(
        'acceleration.base', 10_000.0, 0.08, limit=500.0, resolution=0.002, frame_id='base'
    ),
}
"""A bench with a 500 N force sensor and three 50 g accelerometers, all at 10 kHz."""


def chain_effects(chain: ChannelChain, effects: Iterable[Effect] = ()) -> tuple[Effect, ...]:
    """The chain's own effects and those that name its channel, values filled in and checked."""
    chosen = [*chain.effects, *(e for e in effects if e.channel in ('', chain.channel))]
    result = []
    for effect in chosen:
        kind = mechanism(effect.name)
        if kind.on_channel:
            result.append(Effect(effect.name, kind.values(effect.values), chain.channel))
    return tuple(result)


def device_times(
    chain: ChannelChain, count: int, effects: Iterable[Effect] = (), first: int = 0
) -> Array:
    """True times at which samples ``first`` to ``first + count`` are taken, s, shape (count,)."""
    times: Array = (first + np.arange(count)) / chain.sample_rate
    for effect in chain_effects(chain, effects):
        retime = mechanism(effect.name).retime
        if retime is not None:
            times = retime(times, effect.values)
    return times


def read(
    clean: Array, chain: ChannelChain, rng: np.random.Generator, effects: Iterable[Effect] = ()
) -> Array:
    """What the device delivers for the ``clean`` values at its sample times, shape (n,)."""
    values = chain.gain * np.asarray(clean, dtype=np.float64)
    chosen = chain_effects(chain, effects)
    for effect in chosen:
        distort = mechanism(effect.name).distort
        if distort is not None and effect.name not in _AFTER_NOISE:
            values = distort(values, chain.sample_rate, effect.values)
    if chain.noise > 0:
        values = values + chain.noise * rng.standard_normal(values.size)
    if chain.pink_noise > 0:
        values = values + chain.pink_noise * coloured_noise(values.size, 1.0, rng)
    for name in _AFTER_NOISE:
        for effect in chosen:
            distort = mechanism(effect.name).distort
            if distort is not None and effect.name == name:
                values = distort(values, chain.sample_rate, effect.values)
    values = np.clip(values, -chain.limit, chain.limit)
    if chain.resolution > 0:
        values = chain.resolution * np.round(values / chain.resolution)
    return values


def coloured_noise(count: int, exponent: float, rng: np.random.Generator) -> Array:
    """Gaussian noise with power falling as f^-exponent and unit standard deviation, (count,)."""
    if count < 2:
        return np.zeros(count)
    frequency = np.fft.rfftfreq(count)
    weight = np.zeros_like(frequency)
    weight[1:] = frequency[1:] ** (-0.5 * exponent)
    spectrum = weight * (
        rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size)
    )
    noise = np.fft.irfft(spectrum, count)
    # scaled by the expected variance, not the sample's, so that realisations differ as they should
    variance = 4.0 * np.sum(weight**2)
    if count % 2 == 0:
        variance -= 3.0 * weight[-1] ** 2
    return np.asarray(noise * count / math.sqrt(variance))
