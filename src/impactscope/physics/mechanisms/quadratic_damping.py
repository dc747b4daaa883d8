"""Damping with the square of the speed."""

from __future__ import annotations

from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM', 'quadratic_force']


@law
def quadratic_force(coefficient: float, speed: float) -> float:
    """Force against the motion, N."""
    return coefficient * abs(speed) * speed


def _enter(vector: Array, values: Values) -> None:
    vector[at.QUADRATIC] = values['coefficient']


MECHANISM = Mechanism(
    name='quadratic_damping',
    subsystem=Subsystem.GUIDE,
    sentence='Damping in the guide grows with the square of the speed, as in a fluid.',
    equation='c2 |v| v',
    parameters=(Parameter('coefficient', 'N s^2/m^2', 0.0, 1e5, (10.0, 300.0), absent=0.0),),
    source='Nayfeh and Mook, Nonlinear Oscillations (1979), sec. 3.3',
    test='ring-down after a hard tap: the damping ratio grows with amplitude',
    enter=_enter,
)
