"""The course of a measured motion and its derivatives, right in the whole band of the motion.

A force may stand a thousand noises high, so a derivative must be right to 1e-5 where the motion
is; a central difference is wrong by (2 pi f / rate)^2 / 6. A spline of degree 7 is fitted by least
squares, its knots as wide apart as the band of the motion allows: what lies beyond is the noise
of the motion's sensor, and the ends are as good as the middle (de Boor, A Practical Guide to
Splines (2001), ch. XIV).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline, make_lsq_spline

__all__ = ['Course', 'course_of']

Array = NDArray[np.float64]

DEGREE = 7
KNOTS = 5.0  # in a period of the highest frequency of the motion
CLOSEST = 2.5  # samples from knot to knot, at least; else every sample is passed through
ENDS = 4  # spaces between knots, from an end
LOUD = 6.0  # times the noise: where the spectrum has motion
LINES = 11  # of a spectrum, averaged
QUIET = 0.5  # of half the rate, beyond which the noise is looked for


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Position, speed and acceleration at the samples, shape (3, n)."""

    motion: Array
    noise: float  # standard deviation of a sample of the measured motion
    band: float  # Hz, up to which that noise is left in the course
    ends: Array  # by how much the variance of position and speed is larger near the ends, (2, n)


def course_of(samples: Array, period: float, order: int) -> Course:
    """Course through noisy samples, shape (n,), of a position (``order`` 0) or a speed (1)."""
    top, noise = _band(samples, period)
    time = period * np.arange(samples.size, dtype=np.float64)
    spacing = max(1.0 / (KNOTS * top), 0.0)
    if spacing < CLOSEST * period:
        spline = make_interp_spline(time, samples, DEGREE)
        band, ends = 0.5 / period, np.zeros((2, samples.size))
    else:
        count = max(int(np.ceil(time[-1] / spacing)), 1)
        inner = np.linspace(0.0, time[-1], count + 1)
        knots = np.concatenate([np.full(DEGREE, 0.0), inner, np.full(DEGREE, time[-1])])
        spline = make_lsq_spline(time, samples, knots, DEGREE)
        band, ends = 0.5 * count / time[-1], noise**2 * _near_ends(knots, time, order)
    chain: list[BSpline] = [spline, spline.derivative(1), spline.derivative(2)]
    if order == 1:
        chain = [spline.antiderivative(1), *chain[:2]]
    motion = np.stack([np.asarray(s(time), np.float64) for s in chain])
    return Course(motion, noise, band, ends)


def _near_ends(knots: Array, time: Array, order: int) -> Array:
    """Further variance of position and speed near the ends, for noise of one, shape (2, n)."""
    rows = BSpline.design_matrix(time, knots, DEGREE)
    scatter = np.linalg.pinv((rows.T @ rows).toarray())
    basis = BSpline(knots, np.eye(scatter.shape[0]), DEGREE)
    reach = min(
        1 + int(ENDS * (knots[DEGREE + 1] - knots[DEGREE]) / (time[1] - time[0])), time.size // 3
    )
    found = np.zeros((2, time.size))
    for part, inner in ((slice(0, reach), -1), (slice(time.size - reach, time.size), 0)):
        for row, derivative in ((0, 0), (1, 1)) if order == 0 else ((1, 0),):
            shapes = np.asarray(basis(time[part], derivative))
            variance = np.einsum('ij,jk,ik->i', shapes, scatter, shapes, optimize=True)
            found[row, part] = np.maximum(variance - variance[inner], 0.0)
    return found


def _band(samples: Array, period: float) -> tuple[float, float]:
    """Highest frequency at which there is motion, Hz, and the noise of a sample."""
    n = samples.size
    window = np.blackman(n)  # its far side lobes are lowest
    line = np.linspace(samples[0], samples[-1], n)
    power = np.abs(np.fft.rfft((samples - line) * window)) ** 2 / float(np.sum(window**2))
    level = float(np.median(power[int(QUIET * power.size) :])) / np.log(2.0)
    mean = np.convolve(power, np.full(LINES, 1.0 / LINES), 'same')
    loud = np.flatnonzero(mean[1:] > LOUD * level)
    top = (int(loud[-1]) + 1 if loud.size else 1) / (n * period)
    return max(top, 2.0 / (n * period)), float(np.sqrt(level))
