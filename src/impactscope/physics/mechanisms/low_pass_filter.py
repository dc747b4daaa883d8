"""A Butterworth low-pass in one channel."""

from __future__ import annotations

import math

import numpy as np
from scipy import signal

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values

__all__ = ['MECHANISM']


def _distort(samples: Array, sample_rate: float, values: Values) -> Array:
    if values['cutoff'] >= 0.5 * sample_rate:
        return samples
    sections = signal.butter(int(values['order']), values['cutoff'], fs=sample_rate, output='sos')
    if values['zero_phase']:
        return np.asarray(signal.sosfiltfilt(sections, samples))
    start = signal.sosfilt_zi(sections) * samples[0]
    return np.asarray(signal.sosfilt(sections, samples, zi=start)[0])


MECHANISM = Mechanism(
    name='low_pass_filter',
    subsystem=Subsystem.MEASUREMENT,
    sentence='A low-pass filter stands in the channel.',
    equation='Butterworth of given order and cut-off, forward or forward and backward',
    parameters=(
        Parameter('cutoff', 'Hz', 0.1, 1e6, (50.0, 200.0, 1000.0), absent=math.inf),
        Parameter('order', '1', 1, 8, (2, 4), default=2, whole=True, logarithmic=False),
        Parameter('zero_phase', '1', 0, 1, (0, 1), default=0, whole=True, logarithmic=False),
    ),
    source='ISO 6487 and SAE J211 channel filters are of this kind',
    test='a hard tap, beside an unfiltered channel',
    distort=_distort,
    kin=('clock_error',),
)
