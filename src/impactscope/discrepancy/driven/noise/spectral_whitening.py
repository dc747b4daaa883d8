"""Whitening by a spectrum: the filter that makes noise of any colour white.

The filter is the causal one whose answer has its energy as early as may be (minimum phase): from
the spectrum by its cepstrum (Oppenheim and Schafer, Discrete-Time Signal Processing, ch. 13). For
a sensor's noise beside noise that rings in a plate it is the innovations filter that a Kalman
filter settles to. The first samples, before which nothing is known, are scaled by their variance.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import fft, linalg, optimize

from impactscope.discrepancy.driven.compiled import compiled
from impactscope.discrepancy.driven.noise.quantisation import step_of

__all__ = [
    'COARSE',
    'Colour',
    'Spectral',
    'Stepped',
    'counting_share',
    'fitted_colour',
    'levels',
    'stepped',
    'unlike_noise',
    'weight_by_runs',
    'whitening',
]

Array = NDArray[np.float64]

NEAR = 1.5  # steps: readings that differ by less keep to one
ONWARD = 2.5  # readings of a stretch, up to which it only passes by
MOST_SHARED = 0.9  # of the variance of a reading
FIRST = 256  # samples that are scaled by their variance
FORGOTTEN = 1e-7  # of the filter's answer is left aside
LOUD = 30.0  # times what is left: lines with so much signal do not tell the noise
SLOWEST_LINE = 3.0  # of a spectrum, that is no offset or drift of what was fitted
FEWEST_LINES = 5.0  # of a part
PARTS = 60  # into which a spectrum is cut, ever wider
COARSE = 2.2  # noises, of a step beyond which most of them is its rounding; 3.5 where all is
COLOURED = 40.0  # twice the logarithm of the likelihood by which noise is not white
MIXED = 8.0  # the same by which one part that falls is not enough
FEWEST = 12  # parts of a spectrum that tell a colour
# deviance of the middle one of a spectrum's parts; one of a sensor's noise has 1 to 5, a walk 5
UNLIKE = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class Spectral:
    """Turns a residual of one recording into white noise of unit variance."""

    answer: Array  # of the filter, (k,)
    early: Array  # factors of the first samples
    weight: Array | None = None  # of each sample, (n,): 0 where it does not count
    _spectra: dict[int, NDArray[np.complex128]] = field(default_factory=dict, repr=False)

    def __call__(self, residual: Array) -> Array:
        """Innovations, shape (n,)."""
        if self.weight is not None:
            residual = residual * self.weight
        if self.answer.size == 1:
            out = residual * self.answer[0]
        else:
            out = self._filtered(residual)
            first = min(self.early.size, out.size)
            out[:first] *= self.early[:first]
        if self.weight is not None:
            out = out * self.weight
        return np.asarray(out)

    def _filtered(self, residual: Array) -> Array:
        """The filter's spectrum is kept: a search filters recordings a hundred thousand times."""
        length = fft.next_fast_len(residual.size + self.answer.size - 1, real=True)
        spectrum = self._spectra.get(length)
        if spectrum is None:
            spectrum = self._spectra[length] = fft.rfft(self.answer, length)
        filtered: Array = fft.irfft(fft.rfft(residual, length) * spectrum, length)
        return filtered[: residual.size]


@dataclass(frozen=True, slots=True, eq=False)
class Stepped:
    """Turns a residual into units of its noise where a coarse reading stays as it is.

    What the steps of an encoder leave is the same error as long as the reading does not change:
    a run of equal readings tells as much as one of them.
    """

    noise: float
    weight: Array  # square root of what each sample counts, (n,)
    first: NDArray[np.int64]  # sample of each stretch in which the reading keeps to one step
    lost: Array  # of what a stretch's samples have in common, (stretches,)

    def __call__(self, residual: Array) -> Array:
        """Innovations, shape (n,)."""
        seen = residual * self.weight / self.noise
        common = np.add.reduceat(seen * self.weight, self.first) * self.lost
        return np.asarray(seen - self.weight * np.repeat(common, self._lengths()))

    def _lengths(self) -> NDArray[np.int64]:
        return np.diff(np.concatenate([self.first, [self.weight.size]]))

    @property
    def share(self) -> float:
        """Samples that count, of all."""
        return float(np.mean(self.weight**2))


def stepped(samples: Array, noise: float, step: float) -> Stepped | None:
    """The weights of samples some of which repeat the one before; None where none do.

    ``noise``: standard deviation of a sample, what the steps leave included. As long as readings
    go to and fro by one step they share its error, of which each of them tells the same (Widrow
    and Kollar, Quantization Noise (2008), ch. 5).
    """
    changes = np.flatnonzero(np.diff(samples) != 0.0) + 1
    if changes.size + 1 == samples.size:
        return None
    lengths = np.diff(np.concatenate([[0], changes, [samples.size]]))
    weight = np.repeat(1.0 / np.sqrt(lengths), lengths)
    first = _stretches(samples, NEAR * step)
    counts = np.add.reduceat(weight**2, first)
    share = min(step**2 / 12.0 / noise**2, MOST_SHARED)
    # a stretch's covariance is one minus the share, and the share between any two of its readings
    scale = 1.0 - 1.0 / np.sqrt(1.0 + counts * share / (1.0 - share))
    lost = np.where(counts > ONWARD, scale / counts, 0.0)
    return Stepped(noise, weight, first, lost)


@compiled
def _stretches(samples: Array, most: float) -> NDArray[np.int64]:
    """First samples of stretches in which readings differ by no more than ``most``."""
    found = np.zeros(samples.size, dtype=np.int64)
    count, low, high = 1, samples[0], samples[0]
    for i in range(1, samples.size):
        low, high = min(low, samples[i]), max(high, samples[i])
        if high - low > most:
            found[count] = i
            count += 1
            low = high = samples[i]
    return found[:count].copy()


def weight_by_runs(samples: Array, noise: float) -> Array | None:
    """What each sample of a coarse reading counts, shape (n,); None where its steps are fine.

    ``noise``: standard deviation of a sample, steps included. Where that is little more than what
    steps leave, a reading that rests has one error throughout.
    """
    step = step_of(samples)
    made = stepped(samples, noise, step) if step > COARSE * noise else None
    return None if made is None else made.weight


def counting_share(filters: Sequence[object]) -> float:
    """Samples that count, of all, where encoders' readings repeat."""
    return min((f.share for f in filters if isinstance(f, Stepped)), default=1.0)


def whitening(power: Array, weight: Array | None = None) -> Spectral:
    """The filter for noise of a spectrum.

    Args:
        power: variance that white noise of that level would have, on an even grid of frequencies
            from 0 to half the sampling rate, shape (m + 1,).
        weight: of each sample, 0 or 1.
    """
    if np.ptp(power) < 1e-6 * float(np.max(power)):
        return Spectral(np.array([1.0 / math.sqrt(float(power[0]))]), np.ones(0), weight)
    length = 2 * (power.size - 1)
    cepstrum = np.fft.irfft(-0.5 * np.log(power), length)
    cepstrum[1 : length // 2] *= 2.0
    cepstrum[length // 2 + 1 :] = 0.0
    answer = np.fft.irfft(np.exp(np.fft.rfft(cepstrum)), length)[: length // 2]
    size = np.abs(answer)
    kept = int(np.flatnonzero(size > FORGOTTEN * float(np.max(size)))[-1]) + 1
    answer = answer[:kept]
    first = min(FIRST, length // 2)
    covariance = linalg.toeplitz(np.fft.irfft(power, length)[:first])
    start = np.zeros(first)
    start[: min(kept, first)] = answer[:first]
    rows = linalg.toeplitz(start, np.zeros(first))
    variance = np.einsum('ij,jk,ik->i', rows, covariance, rows, optimize=True)
    return Spectral(answer, 1.0 / np.sqrt(np.maximum(variance, 1.0)), weight)


def levels(samples: Sequence[Array], *, slow: bool = False) -> tuple[Array, Array]:
    """Spectra of several recordings in parts that grow with the frequency.

    Returns the middle of each part over half the sampling rate and its level, the variance that
    white noise would have; by the median, so that lines do not count. Shapes (k,). ``slow``: down
    to the slowest lines, where an error of the model, if there is any, would be largest.
    """
    shortest = min(x.size for x in samples)
    parts = min(PARTS, max(shortest // 24, 3))
    edges = np.geomspace(min(8.0 / shortest, 0.2), 1.0, parts + 1)
    if slow:
        edges = _edges(shortest, parts)
    middle, found = np.sqrt(edges[1:] * edges[:-1]), []
    for x in samples:
        window = np.hanning(x.size)
        power = np.abs(np.fft.rfft((x - np.mean(x)) * window)) ** 2 / np.sum(window**2)
        places = np.linspace(0.0, 1.0, power.size)
        row = []
        for a, b in itertools.pairwise(edges):
            part = power[(places >= a) & (places < b)]
            row.append(np.median(part) / math.log(2.0) if part.size > 3 else np.nan)
        found.append(row)
    table = np.asarray(found)
    keep = np.all(np.isfinite(table), axis=0)
    return middle[keep], np.asarray(np.mean(table[:, keep], axis=0))


@dataclass(frozen=True, slots=True)
class Colour:
    """A spectrum of noise: white, and parts that fall with the frequency."""

    white: float
    parts: tuple[tuple[float, float], ...]  # level, and corner over half the rate; 0: one over f

    def power(self, place: Array, least: float = 0.0) -> Array:
        """Variance that white noise of the level at frequencies over half the rate would have.

        ``place``: shape (k,); ``least``: below it one over f grows no further.
        """
        return np.asarray(
            self.white + sum(level * _fall(place, corner, least) for level, corner in self.parts)
        )


def _fall(place: Array, corner: float, least: float = 0.0) -> Array:
    if corner == 0.0:
        return np.asarray(1.0 / np.maximum(place, least))
    return np.asarray(1.0 / (1.0 + (place / corner) ** 2))


def _edges(size: int, parts: int) -> Array:
    """Where parts of a spectrum begin, over half the rate: ever wider, none of few lines."""
    line = 2.0 / size
    edges = [min(SLOWEST_LINE * line, 0.2)]
    ratio = edges[0] ** (-1.0 / parts)
    while edges[-1] < 1.0:
        edges.append(max(edges[-1] + FEWEST_LINES * line, edges[-1] * ratio))
    edges[-1] = 1.0
    return np.asarray(edges)


def fitted_colour(
    place: Array, left: Array, signal_there: Array, lines: float, slowest: float = 0.0
) -> Colour | None:
    """The colour of noise; None where it is white.

    The noise is a + b / (1 + (f/c)^2), or with one over f in place of the second term, or with
    both: nothing that falls so slowly can take the place of a resonance.

    Args:
        place: frequencies over half the rate, shape (k,).
        left: levels of what a fit leaves there.
        signal_there: levels of the prediction.
        lines: of the spectrum in all, over which the parts are spread.
        slowest: corner below which no noise falls, not even with one over f.
    """
    quiet = signal_there < LOUD * left
    if np.count_nonzero(quiet) < FEWEST or place[quiet][0] > 0.2:
        return None
    f, power = place[quiet], left[quiet]
    widths = np.gradient(place)[quiet] * lines
    white = float(np.average(power, weights=widths))
    flat = float(np.sum(widths * (math.log(white) + power / white)))

    def best(corners: tuple[float, ...]) -> tuple[float, Colour]:
        shapes = [_fall(f, corner) for corner in corners]

        def cost(q: Array) -> float:
            level = np.exp(q[0]) + sum(
                np.exp(x) * shape for x, shape in zip(q[1:], shapes, strict=True)
            )
            return float(np.sum(widths * (np.log(level) + power / level)))

        start = np.log(
            [0.5 * white + 1e-300, *(0.5 * white / float(np.median(s)) + 1e-300 for s in shapes)]
        )
        made = optimize.minimize(cost, start, method='Nelder-Mead', options={'maxiter': 200})
        low, *falls = (float(v) for v in np.exp(made.x))
        return float(made.fun), Colour(low, tuple(zip(falls, corners, strict=True)))

    corners = [c for c in (0.0, *np.geomspace(0.003, 0.6, 12).tolist()) if c >= slowest]
    least, colour = min((best((c,)) for c in corners), key=lambda item: item[0])
    if 2.0 * (flat - least) <= COLOURED:
        return None
    (_, corner), *_ = colour.parts
    if slowest == 0.0 and corner > 0.0:
        both, mixed = best((corner, 0.0))
        if 2.0 * (least - both) > MIXED:
            return mixed
    return colour


def unlike_noise(colour: Colour, place: Array, left: Array, lines: float) -> bool:
    """Whether a spectrum is far from the nearest colour that a sensor's noise has.

    What errors of a force leave in the position of a mass falls far more steeply.

    Args:
        colour: the nearest one.
        place: frequencies over half the rate, shape (k,).
        left: levels there.
        lines: of the spectrum in all, over which the parts are spread.
    """
    ratio = left / colour.power(place)
    deviance = 2.0 * lines * np.gradient(place) * (ratio - 1.0 - np.log(ratio))
    return float(np.median(deviance)) > UNLIKE
