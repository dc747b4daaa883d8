"""Noise that is not white: its covariance from the quiet before the blows, and residuals whitened.

Noise of a channel is white noise and a sum of parts that each forget within a time of their own
(Ornstein and Uhlenbeck's process); times a factor of three apart make any spectrum that falls
with frequency, 1/f among them. The variances are those of greatest likelihood (Whittle, Ark. Mat.
2, 1953), found by multiplicative steps that keep them positive (Fevotte et al., Neural Comput.
21, 2009). Means over bins then have a covariance in closed form, and residuals are whitened by
conditioning each on some before it (Vecchia, J. R. Stat. Soc. B 50, 1988): the nearest, and
further ones at growing distances.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ['Colour', 'Whitener', 'colour_of', 'whitener']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SHORTEST = 64  # samples of a quiet stretch
_GAIN = 10.0  # twice the logarithm of the likelihood, from which noise is not white
_STEPS = 1500  # of the multiplicative kind
_TAKEN = 2.0  # Hz and bins about the mains and their harmonics that may be a hum
_SLOWEST = 4.0  # times the quiet stretch, of the slowest part
_FIRST = 3  # first line of a spectrum that is used: offset and drift are no noise
_NEIGHBOURS = (1, 2, 3, 4, 6, 10, 20, 50, 150, 500)
_ALIKE = 0.01  # relative, of neighbourhoods that are one
_MATTERS = 1e-3  # of the variance, of a part


@dataclass(frozen=True, slots=True, eq=False)
class Colour:
    """Autocovariance of a channel's noise: white, and parts that forget exponentially."""

    white: float  # variance of a sample
    variances: Array  # of a sample, shape (n_parts,)
    times: Array  # s, shape (n_parts,)
    sample_rate: float

    @property
    def std(self) -> float:
        """Standard deviation of a sample by all parts."""
        return math.sqrt(self.white + float(np.sum(self.variances)))

    def variance_of_means(self, counts: IntArray) -> Array:
        """Variance of the mean over that many samples, shape as ``counts``."""
        lengths, place = np.unique(counts, return_inverse=True)
        variance = self.white / lengths
        keep = np.exp(-1.0 / (self.times * self.sample_rate))
        for j, n in enumerate(lengths.tolist()):
            lag = np.arange(1, n)
            sums = (keep[:, None] ** lag) @ (n - lag)
            variance[j] += float(self.variances @ (n + 2.0 * sums)) / n**2
        return np.asarray(variance[place].reshape(counts.shape))


@dataclass(frozen=True, slots=True, eq=False)
class Whitener:
    """The residual of each bin less what those before it tell of it, over what is left of it."""

    before: IntArray  # bins that are conditioned on, -1 for none, shape (n_bins, n_neighbours)
    weights: Array  # shape (n_bins, n_neighbours)
    scale: Array  # shape (n_bins,)

    def __call__(self, residuals: Array) -> Array:
        """Whitened residuals, shape (n_bins,) or (n_bins, n_columns)."""
        columns = residuals[:, None] if residuals.ndim == 1 else residuals
        out = _whitened(np.ascontiguousarray(columns), self.before, self.weights, self.scale)
        return np.asarray(out[:, 0] if residuals.ndim == 1 else out)


def colour_of(stretches: Sequence[Array], sample_rate: float) -> Colour | None:
    """The noise in quiet stretches of a channel; None where it is white for all one can see."""
    quiet = [s for s in stretches if s.size >= _SHORTEST and np.isfinite(s).all()]
    if not quiet:
        return None
    longest = max(s.size for s in quiet)
    count = 2 + math.ceil(math.log(_SLOWEST * longest, 3.0))
    lives = 0.5 * np.power(3.0, np.arange(count, dtype=np.float64))  # in samples
    keep = np.exp(-1.0 / lives)
    power, design = [], []
    for stretch in quiet:
        n = stretch.size
        since = np.linspace(-1.0, 1.0, n)
        values = stretch - np.polyval(np.polyfit(since, stretch, 1), since)
        taper = np.hanning(n + 2)[1:-1]
        taper /= math.sqrt(float(taper @ taper))
        spectrum = np.abs(np.fft.rfft(values * taper)) ** 2
        used = _without_mains(n, sample_rate)
        # expectation of the tapered periodogram, exact for each part
        overlap = np.fft.irfft(np.abs(np.fft.rfft(taper, 2 * n)) ** 2)[:n]
        lags = keep[:, None] ** np.arange(n)
        folded = np.zeros((count, 2 * n))
        folded[:, :n] = lags * overlap
        folded[:, n + 1 :] = folded[:, 1:n][:, ::-1]
        expected = np.fft.rfft(folded, axis=1).real[:, ::2][:, : spectrum.size]
        power.append(spectrum[used])
        design.append(np.vstack([np.ones(spectrum.size), np.maximum(expected, 0.0)])[:, used])
    y, a = np.concatenate(power), np.concatenate(design, axis=1)
    level = float(np.mean(y))
    if not level > 0.0:
        return None
    variances = np.full(count + 1, 0.5 * level / count)
    variances[0] = 0.5 * level
    # a taper makes lines next to each other tell the same: two for three
    share = 2.0 / 3.0
    for _ in range(_STEPS):
        model = variances @ a
        variances *= np.sqrt((a @ (y / model**2)) / (a @ (1.0 / model)))
    model = variances @ a
    gain = 2.0 * share * float(np.sum(np.log(level / model) + y / level - y / model))
    if gain < _GAIN:
        return None
    parts = variances[1:]
    # what the stretches are too short to show goes on like the slowest that they do show
    hidden = lives > longest / (2 * math.pi * _FIRST)
    slow = int(np.argmax(hidden)) if hidden.any() else count
    if slow > 0:
        parts[slow:] = np.maximum(parts[slow:], parts[slow - 1])
    matter = parts > _MATTERS * float(np.sum(variances))
    return Colour(
        float(variances[0]), parts[matter], lives[matter] / float(sample_rate), sample_rate
    )


def _without_mains(n: int, sample_rate: float) -> NDArray[np.bool_]:
    """Lines of a spectrum that are used: neither the slowest nor those that a hum may be in."""
    frequency = np.fft.rfftfreq(n, 1.0 / sample_rate)
    used = np.arange(frequency.size) >= _FIRST
    width = _TAKEN + _TAKEN * sample_rate / n
    for mains in (50.0, 60.0):
        for harmonic in (1, 2, 3):
            used &= np.abs(frequency - harmonic * mains) > width
    used[-1] = False
    return used if np.count_nonzero(used) > 8 else np.arange(frequency.size) >= _FIRST


def whitener(colour: Colour, centres: Array, counts: IntArray, std: Array) -> Whitener:
    """For residuals of bins in the order of time, each over its ``std``; shape (n_bins,) each.

    What ``std`` holds beyond the noise is taken as each bin's own.
    """
    keep = 1.0 / (colour.times * colour.sample_rate)
    shape = np.empty((centres.size, colour.times.size))  # attenuation of a part by the mean
    for n in np.unique(counts):
        lag = np.arange(n) - 0.5 * (n - 1)
        shape[counts == n] = np.mean(np.exp(-np.outer(keep, lag)), axis=1)
    parts = shape * np.sqrt(colour.variances) / std[:, None]
    return Whitener(*_conditioned(parts, 1.0 / colour.times, centres, np.array(_NEIGHBOURS)))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _same(parts: Array, centres: Array, before: IntArray, i: int, other: int) -> bool:
    """Whether two bins have neighbours at the same distances with the same shares of noise."""
    step = centres[i] - centres[i - 1]
    for j in range(-1, before.shape[1]):
        a, b = (i, other) if j < 0 else (before[i, j], before[other, j])
        if a < 0 or b < 0:
            return a == b
        apart = (centres[i] - centres[a]) - (centres[other] - centres[b])
        if abs(apart) > _ALIKE * step:
            return False
        for k in range(parts.shape[1]):
            if abs(parts[a, k] - parts[b, k]) > _ALIKE:
                return False
    return True


@njit(cache=True)  # type: ignore[untyped-decorator]
def _conditioned(
    parts: Array, rates: Array, centres: Array, distances: IntArray
) -> tuple[IntArray, Array, Array]:
    n, most = centres.size, distances.size
    before = np.full((n, most), -1, dtype=np.int64)
    weights = np.zeros((n, most))
    scale = np.ones(n)
    like = -1  # bin whose neighbourhood was solved last
    for i in range(n):
        count = 0
        while count < most and distances[count] <= i:
            before[i, count] = i - distances[count]
            count += 1
        if count == 0:
            continue
        if like >= 0 and _same(parts, centres, before, i, like):
            weights[i], scale[i] = weights[like], scale[like]
            continue
        like = i
        joint = np.eye(count)
        cross = np.empty(count)
        for j in range(count):
            a = before[i, j]
            cross[j] = np.sum(parts[i] * parts[a] * np.exp(-rates * (centres[i] - centres[a])))
            for k in range(j):
                b = before[i, k]
                joint[j, k] = joint[k, j] = np.sum(
                    parts[a] * parts[b] * np.exp(-rates * (centres[b] - centres[a]))
                )
        solved = np.linalg.solve(joint, cross)
        weights[i, :count] = solved
        scale[i] = 1.0 / np.sqrt(max(1.0 - np.sum(cross * solved), 1e-6))
    return before, weights, scale


@njit(cache=True)  # type: ignore[untyped-decorator]
def _whitened(columns: Array, before: IntArray, weights: Array, scale: Array) -> Array:
    out = columns.copy()
    for i in range(columns.shape[0]):
        for j in range(before.shape[1]):
            if before[i, j] < 0:
                break
            for k in range(columns.shape[1]):
                out[i, k] -= weights[i, j] * columns[before[i, j], k]
        for k in range(columns.shape[1]):
            out[i, k] *= scale[i]
    return out
