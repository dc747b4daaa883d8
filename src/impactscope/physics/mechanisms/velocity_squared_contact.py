"""Slamming: force with the square of the approach speed."""

from __future__ import annotations

from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM', 'slamming_force']


@law
def slamming_force(coefficient: float, approach: float) -> float:
    """Contact force at ``approach`` m/s, N; none while separating."""
    if approach > 0.0:
        return coefficient * approach * approach
    return 0.0


def _enter(vector: Array, values: Values) -> None:
    vector[at.SQUARED] = values['coefficient']


MECHANISM = Mechanism(
    name='velocity_squared_contact',
    subsystem=Subsystem.CONTACT,
    sentence=(
        'The contact force grows with the square of the approach speed, as when a fluid is struck.'
    ),
    equation="c (p' - x')^2 while approaching in contact",
    parameters=(Parameter('coefficient', 'N s^2/m^2', 0.0, 1e5, (3.0, 30.0, 300.0), absent=0.0),),
    source='hydrodynamic slamming; Faltinsen, Sea Loads on Ships (1990), ch. 9',
    test=('blows at several speeds: the onset of the force grows with the square of the speed'),
    enter=_enter,
    needs=frozenset({'impactor'}),
)
