"""A zero that drifts."""

from __future__ import annotations

import numpy as np

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values

__all__ = ['MECHANISM']


def _distort(samples: Array, sample_rate: float, values: Values) -> Array:
    return samples + values['rate'] * np.arange(len(samples)) / sample_rate


MECHANISM = Mechanism(
    name='zero_drift',
    subsystem=Subsystem.MEASUREMENT,
    sentence='The zero of the channel drifts.',
    equation='r t from the first sample on',
    parameters=(
        Parameter(
            'rate', 'of the channel per s', -1e6, 1e6, (0.5, -0.5), absent=0.0, logarithmic=False
        ),
    ),
    source='temperature and charge leakage',
    test='quiet before against quiet after a blow',
    distort=_distort,
    kin=('ac_coupling', 'offset'),
)
