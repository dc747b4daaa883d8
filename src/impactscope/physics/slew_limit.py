"""A reading that cannot rise or fall any faster than at some rate, as behind a slow amplifier."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impactscope.physics.mechanisms.compiled import compiled

__all__ = ['behind']

Array = NDArray[np.float64]


def behind(reading: Array, most: float) -> Array:
    """How far a reading stays behind that moves by no more than ``most`` a sample.

    Args:
        reading: as it would be without the limit, shape (n,).
        most: change from sample to sample, in the unit of the reading; at least zero.

    Returns:
        What is to be added to the reading, shape (n,); nothing to the first sample.
    """
    short = np.zeros(reading.size)
    _follow(np.ascontiguousarray(reading, dtype=np.float64), most, short)
    return short


@compiled
def _follow(reading: Array, most: float, short: Array) -> None:
    for i in range(1, reading.size):
        wanted = reading[i] - reading[i - 1] - short[i - 1]
        short[i] = min(max(wanted, -most), most) - wanted
