"""A fixture that gives way."""

from __future__ import annotations

import math

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    mass, omega = values['mass'], 2 * math.pi * values['frequency']
    vector[at.BASE_MASS] = mass
    vector[at.BASE_STIFFNESS] = mass * omega**2
    vector[at.BASE_DAMPING] = 2 * values['damping_ratio'] * mass * omega


MECHANISM = Mechanism(
    name='base_compliance',
    subsystem=Subsystem.FIXTURE,
    sentence='The fixture gives way: the sensor stands on a mass on a spring.',
    equation="m_f b'' + c_f b' + k_f b = force of the sensor, k_f = (2 pi f)^2 m_f",
    parameters=(
        Parameter('frequency', 'Hz', 1.0, 5000.0, (60.0, 150.0, 400.0)),
        # what is heavier than any bench does not give way to a plate of a kilogram
        Parameter('mass', 'kg', 0.1, 1e3, (5.0, 30.0)),
        # a fixture of metal or stone rings; what creeps is something else
        Parameter('damping_ratio', '1', 0.0, 0.3, (0.03,), default=0.03),
    ),
    source=('Zimmermann et al., IJERPH 19, 13657 (2022): less rigid fixation changes peak forces'),
    test="the base's accelerometer",
    enter=_enter,
)
