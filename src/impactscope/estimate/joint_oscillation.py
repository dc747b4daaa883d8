"""One natural frequency and one damping ratio from several blows on the same sensor.

Each blow keeps its own amplitude, phase, offset and noise; the decay and the frequency are
shared. Whether the blows may share them is tested by their scatter (Birge's ratio): repeated
blows on a linear sensor scatter as their own uncertainties say.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from impactscope.errors import EstimationError, InputError
from impactscope.estimate import free_oscillation as model
from impactscope.estimate import oscillation_kernels as kernels
from impactscope.records import Estimate

__all__ = ['JointFit', 'fit_jointly']

Array = NDArray[np.float64]

MOST_STEPS = 30
STEP_LIMIT = 1e-9  # of a standard uncertainty: the joint fit has converged
SCATTER_LIMIT = 0.01  # p-value of the scatter below which the uncertainties grow by Birge's ratio


@dataclass(frozen=True, slots=True, eq=False)
class JointFit:
    """Shared parameters of several spans of free vibration, and each span's own fit."""

    natural_frequency: Estimate  # Hz
    damping_ratio: Estimate
    covariance: float  # of frequency (Hz) and damping ratio
    frequency_birge: float  # scatter between blows over what their uncertainties predict
    damping_birge: float
    scatter_p: float  # chance of so large a scatter of both if all blows share one value
    blows: tuple[model.FreeOscillationFit, ...]
    iterations: int

    @property
    def agree(self) -> bool:
        """Whether the blows may share one frequency and damping ratio."""
        return self.scatter_p > SCATTER_LIMIT


def fit_jointly(spans: Sequence[ArrayLike], sample_rate: float | Sequence[float]) -> JointFit:
    """Fit eq. 27 to several spans with shared natural frequency and damping ratio.

    Args:
        spans: Two or more, each of shape (n_samples,), beginning after contact.
        sample_rate: Hz, one for all or one for each.

    Where the blows disagree (p-value of the scatter below 0.01) the uncertainties grow by the
    larger Birge ratio: the shared value is then a mean over blows that differ.

    Raises:
        InputError: fewer than two spans, or rates that do not match them.
        EstimationError: a span that cannot be fitted alone (its number is named).
    """
    if len(spans) < 2:
        raise InputError(f'{len(spans)} span given; a joint fit needs at least 2')
    if isinstance(sample_rate, Sequence):
        rates = [float(rate) for rate in sample_rate]
    else:
        rates = [float(sample_rate)] * len(spans)
    if len(rates) != len(spans):
        raise InputError(f'{len(rates)} sample rates given for {len(spans)} spans')
    blows = []
    records = []
    for number, (span, rate) in enumerate(zip(spans, rates, strict=True), start=1):
        try:
            blows.append(model.fit_free_oscillation(span, rate))
        except EstimationError as error:
            raise EstimationError(f'span {number}: {error}') from error
        records.append(model.centred(span, rate)[0])
    start = np.array([_pole(blow) for blow in blows])
    weights = np.array([1.0 / max(b.noise_std * b.inflation, 1e-300) ** 2 for b in blows])
    pole, information, iterations = _shared_pole(records, rates, weights, start.mean(axis=0))
    sigma, omega = float(pole[0]), float(pole[1])
    wn = math.hypot(sigma, omega)
    jacobian = np.array(
        [
            [sigma / wn / model.TWO_PI, omega / wn / model.TWO_PI],
            [omega**2 / wn**3, -sigma * omega / wn**3],
        ]
    )
    covariance = jacobian @ np.linalg.inv(information) @ jacobian.T
    birge, p_value = _scatter(blows)
    if p_value < SCATTER_LIMIT:
        covariance *= max(1.0, *birge) ** 2
    return JointFit(
        natural_frequency=Estimate(wn / model.TWO_PI, math.sqrt(covariance[0, 0])),
        damping_ratio=Estimate(sigma / wn, math.sqrt(covariance[1, 1])),
        covariance=float(covariance[0, 1]),
        frequency_birge=birge[0],
        damping_birge=birge[1],
        scatter_p=p_value,
        blows=tuple(blows),
        iterations=iterations,
    )


def _pole(blow: model.FreeOscillationFit) -> tuple[float, float]:
    """(decay rate in 1/s, damped angular frequency in rad/s)."""
    return blow.decay_rate.value, model.TWO_PI * blow.damped_frequency.value


def _shared_pole(
    records: list[Array], rates: list[float], weights: Array, start: Array
) -> tuple[Array, Array, int]:
    """Gauss-Newton on (decay, angular frequency); returns it, its information and the steps."""
    pole = start.copy()
    linear, gradient, hessian = np.zeros(3), np.zeros(2), np.zeros((2, 2))
    products, with_y = np.zeros((5, 5)), np.zeros(5)
    work = [(np.empty(y.size), np.empty(y.size)) for y in records]
    total_hessian = np.zeros((2, 2))
    for step in range(1, MOST_STEPS + 1):
        total_gradient, total_hessian = np.zeros(2), np.zeros((2, 2))
        for y, rate, weight, (c, q) in zip(records, rates, weights, work, strict=True):
            duration = y.size / rate
            kernels.moments(y, pole[0] * duration, pole[1] * duration, c, q, products, with_y)
            if not kernels.project(products, with_y, linear, gradient, hessian):
                raise EstimationError('the spans do not determine a shared oscillation')
            total_gradient += weight * duration * gradient
            total_hessian += weight * duration**2 * hessian
        change = np.linalg.solve(total_hessian, total_gradient)
        # A step of more than a tenth of the decay leaves the region of the linearisation.
        scale = min(1.0, 0.1 * math.hypot(*pole) / max(float(np.abs(change).max()), 1e-300))
        pole += scale * change
        size = float(change @ total_hessian @ change)
        rounding = 1e-13 * float(np.abs(pole).max())
        if size < STEP_LIMIT**2 or float(np.abs(change).max()) < rounding:
            return pole, total_hessian, step
    raise EstimationError(f'the joint fit did not settle in {MOST_STEPS} steps')


def _scatter(blows: Sequence[model.FreeOscillationFit]) -> tuple[tuple[float, float], float]:
    """Birge ratios of frequency and damping ratio, and the p-value of both together."""
    values = np.array([(b.natural_frequency.value, b.damping_ratio.value) for b in blows])
    covariances = np.array([b.covariance[:2, :2] for b in blows])
    # Rounding is no scatter: below it, agreement is complete.
    floor = np.diag((1e-12 * values.mean(axis=0)) ** 2)
    inverses = np.linalg.inv(covariances + floor)
    mean = np.linalg.solve(inverses.sum(axis=0), np.einsum('kij,kj->i', inverses, values))
    difference = values - mean
    statistic = float(np.einsum('ki,kij,kj->', difference, inverses, difference))
    degrees = len(blows) - 1
    ratios = []
    for k in range(2):
        weight = 1.0 / (covariances[:, k, k] + floor[k, k])
        centre = float(np.sum(weight * values[:, k]) / np.sum(weight))
        ratios.append(math.sqrt(float(np.sum(weight * (values[:, k] - centre) ** 2)) / degrees))
    return (ratios[0], ratios[1]), float(chi2.sf(statistic, 2 * degrees))
