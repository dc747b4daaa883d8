"""Other minima of a finding's numbers: a law's shape may be told by more than one value.

Covariances come from the slope at one minimum. Where a yield, a speed or a frequency has a second
one that recordings cannot exclude, the interval about the first is too narrow. So a fit sets out
from either side of each such number; a better end replaces the fit, one about as good widens the
uncertainty of what differs.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence

from impactscope.discrepancy.answer import ParameterEstimate
from impactscope.discrepancy.impact.candidate import Candidate
from impactscope.discrepancy.impact.fit import Fit, fit
from impactscope.errors import ImpactscopeError

__all__ = ['other_modes', 'widened']

_APART = 1.6  # factor on a number, to either side
_NARROW = 1.12  # of a frequency: its minima lie closer
_BETTER = 0.1  # of chi-square
_OPEN = 8.0  # of chi-square, over the reduced one, up to which a mode is not excluded


def other_modes(final: Fit, candidates: Sequence[Candidate]) -> tuple[Fit, list[Fit]]:
    """The best fit, and others about as good, from either side of each number of a shape."""
    keys = [
        (number.key, _NARROW if number.key.endswith('.frequency') else _APART)
        for candidate in candidates
        if candidate.amplitudes and not candidate.channel
        for number in candidate.free
        if number.logarithmic and number.blow is None and number.key not in candidate.amplitudes
    ]
    found = [final]
    for key, factor in keys:
        j = final.model.index(key)
        lower, upper = final.model.bounds()
        for step in (math.log(factor), -math.log(factor)):
            x = final.x.copy()
            x[j] = min(max(x[j] + step, lower[j]), upper[j])
            with contextlib.suppress(ImpactscopeError):
                near = final if abs(step) < 0.2 else None
                found.append(fit(final.model, final.layout, x, settled=0.1, near=near))
    best = min(found, key=lambda f: f.chi_square)
    if best.chi_square > final.chi_square - _BETTER:
        best = final
    allowed = best.chi_square + _OPEN * max(1.0, best.reduced)
    return best, [f for f in found if f is not best and f.chi_square < allowed]


def widened(
    parameters: Mapping[str, ParameterEstimate], tag: str, best: Fit, modes: Sequence[Fit]
) -> dict[str, ParameterEstimate]:
    """Estimates with the spread among modes, each weighed by its likelihood."""
    result = dict(parameters)
    for name, item in parameters.items():
        key = f'{tag}.{name}'
        if key not in best.values or isinstance(item.value, str):
            continue
        variance = item.std**2
        for mode in modes:
            worse = (mode.chi_square - best.chi_square) / max(1.0, best.reduced)
            share = 1.0 / (1.0 + math.exp(0.5 * max(worse, 0.0)))
            variance += share * (mode.values[key] - item.value) ** 2
        result[name] = ParameterEstimate(item.value, math.sqrt(variance), item.unit)
    return result
