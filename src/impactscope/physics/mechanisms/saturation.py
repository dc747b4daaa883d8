"""Values beyond a limit are cut off."""

from __future__ import annotations

import math

import numpy as np

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values

__all__ = ['MECHANISM']


def _distort(samples: Array, sample_rate: float, values: Values) -> Array:  # noqa: ARG001
    return np.clip(samples, -values['limit'], values['limit'])


MECHANISM = Mechanism(
    name='saturation',
    subsystem=Subsystem.MEASUREMENT,
    sentence='The channel saturates: larger values are cut off.',
    equation='clip to +-limit',
    parameters=(
        Parameter('limit', 'of the channel', 1e-9, 1e12, (100.0, 500.0), absent=math.inf),
    ),
    source='range of amplifier and converter',
    test='the hardest blow: a flat top',
    distort=_distort,
)
