"""A spring that softens."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    vector[at.CUBIC] = values['cubic']


MECHANISM = Mechanism(
    name='softening_spring',
    subsystem=Subsystem.SPRING,
    sentence='The spring gets softer the further it is compressed.',
    equation='k s + k3 s^3 with k3 < 0',
    parameters=(Parameter('cubic', 'N/m^3', -1e13, 0.0, (-1e8, -1e9), absent=0.0),),
    source="Duffing's equation; Nayfeh and Mook, Nonlinear Oscillations (1979), ch. 4",
    test='blows at several speeds: contact lengthens, frequency falls with amplitude',
    enter=_enter,
    kin=('hardening_spring', 'clearance'),
)
