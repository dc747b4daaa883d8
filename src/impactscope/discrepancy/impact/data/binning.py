"""Binning of samples that keeps what matters, and where the simulation follows the bins.

Before the blow, and where a channel is sampled faster than anything on the bench moves, samples
are averaged over bins, and the simulation over the same span by nodes: two are exact for two
samples and for cubics. Around the first contact every sample counts on its own, up to 30 kHz;
above, those of 50 us are one unless they change quicker.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.evidence import quantisation_step
from impactscope.discrepancy.impact.noise.coloured_noise import Colour

__all__ = ['BinnedChannel', 'binned', 'coarse_step', 'merged']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FINE_UNTIL = 0.025  # s after the onset in which contacts are followed
_FINE_BIN = 5e-5  # s, there
_LATE = 0.3  # s after the onset from which a bench may be still
_STILL = 0.02  # s over which it is
_LONG_BIN = 4e-3  # s, where nothing changes
_RINGING_BIN = 1e-3  # s, where contacts are over
_FLAT = 0.015  # s, at its largest value, that no coarse converter stays without being cut off
_STEPS_BELOW = 4.5  # the top, where it is looked whether that is round
_WIDER = 1.6  # times as wide there: a parabola is 2 to 3 times
_LEVEL_BEFORE = 6e-3, 1e-3  # s before an onset, between which an impactor shows its level
_SOON = 1e-3  # s after the onset in which an impactor shows how hard a blow is ...
_OF_BLOW, _STRUCK = 0.01, 8.0  # share of that, and noises, from which it is in contact
_NODE_STEP = 5e-5  # s
_FLOOR = 0.05  # of the noise, of a sample: what two sound simulations may differ by
_RELATIVE_FLOOR = 2e-4  # of the value
_TIME_FLOOR = 2e-7  # s, of the moment of a sample


@dataclass(frozen=True, slots=True, eq=False)
class BinnedChannel:
    """One channel of one blow in bins; arrays over the bins, shape (n_bins,), unless said."""

    name: str
    unit: str
    sample_rate: float
    time: Array  # of all samples in use, s, shape (n_samples,)
    samples: Array  # shape (n_samples,)
    edges: IntArray  # first sample of each bin, shape (n_bins,)
    counts: IntArray
    nodes: Array  # times at which the simulation is averaged, s, shape (n_nodes,)
    first_nodes: IntArray  # of each bin, shape (n_bins,)
    node_counts: IntArray
    centres: Array  # s
    means: Array
    std: Array  # standard deviation of the means, with what a bench does not repeat
    own_std: Array  # standard deviation of the means by noise alone
    used: NDArray[np.bool_]
    noise: float  # of a sample
    step: float = 0.0  # of the converter, 0 where it cannot be seen
    clipped_at: float = math.inf
    colour: Colour | None = None  # of the noise; None: white

    def averaged(self, at_nodes: Array) -> Array:
        """Means over the bins of what was simulated at the nodes, shape (n_bins,)."""
        return np.asarray(np.add.reduceat(at_nodes, self.first_nodes) / self.node_counts)


def binned(
    channel: ChannelSamples,
    span: tuple[float, float, float],
    sigma: float,
    colour: Colour | None,
    *,
    coarse: bool,
    hangs: bool = False,
    ringing: float = math.inf,
) -> BinnedChannel:
    """One channel in bins.

    Args:
        channel: its samples.
        span: moment of the onset, and how long before and after it counts, s.
        sigma: noise of a sample.
        colour: of the noise; None: white.
        coarse: of a channel that contacts and reversals do not make jump.
        hangs: whether an impactor is at rest before the onset, too.
        ringing: time after the onset, s, from which the bench only rings, without contacts.
    """
    rate = channel.sample_rate
    onset, lead, last = span
    first = max(0, math.ceil((onset - lead - channel.start) * rate))
    stop = min(channel.values.size, math.floor((onset + last - channel.start) * rate) + 1)
    samples = np.asarray(channel.values[first:stop], dtype=np.float64)
    time = channel.start + (first + np.arange(samples.size)) / rate
    since = time - onset
    step = quantisation_step(samples[since < -2e-3])
    dead = coarse_step(channel, onset)
    step = max(step, dead)
    flat = round(_FLAT * rate) if dead > 0.0 else 8 if step > 0.2 * sigma else 3
    clip = _clipping(samples, channel, flat, step)
    # two nodes reproduce two samples exactly; longer bins would blur the kinks of contacts
    shortest = max(1, round(2e-4 * rate))
    size = np.full(samples.size, max(2, shortest) if coarse else shortest)
    size[since < -5e-3] = max(1, round(_LONG_BIN * rate))
    size[since > ringing] = np.maximum(size, round(_RINGING_BIN * rate))[since > ringing]
    size[(since > _LATE) & _still(samples, sigma, round(_STILL * rate))] = max(
        1, round(_LONG_BIN * rate)
    )
    size[(since >= -5e-3) & (since < _FINE_UNTIL)] = max(1, round(_FINE_BIN * rate))
    size[_quick(samples, sigma, round(1.5e-3 * rate))] = 1
    edges = _edges(size)
    counts = np.diff(np.append(edges, samples.size))
    means = np.add.reduceat(samples, edges) / counts if samples.size else samples
    centres = time[edges] + 0.5 * (counts - 1) / rate
    nodes, first_nodes, node_counts = _nodes(time, edges, counts, onset, rate)
    slope = np.gradient(means, centres) if means.size > 1 else np.zeros(means.size)
    variance = sigma**2 / counts if colour is None else colour.variance_of_means(counts)
    fresh = sigma if colour is None else colour.fresh
    variance = variance + (_FLOOR * fresh) ** 2 / counts
    if dead > 0.0:
        variance = variance * _same(samples, edges)
    variance = variance + (_RELATIVE_FLOOR * means) ** 2 + (_TIME_FLOOR * slope) ** 2
    used = np.isfinite(means)
    if channel.name == 'acceleration.impactor' and not hangs:
        used &= edges >= _in_contact(samples, since, rate, sigma)
    if math.isfinite(clip):
        hit = np.abs(samples) >= clip * (1 - 1e-6)
        used &= np.add.reduceat(hit.astype(np.int64), edges) == 0
    std = np.where(used, np.sqrt(np.where(used, variance, 1.0)), 1.0)
    return BinnedChannel(
        name=channel.name,
        unit=channel.unit,
        sample_rate=rate,
        time=time,
        samples=samples,
        edges=edges,
        counts=counts,
        nodes=nodes,
        first_nodes=first_nodes,
        node_counts=node_counts,
        centres=centres,
        means=np.where(used, means, 0.0),
        std=std,
        own_std=std,
        used=used,
        noise=sigma,
        step=step,
        clipped_at=clip,
        colour=colour,
    )


def _in_contact(samples: Array, since: Array, rate: float, sigma: float) -> int:
    """First sample in which an impactor is certainly in contact, of what begins near an onset.

    Before, it falls or is driven as no file says. A blow is seen when a channel leaves its noise
    for certain, which may be some samples into a contact: those right before, that are away from
    the level by more than noise and a hundredth of the blow, belong to it.
    """
    first = int(np.searchsorted(since, 0.5 / rate, side='right'))
    before = samples[(since > -_LEVEL_BEFORE[0]) & (since < -_LEVEL_BEFORE[1])]
    before = before[np.isfinite(before)]
    if not before.size or first >= samples.size:
        return first
    size = np.abs(samples - np.median(before))
    soon = size[first : first + max(1, round(_SOON * rate))]
    threshold = max(_STRUCK * sigma, _OF_BLOW * float(np.nanmax(soon, initial=0.0)))
    while first > 0 and since[first - 1] > -_LEVEL_BEFORE[1] and threshold < size[first - 1]:
        first -= 1
    return first


def merged(moments: Mapping[str, Array]) -> tuple[Array, dict[str, IntArray]]:
    """All moments, rising, each once; and for every channel which of them are its own.

    ``moments``: of each channel, rising.
    """
    flat = np.concatenate(list(moments.values()))
    ends = np.cumsum(np.array([m.size for m in moments.values()], dtype=np.int64))
    ranked, place = _merged(flat, ends)
    begins = (0, *ends[:-1].tolist())
    return ranked, {n: place[b:e] for n, b, e in zip(moments, begins, ends, strict=True)}


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _merged(flat: Array, ends: IntArray) -> tuple[Array, IntArray]:
    """Values of rising runs in one row, rising, each once; and where each of them stands there.

    ``ends``: of the runs, shape (n_runs,).
    """
    heads = np.concatenate((np.zeros(1, dtype=np.int64), ends[:-1]))
    ranked, place = np.empty(flat.size), np.empty(flat.size, dtype=np.int64)
    count = 0
    for _ in range(flat.size):
        first = -1
        for run in range(ends.size):
            if heads[run] < ends[run] and (first < 0 or flat[heads[run]] < flat[heads[first]]):
                first = run
        value = flat[heads[first]]
        if count == 0 or value > ranked[count - 1]:
            ranked[count] = value
            count += 1
        place[heads[first]] = count - 1
        heads[first] += 1
    return ranked[:count].copy(), place


def coarse_step(channel: ChannelSamples, onset: float) -> float:
    """Step of a converter so coarse that nothing moves before the blow; 0 where it is not."""
    quiet = channel.values[channel.start + np.arange(channel.values.size) / channel.sample_rate
                           < onset - 2e-3]  # fmt: skip
    quiet = quiet[np.isfinite(quiet)]
    if quiet.size < 8 or np.unique(quiet).size > 2:
        return 0.0
    return quantisation_step(channel.values)


def _same(samples: Array, edges: IntArray) -> Array:
    """How many samples in a row have the value of each bin's first, shape (n_bins,).

    While a coarse converter stands still, all its samples tell no more than one of them.
    """
    turns = np.flatnonzero(np.diff(samples, prepend=np.nan) != 0.0)
    length = np.diff(np.append(turns, samples.size))
    which = np.searchsorted(turns, edges, side='right') - 1
    return np.asarray(length[which], dtype=np.float64)


def _nodes(
    time: Array, edges: IntArray, counts: IntArray, onset: float, rate: float
) -> tuple[Array, IntArray, IntArray]:
    """Times at which each bin is simulated, the first of each bin, and how many it has.

    One for a sample, and two for two samples or a bin before the blow, so placed that cubics are
    exact. In a bin after the blow contacts may come and go that no noise shows: it is followed
    in steps of ``_NODE_STEP``.
    """
    width = counts / rate
    steps = np.where(counts > 1, 2, 1)
    followed = (width > 2 * _NODE_STEP) & (counts > 2) & (time[edges] > onset)
    steps[followed] = np.ceil(counts / max(1, round(_NODE_STEP * rate)))[followed]
    first = np.concatenate([[0], np.cumsum(steps)[:-1]]).astype(np.int64)
    place = np.arange(int(np.sum(steps))) - np.repeat(first, steps)
    count, parts = np.repeat(counts, steps), np.repeat(steps, steps)
    # means of n equal steps over the samples of a bin; two of them at the nodes of Gauss
    middle = (place + 0.5) / parts * count - 0.5
    half = np.sqrt((count.astype(np.float64) ** 2 - 1.0) / 12.0)
    gauss = 0.5 * (count - 1) + np.where(place > 0, half, -half)
    offset = np.where(parts == 2, gauss, middle)
    return np.repeat(time[edges], steps) + offset / rate, first, steps


def _quick(samples: Array, sigma: float, reach: int) -> NDArray[np.bool_]:
    """Samples near a change that is quicker than a bin could follow."""
    quick = np.zeros(samples.size, dtype=np.bool_)
    if samples.size < 5:
        return quick
    bend = np.abs(samples[2:] - 2.0 * samples[1:-1] + samples[:-2])
    quick[1:-1] = np.nan_to_num(bend) > 8.0 * math.sqrt(6.0) * sigma
    if reach > 0 and quick.any():
        quick = np.convolve(quick, np.ones(2 * reach + 1), 'same') > 0.5
    return quick


def _still(samples: Array, sigma: float, width: int) -> NDArray[np.bool_]:
    """Samples around which nothing is seen but noise."""
    if width < 8:
        return np.zeros(samples.size, dtype=np.bool_)
    known = np.nan_to_num(samples)
    mean = ndimage.uniform_filter1d(known, width)
    power = ndimage.uniform_filter1d((known - mean) ** 2, width)
    loud = power > (1.0 + 4.0 / math.sqrt(width)) * sigma**2
    return np.asarray(~ndimage.binary_dilation(loud, iterations=width))


def _edges(size: IntArray) -> IntArray:
    """First sample of each bin where ``size`` is the wanted length of the bin at each sample."""
    return np.flatnonzero(_begins(size))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _begins(size: IntArray) -> NDArray[np.bool_]:
    """Whether a bin begins at each sample; it does not reach where shorter ones are wanted.

    Bins end at multiples of their length, so that those of several channels are the same.
    """
    begins = np.zeros(size.size, dtype=np.bool_)
    i = 0
    while i < size.size:
        begins[i] = True
        length, reached = size[i] - i % size[i], 1
        while reached < length and i + reached < size.size and size[i + reached] >= length:
            reached += 1
        i += reached
    return begins


def _round(size: Array, peak: float, step: float) -> bool:
    """Whether the largest value is the top of a curve: some steps below it is far wider.

    A curve that is cut off crosses these steps in no time.
    """
    if step <= 0.0:
        return False
    at_top, below = (
        _longest(size >= least) for least in (peak * (1 - 1e-6), peak - _STEPS_BELOW * step)
    )
    return below > _WIDER * at_top


def _longest(mask: NDArray[np.bool_]) -> int:
    """Length of the longest run that is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _clipping(samples: Array, channel: ChannelSamples, length: int, step: float) -> float:
    """Absolute value at which the channel is cut off, inf where it is not.

    ``length``: samples in a row at the largest value from which that is no coincidence; ``step``:
    of the converter, of which a round top is as flat.
    """
    size = np.abs(np.nan_to_num(samples))
    if size.size < 16:
        return math.inf
    peak = float(np.max(size))
    flat = (size >= peak * (1 - 1e-6)).astype(np.int64)
    runs = np.convolve(flat, np.ones(length, dtype=np.int64), 'valid')
    held = runs.max() == length and peak > 5 * float(np.median(size))
    if held and not _round(size, peak, step):
        return peak
    stated = min(abs(channel.range_min), abs(channel.range_max))
    if math.isfinite(stated) and peak >= stated * (1 - 1e-6):
        return stated
    return math.inf
