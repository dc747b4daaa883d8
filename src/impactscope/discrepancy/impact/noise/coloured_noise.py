"""Coloured noise of a channel: its covariance, from the quiet before the blows.

Noise of a channel is white noise and a sum of parts that each forget within a time of their own
(Ornstein and Uhlenbeck's process); times a factor of two apart make any spectrum that falls
with frequency, 1/f among them. The variances are those of greatest likelihood (Whittle, Ark. Mat.
2, 1953), found by multiplicative steps that keep them positive (Fevotte et al., Neural Comput.
21, 2009). Residuals are whitened by :mod:`.whitening`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, stats

__all__ = [
    'SHORTEST',
    'Colour',
    'colour_of',
    'slowest_seen',
]

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

SHORTEST = 24  # samples of a quiet stretch
_GAIN = 9.0  # twice the logarithm of the likelihood, from which noise is not white
_GAIN_BESIDE = 5.0  # likewise where the noise of another channel is not
_STEPS = 1500  # of the multiplicative kind
_STEPS_AGAIN = 300  # the same from close by
_NOT_RULED_OUT = 0.45  # twice the logarithm of the likelihood: as often too much as too little
_LEAST, _NEAR_ENOUGH = 1e-5, 1.1  # of the variance of a slow part, and to which factor
_TAKEN = 2.0  # Hz and bins about the mains and their harmonics that may be a hum
_SLOWEST = 4.0  # times the quiet stretch, of the slowest part
_FIRST = 3  # first line of a spectrum that is used: offset and drift are no noise
_FIRST_BENT = 4  # the same after a polynomial was taken off
_APART = 2.0  # ratio of the times in which parts forget
_LEVELS = 4  # stretches from which their levels tell slow noise
_SCATTERED = 0.03  # chance from which they do
_TARED = 1e-3  # chance of levels as much alike as they are
_RULED_OUT = 2.71  # twice the logarithm of the likelihood, by which levels rule slow noise out
_SHARES = 40  # of slow noise that are tried
_MATTERS = 1e-3  # of the variance, of a part
_LINES = 256  # of a spectrum that count on their own; beyond, to a factor of e


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

    @property
    def fresh(self) -> float:
        """Standard deviation of what a sample has that the one before does not tell."""
        keep = np.exp(-1.0 / (self.times * self.sample_rate))
        return math.sqrt(self.white + float(self.variances @ (1.0 - keep**2)))

    def scaled(self, factor: float) -> Colour:
        """The same noise, so many times as large."""
        if factor == 1.0:
            return self
        square = factor**2
        parts = square * self.variances
        return dataclasses.replace(self, white=square * self.white, variances=parts)

    def variance_of_means(self, counts: IntArray) -> Array:
        """Variance of the mean over that many samples, shape as ``counts``."""
        there = np.bincount(counts) > 0
        lengths = np.flatnonzero(there)
        place = (np.cumsum(there) - 1)[counts]
        variance = self.white / lengths
        keep = np.exp(-1.0 / (self.times * self.sample_rate))
        for j, n in enumerate(lengths.tolist()):
            lag = np.arange(1, n)
            sums = (keep[:, None] ** lag) @ (n - lag)
            variance[j] += float(self.variances @ (n + 2.0 * sums)) / n**2
        return np.asarray(variance[place].reshape(counts.shape))


@dataclass(frozen=True, slots=True, eq=False)
class _Lines:
    """Spectra of the quiet, what each part of the noise makes of them, and how much they count."""

    power: Array  # shape (n_bands,)
    parts: Array  # expected power by unit variance, shape (n_parts, n_bands)
    weight: Array  # shape (n_bands,)

    def misfit(self, variances: Array) -> float:
        """Minus twice the logarithm of Whittle's likelihood."""
        expected = variances @ self.parts
        return 2.0 * float(self.weight @ (np.log(expected) + self.power / expected))

    def likeliest(self, variances: Array, free: int, steps: int) -> Array:
        """Variances of greatest likelihood, of which the first ``free`` may change."""
        found, some = variances.copy(), self.parts[:free]
        for _ in range(steps):
            expected = found @ self.parts
            up = some @ (self.weight * self.power / expected**2)
            found[:free] *= np.sqrt(up / (some @ (self.weight / expected)))
        return found

    def largest(self, variances: Array, first: int, level: float) -> float:
        """What the spectra do not rule out as the variance of each part from ``first`` on.

        The likeliest variances are none for some parts and too large for their neighbours, where
        spectra are few: the slowest that is seen may be one of those by chance.
        """
        most = self.misfit(variances) + _NOT_RULED_OUT
        low, high = _LEAST * level, level
        while high > _NEAR_ENOUGH * low:
            middle = math.sqrt(low * high)
            tried = variances.copy()
            tried[first:] = middle
            if self.misfit(self.likeliest(tried, first, _STEPS_AGAIN)) < most:
                low = middle
            else:
                high = middle
        return low if low > _LEAST * level else 0.0


def colour_of(
    stretches: Sequence[Array], sample_rate: float, *, bent: bool = False, beside: bool = False
) -> Colour | None:
    """The noise in quiet stretches of a channel; None where it is white for all one can see.

    ``bent``: a polynomial of a motion was taken off the stretches, and slow noise with it.
    ``beside``: another channel's noise is not white, so this one's is more likely not to be.
    """
    quiet = [s for s in stretches if s.size >= SHORTEST and np.isfinite(s).all()]
    if not quiet:
        return None
    longest = max(s.size for s in quiet)
    count = 2 + math.ceil(math.log(_SLOWEST * longest, _APART))
    lives = 0.5 * np.power(_APART, np.arange(count, dtype=np.float64))  # in samples
    first = _FIRST_BENT if bent else _FIRST
    keep = np.exp(-1.0 / lives)
    power, design, widths = [], [], []
    for stretch in quiet:
        n = stretch.size
        since = np.linspace(-1.0, 1.0, n)
        values = stretch - np.polyval(np.polyfit(since, stretch, 1), since)
        taper = np.hanning(n + 2)[1:-1]
        taper /= math.sqrt(float(taper @ taper))
        spectrum = np.abs(np.fft.rfft(values * taper)) ** 2
        used = _without_mains(n, sample_rate, first)
        # expectation of the tapered periodogram, exact for each part
        overlap = np.fft.irfft(np.abs(np.fft.rfft(taper, 2 * n)) ** 2)[:n]
        lags = keep[:, None] ** np.arange(n)
        folded = np.zeros((count, 2 * n))
        folded[:, :n] = lags * overlap
        folded[:, n + 1 :] = folded[:, 1:n][:, ::-1]
        expected = np.fft.rfft(folded, axis=1).real[:, ::2][:, : spectrum.size]
        bands, width = _bands(used)
        power.append(np.add.reduceat(spectrum[used], bands) / width)
        shapes = np.vstack([np.ones(spectrum.size), np.maximum(expected, 0.0)])[:, used]
        design.append(np.add.reduceat(shapes, bands, axis=1) / width)
        widths.append(width)
    y, a, w = np.concatenate(power), np.concatenate(design, axis=1), np.concatenate(widths)
    level = float(np.average(y, weights=w))
    if not level > 0.0:
        return None
    variances = np.full(count + 1, 0.5 * level / count)
    variances[0] = 0.5 * level
    # a taper makes lines next to each other tell the same: two for three
    share = 2.0 / 3.0
    lines = _Lines(y, a, w * share)
    variances = lines.likeliest(variances, count + 1, _STEPS)
    gain = lines.misfit(np.append(level, np.zeros(count))) - lines.misfit(variances)
    white = gain < (_GAIN_BESIDE if beside else _GAIN)
    if white:
        variances = np.append(level, np.zeros(count))
    parts = variances[1:]
    # what the stretches are too short to show goes on as the slowest that they do show may
    hidden = lives > longest / (2 * math.pi * first)
    slow = int(np.argmax(hidden)) if hidden.any() else count
    rate = float(sample_rate)
    if 0 < slow < count and not white:
        unseen = max(parts[slow - 1], lines.largest(variances, slow, level))
        parts[slow:] = np.maximum(parts[slow:], unseen)
        if not bent:
            variances[:] = _as_levels_allow(quiet, lines, variances, 1 + slow, lives)
    seen = Colour(float(variances[0]), parts, lives / rate, rate)
    between = _between(quiet, seen)
    if between > 0.0:
        parts[:] = np.maximum(parts, between) if white else parts
        parts[slow:] = np.maximum(parts[slow:], between)
    elif white:
        return None
    matter = parts > _MATTERS * float(np.sum(variances))
    if not matter.any():
        return None
    return Colour(float(variances[0]), parts[matter], lives[matter] / rate, rate)


def slowest_seen(duration: float, *, bent: bool = False) -> float:
    """Frequency, Hz, from which a quiet stretch of so many s tells of its colour.

    Below, `colour_of` presumes that it goes on as the slowest does that can be seen.
    """
    return (_FIRST_BENT if bent else _FIRST) / duration


def _as_levels_allow(
    quiet: Sequence[Array], lines: _Lines, variances: Array, first: int, lives: Array
) -> Array:
    """Variances with as much of what is slower than stretches can show as levels do not rule out.

    By the likelihood of the spectra and the restricted one of the levels, beside what all have
    and what grows with the time since the beginning. Levels that are more alike than noise lets
    them be were set to zero by who recorded them, and tell nothing.

    Args:
        quiet: the stretches.
        lines: their spectra.
        variances: of the white part and the others, shape (1 + n_parts,).
        first: from where on they are slower, in these.
        lives: samples in which the others forget, shape (n_parts,).
    """
    counts = np.array([s.size for s in quiet])
    if counts.size < _LEVELS or not np.any(variances[first:] > 0.0):
        return variances
    levels = np.array([float(np.mean(s)) for s in quiet])
    free = linalg.null_space(np.stack([np.ones(counts.size), counts / counts.max()]))
    apart = free.T @ levels

    def of_levels(noise: Array) -> tuple[float, float]:
        colour = Colour(float(noise[0]), noise[1:], lives, 1.0)
        covariance = free.T @ (colour.variance_of_means(counts)[:, None] * free)
        scatter = float(apart @ np.linalg.solve(covariance, apart))
        return scatter, float(np.linalg.slogdet(covariance)[1])

    misfits, noises = np.empty(_SHARES), np.empty((_SHARES, variances.size))
    shares = np.geomspace(_LEAST, 1.0, _SHARES)
    for i, share in enumerate(shares.tolist()):
        tried = variances.copy()
        tried[first:] *= share
        noises[i] = tried = lines.likeliest(tried, first, _STEPS_AGAIN)
        scatter, size = of_levels(tried)
        if i == 0 and stats.chi2.cdf(scatter, apart.size) < _TARED:
            return variances
        misfits[i] = lines.misfit(tried) + scatter + size
    return np.asarray(noises[np.flatnonzero(misfits <= np.min(misfits) + _RULED_OUT)[-1]])


def _between(quiet: Sequence[Array], seen: Colour) -> float:
    """Variance of each part of one-over-f noise that the levels of stretches ask for; 0: none.

    Slow noise that no stretch is long enough to show makes their levels differ by more than what
    is seen within them tells. What all have, or what grows with the time since the beginning, is
    no noise. The variance between is that of moments (DerSimonian and Laird, Control. Clin.
    Trials 7, 1986).
    """
    counts = np.array([s.size for s in quiet])
    levels = np.array([float(np.mean(s)) for s in quiet])
    if counts.size < _LEVELS:
        return 0.0
    weights = 1.0 / seen.variance_of_means(counts)
    shapes = np.stack([np.ones(counts.size), counts / counts.max()], axis=1)
    root = np.sqrt(weights)
    basis, _ = np.linalg.qr(shapes * root[:, None])
    left = root * levels
    left = left - basis @ (basis.T @ left)
    scatter, freedom = float(left @ left), counts.size - 2
    if stats.chi2.sf(scatter, freedom) > _SCATTERED:
        return 0.0
    one = dataclasses.replace(seen, white=0.0, variances=np.ones(seen.times.size))
    felt = one.variance_of_means(counts) * weights
    share = float(np.sum(felt) - np.sum(felt @ basis**2))
    return (scatter - freedom) / share


def _without_mains(n: int, sample_rate: float, first: int) -> NDArray[np.bool_]:
    """Lines of a spectrum that are used: neither the slowest nor those that a hum may be in."""
    frequency = np.fft.rfftfreq(n, 1.0 / sample_rate)
    used = np.arange(frequency.size) >= first
    width = _TAKEN + _TAKEN * sample_rate / n
    for mains in (50.0, 60.0):
        for harmonic in (1, 2, 3):
            used &= np.abs(frequency - harmonic * mains) > width
    used[-1] = False
    return used if np.count_nonzero(used) > 8 else np.arange(frequency.size) >= first


def _bands(used: NDArray[np.bool_]) -> tuple[IntArray, Array]:
    """Where bands of a spectrum's used lines begin, and how many each has; shape (n_bands,).

    Noise that forgets exponentially has no lines: high ones that lie within a part in ``_LINES``
    of their frequency tell the same, and their mean as much as all of them.
    """
    place = np.flatnonzero(used)
    octave = np.log(np.maximum(place, _LINES) / _LINES)
    band = np.where(place < _LINES, place, _LINES + np.floor(octave * _LINES).astype(np.int64))
    begin = np.flatnonzero(np.diff(band, prepend=-1))
    return begin, np.diff(np.append(begin, place.size)).astype(np.float64)
