"""A spring that yields (Bouc-Wen)."""

from __future__ import annotations

from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM', 'yielding_rate']


@law
def yielding_rate(speed: float, internal: float, yield_displacement: float) -> float:
    """Rate of the internal displacement, m/s."""
    if speed * internal <= 0.0:
        return speed
    return speed * (1.0 - abs(internal) / yield_displacement)


def _enter(vector: Array, values: Values) -> None:
    vector[at.HYSTERESIS_SHARE] = values['share']
    vector[at.HYSTERESIS_YIELD] = values['yield_displacement']


MECHANISM = Mechanism(
    name='hysteresis',
    subsystem=Subsystem.SPRING,
    sentence=(
        "The spring's force depends on the path: part of it yields and gives energy "
        'away on every cycle.'
    ),
    equation="k (1 - a) s + k a h, h' = v (1 - [v h > 0] |h|/s_y)",
    parameters=(
        Parameter('share', '1', 0.0, 0.95, (0.05, 0.2), absent=0.0),
        Parameter('yield_displacement', 'm', 1e-7, 0.02, (1e-4, 1e-3)),
    ),
    source=(
        'Bouc (1967), Wen (J. Eng. Mech. 102, 1976), with beta = gamma = 1/2 and '
        'exponent 1, which dissipates always'
    ),
    test=(
        'slow compression and release, and taps of different strength: a loop that does '
        'not depend on the rate'
    ),
    enter=_enter,
)
