"""Values come in steps."""

from __future__ import annotations

import numpy as np

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values

__all__ = ['MECHANISM']


def _distort(samples: Array, sample_rate: float, values: Values) -> Array:  # noqa: ARG001
    step = values['step']
    return samples if step == 0 else step * np.round(samples / step)


MECHANISM = Mechanism(
    name='quantisation',
    subsystem=Subsystem.MEASUREMENT,
    sentence='The channel has coarse steps.',
    equation='round to multiples of the step',
    parameters=(Parameter('step', 'of the channel', 0.0, 1e6, (0.1, 1.0), absent=0.0),),
    source='resolution of the converter; Widrow and Kollar, Quantization Noise (2008)',
    test='the quiet before a blow: only few values occur',
    distort=_distort,
)
