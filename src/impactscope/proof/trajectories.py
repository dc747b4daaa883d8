"""References that an axis is to follow: moves with trapezoidal speed, quintic moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ['Move', 'position']

Array = NDArray[np.float64]


class Move(NamedTuple):
    """From rest to rest; afterwards the axis is to stay there."""

    start: float  # s
    duration: float  # s
    distance: float  # m
    ramp: float = 0.0  # share of the duration in which speed is gained, to 0.5; 0: quintic


def position(moves: Sequence[Move], t: Array) -> Array:
    """Sum of the moves at times t, s; m."""
    total = np.zeros(t.size)
    for move in moves:
        s = np.clip((t - move.start) / move.duration, 0.0, 1.0)
        if move.ramp > 0:
            r = move.ramp
            gain = np.minimum(s, r) ** 2 / (2 * r)
            even = np.clip(s - r, 0.0, 1 - 2 * r)
            late = np.maximum(s - (1 - r), 0.0)
            share = (gain + even + late - late**2 / (2 * r)) / (1 - r)
        else:
            share = s**3 * (10 - 15 * s + 6 * s**2)
        total += move.distance * share
    return total
