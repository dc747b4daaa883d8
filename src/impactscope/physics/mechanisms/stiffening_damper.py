"""A layer that stiffens."""

from __future__ import annotations

from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM', 'stiffening_factor']


@law
def stiffening_factor(coefficient: float, compression: float) -> float:
    """Factor on the layer's force at ``compression`` m."""
    if compression > 0.0:
        return 1.0 + coefficient * compression
    return 1.0


def _enter(vector: Array, values: Values) -> None:
    vector[at.LAYER_STIFFENING] = values['coefficient']


MECHANISM = Mechanism(
    name='stiffening_damper',
    subsystem=Subsystem.DAMPER,
    sentence='The damper layer stiffens as it is compressed.',
    equation='(k2 u + branches) (1 + b u) for u > 0',
    parameters=(Parameter('coefficient', '1/m', 0.0, 1e4, (20.0, 200.0), absent=0.0),),
    source='foam and elastomer compression; Gent, Engineering with Rubber (2012), ch. 3',
    test='blows at several speeds with the damper: the contact shortens as the force grows',
    enter=_enter,
    needs=frozenset({'damper'}),
    kin=('rate_dependent_damper',),
)
