"""Weight of the impactor on the plate."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    vector[at.LOAD] = values['force']


MECHANISM = Mechanism(
    name='gravity_load',
    subsystem=Subsystem.IMPACTOR,
    sentence="The impactor's weight rests on the plate.",
    equation='F toward the plate; F cos(p/l) on a pendulum',
    parameters=(
        Parameter('force', 'N', -200.0, 200.0, (4.0, 13.0), absent=0.0, logarithmic=False),
    ),
    source='paper sec. 3.2 (vertical configuration): (m_b L/2 + M d) g / l',
    test='the level to which the force settles after a blow on the vertical bench',
    enter=_enter,
    needs=frozenset({'impactor'}),
    kin=('external_push',),
    alone_in=('pendulum', 'robot'),
)
