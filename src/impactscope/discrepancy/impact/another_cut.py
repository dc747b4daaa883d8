"""Findings that taps alone suggest, looked at again with the taps cut later.

The force of a tap is not known, and its end is read from the samples. Where it is read a sample
too early, the last of the hammer's push is taken for something that the bench does of its own.
What the bench does, it goes on doing; a hammer does not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impactscope.discrepancy.evidence import Thresholds
from impactscope.discrepancy.impact.candidate import Candidate
from impactscope.discrepancy.impact.fit import Fit, fit
from impactscope.discrepancy.impact.outcome import Outcome, weigh, with_findings

__all__ = ['drop_what_a_tap_ends_with']

_BY_BLOWS = 0.1  # of the evidence, from which it is not that of taps alone
_LATER = 0.5  # of the length of a tap, by which it is cut later
_AT_LEAST = 2e-3  # s


def drop_what_a_tap_ends_with(outcome: Outcome, thresholds: Thresholds) -> None:
    """Take out findings that only samples right after the taps bear out."""
    for candidate in list(outcome.accepted):
        rest = [c for c in outcome.accepted if c is not candidate]
        if not candidate.free or not _hangs_on_ends(outcome, candidate, rest, thresholds):
            continue
        outcome.accepted.remove(candidate)
        outcome.final = with_findings(outcome, rest, outcome.final.layout)
        outcome.tests = None


def _hangs_on_ends(
    outcome: Outcome, candidate: Candidate, rest: Sequence[Candidate], thresholds: Thresholds
) -> bool:
    final = outcome.final
    blows = final.model.data.blows
    taps = [i for i in final.layout.blows if blows[i].recording.kind == 'tap']
    if not taps or len(taps) == len(final.layout.blows):
        return False
    without = with_findings(outcome, rest, final.layout)
    gain = without.chi_square - final.chi_square
    struck = sum(
        _power(without, i) - _power(final, i) for i in final.layout.blows if i not in taps
    )
    if struck > _BY_BLOWS * gain:
        return False
    longest = max(blows[i].settled - blows[i].onset for i in taps)
    layout = final.model.layout(
        final.layout.blows, outcome.window, later=max(_LATER * longest, _AT_LEAST)
    )
    with_it = fit(final.model, layout, final.x, settled=0.1)
    item = weigh(candidate, with_it, with_findings(outcome, rest, layout), outcome.looks)
    return not item.counts(thresholds.false_finding)


def _power(found: Fit, i: int) -> float:
    left = found.residuals[found.layout.blow_spans[i]]
    return float(np.sum(left**2))
