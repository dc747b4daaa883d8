"""Trajectory of a measured motion with its derivatives, right in the whole band of the motion.

A force may stand a thousand noises high, so a derivative must be right to 1e-5 where the motion
is; a central difference is wrong by (2 pi f / rate)^2 / 6. A spline of degree 7 is fitted by least
squares, its knots as wide apart as the band of the motion allows: what lies beyond is the noise
of the motion's sensor, and the ends are as good as the middle (de Boor, A Practical Guide to
Splines (2001), ch. XIV). Where a motion begins or turns suddenly the spline has a knot so often
that its speed, or its acceleration, may jump there.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import BSpline, make_interp_spline, make_lsq_spline

from impactscope.discrepancy.driven.data.discontinuities import (
    Discontinuity,
    discontinuities_of,
    needed,
    noise_beside,
)
from impactscope.discrepancy.driven.noise.coloured_noise import Colour, fitted_colour

__all__ = ['KNOTS', 'Trajectory', 'passed_by_spline', 'trajectory_of']

Array = NDArray[np.float64]

DEGREE = 7
KNOTS = 5.0  # in a period of the highest frequency of the motion
CLOSEST = 2.5  # samples from knot to knot, at least; else every sample is passed through
ENDS = 4  # spaces between knots, from an end
PATTERN = 16  # spaces between knots that show what an end does
LOUD = 6.0  # times the noise: where the spectrum has motion
LINES = 11  # of a spectrum, averaged
QUIET = 0.5  # of half the rate, beyond which the noise is looked for
CLOSER = 1.5  # ratio of the spaces between knots that are tried
NOISE = 1.02  # ratio of what a spline leaves to the noise, from which it is right
LEFT = 1.5  # the same in power, about one place
ROUNDS = 2  # of telling motion and noise of a colour apart
BEYOND, PARTS, FEWEST = 2.5, 24, 6  # times the highest line of the motion; parts of the rest
UNLIKE = 4.0  # deviance of the middle one, from which that is no noise
FASTER = 3.0  # than the steepest step between samples: no course between them is
BEND = 2.5  # over the space between knots: how fast an error changes


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Position, speed and acceleration at the samples, shape (3, n)."""

    motion: Array
    noise: float  # standard deviation of a sample of the measured motion
    band: float  # Hz, up to which that noise is left in the course
    ends: Array  # by how much the variance of the same is larger near ends and breaks, (3, n)
    colour: Colour | None = None  # of that noise, over the variance of a sample; None: white


def trajectory_of(samples: Array, period: float, order: int, knots: float = KNOTS) -> Trajectory:
    """Course through noisy samples, shape (n,), of a position (``order`` 0) or a speed (1).

    ``knots``: in a period of the highest frequency of the motion.
    """
    time = period * np.arange(samples.size, dtype=np.float64)
    beside = noise_beside(samples)
    breaks = discontinuities_of(samples, beside)
    top, noise, colour = _band(samples, period)
    spacing = max(1.0 / (knots * top), 0.0)
    if spacing < CLOSEST * period:
        if breaks:
            return _broken(samples, period, order, beside, breaks)
        spline = make_interp_spline(time, samples, DEGREE)
        band, ends = 0.5 / period, np.zeros((3, samples.size))
    else:
        count = max(int(np.ceil(time[-1] / spacing)), 1)
        inner = np.linspace(0.0, time[-1], count + 1)
        places = np.concatenate([np.full(DEGREE, 0.0), inner, np.full(DEGREE, time[-1])])
        spline = make_lsq_spline(time, samples, places, DEGREE)
        breaks = needed(breaks, samples - np.asarray(spline(time)), beside)
        if breaks:
            return _broken(samples, period, order, beside, breaks)
        band = 0.5 * count / time[-1]
        shape = _end(time[-1] / count, period, order)
        ends = noise**2 * _about(shape, [0.0, samples.size - 1.0], samples.size)
    return Trajectory(_derived(spline, time, order), noise, band, ends, colour)


def passed_by_spline(cycles: NDArray[np.floating]) -> Array:
    """Share of white noise that is left in a course, by cycles from knot to knot, shape (n,).

    That of the projection on splines (Unser, IEEE Signal Process. Mag. 16 (1999)).
    """
    u = np.clip(np.asarray(cycles, np.float64), 1e-12, 1.0 - 1e-9)
    images = [(u / np.abs(u + k)) ** (2 * (DEGREE + 1)) for k in (-2, -1, 1, 2)]
    passed = 1.0 / (1.0 + np.sum(images, axis=0))
    return np.asarray(np.where(np.asarray(cycles) < 1.0, passed, 0.0))


def _derived(spline: BSpline, time: Array, order: int) -> Array:
    """Position, speed and acceleration, shape (3, n)."""
    rows = [np.asarray(spline(time, k), np.float64) for k in range(3 - order)]
    if order == 1:
        rows.insert(0, np.asarray(spline.antiderivative(1)(time), np.float64))
    return np.stack(rows)


def _broken(
    samples: Array, period: float, order: int, noise: float, breaks: Sequence[Discontinuity]
) -> Trajectory:
    """Course of a motion that breaks; the knots between are as far apart as noise allows."""
    n = samples.size
    time = period * np.arange(n, dtype=np.float64)
    edges = [0.0, *(b.place for b in breaks), n - 1.0]
    spacing = max(b - a for a, b in itertools.pairwise(edges))
    enough = (NOISE + 3.0 / math.sqrt(2.0 * n)) * noise
    spline, once = None, False
    while True:
        knots = period * _knots(edges, [b.smooth for b in breaks], spacing, n)
        try:
            finer = make_lsq_spline(time, samples, knots, DEGREE)
        except (ValueError, np.linalg.LinAlgError):  # a stretch with too few samples
            finer = None
        if finer is None or not np.all(np.isfinite(finer.c)):  # not every such stretch is refused
            if spline is None:
                return _broken(samples, period, order, noise, _fewer(breaks))
            break
        spline = finer
        rest = samples - spline(time)
        if once or spacing / CLOSER < CLOSEST:
            break
        once = float(np.sqrt(np.mean(rest**2))) < enough
        spacing /= CLOSER
    if breaks and not _sound(spline, time, samples):
        return _broken(samples, period, order, noise, _fewer(breaks))
    rest = samples - np.asarray(spline(time))
    motion = _derived(spline, time, order)
    ends = noise**2 * _about(_end(spacing * period, period, order), edges, n)
    local = ndimage.uniform_filter1d(rest**2, max(int(spacing) | 1, 3))
    wrong = np.where(local > LEFT * noise**2, local, 0.0)
    for row in range(order, 3):
        ends[row] += wrong * (BEND / (spacing * period)) ** (2 * (row - order))
    for b in breaks:  # which side a sample lies on is not sure where it lies on the break
        row = min(b.smooth + 1 + order, 2)
        at = slice(max(int(np.ceil(b.place - 1.0)), 0), min(int(b.place + 1.0) + 1, n))
        jump = np.ptp(motion[row, max(at.start - 1, 0) : at.stop + 1])
        ends[row, at] += jump**2
    return Trajectory(motion, noise, 0.5 / (spacing * period), ends)


def _sound(spline: BSpline, time: Array, samples: Array) -> bool:
    """Whether a spline goes no faster than its samples, as it may where few tell of a piece."""
    steepest = float(np.max(np.abs(np.diff(samples)))) / float(time[1])
    return bool(np.max(np.abs(spline(time, 1))) <= FASTER * steepest)


def _fewer(breaks: Sequence[Discontinuity]) -> list[Discontinuity]:
    """Every other break."""
    return list(breaks[::2]) if len(breaks) > 1 else []


def _knots(edges: Sequence[float], smooth: Sequence[int], spacing: float, n: int) -> Array:
    """Knots in samples: even between breaks, and at a break as many as let it break."""
    found = [np.full(DEGREE + 1, 0.0)]
    for k, (a, b) in enumerate(itertools.pairwise(edges)):
        few = int((b - a) / CLOSEST) - 1 if b - a > DEGREE + 2 else 1
        count = max(min(int(np.ceil((b - a) / spacing)), few), 1)
        found.append(np.linspace(a, b, count + 1)[1:-1])
        if k < len(smooth):
            found.append(np.full(DEGREE - smooth[k], b))
    found.append(np.full(DEGREE + 1, n - 1.0))
    return np.concatenate(found)


def _end(spacing: float, period: float, order: int) -> Array:
    """Further variance of position, speed and acceleration from an end on, (3, m), unit noise."""
    inner = spacing * np.arange(PATTERN + 1)
    time = np.minimum(period * np.arange(int(inner[-1] / period) + 1), inner[-1])
    knots = np.concatenate([np.full(DEGREE, 0.0), inner, np.full(DEGREE, inner[-1])])
    rows = BSpline.design_matrix(time, knots, DEGREE)
    scatter = np.linalg.pinv((rows.T @ rows).toarray())
    basis = BSpline(knots, np.eye(scatter.shape[0]), DEGREE)
    reach = min(1 + int(ENDS * spacing / period), time.size // 2)
    found = np.zeros((3, reach))
    for row in range(order, 3):
        shapes = np.asarray(basis(time[:reach], row - order))
        variance = np.einsum('ij,jk,ik->i', shapes, scatter, shapes, optimize=True)
        found[row] = np.maximum(variance - variance[-1], 0.0)
    return found


def _about(shape: Array, edges: Sequence[float], n: int) -> Array:
    """What is true from an end on, shape (3, m), about every edge, shape (3, n)."""
    found = np.zeros((3, n))
    place = np.arange(n, dtype=np.float64)
    for edge in edges:
        far = np.abs(place - edge)
        near = far <= shape.shape[1] - 1
        for row in range(3):
            more = np.interp(far[near], np.arange(shape.shape[1]), shape[row])
            found[row, near] = np.maximum(found[row, near], more)
    return found


def _band(samples: Array, period: float) -> tuple[float, float, Colour | None]:
    """Highest frequency at which there is motion, Hz, the noise of a sample and its colour."""
    n = samples.size
    window = np.blackman(n)  # its far side lobes are lowest
    line = np.linspace(samples[0], samples[-1], n)
    power = np.abs(np.fft.rfft((samples - line) * window)) ** 2 / float(np.sum(window**2))
    level = float(np.median(power[int(QUIET * power.size) :])) / np.log(2.0)
    mean = np.convolve(power, np.full(LINES, 1.0 / LINES), 'same')
    top = _highest(mean, np.full(power.size, level))
    colour = None
    for _ in range(ROUNDS):  # noise that is not white looks like motion beside the white level
        found = _colour_beyond(power, top)
        if found is None:
            break
        colour = found
        top = _highest(mean, colour.power(np.linspace(0.0, 1.0, power.size)))
    if colour is not None:
        level = float(np.mean(colour.power(np.linspace(0.0, 1.0, power.size)[min(top, n // 2) :])))
        colour = colour.times(1.0 / level)
    return max(top / (n * period), 2.0 / (n * period)), float(np.sqrt(level)), colour


def _highest(power: Array, level: Array) -> int:
    """The last line of a spectrum that stands high above a level, at least the first."""
    loud = np.flatnonzero(power[1:] > LOUD * level[1:])
    return int(loud[-1]) + 1 if loud.size else 1


def _colour_beyond(power: Array, top: int) -> Colour | None:
    """The colour of the noise beyond a line of a spectrum; None where it is white or no noise."""
    first = max(BEYOND * top, LINES)
    if first >= power.size:
        return None
    edges = np.unique(np.geomspace(first, power.size, PARTS).astype(int))
    pairs = [(a, b) for a, b in itertools.pairwise(edges) if b - a >= LINES]
    if len(pairs) < FEWEST:
        return None
    place = np.array([0.5 * (a + b - 1) / power.size for a, b in pairs])
    level = np.array([float(np.median(power[a:b])) / np.log(2.0) for a, b in pairs])
    # a window makes lines next to each other tell the same: two for three
    lines = np.array([2.0 * (b - a) / 3.0 for a, b in pairs])
    colour = fitted_colour(place, level, lines)
    if colour is None:
        return None
    ratio = level / colour.power(place)
    deviance = 2.0 * lines * (ratio - 1.0 - np.log(ratio))
    return colour if float(np.median(deviance)) < UNLIKE else None
