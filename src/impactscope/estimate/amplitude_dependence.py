"""Frequency and damping along the decay: the first sign that a linear model lacks physics.

Dry friction makes the damping ratio rise as the amplitude falls, quadratic damping makes it
fall, a hardening spring makes the frequency fall. One fit over the whole decay averages this
away and still reaches a high R².
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import EstimationError
from impactscope.estimate import free_oscillation as model
from impactscope.records import Estimate

__all__ = ['AmplitudeDependence', 'amplitude_dependence']

Array = NDArray[np.float64]

FEWEST_WINDOWS = 3
RELATIVE_NOISE = 0.1  # largest standard uncertainty of a window's amplitude over the amplitude
PARAMETERS = model.PARAMETERS


@dataclass(frozen=True, slots=True, eq=False)
class AmplitudeDependence:
    """Local estimates in consecutive windows, and their slopes over the amplitude's logarithm.

    Arrays have shape (n_windows,). A slope is the change while the amplitude grows e-fold.
    The p-values are the chance of so large a slope if the oscillation is linear.
    """

    time: Array  # s after the first sample, middle of the window
    amplitude: Array  # unit of the values, at that time
    frequency: Array  # Hz, natural
    frequency_std: Array
    damping_ratio: Array
    damping_ratio_std: Array
    frequency_slope: Estimate  # Hz
    damping_slope: Estimate
    frequency_p: float
    damping_p: float

    @property
    def p_value(self) -> float:
        """Of the more telling slope, corrected for having looked at two."""
        return min(1.0, 2.0 * min(self.frequency_p, self.damping_p))


def amplitude_dependence(
    values: ArrayLike,
    sample_rate: float,
    *,
    fit: model.FreeOscillationFit | None = None,
    periods: float = 2.0,
) -> AmplitudeDependence:
    """Fit eq. 27 in consecutive windows of a free oscillation.

    Args:
        values: Shape (n_samples,), free vibration from the first sample.
        sample_rate: Hz.
        fit: The fit of the same samples, where there is one already.
        periods: Length of a window in damped periods; at least 1.5.

    Raises:
        InputError: values that are not a finite vector.
        EstimationError: fewer than three windows stand clear of the noise.
    """
    if not periods >= 1.5:
        raise EstimationError(f'a window of {periods!r} periods is too short; 1.5 are needed')
    y = np.array(values, dtype=np.float64)
    if fit is None:
        fit = model.fit_free_oscillation(y, sample_rate)
    size = max(math.ceil(periods * sample_rate / fit.damped_frequency.value), 12)
    rows: list[tuple[float, ...]] = []
    rss, dof = 0.0, 0
    start = (fit.damped_frequency.value, fit.decay_rate.value)
    for first in range(0, y.size - size + 1, size):
        part, _ = model.centred(y[first : first + size], sample_rate)
        try:
            found = model.solve(part, model.in_span_units(start, size, sample_rate))
        except EstimationError:
            break
        half = math.exp(-0.5 * found.s)
        amplitude = half * math.hypot(float(found.linear[0]), float(found.linear[1]))
        if amplitude * RELATIVE_NOISE < fit.noise_std * math.sqrt(2.0 / size):
            break
        local = model.describe(found, 0.0, sample_rate)
        unit = local.noise_std * local.inflation
        rows.append(
            (
                (first + 0.5 * size) / sample_rate,
                amplitude,
                local.natural_frequency.value,
                local.natural_frequency.std / unit if unit > 0.0 else 0.0,
                local.damping_ratio.value,
                local.damping_ratio.std / unit if unit > 0.0 else 0.0,
            )
        )
        rss += found.rss
        dof += size - PARAMETERS
    if len(rows) < FEWEST_WINDOWS:
        raise EstimationError(
            f'{len(rows)} windows of {periods:g} periods stand clear of the noise; '
            f'{FEWEST_WINDOWS} are needed to see whether damping depends on amplitude'
        )
    time, amplitudes, frequency, frequency_std, damping, damping_std = np.array(rows).T
    # A window of few samples knows its own noise badly; all together know it well.
    noise = math.sqrt(rss / dof)
    frequency_std = np.maximum(frequency_std * noise, 1e-15 * frequency)
    damping_std = np.maximum(damping_std * noise, 1e-15)
    log_amplitude = np.log(amplitudes / amplitudes[0])
    frequency_slope = _slope(log_amplitude, frequency, frequency_std)
    damping_slope = _slope(log_amplitude, damping, damping_std)
    return AmplitudeDependence(
        time=time,
        amplitude=amplitudes,
        frequency=frequency,
        frequency_std=frequency_std,
        damping_ratio=damping,
        damping_ratio_std=damping_std,
        frequency_slope=frequency_slope,
        damping_slope=damping_slope,
        frequency_p=_two_sided(frequency_slope),
        damping_p=_two_sided(damping_slope),
    )


def _slope(x: Array, y: Array, std: Array) -> Estimate:
    """Weighted straight line's slope; its uncertainty follows from the points' own."""
    weight = 1.0 / std**2
    centre = float(np.sum(weight * x) / np.sum(weight))
    spread = float(np.sum(weight * (x - centre) ** 2))
    if spread <= 0.0:
        return Estimate(0.0, math.inf)
    return Estimate(float(np.sum(weight * (x - centre) * y)) / spread, 1.0 / math.sqrt(spread))


def _two_sided(estimate: Estimate) -> float:
    """Chance of a normal value as far from zero as this."""
    return math.erfc(abs(estimate.value) / estimate.std / math.sqrt(2.0))
