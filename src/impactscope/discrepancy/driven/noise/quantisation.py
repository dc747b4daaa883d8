"""The step of a converter, from the lattice on which its samples lie."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ['step_of']

Array = NDArray[np.float64]

COARSE = 40.0  # rounding errors of single precision that a step must exceed to be seen


def step_of(samples: Array) -> float:
    """Step of the lattice on which samples, shape (n,), lie in single precision; 0 without one."""
    levels = np.unique(samples)
    if levels.size < 3:
        return 0.0
    gaps = np.diff(levels)
    rounding = float(np.finfo(np.float32).eps) * float(np.max(np.abs(levels)))
    step = float(np.min(gaps))
    if step <= COARSE * rounding:
        return 0.0
    for most in (1.5, 4.5, 20.5, math.inf):  # ever wider gaps tell the step ever better
        near = gaps[gaps < most * step]
        step = float(np.sum(near) / np.sum(np.round(near / step)))
    off = np.abs(gaps - step * np.round(gaps / step))
    return step if float(np.max(off)) < 0.02 * step + 2.0 * rounding else 0.0
