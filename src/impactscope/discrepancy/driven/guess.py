"""Start values from the equation of motion itself.

With position, speed and acceleration taken from the measured output, most laws are linear in
their numbers: one linear regression gives values near the right ones, however strongly the
system resonates or jumps. Noise biases them, so they are a start and nothing more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.interpolate import CubicSpline

from impactscope.discrepancy.driven import layout as at
from impactscope.discrepancy.driven.mechanics import SLOTS
from impactscope.discrepancy.driven.model import Segment
from impactscope.discrepancy.driven.oscillator import smooth_force
from impactscope.discrepancy.driven.terms import Number, Term, key

__all__ = ['equation_start']

Array = NDArray[np.float64]

POWER = 0.995  # share of the output's power below the frequency that counts as its highest
HARMONICS = 3.0  # of that are kept when the output is differentiated
_FRICTION = {at.KINETIC_FORWARD: 1.0, at.KINETIC_BACKWARD: -1.0}
_LINEAR = {
    at.MASS,
    at.DAMPING,
    at.STIFFNESS,
    at.SQUARE,
    at.CUBIC,
    at.QUADRATIC_DAMPING,
    at.SKEW_DAMPING,
    at.INPUT_OFFSET,
    *_FRICTION,
}


def _motion(segment: Segment) -> Array:
    """Smoothed position, speed, acceleration, shape (3, n)."""
    rate = 1.0 / segment.period
    frequency, power = signal.periodogram(segment.measured, rate, detrend='constant')
    share = np.cumsum(power)
    highest = float(frequency[np.searchsorted(share, POWER * share[-1])])
    corner = min(max(HARMONICS * highest, 8.0 * frequency[1]), 0.4 * rate)
    sections = signal.butter(4, corner, fs=rate, output='sos')
    smooth = signal.sosfiltfilt(sections, segment.measured)
    spline = CubicSpline(segment.time, smooth)
    return np.stack([smooth, spline(segment.time, 1), spline(segment.time, 2)])


def _column(slots: Sequence[int], motion: Array, sine: bool) -> Array:
    """Force against the input that one unit of a number brings."""
    x, v, a = motion
    p = np.zeros(at.SIZE)
    p[at.HYSTERESIS_EXPONENT] = 1.0
    p[at.SINE] = float(sine)
    force = np.zeros(x.size)
    for slot in slots:
        if slot in _FRICTION:
            way = _FRICTION[slot]
            force += np.where(np.sign(v) == way, way, 0.0)
        elif slot == at.INPUT_OFFSET:
            force -= 1.0
        else:
            p[slot] += 1.0
    out = np.empty(x.size)
    smooth_force(p, x, v, a, out)
    return out + force


def equation_start(
    numbers: Sequence[Number], terms: Sequence[Term], segments: Sequence[Segment]
) -> Mapping[str, float]:
    """Values of the baseline's numbers and of the terms', by key; empty where they cannot be had.

    They cannot where the output is no position, or a law is not linear in its numbers.
    """
    named = [(n.name, n) for n in numbers] + [(key(t, n), n) for t in terms for n in t.numbers]
    slots = []
    for name, _ in named:
        label, dot, number = name.partition('.')
        slots.append(SLOTS.get(label.split('/', 1)[0] + dot + number, ()))
    linear = all(s and set(s) <= _LINEAR for s in slots)
    fitted = [s for s in segments if not s.held_out]
    if not linear or any(s.derivative != 0 for s in fitted):
        return {}
    sine = any(t.fixed for t in terms)
    has_mass = any(n.name == 'mass' for n in numbers)
    rows, targets = [], []
    for segment in fitted:
        motion = _motion(segment)
        edge = slice(segment.measured.size // 50, -max(segment.measured.size // 50, 1))
        columns = [_column(s, motion, sine)[edge] for s in slots]
        drive = np.concatenate([segment.drive[:, 0], segment.drive[-1:, -1]])
        rows.append(np.stack(columns, axis=1))
        targets.append((drive if has_mass else drive - motion[2])[edge])
    matrix, target = np.concatenate(rows), np.concatenate(targets)
    size = np.linalg.norm(matrix, axis=0)
    if not np.all(size > 0.0):
        return {}
    solution = np.linalg.lstsq(matrix / size, target, rcond=None)[0] / size
    return {
        name: float(np.clip(value, n.lower, n.upper))
        for (name, n), value in zip(named, solution, strict=True)
    }
