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
from scipy import signal
from scipy.optimize import least_squares

from impactscope.discrepancy.driven.fits.friction_jumps import (
    LEAP,
    beside_turns,
    may_jump,
    steady_slope,
)
from impactscope.discrepancy.driven.fits.prediction_uncertainty import excused
from impactscope.discrepancy.driven.fits.recordings_in_parallel import by_recording
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel
from impactscope.discrepancy.driven.models.terms import Number, Term, key

__all__ = [
    'FINE',
    'Fit',
    'channel_scales',
    'counted',
    'fit',
    'numbers_of',
    'plainly_begun',
    'sensitivities',
]

Array = NDArray[np.float64]

STEP = 1e-4  # of a number's scale, for differences
MEMORY = 0.1  # of a recording, beyond which accumulated errors are forgotten
BLOCKS = 24  # of a recording, for the scatter of the estimates
MOST_EVALUATIONS = 60
FARTHEST = 1e9  # times a channel's spread: farther off is no worse
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


def channel_scales(segments: Sequence[Segment]) -> dict[str, float]:
    """What one is measured by in each channel: its spread in the fitted recordings."""
    scales: dict[str, float] = {}
    for channel in {s.channel for s in segments}:
        of_channel = [s for s in segments if s.channel == channel]
        chosen = [s for s in of_channel if not s.held_out] or of_channel
        spread = float(np.sqrt(np.mean(np.concatenate([s.measured for s in chosen]) ** 2)))
        scales[channel] = spread if spread > 0.0 else 1.0
    return scales


def numbers_of(model: Model, terms: tuple[Term, ...]) -> list[tuple[str, Number]]:
    """Key and number of everything shared in a model with these terms."""
    found = [(n.name, n) for n in model.numbers]
    return found + [(key(t, n), n) for t in terms for n in t.numbers]


def _differences(
    function: Callable[[Array], Array],
    theta: Array,
    at_theta: Array,
    frozen: Array | None = None,
) -> Array:
    jacobian = np.empty((at_theta.size, theta.size))
    known = 0 if frozen is None else frozen.shape[1]
    if frozen is not None:
        jacobian[:, :known] = frozen
    for j in range(known, theta.size):
        moved = theta.copy()
        moved[j] += STEP
        jacobian[:, j] = (function(moved) - at_theta) / STEP
    return jacobian


def counted(model: Model, residual: Array, segment: Segment) -> Array:
    """A residual as a fit counts it: whitened where the noise is known, else as it is.

    Where errors of force accumulate, old ones are forgotten: the position of a mass without spring
    walks off at random under every small error of the force; plain least squares would tune
    friction to that walk. A first-order high-pass with a memory of a tenth of the recording makes
    the walk nearly white (generalised least squares).
    """
    if segment.whitener is not None:
        return segment.whitened(residual)
    if not model.drifts:
        return residual
    keep = math.exp(-1.0 / (MEMORY * residual.size))
    return np.asarray(signal.lfilter([1.0, -1.0], [1.0, -keep], residual), np.float64)


def _bounded(value: float, number: Number) -> float:
    margin = 1e-3 * number.scale
    lower, upper = number.lower + margin, number.upper - margin
    return float(min(max(value, lower), upper)) if lower < upper else value


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
    shared = numbers_of(model, terms)
    own = [model.starts(s) for s in segments]
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    scales = channel_scales(segments)
    total = sum(segments[i].measured.size for i in fitted)
    known = all(s.whitener is not None for s in segments)
    weights = [(1.0 if known else 1.0 / scales[s.channel]) / math.sqrt(total) for s in segments]

    def beginning(i: int) -> Array:
        if starts is not None and starts[i].size == len(own[i]):
            return starts[i]
        return np.array([n.starts[0] for n in own[i]])

    first = len(shared)
    x0 = [_bounded(initial.get(k, n.starts[0]), n) / n.scale for k, n in shared]
    lower = [n.lower / n.scale for _, n in shared]
    upper = [n.upper / n.scale for _, n in shared]
    place = {}
    for i in fitted:
        place[i] = slice(len(x0), len(x0) + len(own[i]))
        for number, value in zip(own[i], beginning(i), strict=True):
            x0.append(value / number.scale)
            lower.append(number.lower / number.scale)
            upper.append(number.upper / number.scale)

    ends = np.cumsum([segments[i].measured.size for i in fitted])
    rows = {
        i: slice(int(end) - segments[i].measured.size, int(end))
        for i, end in zip(fitted, ends, strict=True)
    }

    jumps = may_jump(terms, segments)

    def values_of(theta: Array) -> dict[str, float]:
        return {k: float(theta[j] * n.scale) for j, (k, n) in enumerate(shared)}

    def start_of(theta: Array, i: int) -> Array:
        return np.asarray(theta[place[i]] * np.array([n.scale for n in own[i]]), np.float64)

    def error(values: Mapping[str, float], begin: Array, i: int) -> Array:
        segment = segments[i]
        predicted = model.predict(values, terms, begin, segment)
        left = segment.measured - predicted
        if jumps and known and segment.derivative == 2:
            _, speed = model.motion(values, terms, begin, segment)
            left = beside_turns(left, predicted, speed, LEAP * segment.noise)
        most = FARTHEST * scales[segment.channel]
        # a model that runs away is far off: finite, so that the fit turns back
        bounded = np.nan_to_num(left, nan=most, posinf=most, neginf=-most)
        return np.asarray(np.clip(bounded, -most, most))

    def left_of(values: Mapping[str, float], begin: Array, i: int) -> Array:
        return weights[i] * counted(model, error(values, begin, i), segments[i])

    def steady(theta: Array, j: int, i: int) -> Array:
        """Slope of one recording's residual as it counts, but for samples that jump."""
        here = error(values_of(theta), start_of(theta, i), i)
        ways = []
        for step in (STEP, -STEP):
            moved = theta.copy()
            moved[j] += step
            if lower[j] <= moved[j] <= upper[j]:
                ways.append((error(values_of(moved), start_of(moved, i), i) - here) / step)
        return weights[i] * counted(model, steady_slope(ways), segments[i])

    last: list[tuple[Array, Array]] = []

    def residual(theta: Array) -> Array:
        values = values_of(theta)

        def part(i: int) -> Array:
            return left_of(values, start_of(theta, i), i)

        whole = np.concatenate(by_recording(part, fitted, segments))
        last[:] = [*last[-2:], (theta.copy(), whole)]
        return whole

    def jacobian(theta: Array) -> Array:
        made = next((r for t, r in last if np.array_equal(t, theta)), None)
        at_theta = residual(theta) if made is None else made
        slopes = np.zeros((at_theta.size, theta.size))
        if jumps:
            given = 0 if frozen is None else frozen.shape[1]
            if frozen is not None:
                slopes[:, :given] = frozen
            for j in range(given, first):
                parts = by_recording(partial(steady, theta, j), fitted, segments)
                slopes[:, j] = np.concatenate(parts)
        else:
            slopes[:, :first] = _differences(
                lambda q: residual(np.concatenate([q, theta[first:]])),
                theta[:first],
                at_theta,
                frozen,
            )
        values = values_of(theta)

        def own_columns(i: int) -> None:
            for j in range(place[i].start, place[i].stop):
                if jumps:
                    slopes[rows[i], j] = steady(theta, j, i)
                    continue
                moved = theta.copy()
                moved[j] += STEP
                left = left_of(values, start_of(moved, i), i)
                slopes[rows[i], j] = (left - at_theta[rows[i]]) / STEP

        by_recording(own_columns, fitted, segments)
        return slopes

    theta = np.array(x0)
    frozen = None if slopes_of_first is None else slopes_of_first / math.sqrt(total)
    spent = 0
    if theta.size:
        solution = least_squares(
            residual,
            theta,
            jacobian,
            bounds=(np.array(lower), np.array(upper)),
            x_scale='jac',
            max_nfev=evaluations,
            ftol=tolerance,
            xtol=tolerance,
            gtol=1e-14,
        )
        theta, slopes, spent = solution.x, solution.jac, int(solution.nfev)
    else:
        slopes = np.zeros((total, 0))
    values = values_of(theta)
    begins: list[Array] = []
    residuals: list[Array] = []
    for i, segment in enumerate(segments):
        if i in place:
            begin = start_of(theta, i)
        else:
            begin = _own_beginning(model, terms, values, segment, beginning(i), weights[i])
        begins.append(begin)
        residuals.append(error(values, begin, i))
    left = np.concatenate([weights[i] * counted(model, residuals[i], segments[i]) for i in fitted])
    spread = _scatter(slopes, left, white=known)

    def forgiven() -> float:
        """What the uncertainty of the numbers excuses of the held-out recordings' misfit."""
        whole = theta
        for i in held_out:
            scale = np.array([n.scale for n in own[i]])
            place[i] = slice(whole.size, whole.size + len(own[i]))
            whole = np.concatenate([whole, begins[i] / scale])
            lower.extend(n.lower / n.scale for n in own[i])
            upper.extend(n.upper / n.scale for n in own[i])

        def rows_of(i: int) -> tuple[Array, Array, Array]:
            here = left_of(values, begins[i], i)
            chosen = [*range(first), *range(place[i].start, place[i].stop)]
            columns = np.empty((here.size, len(chosen)))
            for column, j in enumerate(chosen):
                if jumps:
                    columns[:, column] = steady(whole, j, i)
                    continue
                moved = whole.copy()
                moved[j] += STEP
                there = left_of(values_of(moved), start_of(moved, i), i)
                columns[:, column] = (there - here) / STEP
            unit = math.sqrt(total)
            return unit * here, unit * columns[:, :first], unit * columns[:, first:]

        return excused(math.sqrt(total) * slopes, first, [rows_of(i) for i in held_out])

    held_out = [i for i in range(len(segments)) if i not in place]
    mercy = forgiven() if known and held_out and first else 0.0
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
        excused=mercy,
    )


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

    theta = begin / scale
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
    residual = np.concatenate([base.residuals[i] / scales[segments[i].channel] for i in fitted])
    columns = []
    for k, n in shared:
        step = STEP * n.scale
        moved = {**base.values, k: base.values[k] + step}
        parts = [_moved(model, base, moved, i, segments[i]) for i in fitted]
        columns.append(
            np.concatenate(
                [p / scales[segments[i].channel] for p, i in zip(parts, fitted, strict=True)]
            )
            / STEP
        )
    sizes = [segments[i].measured.size for i in fitted]
    ends = np.cumsum(sizes)
    for which, i in enumerate(fitted):
        for j, n in enumerate(model.starts(segments[i])):
            begin = base.starts[i].copy()
            begin[j] += STEP * n.scale
            predicted = model.predict(base.values, base.terms, begin, segments[i])
            change = predicted - (segments[i].measured - base.residuals[i])
            column = np.zeros(residual.size)
            column[ends[which] - sizes[which] : ends[which]] = (
                change / scales[segments[i].channel] / STEP
            )
            columns.append(column)
    return residual, np.stack(columns, axis=1) if columns else np.zeros((residual.size, 0))


def _moved(
    model: Model, base: Fit, values: Mapping[str, float], i: int, segment: Segment
) -> Array:
    predicted = model.predict(values, base.terms, base.starts[i], segment)
    return predicted - (segment.measured - base.residuals[i])
