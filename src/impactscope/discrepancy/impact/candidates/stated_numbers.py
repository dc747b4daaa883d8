"""Stated numbers that may be wrong: those of sensor, layer, pendulum, and of each blow."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.models.bench_model import ActiveEffect, Free, ImpactModel
from impactscope.discrepancy.impact.models.bench_parameters import ADDED_WEIGHT, WEIGHT

__all__ = ['wrong_numbers']

_STATED = ('sensor.', 'damper.', 'pendulum.', 'mass_distance@', 'angle@')
_STEEPEST = 89.0  # deg
_OF_A_PUSH = 2  # numbers of a push that a load holds: it has begun, and has risen
_NOT_STATED = 2.0  # doubt that a load that nobody has stated is meant


def wrong_numbers(model: ImpactModel) -> Iterator[Candidate]:
    """Stated numbers that may be wrong: constants set free, and priors let go."""
    values = model.values(model.start())
    for number in model.free:
        if number.prior is None or number.key.startswith('tap_'):
            continue
        recording = '' if number.blow is None else model.data.blows[number.blow].name
        if number.blow is not None and number.blow not in model.data.fitted:
            continue
        freed = Free(
            number.key,
            number.start,
            number.scale,
            number.lower,
            number.upper,
            number.logarithmic,
            None,
            number.blow,
        )
        yield Candidate(
            label=f'wrong {number.key}',
            name='wrong_parameter',
            subsystem='parameter',
            free=(freed,),
            parameter=number.key,
            recording=recording,
        )
    for key, value in model.constants.items():
        stated = key.startswith(_STATED)
        place = key.startswith('mass_distance@')  # that may be nought
        most = _STEEPEST if key.startswith('angle@') else value * 20
        if not stated or not (value > 0 or place):
            continue
        blow = int(key.split('@')[1]) if '@' in key else None
        if blow is not None and blow not in model.data.fitted:
            continue
        yield Candidate(
            label=f'wrong {key}',
            name='wrong_parameter',
            subsystem='parameter',
            free=(
                Free(key, value, 0.005, 0.0, 0.6, blow=blow)
                if place
                else Free(key, value, 0.02, value / 20, most, logarithmic=True, blow=blow),
            ),
            starts=({key: value + 0.005 if place else 1.05 * value},),
            amplitudes={key: value},
            parameter=key,
            recording='' if blow is None else model.data.blows[blow].name,
        )
    yield from _exact_gains(model)
    yield from _other_weight(model)
    swings = any(b.recording.kind == 'pendulum' for b in model.data.blows)
    if swings and 'pendulum.contact_distance' in values:
        yield from _other_orientation(model)


def _exact_gains(model: ImpactModel) -> Iterator[Candidate]:
    """Gains of channels that are stated to have no tolerance."""
    known = {f.key for f in model.free}
    for channel in model.data.channels:
        key = f'gain.{channel}'
        if key in known:
            continue
        yield Candidate(
            label=f'wrong {key}',
            name='wrong_parameter',
            subsystem='parameter',
            free=(Free(key, 1.0, 0.01, 0.2, 5.0),),
            starts=({key: 1.05},),
            amplitudes={key: 1.0},
            parameter=key,
        )


def _other_weight(model: ImpactModel) -> Iterator[Candidate]:
    """A weight that geometry or mass imply, and that is another: by a factor, or by a load.

    Where no load is stated none is stated wrongly, and a further one is a push that does not
    change: it counts as one, and of two that explain as much it is the less likely.
    """
    for active in model.effects:
        follows = any(
            math.isnan(value) and key.startswith((f'{active.tag}.force@', f'{active.tag}.stiff'))
            for key, value in model.constants.items()
        )
        if active.name not in ('gravity_load', 'restoring_force') or not follows:
            continue
        key = f'{active.tag}.{WEIGHT}'
        stated = model.constants.get(key, 1.0)
        numbers = [(Free(key, stated, 0.02, 0.05, 20.0, logarithmic=True), 1.05 * stated, 0)]
        if active.name == 'gravity_load':
            key = f'{active.tag}.{ADDED_WEIGHT}'
            stated = model.constants.get(key, 0.0)
            implied = 0 if stated else _OF_A_PUSH
            numbers.append((Free(key, stated, 0.1, -1e3, 1e3), stated + 0.1, implied))
        for number, tried, implied in numbers:
            if number.key in {f.key for f in model.free}:
                continue
            yield Candidate(
                label=f'wrong {number.key}',
                name='wrong_parameter',
                subsystem='parameter',
                free=(number,),
                starts=({number.key: tried},),
                amplitudes={number.key: number.start},
                parameter=number.key,
                implied=implied,
                doubt=_NOT_STATED if implied else 0.0,
            )


def _other_orientation(model: ImpactModel) -> Iterator[Candidate]:
    """The label of the bench's orientation is wrong: speed and weight change.

    A hanging pendulum is pulled back to where it hit, unless it is caught or led.
    """
    other = 1.0 - model.constants['orientation']
    missing = 'restoring_force' if other > 0.5 else 'gravity_load'
    parameter = 'stiffness' if other > 0.5 else 'force'
    effects: tuple[ActiveEffect, ...] = ()
    constants: dict[str, float] = {'orientation': other}
    if missing not in {e.name for e in model.effects}:
        effects = (ActiveEffect(missing),)
        constants[f'{missing}.{parameter}'] = math.nan
    whole = Candidate(
        label='wrong orientation',
        name='wrong_parameter',
        subsystem='parameter',
        effects=effects,
        constants=constants,
        parameter='orientation',
    )
    yield whole
    if effects and missing == 'restoring_force':
        yield dataclasses.replace(
            whole,
            label='wrong orientation, nothing pulls back',
            effects=(),
            constants={'orientation': other},
        )
