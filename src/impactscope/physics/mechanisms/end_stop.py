"""A stop at the end of the travel."""

from __future__ import annotations

from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM', 'stop_energy', 'stop_force']


@law
def stop_force(stiffness: float, travel: float, compression: float) -> float:
    """Force of the stop, N."""
    if stiffness > 0.0 and compression > travel:
        return stiffness * (compression - travel)
    return 0.0


@law
def stop_energy(stiffness: float, travel: float, compression: float) -> float:
    """Energy stored in the stop, J."""
    if stiffness > 0.0 and compression > travel:
        return 0.5 * stiffness * (compression - travel) ** 2
    return 0.0


def _enter(vector: Array, values: Values) -> None:
    vector[at.STOP_TRAVEL] = values['travel']
    vector[at.STOP_STIFFNESS] = values['stiffness']


MECHANISM = Mechanism(
    name='end_stop',
    subsystem=Subsystem.SPRING,
    sentence=(
        'The plate runs into an end stop: beyond a certain travel a second, stiff '
        'spring takes part.'
    ),
    equation='k s + k_e max(0, s - travel)',
    parameters=(
        Parameter('travel', 'm', 1e-5, 0.05, (1e-3, 2e-3, 4e-3)),
        Parameter('stiffness', 'N/m', 0.0, 1e8, (1e5, 1e6), absent=0.0),
    ),
    source='piecewise linear oscillator; Shaw and Holmes, J. Sound Vib. 90 (1983)',
    test='blows at several speeds: nothing changes up to a force, then the peak sharpens',
    enter=_enter,
    kin=('hardening_spring',),
)
