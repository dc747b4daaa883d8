"""Numbers of a free swing, which are per mass, as forces where a mass or a spring is stated."""

from __future__ import annotations

import dataclasses
import math
import re

from impactscope.discrepancy.answer import ParameterEstimate
from impactscope.discrepancy.campaign import Quantity
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel
from impactscope.discrepancy.driven.models.terms import Term

__all__ = ['as_force', 'mass_of_free_swing', 'swings_freely', 'unit_per_mass']

PER_MASS = 'm/s^2'  # the unit of a force there


def swings_freely(s: Subject) -> bool:
    """Whether no force is measured, so that only ratios to the mass show."""
    return isinstance(s.model, OscillatorModel) and s.model.free


def mass_of_free_swing(s: Subject) -> Quantity | None:
    """Mass in kg, as stated or from the stated stiffness; None where numbers stay per mass."""
    if not swings_freely(s) or s.segments[0].unit not in ('m', 'm/s', 'm/s^2'):
        return None
    mass, spring = s.campaign.sensor.get('moving_mass'), s.campaign.sensor.get('stiffness')
    if mass is not None and mass.known:
        return mass
    found = s.outcome.best.values.get('stiffness', 0.0)
    if spring is None or not spring.known or not found > 0.0:
        return None
    certain = s.outcome.best.std.get('stiffness', 0.0) / found
    value = spring.value / found
    return Quantity(value, value * math.hypot(spring.std / spring.value, certain))


def unit_per_mass(unit: str) -> str:
    """A unit like ``rad/s^2 s/rad``, of a force per mass over powers of a motion, cancelled."""
    parts = re.fullmatch(r'(m|rad)/s\^2(?: s(?:\^(\d))?)?/\1(?:\^(\d))?', unit)
    if parts is None:
        return unit
    length, time, power = parts.groups()
    seconds = 2 - (int(time or 1) if ' s' in unit else 0)
    lengths = int(power or 1) - 1
    below = [
        f'{name}^{count}' if count > 1 else name
        for name, count in ((length, lengths), ('s', seconds))
        if count
    ]
    if not below:
        return '1'
    return f'1/{below[0]}' if len(below) == 1 else f'1/({" ".join(below)})'


def as_force(
    item: ParameterEstimate, mass: Quantity | None, term: Term | None
) -> ParameterEstimate:
    """An estimate per mass as a force; per mass where no mass is known or no force meant.

    Args:
        item: the estimate.
        mass: of the swing.
        term: whose number it is; None: of the linear model. Numbers of a channel stay.
    """
    if mass is None:
        return dataclasses.replace(item, unit=unit_per_mass(item.unit))
    if not item.unit.startswith(PER_MASS) or isinstance(item.value, str):
        return item
    if term is not None and (term.output or term.subsystem == 'measurement'):
        return item
    unit = 'N' + item.unit.removeprefix(PER_MASS)
    return dataclasses.replace(
        item,
        value=mass.value * item.value,
        std=math.hypot(mass.value * item.std, item.value * mass.std),
        unit={'N s^2/m': 'kg'}.get(unit, unit),
    )
