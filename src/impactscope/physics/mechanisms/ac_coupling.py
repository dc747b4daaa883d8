"""A first-order high-pass in one channel."""

from __future__ import annotations

import math

import numpy as np
from scipy import signal

from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values

__all__ = ['MECHANISM', 'high_pass']

HIGHEST = 0.49  # of the sampling rate


def high_pass(corner: float, sample_rate: float) -> tuple[Array, Array]:
    """Coefficients b and a of a first-order high-pass of samples, each of shape (2,).

    The bilinear transform of s / (s + 2 pi corner), at the corner exact (Oppenheim and Schafer,
    Discrete-Time Signal Processing, sec. 7.2): in closed form, since fits ask for it thousands of
    times.

    Args:
        corner: Hz, above zero and below half the sampling rate.
        sample_rate: Hz.
    """
    turn = math.tan(math.pi * corner / sample_rate)
    passed = 1.0 / (1.0 + turn)
    return np.array([passed, -passed]), np.array([1.0, (turn - 1.0) * passed])


def _distort(samples: Array, sample_rate: float, values: Values) -> Array:
    corner = values['corner']
    if corner == 0:
        return samples
    # samples show no corner beyond half their rate
    b, a = high_pass(min(corner, HIGHEST * sample_rate), sample_rate)
    start = np.array([-b[0] * samples[0]])  # settled at the first sample: nothing passes
    return np.asarray(signal.lfilter(b, a, samples, zi=start)[0])


MECHANISM = Mechanism(
    name='ac_coupling',
    subsystem=Subsystem.MEASUREMENT,
    sentence='The channel is AC coupled: slow signals fade.',
    equation='first-order high-pass at the corner frequency',
    parameters=(Parameter('corner', 'Hz', 0.0, 1e3, (0.1, 1.0, 5.0), absent=0.0),),
    source='piezoelectric sensors and IEPE inputs',
    test='a load that stays: the reading returns to zero',
    distort=_distort,
    kin=('zero_drift',),
)
