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
    weights = np.array([0.5 * float(np.trace(precision)) for _, precision in told])
    if not np.any(gains > 0.0):
        return HumAmplitude(0.0, math.nan, 0.0, 0.0)
    most = _FARTHEST * math.sqrt(float(np.max(gains / weights)))
    reach, weight = most * np.sqrt(weights * gains), most**2 * float(np.sum(weights))

    def lost(share: float) -> float:
        along = share * reach
        together = np.log(special.i0e(along)) + along
        return weight * share**2 - 2.0 * float(np.sum(together))

    found = optimize.minimize_scalar(lost, bounds=(0.0, 1.0), method='bounded')
    share, gain = float(found.x), max(0.0, -float(found.fun))
    along = share * reach
    turned = special.i1e(along) / special.i0e(along)
    over = np.divide(turned, along, out=np.full(along.size, 0.5), where=along > 0.0)
    curvature = weight - float(np.sum(reach**2 * (1.0 - over - turned**2)))
    value = most * share
    std = most / math.sqrt(curvature) if curvature > 0.0 else math.nan
    return HumAmplitude(value, std, gain, float(np.sum(gains)) - gain)
