"""The contact force behind a reading: with the plate's accelerometer, or by inversion.

The sensor reads f_o = k x; the force at its plate is f_i = f_o + m a + c v (eq. 7 of Samarathunga
et al., Machines 2024, 12, 26). With an accelerometer on the plate this is a sum. Without one,
eq. 24 has to be inverted, which amplifies noise: a Kalman smoother does it under the prior that
the force is zero out of contact and that its rate wanders in contact; how much it wanders is
found from the data by maximum likelihood. Positive is into the sensor, for force and plate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import next_fast_len
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from impactscope.errors import EstimationError, InputError
from impactscope.estimate.contact_smoother import filter_reading, smooth_reading, transition
from impactscope.records import Estimate

__all__ = [
    'ContactForce',
    'Peak',
    'contact_force_by_inversion',
    'contact_force_from_acceleration',
    'find_peak',
    'plate_velocity',
]

Array = NDArray[np.float64]

_CREST = 0.9  # share of the peak above which samples enter its parabola
_CREST_BIAS = 1.5e-4  # of the peak: a sine's crest is no parabola
_FEWEST_CREST_SAMPLES = 7
_KERNEL = 2.8  # full width at half maximum of the smoother's kernel, in 1/w_c
_LEAST_RESOLVED = 1.55  # widths of that kernel: a needle comes out 1.4 wide
_ENOUGH_RATE = 10_000.0  # Hz, at which a reading is inverted, or less
_STRETCH = 15  # samples over which surprises are averaged
_USUAL_SURPRISE = 3.2  # the largest such average in a thousand samples of noise, about


@dataclass(frozen=True, slots=True)
class Peak:
    """Where a signal is largest."""

    value: Estimate
    time: Estimate  # s after the first sample


@dataclass(frozen=True, slots=True, eq=False)
class ContactForce:
    """A reconstructed contact force; arrays of shape (n_samples,), N."""

    force: Array
    std: Array  # standard uncertainty of each sample
    method: str
    peak: Peak
    reading_error: Estimate  # (peak of the reading - peak of the contact force) / the latter


def find_peak(values: ArrayLike, sample_rate: float, noise_std: float) -> Peak:
    """Peak of a signal by a parabola through its crest, so that noise does not lift it.

    ``values`` has shape (n_samples,), ``noise_std`` is white noise of the same unit. Where the
    crest is too short for a parabola, the largest sample stands, uncertain by noise and by half
    a sample of time. Raises InputError for an empty signal or one that is not finite.
    """
    y = np.asarray(values, np.float64)
    if y.ndim != 1 or y.size == 0 or not np.isfinite(y).all():
        raise InputError(f'peak: values of shape {y.shape} must be 1-D, finite and not empty')
    top = int(np.argmax(y))
    below = y < _CREST * y[top] - 3 * noise_std
    left = int(np.flatnonzero(below[:top])[-1]) + 1 if below[:top].any() else 0
    right = top + int(np.argmax(below[top:])) if below[top:].any() else y.size
    half = min(top - left, right - 1 - top)  # symmetric, lest a steep flank tilts the parabola
    lo, hi = top - half, top + half + 1
    if hi - lo < _FEWEST_CREST_SAMPLES or y[top] <= 0:
        return Peak(
            Estimate(float(y[top]), noise_std), Estimate(top / sample_rate, 0.5 / sample_rate)
        )
    t = (np.arange(lo, hi) - top) / sample_rate
    scale = t[-1]
    design = np.vander(t / scale, 3, increasing=True)
    coefficients, *_ = np.linalg.lstsq(design, y[lo:hi], rcond=None)
    residual = y[lo:hi] - design @ coefficients
    sigma = max(noise_std, float(np.sqrt(residual @ residual / (t.size - 3))))
    covariance = sigma**2 * np.linalg.inv(design.T @ design)
    _, b1, b2 = coefficients
    turn = float(np.clip(-b1 / (2 * b2), -1, 1)) if b2 < 0 else 0.0
    gradient = np.array([1.0, turn, turn**2])
    height_std = math.hypot(
        math.sqrt(gradient @ covariance @ gradient), _CREST_BIAS * float(y[top])
    )
    time_std = scale
    if b2 < 0:
        slope = np.array([0.0, -1 / (2 * b2), b1 / (2 * b2**2)])
        time_std = min(scale, scale * math.sqrt(slope @ covariance @ slope))
    return Peak(
        Estimate(float(gradient @ coefficients), height_std),
        Estimate(top / sample_rate + turn * scale, max(time_std, 0.1 / sample_rate)),
    )


def plate_velocity(
    displacement: ArrayLike,
    acceleration: ArrayLike,
    sample_rate: float,
    displacement_noise: float,
    acceleration_noise: float,
) -> tuple[Array, float]:
    """Velocity, m/s, and the standard deviation of its noise, from both signals at once.

    Slow parts come from the displacement's derivative, quick ones from the acceleration's
    integral, each frequency by the noise of the two: no drift, little noise. Both signals have
    shape (n_samples,), m and m/s²; noise densities (one-sided) are in m/sqrt(Hz) and
    m/s²/sqrt(Hz). The ends are taken as momentarily at rest.
    """
    x, a = np.asarray(displacement, np.float64), np.asarray(acceleration, np.float64)
    n = next_fast_len(x.size, real=True)
    x, a = (np.pad(y, (0, n - y.size), 'edge') for y in (x, a))
    w = 2 * np.pi * np.fft.rfftfreq(2 * n, 1 / sample_rate)
    by_displacement = acceleration_noise**2 / (
        acceleration_noise**2 + w**4 * displacement_noise**2
    )
    safe = np.where(w > 0, w, 1.0)
    by_acceleration = np.where(w > 0, (1 - by_displacement) / safe, 0.0)
    spectrum = 1j * w * by_displacement * np.fft.rfft(np.concatenate((x, x[::-1])))
    spectrum -= 1j * by_acceleration * np.fft.rfft(np.concatenate((a, a[::-1])))
    density = (w * by_displacement * displacement_noise) ** 2
    density += (by_acceleration * acceleration_noise) ** 2
    std = math.sqrt(float(density.sum()) * sample_rate / (2 * n))
    return np.fft.irfft(spectrum, 2 * n)[: np.size(displacement)], std


def contact_force_from_acceleration(
    force: ArrayLike,
    acceleration: ArrayLike,
    sample_rate: float,
    *,
    mass: Estimate,
    damping_constant: Estimate,
    stiffness: float,
    force_noise: float,
    acceleration_noise: float,
    force_bandwidth: float = math.inf,
    acceleration_bandwidth: float = math.inf,
    acceleration_uncertainty: float = 0.0,
) -> ContactForce:
    """f_i = f_o + m a + c v, with its uncertainty band.

    ``force`` N and ``acceleration`` of the plate m/s² have shape (n_samples,) on one grid, zero
    levels removed, at rest at both ends. ``mass`` kg, ``damping_constant`` N s/m and
    ``stiffness`` N/m are the sensor's; noises are standard deviations of the samples, white up
    to the bandwidths (Hz; the Nyquist frequency at most); ``acceleration_uncertainty`` is the
    relative standard uncertainty of that channel's gain. The stiffness serves the small
    damping term only. Raises InputError on shapes and values that are not finite.
    """
    f, a = _checked(force, sample_rate), _checked(acceleration, sample_rate)
    if f.shape != a.shape:
        raise InputError(f'contact force: force {f.shape} and acceleration {a.shape} differ')
    for name, value in (
        ('mass', mass.value),
        ('damping constant', damping_constant.value),
        ('stiffness', stiffness),
    ):
        if not (math.isfinite(value) and value >= 0) or (
            value == 0 and name != 'damping constant'
        ):
            raise InputError(f'contact force: the {name} is {value!r}; it must be above zero')
    nyquist = sample_rate / 2
    sigma_f, sigma_a = max(force_noise, 1e-9), max(acceleration_noise, 1e-9)
    velocity, velocity_std = plate_velocity(
        f / stiffness,
        a,
        sample_rate,
        sigma_f / stiffness / math.sqrt(min(nyquist, force_bandwidth)),
        sigma_a / math.sqrt(min(nyquist, acceleration_bandwidth)),
    )
    m, c = mass.value, damping_constant.value
    contact = f + m * a + c * velocity
    noise = math.sqrt(force_noise**2 + (m * acceleration_noise) ** 2 + (c * velocity_std) ** 2)
    mass_std = math.hypot(_known(mass.std), m * acceleration_uncertainty)
    systematic = np.hypot(mass_std * a, _known(damping_constant.std) * velocity)
    # Interpolated channels have noise that goes together from sample to sample: a parabola
    # averages as much of it as if it were this white noise.
    white = math.hypot(
        force_noise * math.sqrt(max(1.0, nyquist / force_bandwidth)),
        m * acceleration_noise * math.sqrt(max(1.0, nyquist / acceleration_bandwidth)),
    )
    std = np.hypot(noise, systematic)
    crest = find_peak(contact, sample_rate, white)
    at = min(round(crest.time.value * sample_rate), contact.size - 1)
    peak = Peak(
        Estimate(crest.value.value, math.hypot(crest.value.std, systematic[at])), crest.time
    )
    return _result(f, contact, std, peak, force_noise, sample_rate, 'accelerometer')


def contact_force_by_inversion(
    force: ArrayLike,
    sample_rate: float,
    *,
    natural_frequency: Estimate,
    damping_ratio: Estimate,
    force_noise: float,
    spans: tuple[tuple[float, float], ...] = (),
) -> ContactForce:
    """Regularised inversion of eq. 24, where the plate has no accelerometer.

    ``force`` N has shape (n_samples,), zero level removed, at rest at its beginning, with white
    noise of standard deviation ``force_noise``; ``natural_frequency`` (undamped) in Hz. Contact
    is possible in ``spans`` (start and end, s after the first sample; all of the record where
    empty); outside the force is zero, which is what makes the answer firm. The band holds
    noise, what the smoothing may have lost, the sensor's uncertainty and any misfit. Raises
    EstimationError where the reading is lost in noise or the blow too short to be resolved,
    InputError on shapes and values.
    """
    f = _checked(force, sample_rate)
    w, zeta = 2 * math.pi * natural_frequency.value, damping_ratio.value
    if not (math.isfinite(w) and w > 0 and math.isfinite(zeta) and zeta >= 0):
        raise InputError(
            f'contact force: natural frequency {natural_frequency.value!r} Hz and damping ratio '
            f'{zeta!r} must be known'
        )
    if not (math.isfinite(force_noise) and force_noise > 0):
        raise InputError(f'contact force: noise {force_noise!r} N must be above zero')
    if np.abs(f).max() < 5 * force_noise:
        raise EstimationError(
            f'contact force: the reading does not rise above its noise of {force_noise:.3g} N'
        )
    together = int(sample_rate // _ENOUGH_RATE)
    if together > 1:
        # The plate passes nothing that is that quick: means of a few samples say the same.
        kept = f.size - f.size % together
        later = 0.5 * (together - 1) / sample_rate  # a mean stands in the middle of its samples
        coarse = contact_force_by_inversion(
            f[:kept].reshape(-1, together).mean(axis=1),
            sample_rate / together,
            natural_frequency=natural_frequency,
            damping_ratio=damping_ratio,
            force_noise=force_noise / math.sqrt(together),
            spans=tuple((start - later, end - later) for start, end in spans),
        )
        return _refined(coarse, f.size, sample_rate, together, later)
    touching = np.zeros(f.size, np.bool_)
    time = np.arange(f.size) / sample_rate
    for start, end in spans or ((0.0, math.inf),):
        touching |= (time >= start) & (time <= end)
    if not touching.any():
        raise InputError(f'contact force: no sample lies in the spans {spans!r} s')
    step, unit_noise = transition(w, zeta, 1 / sample_rate)
    size = float(np.abs(f).max())
    duration = max(float(touching.sum()), 4.0) / sample_rate
    unit = size**2 / duration**3
    # The rate with which force may set in: all of it within a twentieth of the natural period.
    onset = (size * w * 20 / (2 * math.pi)) ** 2

    def misfit(exponent: float) -> float:
        noise = 10.0**exponent * unit * unit_noise
        return float(filter_reading(f, touching, step, noise, force_noise**2, onset)[0])

    grid = np.arange(-3.0, 8.5, 1.0)
    costs = [misfit(e) for e in grid]
    i = int(np.argmin(costs))
    best = minimize_scalar(
        misfit, bounds=(grid[i] - 1, grid[i] + 1), method='bounded', options={'xatol': 0.05}
    )
    noise = 10.0**best.x * unit * unit_noise
    states, variances = smooth_reading(f, touching, step, noise, force_noise**2, onset)
    _, _, _, innovations, spreads = filter_reading(f, touching, step, noise, force_noise**2, onset)
    # A sensor that is not the assumed one, or a blow too short for the prior, shows as
    # surprises beyond the noise, however few: widen the band by the worst stretch of them.
    surprises = np.convolve(innovations**2 / spreads, np.ones(_STRETCH) / _STRETCH, 'same')
    variances *= max(1.0, float(surprises.max()) / _USUAL_SURPRISE)
    contact = states[:, 2]
    # Where wanderings of the force reach the reading no stronger than its noise, the prior rules:
    # wander/w_c^4 (w/w_c)^4 = noise²/rate. A pulse hardly wider than that is not resolved.
    wander = 10.0**best.x * unit
    finest = _KERNEL / (wander * w**4 * sample_rate / force_noise**2) ** 0.125
    if _half_width(contact) / sample_rate < _LEAST_RESOLVED * finest:
        raise EstimationError(
            f'contact force: the blow is too short for a resolution of {1e3 * finest:.2g} ms, '
            'which is all that the noise allows'
        )
    # f_i - f_o = f_o''/w² + 2 zeta f_o'/w: how the sensor's uncertainty enters.
    damping = 2 * zeta * states[:, 1]
    inertia = contact - states[:, 0] - damping
    by_frequency = (
        _known(natural_frequency.std) / natural_frequency.value * (2 * inertia + damping)
    )
    by_damping = 2 * _known(damping_ratio.std) * states[:, 1]
    std = np.sqrt(np.maximum(variances, 0.0) + by_frequency**2 + by_damping**2)
    crest = find_peak(contact, sample_rate, 0.0)
    at = min(round(crest.time.value * sample_rate), contact.size - 1)
    # Neighbouring errors go together here: a parabola averages nothing.
    peak = Peak(Estimate(crest.value.value, float(std[at])), crest.time)
    return _result(f, contact, std, peak, force_noise, sample_rate, 'inversion')


def _refined(
    coarse: ContactForce, samples: int, sample_rate: float, together: int, later: float
) -> ContactForce:
    """A force found from means of samples, at the samples."""
    at = later + np.arange(coarse.force.size) * (together / sample_rate)
    time = np.clip(np.arange(samples) / sample_rate, at[0], at[-1])
    crest = coarse.peak
    return replace(
        coarse,
        force=CubicSpline(at, coarse.force)(time),
        std=np.interp(time, at, coarse.std),
        peak=replace(crest, time=Estimate(crest.time.value + later, crest.time.std)),
    )


def _result(
    reading: Array,
    contact: Array,
    std: Array,
    peak: Peak,
    reading_noise: float,
    sample_rate: float,
    method: str,
) -> ContactForce:
    read = find_peak(reading, sample_rate, reading_noise).value
    error = Estimate()
    if peak.value.value > 0 and read.value > 0:
        ratio = read.value / peak.value.value
        spread = math.hypot(read.std / read.value, peak.value.std / peak.value.value)
        error = Estimate(ratio - 1, ratio * spread)
    return ContactForce(contact, std, method, peak, error)


def _checked(values: ArrayLike, sample_rate: float) -> Array:
    y = np.ascontiguousarray(values, np.float64)
    if y.ndim != 1 or y.size < 4 or not np.isfinite(y).all():
        raise InputError(
            f'contact force: samples of shape {y.shape} must be 1-D, at least 4, and finite'
        )
    if not (math.isfinite(sample_rate) and sample_rate > 0):
        raise InputError(f'contact force: sample rate {sample_rate!r} Hz must be above zero')
    return y


def _known(std: float) -> float:
    return std if math.isfinite(std) else 0.0


def _half_width(contact: Array) -> int:
    """Samples around the peak that exceed half of it."""
    top = int(np.argmax(contact))
    low = contact < 0.5 * contact[top]
    left = int(np.flatnonzero(low[:top])[-1]) + 1 if low[:top].any() else 0
    right = top + int(np.argmax(low[top:])) if low[top:].any() else contact.size
    return right - left
