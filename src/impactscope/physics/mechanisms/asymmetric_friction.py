"""Dry friction of the guide that depends on the direction of sliding."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    vector[at.STATIC_FORWARD] = values['force_forward']
    vector[at.STATIC_BACKWARD] = values['force_backward']
    vector[at.KINETIC_FORWARD] = values['force_forward']
    vector[at.KINETIC_BACKWARD] = values['force_backward']


MECHANISM = Mechanism(
    name='asymmetric_friction',
    subsystem=Subsystem.GUIDE,
    sentence='Dry friction in the guide is stronger one way than the other.',
    equation='F+ while sliding into the sensor, F- while sliding back; sticks in between',
    parameters=(
        Parameter('force_forward', 'N', 0.0, 100.0, (0.5, 3.0), absent=0.0),
        Parameter('force_backward', 'N', 0.0, 100.0, (0.2, 1.0), absent=0.0),
    ),
    source=('Olsson et al., Friction models and friction compensation, Eur. J. Control 4 (1998)'),
    test='ring-down after hammer taps: successive half-waves shrink by unequal steps',
    enter=_enter,
    kin=('coulomb_friction', 'stribeck_friction'),
    contains=('coulomb_friction',),
)
