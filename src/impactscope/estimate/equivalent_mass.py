"""Equivalent mass of an impactor that comes to rest on the plate, from their common oscillation.

Source: Samarathunga et al., Machines 2024, 12, 26, section 3.2, Fig. 10: plate and pendulum swing
as one at sqrt(k/(m + M)). That holds only while the pendulum stays on the plate: its weight must
exceed what it takes to accelerate it. A reading that swings by A about the weight W needs a
contact force that swings by A M/(m + M), so contact is kept where A < W (m + M)/M. A blow
from 10 degrees starts far above; fitted from there, as one would at first, the mass is wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import EstimationError, InputError
from impactscope.estimate.free_oscillation import FreeOscillationFit, fit_free_oscillation
from impactscope.records import Estimate

__all__ = ['EquivalentMass', 'contact_spans', 'estimate_equivalent_mass']

Array = NDArray[np.float64]

_UNKNOWN = Estimate()
_MARGIN = 0.95  # of the largest swing that keeps contact: what is left for noise
_FEWEST_PERIODS = 3.0
_LEAST_SWING = 4.0  # noise standard deviations, at the span's beginning
_LEAST_R_SQUARED = 0.8
_QUARTERS_TRIED = 16
_REST_SHARE = 0.15  # of the record, its end, from which the weight is read


@dataclass(frozen=True, slots=True, eq=False)
class EquivalentMass:
    """What the common oscillation tells. NaN where it could not be told."""

    valid: bool
    reason: str  # why not, in words; empty where valid
    mass: Estimate = _UNKNOWN  # M, kg, of the impactor at the contact point
    total_mass: Estimate = _UNKNOWN  # m + M, kg
    weight: Estimate = _UNKNOWN  # N, on the plate at rest
    span: tuple[float, float] = (math.nan, math.nan)  # s after the first sample, all in contact
    largest_swing: float = math.nan  # N, of the reading about the weight, that keeps contact
    naive_total_mass: float = math.nan  # kg, fitted from the blow's peak on, contact or not
    fit: FreeOscillationFit | None = None

    @property
    def naive_bias(self) -> float:
        """Relative error of the total mass that neglecting the loss of contact would make."""
        return self.naive_total_mass / self.total_mass.value - 1


def contact_spans(
    force: ArrayLike,
    acceleration: ArrayLike,
    sample_rate: float,
    *,
    plate_mass: float,
    threshold: float,
) -> list[tuple[float, float]]:
    """Spans, s after the first sample, in which f_o + m a exceeds ``threshold`` N.

    ``force`` N and the plate's ``acceleration`` m/s², shape (n_samples,), zero levels removed: the
    direct way to see loss and return of contact, where the plate carries an accelerometer.
    """
    f, a = np.asarray(force, np.float64), np.asarray(acceleration, np.float64)
    if f.shape != a.shape or f.ndim != 1:
        raise InputError(f'contact spans: force {f.shape} and acceleration {a.shape} differ')
    touching = np.concatenate(([False], f + plate_mass * a > threshold, [False]))
    edges = np.flatnonzero(touching[1:] != touching[:-1])
    return [
        (float(start) / sample_rate, float(end - 1) / sample_rate)
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]


def estimate_equivalent_mass(
    force: ArrayLike,
    sample_rate: float,
    *,
    stiffness: Estimate,
    sensor_frequency: Estimate,
    weight: Estimate | None = None,
) -> EquivalentMass:
    """Equivalent mass from the reading of a blow after which the impactor stays on the plate.

    ``force`` N, shape (n_samples,), zero level (before the blow) removed, from before the blow
    until rest; ``stiffness`` of the spring N/m; ``sensor_frequency`` the undamped one of
    the sensor alone, Hz. ``weight`` N is the reading at rest, taken from the record's end where
    not given. M = k (1/w² - 1/w0²), so that the stiffness enters once. Raises InputError
    for arrays and constants that cannot be.
    """
    f = np.asarray(force, np.float64)
    if f.ndim != 1 or not np.isfinite(f).all() or not sample_rate > 0:
        raise InputError(f'equivalent mass: force of shape {f.shape} must be 1-D and finite')
    if not (stiffness.value > 0 and sensor_frequency.value > 0):
        raise InputError(
            f'equivalent mass: stiffness {stiffness.value!r} N/m and sensor frequency '
            f'{sensor_frequency.value!r} Hz must be known'
        )
    end = f[int((1 - _REST_SHARE) * f.size) :]
    if end.size < 8:
        return EquivalentMass(False, f'{f.size} samples are too few')
    noise = float(np.median(np.abs(np.diff(f, 2)))) / 0.6745 / math.sqrt(6)
    if weight is None:
        weight = Estimate(float(end.mean()), float(end.std()) / math.sqrt(end.size))
    if not weight.value > max(5 * weight.std, 3 * noise / math.sqrt(end.size)):
        return EquivalentMass(
            False,
            f'the reading comes to rest at {weight.value:.3g} N: no impactor stays on the plate',
        )
    k, w0 = stiffness.value, 2 * math.pi * sensor_frequency.value
    plate = k / w0**2
    # What is still to come swings no further than this:
    swing = np.maximum.accumulate(np.abs(f - weight.value)[::-1])[::-1]
    bound = weight.value  # (m + M)/M times this once M is known: more of the record is good
    try:
        for _ in range(4):
            first = int(np.argmax(swing < bound - 2 * noise))
            first, fit = _settled(f, first, sample_rate, sensor_frequency.value)
            total = k / (2 * math.pi * fit.natural_frequency.value) ** 2
            if total <= plate:
                break
            wider = _MARGIN * weight.value * total / (total - plate)
            if abs(wider - bound) < 0.01 * bound:
                break
            bound = wider
    except EstimationError as error:
        return EquivalentMass(False, f'no common oscillation in contact: {error}')
    reason = _doubt(fit, total, plate, noise)
    if reason:
        return EquivalentMass(False, reason, weight=weight)
    frequency = fit.natural_frequency
    by_frequency = 2 * total * frequency.std / frequency.value
    by_sensor = 2 * plate * sensor_frequency.std / sensor_frequency.value
    share = stiffness.std / k if math.isfinite(stiffness.std) else 0.0
    mass = total - plate
    std = math.hypot(by_frequency, by_sensor if math.isfinite(by_sensor) else 0.0, mass * share)
    if mass < 2 * std:
        return EquivalentMass(
            False,
            f'the mass, {mass:.3g} kg, is within its uncertainty of {std:.3g} kg',
            weight=weight,
        )
    return EquivalentMass(
        True,
        '',
        Estimate(mass, std),
        Estimate(total, math.hypot(by_frequency, total * share)),
        weight,
        (first / sample_rate, f.size / sample_rate),
        weight.value * total / mass,
        _naive(f, sample_rate, k),
        fit,
    )


def _settled(
    f: Array, first: int, sample_rate: float, sensor_frequency: float
) -> tuple[int, FreeOscillationFit]:
    """The first start, from ``first`` on by quarter periods, that leaves a white residual.

    The swing may be small enough while the impactor is still in the air; then the span begins
    with another motion, and the residual shows it. Where none is white, the best of them.
    """
    best: tuple[int, FreeOscillationFit] | None = None
    for quarter in range(_QUARTERS_TRIED):
        start = first + round(quarter * sample_rate / sensor_frequency / 4)
        try:
            fit = fit_free_oscillation(f[start:], sample_rate)
        except EstimationError:
            if best is None and quarter == _QUARTERS_TRIED - 1:
                raise
            continue
        if fit.white:
            return start, fit
        if best is None or fit.whiteness < best[1].whiteness:
            best = (start, fit)
    if best is None:
        raise EstimationError('nothing oscillates')
    return best


def _doubt(fit: FreeOscillationFit, total: float, plate: float, noise: float) -> str:
    """Why a fit is not the common oscillation of plate and impactor; empty where it is."""
    frequency = fit.natural_frequency.value
    if total <= plate:
        return f'the oscillation, {frequency:.4g} Hz, is no slower than the sensor alone'
    if fit.periods < _FEWEST_PERIODS:
        return f'only {fit.periods:.2g} periods are in contact; {_FEWEST_PERIODS:g} are needed'
    if abs(fit.amplitude.value) < _LEAST_SWING * noise:
        return 'where contact is kept the oscillation does not rise above the noise'
    # A long record is mostly noise at rest: what counts is the misfit beyond it.
    misfit = max(fit.rmse**2 - noise**2, 0.0)
    explained = 1.0 - misfit * (1.0 - fit.r_squared) / max(fit.rmse**2, 1e-300)
    if explained < _LEAST_R_SQUARED:
        return (
            'no single damped oscillation fits the span in contact '
            f'(R² without the noise {explained:.2f})'
        )
    return ''


def _naive(f: Array, sample_rate: float, stiffness: float) -> float:
    """Total mass fitted from the peak on, kg; NaN where even that fails."""
    try:
        fit = fit_free_oscillation(f[int(np.argmax(f)) :], sample_rate)
    except EstimationError:
        return math.nan
    return stiffness / (2 * math.pi * fit.natural_frequency.value) ** 2
