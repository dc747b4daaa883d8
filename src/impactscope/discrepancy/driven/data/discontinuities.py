"""Discontinuities of a measured motion: where its speed or its acceleration jumps.

A ramp, a half-sine step, a sine that starts: no smooth course goes through them. A break is where
the motion goes on, to both sides, like two polynomials that share their value (and maybe their
slope) and no more; it lies between the samples, and where exactly the two tell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

__all__ = ['Discontinuity', 'discontinuities_of', 'needed', 'noise_beside']

Array = NDArray[np.float64]

WIDTHS = (6, 12, 24, 48, 96, 192)  # samples to each side
SMOOTH = 5  # degree that a smooth motion has there
SURE = 80.0  # chi-square of a break
ABOVE = 25.0  # times what is usual around it: else the motion is bent throughout
FOLLOWS = 1.5  # reduced chi-square up to which two polynomials follow
BETTER = 16.0  # chi-square by which a jump of the speed is believed rather than one of its slope
BRANCH, NARROW = (5, 3), 24  # degree of a branch, wide and narrow
APART = 10  # samples from one break to the next, at least
MOST = 20  # samples, on average, for each break
FINE = 17  # places that are tried for a break at once
STILL = 30.0  # chi-square of two numbers, by which a course without breaks is wrong
LAST = 0.01  # samples: how well a place is sought
ORDER = 8  # of the differences that tell the noise
ROUNDING = 3e-8  # of the largest sample: single precision


@dataclass(frozen=True, slots=True)
class Discontinuity:
    """A break: its place in samples, and how many derivatives go through (0: the value alone)."""

    place: float
    smooth: int


def noise_beside(samples: Array) -> float:
    """Noise of a sample, from high differences: breaks are few and do not count."""
    high = np.abs(np.diff(samples, ORDER)) / math.sqrt(math.comb(2 * ORDER, ORDER))
    least = ROUNDING * float(np.max(np.abs(samples)))
    return max(float(np.median(high)) / 0.6745, least, 1e-300)


def discontinuities_of(samples: Array, noise: float) -> list[Discontinuity]:
    """Breaks of a motion, shape (n,), in their order; none where there would be very many."""
    n = samples.size
    strength, width = np.zeros(n), np.zeros(n, dtype=np.int64)
    for w in WIDTHS:
        if 6 * w > n:
            break
        found = _strength(samples, w, noise)
        usual = ndimage.percentile_filter(found, 25, size=min(16 * w, n))
        found = np.where(found > ABOVE * usual, found, 0.0)
        # a wide look is right only where the narrow ones see nothing
        new = (found > SURE) & (ndimage.maximum_filter1d(strength, 4 * w + 1) == 0.0)
        strength, width = np.where(new, found, strength), np.where(new, w, width)
    chosen: list[Discontinuity] = []
    taken = np.zeros(n, dtype=np.bool_)
    for i in np.argsort(-strength):
        if strength[i] <= 0.0 or len(chosen) > n // MOST:
            break
        if not taken[i]:
            there = _placed(samples, int(i), int(width[i]), noise)
            if all(abs(there.place - b.place) >= APART for b in chosen):
                chosen.append(there)
            reach = max(APART, int(width[i]))
            taken[max(i - reach, 0) : i + reach + 1] = True
    if len(chosen) > n // MOST:
        return []
    return sorted(chosen, key=lambda b: b.place)


def needed(breaks: Sequence[Discontinuity], rest: Array, noise: float) -> list[Discontinuity]:
    """Those breaks of which a course without any leaves something, ``rest``, shape (n,).

    Polynomials of a few samples bend less than a fast but smooth motion does.
    """
    strength = np.zeros(rest.size)
    for w in WIDTHS:
        if 6 * w <= rest.size:
            strength = np.maximum(strength, _strength(rest, w, noise))
    reach = ndimage.maximum_filter1d(strength, 2 * APART + 1)
    return [b for b in breaks if reach[round(b.place)] > STILL]


def _strength(samples: Array, w: int, noise: float) -> Array:
    """Chi-square of a break at every sample, shape (n,), by ``w`` samples to each side."""
    t = np.arange(-w, w + 1) / w
    smooth = np.stack([t**k for k in range(SMOOTH + 1)], axis=1)
    bent = np.stack([np.maximum(t, 0.0), np.maximum(t, 0.0) ** 2], axis=1)
    q = np.linalg.qr(smooth)[0]
    shapes = np.linalg.qr(bent - q @ (q.T @ bent))[0]
    found = np.zeros(samples.size)
    for shape in shapes.T:
        found[w:-w] += np.convolve(samples, shape[::-1], 'valid') ** 2
    return found / noise**2


def _placed(samples: Array, i: int, w: int, noise: float) -> Discontinuity:
    """A break near a sample with its place between the samples.

    As many samples to each side tell it as two polynomials can follow.
    """
    best = _sought(samples, float(i), w, noise, max(2.0, 0.5 * w))
    for wider in (2 * w, 4 * w):
        if not wider <= i < samples.size - wider:
            break
        more = _sought(samples, best[0].place, wider, noise, max(2.0, 0.25 * w))
        if more[1] > FOLLOWS:
            break
        best = more
    return best[0]


def _sought(
    samples: Array, near: float, w: int, noise: float, reach: float
) -> tuple[Discontinuity, float]:
    """The best break about a place, and the reduced chi-square that it leaves."""
    first, last = max(round(near) - w, 0), min(round(near) + w + 1, samples.size)
    time: Array = np.arange(first, last, dtype=np.float64)
    part = samples[first:last] - samples[round(near)]
    degree = BRANCH[w <= NARROW]
    best: list[tuple[float, float]] = []
    for smooth in (0, 1):
        place, within, least = near, reach, math.inf
        while within > LAST:
            places = np.linspace(place - within, place + within, FINE)
            left = np.array([_left(part, (time - p) / w, smooth, degree) for p in places])
            k = int(np.argmin(left))
            place, within, least = float(places[k]), 3.0 * within / FINE, float(left[k])
        best.append((least / noise**2, place))
    smooth = 0 if best[0][0] < best[1][0] - BETTER else 1
    free = max(part.size - 2 * degree - 1, 1)
    return Discontinuity(best[smooth][1], smooth), best[smooth][0] / free


def _left(part: Array, t: Array, smooth: int, degree: int) -> float:
    """Sum of squares that two branches leave which share their lowest derivatives."""
    columns = [t**k for k in range(smooth + 1)]
    for k in range(smooth + 1, degree + 1):
        columns += [np.maximum(t, 0.0) ** k, np.minimum(t, 0.0) ** k]
    matrix = np.stack(columns, axis=1)
    rest = part - matrix @ np.linalg.lstsq(matrix, part, rcond=None)[0]
    return float(rest @ rest)
