"""What the spectrum says beside the fit: peak, half-power damping, bandwidth.

The spectrum of a record of T seconds cannot tell frequencies closer than 1/T apart, and its
peak is never narrower than the record's own; both stand in the uncertainties and in the
correction of the half-power width.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from impactscope.errors import EstimationError, InputError
from impactscope.estimate import free_oscillation as model
from impactscope.records import Estimate

__all__ = ['SpectralEstimate', 'bandwidth', 'estimate_from_spectrum']

Array = NDArray[np.float64]

BARE_HALF_WIDTH = 2.7831145672  # half width at half power, times T, of a record without decay
UNIFORM = math.sqrt(12.0)  # a uniform distribution's width over its standard deviation


@dataclass(frozen=True, slots=True)
class SpectralEstimate:
    """Peak of the amplitude spectrum of one span."""

    frequency: Estimate  # Hz, of the peak: the damped frequency, about
    damping_ratio: Estimate  # half-power, the record's length taken out; NaN if not resolved
    resolution: float  # Hz: one over the record's length
    half_power_width: float  # Hz, as it stands in the spectrum


def estimate_from_spectrum(values: ArrayLike, sample_rate: float) -> SpectralEstimate:
    """Peak and half-power damping of samples of free vibration.

    Args:
        values: Shape (n_samples,), beginning after contact.
        sample_rate: Hz.

    Raises:
        InputError: values that are not a finite vector, or a rate that is not positive.
        EstimationError: no peak, or one that does not fall to half its power.
    """
    y, _ = model.centred(values, sample_rate)
    # The mean of a decaying oscillation is not its offset; the end shows the offset better.
    y -= y[y.size // 2 :].mean()
    n = y.size
    duration = n / sample_rate
    padded = 2 << (n - 1).bit_length()
    transform = np.fft.rfft(y, padded)
    power = transform.real**2 + transform.imag**2
    first = max(1, round(padded / n))  # one period in the record
    if power.size - first < 3 or not power[first:].max() > 0.0:
        raise EstimationError('the spectrum has no peak: the span does not vary')
    peak = first + int(np.argmax(power[first:]))
    unit = 2.0 * math.pi / padded
    angle, height = _refine_peak(y, peak * unit, unit)
    left, right = _half_power(y, angle, height, -unit), _half_power(y, angle, height, unit)
    if math.isnan(left) or math.isnan(right):
        raise EstimationError(
            f'the peak at {angle * sample_rate / model.TWO_PI:.3g} Hz does not fall to half power'
        )
    half_width = 0.5 * (right - left) * sample_rate  # rad/s
    # Level of the noise around the peak: the median, exponentially distributed.
    floor = float(np.median(power[min(3 * peak, power.size // 2) :])) / math.log(2.0)
    # The noise may have raised any of the lines that are lower by no more than its own size.
    as_high = first + np.flatnonzero(
        np.sqrt(power[first:]) >= math.sqrt(height) - math.sqrt(floor)
    )
    as_high = np.append(as_high, peak)
    noise = float(as_high.max() - as_high.min()) * unit * sample_rate / UNIFORM
    noise = max(noise, half_width * math.sqrt(0.5 * floor / height))
    asymmetry = 0.5 * abs((right - angle) - (angle - left)) * sample_rate
    resolution = 1.0 / duration
    # The peak is drawn aside by its image at the negative frequency.
    image = half_width * 0.25 * half_width / (angle * sample_rate)
    u_peak = math.hypot(model.TWO_PI * resolution / UNIFORM, noise, asymmetry, image)
    frequency = angle * sample_rate / model.TWO_PI
    return SpectralEstimate(
        frequency=Estimate(frequency, u_peak / model.TWO_PI),
        damping_ratio=_damping(half_width, u_peak, duration, angle * sample_rate),
        resolution=resolution,
        half_power_width=2.0 * half_width / model.TWO_PI,
    )


def bandwidth(
    natural_frequency: Estimate, damping_ratio: Estimate, covariance: float = 0.0
) -> Estimate:
    """-3 dB bandwidth in Hz of the force sensor, eq. 28.

    ``covariance`` is that of frequency (Hz) and damping ratio. Raises InputError for a
    negative frequency or damping ratio.
    """
    fn, zeta = natural_frequency.value, damping_ratio.value
    if fn < 0.0 or zeta < 0.0:
        raise InputError(f'natural frequency {fn!r} Hz and damping ratio {zeta!r} must not be < 0')
    root = math.sqrt((2.0 * zeta**2 - 1.0) ** 2 + 1.0)
    factor = math.sqrt((1.0 - 2.0 * zeta**2) + root)
    by_zeta = fn * (-2.0 * zeta + 2.0 * zeta * (2.0 * zeta**2 - 1.0) / root) / factor
    variance = (
        (factor * natural_frequency.std) ** 2
        + (by_zeta * damping_ratio.std) ** 2
        + 2.0 * factor * by_zeta * covariance
    )
    return Estimate(
        fn * factor, math.sqrt(max(variance, 0.0)) if variance == variance else math.nan
    )


def _damping(half_width: float, uncertainty: float, duration: float, omega: float) -> Estimate:
    """Damping ratio from a half width at half power in rad/s, both of a record of T seconds."""

    def from_width(width: float) -> float:
        y = width * duration
        if y <= BARE_HALF_WIDTH:
            return 0.0
        return float(brentq(_half_power_excess, 1e-9, y + 1.0, args=(y,), xtol=1e-12)) / duration

    low, decay, high = (from_width(half_width + k * uncertainty) for k in (-1.0, 0.0, 1.0))
    if decay == 0.0:
        return Estimate()
    natural = math.hypot(decay, omega)
    # One-sided where the lower end is no longer resolved: the larger of both sides counts.
    return Estimate(decay / natural, max(high - decay, decay - low) / natural)


def _half_power_excess(x: float, y: float) -> float:
    """Power at y = width T over half the peak's, minus 1, for a record of decay x = sigma T."""
    e = math.exp(-x)
    peak = (math.expm1(-x) / x) ** 2
    return (1.0 - 2.0 * e * math.cos(y) + e * e) / (x * x + y * y) / (0.5 * peak) - 1.0


@njit(cache=True)  # type: ignore[untyped-decorator]
def _power(y: Array, angle: float) -> float:
    """|Fourier sum of y|² at an angle per sample in rad."""
    turn_re, turn_im = math.cos(angle), -math.sin(angle)
    re, im = 1.0, 0.0
    total_re = total_im = 0.0
    for i in range(y.size):
        total_re += y[i] * re
        total_im += y[i] * im
        re, im = re * turn_re - im * turn_im, re * turn_im + im * turn_re
    return total_re**2 + total_im**2


@njit(cache=True)  # type: ignore[untyped-decorator]
def _refine_peak(y: Array, angle: float, unit: float) -> tuple[float, float]:
    """(angle, power) of the largest power within one bin, by golden section."""
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    low, high = max(angle - unit, 0.0), min(angle + unit, math.pi)
    a, b = high - golden * (high - low), low + golden * (high - low)
    at_a, at_b = _power(y, a), _power(y, b)
    for _ in range(24):
        if at_a > at_b:
            high, b, at_b = b, a, at_a
            a = high - golden * (high - low)
            at_a = _power(y, a)
        else:
            low, a, at_a = a, b, at_b
            b = low + golden * (high - low)
            at_b = _power(y, b)
    middle = 0.5 * (low + high)
    return middle, _power(y, middle)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _half_power(y: Array, angle: float, height: float, step: float) -> float:
    """Angle at which the power has fallen to half, going by steps; NaN where it never does."""
    inner = angle
    outer = angle + step
    while _power(y, outer) > 0.5 * height:
        inner = outer
        outer += step
        if not 0.0 < outer < math.pi:
            return math.nan
    for _ in range(24):
        middle = 0.5 * (inner + outer)
        if _power(y, middle) > 0.5 * height:
            inner = middle
        else:
            outer = middle
    return 0.5 * (inner + outer)
