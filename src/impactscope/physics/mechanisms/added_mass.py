"""Mass of a struck medium."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM']


def _enter(vector: Array, values: Values) -> None:
    vector[at.ADDED_MASS] = values['mass']


MECHANISM = Mechanism(
    name='added_mass',
    subsystem=Subsystem.CONTACT,
    sentence='The struck medium has mass: the impactor takes it along while in contact.',
    equation="(M + m_a) p'' = ..., with the momentum of the blow shared at first touch",
    parameters=(Parameter('mass', 'kg', 0.0, 10.0, (0.05, 0.3), absent=0.0),),
    source=(
        'von Karman (NACA TN 321, 1929); plastic sharing of momentum, the medium at '
        'rest before and left behind after'
    ),
    test=(
        'blows with impactors of different mass: the apparent mass in contact exceeds '
        'that in flight'
    ),
    enter=_enter,
    needs=frozenset({'impactor'}),
)
