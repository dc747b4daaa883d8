"""Motion prescribed, force measured, where a right model leaves noise alone.

The force is a law of position, speed and acceleration, so every candidate costs a few operations a
sample. Friction is ideal: it turns with the speed, unless the recordings show that it builds up.
What the noise of the motion's sensor does to the force is part of the noise (errors in variables):
a linear device passes it like the motion itself.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.adequacy.prescribed_laws import prescribed_laws
from impactscope.discrepancy.driven.compiled import compiled
from impactscope.discrepancy.driven.data.recordings import Cut, derivative_of
from impactscope.discrepancy.driven.data.trajectory import (
    KNOTS,
    Trajectory,
    trajectory_of,
)
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.model_selection.chi_square import NoiseJudge
from impactscope.discrepancy.driven.models import parameter_layout as at
from impactscope.discrepancy.driven.models.candidate_effects import candidate_effects
from impactscope.discrepancy.driven.models.measuring_chain import (
    begins_in_motion,
    count_in_motion,
    passed_on,
    power_passed,
    retimed,
)
from impactscope.discrepancy.driven.models.mechanical_effects import Sizes, enter
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.relaxation import branch_force, relaxation
from impactscope.discrepancy.driven.models.terms import Number, Term
from impactscope.discrepancy.driven.noise.spectral_whitening import weight_by_runs
from impactscope.discrepancy.driven.systems.case import Case, throughout
from impactscope.discrepancy.driven.systems.prescribed_motion_ends import ends_of_a_filter
from impactscope.discrepancy.driven.systems.prescribed_motion_noise import (
    PrescribedMotionNoise,
    between,
    runs,
)

__all__ = [
    'PARTS',
    'NoiseLimitedMotionModel',
    'prescribed_case',
]

Array = NDArray[np.float64]

PARTS = ('stiffness', 'damping', 'mass')  # by position, speed and acceleration
UPPER = 0.5  # of half the rate, beyond which the force's noise is looked for
ROUNDED = (0.002, 0.03)  # of the largest speed, in which friction turns round
STUCK = (0.001,)  # of the largest travel, over which friction builds up; more is hysteresis
MOST_STUCK = 0.004
RELAXES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # times over the motion's own, to set out from
TOLD_LESS = 0.5  # of the space between knots, from an end
ON_A_SAMPLE = 0.02  # of the time between samples, within which a motion turns round on one
SLOW = 3.0  # times the noise of the speed, below which a motion may as well rest
BY_CHANCE = 6.0  # the same, for a moment within a rest
RESTS = 8.0  # independent values of the speed in a row, from which it does
BEYOND = 3.0  # samples, by which a force is continued beyond its ends


@dataclass(frozen=True, eq=False)
class NoiseLimitedMotionModel:
    """Force of a device on a known course; ``drive`` is position, speed, acceleration (3, n)."""

    numbers: tuple[Number, ...]
    terms: tuple[Term, ...]

    def starts(self, segment: Segment) -> tuple[Number, ...]:  # noqa: ARG002
        """Nothing is unknown of a beginning."""
        return ()

    @property
    def drifts(self) -> bool:
        """Nothing accumulates here."""
        return False

    def predict(
        self,
        values: Mapping[str, float],
        terms: tuple[Term, ...],
        start: Array,  # noqa: ARG002
        segment: Segment,
    ) -> Array:
        """Force, shape (n,)."""
        force = self._force(values, terms, segment)
        relaxing = branch_force(
            terms, values, segment.drive, segment.measured - force, segment.period
        )
        if relaxing is not None:
            force = force + relaxing
        parts = {t.name: t for t in terms if t.output}
        if not parts:
            return force
        if 'clock_error' in parts:
            clock = parts['clock_error'].label
            offset, drift = values.get(f'{clock}.offset', 0.0), values.get(f'{clock}.drift', 0.0)
            force = retimed(force, offset, drift, segment.period, BEYOND)
        return passed_on(
            force, parts, values, segment.period, segment.begin, measured=segment.measured
        )

    def _force(
        self, values: Mapping[str, float], terms: tuple[Term, ...], segment: Segment
    ) -> Array:
        p = np.zeros(at.SIZE)
        outside = {t.label for t in terms if t.output}
        enter(p, {k: v for k, v in values.items() if k.partition('.')[0] not in outside})
        for term in terms:
            if term.fixed:
                enter(p, term.fixed)
        x, v, a = segment.drive
        share = p[at.SHARE] if p[at.YIELD] > 0.0 else 0.0
        w = x if p[at.GAP] <= 0.0 else x - np.clip(x, -0.5 * p[at.GAP], 0.5 * p[at.GAP])
        force = (1.0 - share) * p[at.STIFFNESS] * w + p[at.DAMPING] * v + p[at.MASS] * a
        if p[at.CUBIC] != 0.0:
            force = force + p[at.CUBIC] * w**3
        if p[at.QUADRATIC_DAMPING] != 0.0:
            force = force + p[at.QUADRATIC_DAMPING] * v * np.abs(v)
        if p[at.STOP_STIFFNESS] != 0.0:
            d = p[at.STOP_TRAVEL]
            below = 0.0 if p[at.STOP_ONE_WAY] > 0.5 else np.minimum(x + d, 0.0)
            force = force + p[at.STOP_STIFFNESS] * (np.maximum(x - d, 0.0) + below)
        if share > 0.0:
            held = np.empty(x.size)
            _yielding(x, p[at.YIELD], held)
            force = force + share * p[at.STIFFNESS] * held
        if p[at.WEIGHT_SINE] != 0.0 or p[at.WEIGHT_COSINE] != 0.0:
            force = force + p[at.WEIGHT_SINE] * np.sin(x) + p[at.WEIGHT_COSINE] * np.cos(x)
        if p[at.KINETIC_FORWARD] != 0.0 or p[at.KINETIC_BACKWARD] != 0.0 or p[at.STATIC_EXCESS]:
            force = force + _friction(p, x, v, terms, values)
        return np.asarray(force)

    def motion(
        self,
        values: Mapping[str, float],  # noqa: ARG002
        terms: tuple[Term, ...],  # noqa: ARG002
        start: Array,  # noqa: ARG002
        segment: Segment,
    ) -> tuple[Array, Array]:
        """The prescribed motion."""
        return segment.drive[0], segment.drive[1]


def _friction(
    p: Array, x: Array, v: Array, terms: Sequence[Term], values: Mapping[str, float]
) -> Array:
    """Dry friction on a known course, shape (n,)."""
    way = np.sign(v)
    for term in terms:
        if 'turning_speed' in term.variant:
            way = np.tanh(v / max(values[f'{term.label}.turning_speed'], 1e-300))
        if 'presliding' in term.variant:
            way = np.empty(x.size)
            _yielding(x, values[f'{term.label}.presliding'], way)
            way /= max(values[f'{term.label}.presliding'], 1e-300)
    level = np.where(way > 0.0, p[at.KINETIC_FORWARD], p[at.KINETIC_BACKWARD])
    if p[at.STATIC_EXCESS] != 0.0 and p[at.STRIBECK_SPEED] > 0.0:
        level = level + p[at.STATIC_EXCESS] * np.exp(-((v / p[at.STRIBECK_SPEED]) ** 2))
    return np.asarray(level * way)


@compiled
def _yielding(x: Array, most: float, out: Array) -> None:
    """Elongation of an element that yields, h' = v (1 - [v h > 0] |h| / most); fills ``out``."""
    h = 0.0
    out[0] = h
    for i in range(1, x.size):
        step = (x[i] - x[i - 1]) / 4.0
        for _ in range(4):
            if step * h >= 0.0:
                end = most if step > 0.0 else -most
                h = end - (end - h) * math.exp(-abs(step) / most)
            else:
                h += step
        out[i] = h


def prescribed_case(
    cuts: Sequence[Cut],
    parts: Sequence[str],
    found: Case | None = None,
    best: Fit | None = None,
    *,
    knots: float = KNOTS,
) -> Case | None:
    """A prescribed motion as a case in which noise is all that a right model leaves.

    Args:
        cuts: usable parts of the recordings.
        parts: what the baseline has of stiffness, damping and mass.
        found: a case made before, whose courses are kept.
        best: a fit that leaves less, from which the noise is known better.
        knots: of the courses, in a period of the highest frequency of the motion.
    """
    if derivative_of(cuts[0].drive_unit) > 1:
        return None
    if found is None:
        courses = [_course(c, knots) for c in cuts]
        if not all(np.all(np.isfinite(k.motion)) for k in courses):
            return None
        segments = [_segment(c, k) for c, k in zip(cuts, courses, strict=True)]
        model = _linear(cuts, segments, parts)
        made = fit(model, (), segments, {}, tolerance=FINE)
        order = derivative_of(cuts[0].drive_unit)
        known = [_noise_of(k, s.period, order) for k, s in zip(courses, segments, strict=True)]
    else:
        assert isinstance(found.model, NoiseLimitedMotionModel)  # noqa: S101 - made below
        segments, model, made = list(found.segments), found.model, found.baseline
        known = [w for s in segments if isinstance(w := s.whitener, PrescribedMotionNoise)]
    noise = _noise(cuts, segments, best or made, [w.turns for w in known])
    if not noise > 0.0:
        return None
    stiffness, damping, mass = (made.values.get(name, 0.0) for name in PARTS)
    ready = [
        dataclasses.replace(
            s,
            weight=weight_by_runs(s.measured, noise),
            noise=noise,
            whitener=dataclasses.replace(
                w, force=noise, device=(stiffness, damping, mass), colour=None, slow=None
            ),
        )
        for s, w in zip(segments, known, strict=True)
    ]
    if found is None:
        model = dataclasses.replace(model, terms=_terms(cuts, ready, made, noise))
    baseline = fit(model, (), ready, made.values, tolerance=FINE)
    if ends := ends_of_a_filter(model, ready, best or baseline):
        ready = ends
        baseline = fit(model, (), ready, made.values, tolerance=FINE)
    return Case(
        model,
        ready,
        baseline,
        NoiseJudge(ready, _muffled(ready)),
        prescribed_laws,
        throughout(ready),
        {cuts[0].channel: noise},
    )


def _noise_of(course: Trajectory, period: float, order: int) -> PrescribedMotionNoise:
    """What is known of the noise before the device and the noise of the force are."""
    size = course.motion.shape[1]
    reach = min(math.ceil(TOLD_LESS / (2.0 * course.band * period)), size // 8)
    return PrescribedMotionNoise(
        math.nan,
        course.noise,
        course.band,
        (math.nan,) * 3,
        period,
        course.ends,
        course.colour,
        turns=_turns(course, period, order, reach),
        reach=reach,
    )


def _turns(course: Trajectory, period: float, order: int, reach: int) -> NDArray[np.bool_]:
    """Samples at which the motion turns round, rests or has an end, shape (n,).

    Dry friction may have either sign there, or any force between: which, nobody knows. Within
    ``reach`` samples of an end the course is told from one side only.
    """
    _, speed, acceleration = course.motion
    turns = np.abs(speed) < ON_A_SAMPLE * period * np.abs(acceleration)
    turns |= _rests(course, period, order)
    turns[:reach] = turns[turns.size - reach :] = True
    return np.asarray(turns)


def _rests(course: Trajectory, period: float, order: int) -> NDArray[np.bool_]:
    """Samples in which a motion may as well rest, shape (n,).

    Near its ends a course is known less well, and in a long rest noise goes beyond any limit now
    and then: neither ends one.
    """
    passed = 2.0 * period * course.band
    if order == 0:
        passed *= (2.0 * math.pi * course.band) ** 2 / 3.0
    known = np.sqrt(course.noise**2 * passed + course.ends[1])
    speed = np.abs(course.motion[1])
    slow = speed <= SLOW * known
    long = [r for r in runs(slow) if 2.0 * course.band * period * (r[1] - r[0]) > RESTS]
    rests = np.zeros(speed.size, np.bool_)
    for first, last in runs(speed <= BY_CHANCE * known):
        if any(first <= a and b <= last for a, b in long):
            inside = first + np.flatnonzero(slow[first:last])
            rests[inside[0] : inside[-1] + 1] = True
    return rests


def _muffled(segments: Sequence[Segment]) -> Callable[[Fit], Sequence[float]]:
    """Chi-square that a fit's filters take from the motion's noise, by segment."""

    def lost(made: Fit) -> Sequence[float]:
        found = []
        for s in segments:
            assert isinstance(s.whitener, PrescribedMotionNoise)  # noqa: S101 - as made above
            frequency: Array = np.fft.rfftfreq(s.measured.size, s.period)[1:].astype(np.float64)
            share = s.whitener.share(frequency)
            kept = power_passed(made.terms, made.values, frequency, 1.0 / s.period)
            found.append(2.0 * float(np.sum(share * (1.0 - kept))))
        return found

    return lost


def _course(cut: Cut, knots: float) -> Trajectory:
    assert cut.drive is not None  # noqa: S101 - a prescribed motion is always there
    return trajectory_of(cut.drive, 1.0 / cut.rate, derivative_of(cut.drive_unit), knots)


def _segment(cut: Cut, course: Trajectory) -> Segment:
    motion = course.motion.copy()
    # what noise makes of the speed at rest would have friction chatter
    motion[1, _rests(course, 1.0 / cut.rate, derivative_of(cut.drive_unit))] = 0.0
    return Segment(
        cut.recording,
        cut.channel,
        cut.unit,
        cut.held_out,
        cut.begin,
        1.0 / cut.rate,
        cut.output,
        motion,
        noise=cut.noise,
    )


def _linear(
    cuts: Sequence[Cut], segments: Sequence[Segment], parts: Sequence[str]
) -> NoiseLimitedMotionModel:
    fitted = [s for s in segments if not s.held_out]
    motion = np.concatenate([s.drive for s in fitted], axis=1)
    force = np.concatenate([s.measured for s in fitted])
    used = [PARTS.index(name) for name in parts]
    rms = np.maximum(np.sqrt(np.mean(motion[used] ** 2, axis=1)), 1e-300)
    level = float(np.sqrt(np.mean(force**2))) or 1.0
    linear = np.linalg.lstsq((motion[used] / rms[:, None]).T, force, rcond=None)[0]
    f, x = cuts[0].unit, cuts[0].drive_unit.split('/', 1)[0] or '1'
    units = (f'{f}/{x}', f'{f} s/{x}', 'kg' if (f, x) == ('N', 'm') else f'{f} s^2/{x}')
    rows = zip(parts, [units[j] for j in used], linear, rms, strict=True)
    return NoiseLimitedMotionModel(
        tuple(Number(n, u, (float(k / r),), level / float(r)) for n, u, k, r in rows), ()
    )


def _noise(
    cuts: Sequence[Cut],
    segments: Sequence[Segment],
    made: Fit,
    turns: Sequence[NDArray[np.bool_] | None],
) -> float:
    """Standard deviation of a sample of the force: as stated, or from the upper band."""
    stated = cuts[0].noise
    if math.isfinite(stated) and stated > 0.0:
        return stated
    levels = []
    for s, left, turning in zip(segments, made.residuals, turns, strict=True):
        if not s.held_out:
            residual = left if turning is None else between(left, turning)
            power = np.abs(np.fft.rfft(residual * np.hanning(residual.size))) ** 2
            upper = power[int(UPPER * power.size) :]
            levels.append(float(np.median(upper)) / math.log(2.0) / (0.375 * residual.size))
    return float(np.sqrt(np.median(levels)))


def _terms(
    cuts: Sequence[Cut], segments: Sequence[Segment], made: Fit, noise: float
) -> tuple[Term, ...]:
    fitted = [s for s in segments if not s.held_out]
    x = max(float(np.max(np.abs(s.drive[0]))) for s in fitted) or 1.0
    v = max(float(np.max(np.abs(s.drive[1]))) for s in fitted) or 1.0
    force = max(float(np.max(np.abs(s.measured))) for s in fitted) or 1.0
    unit = cuts[0].drive_unit.split('/', 1)[0] or '1'
    sizes = Sizes(x, v, force, force / x, cuts[0].unit, unit)
    terms = candidate_effects(
        sizes,
        (1.0, 0.0, force / x),
        (cuts[0].channel, cuts[0].unit),
        cuts[0].rate,
        max(s.measured.size * s.period for s in segments),
        noise,
        force,
        len(segments),
        ends=count_in_motion([s.measured for s in segments]),
        kind='driven' if 'stiffness' in made.values else 'axis',
        joint=unit == 'rad',
    )
    found = []
    for term in terms:
        if term.name == 'base_compliance':
            continue  # the motion is measured where the device is
        if term.name == 'offset' and not term.output:
            continue  # of the force there is one, in its channel
        found.append(term)
        if term.name == 'coulomb_friction':
            found.append(
                _rounded(term, 'turning_speed', f'{unit}/s', v, 'F tanh(v / v_t)', ROUNDED)
            )
            found.append(
                _rounded(term, 'presliding', unit, x, 'F h, h builds up over a travel', STUCK)
            )
        if term.name == 'stribeck_friction':
            found.append(
                _rounded(term, 'turning_speed', f'{unit}/s', v, 'with tanh(v / v_t)', ROUNDED[:1])
            )
        if term.name == 'asymmetric_friction':
            found.append(
                _rounded(term, 'turning_speed', f'{unit}/s', v, 'F+- tanh(v / v_t)', ROUNDED)
            )
    longest = max(s.measured.size * s.period for s in fitted)
    times = [r * x / v for r in RELAXES]
    moving = sum(begins_in_motion(s.drive[0]) for s in fitted)
    found.append(relaxation(sizes, (1e-3 * force / x,), times, fitted[0].period, longest, moving))
    return tuple(found)


def _rounded(
    term: Term, name: str, unit: str, size: float, equation: str, ratios: Sequence[float]
) -> Term:
    """Friction that turns round over a speed or a travel."""
    starts = tuple(size * r for r in ratios)
    most = MOST_STUCK * size if name == 'presliding' else size
    number = Number(name, unit, starts, starts[0], 1e-5 * size, most)
    kept = tuple(
        n
        if n.name == 'speed'
        else dataclasses.replace(n, starts=n.starts[len(n.starts) // 2 :][:1])
        for n in term.numbers
    )
    return dataclasses.replace(term, numbers=(*kept, number), variant=name, equation=equation)
