"""Least squares over a whole campaign: shared physics, the unknowns of each blow, priors.

Levenberg and Marquardt's method within bounds, with the damping rule of Nielsen (IMM-REP-1999-05,
Technical University of Denmark). The sensitivities of all blows' own unknowns come from one
further simulation of the campaign each, those of shared numbers likewise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.impact.model import ImpactModel, Layout
from impactscope.discrepancy.side_by_side import side_by_side
from impactscope.errors import ImpactscopeError

__all__ = ['Fit', 'at_point', 'fit', 'jacobian', 'projector']

Array = NDArray[np.float64]

_STEP = 0.02  # of a number's scale, for finite differences at most
_FELT = 3.0  # norm of the change of all residuals that a step shall make
_SETTLED = 0.02  # fall of chi-square below which a fit has converged


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A model with the numbers that fit best."""

    model: ImpactModel
    layout: Layout
    x: Array
    residuals: Array  # standardised, then priors
    jacobian: Array  # of the residuals, shape (n_residuals, n_free)
    chi_square: float  # with priors
    converged: bool

    @property
    def reduced(self) -> float:
        """Chi-square of the data over the degrees of freedom."""
        data = self.residuals[: self.layout.size]
        return float(data @ data) / max(self.layout.size - self.x.size, 1)

    @property
    def values(self) -> dict[str, float]:
        """All numbers by key."""
        return self.model.values(self.x)

    def covariance(self) -> Array:
        """Covariance of the fitted numbers, shape (n_free, n_free); inner numbers.

        Inflated by the reduced chi-square where that is above one.
        """
        scale = np.linalg.norm(self.jacobian, axis=0)
        known = scale > 0.0
        result = np.zeros((scale.size, scale.size))
        triangle = np.linalg.qr(self.jacobian[:, known] / scale[known], mode='r')
        inverse = np.linalg.pinv(triangle, rcond=1e-12)
        inverse = inverse @ inverse.T / np.outer(scale[known], scale[known])
        result[np.ix_(known, known)] = inverse * max(1.0, self.reduced)
        return result

    def std(self, key: str) -> float:
        """Standard uncertainty of a free number in its own unit; 0 for a constant."""
        keys = [f.key for f in self.model.free]
        if key not in keys:
            return 0.0
        j = keys.index(key)
        std = math.sqrt(max(float(self.covariance()[j, j]), 0.0))
        return std * self.values[key] if self.model.free[j].logarithmic else std


def jacobian(
    model: ImpactModel,
    x: Array,
    layout: Layout,
    residuals: Array,
    only: Sequence[int] | None = None,
) -> Array:
    """Sensitivities of the residuals by one-sided differences, shape (n_residuals, n_free).

    ``only``: the numbers whose columns are wanted; the others stay zero.
    """
    result = np.zeros((residuals.size, x.size))
    _, upper = model.bounds()
    for j in range(x.size) if only is None else only:
        number = model.free[j]
        if number.blow is not None and number.blow not in layout.blow_spans:
            continue
        step = min(_STEP * number.scale, model.steps.get(number.key, math.inf))
        if x[j] + step > upper[j]:
            step = -step
        moved = x.copy()
        moved[j] += step
        values = model.values(moved)
        blows = layout.blows if number.blow is None else (number.blow,)
        parts = side_by_side(partial(model.blow_residuals, values, layout=layout), blows)
        for i, changed in zip(blows, parts, strict=True):
            span = layout.blow_spans[i]
            result[span, j] = (changed - residuals[span]) / step
        prior = model.prior_residuals(values, layout) - residuals[layout.size :]
        result[layout.size :, j] = prior / step
        norm = float(np.linalg.norm(result[:, j]))
        # later contacts amplify: a step that is small at the onset may be far too large there
        model.steps[number.key] = _FELT / max(norm, 1e-300)
    return result


def fit(
    model: ImpactModel,
    layout: Layout,
    start: Array | None = None,
    *,
    iterations: int = 25,
    settled: float = _SETTLED,
) -> Fit:
    """The numbers that fit best, from ``start`` on."""
    x = model.start() if start is None else start.copy()
    lower, upper = model.bounds()
    x = np.clip(x, lower, upper)
    residuals = model.residuals(x, layout)
    cost = float(residuals @ residuals)
    slopes = jacobian(model, x, layout, residuals)
    fresh, damping, growth, converged = True, 1e-4, 2.0, False
    for _ in range(iterations):
        gradient = slopes.T @ residuals
        pinned = ((x <= lower) & (gradient > 0)) | ((x >= upper) & (gradient < 0))
        curvature = slopes.T @ slopes
        diagonal = np.maximum(np.diag(curvature), 1e-12)
        moves = ~pinned
        step = np.zeros_like(x)
        system = curvature + damping * np.diag(diagonal)
        try:
            step[moves] = -np.linalg.solve(system[np.ix_(moves, moves)], gradient[moves])
        except np.linalg.LinAlgError:
            damping *= 10.0
            continue
        trial = np.clip(x + step, lower, upper)
        step = trial - x
        expected = -float(2.0 * gradient @ step + step @ curvature @ step)
        if expected < settled and damping <= 1.0:
            if fresh or expected <= 0.0:
                converged = True
                break
            slopes, fresh = jacobian(model, x, layout, residuals), True
            continue
        try:
            moved = model.residuals(trial, layout)
            moved_cost = float(moved @ moved)
        except (ImpactscopeError, OverflowError, ZeroDivisionError):
            moved_cost = math.inf
        fallen = cost - moved_cost
        if fallen > 0.0 and math.isfinite(moved_cost):
            ratio = fallen / max(expected, 1e-300)
            x, residuals, cost = trial, moved, moved_cost
            damping *= max(1.0 / 5.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
            growth = 2.0
            if 0.8 < ratio < 1.25 and fallen < 1e-3 * cost and fresh:
                fresh = False  # the slopes still serve
            else:
                slopes, fresh = jacobian(model, x, layout, residuals), True
            if fallen < settled and fresh:
                converged = True
                break
        else:
            if not fresh:
                slopes, fresh = jacobian(model, x, layout, residuals), True
                continue
            damping *= growth
            growth *= 2.0
            if damping > 1e8 or float(np.max(np.abs(step) / model.scales())) < 1e-7:
                converged = True
                break
    if not fresh:
        slopes = jacobian(model, x, layout, residuals)
    return Fit(model, layout, x, residuals, slopes, cost, converged)


def at_point(model: ImpactModel, layout: Layout, x: Array) -> Fit:
    """Residuals and sensitivities where nothing is fitted: at numbers found elsewhere."""
    residuals = model.residuals(x, layout)
    slopes = jacobian(model, x, layout, residuals)
    return Fit(model, layout, x, residuals, slopes, float(residuals @ residuals), False)


def projector(slopes: Array) -> Array:
    """Orthonormal basis of what the fitted numbers can re-tune, shape (n_residuals, rank)."""
    scale = np.linalg.norm(slopes, axis=0)
    keep = scale > 0
    basis, triangle = np.linalg.qr(slopes[:, keep] / scale[keep])
    sound = np.abs(np.diag(triangle)) > 1e-7
    return np.asarray(basis[:, sound])
