"""Start values by equation error: regression of the equation of motion on measured motion.

With position, speed and acceleration taken from the measured output, most laws are linear in
their numbers: one linear regression gives values near the right ones, however strongly the
system resonates or jumps. Noise biases them, so they are a start and nothing more.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal
from scipy.interpolate import CubicSpline

from impactscope.discrepancy.driven.models import parameter_layout as at
from impactscope.discrepancy.driven.models.equation_of_motion import smooth_force
from impactscope.discrepancy.driven.models.mechanical_effects import SLOTS
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.terms import Number, Term, key
from impactscope.discrepancy.driven.noise.quantisation import step_of
from impactscope.discrepancy.evidence import noise_std

__all__ = ['equation_start', 'position_cogging']

Array = NDArray[np.float64]

POWER = 0.995  # share of the output's power below the frequency that counts as its highest
CLEAR = 10.0  # times the noise's spectrum
STANDS = 0.03  # of the largest speed, below which an axis may stand
HARMONICS = 3.0  # of that are kept when the output is differentiated
RIPPLES = (2.0, 60.0, 0.2)  # periods in the range of motion: from, to, step
MOSTLY = 0.5  # of what the usual forces leave must repeat with the position
SCANNED = 10_000  # samples, about
_FRICTION = {at.KINETIC_FORWARD: 1.0, at.KINETIC_BACKWARD: -1.0}
_ROUGH = {at.KINETIC_FORWARD, at.KINETIC_BACKWARD, at.STATIC_EXCESS}
_FALLS = (0.02, 0.04, 0.08, 0.16, 0.32)
_RESTS = tuple(float(a) for a in np.linspace(-math.pi, math.pi, 72, endpoint=False))  # rad
_LINEAR = {
    at.MASS,
    at.DAMPING,
    at.STIFFNESS,
    at.SQUARE,
    at.CUBIC,
    at.QUADRATIC_DAMPING,
    at.SKEW_DAMPING,
    at.INPUT_OFFSET,
    at.WEIGHT_SINE,
    at.WEIGHT_COSINE,
    *_FRICTION,
    at.STATIC_EXCESS,
}


def _corner(segment: Segment, *, axis: bool) -> float:
    """Frequency, Hz, up to which the output is kept when it is differentiated.

    The position of an ``axis`` that nothing brings back says little of its highest frequencies:
    there it is kept as far as it stands clear of its noise.
    """
    rate = 1.0 / segment.period
    frequency, power = signal.periodogram(segment.measured, rate, detrend='constant')
    share = np.cumsum(power)
    highest = HARMONICS * float(frequency[np.searchsorted(share, POWER * share[-1])])
    # an axis at rest repeats one reading, and second differences tell no noise
    noise = max(noise_std(segment.measured), step_of(segment.measured) / math.sqrt(12.0))
    if axis and math.isfinite(noise):
        parts = min(segment.measured.size, 1 << round(math.log2(2.0 * rate)))
        places, level = signal.welch(segment.measured, rate, nperseg=parts)
        loud = level > CLEAR * 2.0 * noise**2 / rate
        highest = max(highest, float(places[int(np.argmin(loud)) - 1]))
    return min(max(highest, 8.0 * float(frequency[1])), 0.4 * rate)


def _motion(segment: Segment, sections: Array) -> Array:
    """Smoothed position, speed, acceleration, shape (3, n)."""
    smooth = signal.sosfiltfilt(sections, segment.measured)
    spline = CubicSpline(segment.time, smooth)
    return np.stack([smooth, spline(segment.time, 1), spline(segment.time, 2)])


def _column(slots: Sequence[int], motion: Array, sine: bool, rest: float) -> Array:
    """Force against the input that one unit of a number brings."""
    x, v, a = motion
    p = np.zeros(at.SIZE)
    p[at.SINE], p[at.SINE_ZERO] = float(sine), rest
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

    They cannot where the output is no position, or a law is not linear in its numbers; the speed
    over which friction falls and the angle at which a weight rests are taken from ladders.
    """
    named = [(n.name, n) for n in numbers] + [(key(t, n), n) for t in terms for n in t.numbers]
    slots = []
    for name, _ in named:
        label, dot, number = name.partition('.')
        slots.append(SLOTS.get(label.split('/', 1)[0] + dot + number, ()))
    axis = not any(n.name == 'stiffness' for n in numbers)
    falls = [i for i, s in enumerate(slots) if axis and s == (at.STRIBECK_SPEED,)]
    rests = [i for i, s in enumerate(slots) if s == (at.SINE_ZERO,)]
    known = {*falls, *rests}
    linear = all(s and set(s) <= _LINEAR for i, s in enumerate(slots) if i not in known)
    fitted = [s for s in segments if not s.held_out]
    if not (linear or falls) or any(s.derivative != 0 for s in fitted):
        return {}
    least = max((n.lower for n in numbers if n.name == 'stiffness'), default=0.0)
    best: tuple[float, dict[str, float]] = (math.inf, {})
    for share, rest in itertools.product(
        _FALLS if falls else (math.nan,), _RESTS if rests else (0.0,)
    ):
        left, values = _regressed(named, slots, terms, fitted, axis=axis, share=share, rest=rest)
        # a weight that would push away from its rest hangs half a turn from there
        hangs = not rests or values.get('stiffness', -math.inf) > least
        if left < best[0] and hangs:
            best = left, values
    return best[1]


def _regressed(
    named: Sequence[tuple[str, Number]],
    slots: Sequence[Sequence[int]],
    terms: Sequence[Term],
    fitted: Sequence[Segment],
    *,
    axis: bool,
    share: float,
    rest: float,
) -> tuple[float, dict[str, float]]:
    """What the equation of motion leaves, and the values by key.

    ``share``: of the largest speed, over which friction at rest falls. ``rest``: angle at which a
    weight hangs, if any does.
    """
    ladders = {(at.SINE_ZERO,): rest}
    sine = any(t.fixed for t in terms)
    has_mass = any(name == 'mass' for name, _ in named)
    rows, targets, fastest = [], [], 0.0
    for segment in fitted:
        corner = _corner(segment, axis=axis and has_mass)
        sections = signal.butter(4, corner, fs=1.0 / segment.period, output='sos')
        motion = _motion(segment, sections)
        speed = motion[1]
        inside = np.zeros(speed.size, np.bool_)
        inside[speed.size // 50 : -max(speed.size // 50, 1)] = True
        drive = np.concatenate([segment.drive[:, 0], segment.drive[-1:, -1]])
        fastest = max(fastest, float(np.max(np.abs(speed[inside]))))
        columns = []
        for s in slots:
            if axis and s == (at.STATIC_EXCESS,):
                column = np.sign(speed) * np.exp(-((speed / (share * fastest)) ** 2))
            elif s in ladders or (axis and s == (at.STRIBECK_SPEED,)):
                continue
            else:
                column = _column(s, motion, sine, rest)
            columns.append(column)
        if axis and has_mass:
            # What friction holds at rest is not what it is in motion. Forces that jump go through
            # the filter that the motion has gone through.
            inside &= np.abs(speed) > STANDS * fastest
            kept = [s for s in slots if s != (at.STRIBECK_SPEED,) and s not in ladders]
            columns = [
                signal.sosfiltfilt(sections, c) if set(s) & _ROUGH else c
                for s, c in zip(kept, columns, strict=True)
            ]
            drive = signal.sosfiltfilt(sections, drive)
        rows.append(np.stack(columns, axis=1)[inside])
        targets.append((drive if has_mass else drive - motion[2])[inside])
    matrix, target = np.concatenate(rows), np.concatenate(targets)
    size = np.linalg.norm(matrix, axis=0)
    if not np.all(size > 0.0):
        return math.inf, {}
    told = [
        n
        for s, n in zip(slots, named, strict=True)
        if s not in ladders and (s != (at.STRIBECK_SPEED,) or not axis)
    ]
    if axis:
        # open loop, a damping below zero would run away
        least = [max(n.lower, 0.0) if name == 'damping' else n.lower for name, n in told]
        bounds = np.array(least) * size, np.array([n.upper for _, n in told]) * size
        solution = optimize.lsq_linear(matrix / size, target, bounds).x / size
    else:
        solution = np.linalg.lstsq(matrix / size, target, rcond=None)[0] / size
    values = {
        name: float(np.clip(value, n.lower, n.upper))
        for (name, n), value in zip(told, solution, strict=True)
    }
    for s, (name, n) in zip(slots, named, strict=True):
        if axis and s == (at.STRIBECK_SPEED,):
            values[name] = float(np.clip(share * fastest, n.lower, n.upper))
        elif s in ladders:
            values[name] = ladders[s]
    return float(np.sum((target - matrix @ solution) ** 2)), values


def position_cogging(segments: Sequence[Segment]) -> float | None:
    """Period of a force that repeats with an axis' position, where it is most of what is left.

    Cogging of a motor, a screw or a tooth out of true. From the equation of motion, beside mass,
    viscous, dry and quadratic friction and a constant force.
    """
    fitted = [s for s in segments if not s.held_out]
    if not fitted or any(s.derivative != 0 for s in fitted):
        return None
    rows, targets, places = [], [], []
    for segment in fitted:
        corner = _corner(segment, axis=True)
        sections = signal.butter(4, corner, fs=1.0 / segment.period, output='sos')
        x, v, a = _motion(segment, sections)
        drive = np.concatenate([segment.drive[:, 0], segment.drive[-1:, -1]])
        fastest = float(np.max(np.abs(v))) or 1.0
        inside = np.abs(v) > STANDS * fastest
        edge = max(x.size // 50, 1)
        inside[:edge] = inside[-edge:] = False
        way = signal.sosfiltfilt(sections, np.sign(v))
        falling = signal.sosfiltfilt(sections, np.sign(v) * np.exp(-((20.0 * v / fastest) ** 2)))
        columns = np.stack([a, v, way, falling, np.abs(v) * v, np.ones(x.size)], axis=1)
        thin = slice(None, None, max(1, sum(s.measured.size for s in fitted) // SCANNED))
        rows.append(columns[inside][thin])
        targets.append(signal.sosfiltfilt(sections, drive)[inside][thin])
        places.append(x[inside][thin])
    matrix, target, place = np.concatenate(rows), np.concatenate(targets), np.concatenate(places)
    size = np.linalg.norm(matrix, axis=0)
    if target.size < SCANNED // 50 or not np.all(size > 0.0):
        return None
    basis = np.linalg.qr(matrix / size)[0]
    left = target - basis @ (basis.T @ target)
    if not float(left @ left) > 0.0:  # no force is measured
        return None
    span = float(np.ptp(place))
    best = MOSTLY, math.nan
    for turns in np.arange(*RIPPLES):
        angle = 2.0 * math.pi * turns / span * place
        waves = np.stack([np.sin(angle), np.cos(angle)], axis=1)
        waves -= basis @ (basis.T @ waves)
        factors = np.linalg.lstsq(waves, left, rcond=None)[0]
        share = float(left @ (waves @ factors)) / float(left @ left)
        best = max(best, (share, span / turns))
    return None if math.isnan(best[1]) else best[1]
