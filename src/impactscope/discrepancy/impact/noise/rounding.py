"""Noise of a channel behind a coarse converter: what it is while the bench moves.

At rest the converter shows two or three of its steps, and how much they scatter hangs on where
between two of them the level happens to lie (Widrow and Kollar, Quantization Noise, 2008). While
the bench moves, every place between two steps comes up, and the error of rounding is even.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

__all__ = ['moving_noise']

Array = NDArray[np.float64]

_LEAST_LEVELS = 3  # two do not tell the noise from the level
_RARE = 1e-12  # chance of a step, at least


def moving_noise(quiet: Array, step: float) -> float:
    """Standard deviation of noise and rounding together where a signal moves, unit of ``quiet``.

    Args:
        quiet: samples at one level, shape (n,), on a lattice.
        step: of the lattice.

    Returns:
        Zero where too few steps show to tell. The noise is that of greatest likelihood for how
        often each step shows, taken as normal.
    """
    levels, counts = np.unique(np.round((quiet - np.median(quiet)) / step), return_counts=True)
    if levels.size < _LEAST_LEVELS:
        return 0.0

    def misfit(x: Array) -> float:
        level, sigma = float(x[0]), math.exp(float(x[1]))
        edges = (levels[:, None] + np.array([-0.5, 0.5]) - level) / sigma
        chance = np.diff(stats.norm.cdf(edges), axis=1)[:, 0]
        return -float(counts @ np.log(np.maximum(chance, _RARE)))

    begin = np.array([counts @ levels / counts.sum(), math.log(0.4)])
    found = optimize.minimize(misfit, begin, method='Nelder-Mead')
    sigma = math.exp(float(found.x[1]))
    return step * math.sqrt(sigma**2 + 1.0 / 12.0)
