"""Noise that recordings share, and of those in which it differs for certain their own.

A cable that was touched, another range of an amplifier, a motor that was on: noise of a channel
need not be the same in all recordings of a campaign. Where it is, all of them tell it best.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ['shared_and_own']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_RELATIVE = 1.4  # times one over the root of the samples, uncertainty of what differences tell
_CERTAIN = 4.5  # standard deviations, from which noise of a recording is another
_LEAST = 1.15  # times the others', less than which is none


def shared_and_own(stds: Array, sizes: IntArray) -> tuple[float, Array]:
    """Standard deviation of the noise that recordings share, and of each of them.

    Args:
        stds: of each recording by itself, from second differences, above zero, shape (n,).
        sizes: samples that told it, shape (n,).

    Returns:
        What those share that do not differ from the median by more than chance and a seventh; and
        of each recording that, or its own where it differs, shape (n,).
    """
    level = np.log(stds)
    order = np.argsort(level)
    passed = np.cumsum(sizes[order])
    middle = level[order][np.searchsorted(passed, 0.5 * passed[-1])]  # of all samples
    told = np.maximum(_CERTAIN * _RELATIVE / np.sqrt(sizes), math.log(_LEAST))
    alike = np.abs(level - middle) <= told
    shared = math.sqrt(float(sizes[alike] @ stds[alike] ** 2) / float(np.sum(sizes[alike])))
    return shared, np.where(alike, shared, stds)
