"""Candidates where the residual is noise: every effect with a grid of start values.

Effects of a few times the noise are far from any guess made from the size of the recordings, so
each shape parameter starts from several places and each amount from a small one, which a first,
linear look then stretches to what the recordings ask for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from impactscope.discrepancy.driven.models.channel_effects import channel_terms
from impactscope.discrepancy.driven.models.mechanical_effects import (
    Sizes,
    mechanical_terms,
    springs_of_axis,
)
from impactscope.discrepancy.driven.models.terms import Number, Term

__all__ = ['FRICTION', 'candidate_effects']

FRICTION = frozenset({'coulomb_friction', 'asymmetric_friction', 'stribeck_friction'})


def _ladder(scale: float, low: float, high: float, steps: int) -> tuple[float, ...]:
    return tuple(float(scale * v) for v in np.geomspace(low, high, steps))


def _with(term: Term, amounts: Sequence[str], **numbers: tuple[float, ...]) -> Term:
    """A term with other start values; numbers are measured by the smallest of them."""
    changed = tuple(
        dataclasses.replace(n, starts=numbers[n.name], scale=abs(numbers[n.name][0]))
        if n.name in numbers
        else n
        for n in term.numbers
    )
    return dataclasses.replace(term, numbers=changed, amounts=tuple(amounts))


def candidate_effects(
    sizes: Sizes,
    plate: tuple[float, float, float],
    output: tuple[str, str],
    rate: float,
    longest: float,
    noise: float,
    peak: float,
    recordings: int = 1,
    *,
    ends: tuple[int, int] = (0, 0),
    kind: str = 'driven',
    drive: str = '',
    tag: str = '',
    joint: bool = False,
) -> tuple[Term, ...]:
    """Candidates of the vocabulary.

    Args:
        sizes: of the recordings.
        plate: mass, damping and stiffness of the baseline.
        output: the channel's name and unit.
        rate: samples a second.
        longest: recording, s.
        noise: standard deviation of the output's noise.
        peak: largest sample of the output.
        recordings: their number.
        ends: how many of them begin and how many end in motion, see :func:`channel_terms`.
        kind: ``driven``, ``free`` (no input) or ``axis`` (no spring).
        drive: the input channel's name.
        tag: tells the effects of several channels apart.
        joint: whether it is a joint, whose link may have a weight.
    """
    mass, _, stiffness = plate
    x, v = sizes.position, sizes.speed
    load = stiffness * x
    angle = kind == 'free' and sizes.position_unit == 'rad'
    known = {
        t.label: t
        for t in mechanical_terms(
            sizes,
            spring=True,
            driven=True,
            angle=angle or joint,
            offset_channel=drive,
            joint=joint,
        )
    }
    chain = channel_terms(
        *output, rate, longest, noise, peak, recordings=recordings, ends=ends, tag=tag
    )
    rub = _ladder(load, 1e-5, 0.1, 7)
    uneven = _with(
        known['asymmetric_friction'],
        ['force_forward', 'force_backward'],
        force_forward=rub[1:6:2],
        force_backward=rub[1:6:2],
    )
    if kind == 'driven' and '/s' in output[1]:
        # the load that stays in it shows in a position alone, as an offset of it
        uneven = dataclasses.replace(uneven, excludes=uneven.excludes - {'offset'})
    found = [
        _with(known['coulomb_friction'], ['force'], force=rub),
        uneven,
        _with(
            known['stribeck_friction'],
            ['kinetic_force', 'excess_force'],
            kinetic_force=(rub[2],),
            excess_force=(rub[2],),
            speed=_ladder(v, 0.003, 0.5, 4),
        ),
        _with(
            known['quadratic_damping'],
            ['coefficient'],
            coefficient=_ladder(load / v**2, 1e-4, 1e-2, 2),
        ),
    ]
    if joint:
        weight = known['restoring_force/joint']
        load_of_it = (1e-3 * load, 0.3 * load, -0.3 * load)
        found.append(_with(weight, ['sine', 'cosine'], sine=load_of_it, cosine=load_of_it))
    if kind == 'axis':
        push = known['offset']
        found.append(_with(push, ['value'], value=_ladder(load, 1e-4, 1e-2, 2)))
        if not joint:
            found += _springs_of_axis(springs_of_axis(sizes), x, load)
        found.append(_base(mass, _ladder(1.0, 1.0, 0.3 * rate, 40), rate, reacts=True))
        return (*found, *chain)
    if angle:
        found.append(known['restoring_force'])
    found += [
        _with(known['hardening_spring'], ['cubic'], cubic=_ladder(load / x**3, 1e-4, 1e-2, 2)),
        _with(known['softening_spring'], ['cubic'], cubic=_ladder(-load / x**3, 1e-4, 1e-2, 2)),
        _with(known['clearance'], ['gap'], gap=_ladder(x, 1e-5, 0.1, 6)),
    ]
    found += _stops(known['end_stop'], x, (0.03 * stiffness, stiffness))
    slips = _ladder(x, 0.01, 2.0, 8)
    found.append(
        dataclasses.replace(
            known['hysteresis'],
            equation="k (1 - a) x + k a h with h' = v (1 - [v h > 0] |h| / x_y)",
            numbers=(
                Number('share', '1', (1e-3, 0.05), 1e-3, 0.0, 0.95),
                Number(
                    'yield_displacement', sizes.position_unit, slips, 0.1 * x, 1e-4 * x, 20.0 * x
                ),
            ),
            variant='share',
            amounts=('share',),
        )
    )
    if kind == 'free':
        return (*found, *chain)
    natural = float(np.sqrt(stiffness / mass)) / (2.0 * np.pi)
    found.append(_base(mass, _ladder(natural, 0.3, 25.0, 40), rate))
    return (*found, *chain)


def _stops(stop: Term, x: float, stiffness: tuple[float, ...]) -> list[Term]:
    """A stop on one side, and one on each; ``stiffness``: to start from, the least one first."""
    travels = tuple(x * s for s in (0.97, 0.9, 0.8, 0.65, 0.5, 0.35))
    stop = _with(stop, ['stiffness'], travel=travels, stiffness=stiffness)
    least = tuple(
        dataclasses.replace(n, lower=0.1 * x, upper=x, scale=0.05 * x) if n.name == 'travel' else n
        for n in stop.numbers
    )
    one_way = dataclasses.replace(
        stop,
        numbers=least,
        variant='one-way',
        fixed={'end_stop.one_way': 1.0},
        equation='k_s (x - d) beyond d',
    )
    return [one_way, dataclasses.replace(stop, numbers=least)]


def _springs_of_axis(known: Sequence[Term], x: float, load: float) -> list[Term]:
    """Springs and stops of an axis that is said to move freely."""
    spring, cubic, stop = known
    return [
        _with(spring, ['stiffness'], stiffness=_ladder(load / x, 1e-5, 1e-2, 2)),
        _with(cubic, ['cubic'], cubic=_ladder(load / x**3, 1e-5, 1e-2, 2)),
        # what accelerates an axis is far more than a soft stop, which shows all the same
        *_stops(stop, x, _ladder(load / x, 1e-5, 1.0, 3)),
    ]


def _base(
    mass: float, frequencies: tuple[float, ...], rate: float, *, reacts: bool = False
) -> Term:
    """A fixture that gives way under the suspension of a mass, or under what drives it."""
    what, under = ('axis', 'drive') if reacts else ('plate', "plate's suspension")
    first = frequencies[0]
    return Term(
        'base_compliance',
        'fixture',
        f'The fixture gives way: the {what} stands on a mass on a spring.',
        f"M b'' + c_b b' + k_b b = force of the {under}",
        'Zimmermann et al., IJERPH 19, 13657 (2022)',
        "the base's accelerometer",
        (
            Number('frequency', 'Hz', frequencies, first / 3.0, first / 15.0, 0.3 * rate),
            Number('mass', 'kg', (1e5 * mass,), mass, 0.02 * mass, 1e7 * mass),
            # a fixture of metal or stone rings; what creeps is something else
            Number('damping_ratio', '1', (0.05,), 0.01, 0.0, 0.3),
        ),
        variant='drive' if reacts else '',
        fixed={'base_compliance.reacts': 1.0} if reacts else None,
        amounts=('/mass',),
    )
