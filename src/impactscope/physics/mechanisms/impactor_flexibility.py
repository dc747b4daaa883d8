"""An impactor of two masses; the frequency is that of the far one with the contact point held."""

from __future__ import annotations

import math

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    share, mass = values['mass_share'], vector[at.IMPACTOR_MASS]
    omega = 2 * math.pi * values['frequency']
    far = mass * share
    vector[at.IMPACTOR_MASS] = mass - far
    vector[at.SECOND_MASS] = far
    vector[at.FLEXURE_STIFFNESS] = far * omega**2
    vector[at.FLEXURE_DAMPING] = 2 * values['damping_ratio'] * far * omega


MECHANISM = Mechanism(
    name='impactor_flexibility',
    subsystem=Subsystem.IMPACTOR,
    sentence='The impactor is not rigid: a part of its mass swings on an elastic arm.',
    equation="m2 q'' = k_f (p - q) + c_f (p' - q'), k_f = (2 pi f)^2 m2, m2 = s M",
    parameters=(
        Parameter('frequency', 'Hz', 5.0, 5000.0, (30.0, 100.0, 300.0)),
        Parameter('mass_share', '1', 0.0, 0.95, (0.1, 0.4), absent=0.0, logarithmic=False),
        Parameter('damping_ratio', '1', 0.0, 1.0, (0.02,), default=0.02),
    ),
    source=(
        'reduced mass-spring-mass model of compliant robots; Jeanneau et al., J. Mech. '
        'Robot. 16 (2024)'
    ),
    test="ringing of the impactor's accelerometer after it has left the plate",
    enter=_enter,
    needs=frozenset({'impactor'}),
    alone_in=('robot', 'pendulum'),
)
