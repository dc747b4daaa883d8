"""Hum of the mains."""

from __future__ import annotations

import math

import numpy as np

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values

__all__ = ['MECHANISM']


def _distort(samples: Array, sample_rate: float, values: Values) -> Array:
    time = np.arange(len(samples)) / sample_rate
    angle = 2 * math.pi * values['frequency'] * time + values['phase']
    return samples + values['amplitude'] * np.sin(angle)


MECHANISM = Mechanism(
    name='mains_hum',
    subsystem=Subsystem.MEASUREMENT,
    sentence='Mains hum is added.',
    equation='A sin(2 pi f t + phase)',
    parameters=(
        Parameter('amplitude', 'of the channel', 0.0, 1e6, (0.5,), absent=0.0),
        Parameter('frequency', 'Hz', 1.0, 1e4, (50.0, 60.0), default=50.0),
        Parameter('phase', 'rad', -math.pi, math.pi, (0.0, 1.57), default=0.0, logarithmic=False),
    ),
    source='ground loops and unshielded leads',
    test='the quiet before a blow: a line in the spectrum',
    distort=_distort,
)
