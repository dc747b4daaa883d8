"""Profile likelihood: how far a finding's numbers may go before chi-square rises enough.

Covariances come from slopes at the minimum. Dry friction, contacts and gaps make chi-square a
valley whose floor is rough: the slope at one point may be steeper than the valley is narrow. So
each number is moved to where chi-square should have risen by four, the others re-tuned; where it
has risen by less, the number is known less well by as much. That is the profile likelihood (Venzon
and Moolgavkar, Appl. Stat. 37, 1988).
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.fits.least_squares import Fit, at_point, fit, settled
from impactscope.discrepancy.time_limit import time_left
from impactscope.errors import ImpactscopeError

__all__ = ['profiled']

Array = NDArray[np.float64]

_AWAY = 2.0  # standard deviations, to either side
_AS_FORESEEN = (3.2, 5.0)  # of chi-square, about the four that slopes say
_NEAR = (2.5, 6.5)  # of chi-square, between which the end of an interval is known
_LONGER, _SHORTER = 3.0, 0.4  # times a step at once
_ROUNDS = 3
_TUNED = 3  # steps of the other numbers
_WORTH = 0.05  # of chi-square, of such a step
_LEAST = 0.25  # of chi-square, that a rise counts as
_BETTER = 0.5  # of chi-square, from which a lower point is another minimum
_AGAIN = 2  # times that a fit is taken up from a lower point


def profiled(found: Fit, candidates: Sequence[Candidate]) -> tuple[Fit, dict[str, float]]:
    """The best fit met on the way, and how many times less well than by slopes a number is known.

    Args:
        found: the final fit, with its exact slopes.
        candidates: the findings whose numbers are looked at.

    Returns:
        The fit, or a better one that a number moved away has led to; and by the key of each
        number of a finding that all blows share the factor on its standard deviation, at least
        one.
    """
    keys = [
        number.key
        for candidate in candidates
        for number in candidate.free
        if number.blow is None and number.key in {f.key for f in found.model.free}
    ]
    for again in range(_AGAIN + 1):
        factors: dict[str, float] = {}
        covariance = found.covariance()
        lower: Fit | None = None
        for key in keys:
            if not time_left('how far its numbers may go'):
                break
            factors[key], lower = _factor(found, found.model.index(key), covariance)
            if lower is not None:
                break
        if lower is None or again == _AGAIN:
            break
        better = fit(found.model, found.layout, lower.x, settled=0.1)
        if better.chi_square > found.chi_square - _BETTER:
            break
        found = settled(better)
    return found, {key: factors.get(key, 1.0) for key in keys}


def _factor(found: Fit, j: int, covariance: Array) -> tuple[float, Fit | None]:
    """Factor on the standard deviation of a number; and a point that is lower than the fit."""
    std = math.sqrt(max(float(covariance[j, j]), 0.0))
    if not std > 0.0:
        return 1.0, None
    spread = max(1.0, found.reduced)
    others = np.array([k for k in range(found.x.size) if k != j])
    scale = np.maximum(np.linalg.norm(found.jacobian[:, others], axis=0), 1e-300)
    inverse = np.linalg.pinv(found.jacobian[:, others] / scale, rcond=1e-10) / scale[:, None]
    low, high = found.model.bounds()
    factor = 1.0
    for side in (1.0, -1.0):
        step = _AWAY * std
        for _ in range(_ROUNDS):
            x = found.x + side * step * covariance[:, j] / std**2
            if not low[j] < x[j] < high[j]:
                break
            with contextlib.suppress(ImpactscopeError, OverflowError, ZeroDivisionError):
                there = at_point(found.model, found.layout, np.clip(x, low, high))
                rise = (there.chi_square - found.chi_square) / spread
                as_foreseen = _AS_FORESEEN[0] < rise < _AS_FORESEEN[1]
                if as_foreseen and step == _AWAY * std:
                    break
                there = _tuned(there, others, inverse)
                rise = (there.chi_square - found.chi_square) / spread
                if rise < -_BETTER:
                    return factor, there
                factor = max(factor, step / (std * math.sqrt(max(rise, _LEAST))))
                if _NEAR[0] < rise:
                    break
                step *= min(_LONGER, _AWAY / math.sqrt(max(rise, _LEAST)))
                continue
            break
    return factor, None


def _tuned(there: Fit, others: NDArray[np.int64], inverse: Array) -> Fit:
    """The other numbers re-tuned by the slopes at the minimum."""
    low, high = there.model.bounds()
    for _ in range(_TUNED):
        x = there.x.copy()
        x[others] = np.clip(x[others] - inverse @ there.residuals, low[others], high[others])
        trial = at_point(there.model, there.layout, x)
        if trial.chi_square > there.chi_square - _WORTH:
            break
        there = trial
    return there
