"""A reading that cannot rise or fall any faster than at some rate, as behind a slow amplifier."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impactscope.physics.mechanisms.compiled import compiled

__all__ = ['behind']

Array = NDArray[np.float64]


def behind(reading: Array, most: float) -> Array:
    """How far a reading stays behind that moves by no more than ``most`` a sample.

    ``reading`` as it would be without the limit, shape (n,), in units of ``most``; the answer
    alike, to be added. The first sample is read as it is.
    """
    short = np.zeros(reading.size)
    _follow(np.ascontiguousarray(reading, dtype=np.float64), most, short)
    return short


@compiled
def _follow(reading: Array, most: float, short: Array) -> None:
    for i in range(1, reading.size):
        wanted = reading[i] - reading[i - 1] - short[i - 1]
        short[i] = min(max(wanted, -most), most) - wanted
