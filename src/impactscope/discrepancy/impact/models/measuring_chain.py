"""What the measuring chain does to a simulated channel."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.impact.data.binning import BinnedChannel, merged
from impactscope.discrepancy.impact.data.blows import BlowData
from impactscope.errors import ImpactscopeError
from impactscope.physics.mechanisms.ac_coupling import high_pass
from impactscope.physics.mechanisms.low_pass_filter import (
    forwards,
    forwards_and_backwards,
    low_pass,
)
from impactscope.physics.mechanisms.registry import mechanism

__all__ = [
    'HIGHEST',
    'LOWEST_AHEAD',
    'coupled_since',
    'distort',
    'fineness',
    'moments_of',
    'sample_moments',
    'softened',
]

Array = NDArray[np.float64]

HIGHEST = 0.49
"""Of the sampling rate, up to which a filter may be one of samples."""
LOWEST_AHEAD = 0.15
"""Of the sampling rate, from which a filter that acts before sampling differs from that."""

# moments in a second, and for each sample at most, between which straight lines will do for what
# an AC coupling sums up: the samples alone tell too little of a contact over within a few of them
_COUPLED, _COUPLED_AT_MOST = 2e4, 8
_FINE = 40  # moments for each sample at most, where a filter acts before sampling
_FINEST = 4e4  # moments in a second, that are enough
# times the cut-off, of a filter without a phase: its second pass is not over straight lines
_BOTH_WAYS = 8.0
_DOUBLED = 3  # times that moments are doubled for it; one still higher does nothing that is seen
_LINES = 200  # of an arc, that are summed
_ADDED = ('offset', 'zero_drift', 'mains_hum')
_BEFORE = 0.01  # s before a contact, in which an impactor is falling
_KINK_TIME = 1.5e-5  # s around a reversal in which a sample may fall on either side of its jump


def moments_of(
    blow: BlowData,
    shifted: Mapping[str, list[tuple[str, dict[str, float]]]],
    whole: Mapping[str, int],
) -> tuple[Array, dict[str, NDArray[np.int64]]]:
    """Moments of the simulation where some channels need other moments than their nodes.

    ``shifted``: channels whose clock errs, with what acts on them; ``whole``: channels that need
    every sample, with the number of moments for each.
    """
    wanted = {}
    for name, channel in blow.channels.items():
        moments = sample_moments(channel, whole[name]) if name in whole else channel.nodes
        for kind, numbers in shifted.get(name, ()):
            if kind == 'clock_error':
                moments = (moments - numbers['offset']) / (1.0 + numbers['drift'])
        wanted[name] = moments
    return merged(wanted)


def sample_moments(channel: BinnedChannel, fine: int) -> Array:
    """Moments of a channel's samples, s, and ``fine`` - 1 between each two of them."""
    if fine == 1 or channel.time.size == 0:
        return channel.time
    count = (channel.time.size - 1) * fine + 1
    return np.asarray(channel.time[0] + np.arange(count) / (fine * channel.sample_rate))


def fineness(effects: Sequence[tuple[str, Mapping[str, float]]], channel: BinnedChannel) -> int:
    """Moments for each sample that a channel needs for what acts on it."""
    ahead = [
        numbers
        for kind, numbers in effects
        if kind == 'low_pass_filter' and _acts_ahead(numbers, channel.sample_rate)
    ]
    if not ahead:
        coupled = any(kind == 'ac_coupling' and numbers['corner'] > 0 for kind, numbers in effects)
        return _fine_enough(channel, _COUPLED, _COUPLED_AT_MOST) if coupled else 1
    enough = _fine_enough(channel, _FINEST, _FINE)
    return enough << max(_doubled(numbers, channel.sample_rate) for numbers in ahead)


def _fine_enough(channel: BinnedChannel, rate: float, most: int) -> int:
    return min(most, math.ceil(rate / channel.sample_rate))


def _doubled(numbers: Mapping[str, float], rate: float) -> int:
    """Times that the moments of a filter that runs both ways before sampling are doubled."""
    if numbers['zero_phase'] <= 0.5:
        return 0
    enough = rate * min(_FINE, math.ceil(_FINEST / rate))
    times = math.ceil(math.log2(max(_BOTH_WAYS * numbers['cutoff'] / enough, 1.0)))
    return times if times <= _DOUBLED else 0


def _acts_ahead(numbers: Mapping[str, float], rate: float) -> bool:
    """Whether a low-pass acts before the samples are taken: far up it can do nothing else."""
    return numbers.get('ahead', 0.0) > 0.5 or numbers['cutoff'] >= HIGHEST * rate


def distort(
    kind: str,
    clean: Array,
    moments: Array,
    channel: BinnedChannel,
    numbers: Mapping[str, float],
    fine: int = 1,
) -> Array:
    """Values of a channel at ``moments`` (s), shape (n,), after an effect of its chain.

    ``fine``: moments for each sample.
    """
    rate = fine * channel.sample_rate
    if kind == 'clock_error' or kind == 'quantisation':
        return clean
    if kind == 'offset':
        return clean + numbers['value']
    if kind == 'zero_drift':
        return clean + numbers['rate'] * moments
    if kind == 'mains_hum':
        angle = 2 * math.pi * numbers['frequency'] * moments
        return clean + numbers['sine'] * np.sin(angle) + numbers['cosine'] * np.cos(angle)
    if kind == 'saturation':
        return np.clip(clean, -numbers['limit'], numbers['limit'])
    if kind == 'low_pass_filter':
        if _acts_ahead(numbers, channel.sample_rate):
            return _ahead(clean, rate, numbers)
        return _low_pass(clean, rate, numbers)
    acting = mechanism(kind).distort
    if acting is None:
        raise ImpactscopeError(f'{kind} is not an effect on samples')
    return np.asarray(acting(clean, rate, numbers), dtype=np.float64)


def coupled_since(
    contact: float,
    clean: Array,
    moments: Array,
    channel: BinnedChannel,
    effects: Sequence[tuple[str, Mapping[str, float]]],
    fine: int = 1,
) -> Array:
    """Values of an impactor's channel after AC coupling, shape (n,).

    An impactor is held, let go and falls before it strikes, and of that no model tells. What it
    left in the coupling is told by what was read meanwhile: the input of a high-pass is its
    reading and the integral of that. Only where the reading right before the contact is that of
    one that has been falling for long, as a simulation may have it, the coupling is settled.

    Args:
        contact: first moment of which the model tells, s.
        clean: values that come to the coupling at ``moments``, s, shape (n,).
        moments: ``fine`` for each sample.
        channel: what was read.
        effects: that and what acts behind it in the chain.
        fine: moments for each sample.
    """
    (_, numbers), *behind = effects
    corner = min(numbers['corner'], HIGHEST * channel.sample_rate)
    begin = int(np.searchsorted(moments, contact))
    known = -(-begin // fine)  # samples before
    if corner == 0.0 or begin == 0:
        return clean
    added = np.zeros(known)
    for kind, own in behind:
        if kind in _ADDED:
            added = distort(kind, added, channel.time[:known], channel, own)
    read = np.nan_to_num(channel.samples[:known] - added)
    b, a = high_pass(corner, channel.sample_rate)
    entered = signal.lfilter(a, b, read)
    held = clean.copy()
    held[:begin] -= np.repeat(entered - read, fine)[:begin]
    finer = high_pass(corner, fine * channel.sample_rate)
    fallen = signal.lfilter(*finer, clean, zi=-finer[0][:1] * clean[0])[0]
    last = slice(max(0, known - math.ceil(_BEFORE * channel.sample_rate)), known)
    missed = [float(np.sum((p[:begin:fine] - read)[last] ** 2)) for p in (held, fallen)]
    if missed[1] < missed[0]:
        return np.asarray(fallen)
    left = np.array([finer[0][1] * entered[-1] - finer[1][1] * read[-1]])
    held[begin:] = signal.lfilter(*finer, clean[begin:], zi=left)[0]
    return held


def _low_pass(samples: Array, rate: float, numbers: Mapping[str, float]) -> Array:
    sections = low_pass(round(numbers['order']), numbers['cutoff'], rate)
    if numbers['zero_phase'] > 0.5:
        return forwards_and_backwards(sections, samples)
    return forwards(sections, samples, float(samples[0]))


def _ahead(course: Array, rate: float, numbers: Mapping[str, float]) -> Array:
    """What a low-pass before the converter makes of a course that is smooth but for a few corners.

    The filter's response is that to straight lines between the moments. A curved course lies
    beside them by arcs; what the filter passes of these is taken off first. One without a phase
    ran forwards and backwards over samples that were thinned out afterwards.
    """
    if course.size < 3:
        return course
    if numbers['zero_phase'] > 0.5 and _BOTH_WAYS * numbers['cutoff'] > 2.0 * rate:
        return course  # so high that it does nothing
    forwards = _one_way(course, rate, numbers)
    if numbers['zero_phase'] <= 0.5:
        return forwards
    return _one_way(forwards[::-1], rate, numbers)[::-1]


def _one_way(course: Array, rate: float, numbers: Mapping[str, float]) -> Array:
    sections, rest, arcs = _analogue(round(numbers['order']), numbers['cutoff'] / rate)
    straight = course.copy()
    straight[1:-1] -= arcs * np.diff(course, 2)
    return np.asarray(signal.sosfilt(sections, straight, zi=rest * straight[0])[0])


@functools.lru_cache(maxsize=64)
def _analogue(order: int, turns: float) -> tuple[Array, Array, float]:
    """Sections of an analogue Butterworth, state at rest, and the share of arcs it passes.

    ``turns``: cut-off over the rate. An arc over a step h lies y'' h^2 / 12 beside its chord on
    average, and has the lines -y'' h^2 / (2 pi^2 n^2) cos(2 pi n t / h), which are all one at the
    moments themselves.
    """
    below = signal.butter(order, 1.0, analog=True)
    above, under, _ = signal.cont2discrete(below, 2.0 * math.pi * turns, method='foh')
    sections = signal.tf2sos(np.ravel(above), under)
    line = np.arange(1, _LINES + 1)
    passed = 1.0 / np.polyval(below[1], 1j * line / turns)
    arcs = (1.0 - 6.0 / math.pi**2 * float(np.sum(passed.real / line**2))) / 12.0
    return sections, signal.sosfilt_zi(sections), arcs


def softened(residual: Array, jump: Array, centres: Array, kinks: Array) -> Array:
    """Residuals with a jump of the acceleration as an uncertainty right at the reversals.

    ``jump`` is its size over the noise. Without this a sample that changes sides would change
    chi-square by the square of the jump, and no fit could settle.
    """
    place = np.searchsorted(centres, kinks)
    out = residual.copy()
    for shift in (-1, 0):
        index = np.clip(place + shift, 0, centres.size - 1)
        near = np.abs(centres[index] - kinks) / _KINK_TIME
        index, near = index[near < 3.0], near[near < 3.0]
        variance = (0.7 * jump[index]) ** 2 * np.exp(-(near**2))
        out[index] = residual[index] / np.sqrt(1.0 + variance)
    return out
