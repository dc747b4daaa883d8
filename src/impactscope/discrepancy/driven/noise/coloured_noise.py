"""Coloured noise that falls with the frequency: its fit to spectra, and whitening by it.

Parts whose times are a factor of two apart (Ornstein and Uhlenbeck's process, sampled) make any
spectrum that falls no faster than with the square of the frequency: one over f, a random walk,
two corners. No sum of them is like a resonance. Their variances are those of greatest likelihood
(Whittle, Ark. Mat. 2 (1953)), by multiplicative steps that keep them positive (Fevotte et al.,
Neural Comput. 21 (2009)). Residuals are whitened by Kalman's filter, which is exact from the first
sample on, however slow a part is (J. Basic Eng. 82 (1960)).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.compiled import compiled

__all__ = ['COLOURED', 'Colour', 'Forgetting', 'fitted_colour', 'forgetting', 'kept', 'spectrum']

Array = NDArray[np.float64]

COLOURED = 25.0  # twice the logarithm of the likelihood by which noise is not white
STEPS = 1000  # of the multiplicative kind
FASTEST = 0.6  # of half the rate: the largest corner
BELOW = 1.0 / 16.0  # of the lowest frequency that tells: the smallest
APART = 2.0  # ratio of corners
SLOPE, STEEPEST = 2.5, 2.0  # over which the lowest end rises, and by which power at most
LITTLE = 1e-3  # of the power anywhere, of a part that is left aside


@dataclass(frozen=True, slots=True)
class Colour:
    """A spectrum of noise: variance of its white part, and parts that forget."""

    white: float
    parts: tuple[tuple[float, float], ...]  # variance of a sample, and corner over half the rate

    def power(self, place: Array) -> Array:
        """Variance that white noise of the level at frequencies over half the rate would have.

        ``place``: shape (k,).
        """
        return np.asarray(self.white + sum(v * spectrum(place, c) for v, c in self.parts))

    def times(self, factor: float) -> Colour:
        """The same colour of another strength, in power."""
        return Colour(factor * self.white, tuple((factor * v, c) for v, c in self.parts))


def kept(corner: float) -> float:
    """What is left of a part after one sample."""
    return math.exp(-math.pi * corner)


def spectrum(place: Array, corner: float) -> Array:
    """Spectrum of a part of unit variance, whose mean is one."""
    keep = kept(corner)
    return np.asarray(
        (1.0 - keep**2) / ((1.0 - keep) ** 2 + 4.0 * keep * np.sin(0.5 * math.pi * place) ** 2)
    )


def fitted_colour(
    place: Array,
    left: Array,
    lines: Array,
    slowest: float = 0.0,
    seen_as: Callable[[float], Array] | None = None,
    needed: float = COLOURED,
) -> Colour | None:
    """The colour of noise; None where it is white.

    Args:
        place: frequencies over half the rate, shape (k,).
        left: levels of what a fit leaves there.
        lines: of the spectrum that tell each of them; a real one is half a line.
        slowest: corner below which no noise falls.
        seen_as: levels that a part of unit variance has there, by its corner; its spectrum.
        needed: twice the logarithm of the likelihood by which noise is not white.
    """
    white = float(np.average(left, weights=lines))
    if not white > 0.0:
        return None
    lowest = float(np.min(place[place > 0.0]))
    corners = _corners(lowest, slowest)
    shapes = np.stack(
        [np.ones(place.size), *((seen_as or partial(spectrum, place))(c) for c in corners)]
    )
    # each begins with the same share of the power
    sizes = white / np.average(shapes, axis=1, weights=lines) / shapes.shape[0]
    for _ in range(STEPS):
        model = sizes @ shapes
        sizes *= (shapes @ (lines * left / model**2)) / (shapes @ (lines / model))
    model = sizes @ shapes
    gain = 2.0 * float(np.sum(lines * (np.log(white / model) + left / white - left / model)))
    if gain <= needed:
        return None
    if slowest == 0.0 and seen_as is None:
        sizes[1:] = _onward(sizes[1:], corners, place[place > 0.0], model[place > 0.0])
    matter = np.max(sizes[:, None] * shapes / model, axis=1) > LITTLE
    parts = zip(sizes[1:], corners, matter[1:], strict=True)
    return Colour(float(sizes[0]), tuple((float(v), float(c)) for v, c, m in parts if m))


def _onward(sizes: Array, corners: Array, f: Array, model: Array) -> Array:
    """Variances of parts, those below the lowest frequency that tells by how it begins to rise.

    Seen from above they all look alike: only what all together have there is known.
    """
    hidden = corners < f[0]
    level = float(np.interp(SLOPE * f[0], f, model))
    slope = min(max(math.log(float(model[0]) / level) / math.log(SLOPE), 0.0), STEEPEST)
    shares = corners[hidden] ** (1.0 - slope)
    seen = float(sizes[hidden] @ corners[hidden])
    made = sizes.copy()
    made[hidden] = shares * seen / float(shares @ corners[hidden])
    return made


def _corners(lowest: float, slowest: float) -> Array:
    least = max(BELOW * lowest, slowest)
    count = 1 + max(math.ceil(math.log(FASTEST / least, APART)), 1)
    return np.asarray(np.geomspace(least, FASTEST, count))


@dataclass(frozen=True, slots=True, eq=False)
class Forgetting:
    """Turns noise of a colour into white noise of unit variance."""

    keep: Array  # of each part from one sample to the next, (k,)
    gain: Array  # of what a sample tells of the parts, (m, k); the last row goes on
    scale: Array  # one over the innovation's standard deviation, (m,)

    def __call__(self, residual: Array) -> Array:
        """Innovations, shape (n,)."""
        out = np.empty(residual.size)
        _whitened(np.ascontiguousarray(residual), self.keep, self.gain, self.scale, out)
        return out

    def logarithm(self, count: int) -> float:
        """Logarithm of the determinant of the noise's covariance for so many samples."""
        first = self.scale[:count]
        return -2.0 * float(np.sum(np.log(first)) + (count - first.size) * math.log(first[-1]))


@functools.lru_cache(maxsize=64)
def forgetting(colour: Colour, count: int) -> Forgetting:
    """The filter for recordings of up to ``count`` samples."""
    variances = np.array([v for v, _ in colour.parts])
    keep = np.array([kept(c) for _, c in colour.parts])
    gain, scale = np.empty((count, keep.size)), np.empty(count)
    last = _gains(variances, keep, colour.white, gain, scale)
    return Forgetting(keep, gain[:last].copy(), scale[:last].copy())


@compiled
def _gains(variances: Array, keep: Array, white: float, gain: Array, scale: Array) -> int:
    """Fills the gains up to where they stay as they are; returns how many there are."""
    k = keep.size
    p = np.diag(variances)
    total = np.sum(variances) + white
    for i in range(scale.size):
        seen = np.sum(p, axis=1)
        power = max(np.sum(seen) + white, 1e-12 * total)
        moved = 0.0
        for j in range(k):
            gain[i, j] = keep[j] * seen[j] / power
            if i > 0:
                moved = max(moved, abs(gain[i, j] - gain[i - 1, j]))
        scale[i] = 1.0 / math.sqrt(power)
        if i > 64 and moved < 1e-12 and abs(scale[i] - scale[i - 1]) < 1e-12 * scale[i]:
            return i + 1
        for j in range(k):
            for m in range(k):
                p[j, m] = keep[j] * keep[m] * p[j, m] - gain[i, j] * gain[i, m] * power
            p[j, j] += variances[j] * (1.0 - keep[j] ** 2)
    return int(scale.size)


@compiled
def _whitened(residual: Array, keep: Array, gain: Array, scale: Array, out: Array) -> None:
    k, last = keep.size, scale.size - 1
    state = np.zeros(k)
    for i in range(residual.size):
        row = min(i, last)
        left = residual[i] - np.sum(state)
        out[i] = left * scale[row]
        for j in range(k):
            state[j] = keep[j] * state[j] + gain[row, j] * left
