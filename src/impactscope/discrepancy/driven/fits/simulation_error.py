"""Simulation-error fits: numbers that all recordings share, and the beginning of each.

The prediction runs from the first sample to the last without being corrected by what was
measured: an error of the model can accumulate and shows. (One-step predictions hide it: there a
linear model of high order looks right for almost anything.)
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from impactscope.discrepancy.driven.fits.prediction_uncertainty import excused
from impactscope.discrepancy.driven.fits.weighted_residuals import (
    STEP,
    WeightedResiduals,
    channel_scales,
    counted,
    in_units,
    numbers_of,
    step_of,
)
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel
from impactscope.discrepancy.driven.models.terms import Term

__all__ = [
    'FINE',
    'Fit',
    'fit',
    'plainly_begun',
    'sensitivities',
]

Array = NDArray[np.float64]

BLOCKS = 24  # of a recording, for the scatter of the estimates
MOST_EVALUATIONS = 60
FIRST_OF_A_SWING = (0.03, 0.1, 0.3, 1.0)  # shares of a recording, for its beginning alone
ROUGH, FINE = 1e-4, 1e-8  # relative fall of the sum of squares at which a fit ends


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fitted model.

    ``residuals``: measured minus predicted, by segment, fitted and held out alike.
    """

    terms: tuple[Term, ...]
    values: Mapping[str, float]
    std: Mapping[str, float]
    starts: tuple[Array, ...]
    residuals: tuple[Array, ...]
    added: int  # numbers beyond the baseline's
    label: str = ''
    evaluations: int = 0
    cost: float = 0.0  # sum of squares as the fit counts it
    own: int = 0  # of the added numbers those that single recordings have of their own
    covariance: Array | None = None  # of the shared numbers, in the order of ``values``
    # by which the deviance of held-out recordings falls as the numbers are not known for certain
    excused: float = 0.0

    def variance_along(self, slopes: Mapping[str, float]) -> float:
        """Variance of a quantity by its slopes by shared numbers; nan where none is known."""
        if self.covariance is None:
            return math.nan
        along = np.array([slopes.get(k, 0.0) for k in self.values])
        return max(float(along @ self.covariance @ along), 0.0)

    def rms(self, segment: int) -> float:
        """Root mean square of one segment's residual, in the channel's unit."""
        return float(np.sqrt(np.mean(self.residuals[segment] ** 2)))


def _differences(function: Callable[[Array], Array], theta: Array, at_theta: Array) -> Array:
    jacobian = np.empty((at_theta.size, theta.size))
    for j in range(theta.size):
        moved = theta.copy()
        moved[j] += STEP
        jacobian[:, j] = (function(moved) - at_theta) / STEP
    return jacobian


def fit(
    model: Model,
    terms: tuple[Term, ...],
    segments: Sequence[Segment],
    initial: Mapping[str, float],
    starts: Sequence[Array] | None = None,
    evaluations: int = MOST_EVALUATIONS,
    tolerance: float = ROUGH,
    slopes_of_first: Array | None = None,
) -> Fit:
    """Fit a model with these terms to the segments that are not held out.

    Args:
        model: what predicts.
        terms: effects beyond the baseline.
        segments: of all recordings.
        initial: values to set out from, by key; where one is missing, the number's first start.
        starts: beginnings to set out from, by segment.
        evaluations: of the prediction at most, without those for derivatives.
        tolerance: relative fall of the sum of squares at which the fit ends.
        slopes_of_first: derivatives of the residual as it counts by the first numbers, each over
            its scale, where they are known well enough; shape (n_samples, n_first).
    """
    problem = WeightedResiduals(model, terms, segments, initial, starts)
    shared, fitted, total = problem.shared, problem.fitted, problem.total
    first = len(shared)
    theta = problem.begin
    frozen = None if slopes_of_first is None else slopes_of_first / math.sqrt(total)
    spent = 0
    if theta.size:
        solution = least_squares(
            problem.residual,
            theta,
            partial(problem.jacobian, first=frozen),
            bounds=(problem.lower[: theta.size], problem.upper[: theta.size]),
            x_scale='jac',
            max_nfev=evaluations,
            ftol=tolerance,
            xtol=tolerance,
            gtol=1e-14,
        )
        theta, slopes, spent = solution.x, solution.jac, int(solution.nfev)
    else:
        slopes = np.zeros((total, 0))
    values = problem.values(theta)
    begins: list[Array] = []
    residuals: list[Array] = []
    for i, segment in enumerate(segments):
        if segment.held_out:
            begin, weight = problem.beginning(i), problem.weights[i]
            begin = _own_beginning(model, terms, values, segment, begin, weight)
        else:
            begin = problem.start(theta, i)
        begins.append(begin)
        residuals.append(problem.error(values, begin, i))
    left = np.concatenate([problem.weighted(residuals[i], i) for i in fitted])
    spread = _scatter(slopes, left, white=problem.known)
    scale = np.array([n.scale for _, n in shared])
    covariance = spread[:first, :first] * np.outer(scale, scale)
    std = {k: math.sqrt(max(float(covariance[j, j]), 0.0)) for j, (k, _) in enumerate(shared)}
    mine = sum(t.own for t in terms)
    added = sum(len(t.numbers) for t in terms) + mine
    return Fit(
        terms,
        values,
        std,
        tuple(begins),
        tuple(residuals),
        added,
        evaluations=spent,
        cost=float(left @ left),
        own=mine,
        covariance=covariance,
        excused=_excused(problem, theta, slopes, begins) if problem.known and first else 0.0,
    )


def _excused(
    problem: WeightedResiduals, theta: Array, slopes: Array, begins: Sequence[Array]
) -> float:
    """What the uncertainty of the numbers excuses of the misfit of held-out recordings."""
    held_out = [i for i, s in enumerate(problem.segments) if s.held_out]
    for i in held_out:
        theta = problem.with_beginning(theta, i, begins[i])
    unit = math.sqrt(problem.total)  # residuals in units of their noise
    parts = [[unit * part for part in problem.linearised(theta, i)] for i in held_out]
    return excused(unit * slopes, len(problem.shared), [(r, s, o) for r, s, o in parts])


def _own_beginning(
    model: Model,
    terms: tuple[Term, ...],
    values: Mapping[str, float],
    segment: Segment,
    begin: Array,
    weight: float,
) -> Array:
    """Beginning of a held-out recording; nothing else is fitted to it.

    Of a free swing first by its first cycles: over many, a speed that is slightly off at the
    beginning makes whole cycles.
    """
    numbers = model.starts(segment)
    if not numbers:
        return begin
    scale = np.array([n.scale for n in numbers])

    def left(begin: Array) -> float:
        predicted = model.predict(values, terms, begin, segment)
        counting = counted(model, segment.measured - predicted, segment)
        return float(counting @ counting)

    # one that another model asked for may lie in another valley
    usual = np.array([n.starts[0] for n in numbers])
    theta = min(begin, usual, key=left) / scale
    swings = isinstance(model, OscillatorModel) and model.free
    for share in FIRST_OF_A_SWING if swings else (1.0,):
        count = max(math.ceil(share * segment.measured.size), 2 * len(numbers))

        def residual(theta: Array, count: int = count) -> Array:
            predicted = model.predict(values, terms, theta * scale, segment)
            return weight * counted(model, segment.measured - predicted, segment)[:count]

        def jacobian(theta: Array, count: int = count) -> Array:
            return _differences(lambda q: residual(q, count), theta, residual(theta, count))

        theta = least_squares(residual, theta, jacobian, x_scale='jac', max_nfev=30).x
    return np.asarray(theta * scale)


def plainly_begun(model: Model, made: Fit, segments: Sequence[Segment]) -> Fit:
    """The fit with beginnings that leave least as it is, where errors of force accumulate.

    Beside slow noise a fit forgives a position and a speed that are far off at the beginning; as
    figures and curves they would hide how well its laws predict.
    """
    if not model.drifts or not made.starts:
        return made
    begins, residuals = list(made.starts), list(made.residuals)
    for i, segment in enumerate(segments):
        if segment.whitener is None or not begins[i].size:
            continue
        scale = np.array([n.scale for n in model.starts(segment)])

        def left(theta: Array, segment: Segment = segment, scale: Array = scale) -> Array:
            predicted = model.predict(made.values, made.terms, theta * scale, segment)
            return segment.measured - predicted

        def slopes(theta: Array, left: Callable[[Array], Array] = left) -> Array:
            return _differences(left, theta, left(theta))

        found = least_squares(left, begins[i] / scale, slopes, x_scale='jac', max_nfev=15)
        if found.cost < 0.5 * float(residuals[i] @ residuals[i]):
            begins[i] = np.asarray(found.x * scale)
            residuals[i] = np.asarray(found.fun)
    return dataclasses.replace(made, starts=tuple(begins), residuals=tuple(residuals))


def _scatter(jacobian: Array, residual: Array, *, white: bool) -> Array:
    """Covariance that allows for coloured residuals, shape (n_numbers, n_numbers).

    The usual one where residuals are whitened; else with the larger standard uncertainties of it
    and of the sandwich estimate, whose filling is the scatter of the gradient over blocks of
    consecutive samples.
    """
    n, k = jacobian.shape
    if k == 0:
        return np.zeros((0, 0))
    # columns of one length: a number in large units must not pass for one that is not seen
    length = np.linalg.norm(jacobian, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    even = jacobian / length
    inverse = np.linalg.pinv(even.T @ even, hermitian=True) / np.outer(length, length)
    usual = inverse * float(residual @ residual) / max(n - k, 1)
    if white:
        return np.asarray(usual)
    edges = np.linspace(0, n, min(BLOCKS, n) + 1).astype(int)
    gradients = np.array([jacobian[a:b].T @ residual[a:b] for a, b in itertools.pairwise(edges)])
    sandwich = inverse @ (gradients.T @ gradients) @ inverse
    least = np.maximum(np.diag(usual), 0.0)
    larger = np.sqrt(np.maximum(np.diag(sandwich), least) / np.where(least > 0.0, least, 1.0))
    return np.asarray(usual * np.outer(larger, larger))


def sensitivities(model: Model, base: Fit, segments: Sequence[Segment]) -> tuple[Array, Array]:
    """Residual of a fit and its derivatives by every fitted number, weighted, on fitted data.

    Shapes (n_samples,) and (n_samples, n_numbers): what the model can re-tune.
    """
    shared = numbers_of(model, base.terms)
    scales = channel_scales(segments)
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    residual = np.concatenate([in_units(base.residuals[i], segments[i], scales) for i in fitted])
    columns = []
    share = step_of(model, base.terms, segments, float(np.mean(residual**2)))
    for k, n in shared:
        step = share * n.scale
        moved = {**base.values, k: base.values[k] + step}
        parts = [_moved(model, base, moved, i, segments[i]) for i in fitted]
        columns.append(
            np.concatenate(
                [in_units(p, segments[i], scales) for p, i in zip(parts, fitted, strict=True)]
            )
            / share
        )
    sizes = [segments[i].measured.size for i in fitted]
    ends = np.cumsum(sizes)
    for which, i in enumerate(fitted):
        for j, n in enumerate(model.starts(segments[i])):
            begin = base.starts[i].copy()
            begin[j] += share * n.scale
            predicted = model.predict(base.values, base.terms, begin, segments[i])
            change = predicted - (segments[i].measured - base.residuals[i])
            column = np.zeros(residual.size)
            column[ends[which] - sizes[which] : ends[which]] = (
                in_units(change, segments[i], scales) / share
            )
            columns.append(column)
    return residual, np.stack(columns, axis=1) if columns else np.zeros((residual.size, 0))


def _moved(
    model: Model, base: Fit, values: Mapping[str, float], i: int, segment: Segment
) -> Array:
    predicted = model.predict(values, base.terms, base.starts[i], segment)
    return predicted - (segment.measured - base.residuals[i])
