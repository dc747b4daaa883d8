"""Speed lost before the impact."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    vector[at.IMPACT_SPEED] *= values['ratio']


MECHANISM = Mechanism(
    name='impact_speed_loss',
    subsystem=Subsystem.IMPACTOR,
    sentence=(
        'The impactor arrives slower (or faster) than its release says: hinge '
        'friction, air, a wrong height.'
    ),
    equation="p'(0) = ratio v0",
    parameters=(Parameter('ratio', '1', 0.2, 1.5, (0.95, 0.85), absent=1.0, logarithmic=False),),
    source='eq. 5 and 6 presume no loss',
    test="impactor's accelerometer, integrated over the contact, against the release angle",
    enter=_enter,
    needs=frozenset({'impactor'}),
    alone_in=('pendulum',),
)
