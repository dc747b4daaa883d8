"""A layer that stiffens."""

from __future__ import annotations

from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM', 'stiffening_energy', 'stiffening_force']


@law
def stiffening_force(stiffness: float, coefficient: float, u: float) -> float:
    """Force of the layer's parallel spring at compression ``u`` m, N."""
    return stiffness * u * (1.0 + coefficient * abs(u))


@law
def stiffening_energy(stiffness: float, coefficient: float, u: float) -> float:
    """Energy stored by :func:`stiffening_force`, J."""
    return stiffness * u * u * (0.5 + coefficient * abs(u) / 3.0)


def _enter(vector: Array, values: Values) -> None:
    vector[at.LAYER_STIFFENING] = values['coefficient']


MECHANISM = Mechanism(
    name='stiffening_damper',
    subsystem=Subsystem.DAMPER,
    sentence='The damper layer stiffens as it is compressed.',
    equation='k2 u (1 + b |u|) for the parallel spring',
    parameters=(Parameter('coefficient', '1/m', 0.0, 1e4, (20.0, 200.0), absent=0.0),),
    source='foam and elastomer compression; Gent, Engineering with Rubber (2012), ch. 3',
    test='blows at several speeds with the damper: the contact shortens as the force grows',
    enter=_enter,
    needs=frozenset({'damper'}),
    kin=('rate_dependent_damper',),
)
