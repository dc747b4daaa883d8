"""What is known of a measured force: its noise, where it stands still, where it turns sharply."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from impactscope.discrepancy.driven.noise.kalman_whitening import HammerForce
from impactscope.discrepancy.evidence import noise_std

__all__ = ['KnownForce', 'known_force']

Array = NDArray[np.float64]

NOISY = 0.02  # of the force's power: more beyond its band is no noise
UPPER = 0.7  # of half the rate, beyond which the force's noise is looked for
CORNER = 15.0  # times the usual fourth difference of a force
CORNERS = 0.1  # of the samples: more is no corner
SHARP = 1e-4  # of the largest force
STILL = 64  # samples that a force stands still, at least
AGREE = 3.5  # standard deviations
IDLE = 0.1  # of the samples, from which standing still matters


@dataclass(frozen=True, slots=True, eq=False)
class KnownForce:
    """A measured force as well as it is known; arrays (n,)."""

    force: Array
    noise: float  # variance of a sample; NaN where its band leaves no room to tell
    moves: float  # share of the samples in which it does not stand still
    error: HammerForce | None  # of each sample, where it is not the same for all


def known_force(samples: Array) -> KnownForce:
    """A measured force, shape (n,), with its mean in place of its noise where it stands still.

    A mass that friction holds does not answer the noise of the force's sensor, a linear one does:
    friction would be found wherever nothing moves.
    """
    noise = _noise(samples)
    if samples.size < 2 * STILL or not noise > 0.0:
        return KnownForce(samples, noise, 1.0, None)
    still = _still(samples, math.sqrt(noise))
    rest = _noise_at_rest(samples, still, noise)
    if rest < noise:
        noise, still = rest, _still(samples, math.sqrt(rest))
    force, variance = samples.copy(), np.full(samples.size, noise)
    moves = 1.0
    if sum(b - a for a, b in still) > IDLE * samples.size:
        for a, b in still:
            force[a:b] = float(np.mean(samples[a:b]))
            variance[a:b] = noise / (b - a)
        moves -= sum(b - a for a, b in still) / samples.size
    sharp = _corners(samples)
    if moves == 1.0 and not np.any(sharp):
        return KnownForce(samples, noise, 1.0, None)
    error = HammerForce(force, variance + sharp**2, variance, math.sqrt(noise), ())
    return KnownForce(force, noise, moves, error)


def _noise(force: Array) -> float:
    """Variance of a sample that is noise; NaN where the band of the force leaves no room."""
    window = np.blackman(force.size)
    power = np.abs(np.fft.rfft((force - np.mean(force)) * window)) ** 2 / np.sum(window**2)
    level = float(np.median(power[int(UPPER * power.size) :])) / math.log(2.0)
    level = min(level, noise_std(force) ** 2)  # a force that stands still at times tells it better
    return level if level < NOISY * float(np.mean(power)) else math.nan


def _noise_at_rest(force: Array, still: Sequence[tuple[int, int]], noise: float) -> float:
    """Variance of a sample where a force stands still, if clearly below ``noise``; else that.

    A force that turns sharply is loud at all frequencies, and its noise is not seen beside that.
    """
    parts = [force[a:b] - np.mean(force[a:b]) for a, b in still]
    count = sum(p.size - 1 for p in parts)
    if not count:
        return noise
    level = float(sum(p @ p for p in parts)) / count
    return level if level * (1.0 + AGREE * math.sqrt(2.0 / count)) < noise else noise


def _corners(force: Array) -> Array:
    """Error of a force where it turns faster than its samples tell, shape (n,); else zero."""
    fourth = np.zeros(force.size)
    fourth[2:-2] = np.abs(np.diff(force, 4)) / 24.0
    usual = float(np.median(fourth)) / 0.6745
    sharp = ndimage.maximum_filter1d(np.where(fourth > CORNER * usual, fourth, 0.0), 5)
    rare = float(np.mean(sharp > 0.0)) < CORNERS
    plain = float(np.max(sharp)) > SHARP * float(np.max(np.abs(force)))
    return np.asarray(sharp if rare and plain else np.zeros(force.size))


def _still(force: Array, noise: float) -> list[tuple[int, int]]:
    """First and behind last sample of the stretches in which a force is constant but for noise."""
    half = STILL // 2
    total = np.concatenate([[0.0], np.cumsum(force)])
    means = (total[half:] - total[:-half]) / half
    level = AGREE * noise * math.sqrt(2.0 / half)
    flat = np.abs(means[half:] - means[:-half]) < level  # of windows of two halves
    runs = np.diff(np.concatenate([[0], flat.astype(np.int8), [0]])).nonzero()[0].reshape(-1, 2)
    found = []
    for a, b in runs:
        first, last = int(a) + half // 2, int(b) + 2 * half - half // 2 - 1
        if last - first < STILL:
            continue
        part = force[first:last]
        apart = np.abs(part - np.mean(part))
        slope = np.polyfit(np.linspace(-1.0, 1.0, part.size), part, 1)[0]
        if np.max(apart) < (AGREE + 2.0) * noise and abs(slope) < AGREE * noise * math.sqrt(
            3.0 / part.size
        ):
            found.append((first, last))
    return found
