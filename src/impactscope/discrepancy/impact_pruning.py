"""Findings that are not needed go; close rivals that do better take their place."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from impactscope.discrepancy.evidence import Thresholds, family_p_value
from impactscope.discrepancy.impact_candidates import Candidate
from impactscope.discrepancy.impact_fit import fit
from impactscope.discrepancy.impact_outcome import Found, Outcome, weigh, with_findings
from impactscope.errors import ImpactscopeError

__all__ = ['prune']

_CLOSE = 40.0  # of the criterion, within which a rival is fitted over the whole window


def prune(
    outcome: Outcome, thresholds: Thresholds, window: float, progress: Callable[[float, str], None]
) -> None:
    """Drop what is not needed once the others are there; swap what a close rival does better.

    Decided in the shortest window that decides: where later contacts have amplified errors,
    a model that lacks something cannot even be fitted.
    """
    done: set[str] = set()
    while True:
        left = [c for c in outcome.accepted if c.label not in done]
        if not left:
            break
        candidate = left[-1] if len(left) == len(outcome.accepted) else left[0]
        done.add(candidate.label)
        progress(0.7 + 0.1 * len(done), f'without {candidate.label}')
        rest = [c for c in outcome.accepted if c is not candidate]
        kept = candidate.label in outcome.doubted
        if rest and not kept and not _needed(outcome, candidate, rest, thresholds, window):
            outcome.accepted.remove(candidate)
            outcome.final = with_findings(outcome, rest, outcome.final.layout)
            continue
        _swap(outcome, candidate, rest)


def _needed(
    outcome: Outcome,
    candidate: Candidate,
    rest: list[Candidate],
    thresholds: Thresholds,
    shorter: float,
) -> bool:
    blows = outcome.final.model.data.fitted
    for window in sorted({shorter, outcome.window}):
        layout = outcome.final.model.layout(blows, window)
        with_it = fit(outcome.final.model, layout, outcome.final.x, settled=0.1)
        without = with_findings(outcome, rest, layout)
        item = weigh(candidate, with_it, without, outcome.looks)
        outcome.found[candidate.label] = item
        if item.p_value <= thresholds.false_finding:
            return True
    return False


def _swap(outcome: Outcome, candidate: Candidate, rest: list[Candidate]) -> None:
    """Fit close rivals of a finding over the whole window, and let the best one stand."""
    mine = outcome.found[candidate.label]
    close = [
        r
        for r in outcome.rivals.get(candidate.label, [])
        if r.criterion < mine.criterion + _CLOSE
        and r.candidate.label not in {c.label for c in rest}
    ]
    layout = outcome.final.layout
    refitted = []
    for rival in close[:3]:
        model = outcome.baseline.model
        for chosen in (*rest, rival.candidate):
            model = chosen.extend(model)
        known = {**outcome.final.values, **rival.fit.values}
        x = np.array([f.to_inner(known.get(f.key, f.start)) for f in model.free])
        try:
            other = fit(model, layout, x, settled=0.1)
        except ImpactscopeError:
            continue
        spread = max(1.0, min(other.reduced, outcome.final.reduced))
        cost = (rival.candidate.cost - candidate.cost) * math.log(layout.size)
        cost += rival.candidate.doubt - candidate.doubt
        worse = (other.chi_square - outcome.final.chi_square) / spread
        refitted.append(
            Found(
                rival.candidate,
                other,
                mine.gain - worse,
                family_p_value(mine.gain - worse, rival.candidate.cost, outcome.looks),
                mine.criterion + worse + cost,
            )
        )
    refitted.sort(key=lambda f: f.criterion)
    outcome.rivals[candidate.label] = refitted
    if refitted and refitted[0].criterion < mine.criterion - 0.5:
        best = refitted[0]
        place = outcome.accepted.index(candidate)
        outcome.accepted[place] = best.candidate
        outcome.final = best.fit
        outcome.found[best.candidate.label] = best
        outcome.rivals[best.candidate.label] = [mine, *refitted[1:]]
