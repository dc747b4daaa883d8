"""The mechanical effects that an oscillator may lack, scaled to a machine.

Names, units and senses follow the vocabulary of mechanisms; where that lacks an effect the name
is new: ``asymmetric_damping``, ``asymmetric_spring``. Numbers are written into the vector of
:mod:`parameter_layout` by the slots of :data:`SLOTS`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.models import parameter_layout as at
from impactscope.discrepancy.driven.models.terms import Number, Term, key

__all__ = [
    'SLOTS',
    'Sizes',
    'enter',
    'mechanical_terms',
    'springs_of_axis',
    'with_slots_that_follow',
]

Array = NDArray[np.float64]

SLOTS: Mapping[str, tuple[int, ...]] = {
    'mass': (at.MASS,),
    'damping': (at.DAMPING,),
    'stiffness': (at.STIFFNESS,),
    'coulomb_friction.force': (at.KINETIC_FORWARD, at.KINETIC_BACKWARD),
    'asymmetric_friction.force_forward': (at.KINETIC_FORWARD,),
    'asymmetric_friction.force_backward': (at.KINETIC_BACKWARD,),
    'stribeck_friction.kinetic_force': (at.KINETIC_FORWARD, at.KINETIC_BACKWARD),
    'stribeck_friction.excess_force': (at.STATIC_EXCESS,),
    'stribeck_friction.speed': (at.STRIBECK_SPEED,),
    'quadratic_damping.coefficient': (at.QUADRATIC_DAMPING,),
    'asymmetric_damping.difference': (at.SKEW_DAMPING,),
    'hardening_spring.cubic': (at.CUBIC,),
    'softening_spring.cubic': (at.CUBIC,),
    'asymmetric_spring.quadratic': (at.SQUARE,),
    'clearance.gap': (at.GAP,),
    'clearance.stiffness': (at.STIFFNESS,),
    'end_stop.travel': (at.STOP_TRAVEL,),
    'end_stop.stiffness': (at.STOP_STIFFNESS,),
    'hysteresis.stiffness': (at.HYSTERESIS_STIFFNESS,),
    'hysteresis.closing': (at.HYSTERESIS_CLOSING,),
    'hysteresis.leaning': (at.HYSTERESIS_LEANING,),
    'hysteresis.share': (at.SHARE,),
    'hysteresis.yield_displacement': (at.YIELD,),
    'end_stop.one_way': (at.STOP_ONE_WAY,),
    'base_compliance.mass': (at.BASE_MASS,),
    'base_compliance.frequency': (at.BASE_FREQUENCY,),
    'base_compliance.damping_ratio': (at.BASE_RATIO,),
    'base_compliance.reacts': (at.BASE_REACTS,),
    'restoring_force.stiffness': (at.STIFFNESS,),
    'restoring_force.hangs': (at.SINE,),
    'restoring_force.rest_angle': (at.SINE_ZERO,),
    'restoring_force.sine': (at.WEIGHT_SINE,),
    'restoring_force.cosine': (at.WEIGHT_COSINE,),
    'offset.value': (at.INPUT_OFFSET,),
}
"""Where each number goes; a term's variant plays no part."""

_FRICTION = frozenset({'coulomb_friction', 'asymmetric_friction', 'stribeck_friction'})
_CUBES = frozenset({'hardening_spring', 'softening_spring', 'restoring_force'})
TURN = math.pi  # rad, beyond which a spring fitted to a hanging weight says nothing of it
_OLSSON = 'Olsson et al., Friction models and friction compensation, Eur. J. Control 4 (1998)'
_DUFFING = "Duffing's equation; Nayfeh and Mook, Nonlinear Oscillations (1979), ch. 4"


@dataclass(frozen=True, slots=True)
class Sizes:
    """How large things are in the recordings that are fitted, and in which units."""

    position: float  # largest
    speed: float
    force: float
    stiffness: float  # of the baseline; force over position where it has none
    force_unit: str = 'N'
    position_unit: str = 'm'


def enter(vector: Array, values: Mapping[str, float]) -> None:
    """Add the values, by ``term/variant.number``, into a parameter vector."""
    for name, value in values.items():
        label, dot, number = name.partition('.')
        plain = label.split('/', 1)[0] + dot + number
        for slot in SLOTS.get(plain, ()):
            vector[slot] += value


def with_slots_that_follow(vector: Array) -> None:
    """Fill what follows from the numbers that were entered into a parameter vector."""
    if vector[at.YIELD] > 0.0:
        vector[at.HYSTERESIS_CLOSING] = vector[at.HYSTERESIS_LEANING] = 0.5 / vector[at.YIELD]
    if vector[at.STRIBECK_SPEED] == 0.0:
        vector[at.STRIBECK_SPEED] = 1.0


def _term(
    name: str,
    subsystem: str,
    sentence: str,
    equation: str,
    source: str,
    test: str,
    *numbers: Number,
    excludes: frozenset[str] = frozenset(),
    variant: str = '',
    fixed: Mapping[str, float] | None = None,
    restart: Mapping[str, float] | None = None,
) -> Term:
    return Term(
        name,
        subsystem,
        sentence,
        equation,
        source,
        test,
        numbers,
        variant,
        excludes,
        fixed,
        restart=restart,
    )


def _friction_terms(s: Sizes) -> list[Term]:
    f, speed = s.force_unit, f'{s.position_unit}/s'
    weak, strong = 0.01 * s.force, 0.2 * s.force
    ring_down = 'a free ring-down, or slow motion with reversals, at two strengths'
    return [
        _term(
            'coulomb_friction',
            'guide',
            'Dry friction opposes the motion with a constant force and lets the mass stick.',
            'F sign(v); at rest any force up to F',
            _OLSSON,
            ring_down,
            Number('force', f, (weak, strong), weak, 0.0, 5.0 * s.force),
            excludes=_FRICTION,
        ),
        _term(
            'asymmetric_friction',
            'guide',
            'Dry friction is stronger one way than the other.',
            'F+ forwards, F- backwards; at rest any force up to these',
            _OLSSON,
            ring_down,
            Number('force_forward', f, (strong, weak), weak, 0.0, 5.0 * s.force),
            Number('force_backward', f, (weak, strong), weak, 0.0, 5.0 * s.force),
            excludes=_FRICTION | {'offset'},
        ),
        _term(
            'stribeck_friction',
            'guide',
            'Dry friction is higher at rest than while sliding and falls off with speed.',
            'F_k + (F_s - F_k) exp(-(v/v_s)^2) against the motion; F_s at rest',
            _OLSSON,
            'motion at several constant low speeds, and a slow push from rest',
            Number('kinetic_force', f, (weak, strong), weak, 0.0, 5.0 * s.force),
            Number('excess_force', f, (weak, 0.2 * s.force), weak, 0.0, 5.0 * s.force),
            Number('speed', speed, (0.1 * s.speed,), 0.05 * s.speed, 1e-3 * s.speed, s.speed),
            excludes=_FRICTION,
        ),
    ]


def _damping_terms(s: Sizes) -> list[Term]:
    f, x = s.force_unit, s.position_unit
    square = 0.1 * s.force / s.speed**2
    skew = 0.05 * s.force / s.speed
    return [
        _term(
            'quadratic_damping',
            'guide',
            'Damping grows with the square of the speed.',
            'c2 |v| v',
            'drag of a fluid at high Reynolds number; orifice flow',
            'ring-down from several amplitudes: large swings decay faster',
            Number('coefficient', f'{f} s^2/{x}^2', (square, 5.0 * square), square, 0.0),
        ),
        _term(
            'asymmetric_damping',
            'guide',
            'Viscous friction is stronger one way than the other.',
            'c v + d |v|',
            'friction of a loaded screw or seal depends on the direction of travel',
            'constant speeds, several, both ways',
            Number('difference', f'{f} s/{x}', (skew, -skew), skew),
        ),
    ]


def _spring_terms(s: Sizes) -> list[Term]:
    f, x = s.force_unit, s.position_unit
    cubic = 0.2 * s.stiffness / s.position**2
    square = 0.05 * s.stiffness / s.position
    several = 'the same excitation at several strengths: the frequency moves with amplitude'
    return [
        _term(
            'hardening_spring',
            'spring',
            'The spring gets stiffer the further it is displaced.',
            'k x + k3 x^3 with k3 > 0',
            _DUFFING,
            several,
            Number('cubic', f'{f}/{x}^3', (cubic, 0.1 * cubic), cubic, 0.0),
            excludes=_CUBES,
        ),
        _term(
            'softening_spring',
            'spring',
            'The spring gets softer the further it is displaced.',
            'k x + k3 x^3 with k3 < 0',
            _DUFFING,
            several,
            Number('cubic', f'{f}/{x}^3', (-0.3 * cubic, -0.03 * cubic), cubic, upper=0.0),
            excludes=_CUBES,
        ),
        _term(
            'asymmetric_spring',
            'spring',
            'The spring is stiffer one way than the other.',
            'k x + k2 x^2',
            _DUFFING,
            'static loads both ways',
            Number('quadratic', f'{f}/{x}^2', (square, -square), square),
        ),
        _term(
            'end_stop',
            'spring',
            'A stop is reached at large displacement.',
            'k_s (|x| - d) beyond d',
            'Shaw and Holmes, J. Sound Vib. 90 (1983)',
            'drive until the top of the motion flattens',
            Number(
                'travel',
                x,
                (0.7 * s.position, 0.5 * s.position),
                0.1 * s.position,
                0.3 * s.position,  # nearer to the middle it would be play
            ),
            Number('stiffness', f'{f}/{x}', (s.stiffness,), s.stiffness, 0.0),
        ),
        _term(
            'clearance',
            'guide',
            'There is play: inside it nothing pushes the mass back.',
            'F = 0 for |x| < gap/2, else k (x -+ gap/2)',
            'Kahraman and Singh, J. Sound Vib. 142 (1990)',
            several,
            Number(
                'gap',
                x,
                (0.05 * s.position, 0.5 * s.position),
                0.05 * s.position,
                0.0,
                1.8 * s.position,
            ),
        ),
    ]


def springs_of_axis(s: Sizes) -> list[Term]:
    """What may bring an axis back that is said to move freely: a spring, its cube, a stop."""
    known = {t.name: t for t in _spring_terms(s)}
    return [
        _term(
            'restoring_force',
            'impactor',
            'A spring brings the axis back: a cable, a hose or a bellows.',
            'k x beside the other forces',
            'Hooke (1678)',
            'a hold at each end of the travel: the force that it takes',
            Number(
                'stiffness',
                f'{s.force_unit}/{s.position_unit}',
                (0.1 * s.stiffness, 0.01 * s.stiffness),
                0.1 * s.stiffness,
                0.0,
            ),
        ),
        dataclasses.replace(
            known['hardening_spring'],
            sentence='A force that grows with the cube of the position brings the axis back.',
            equation='k3 x^3 beside the other forces',
            excludes=frozenset(),
        ),
        known['end_stop'],
    ]


def _hysteresis(s: Sizes, leaning: bool) -> Term:
    f, x = s.force_unit, s.position_unit
    rate = 2.0 / s.position
    numbers = [
        Number('stiffness', f'{f}/{x}', (0.3 * s.stiffness, s.stiffness), s.stiffness, 0.0),
        Number('closing', f'1/{x}', (rate, 0.2 * rate), rate, 0.0),
    ]
    if leaning:
        numbers.append(Number('leaning', f'1/{x}', (0.5 * rate, -0.5 * rate), rate))
    return _term(
        'hysteresis',
        'spring',
        'The force depends on the path: part of the spring yields and dissipates every cycle.',
        "s h with h' = v - g |v| h" + (' - d v |h|' if leaning else ''),
        'Bouc (1967); Wen, J. Eng. Mech. 102 (1976)',
        'slow cycles of several amplitudes: a loop that does not depend on the rate',
        *numbers,
        variant='leaning' if leaning else '',
    )


def _weights(s: Sizes, *, spring: bool, joint: bool) -> list[Term]:
    """A hanging weight: in place of the spring, or beside whatever else a joint has."""
    sentence = 'The restoring torque is that of a hanging weight: it goes with the sine.'
    huygens = "the pendulum's equation; Huygens (1673)"
    test = 'swings from several angles: the period grows with the amplitude'
    found = []
    if spring:
        found.append(
            _term(
                'restoring_force',
                'impactor',
                sentence,
                'k sin(x) in place of k x',
                huygens,
                test,
                excludes=_CUBES,
                fixed={'restoring_force.hangs': 1.0},
                restart={'stiffness': s.force} if s.position > TURN else None,
            )
        )
    if joint:
        load = (0.5 * s.force, -0.5 * s.force)
        found.append(
            _term(
                'restoring_force',
                'impactor',
                sentence,
                'k sin(x - x0) beside the other forces',
                huygens,
                'slow motion through the whole range, both ways',
                Number('sine', s.force_unit, load, 0.1 * s.force),
                Number('cosine', s.force_unit, load, 0.1 * s.force),
                variant='joint',
                excludes=_CUBES,
            )
        )
    elif spring:
        found.append(
            _term(
                'restoring_force',
                'impactor',
                sentence,
                'k sin(x - x0) in place of k x',
                huygens,
                test,
                Number('rest_angle', 'rad', (0.1, -0.1, 0.5, -0.5), 0.1, -math.pi, math.pi),
                variant='tilted',
                excludes=_CUBES | {'offset'},
                fixed={'restoring_force.hangs': 1.0},
            )
        )
    return found


def mechanical_terms(
    sizes: Sizes,
    *,
    spring: bool,
    driven: bool,
    angle: bool,
    offset_channel: str = '',
    joint: bool = False,
    axis: bool = False,
) -> tuple[Term, ...]:
    """Candidates for an oscillator.

    Args:
        sizes: of the recordings.
        spring: whether the baseline has a restoring force.
        driven: whether there is an input.
        angle: whether the position is an angle, so that a pendulum's sine may act.
        offset_channel: channel whose zero may be off.
        joint: whether a weight may act beside a spring, hanging at any angle.
        axis: whether springs and stops are looked for that the baseline has none of.
    """
    terms = [*_friction_terms(sizes), *_damping_terms(sizes)]
    if spring:
        terms += _spring_terms(sizes)
        if driven:
            terms += [_hysteresis(sizes, leaning=False), _hysteresis(sizes, leaning=True)]
    if axis:
        terms += springs_of_axis(sizes)
    if angle:
        terms += _weights(sizes, spring=spring, joint=joint or not spring)
    step = 0.02 * sizes.force
    terms.append(
        Term(
            'offset',
            'measurement',
            f'A constant force is there, or the zero of {offset_channel or "the input"} is off.'
            if driven
            else 'The rest position is not at zero.',
            'u + u0',
            'a missing tare',
            'a recording at rest',
            (Number('value', sizes.force_unit, (step, -step), step),),
            channel=offset_channel,
            excludes=frozenset({'asymmetric_friction'}),
        )
    )
    for term in terms:
        if not all(math.isfinite(v) for n in term.numbers for v in n.starts):
            raise ValueError(f'{term.name}: a start value is not finite')
    return tuple(terms)


def all_keys(terms: tuple[Term, ...]) -> list[str]:
    """Names of all numbers of the terms."""
    return [key(term, number) for term in terms for number in term.numbers]
