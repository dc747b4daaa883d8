"""Rounding error of an input that rests: it stays as long as its reading does.

A converter whose steps are larger than its noise reads the same value again and again while the
quantity rests or moves slowly. What it rounds off is then no noise of single samples: the whole
stretch is off by up to half a step (Widrow and Kollar, Quantization Noise (2008), ch. 5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.noise.quantisation import step_of

__all__ = ['Rounding', 'rounding_of']

Array = NDArray[np.float64]

SHORTEST = 8  # samples of a stretch
MATTERS = 0.05  # variance of a stretch's mean by rounding over that by noise


@dataclass(frozen=True, slots=True, eq=False)
class Rounding:
    """Whitens a residual whose stretches have an error of their own; arrays (stretches,)."""

    first: NDArray[np.int64]  # sample of each stretch, the whole recording in stretches
    length: NDArray[np.int64]
    share: Array  # of its mean that a stretch loses

    def __call__(self, residual: Array) -> Array:
        """A residual, shape (n,), whose noise is then white."""
        mean = np.add.reduceat(residual, self.first) / self.length
        return np.asarray(residual - np.repeat(self.share * mean, self.length))


def rounding_of(samples: Array, noise: float) -> Rounding | None:
    """What the rounding of an input, shape (n,), does to a residual with white noise besides."""
    step = step_of(samples)
    if step <= 0.0 or not noise > 0.0:
        return None
    first = np.concatenate([[0], 1 + np.flatnonzero(np.abs(np.diff(samples)) > 0.5 * step)])
    length = np.diff(np.concatenate([first, [samples.size]]))
    ratio = np.where(length >= SHORTEST, length * step**2 / 12.0 / noise**2, 0.0)
    if not np.any(ratio > MATTERS):
        return None
    return Rounding(first, length, 1.0 - 1.0 / np.sqrt(1.0 + ratio))
