"""A hum's one amplitude, and what the phases of the recordings take of the evidence for it.

The mains leave one amplitude in a channel and a phase by chance in each recording. Fitted, each
recording has two numbers, to which noise gives two of chi-square, whether it is long enough to
tell anything of a hum or not. The likelihood with the phases averaged over, that of an envelope
in noise (Rice, Bell Syst. Tech. J. 24, 1945), has the amplitude alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

__all__ = ['HumAmplitude', 'hum_amplitude']

Array = NDArray[np.float64]

_FARTHEST = 3.0  # times the largest amplitude of a recording
_PHASES = 256  # over which is averaged
_STEP = 0.1  # standard deviations, over which the likelihood's bend is taken


@dataclass(frozen=True, slots=True)
class HumAmplitude:
    """The amplitude that all recordings share."""

    value: float  # in the unit of the numbers
    std: float
    gain: float
    """Twice the logarithm of its likelihood over that of none.

    Under noise none is likeliest in half of all cases, and the gain goes like chi-square of one
    degree of freedom in the others.
    """
    taken: float  # fall of chi-square by sine and cosine of each recording beyond that


def hum_amplitude(parts: Sequence[tuple[Array, Array]]) -> HumAmplitude:
    """The likeliest amplitude of a hum.

    Args:
        parts: of each recording, sine and cosine as fitted, shape (2,), and their covariance,
            shape (2, 2).

    Returns:
        Nothing, without a standard deviation, where no recording tells anything.
    """
    told = [(numbers, np.linalg.inv(c)) for numbers, c in parts if np.all(np.diag(c) > 0.0)]
    gains = np.array([float(numbers @ precision @ numbers) for numbers, precision in told])
    if not np.any(gains > 0.0):
        return HumAmplitude(0.0, math.nan, 0.0, 0.0)
    turn = 2.0 * math.pi / _PHASES * np.arange(_PHASES)
    ways = np.stack([np.cos(turn), np.sin(turn)])
    along = np.stack([numbers @ precision @ ways for numbers, precision in told])
    square = np.stack([np.sum(ways * (precision @ ways), axis=0) for _, precision in told])

    def gained(amplitude: float) -> float:
        likely = amplitude * along - 0.5 * amplitude**2 * square
        return 2.0 * float(np.sum(special.logsumexp(likely, axis=1) - math.log(_PHASES)))

    most = _FARTHEST * float(np.max(np.sqrt(gains / np.mean(square, axis=1))))
    found = optimize.minimize_scalar(
        lambda share: -gained(share * most), bounds=(0.0, 1.0), method='bounded'
    )
    value = most * float(found.x)
    gain = gained(value)
    if gain <= 0.0:
        return HumAmplitude(0.0, math.nan, 0.0, float(np.sum(gains)))
    step = _STEP / math.sqrt(float(np.sum(np.mean(square, axis=1))))
    bend = (2.0 * gain - gained(value + step) - gained(value - step)) / step**2
    std = math.sqrt(2.0 / bend) if bend > 0.0 else math.nan
    return HumAmplitude(value, std, gain, float(np.sum(gains)) - gain)
