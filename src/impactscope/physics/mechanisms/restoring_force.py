"""Restoring force of a hanging pendulum."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    vector[at.RESTORING] = values['stiffness']


MECHANISM = Mechanism(
    name='restoring_force',
    subsystem=Subsystem.IMPACTOR,
    sentence='The pendulum hangs: its weight pulls the impactor back to where it hit.',
    equation='K p; K l sin(p/l) on a pendulum',
    parameters=(Parameter('stiffness', 'N/m', 0.0, 1e5, (15.0, 50.0), absent=0.0),),
    source='paper sec. 2.2.2 (horizontal configuration): K = (m_b L/2 + M d) g / l^2',
    test='rebound on the horizontal bench: the impactor comes back after half a swing',
    enter=_enter,
    needs=frozenset({'impactor'}),
    kin=('external_push',),
    alone_in=('pendulum',),
)
