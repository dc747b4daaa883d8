"""What several blows tell of one sensor together, blow by blow.

The weighted mean of frequency and damping ratio is, to first order, the joint fit of all blows
(:func:`impactscope.estimate.joint_oscillation.fit_jointly`), but needs no samples; so it grows
with the campaign, live as offline. Two tests say whether there is one sensor to speak of:
the scatter between blows (Birge's ratio), and a trend with how hard the plate was hit.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from impactscope.estimate.sensor_parameters import moving_mass
from impactscope.records import Estimate, SensorParameters, SensorSummary

__all__ = ['RepeatedBlows', 'summarise_blows']

Array = NDArray[np.float64]

REMEMBERED = 64  # blows
FEWEST_BLOWS = 2
FEWEST_FOR_TREND = 3
LEAST_SPREAD = 0.1  # of the amplitude's logarithm, from which a trend can show
SCATTER_LIMIT = 0.01  # p-value of the scatter below which the uncertainties grow by Birge's ratio


class RepeatedBlows:
    """Stage: sensor parameters in, their summary out, from the second blow that tells them on."""

    def __init__(self) -> None:
        self._blows: deque[SensorParameters] = deque(maxlen=REMEMBERED)

    def push(self, record: SensorParameters) -> list[SensorSummary]:
        """Take one blow into account; one summary, or none where it tells nothing new."""
        if not record.valid:
            return []
        if self._blows and self._blows[-1].channel != record.channel:
            self._blows.clear()
        self._blows.append(record)
        return [summarise_blows(self._blows)] if len(self._blows) >= FEWEST_BLOWS else []

    def flush(self) -> list[SensorSummary]:
        """Nothing is ever open; the blows are forgotten."""
        self._blows.clear()
        return []


def summarise_blows(blows: Sequence[SensorParameters]) -> SensorSummary:
    """The summary of valid blows on one channel, in order of time; at least one."""
    latest = blows[-1]
    frequency = np.array([blow.natural_frequency for blow in blows])
    damping = np.array([blow.damping_ratio for blow in blows])
    scatter = [_scatter(values) for values in (frequency, damping)]
    degrees = len(blows) - 1
    p_value = float(chdtrc(2 * degrees, sum(scatter))) if degrees else math.nan
    wider = 1.0
    if p_value < SCATTER_LIMIT:
        wider = math.sqrt(max(*scatter, degrees) / degrees)
    natural = _mean(frequency, wider)
    slopes = _slopes(blows, frequency, damping)
    chances = [_two_sided(slope) for slope in slopes]
    return SensorSummary(
        stamp_ns=latest.stamp_ns,
        event_ids=tuple(blow.event_id for blow in blows),
        channel=latest.channel,
        natural_frequency=natural,
        damping_ratio=_mean(damping, wider),
        moving_mass=moving_mass(latest.stiffness, natural),
        scatter_p_value=p_value,
        frequency_slope=slopes[0],
        damping_slope=slopes[1],
        linearity_p_value=float(np.minimum(1.0, 2.0 * np.min(chances))),  # NaN stays NaN
    )


def _weights(values: Array) -> Array:
    """One over the variances of rows (value, standard uncertainty); rounding is no scatter."""
    return np.asarray(1.0 / np.maximum(values[:, 1], 1e-12 * np.abs(values[:, 0])) ** 2)


def _mean(values: Array, wider: float) -> Estimate:
    weight = _weights(values)
    total = float(weight.sum())
    return Estimate(float(weight @ values[:, 0]) / total, wider / math.sqrt(total))


def _scatter(values: Array) -> float:
    """Chi-squared of the values about their mean."""
    return float(_weights(values) @ (values[:, 0] - _mean(values, 1.0).value) ** 2)


def _slopes(
    blows: Sequence[SensorParameters], frequency: Array, damping: Array
) -> tuple[Estimate, Estimate]:
    """Slopes over the amplitude's logarithm; NaN where all blows were about as strong."""
    strength = np.log([blow.amplitude.value for blow in blows])
    if len(blows) < FEWEST_FOR_TREND or not np.ptp(strength) >= LEAST_SPREAD:
        return Estimate(), Estimate()
    return _slope(strength, frequency), _slope(strength, damping)


def _slope(x: Array, values: Array) -> Estimate:
    weight = _weights(values)
    centred = x - float(weight @ x) / float(weight.sum())
    spread = float(weight @ centred**2)
    return Estimate(float((weight * centred) @ values[:, 0]) / spread, 1.0 / math.sqrt(spread))


def _two_sided(slope: Estimate) -> float:
    """Chance of a slope as far from zero where there is none; NaN where it is not known."""
    return math.erfc(abs(slope.value) / slope.std / math.sqrt(2.0))
