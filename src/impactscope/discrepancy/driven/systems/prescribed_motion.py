"""Motion prescribed, force measured: a spring, a damper, a mass, and what may be missing.

Dry friction may act beside the spring or in series with it: then the spring carries what the
slider holds, and after a reversal the force comes back over the slider's free travel. Play in
series with the slider leaves a stretch without force between (lost motion). Beside the spring it
turns round at once, or over a travel (presliding), a speed of its own, or both as in
magnetorheological dampers, and it may fall with the speed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.data.recordings import Cut, derivative_of
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.models import parameter_layout as at
from impactscope.discrepancy.driven.models.equation_of_motion import (
    creeping_friction,
    slider_force,
    smooth_force,
)
from impactscope.discrepancy.driven.models.measuring_chain import begins_in_motion
from impactscope.discrepancy.driven.models.mechanical_effects import Sizes, enter, mechanical_terms
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.relaxation import branch_force, relaxation
from impactscope.discrepancy.driven.models.terms import Number, Term
from impactscope.errors import InputError

__all__ = ['PrescribedModel', 'force_counts_against', 'linear_prescribed', 'one_speed_told']

Array = NDArray[np.float64]

CORNER = 0.05  # of the sampling rate: low-pass before the motion is differentiated
RIGID = 1e-5  # of the largest displacement: travel in which friction beside a spring builds up
SLIPS = 0.5  # of the largest displacement, within which a slider lets go: else it is a spring
STUCK = 0.01  # of the largest displacement: what yields within that is friction
LEAST = 1e-5  # of the largest displacement or speed, within which friction may be found to turn
BOTH_WAYS = 0.02  # share of the samples that must move either way for effects that tell them apart
ONE_SPEED = 1.5  # ratio of the fastest to the slowest tenth, up to which it is one speed
MOVES = 0.02  # of the largest speed: what counts as moving
SHOWN = 0.1  # of a force's scatter, from which it is seen to go with the speed
RELAXES = (1.0, 0.2, 5.0)  # times over the motion's own, to set out from
BRANCHES = (0.5, 0.05)  # of the stiffness, likewise
_FRICTIONS = ('coulomb_friction', 'asymmetric_friction', 'stribeck_friction')
_SKEWED = ('asymmetric_friction', 'asymmetric_damping')


@dataclass(frozen=True, eq=False)
class PrescribedModel:
    """Force of a device whose motion is prescribed. ``drive`` holds x, v, a, shape (3, n)."""

    numbers: tuple[Number, ...]
    terms: tuple[Term, ...]
    position_scale: float
    position_unit: str = 'm'
    middle: float = 0.0  # of the sensor's scale, from which positions count
    one_way: bool = False  # whether it never comes back: friction turns round nowhere

    def starts(self, segment: Segment) -> tuple[Number, ...]:  # noqa: ARG002
        """Where the slider stands at the first sample."""
        return (Number('slip', self.position_unit, (0.0,), 0.05 * self.position_scale),)

    @property
    def drifts(self) -> bool:
        """Nothing accumulates here."""
        return False

    def predict(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> Array:
        """Force, shape (n,)."""
        p = np.zeros(at.SIZE)
        enter(p, values)
        for term in terms:
            if term.fixed:
                enter(p, term.fixed)
        force = self._force(values, terms, p, start, segment)
        relaxing = branch_force(
            terms, values, segment.drive, segment.measured - force, segment.period
        )
        return force if relaxing is None else force + relaxing

    def _force(
        self,
        values: Mapping[str, float],
        terms: tuple[Term, ...],
        p: Array,
        start: Array,
        segment: Segment,
    ) -> Array:
        x, v, a = segment.drive
        forward, backward, gap = p[at.KINETIC_FORWARD], p[at.KINETIC_BACKWARD], p[at.GAP]
        turning = _number_of('turning_speed', values, terms)
        rubs = turning == 0.0 and any(t.name in _FRICTIONS for t in terms)
        series = any(t.variant == 'series' for t in terms)
        stiffness = float(p[at.STIFFNESS])
        if rubs:
            p[at.GAP] = 0.0
        if series:
            p[at.STIFFNESS] = 0.0
        out = np.empty(x.size)
        smooth_force(p, x, v, a, out)
        slip, own = float(start[0]), _number_of('presliding', values, terms)
        if turning > 0.0 and own > 0.0:
            held = np.empty(x.size)
            acts = min(max(-slip / own, -1.0), 1.0)
            creeping_friction(v, segment.period, own, turning, acts, held)
            out += np.where(held > 0.0, forward, backward) * held
            return out
        if not rubs:
            if turning > 0.0:
                out += np.where(v > 0.0, forward, backward) * np.tanh(v / turning)
            return out
        travel = own if own > 0.0 else RIGID * self.position_scale
        if any(t.name == 'stribeck_friction' for t in terms):
            held = np.zeros(x.size)
            slider_force(x, 1.0 / travel, 1.0, 1.0, gap, slip, held)
            fall = np.exp(-((v / max(p[at.STRIBECK_SPEED], 1e-300)) ** 2))
            out += held * (forward + p[at.STATIC_EXCESS] * fall)
            return out
        strongest = max(forward, backward, 1e-300)
        least = strongest / (SLIPS * self.position_scale)
        stiffness = max(stiffness, least) if series else strongest / travel
        slider_force(x, stiffness, forward, backward, gap, slip, out)
        return out

    def motion(
        self,
        values: Mapping[str, float],  # noqa: ARG002
        terms: tuple[Term, ...],  # noqa: ARG002
        start: Array,  # noqa: ARG002
        segment: Segment,
    ) -> tuple[Array, Array]:
        """The prescribed motion."""
        return segment.drive[0], segment.drive[1]


def _number_of(name: str, values: Mapping[str, float], terms: Sequence[Term]) -> float:
    """A number of a form of friction, 0 where no term has it."""
    return max((values.get(f'{t.label}.{name}', 0.0) for t in terms), default=0.0)


def _motion(cut: Cut) -> Array:
    """Position, speed, acceleration, shape (3, n), the latter from the smoothed position."""
    assert cut.drive is not None  # noqa: S101 - a prescribed motion is always there
    order = derivative_of(cut.drive_unit)
    if order == 2:
        raise InputError(
            f'{cut.recording}: {cut.drive_channel} is an acceleration; a prescribed motion must '
            'be a position or a speed'
        )
    period = 1.0 / cut.rate
    position = cut.drive
    if order == 1:
        steps = 0.5 * period * (position[1:] + position[:-1])
        position = np.concatenate([[0.0], np.cumsum(steps)])
    sections = signal.butter(4, CORNER * cut.rate, fs=cut.rate, output='sos')
    smooth = signal.sosfiltfilt(sections, position)
    speed = np.gradient(smooth, period)
    return np.stack([smooth, speed, np.gradient(speed, period)])


def _middle(segments: Sequence[Segment]) -> float:
    """Middle of the motion in these recordings where their zero lies outside of it, else 0."""
    low = min(float(np.min(s.drive[0])) for s in segments)
    high = max(float(np.max(s.drive[0])) for s in segments)
    return 0.5 * (low + high) if low > 0.0 or high < 0.0 else 0.0


def one_speed_told(segments: Sequence[Segment]) -> tuple[str, ...]:
    """A note where the fitted motions have hardly more than one speed, either way."""
    speeds = np.concatenate([np.abs(s.drive[1]) for s in segments if not s.held_out])
    moving = speeds[speeds > MOVES * np.max(speeds)]
    slow, usual, fast = np.quantile(moving, (0.1, 0.5, 0.9)) if moving.size else (0.0, 0.0, 1.0)
    if fast > ONE_SPEED * slow:
        return ()
    return (
        f'The motion has hardly more than one speed, about {usual:.2g}: viscous, dry and '
        'quadratic friction cannot be told apart. Recordings at several speeds would tell them.',
    )


def force_counts_against(cuts: Sequence[Cut]) -> bool:
    """Whether the force counts in the other direction than the motion: then it would drive it.

    A device takes power from what moves it, and pushes back where it is pushed. A force that comes
    late gives some power back as well, but less than its spring pushes; a spring that pulls away
    from its middle takes power in its damping.
    """
    fitted = [c for c in cuts if not c.held_out]
    motion = np.concatenate([_motion(c) for c in fitted], axis=1)
    force = np.concatenate([c.output for c in fitted])
    size = np.maximum(np.sqrt(np.mean(motion**2, axis=1)), 1e-300)
    columns = np.vstack([motion / size[:, None], np.ones(force.size)])
    spring, damping, _, _ = np.linalg.lstsq(columns.T, force, rcond=None)[0]
    least = SHOWN * float(np.std(force))
    return bool(damping + spring < -least and damping < least)


def linear_prescribed(
    cuts: Sequence[Cut], *, spring: bool = True
) -> tuple[PrescribedModel, list[Segment], Fit]:
    """Fit damper and mass and, with ``spring``, a spring; the model knows what may be missing.

    Positions count from the sensor's zero or, where the motion never comes by it, from the middle
    of the motion: a spring's law about a far-off zero would be little but an offset.
    """
    segments = [
        Segment(
            c.recording,
            c.channel,
            c.unit,
            c.held_out,
            c.begin,
            1.0 / c.rate,
            c.output,
            _motion(c),
            noise=c.noise,
        )
        for c in cuts
    ]
    fitted = [s for s in segments if not s.held_out]
    middle = _middle(fitted)
    for s in segments:
        s.drive[0] -= middle
    motion = np.concatenate([s.drive for s in fitted], axis=1)
    force = np.concatenate([s.measured for s in fitted])
    f, x = cuts[0].unit, cuts[0].drive_unit.split('/', 1)[0] or '1'
    rms = np.maximum(np.sqrt(np.mean(motion**2, axis=1)), 1e-300)
    level = float(np.sqrt(np.mean(force**2))) or 1.0
    first = 0 if spring else 1
    linear = np.linalg.lstsq((motion / rms[:, None])[first:].T, force, rcond=None)[0] / rms[first:]
    numbers = tuple(
        Number(
            name,
            unit,
            (float(value),),
            level / float(size),
            **({'lower': 0.0} if name == 'mass' else {}),
        )
        for name, unit, value, size in zip(
            ('stiffness', 'damping', 'mass')[first:],
            (f'{f}/{x}', f'{f} s/{x}', 'kg' if (f, x) == ('N', 'm') else f'{f} s^2/{x}')[first:],
            linear,
            rms[first:],
            strict=True,
        )
    )
    position = float(np.max(np.abs(motion[0] - np.mean(motion[0])))) or 1.0
    sizes = Sizes(
        position,
        float(np.quantile(np.abs(motion[1]), 0.99)) or 1.0,
        level,
        level / position,
        f,
        x,
    )
    terms = mechanical_terms(
        sizes,
        spring=spring,
        driven=True,
        angle=x == 'rad',
        offset_channel=cuts[0].channel,
        joint=True,
    )
    if middle != 0.0:
        terms = tuple(t for t in terms if t.label != 'restoring_force')
    moving = motion[1][np.abs(motion[1]) > MOVES * np.max(np.abs(motion[1]))]
    forwards = float(np.mean(moving > 0.0)) if moving.size else 0.0
    one_way = not BOTH_WAYS < forwards < 1.0 - BOTH_WAYS
    if one_way:
        terms = tuple(t for t in terms if t.name not in _SKEWED)
    period = fitted[0].period
    longest = max(s.measured.size * s.period for s in fitted)
    times = [r * sizes.position / sizes.speed for r in RELAXES]
    moving = sum(begins_in_motion(s.drive[0]) for s in fitted)
    stiffness = tuple(share * sizes.stiffness for share in BRANCHES)
    variants = (
        *_variants(terms, sizes, spring=spring),
        relaxation(sizes, stiffness, times, period, longest, moving),
    )
    model = PrescribedModel(numbers, variants, position, x, middle, one_way)
    made = fit(dataclasses.replace(model, terms=()), (), segments, {}, tolerance=FINE)
    return model, segments, made


def _variants(terms: Sequence[Term], sizes: Sizes, *, spring: bool) -> tuple[Term, ...]:
    """Friction beside and in series with the spring; it needs no mass that sticks."""
    found = []
    for term in terms:
        if term.name == 'end_stop':
            continue
        if term.name == 'hysteresis':
            found.append(_that_yields(term, sizes))
            continue
        if term.name not in _FRICTIONS:
            found.append(term)
            continue
        strong = tuple(_strong(n, sizes) for n in term.numbers)
        found.append(dataclasses.replace(term, numbers=strong))
        if term.name == 'stribeck_friction':
            continue
        if term.name == 'coulomb_friction':
            found += _gradual(dataclasses.replace(term, numbers=strong), sizes)
        if spring:
            found.append(
                dataclasses.replace(
                    term,
                    numbers=strong,
                    variant='series',
                    equation=f'{term.equation}, behind the spring k',
                    restart={'stiffness': 8.0 * sizes.force / sizes.position, 'mass': 0.0},
                )
            )
    return tuple(found)


def _that_yields(term: Term, sizes: Sizes) -> Term:
    """Hysteresis that shows in the motion.

    What yields later is a spring about the first sample's position, what yields at once friction.
    """
    low, high = 1.0 / (SLIPS * sizes.position), 1.0 / (STUCK * sizes.position)
    numbers = tuple(
        dataclasses.replace(n, lower=low, upper=high) if n.name == 'closing' else n
        for n in term.numbers
    )
    return dataclasses.replace(term, numbers=numbers)


def _strong(number: Number, sizes: Sizes) -> Number:
    """Friction as a device under test has it: most of its force."""
    shares = {'speed': (), 'excess_force': (0.2, 0.05)}.get(number.name, (0.8, 0.3))
    starts = tuple(share * sizes.force for share in shares) or number.starts
    return dataclasses.replace(number, starts=starts)


def _gradual(term: Term, sizes: Sizes) -> list[Term]:
    """Friction that turns round over a travel or a speed of its own, or over both."""
    travel = _turns_within('presliding', sizes.position_unit, sizes.position)
    speed = _turns_within('turning_speed', f'{sizes.position_unit}/s', sizes.speed)
    forms = (
        ('presliding', (travel,), 'after a reversal it builds up over x_t'),
        ('turning_speed', (speed,), 'F tanh(v / v_t)'),
        ('creeping', (travel, speed), 'it builds up over x_t towards F tanh(v / v_t)'),
    )
    return [
        dataclasses.replace(
            term,
            variant=name,
            equation=f'{term.equation}; {law}',
            numbers=(*term.numbers, *within),
        )
        for name, within, law in forms
    ]


def _turns_within(name: str, unit: str, size: float) -> Number:
    """A travel or a speed in which friction turns round; ``size``: the largest of the motion."""
    starts = (0.05 * size, 0.2 * size, 0.002 * size)
    return Number(name, unit, starts, 0.002 * size, LEAST * size, 0.5 * size)
