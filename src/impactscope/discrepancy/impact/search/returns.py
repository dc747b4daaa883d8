"""What pulls an impactor, by when it comes back: met within a contact's time or not at all.

No slope leads from one moment to another. So amounts are scanned, and fits set out from the places
that meet the return least badly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.fits.least_squares import Fit, at_point, raced
from impactscope.discrepancy.impact.models.bench_model import ImpactModel, Layout
from impactscope.discrepancy.impact.search.screening import Screening
from impactscope.discrepancy.parallel import in_parallel
from impactscope.errors import ImpactscopeError
from impactscope.physics.mechanisms.mechanism import Subsystem

__all__ = ['from_return', 'swept']

Array = NDArray[np.float64]

_PULLS = ('external_push', 'restoring_force', 'gravity_load')  # tell when an impactor returns
_SHARES = np.geomspace(0.01, 100.0, 41).tolist()
_AMOUNTS = (*(-x for x in reversed(_SHARES)), *_SHARES)  # of a pull, over the one it starts from
_FROM_AMOUNTS = 2  # places of these from which fits set out
_SWEPT = (-3.0, -2.0, -1.3, -0.7, 0.7, 1.3, 2.0, 3.0)  # standard deviations
_SCANNED = tuple(float(x) for x in np.linspace(-3.0, 3.0, 121))  # likewise, without fits
_ENDED = tuple(float(x) for x in np.geomspace(1.0, 0.01, 61))  # of a ramp, where it may end
_FROM_SCAN = 4  # places of these two from which fits set out
_HEAT, _GO_ON, _LAST = 6, 4, 12  # iterations of each fit; of those that are best, and how many


def from_return(place: Fit, listed: Sequence[Candidate]) -> list[tuple[Candidate, Fit]]:
    """What pulls an impactor, by the amount that lets it come back when it did; best first.

    A pull hardly shows before the impactor returns, and then by when it does: that is met within
    a contact's time or not at all, and no slope leads to it. So amounts are tried one by one.

    Args:
        place: the model without them, up to a return that it misses; at numbers that have met
            everything before.
        listed: candidates.
    """
    screening = Screening(place)
    found: list[tuple[Candidate, Fit]] = []
    for candidate in listed:
        if candidate.name not in _PULLS or len(candidate.amplitudes) != 1 or candidate.parameter:
            continue
        ((key, absent),) = candidate.amplitudes.items()
        model = candidate.extend(place.model)
        number = next(f for f in model.free if f.key == key)
        begins: list[Array] = []
        for start in candidate.starts:
            size = abs(start.get(key, number.start) - absent)
            amounts = [absent + size * share for share in _AMOUNTS]
            amounts = [a for a in amounts if number.lower <= a <= number.upper]
            scan = [screening.vector(model, {**start, key: a}) for a in amounts]
            begins += _least(model, place.layout, scan, _FROM_AMOUNTS)
        best = _best(model, place.layout, begins, 0.5)
        if best is not None:
            found.append((candidate, best))
    return sorted(found, key=lambda item: item[1].chi_square)


def swept(before: Fit, grown: Fit, accepted: Sequence[Candidate]) -> Fit:
    """The fit of a longer window from amounts to either side of what a shorter one told.

    When an impactor comes back is told by what pulls it. Where a shorter window leaves that open
    by more than a contact lasts, no slope leads from one moment to the other.

    Args:
        before: the fit of the shorter window.
        grown: that of the longer one, which misses it.
        accepted: findings; of these, those of the impactor are tried.
    """
    keys = [f.key for f in before.model.free]
    if keys != [f.key for f in grown.model.free]:
        return grown
    covariance = before.covariance()
    pulls = [c for c in accepted if c.subsystem == Subsystem.IMPACTOR.value]
    begins = _ramps(before, grown, pulls)
    amounts = {k for c in pulls for k in c.amplitudes if k in keys}
    for j in (keys.index(k) for k in sorted(amounts)):
        if not covariance[j, j] > 0.0:
            continue
        along = covariance[:, j] / math.sqrt(covariance[j, j])
        scan = [_moved(before, far * along) for far in _SCANNED]
        begins += [_moved(before, far * along) for far in _SWEPT]
        begins += _least(grown.model, grown.layout, scan, _FROM_SCAN)
    best = _best(grown.model, grown.layout, begins, 0.02)
    return grown if best is None else min(grown, best, key=lambda f: f.chi_square)


def _ramps(before: Fit, grown: Fit, pulls: Sequence[Candidate]) -> list[Array]:
    """Pushes that rise as steeply and end sooner: a ramp does not tell how far it goes."""
    begins: list[Array] = []
    for candidate in pulls:
        force, rise = (f'{candidate.label}.{n}' for n in ('force', 'rise'))
        values = before.values
        if force not in values or rise not in values:
            continue
        ends = ({force: share * values[force], rise: share * values[rise]} for share in _ENDED)
        scan = [before.model.vector({**values, **end}) for end in ends]
        begins += _least(grown.model, grown.layout, scan, _FROM_SCAN)
    return begins


def _moved(found: Fit, by: Array) -> Array:
    """Numbers of a fit that are changed, within their bounds: some may be known by no means."""
    return np.asarray(np.clip(found.x + by, *found.model.bounds()))


def _least(model: ImpactModel, layout: Layout, scan: Sequence[Array], most: int) -> list[Array]:
    """Places of a scan from which the misfit rises to either side; the least first."""

    def misfit(x: Array) -> float:
        try:
            return at_point(model, layout, x).chi_square
        except ImpactscopeError:
            return math.inf

    left = np.asarray(in_parallel(misfit, scan))
    inner = np.flatnonzero((left[1:-1] <= left[:-2]) & (left[1:-1] < left[2:])) + 1
    return [scan[i] for i in inner[np.argsort(left[inner])][:most]]


def _best(
    model: ImpactModel, layout: Layout, begins: Sequence[Array], settled: float
) -> Fit | None:
    """The best fit from any of some places; None where none can be simulated."""
    fits = raced(
        model, layout, begins, most=_GO_ON, iterations=(_HEAT, _LAST), settled=(settled, settled)
    )
    return min(fits, key=lambda f: f.chi_square, default=None)
