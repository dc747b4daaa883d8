"""A spring that stiffens."""

from __future__ import annotations

from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM', 'cubic_energy', 'cubic_force']


@law
def cubic_force(cubic: float, stretch: float) -> float:
    """Force beyond the linear one, N; a negative ``cubic`` softens."""
    return cubic * stretch * stretch * stretch


@law
def cubic_energy(cubic: float, stretch: float) -> float:
    """Energy stored by :func:`cubic_force`, J."""
    return 0.25 * cubic * stretch * stretch * stretch * stretch


def _enter(vector: Array, values: Values) -> None:
    vector[at.CUBIC] = values['cubic']


MECHANISM = Mechanism(
    name='hardening_spring',
    subsystem=Subsystem.SPRING,
    sentence='The spring gets stiffer the further it is compressed.',
    equation='k s + k3 s^3 with k3 > 0',
    parameters=(Parameter('cubic', 'N/m^3', 0.0, 1e13, (1e8, 1e9, 1e10), absent=0.0),),
    source="Duffing's equation; Nayfeh and Mook, Nonlinear Oscillations (1979), ch. 4",
    test='blows at several speeds: contact shortens, frequency rises with amplitude',
    enter=_enter,
    kin=('softening_spring', 'end_stop'),
)
