"""From the stamps of single samples to their indices and their rate."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from impactscope.records import NANOSECONDS

__all__ = [
    'BACKWARDS',
    'DUPLICATE',
    'JUMPED',
    'TAKEN',
    'UNSTAMPED',
    'estimate_rate',
    'number_stamps',
]

WHOLE_HERTZ = 500e-6  # relative; an estimate this close to a whole number of Hz is that number
PULL = 1 / 16  # of a deviation, by which each stamp corrects the timeline
TAKEN, DUPLICATE, BACKWARDS, UNSTAMPED, JUMPED = range(5)  # what a stamp is


@njit(cache=True)  # type: ignore[untyped-decorator]
def number_stamps(
    stamps: NDArray[np.int64],
    period: float,
    jump: float,
    state: NDArray[np.int64],
    fraction: NDArray[np.float64],
    indices: NDArray[np.int64],
    times: NDArray[np.int64],
    kinds: NDArray[np.int64],
) -> None:
    """Give each stamp its index, its time on a smooth line, and what it is.

    ``state`` is the index, stamp and line time of the sample before (index -1: none).
    """
    for k in range(stamps.size):
        stamp = stamps[k]
        indices[k] = state[0]
        times[k] = state[2]
        if stamp <= 0:
            kinds[k] = UNSTAMPED
            continue
        if state[0] < 0:
            state[0], state[1], state[2], fraction[0] = 0, stamp, stamp, 0.0
            indices[k], times[k], kinds[k] = 0, stamp, TAKEN
            continue
        if stamp == state[1]:
            kinds[k] = DUPLICATE
            continue
        expected = fraction[0] + period
        deviation = (stamp - state[2]) - expected
        lost = 0
        kinds[k] = TAKEN
        if deviation < -jump:  # back by more than jitter: another clock, from here on
            kinds[k] = JUMPED
            expected += deviation
            deviation = 0.0
        elif stamp < state[1]:
            kinds[k] = BACKWARDS
            continue
        elif deviation > 0.5 * period:
            lost = math.floor(deviation / period + 0.5)
            expected += lost * period
            deviation -= lost * period
        expected += deviation * PULL
        whole = math.floor(expected)
        state[0] += 1 + lost
        state[1] = stamp
        state[2] += whole
        fraction[0] = expected - whole
        indices[k] = state[0]
        times[k] = state[2]


def estimate_rate(stamps: NDArray[np.int64]) -> float:
    """Rate in Hz from rising stamps: median difference, then a line through all of them.

    The median is not moved by a few lost samples; by it the stamps are counted; the slope of
    stamp over count is not moved by jitter. A rate within 500 ppm of a whole number of Hz, as
    far as the blocks' clock can follow, is that number.
    """
    steps = np.diff(stamps)
    counts = np.concatenate(([0.0], np.cumsum(np.maximum(np.rint(steps / np.median(steps)), 1))))
    counts -= counts.mean()
    elapsed = (stamps - stamps[0]).astype(np.float64)
    period = float(counts @ (elapsed - elapsed.mean()) / (counts @ counts))
    rate = NANOSECONDS / period
    whole = round(rate)
    return float(whole) if whole and abs(rate - whole) <= WHOLE_HERTZ * rate else rate
