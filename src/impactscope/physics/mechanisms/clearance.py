"""Play between plate and spring (dead zone)."""

from __future__ import annotations

from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM', 'slack']


@law
def slack(compression: float, gap: float) -> float:
    """Stretch left of ``compression`` once a whole play of ``gap`` is taken up, m."""
    half = 0.5 * gap
    if compression > half:
        return compression - half
    if compression < -half:
        return compression + half
    return 0.0


def _enter(vector: Array, values: Values) -> None:
    vector[at.GAP] = values['gap']


MECHANISM = Mechanism(
    name='clearance',
    subsystem=Subsystem.GUIDE,
    sentence=('There is play between plate and spring: inside it nothing pushes the plate back.'),
    equation='F = 0 for |s| < gap/2, else k (s -+ gap/2)',
    parameters=(Parameter('gap', 'm', 0.0, 5e-3, (1e-5, 1e-4, 5e-4), absent=0.0),),
    source=(
        'Kahraman and Singh, Non-linear dynamics of a spur gear pair, J. Sound Vib. 142 (1990)'
    ),
    test=('ring-down after taps of different strength: the frequency falls with the amplitude'),
    enter=_enter,
)
