"""What pulls an impactor, by when it comes back: met within a contact's time or not at all.

No slope of the misfit leads from one moment to another. So amounts are scanned, and fits set out
from the places that meet the return least badly. A scan misses a short contact: the moment of that
is aimed at.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.fits.least_squares import Fit, at_point, raced
from impactscope.discrepancy.impact.models.bench_model import ImpactModel, Layout
from impactscope.discrepancy.impact.search.outcome import QUIET
from impactscope.discrepancy.impact.search.screening import Screening
from impactscope.discrepancy.parallel import in_parallel
from impactscope.errors import ImpactscopeError
from impactscope.physics.mechanisms.mechanism import Subsystem

__all__ = ['from_return', 'only_a_return_is_missed', 'swept']

Array = NDArray[np.float64]

_PULLS = ('external_push', 'restoring_force', 'gravity_load')  # tell when an impactor returns
_SHARES = np.geomspace(0.01, 100.0, 41).tolist()
_AMOUNTS = (*(-x for x in reversed(_SHARES)), *_SHARES)  # of a pull, over the one it starts from
_FROM_AMOUNTS = 2  # places of these from which fits set out
_FROM_SCANNED, _FROM_AIMED = 4, 6  # of all places that are met so, and that are aimed at
_AIMS = 3  # returns that are aimed at
_STRIDE = 4  # steps of these amounts between those tried, and ...
_HALVED = 14  # times a step is halved
_AWAY = 6.0  # times its noise
_BEGAN = (0.01, 0.02)  # s after the onset, of a push
_RUN, _MISSED = 5, 20.0  # bins, and their mean square that noise does not leave
_LATER = 0.1  # s after the onset, from which a return is looked for
_SWEPT = (-3.0, -2.0, -1.3, -0.7, 0.7, 1.3, 2.0, 3.0)  # standard deviations
_SCANNED = tuple(float(x) for x in np.linspace(-3.0, 3.0, 121))  # likewise, without fits
_ENDED = tuple(float(x) for x in np.geomspace(1.0, 0.01, 61))  # of a ramp, where it may end
_FROM_SCAN = 4  # places of these two from which fits set out
_HEAT, _GO_ON, _LAST = 6, 4, 30  # iterations of each fit; of those that are best, and how many


@dataclass(frozen=True, slots=True, eq=False)
class _Return:
    """A return that a simulation without a pull misses."""

    blow: int
    moment: float  # at which it is first seen, s
    without: Mapping[str, Array]  # means of the bins as they are simulated, by channel


def only_a_return_is_missed(found: Fit) -> bool:
    """Whether a fit leaves noise alone but for a few bins, long after a blow."""
    early = 0.0
    size, missed = 0, False
    for (i, name), span in found.layout.spans.items():
        blow = found.model.data.blows[i]
        mask = found.layout.masks[i, name]
        late = blow.channels[name].centres[mask] > blow.onset + _LATER
        left = found.residuals[span] ** 2
        early += float(np.sum(left[~late]))
        size += int(np.count_nonzero(~late))
        if name != 'acceleration.impactor' and np.count_nonzero(late) >= _RUN:
            missed |= bool(np.max(ndimage.uniform_filter1d(left[late], _RUN)) > _MISSED)
    return missed and early < QUIET * size


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
    returns = _returns(place)
    found: list[tuple[Candidate, Fit]] = []
    for candidate in listed:
        if candidate.name not in _PULLS or len(candidate.amplitudes) != 1 or candidate.parameter:
            continue
        ((key, absent),) = candidate.amplitudes.items()
        model = candidate.extend(place.model)
        number = next(f for f in model.free if f.key == key)
        scanned: list[Array] = []
        aimed: list[Array] = []
        for start in _starts(candidate):
            size = abs(start.get(key, number.start) - absent)
            amounts = [absent + size * share for share in _AMOUNTS]
            amounts = [a for a in amounts if number.lower <= a <= number.upper]
            at = functools.partial(_with_amount, screening, model, start, key)
            aimed += _aimed(place, returns, model, amounts, at)
            if start in candidate.starts:
                places = [at(a) for a in amounts]
                scanned += _least(model, place.layout, places, _FROM_AMOUNTS)
        begins = [
            *_nearest(model, place.layout, scanned, _FROM_SCANNED),
            *_nearest(model, place.layout, aimed, _FROM_AIMED),
        ]
        best = _best(model, place.layout, begins, 0.05)
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
    left = np.asarray(in_parallel(lambda x: _misfit(model, layout, x), scan))
    inner = np.flatnonzero((left[1:-1] <= left[:-2]) & (left[1:-1] < left[2:])) + 1
    return [scan[i] for i in inner[np.argsort(left[inner])][:most]]


def _with_amount(
    screening: Screening, model: ImpactModel, start: Mapping[str, float], key: str, amount: float
) -> Array:
    return screening.vector(model, {**start, key: amount})


def _starts(candidate: Candidate) -> list[dict[str, float]]:
    """Starts of a candidate; of a push with its beginning within the contact as well."""
    began = f'{candidate.label}.start'
    found = [dict(start) for start in candidate.starts]
    if any(began in start for start in found):
        early = [s for s in found if s.get(began) == 0.0]
        found += [{**s, began: moment} for s in early for moment in _BEGAN]
    return found


def _aimed(
    place: Fit,
    returns: Sequence[_Return],
    model: ImpactModel,
    amounts: Sequence[float],
    at: Callable[[float], Array],
) -> list[Array]:
    """Places at which a blow's impactor comes back when it did.

    When a blow departs from what is simulated without a pull, measured or simulated with it, is
    when the impactor is back: the sooner the stronger the pull.
    """

    def too_late(missed: _Return, amount: float) -> bool:
        try:
            pulled = model.predict(model.values(at(amount)), missed.blow).means
        except ImpactscopeError:
            return False
        apart = {name: means - missed.without[name] for name, means in pulled.items()}
        return _departs(place, missed.blow, apart) > missed.moment

    pulls, pushes = [a for a in amounts if a > 0.0], [a for a in reversed(amounts) if a < 0.0]
    met = [
        _halved(functools.partial(too_late, missed), side[::_STRIDE])
        for missed, side in itertools.product(returns, (pulls, pushes))
    ]
    return [at(amount) for amount in met if amount is not None]


def _halved(too_late: Callable[[float], bool], tried: Sequence[float]) -> float | None:
    """The weakest amount that is not too weak, by halving; None where it is not among these.

    ``tried``: of one sign, the weakest first.
    """
    late = [too_late(amount) for amount in tried]
    if all(late) or not late[0]:
        return None
    weak, strong = tried[late.index(False) - 1], tried[late.index(False)]
    for _ in range(_HALVED):
        middle = math.copysign(math.sqrt(weak * strong), strong)
        weak, strong = (middle, strong) if too_late(middle) else (weak, middle)
    return strong


def _returns(place: Fit) -> list[_Return]:
    """Returns that a fit misses; those of the longest ways first."""
    found = []
    for i in place.layout.blows:
        without = place.model.predict(place.values, i).means
        channels = place.model.data.blows[i].channels
        moment = _departs(place, i, {n: c.means - without[n] for n, c in channels.items()})
        if math.isfinite(moment):
            found.append(_Return(i, moment, without))
    onsets = [b.onset for b in place.model.data.blows]
    return sorted(found, key=lambda r: r.moment - onsets[r.blow], reverse=True)[:_AIMS]


def _departs(place: Fit, i: int, apart: Mapping[str, Array]) -> float:
    """Moment long after a blow from which the bench is away from a simulation, s; or infinity."""
    blow = place.model.data.blows[i]
    moments = [math.inf]
    for name, channel in blow.channels.items():
        if name != 'acceleration.impactor' and (i, name) in place.layout.masks:
            mask = place.layout.masks[i, name] & (channel.centres > blow.onset + _LATER)
            away = np.flatnonzero(np.abs(apart[name][mask]) > _AWAY * channel.own_std[mask])
            if away.size:
                moments.append(float(channel.centres[mask][away[0]]))
    return min(moments)


def _misfit(model: ImpactModel, layout: Layout, x: Array) -> float:
    try:
        return at_point(model, layout, x).chi_square
    except ImpactscopeError:
        return math.inf


def _nearest(model: ImpactModel, layout: Layout, begins: list[Array], most: int) -> list[Array]:
    """The places from which least is left."""
    if len(begins) <= most:
        return begins
    left = in_parallel(lambda x: _misfit(model, layout, x), begins)
    return [begins[i] for i in np.argsort(left)[:most]]


def _best(
    model: ImpactModel, layout: Layout, begins: Sequence[Array], settled: float
) -> Fit | None:
    """The best fit from any of some places; None where none can be simulated."""
    fits = raced(
        model, layout, begins, most=_GO_ON, iterations=(_HEAT, _LAST), settled=(settled, settled)
    )
    return min(fits, key=lambda f: f.chi_square, default=None)
