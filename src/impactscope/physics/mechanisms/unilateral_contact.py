"""Contact that pushes only."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:  # noqa: ARG001
    vector[at.UNILATERAL] = 1.0


MECHANISM = Mechanism(
    name='unilateral_contact',
    subsystem=Subsystem.CONTACT,
    sentence='The impactor can push but not pull: contact is lost and found again.',
    equation='f_i >= 0; free flight in between',
    parameters=(),
    source='paper sec. 3.2 (monolateral contact)',
    test=(
        'any blow with a rebound: the coupled oscillation ends when the contact force '
        'would turn negative'
    ),
    enter=_enter,
    needs=frozenset({'impactor'}),
)
