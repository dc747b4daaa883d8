"""Dry friction of the guide, set-valued: it sticks exactly."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    vector[at.STATIC_FORWARD] = values['force']
    vector[at.STATIC_BACKWARD] = values['force']
    vector[at.KINETIC_FORWARD] = values['force']
    vector[at.KINETIC_BACKWARD] = values['force']


MECHANISM = Mechanism(
    name='coulomb_friction',
    subsystem=Subsystem.GUIDE,
    sentence=(
        'Dry friction in the guide holds the plate against motion with a constant '
        'force and lets it stick.'
    ),
    equation='F sign(v) while sliding; at rest any force up to F',
    parameters=(Parameter('force', 'N', 0.0, 100.0, (0.3, 2.0, 8.0), absent=0.0),),
    source=('Olsson et al., Friction models and friction compensation, Eur. J. Control 4 (1998)'),
    test=(
        'ring-down after hammer taps of different strength: the decay is linear, not '
        'exponential, and ends away from zero'
    ),
    enter=_enter,
    kin=('asymmetric_friction', 'stribeck_friction'),
)
