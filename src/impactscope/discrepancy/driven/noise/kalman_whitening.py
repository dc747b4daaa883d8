"""Noise of the measured force in a plate's response, and the Kalman filter that whitens it.

A force that drives a lightly damped plate brings its sensor's noise into the prediction, where it
rings: the residual of the right model is white no longer. Two remedies. A hammer that has left
the plate pushes no more, so its force is zero between blows, whatever the sensor reads (the force
window of modal testing; Ewins, Modal Testing (2000), sec. 3.7). What remains during the blow goes
into the residual's covariance: a Kalman filter of the linear plate, driven by the force's noise,
turns the residual into its innovations, which are white where the model is right (Kailath, IEEE
Trans. Autom. Control 13 (1968)). Least squares on innovations is generalised least squares.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import fft, linalg, ndimage

from impactscope.discrepancy.driven.compiled import compiled
from impactscope.discrepancy.driven.noise.coloured_noise import Colour, kept
from impactscope.discrepancy.evidence import noise_std

__all__ = ['HammerForce', 'Whitener', 'hammer_force', 'whitener']

Array = NDArray[np.float64]

QUIET = 0.6  # share of the samples of a hammer's force that must be quiet
BEYOND = 5.0  # standard deviations of the noise from which a blow begins
MARGIN = 0.1  # of a blow's length is kept before and after it
PAD = 3  # samples besides
LONGEST = 0.1  # s: what lasts longer is no blow of a hammer
ORDERS = (1, 2, 3, 4)  # of the penalty on a rough force
CUTOFFS = 24  # frequencies from which on it smooths, tried
CORNER = 24.0  # fourth difference over error of the force beside a corner of its course


@dataclass(frozen=True, slots=True, eq=False)
class HammerForce:
    """Force of a hammer, zero between blows, and the variance of its error; arrays (n,)."""

    force: Array
    variance: Array  # N^2: sensor's noise and what happens between samples
    smooth_variance: Array  # N^2: of a smoothed sample
    noise: float  # N, of a sample of the sensor
    blows: tuple[tuple[int, int], ...]  # first and behind last sample


def hammer_force(samples: Array, period: float) -> HammerForce | None:
    """The blows in a measured force, shape (n,); None where it is not that of a hammer."""
    noise, level = noise_std(samples), float(np.median(samples))
    if not math.isfinite(noise):
        return None
    largest = float(np.max(np.abs(samples - level)))
    busy = np.abs(samples - level) > max(BEYOND * noise, 1e-4 * largest)
    if largest <= 2.0 * BEYOND * noise or np.mean(busy) > 1.0 - QUIET:
        return None
    busy = ndimage.binary_closing(np.pad(busy, 8), np.ones(7))[8:-8]
    found: list[tuple[int, int]] = []
    edges = np.flatnonzero(np.diff(np.concatenate([[0], busy.astype(np.int8), [0]])))
    for first, last in edges.reshape(-1, 2):
        if last - first < 3:
            if np.max(np.abs(samples[first:last] - level)) > 2.0 * BEYOND * noise:
                return None  # a spike: no force of a hammer
            continue
        if (last - first) * period > LONGEST:
            return None
        margin = PAD + int(MARGIN * (last - first))
        begin, end = max(int(first) - margin, 0), min(int(last) + margin, samples.size)
        if found and begin <= found[-1][1]:
            found[-1] = found[-1][0], end
        else:
            found.append((begin, end))
    if not found:
        return None
    force, variance, smooth_variance = (np.zeros(samples.size) for _ in range(3))
    fourth = np.zeros(samples.size)
    fourth[2:-2] = np.abs(np.diff(samples, 4)) / CORNER
    fourth = ndimage.maximum_filter1d(fourth, 3)
    for begin, end in found:
        force[begin:end], left = _smoothed(samples[begin:end] - level, noise)
        variance[begin:end] = noise**2 + fourth[begin:end] ** 2
        smooth_variance[begin:end] = left
    return HammerForce(force, variance, smooth_variance, noise, tuple(found))


def _smoothed(samples: Array, noise: float) -> tuple[Array, float]:
    """A blow without as much of its noise as its course allows, and what variance is left.

    Else any low-pass of the prediction would seem to explain the recording: it would smooth the
    force. Penalised least squares in the cosine basis (Garcia, Comput. Stat. Data Anal. 54
    (2010)), the order of the penalty and its weight by Stein's unbiased estimate of the risk: what
    smoothing gets wrong stays below the noise that it takes. The impulse is that of the samples.
    """
    n = samples.size
    waves = fft.dct(samples, norm='ortho')
    bends = 2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n)
    least, kept_share = n * noise**2, np.ones(n)  # the samples as they are
    for cutoff in np.geomspace(min(2.0 / n, 0.5), 1.0, CUTOFFS):  # over half the sampling rate
        ratio = bends / (2.0 - 2.0 * math.cos(math.pi * cutoff))
        for order in ORDERS:
            share = 1.0 / (1.0 + ratio**order)
            wrong = float(np.sum(((1.0 - share) * waves) ** 2))
            risk = wrong + noise**2 * (2.0 * float(np.sum(share)) - n)
            if risk < least:
                least, kept_share = risk, share
    made = fft.idct(kept_share * waves, norm='ortho')
    return np.asarray(made), noise**2 * float(np.mean(kept_share**2))


@dataclass(frozen=True, slots=True, eq=False)
class Whitener:
    """Turns a residual into innovations of unit variance; one recording's.

    Its states are those of the plate and of the parts of which the output's noise is made.
    """

    transition: Array  # (k, k)
    shows: Array  # (k,): output of a state
    gain: Array  # (n, k)
    scale: Array  # (n,): one over the innovation's standard deviation
    knowing: Callable[[Colour], Whitener]  # the same where the output's noise has a colour

    def __call__(self, residual: Array) -> Array:
        """Innovations, shape (n,)."""
        out = np.empty(residual.size)
        _innovations(residual, self.transition, self.shows, self.gain, self.scale, out)
        return out

    def logarithm(self) -> float:
        """Logarithm of the determinant of the noise's covariance."""
        return -2.0 * float(np.sum(np.log(self.scale)))


def whitener(
    plate: tuple[float, float, float],
    derivative: int,
    period: float,
    noise: float,
    force: HammerForce | None,
    samples: int,
    colour: Colour | None = None,
) -> Whitener:
    """Filter for the residual of one recording.

    Args:
        plate: mass, damping and stiffness.
        derivative: 0 where the output is a position, 1 a speed, 2 an acceleration.
        period: s between samples.
        noise: standard deviation of the output's white noise.
        force: with its error; None: exact.
        samples: of the recording.
        colour: of the output's noise, over the variance of ``noise``; None: white.
    """
    mass, damping, stiffness = plate
    rates = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    block = np.zeros((3, 3))
    block[:2, :2], block[1, 2] = rates, 1.0 / mass
    block = linalg.expm(block * period)
    parts = () if colour is None else colour.parts
    states = 2 + len(parts)
    transition, push, shows = np.zeros((states, states)), np.zeros(states), np.ones(states)
    transition[:2, :2], push[:2] = block[:2, :2], block[:2, 2]
    shows[:2] = np.eye(3, 2)[derivative] if derivative < 2 else rates[1]
    transition[range(2, states), range(2, states)] = [kept(corner) for _, corner in parts]
    begins = np.zeros(states)
    begins[2:] = [noise**2 * variance for variance, _ in parts]
    through = 1.0 / mass if derivative == 2 else 0.0
    error = np.zeros(samples) if force is None else force.variance
    # smoothing leaves the slow part of the noise as it is
    sensor = np.zeros(samples) if force is None else np.minimum(error, force.noise**2)
    gain, scale = np.empty((samples, states)), np.empty(samples)
    _gains(
        transition,
        push,
        shows,
        begins,
        through,
        noise**2 * (1.0 if colour is None else colour.white),
        np.ascontiguousarray(error),
        np.ascontiguousarray(sensor),
        gain,
        scale,
    )
    known = partial(whitener, plate, derivative, period, noise, force, samples)
    return Whitener(transition, shows, gain, scale, known)


@compiled
def _gains(
    transition: Array,
    push: Array,
    shows: Array,
    begins: Array,
    through: float,
    noise: float,
    error: Array,
    sensor: Array,
    gain: Array,
    scale: Array,
) -> None:
    """Gains of the Kalman filter; the force's noise is in the state and in the output at once.

    ``begins``: variances of the states before the first sample, which those of the noise keep.
    """
    k = shows.size
    p = np.diag(begins)
    fresh = begins * (1.0 - np.diag(transition) ** 2)
    total = noise + np.sum(begins)
    for i in range(scale.size):
        seen = p @ shows
        variance = max(shows @ seen + noise, 1e-12 * total) + sensor[i] * through * through
        column = (transition @ seen + push * (sensor[i] * through)) / variance
        gain[i] = column
        scale[i] = 1.0 / math.sqrt(variance)
        p = transition @ p @ transition.T
        for a in range(k):
            for b in range(k):
                p[a, b] += push[a] * push[b] * error[i] - column[a] * column[b] * variance
            p[a, a] += fresh[a]


@compiled
def _innovations(
    residual: Array, transition: Array, shows: Array, gain: Array, scale: Array, out: Array
) -> None:
    states = shows.size
    now, after = np.zeros(states), np.zeros(states)
    for i in range(residual.size):
        new = residual[i]
        for a in range(states):
            new -= shows[a] * now[a]
        out[i] = new * scale[i]
        after[0] = transition[0, 0] * now[0] + transition[0, 1] * now[1]
        after[1] = transition[1, 0] * now[0] + transition[1, 1] * now[1]
        for a in range(2, states):  # parts of the noise forget each on its own
            after[a] = transition[a, a] * now[a]
        for a in range(states):
            now[a] = after[a] + gain[i, a] * new
