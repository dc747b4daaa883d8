"""A constant offset."""

from __future__ import annotations

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values

__all__ = ['MECHANISM']


def _distort(samples: Array, sample_rate: float, values: Values) -> Array:  # noqa: ARG001
    return samples + values['value']


MECHANISM = Mechanism(
    name='offset',
    subsystem=Subsystem.MEASUREMENT,
    sentence='The channel has a constant offset.',
    equation='y + value',
    parameters=(
        Parameter(
            'value', 'of the channel', -1e6, 1e6, (1.0, -1.0), absent=0.0, logarithmic=False
        ),
    ),
    source='a missing tare',
    test='the quiet before a blow',
    distort=_distort,
    kin=('zero_drift',),
)
