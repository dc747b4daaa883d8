"""Pruning: findings that are not needed go; close rivals that do better take their place."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence

from impactscope.discrepancy.evidence import Thresholds, family_p_value, least_gain
from impactscope.discrepancy.impact.candidates.candidate import Candidate, contains, kin_of
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.fits.least_squares import Fit, fit
from impactscope.discrepancy.impact.models.bench_model import ImpactModel
from impactscope.discrepancy.impact.search.other_minima import lowest
from impactscope.discrepancy.impact.search.outcome import (
    Found,
    Outcome,
    evidence_for,
    weigh,
    with_findings,
)
from impactscope.discrepancy.impact.search.screening import Screening
from impactscope.discrepancy.impact.search.strong_effects import (
    from_within,
    in_place_of,
    with_its_numbers,
)
from impactscope.discrepancy.processes import in_processes
from impactscope.discrepancy.time_limit import time_left
from impactscope.errors import ImpactscopeError

__all__ = [
    'at_bottom',
    'drop_idle',
    'in_the_place_of',
    'join_relatives',
    'no_weight_along',
    'one_for_two',
    'prune',
]

_CLOSE = 40.0  # of the criterion, within which a rival is fitted over the whole window
_RIVALS = 3  # that are
# of a finding's gain, from which a rival is as well, where others were found later; set, not
# measured
_NEARLY = 0.8
_AS_MUCH = 3.0  # of chi-square, by which an explanation that is as good may be behind
_AHEAD = 0.5  # of the criterion, from which a rival takes a finding's place
_DEEPER = 1.0  # of chi-square, by which another minimum has to be lower
_TIED = 8.0  # of the criterion, within which one explanation does as well as another
_RICHER = 2.0 * math.log(3.0)  # of the criterion: of a law and its plain form this is likelier
_STARTS = 2  # of a relative
_AS_STATED = 1.0  # standard deviations within which a number is the stated one
_LOST = 2.0  # reduced chi-square, over that of a finding, of a fit that has lost its way
_STUCK = 1.0  # of chi-square, less than which a fuller law has not left the plain one
_PROMISING = 0.5  # of a finding's gain, from which a relative is fitted jointly


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
        beside = outcome.found[candidate.label]  # weighed as its rivals were
        if not _dropped(outcome, candidate, thresholds, window):
            rest = [c for c in outcome.accepted if c is not candidate]
            _swap(outcome, candidate, rest, beside)
    for candidate in tuple(outcome.accepted):  # others may have been swapped since
        rest = [c for c in outcome.accepted if c is not candidate]
        kept = candidate.label in outcome.doubted
        if rest and not kept and _as_stated(outcome.final, outcome.baseline.model, candidate):
            outcome.accepted.remove(candidate)
            outcome.final = with_findings(outcome, rest, outcome.final.layout)


def drop_idle(outcome: Outcome, thresholds: Thresholds, window: float) -> None:
    """Drop what the last finding has made idle; ``window`` is the shortest that decides, s."""
    for candidate in outcome.accepted[:-1]:
        known = outcome.found[candidate.label]  # weighed as its rivals were
        if not _dropped(outcome, candidate, thresholds, window):
            outcome.found[candidate.label] = known


def _dropped(
    outcome: Outcome, candidate: Candidate, thresholds: Thresholds, window: float
) -> bool:
    """Whether a finding was dropped since it is not needed beside the others."""
    rest = [c for c in outcome.accepted if c is not candidate]
    if not rest or candidate.label in outcome.doubted:
        return False
    stated = _as_stated(outcome.final, outcome.baseline.model, candidate)
    if not stated and _needed(outcome, candidate, rest, thresholds, window):
        return False
    outcome.accepted.remove(candidate)
    outcome.final = with_findings(outcome, rest, outcome.final.layout)
    return True


def _as_stated(final: Fit, stated: ImpactModel, candidate: Candidate) -> bool:
    """Whether a number that is said to be wrong is fitted as it was stated.

    What it has gained came from elsewhere: a fit that had missed its minimum, or a short window
    in which it stood in for what a longer one shows to be something else.
    """
    if candidate.name != 'wrong_parameter' or not candidate.free:
        return False
    priors = {f.key: f.prior for f in stated.free}
    absent = candidate.amplitudes.get(candidate.parameter)
    prior = priors.get(candidate.parameter) or (None if absent is None else (absent, 0.0))
    if prior is None:
        return False
    mean, tolerance = prior
    beside = math.hypot(final.std(candidate.parameter), tolerance)
    return abs(final.values[candidate.parameter] - mean) < _AS_STATED * beside


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
        if item.counts(thresholds.false_finding):
            return True
    return False


def _swap(outcome: Outcome, candidate: Candidate, rest: list[Candidate], beside: Found) -> None:
    """Fit close rivals of a finding over the whole window, and let the best one stand.

    ``beside``: the finding as it was weighed when its rivals were.
    """
    mine = outcome.found[candidate.label]
    taken = {c.label for c in rest}
    rivals = [r for r in outcome.rivals.get(candidate.label, []) if r.candidate.label not in taken]
    close = [r for r in rivals if r.criterion < beside.criterion + _CLOSE]
    tied = [r for r in close[_RIVALS:] if r.criterion < beside.criterion + _TIED]
    # what was found later was missing then, and bent each of them in its own way
    later = outcome.accepted[-1] is not candidate
    further = [r for r in rivals if r not in close] if later else []
    nearly = [r for r in further if r.gain > _NEARLY * beside.gain]

    def fitted(rival: Found) -> Found | None:
        known = {**outcome.final.values, **rival.fit.values}
        item = _instead(outcome, mine, rest, rival.candidate, known)
        return None if item is None else at_bottom(item, outcome.final.chi_square + _CLOSE)

    tried = in_processes(fitted, [*(close + nearly)[:_RIVALS], *tied[:_RIVALS]])
    refitted = [f for f in tried if f is not None]
    near = [f for f in (mine, *refitted) if f.criterion < mine.criterion + _TIED]
    refitted += _relatives(outcome, mine, rest, near, {f.candidate.name for f in refitted})
    refitted.sort(key=lambda f: f.criterion)
    outcome.rivals[candidate.label] = refitted
    if refitted and refitted[0].criterion < mine.criterion - _AHEAD:
        mine = outcome.found[candidate.label] = at_bottom(
            dataclasses.replace(mine, fit=outcome.final), math.inf
        )
        outcome.final = mine.fit
    if refitted and refitted[0].criterion < mine.criterion - _AHEAD:
        best = refitted[0]
        place = outcome.accepted.index(candidate)
        outcome.accepted[place] = best.candidate
        outcome.final = best.fit
        outcome.found[best.candidate.label] = best
        outcome.rivals[best.candidate.label] = [mine, *refitted[1:]]


def at_bottom(item: Found, most: float) -> Found:
    """A finding or a rival close to it, from the lowest of its minima that are seen nearby.

    ``most``: chi-square from which it is too far behind.
    """
    found = item.fit
    if (
        found.chi_square > most
        or not item.candidate.free
        or not time_left('other minima of a rival')
    ):
        return item
    best = lowest(found, [item.candidate])
    fallen = (found.chi_square - best.chi_square) / max(1.0, best.reduced)
    if fallen < _DEEPER:
        return item
    dearer = item.candidate.price(item.gain, best) - item.candidate.price(item.gain, found)
    if dearer > fallen:  # a narrow minimum may be lower than a wide one and no likelier
        return item
    return dataclasses.replace(
        item, fit=best, gain=item.gain + fallen, criterion=item.criterion - fallen + dearer
    )


def one_for_two(outcome: Outcome) -> bool:
    """One explanation in place of two findings, where it was a rival of both; whether it was.

    In a short window a wrong number of the simulation may stand for a part of what is missing,
    and another one then for the rest. What takes their place has to explain as much as both, but
    for their numbers and the choice of a further one.
    """
    final = outcome.final
    for pair in itertools.combinations(outcome.accepted, 2):
        of_both = _rivals_of_both(outcome, *pair)
        if not of_both or not time_left('one effect in place of two'):
            continue
        rest = [c for c in outcome.accepted if c not in pair]
        without = with_findings(outcome, rest, final.layout)
        gain = evidence_for(final, without)
        price = sum(c.price(gain, final) + c.doubt_at(final.values) for c in pair)
        reached = price + 2.0 * math.log(outcome.looks) - gain
        screening = Screening(without)
        found: list[Found] = []
        for candidate, known in of_both[:_RIVALS]:
            starts = [*known, *(t.model.values(t.x) for t in screening.best(candidate)[:1])]
            mine = outcome.found[pair[0].label]
            made = (
                _instead(outcome, mine, rest, candidate, {**final.values, **s}) for s in starts
            )
            fits = [f.fit for f in made if f is not None]
            if fits:
                deepest = min(fits, key=lambda f: f.chi_square)
                item = weigh(candidate, deepest, without, outcome.looks)
                found.append(at_bottom(item, final.chi_square + _CLOSE))
        best = min(found, key=lambda f: f.criterion, default=None)
        if best is not None and best.criterion < reached and not best.refused:
            outcome.final = best.fit
            outcome.put_in_place(pair, best, found)
            return True
    return False


def _rivals_of_both(
    outcome: Outcome, one: Candidate, other: Candidate
) -> list[tuple[Candidate, list[Mapping[str, float]]]]:
    """What has been fitted instead of either of two findings, with what it was fitted to."""
    taken = {c.label for c in outcome.accepted}
    first, second = (
        {f.candidate.label: f for f in outcome.rivals.get(c.label, ())} for c in (one, other)
    )
    both = [f for label, f in first.items() if label in second and label not in taken]
    both.sort(key=lambda f: f.criterion)
    return [(f.candidate, [f.fit.values, second[f.candidate.label].fit.values]) for f in both]


def no_weight_along(outcome: Outcome) -> None:
    """A push in the place of a weight, where it explains as much, of pendulums that swing to it.

    No weight acts along at the lowest point of a swing: it is as unlikely as the push, which has
    more numbers, was beside it. Carts are another matter, a track may be out of level.
    """
    weight = next((c for c in outcome.accepted if c.name == 'gravity_load'), None)
    model = outcome.final.model
    if weight is None or model.constants.get('orientation', 0.0) < 0.5:
        return
    if {b.recording.kind for b in model.data.blows} - {'tap'} != {'pendulum'}:
        return
    mine, others = outcome.found[weight.label], outcome.rivals.get(weight.label, [])
    pushes = [f for f in others if f.candidate.name == 'external_push']
    push = next((f for f in pushes if f.gain > mine.gain - _AS_MUCH), None)
    if push is None or push.fit.layout is not outcome.final.layout:
        return
    outcome.final = push.fit
    outcome.put_in_place(
        [weight],
        dataclasses.replace(push, criterion=mine.criterion),
        [dataclasses.replace(mine, criterion=push.criterion), *others],
    )


def _instead(
    outcome: Outcome,
    mine: Found,
    rest: Sequence[Candidate],
    candidate: Candidate,
    known: Mapping[str, float],
) -> Found | None:
    """Another candidate in a finding's place, fitted over the whole window from known numbers."""
    without = outcome.model_with(rest)
    model = candidate.extend(without)
    layout = outcome.final.layout
    x = model.vector(known)
    other: Fit | None = None
    with contextlib.suppress(ImpactscopeError):
        other = fit(model, layout, x, settled=0.1)
    if other is None or other.reduced > _LOST * max(1.0, outcome.final.reduced):
        nearer = in_place_of(outcome.final, without, candidate)
        if nearer is not None and (other is None or nearer.chi_square < other.chi_square):
            other = nearer
    same = bool(mine.candidate.parameter) and candidate.name in kin_of(mine.candidate)
    # a plain law that lacks more than chance may only have stopped short beside its fuller form
    plain = contains(mine.candidate, candidate)
    behind = outcome.final.chi_square + (_AS_MUCH if plain else _CLOSE)
    if other is not None and (same or other.chi_square > behind):
        nearer = with_its_numbers(outcome.final, without, candidate)
        if nearer is not None and nearer.chi_square < other.chi_square:
            other = nearer
    if contains(candidate, mine.candidate) and time_left('fuller laws from a finding'):
        level = outcome.final.chi_square - _STUCK
        if other is None or other.chi_square > level:
            fuller = from_within(outcome.final, without, mine.candidate, candidate)
            if fuller is not None and fuller.chi_square < level:
                other = fuller
    if other is None:
        return None
    return in_the_place_of(mine, outcome.final, candidate, other, outcome.looks)


def in_the_place_of(
    mine: Found, final: Fit, candidate: Candidate, other: Fit, looks: int
) -> Found:
    """Another candidate as it was fitted in a finding's place, weighed beside the finding.

    Args:
        mine: the finding.
        final: the fit with it.
        candidate: the other one.
        other: the fit with that.
        looks: independent candidates.
    """
    worse, cost = _against(candidate, other, mine, final)
    chance = family_p_value(mine.gain - worse, candidate.cost, looks)
    return Found(candidate, other, mine.gain - worse, chance, mine.criterion + worse + cost)


def _against(candidate: Candidate, other: Fit, found: Found, final: Fit) -> tuple[float, float]:
    """What another candidate leaves more than a finding, and what it costs more.

    A law that contains another one need not pay for all samples: of two laws of one kind neither
    is likelier from the outset but for the choice of the richer one. Where chance would hardly
    gain as much by its further numbers it stands in any case.
    """
    mine = found.candidate
    doubt = candidate.doubt_at(other.values) - mine.doubt_at(final.values)
    if contains(candidate, mine):
        return -evidence_for(other, final), _beyond_plain(candidate, mine, other) + doubt
    if contains(mine, candidate):
        return evidence_for(final, other), doubt - _beyond_plain(mine, candidate, final)
    spread = max(1.0, min(other.reduced, final.reduced))
    worse = (other.chi_square - final.chi_square) / spread
    dearer = candidate.price(found.gain - worse, other) - mine.price(found.gain, final)
    return worse, dearer + doubt


def join_relatives(outcome: Outcome, candidate: Candidate) -> None:
    """What is of one family with a finding among its rivals, where it was not fitted yet."""
    mine, rivals = outcome.found[candidate.label], outcome.rivals[candidate.label]
    rest = [c for c in outcome.accepted if c is not candidate]
    near = [f for f in (mine, *rivals) if f.criterion < mine.criterion + _TIED]
    known = {f.candidate.name for f in rivals}
    rivals = [*rivals, *_relatives(outcome, mine, rest, near, known)]
    outcome.rivals[candidate.label] = sorted(rivals, key=lambda f: f.criterion)


def _beyond_plain(law: Candidate, plain: Candidate, joint: Fit) -> float:
    """Fall of chi-square that a law has to bring beyond a plain one that it contains."""
    least = least_gain(law.cost - plain.cost, 1, Thresholds().false_finding)
    return min(least, law.price_beyond_plain(joint) + _RICHER)


def _relatives(
    outcome: Outcome,
    mine: Found,
    rest: Sequence[Candidate],
    near: Sequence[Found],
    fitted: set[str],
) -> list[Found]:
    """What is of one family with a finding, or with what does as well, and was not fitted yet.

    A sharper law may need a start of its own, which the cheap order of candidates does not give.
    """
    wanted = {
        (kin, f.candidate.channel)
        for f in near
        for kin in kin_of(f.candidate)
        if kin not in fitted and kin != mine.candidate.name
    }
    taken = {c.label for c in outcome.accepted}
    if not wanted or not time_left('relatives of what was found'):
        return []
    without = with_findings(outcome, rest, outcome.final.layout)
    screening = Screening(without)

    def in_its_place(candidate: Candidate) -> Found | None:
        tried = screening.best(candidate)
        if not tried:
            return None
        best = screening.best_refined(tried[:_STARTS])
        bent = without.reduced > _LOST and not candidate.channel
        able = bent or contains(candidate, mine.candidate)  # which has a start from the finding
        wanted_gain = min(_PROMISING * mine.gain, mine.gain - _CLOSE)
        if best.gain < wanted_gain and not able:
            return None  # tried at numbers that are bent, a trial says nothing of a force
        starts = [best, tried[0]] if candidate.of_several_shapes else [best]
        values = [t.model.values(t.x) for t in starts]
        items = [_instead(outcome, mine, rest, candidate, known) for known in values]
        able_to = [item for item in items if item is not None]
        return min(able_to, key=lambda f: f.criterion, default=None)

    open_ones = [
        c
        for c in candidates(without, ())
        if (c.name, c.channel) in wanted and c.label not in taken
    ]
    return [f for f in in_processes(in_its_place, open_ones) if f is not None]
