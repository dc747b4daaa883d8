"""Least squares over a whole campaign: shared physics, the unknowns of each blow, priors.

Levenberg and Marquardt's method within bounds, with the damping rule of Nielsen (IMM-REP-1999-05,
Technical University of Denmark). The sensitivities of all blows' own unknowns come from one
further simulation of the campaign each, those of shared numbers likewise.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from impactscope.discrepancy.impact.models.bench_model import ImpactModel, Layout
from impactscope.discrepancy.parallel import in_parallel
from impactscope.discrepancy.processes import in_processes
from impactscope.discrepancy.time_limit import time_left
from impactscope.errors import ImpactscopeError

__all__ = [
    'Fit',
    'at_point',
    'exact_slope',
    'exact_slopes',
    'fit',
    'fits_from',
    'jacobian',
    'projector',
    'raced',
    'settled',
    'stepping',
    'weighted_median',
]

Array = NDArray[np.float64]

_STEP = 0.02  # of a number's scale, for finite differences at most
_FELT = 3.0  # norm of the change of all residuals that a step shall make
_TOO_FAR = 10.0  # times that, by which slopes are those of another place
_REACH = 1.5  # of a logarithm, in one step: numbers that hardly tell go off to their bounds else
_SETTLED = 0.02  # fall of chi-square, over its mean, below which a fit has converged
_HOPELESS = 100.0  # times the chi-square that is of use, from which a fit may be given up ...
_PACE = 5  # ... by how fast it fell in more iterations than these ...
_FASTER = 2.0  # ... and how much faster it may fall yet
_UPDATED = 3  # steps in a row for which slopes are brought up to date and not taken anew
_FAR_OFF = 4.0  # times the chi-square of a fit, from which a start is not close by
_STRAIGHT = (0.3, 1.7)  # fall over the expected one, within which they are
_ROUGH = 1.0  # ``settled`` of fits on the way to others
_FELT_BY = (0.1, 0.3, 1.0, 3.0)  # the same, of the steps either way for exact slopes
_ROUNDS = 6  # with exact slopes
_AT_REST = 0.01  # of chi-square


@dataclass(frozen=True, eq=False)
class Fit:
    """A model with the numbers that fit best."""

    model: ImpactModel
    layout: Layout
    x: Array
    residuals: Array  # standardised, then priors
    chi_square: float  # with priors
    converged: bool
    slopes: Array | None = None  # sensitivities where they are known already

    @cached_property
    def jacobian(self) -> Array:
        """Sensitivities of the residuals, shape (n_residuals, n_free)."""
        if self.slopes is not None:
            return self.slopes
        return jacobian(self.model, self.x, self.layout, self.residuals)

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

    def covariance_root(self, only: Sequence[int] | None = None) -> Array:
        """A root R of the covariance C of some numbers, or of all: R R' = C, shape (n, n).

        By way of their correlation: a number in a large unit would leave no digits to the others.
        """
        chosen = list(range(self.x.size)) if only is None else list(only)
        covariance = self.covariance()[np.ix_(chosen, chosen)]
        size = np.sqrt(np.diag(covariance))
        known = np.where(size > 0.0, size, 1.0)
        power, vectors = np.linalg.eigh(covariance / np.outer(known, known))
        return np.asarray(size[:, None] * vectors * np.sqrt(np.maximum(power, 0.0)))

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
    wanted = []
    for j in range(x.size) if only is None else only:
        blow = model.free[j].blow
        if blow is None or blow in layout.blow_spans:
            wanted.append(j)

    def column(j: int) -> Array:
        number = model.free[j]
        step = min(_STEP * number.scale, model.steps.get(number.key, math.inf))
        if x[j] + step > upper[j]:
            step = -step
        return _change(model, layout, x, residuals, j, step)

    for j, changed in zip(wanted, in_parallel(column, wanted), strict=True):
        result[:, j] = changed
    return result


def stepping(
    model: ImpactModel, layout: Layout, slopes: Array, only: Sequence[int] | None = None
) -> ImpactModel:
    """The model with steps for its next finite differences that are felt about as wanted.

    ``slopes``: as they are, shape (n_residuals, n_free); ``only``: the columns that are known.
    Later contacts amplify: a step that is small at the onset may be far too large there.
    """
    norms = np.linalg.norm(slopes, axis=0)
    steps = dict(model.steps)
    for j in range(norms.size) if only is None else only:
        number = model.free[j]
        if number.blow is None or number.blow in layout.blow_spans:
            steps[number.key] = _FELT / max(float(norms[j]), 1e-300)
    return dataclasses.replace(model, steps=steps)


def exact_slopes(found: Fit) -> Array:
    """Sensitivities at a fit by differences of several lengths, shape (n_residuals, n_free).

    A step that is long enough to lead a search may bring a contact, a slip or a sample of either
    to the other side; in a very short one the integrator's own errors show. Either would pass for
    an influence that no other number has, and numbers that recordings hardly part would seem to be
    parted well. So every residual has the weighted median of its changes by steps of several
    lengths to both sides: what jumps on one side, or in the longest steps alone, is outvoted.
    """
    result = found.jacobian.copy()
    norms = np.linalg.norm(result, axis=0)
    wanted = [j for j in range(found.x.size) if norms[j] > 0.0]

    def column(j: int) -> Array | None:
        return exact_slope(found, j, float(norms[j]))

    for j, changed in zip(wanted, in_parallel(column, wanted), strict=True):
        if changed is not None:
            result[:, j] = changed
    return result


def exact_slope(found: Fit, j: int, norm: float) -> Array | None:
    """One column of :func:`exact_slopes`; None where no step to either side can be simulated.

    ``norm``: about that of the column, above zero; it gives the lengths of the steps.
    """
    model, layout, x = found.model, found.layout, found.x
    lower, upper = (bounds[j] for bounds in model.bounds())
    ways, lengths = [], []
    for felt in _FELT_BY:
        step = min(felt / norm, _STEP * model.free[j].scale)
        for way in (step, -step):
            if not lower <= x[j] + way <= upper:
                continue
            with contextlib.suppress(ImpactscopeError):
                ways.append(_change(model, layout, x, found.residuals, j, way))
                lengths.append(step)
    return weighted_median(np.stack(ways), np.array(lengths)) if ways else None


def weighted_median(rows: Array, weights: Array) -> Array:
    """Median over the first axis, shape (n_rows, n), rows of weights of shape (n_rows,).

    Midway between the two in the middle where the weights of either side are the same.
    """
    order = np.argsort(rows, axis=0)
    ranked = np.take_along_axis(rows, order, axis=0)
    share = np.cumsum(weights[order], axis=0) / float(np.sum(weights))
    columns = np.arange(rows.shape[1])
    low = np.argmax(share >= 0.5 - 1e-9, axis=0)
    high = np.argmax(share > 0.5 + 1e-9, axis=0)
    return np.asarray(0.5 * (ranked[low, columns] + ranked[high, columns]))


def _rough(model: ImpactModel, slopes: Array) -> bool:
    """Whether a number's slopes were taken by a step that changes far more than is wanted."""
    norms = np.linalg.norm(slopes, axis=0)
    steps = [min(_STEP * f.scale, model.steps.get(f.key, math.inf)) for f in model.free]
    return bool(np.any(norms * steps > _TOO_FAR * _FELT))


def _change(
    model: ImpactModel, layout: Layout, x: Array, residuals: Array, j: int, step: float
) -> Array:
    """Change of all residuals per step of one number."""
    moved = x.copy()
    moved[j] += step
    values = model.values(moved)
    blow = model.free[j].blow
    out = np.zeros_like(residuals)
    for i in layout.blows if blow is None else (blow,):
        span = layout.blow_spans[i]
        out[span] = (model.blow_residuals(values, i, layout) - residuals[span]) / step
    prior = model.prior_residuals(values, layout) - residuals[layout.size :]
    out[layout.size :] = prior / step
    return out


def settled(found: Fit) -> Fit:
    """A fit brought to the very bottom of its minimum, with exact slopes there."""
    lower, upper = found.model.bounds()
    best = dataclasses.replace(found, slopes=exact_slopes(found))
    for again in range(_ROUNDS):
        if again and not time_left('the last digits of the numbers'):
            break
        slopes, residuals = best.jacobian, best.residuals
        gradient = slopes.T @ residuals
        inside = ~(((best.x <= lower) & (gradient > 0)) | ((best.x >= upper) & (gradient < 0)))
        scale = np.linalg.norm(slopes, axis=0)
        inside &= scale > 0.0
        step = np.zeros_like(best.x)
        answer = np.linalg.lstsq(slopes[:, inside] / scale[inside], residuals, rcond=1e-12)[0]
        step[inside] = -answer / scale[inside]
        if -float(gradient @ step) < _AT_REST:
            break
        better = None
        for share in (1.0, 0.3, 0.1):
            x = np.clip(best.x + share * step, lower, upper)
            try:
                trial = at_point(found.model, found.layout, x)
            except (ImpactscopeError, OverflowError):
                continue
            if trial.chi_square < best.chi_square:
                better = trial
                break
        if better is None:
            break
        fallen = best.chi_square - better.chi_square
        better = dataclasses.replace(better, slopes=slopes, converged=True)
        best = dataclasses.replace(better, slopes=exact_slopes(better))
        if fallen < _AT_REST:
            break
    return best


def fit(
    model: ImpactModel,
    layout: Layout,
    start: Array | None = None,
    *,
    iterations: int = 25,
    settled: float = _SETTLED,
    near: Fit | None = None,
    fresh: bool = True,
    most: float = math.inf,
) -> Fit:
    """The numbers that fit best, from ``start`` on.

    ``settled``: fall of chi-square below which the fit has converged, in units of the reduced
    chi-square that is left: where the model misses by far, digits of chi-square tell nothing.
    ``near``: a fit close by, whose sensitivities serve for the first step unless it leads far off.
    ``most``: chi-square above which its numbers are of no use: a fit far above ends where it does
    not come down to that in the iterations that are left, be it much faster from now on.

    Between full evaluations slopes are brought up to date by each step that went about as they
    said (Broyden, Math. Comp. 19, 1965); before a fit counts as converged they are taken anew,
    unless ``fresh`` is not wanted: those of a fit ``near`` that is the same but for a detail do.
    """
    x = model.start() if start is None else start.copy()
    lower, upper = model.bounds()
    x = np.clip(x, lower, upper)
    reach = np.array([_REACH if f.logarithmic else math.inf for f in model.free])
    residuals = model.residuals(x, layout)
    cost = float(residuals @ residuals)
    if near is not None and cost > _FAR_OFF * max(near.chi_square, float(layout.size)):
        near = None  # its slopes tell nothing there
    slopes, updates = _first_slopes(model, layout, x, residuals, near)
    rough = _rough(model, slopes)
    model = stepping(model, layout, slopes)
    damping, growth, converged = 1e-4, 2.0, False
    begun = cost
    for done in range(iterations):
        if done > _PACE and cost > _HOPELESS * most:
            pace = math.log(begun / cost) / done
            if math.log(cost / most) > _FASTER * pace * (iterations - done):
                break
        # on the way a fit that misses by far has to go on, however slowly it comes nearer
        enough = settled * (1.0 if settled >= _ROUGH else max(1.0, cost / max(layout.size, 1)))
        gradient = slopes.T @ residuals
        pinned = ((x <= lower) & (gradient > 0)) | ((x >= upper) & (gradient < 0))
        curvature = slopes.T @ slopes
        told = np.diag(curvature) > 0.0  # a number that nothing tells stays where it is
        diagonal = np.maximum(np.diag(curvature), 1e-12)
        system = curvature + damping * np.diag(diagonal)
        try:
            near_by = np.maximum(lower, x - reach), np.minimum(upper, x + reach)
            trial = _within(x, system, gradient, told & ~pinned, near_by)
        except np.linalg.LinAlgError:
            damping *= 10.0
            continue
        step = trial - x
        expected = -float(2.0 * gradient @ step + step @ curvature @ step)
        if 0.0 <= expected < enough and damping <= 1.0:
            if not (updates and fresh):
                converged = True
                break
            slopes, updates = jacobian(model, x, layout, residuals), 0
            model = stepping(model, layout, slopes)
            continue
        try:
            moved = model.residuals(trial, layout)
            moved_cost = float(moved @ moved)
        except (ImpactscopeError, OverflowError, ZeroDivisionError):
            moved_cost = math.inf
        fallen = cost - moved_cost
        if fallen > 0.0 and math.isfinite(moved_cost):
            ratio = fallen / max(expected, 1e-300)
            change = moved - residuals
            x, residuals, cost = trial, moved, moved_cost
            damping *= max(1.0 / 5.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
            growth = 2.0
            if fallen < enough and not (updates and fresh):
                converged = True
                break
            if _STRAIGHT[0] < ratio < _STRAIGHT[1] and updates < _UPDATED:
                slopes = _updated(slopes, step, change, model.scales())
                updates += 1
            else:
                slopes, updates = jacobian(model, x, layout, residuals), 0
                model = stepping(model, layout, slopes)
        else:
            if updates or rough:
                slopes, updates, rough = jacobian(model, x, layout, residuals), 0, False
                model = stepping(model, layout, slopes)
                continue
            damping *= growth
            growth *= 2.0
            if damping > 1e8 or float(np.max(np.abs(step) / model.scales())) < 1e-7:
                converged = True
                break
    return Fit(model, layout, x, residuals, cost, converged, None if updates else slopes)


def fits_from(
    model: ImpactModel,
    layout: Layout,
    starts: Sequence[Array],
    *,
    settled: float,
    iterations: int,
    near: Sequence[Fit | None] = (),
) -> list[Fit]:
    """Fits from several starts side by side, without those that cannot be simulated.

    ``near``: for each start a fit close by, or None; see :func:`fit` for the rest.
    """

    def fitted(start: tuple[Array, Fit | None]) -> Fit | None:
        x, close = start
        try:
            return fit(model, layout, x, settled=settled, iterations=iterations, near=close)
        except ImpactscopeError:
            return None

    pairs = list(zip(starts, near or [None] * len(starts), strict=True))
    return [f for f in in_processes(fitted, pairs) if f is not None]


def raced(
    model: ImpactModel,
    layout: Layout,
    starts: Sequence[Array],
    *,
    most: int,
    iterations: tuple[int, int],
    settled: tuple[float, float],
) -> list[Fit]:
    """Fits from several starts, of which the ``most`` that are best go to their end.

    ``iterations``, ``settled``: of every fit, and of those that go on; see :func:`fit`.
    """
    rough = fits_from(model, layout, starts, settled=settled[0], iterations=iterations[0])
    ahead = sorted(rough, key=lambda f: f.chi_square)[:most]
    begins = [f.x for f in ahead]
    return [
        *ahead,
        *fits_from(model, layout, begins, settled=settled[1], iterations=iterations[1]),
    ]


def _within(
    x: Array,
    system: Array,
    gradient: Array,
    moves: NDArray[np.bool_],
    bounds: tuple[Array, Array],
) -> Array:
    """Where a step leads that stays within bounds; the best that does.

    One that is only cut off may lead uphill: what stops at its bound drags others along.
    """
    if not moves.any():
        return x
    lower, upper = (b[moves] for b in bounds)
    inner, pull = system[np.ix_(moves, moves)], gradient[moves]
    trial = x.copy()
    trial[moves] = x[moves] - np.linalg.solve(inner, pull)
    if np.all((trial[moves] >= lower) & (trial[moves] <= upper)):
        return trial
    scale = np.sqrt(np.diag(inner))
    root = np.linalg.cholesky(inner / np.outer(scale, scale)).T
    aim = -np.linalg.solve(root.T, pull / scale)
    limits = (lower - x[moves]) * scale, (upper - x[moves]) * scale
    with np.errstate(divide='ignore', invalid='ignore'):
        found = optimize.lsq_linear(root, aim, limits, method='bvls')
    trial[moves] = np.clip(x[moves] + found.x / scale, lower, upper)
    return trial


def _updated(slopes: Array, step: Array, change: Array, scales: Array) -> Array:
    """Slopes that give the change that a step has made, otherwise as they were."""
    along = step / scales**2
    return slopes + np.outer(change - slopes @ step, along / float(along @ step))


def _first_slopes(
    model: ImpactModel, layout: Layout, x: Array, residuals: Array, near: Fit | None
) -> tuple[Array, int]:
    """Slopes to begin with, and how often they count as updated: once where some are borrowed."""
    if near is None or near.layout is not layout:
        return jacobian(model, x, layout, residuals), 0
    known = {f.key: j for j, f in enumerate(near.model.free)}
    new = [
        j
        for j, f in enumerate(model.free)
        if f.key not in known or near.model.free[known[f.key]] is not f
    ]
    slopes = jacobian(model, x, layout, residuals, only=new)
    size = layout.size
    old = np.setdiff1d(np.arange(x.size), np.array(new, dtype=np.int64))
    place = np.array([known[model.free[j].key] for j in old], dtype=np.int64)
    slopes[:size, old] = near.jacobian[:size, place]
    slopes[np.ix_(size + old, old)] = near.jacobian[np.ix_(size + place, place)]
    return slopes, 1


def at_point(model: ImpactModel, layout: Layout, x: Array) -> Fit:
    """Residuals and sensitivities where nothing is fitted: at numbers found elsewhere."""
    residuals = model.residuals(x, layout)
    return Fit(model, layout, x, residuals, float(residuals @ residuals), False)


def projector(slopes: Array) -> Array:
    """Orthonormal basis of what the fitted numbers can re-tune, shape (n_residuals, rank)."""
    scale = np.linalg.norm(slopes, axis=0)
    keep = scale > 0
    basis, triangle = np.linalg.qr(slopes[:, keep] / scale[keep])
    sound = np.abs(np.diag(triangle)) > 1e-7
    return np.asarray(basis[:, sound])
