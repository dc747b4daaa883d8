"""Frequency and damping along the decay: the first sign that a linear model lacks physics.

Dry friction makes the damping ratio rise as the amplitude falls, quadratic damping makes it
fall, a hardening spring makes the frequency fall. One fit over the whole decay averages this
away and still reaches a high R².
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import EstimationError, InputError
from impactscope.estimate import free_oscillation as model
from impactscope.records import Estimate

__all__ = ['AmplitudeDependence', 'amplitude_dependence']

Array = NDArray[np.float64]

FEWEST_WINDOWS = 3
RELATIVE_NOISE = 0.1  # largest standard uncertainty of a window's amplitude over the amplitude
PERIODS = (2.0, 1.5, 1.0)  # lengths of windows that are tried


@dataclass(frozen=True, slots=True, eq=False)
class AmplitudeDependence:
    """Local estimates in consecutive windows, and their slopes over the amplitude's logarithm.

    Arrays have shape (n_windows,). A slope is the change while the amplitude grows e-fold.
    The p-values are the chance of so large a slope if the oscillation is linear.
    ``viscous_damping`` and ``linear_frequency`` extrapolate, by what varies as one over the
    amplitude (dry friction) and by what varies as the amplitude (quadratic damping).
    ``small_amplitude_frequency`` extrapolates by the amplitude's square, as the frequency of
    every smooth spring that is alike to both sides varies (hardening, softening, a pendulum).
    """

    time: Array  # s after the first sample, middle of the window
    amplitude: Array  # unit of the values, at that time
    frequency: Array  # Hz, natural
    frequency_std: Array
    damping_ratio: Array
    damping_ratio_std: Array
    viscous_damping: tuple[float, float]  # damping ratio left at large, at small amplitude
    linear_frequency: tuple[float, float]  # Hz, likewise
    small_amplitude_frequency: Estimate  # Hz, natural
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
    periods: float | None = None,
) -> AmplitudeDependence:
    """Fit eq. 27 in consecutive windows of a free oscillation.

    Args:
        values: Shape (n_samples,), free vibration from the first sample.
        sample_rate: Hz.
        fit: The fit of the same samples, where there is one already.
        periods: Length of a window in damped periods, at least 1; the longest of 2, 1.5 and 1
            that leaves three windows where not given.

    Raises:
        InputError: values that are not a finite vector, or windows below one period.
        EstimationError: fewer than three windows stand clear of the noise.
    """
    if periods is not None and not periods >= 1.0:
        raise InputError(f'a window of {periods!r} periods is too short; 1 is the least')
    y = np.array(values, dtype=np.float64)
    if fit is None:
        fit = model.fit_free_oscillation(y, sample_rate)
    windows = _Windows()
    for length in PERIODS if periods is None else (periods,):
        windows = _fit_windows(y, fit, length)
        if len(windows.rows) >= FEWEST_WINDOWS:
            break
    else:
        raise EstimationError(
            f'{len(windows.rows)} windows of the decay stand clear of the noise; '
            f'{FEWEST_WINDOWS} are needed to see whether damping depends on amplitude'
        )
    time, amplitudes, frequency, frequency_std, damping, damping_std = np.array(windows.rows).T
    # A window of few samples knows its own noise badly; all together know it well.
    noise = math.sqrt(windows.rss / windows.dof)
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
        viscous_damping=_limits(amplitudes, damping, damping_std),
        linear_frequency=_limits(amplitudes, frequency, frequency_std),
        small_amplitude_frequency=_small_limit(amplitudes, frequency, frequency_std),
        frequency_slope=frequency_slope,
        damping_slope=damping_slope,
        frequency_p=_two_sided(frequency_slope),
        damping_p=_two_sided(damping_slope),
    )


@dataclass(slots=True)
class _Windows:
    """Local fits: time, amplitude, frequency, its std, damping ratio, its std (noise of 1)."""

    rows: list[tuple[float, ...]] = field(default_factory=list)
    rss: float = 0.0
    dof: int = 0


def _fit_windows(y: Array, fit: model.FreeOscillationFit, periods: float) -> _Windows:
    """Fits of consecutive windows until one does not stand clear of the noise."""
    rate = fit.sample_rate
    size = max(math.ceil(periods * rate / fit.damped_frequency.value), model.FEWEST_SAMPLES)
    start = (fit.damped_frequency.value, fit.decay_rate.value)
    windows = _Windows()
    for first in range(0, y.size - size + 1, size):
        part, _ = model.centred(y[first : first + size], rate)
        try:
            found = model.solve(part, model.in_span_units(start, size, rate))
        except EstimationError:
            break
        amplitude = math.hypot(float(found.linear[0]), float(found.linear[1]))
        amplitude *= math.exp(-0.5 * found.s)
        local = model.describe(found, 0.0, rate)
        noise = max(local.noise_std, math.sqrt(windows.rss / max(windows.dof, 1)))
        if amplitude * RELATIVE_NOISE < noise * math.sqrt(2.0 / size):
            break
        unit = local.noise_std * local.inflation
        windows.rows.append(
            (
                (first + 0.5 * size) / rate,
                amplitude,
                local.natural_frequency.value,
                local.natural_frequency.std / unit if unit > 0.0 else 0.0,
                local.damping_ratio.value,
                local.damping_ratio.std / unit if unit > 0.0 else 0.0,
            )
        )
        windows.rss += found.rss
        windows.dof += size - model.PARAMETERS
    return windows


def _slope(x: Array, y: Array, std: Array) -> Estimate:
    """Weighted straight line's slope; its uncertainty follows from the points' own."""
    weight = 1.0 / std**2
    centre = float(np.sum(weight * x) / np.sum(weight))
    spread = float(np.sum(weight * (x - centre) ** 2))
    if spread <= 0.0:
        return Estimate(0.0, math.inf)
    return Estimate(float(np.sum(weight * (x - centre) * y)) / spread, 1.0 / math.sqrt(spread))


def _limits(amplitude: Array, y: Array, std: Array) -> tuple[float, float]:
    """Value at large amplitude by a line over 1/amplitude, at small by one over amplitude."""
    relative = amplitude / amplitude[0]
    return _at_zero(1.0 / relative, y, std), _at_zero(relative, y, std)


def _small_limit(amplitude: Array, y: Array, std: Array) -> Estimate:
    """Value at zero by a weighted line over the squared amplitude, widened where it bends."""
    x = (amplitude / amplitude[0]) ** 2
    slope = _slope(x, y, std)
    if not math.isfinite(slope.std):
        return Estimate()
    value = _at_zero(x, y, std)
    weight = 1.0 / std**2
    lever = float(np.sum(weight * x) / np.sum(weight))
    bend = float(np.sum(weight * (y - value - slope.value * x) ** 2)) / (x.size - 2)
    spread = math.hypot(1.0 / math.sqrt(float(np.sum(weight))), lever * slope.std)
    return Estimate(value, spread * math.sqrt(max(1.0, bend)))


def _at_zero(x: Array, y: Array, std: Array) -> float:
    """Weighted straight line's value at x = 0."""
    weight = 1.0 / std**2
    mean_y = float(np.sum(weight * y) / np.sum(weight))
    return mean_y - _slope(x, y, std).value * float(np.sum(weight * x) / np.sum(weight))


def _two_sided(estimate: Estimate) -> float:
    """Chance of a normal value as far from zero as this."""
    return math.erfc(abs(estimate.value) / estimate.std / math.sqrt(2.0))
