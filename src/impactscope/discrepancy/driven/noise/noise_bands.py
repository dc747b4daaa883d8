"""Levels of noise in bands of frequency, and whitening by one level below a corner, one above."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ['BANDS', 'Bands', 'band_levels', 'in_bands', 'quietest']

Array = NDArray[np.float64]

BANDS = 48
LONGEST, MOST, DRAWS = 2048, 8, 25  # samples, recordings and draws of noise to compare with
EVEN = 0.03  # relative difference of two levels from which noise is not white


@dataclass(frozen=True, slots=True)
class Bands:
    """Whitens noise of two levels, one below and one above a frequency."""

    below: float  # standard deviation of a sample of white noise of that level
    above: float
    corner: float  # Hz
    period: float  # s
    rounding: Callable[[Array], Array] | None = None  # of an input that rests

    def __call__(self, residual: Array) -> Array:
        """A residual, shape (n,), in units of its noise."""
        if self.rounding is not None:
            residual = self.rounding(residual)
        if abs(self.below - self.above) < EVEN * self.below:
            return residual / self.below
        spectrum = np.fft.rfft(residual)
        frequency = np.fft.rfftfreq(residual.size, self.period)
        level = np.where(frequency <= self.corner, self.below, self.above)
        return np.asarray(np.fft.irfft(spectrum / level, residual.size))


def band_levels(samples: Sequence[Array]) -> Array:
    """Mean spectra of several recordings in even bands up to half the rate, shape (BANDS,).

    As the variance that white noise of that level would have. By the median in each band, so that
    lines do not count; a Hann window keeps strong slow signals out of the upper bands.
    """
    found = []
    for x in samples:
        power, edges = in_bands(x)
        pairs = itertools.pairwise(edges)
        found.append([np.median(power[a : max(b, a + 1)]) / np.log(2.0) for a, b in pairs])
    return np.asarray(np.mean(found, axis=0))


def in_bands(samples: Array) -> tuple[Array, NDArray[np.int_]]:
    """Spectrum as of white noise's variance, line by line, and the even bands' first lines.

    Returns:
        Shapes (n // 2 + 1,) and (BANDS + 1,).
    """
    window = np.hanning(samples.size)
    power = np.abs(np.fft.rfft((samples - np.mean(samples)) * window)) ** 2 / np.sum(window**2)
    return power, np.linspace(1, power.size, BANDS + 1).astype(int)


def quietest(samples: Sequence[Array], count: int) -> float:
    """Mean level of the quietest bands of several recordings, as of white noise.

    The quietest of many estimates lie below the truth; by how much, noise of the same size tells.
    """
    level = float(np.mean(np.sort(band_levels(samples))[:count]))
    least = min(x.size for x in samples)
    size = min(least, LONGEST)
    drawn = 1.0 - _drawn(size, min(len(samples), MOST), count)
    # the scatter of a level falls with the root of the lines that tell it
    return level / (1.0 - drawn * math.sqrt(size / least))


@functools.lru_cache(maxsize=64)
def _drawn(size: int, recordings: int, count: int) -> float:
    """The same of white noise of unit level, the mean of several draws."""
    noise = np.random.default_rng(0).standard_normal((DRAWS, recordings, size))
    return float(np.mean([np.mean(np.sort(band_levels(x))[:count]) for x in noise]))
