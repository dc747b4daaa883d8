"""Recordings in which the course is given: a prescribed motion and its force, or a bare chain.

Nothing is integrated here but the hysteretic displacement and the force of the branch: all else
follows from the course in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.special import hyp1f1

from .bench import Bench

__all__ = ['Wave', 'course', 'device_force']

Array = NDArray[np.float64]


class Wave(NamedTuple):
    """A vibration that begins, swells, glides in frequency and decays."""

    amplitude: float
    frequency: float  # Hz at its begin
    start: float = 0.0  # s
    phase: float = 0.0  # rad
    rise: float = 0.0  # s, 1 - exp(-(t/rise)²) of it are there after t; 0: at once
    decay: float = 0.0  # 1/s
    glide: float = 0.0  # Hz/s

    def fastest(self, until: float) -> float:
        """Largest angular frequency from its begin to a moment, rad/s; until in s."""
        last = self.frequency + self.glide * max(until - self.start, 0.0)
        return 2 * math.pi * max(self.frequency, last)


def course(waves: Sequence[Wave], t: Array) -> tuple[Array, Array]:
    """Value and rate of change of the sum of waves at times t, s."""
    value, rate = np.zeros(t.size), np.zeros(t.size)
    for wave in waves:
        since = np.maximum(t - wave.start, 0.0)
        angle = 2 * np.pi * (wave.frequency + 0.5 * wave.glide * since) * since + wave.phase
        speed = 2 * np.pi * (wave.frequency + wave.glide * since)
        hull = wave.amplitude * np.exp(-wave.decay * since)
        swell = -wave.decay * hull
        if wave.rise > 0:
            there = np.exp(-((since / wave.rise) ** 2))
            swell = swell * (1 - there) + hull * there * 2 * since / wave.rise**2
            hull = hull * (1 - there)
        begun = t >= wave.start
        value += begun * hull * np.sin(angle)
        rate += begun * (swell * np.sin(angle) + hull * speed * np.cos(angle))
    return value, rate


def device_force(bench: Bench, t: Array, x: Array, v: Array) -> Array:
    """Force of the spring, the damper and the guide at a prescribed motion, N.

    Args:
        bench: its numbers; masses do not count.
        t: s, closely and evenly spaced (the hysteretic displacement and the branch are followed
            from sample to sample); the device has stood until the first.
        x: displacement, m.
        v: speed, m/s; dry friction is zero where it is zero.
    """
    half = 0.5 * bench.clearance
    e = x - np.clip(x, -half, half)
    stiffness = bench.stiffness * (
        1 + bench.modulation * np.sin(2 * np.pi * bench.modulation_frequency * t)
    )
    held = _hysteretic(x, bench.yield_displacement) if bench.hysteretic_share else 0.0
    force = stiffness * ((1 - bench.hysteretic_share) * e + bench.hysteretic_share * held)
    force += bench.cubic * e**3
    force += (
        bench.stop_stiffness * np.maximum(x - bench.stop_travel, 0.0) * (bench.stop_travel > 0)
    )
    force += bench.damping * v
    if bench.second_stiffness:
        force += _branch(bench.second_stiffness, bench.second_damping, t, x, v)
    force += np.where(v > 0, bench.quadratic_forward, -bench.quadratic_backward) * v**2
    dry = np.where(v > 0, bench.friction_forward, bench.friction_backward)
    dry = dry + bench.friction_slope * np.abs(x)
    dry = dry * (1 + (bench.static_ratio - 1) * np.exp(-((v / bench.stribeck_speed) ** 2)))
    result: Array = force + dry * np.sign(v)
    return result


def _branch(stiffness: float, damping: float, t: Array, x: Array, v: Array) -> Array:
    """Force of a spring (N/m) in series with a dashpot (N s/m), N: F' = k v - (k/c) F.

    None at the first sample: a branch that has stood for long has relaxed, wherever it stands.
    Exact for the cubic course between two samples that has their displacements and speeds: the
    branch may relax within a sample or be as slow as the recording is long.
    """
    step = (t[-1] - t[0]) / (t.size - 1)
    faded = step * stiffness / damping  # samples' distance over the relaxation time
    moved, before, after = np.diff(x), step * v[:-1], step * v[1:]
    # speed over a step of length 1: before + (...) u + (...) u²
    slope, bend = 6 * moved - 4 * before - 2 * after, 3 * (before + after) - 6 * moved
    # what is left at the step's end of u^j, integral of u^j exp(-faded (1 - u)) over 0 to 1
    kept = [float(hyp1f1(1, j + 2, -faded)) / (j + 1) for j in range(3)]
    pulled = stiffness * (kept[0] * before + kept[1] * slope + kept[2] * bend)
    held: Array = lfilter([1.0], [1.0, -math.exp(-faded)], pulled)
    return np.concatenate([[0.0], held])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _hysteretic(x: Array, reach: float) -> Array:
    """Bouc-Wen with n = 1, exact for motions that do not turn between two samples."""
    z = np.zeros(x.size)
    for i in range(1, x.size):
        step = x[i] - x[i - 1]
        at = z[i - 1]
        if at * step < 0:  # unloads along the straight line, down to zero
            part = min(abs(step), abs(at))
            side = 1.0 if step > 0 else -1.0
            at += side * part
            step -= side * part
        if step != 0.0:
            side = 1.0 if step > 0 else -1.0
            at = side * (reach - (reach - abs(at)) * math.exp(-abs(step) / reach))
        z[i] = at
    return z
