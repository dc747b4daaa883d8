"""Linearisation of a fit: its whitened residual, and what its numbers can re-tune."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.fits.friction_jumps import may_jump, steady_slope
from impactscope.discrepancy.driven.fits.innovations import innovations
from impactscope.discrepancy.driven.fits.orthonormal import orthonormal
from impactscope.discrepancy.driven.fits.recordings_in_parallel import by_recording
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.fits.weighted_residuals import numbers_of, step_of
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import Term

__all__ = ['Linearisation', 'change', 'linearised']

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """A fit's whitened residual and what its numbers can re-tune, on the fitted recordings."""

    residual: Array  # projected, shape (n,)
    basis: Array  # orthonormal rows, shape (k, n)
    slopes: Array  # of the prediction by the fit's shared numbers over their scales, (n, k)

    def explained(self, columns: Array) -> tuple[float, Array]:
        """Chi-square that columns, shape (c, n), could take away, and by which factors."""
        seen = columns @ self.basis.T
        gram = columns @ columns.T - seen @ seen.T
        along = columns @ self.residual
        size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        factors = np.linalg.lstsq(gram / np.outer(size, size), along / size, rcond=1e-9)[0] / size
        return float(factors @ along), np.asarray(factors)

    def taken(self, column: Array) -> float:
        """Chi-square that a change, shape (n,), takes away as it is."""
        seen = self.basis @ column
        return float(2.0 * (column @ self.residual) - column @ column + seen @ seen)


def linearised(model: Model, made: Fit, segments: Sequence[Segment]) -> Linearisation:
    """Linear picture of a fit."""
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    residual = np.concatenate([innovations(segments[i], made.residuals[i]) for i in fitted])
    columns = []
    share = step_of(model, made.terms, segments, float(np.mean(residual**2)))
    for name, number in numbers_of(model, made.terms):
        step = share * number.scale
        moved = {**made.values, name: made.values[name] + step}
        if may_jump(made.terms, segments):
            back = {**made.values, name: made.values[name] - step}
            ways = [moved] if back[name] < number.lower else [moved, back]
            columns.append(_steady(model, made, ways, segments) / share)
        else:
            columns.append(change(model, made, made.terms, moved, segments) / share)
    shared = np.stack(columns, axis=1) if columns else np.zeros((residual.size, 0))
    columns += _beginnings(model, made, segments, share)
    if not columns:
        none = np.zeros((residual.size, 0))
        return Linearisation(residual, none.T, none)
    matrix = np.stack(columns, axis=1)
    basis = np.ascontiguousarray(orthonormal(matrix).T)
    return Linearisation(residual - basis.T @ (basis @ residual), basis, shared)


def _beginnings(model: Model, made: Fit, segments: Sequence[Segment], step: float) -> list[Array]:
    """Whitened changes of the prediction by every recording's own beginning, each shape (n,)."""
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    ends = np.cumsum([segments[i].measured.size for i in fitted])
    columns = []
    for i, end in zip(fitted, ends, strict=True):
        s = segments[i]
        for j, number in enumerate(model.starts(s)):
            begin = made.starts[i].copy()
            begin[j] += step * number.scale
            predicted = model.predict(made.values, made.terms, begin, s)
            column = np.zeros(int(ends[-1]))
            moved = innovations(s, predicted - (s.measured - made.residuals[i]))
            column[end - s.measured.size : end] = moved / step
            columns.append(column)
    return columns


def _steady(
    model: Model, made: Fit, ways: Sequence[Mapping[str, float]], segments: Sequence[Segment]
) -> Array:
    """Whitened change of the prediction by a step forwards, but for samples that jump, (n,)."""

    def part(i: int) -> Array:
        segment = segments[i]
        before = segment.measured - made.residuals[i]
        moved = [model.predict(v, made.terms, made.starts[i], segment) - before for v in ways]
        return innovations(segment, steady_slope([moved[0], *(-x for x in moved[1:])]))

    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    return np.concatenate(by_recording(part, fitted, segments))


def change(
    model: Model,
    made: Fit,
    terms: tuple[Term, ...],
    values: Mapping[str, float],
    segments: Sequence[Segment],
) -> Array:
    """Whitened change of the prediction on the fitted recordings, shape (n,)."""

    def part(i: int) -> Array:
        segment = segments[i]
        predicted = model.predict(values, terms, made.starts[i], segment)
        return innovations(segment, predicted - (segment.measured - made.residuals[i]))

    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    return np.concatenate(by_recording(part, fitted, segments))
