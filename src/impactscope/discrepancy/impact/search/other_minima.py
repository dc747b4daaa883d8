"""Other minima of a finding's numbers: more than one value may tell the shape of a law.

Covariances come from the slope at one minimum. Where a yield, a speed or a frequency has a second
one that recordings cannot exclude, the interval about the first is too narrow. So a fit sets out
from either side of each such number; a better end replaces the fit, one about as good widens the
uncertainty of what differs. A part that rings weakly has minima all over the spectrum: its
frequency is scanned.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.answer import ParameterEstimate
from impactscope.discrepancy.evidence import spread_over_minima
from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.candidates.motion_scales import LARGEST_FREQUENCY
from impactscope.discrepancy.impact.fits.least_squares import Fit, fit, fits_from
from impactscope.discrepancy.impact.search.screening import Screening, Trial
from impactscope.discrepancy.processes import in_processes
from impactscope.discrepancy.time_limit import time_left
from impactscope.errors import ImpactscopeError

__all__ = ['lowest', 'other_modes', 'rung', 'scanned', 'weighed_by_width', 'widened']

Array = NDArray[np.float64]

_OTHER_VALUES = 'other values of what was found'
_ALONE, _ALONE_FREQUENCY = (1.6,), (1.12,)  # factors on a number, to either side
_ALONG, _ALONG_FREQUENCY = (1.6,), (1.7, 2.9)  # the same, the others moved along
_BETTER = 0.1  # of chi-square
_HEAT, _ROUGHLY = 10, 1.0  # iterations of a fit from each start, and the fall at which it ends
_BEHIND = 100.0  # of chi-square, over the reduced one, from which no end makes up for it
_LAST, _SETTLED = 25, 0.1  # the same of fits that are brought to their end
_NEAR = 0.2  # change of a logarithm, up to which slopes serve for another start
_OPEN = 8.0  # of -2 log of its probability, over the likeliest, up to which a mode is not excluded
_LUCK = 15.0  # of chi-square, over the reduced one, that a wide minimum may be behind a narrow one
_EARLY = 0.1  # s after the onset, up to which contacts have amplified little
_STRIDE = 4.0  # standard deviations
_ALIKE = 0.3  # standard deviations, between two fits that are one
_LOWEST = 15.0  # Hz, from which a frequency is scanned
_APART = 0.04  # of its logarithm, between two that are tried where a line is narrow
_BROADER = (1.0, 4.0)  # times the damping it starts from
_PEAKS = 3  # that are followed, of each damping


def rung(without: Fit, candidate: Candidate) -> list[dict[str, float]]:
    """All numbers of a model with a candidate that rings, at the frequencies that explain most.

    ``without``: the fit that lacks it. Nothing where the candidate has no frequency.
    """
    return [t.model.values(t.x) for t in scanned(Screening(without), candidate)]


def scanned(screening: Screening, candidate: Candidate) -> list[Trial]:
    """A candidate that rings, tried at the frequencies that explain most, narrow lines and broad.

    Nothing where it has no frequency.
    """
    key, ratio = f'{candidate.label}.frequency', f'{candidate.label}.damping_ratio'
    number = next((f for f in candidate.free if f.key == key), None)
    if number is None:
        return []
    highest = min(number.upper, LARGEST_FREQUENCY)
    start = dict(candidate.starts[0])
    tops: list[Trial] = []
    for broader in _BROADER if ratio in start else _BROADER[:1]:
        at = start if broader == 1.0 else {**start, ratio: broader * start[ratio]}
        count = round(math.log(highest / _LOWEST) / (_APART * broader))
        grid = np.geomspace(_LOWEST, highest, count)
        tops += screening.peaks(candidate, [{**at, key: float(f)} for f in grid])[:_PEAKS]
    return in_processes(lambda t: screening.best_refined([t]), tops)


def other_modes(
    final: Fit, candidates: Sequence[Candidate], further: Sequence[Mapping[str, float]] = ()
) -> tuple[Fit, list[Fit]]:
    """The best fit, and others about as good, from either side of each number of a shape.

    Where a moment is one of them, also from the shapes that the search set out from.

    ``further``: numbers by key, of other starts.
    """
    acting = [c for c in candidates if c.amplitudes and not c.channel]
    shape = [number for c in acting for number in c.shape]
    keys = [number.key for number in shape]
    starts = [x for f in shape if f.logarithmic for x in _starts(final, f.key)]
    near = [final if float(np.max(np.abs(x - final.x))) < _NEAR else None for x in starts]
    elsewhere = [*further, *(known for c in acting for known in _moments(c))]
    starts += [final.model.vector({**final.values, **values}) for values in elsewhere]
    near += [None] * len(elsewhere)
    found = [final]
    if starts and time_left(_OTHER_VALUES):
        model, layout = final.model, final.layout
        rough = fits_from(model, layout, starts, settled=_ROUGHLY, iterations=_HEAT, near=near)
        most = final.chi_square + _BEHIND * max(1.0, final.reduced)
        ahead = [f.x for f in rough if f.chi_square < most]
        found += fits_from(model, layout, ahead, settled=_SETTLED, iterations=_LAST)
    best = min(found, key=lambda f: f.chi_square)
    if best.chi_square > final.chi_square - _BETTER:
        best = final
    allowed = best.chi_square + (_OPEN + _LUCK) * max(1.0, best.reduced)
    modes: list[Fit] = []
    for mode in sorted(found, key=lambda f: f.chi_square):
        if mode is best or mode.chi_square > allowed:
            continue
        if not any(_same(mode, other, keys) for other in (best, *modes)):
            modes.append(mode)
    return best, modes


def _moments(candidate: Candidate) -> list[dict[str, float]]:
    """A shape with a moment in it as each start has it: no factor leads to another moment."""
    if all(number.logarithmic for number in candidate.shape):
        return []
    keys = {number.key for number in candidate.shape}
    return [{k: v for k, v in start.items() if k in keys} for start in candidate.starts]


def lowest(found: Fit, candidates: Sequence[Candidate]) -> Fit:
    """The lowest minimum that is seen nearby, of a fit with candidates.

    Later contacts fold the ground that a fit has to cross: a short window shows where to cross it,
    and so do some steps along the valley of each number.
    """
    model, layout = found.model, found.layout
    tried = [found, other_modes(found, candidates)[0]]
    strides = list(_strides(found, candidates))
    tried += fits_from(model, layout, strides, settled=_SETTLED, iterations=_LAST)
    with contextlib.suppress(ImpactscopeError):
        early = fit(model, model.layout(layout.blows, _EARLY), found.x, settled=_SETTLED)
        tried.append(fit(model, layout, early.x, settled=_SETTLED))
    return min(tried, key=lambda f: f.chi_square)


def _strides(found: Fit, candidates: Sequence[Candidate]) -> Iterator[Array]:
    """Some standard deviations along the valley of each number of candidates, to either side."""
    covariance = found.covariance()
    lower, upper = found.model.bounds()
    for number in (f for c in candidates for f in c.free if f.blow is None):
        j = found.model.index(number.key)
        if covariance[j, j] > 0.0:
            stride = _STRIDE / math.sqrt(covariance[j, j]) * covariance[:, j]
            for sign in (1.0, -1.0):
                yield np.clip(found.x + sign * stride, lower, upper)


def _starts(final: Fit, key: str) -> Iterator[Array]:
    """Starts to either side of a number, alone and with the others as its slope wants them.

    What rings far above all motion shows its stiffness alone: only a start that keeps it leads
    along such a valley.
    """
    j, frequency = final.model.index(key), key.endswith('.frequency')
    lower, upper = final.model.bounds()
    alone = np.zeros(final.x.size)
    alone[j] = 1.0
    covariance = final.covariance()
    along = covariance[:, j] / covariance[j, j] if covariance[j, j] > 0.0 else alone
    for factors, moves in (
        (_ALONE_FREQUENCY if frequency else _ALONE, alone),
        (_ALONG_FREQUENCY if frequency else _ALONG, along),
    ):
        for factor, sign in itertools.product(factors, (1.0, -1.0)):
            yield np.clip(final.x + sign * math.log(factor) * moves, lower, upper)


def _same(mode: Fit, other: Fit, keys: Sequence[str]) -> bool:
    """Whether two fits stand in one minimum, as far as the numbers of a shape go.

    At a bend of the motion slopes may tell nothing: the surer of the two says what is near.
    """
    return all(
        abs(mode.values[k] - other.values[k]) <= _ALIKE * min(mode.std(k), other.std(k))
        for k in keys
    )


def widened(
    parameters: Mapping[str, ParameterEstimate],
    tag: str,
    best: Fit,
    modes: Sequence[Fit],
    factors: Mapping[str, float],
) -> dict[str, ParameterEstimate]:
    """Estimates whose 95 % interval holds 95 % of what the recordings leave likely.

    Args:
        parameters: as the best fit has them.
        tag: of their keys.
        best: the final fit.
        modes: other fits about as good, each weighed by its probability, see
            :func:`weighed_by_width`.
        factors: by key, how many times less well a number is known than slopes say.
    """
    likely = weighed_by_width(best, modes, tag)
    result = dict(parameters)
    for name, item in parameters.items():
        key = f'{tag}.{name}'
        if key not in best.values or isinstance(item.value, str) or not item.std > 0.0:
            continue
        std = factors.get(key, 1.0) * item.std
        away = [0.0, *(abs(mode.values[key] - item.value) for mode in modes)]
        # where slopes tell nothing in another minimum, no more than the way to the farthest one
        most = max(std, *away)
        stds = [std, *(min(mode.std(key) or std, most) for mode in modes)]
        result[name] = ParameterEstimate(
            item.value, spread_over_minima(stds, away, likely), item.unit
        )
    return result


def weighed_by_width(best: Fit, modes: Sequence[Fit], tag: str) -> list[float]:
    """Probability of each minimum over that of the likeliest; ``best`` first.

    A minimum counts by its depth and by its width. Noise makes a narrow line at one of many
    frequencies: it is deep, and few values lie in it (Laplace's method; MacKay, "Information
    Theory, Inference, and Learning Algorithms", 2003, chapter 27).
    """
    spread = max(1.0, best.reduced)
    weights = [_width(f, tag) - 0.5 * f.chi_square / spread for f in (best, *modes)]
    most = max(weights)
    likely = [math.exp(w - most) for w in weights]
    excluded = math.exp(-0.5 * _OPEN)
    return [share if share > excluded else 0.0 for share in likely]


def _width(found: Fit, tag: str) -> float:
    """Log of the volume that an effect's numbers may take, none wider than what is tried of it."""
    free = found.model.free
    own = [j for j, f in enumerate(free) if f.key.startswith(f'{tag}.') and f.blow is None]
    if not own:
        return 0.0
    lower, upper = found.model.bounds()
    tried = (upper[own] - lower[own]) / math.sqrt(12.0)
    covariance = found.covariance()[np.ix_(own, own)]
    unit = np.where(np.isfinite(tried), tried, [free[j].scale for j in own])
    told = np.flatnonzero(np.diag(covariance) > 0.0)  # where it has no slope, nothing is told
    precision = np.diag(np.where(np.isfinite(tried), 1.0, 0.0))
    inner = covariance[np.ix_(told, told)] / np.outer(unit[told], unit[told])
    precision[np.ix_(told, told)] += np.linalg.pinv(inner, rcond=1e-14, hermitian=True)
    return -0.5 * float(np.linalg.slogdet(precision)[1])
