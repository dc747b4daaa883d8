"""Noise of a channel: its colour, samples of it, and the whitening that undoes it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import lfilter

__all__ = [
    'COLOURS',
    'WHITE',
    'Colour',
    'Whitening',
    'draw_colour',
    'noise',
    'seen_better',
    'spectrum',
]

Array = NDArray[np.float64]

COLOURS = ('first_order', 'flicker', 'steps')
_LOWEST, _OCTAVES, _COUNT = 1e-5, 2.0, 8  # corners of flicker noise: share of the rate, spacing


class Colour(NamedTuple):
    """How the variance of a channel's noise is made up, in units of its own.

    A white part and independent processes of first order; the shares sum to 1. The steps of the
    converter come on top and act as further white noise, step²/12.
    """

    white: float = 1.0  # share of the variance
    poles: tuple[float, ...] = ()  # exp(-2 pi corner / rate) of each process
    shares: tuple[float, ...] = ()  # of the variance, one a process
    step: float = 0.0  # of the converter, in standard deviations of the noise

    @property
    def variance(self) -> float:
        """All of it, with the steps, in units of the noise before the converter."""
        return 1.0 + self.step**2 / 12


WHITE = Colour()


def draw_colour(rng: np.random.Generator, kind: str) -> Colour:
    """A colour of one of the ``COLOURS``.

    'first_order': corner at 1 to 20 % of the rate; 'flicker': white and a 1/f part that are
    equal at 0.1 to 10 % of the rate; 'steps': white, with steps of 0.2 to 2 deviations.
    """
    if kind == 'first_order':
        corner = float(10 ** rng.uniform(-2.0, math.log10(0.2)))
        return Colour(0.0, (math.exp(-2 * math.pi * corner),), (1.0,))
    if kind == 'flicker':
        knee = float(10 ** rng.uniform(-3.0, -1.0))
        corners = [_LOWEST * 2 ** (_OCTAVES * i) for i in range(_COUNT)]
        # a density of A/f has the variance A ln 2 in each octave; the white one is 2 a unit rate
        part = 2 * knee * math.log(2) * _OCTAVES
        whole = 1 + part * _COUNT
        poles = tuple(math.exp(-2 * math.pi * c) for c in corners)
        return Colour(1 / whole, poles, (part / whole,) * _COUNT)
    return Colour(step=float(10 ** rng.uniform(math.log10(0.2), math.log10(2.0))))


def noise(rng: np.random.Generator, colour: Colour, std: float, size: int) -> Array:
    """Samples before the converter, of standard deviation ``std``; stationary from the first."""
    total = math.sqrt(colour.white) * rng.normal(0, 1, size) if colour.white else np.zeros(size)
    for pole, share in zip(colour.poles, colour.shares, strict=True):
        drive = rng.normal(0, math.sqrt(share), size)
        drive[1:] *= math.sqrt(1 - pole**2)
        total = total + lfilter([1.0], [1.0, -pole], drive)
    result: Array = std * total
    return result


def spectrum(colour: Colour, frequency: Array) -> Array:
    """Density over that of white noise of the same deviation; frequency as share of the rate."""
    turn = np.exp(-2j * np.pi * frequency)
    density = np.full(frequency.shape, colour.white + colour.step**2 / 12)
    for pole, share in zip(colour.poles, colour.shares, strict=True):
        density += share * (1 - pole**2) / np.abs(1 - pole * turn) ** 2
    return density


def seen_better(colour: Colour) -> float:
    """By how much a further white part is seen better in this noise than in white noise."""
    frequency = (np.arange(4096) + 0.5) / 8192
    return math.sqrt(float(np.mean(spectrum(colour, frequency) ** -2.0)))


class Whitening:
    """Turns samples, in units of the noise, into as many that are white and of unit variance.

    Each sample less what the ones before it foretell of its noise, over the deviation of what
    they do not: the innovations of a Kalman filter whose state are the processes of the colour,
    so that samples that are missing, or less certain, are weighed as they deserve.
    """

    def __init__(self, colour: Colour, seen: NDArray[np.bool_], extra: Array | None = None):
        """``seen``: which samples count; ``extra``: further variance of each, white."""
        white = np.full(seen.size, colour.white + colour.step**2 / 12)
        if extra is not None:
            white += extra
        self._poles = np.array(colour.poles)
        self._seen = seen
        self._gains = np.zeros((seen.size, self._poles.size))
        if self._poles.size:
            self._scale = np.zeros(seen.size)
            _gains(self._poles, np.array(colour.shares), white, seen, self._gains, self._scale)
        else:
            self._scale = seen / np.sqrt(white)

    def __call__(self, values: Array) -> Array:
        """Innovations of ``values``; 0 where a sample does not count."""
        if not self._poles.size:
            weighed: Array = values * self._scale
            return weighed
        result = np.empty(values.size)
        _innovations(self._poles, self._gains, self._scale, np.ascontiguousarray(values), result)
        return result


@njit(cache=True)  # type: ignore[untyped-decorator]
def _gains(
    poles: Array,
    shares: Array,
    white: Array,
    seen: NDArray[np.bool_],
    gains: Array,
    scale: Array,
) -> None:
    """Gain of every process and inverse deviation of every innovation (Riccati recursion)."""
    n = poles.size
    p = np.diag(shares)
    row = np.zeros(n)
    for k in range(white.size):
        if seen[k]:
            total = white[k]
            for i in range(n):
                row[i] = 0.0
                for j in range(n):
                    row[i] += p[i, j]
                total += row[i]
            scale[k] = 1.0 / math.sqrt(total)
            for i in range(n):
                gains[k, i] = row[i] / total
                for j in range(n):
                    p[i, j] -= row[i] * row[j] / total
        for i in range(n):
            for j in range(n):
                p[i, j] *= poles[i] * poles[j]
            p[i, i] += shares[i] * (1.0 - poles[i] * poles[i])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _innovations(poles: Array, gains: Array, scale: Array, values: Array, out: Array) -> None:
    z = np.zeros(poles.size)
    for k in range(values.size):
        left = 0.0
        if scale[k] > 0.0:
            left = values[k]
            for i in range(z.size):
                left -= z[i]
        out[k] = left * scale[k]
        for i in range(z.size):
            z[i] = poles[i] * (z[i] + gains[k, i] * left)
