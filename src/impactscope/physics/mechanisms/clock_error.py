"""A device's clock that is off."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values

__all__ = ['MECHANISM']


def _retime(stamps: Array, values: Values) -> Array:
    return (stamps - values['offset']) / (1 + values['drift'])


MECHANISM = Mechanism(
    name='clock_error',
    subsystem=Subsystem.MEASUREMENT,
    sentence="The device's clock is off: its stamps are shifted and stretched.",
    equation='stamp = t (1 + drift) + offset',
    parameters=(
        Parameter(
            'offset', 's', -10.0, 10.0, (1e-3, -1e-3), absent=0.0, default=0.0, logarithmic=False
        ),
        Parameter('drift', '1', -0.01, 0.01, (5e-5,), absent=0.0, default=0.0, logarithmic=False),
    ),
    source='free-running clocks of separate devices',
    test='the onset of every blow in two channels',
    retime=_retime,
    kin=('low_pass_filter',),
)
