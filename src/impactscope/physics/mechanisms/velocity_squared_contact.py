"""Slamming: force with the square of the approach speed."""

from __future__ import annotations

from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem

__all__ = ['MECHANISM', 'slamming_force']


@law
def slamming_force(par: Array, own: int, indentation: float, approach: float) -> float:  # noqa: ARG001
    """Contact force, N, none while separating; ``own``: place of the coefficient in ``par``."""
    if approach > 0.0:
        return par[own] * approach * approach  # type: ignore[no-any-return]
    return 0.0


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
    contact_term=slamming_force,
    needs=frozenset({'impactor'}),
)
