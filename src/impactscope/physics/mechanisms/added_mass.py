"""Mass of a struck medium."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    vector[at.PLATE_MASS] += values['mass']


MECHANISM = Mechanism(
    name='added_mass',
    subsystem=Subsystem.CONTACT,
    sentence='The struck medium has mass: it moves along with the plate in every blow.',
    equation="(m + m_a) x'' = ... where an impactor strikes",
    parameters=(Parameter('mass', 'kg', 0.0, 10.0, (0.05, 0.3), absent=0.0),),
    source='added mass of a struck medium; von Karman, NACA TN 321 (1929)',
    test='taps beside blows: the plate is heavier in the blows',
    enter=_enter,
    needs=frozenset({'impactor'}),
)
