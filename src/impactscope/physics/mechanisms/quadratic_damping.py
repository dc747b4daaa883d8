"""Damping with the square of the speed."""

from __future__ import annotations

from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem

__all__ = ['MECHANISM', 'quadratic_force']


@law
def quadratic_force(par: Array, own: int, compression: float, speed: float) -> float:  # noqa: ARG001
    """Force against the motion, N; ``own`` is the place of the coefficient in ``par``."""
    return par[own] * abs(speed) * speed  # type: ignore[no-any-return]


MECHANISM = Mechanism(
    name='quadratic_damping',
    subsystem=Subsystem.GUIDE,
    sentence='Damping in the guide grows with the square of the speed, as in a fluid.',
    equation='c2 |v| v',
    parameters=(Parameter('coefficient', 'N s^2/m^2', 0.0, 1e5, (10.0, 300.0), absent=0.0),),
    source='Nayfeh and Mook, Nonlinear Oscillations (1979), sec. 3.3',
    test='ring-down after a hard tap: the damping ratio grows with amplitude',
    guide_term=quadratic_force,
)
