"""Held-out recordings: they confirm a finding, contradict it, or speak for another one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

import numpy as np

from impactscope.discrepancy.evidence import Thresholds, least_gain
from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.fits.growing_windows import held_out_fit
from impactscope.discrepancy.impact.fits.least_squares import Fit, fit
from impactscope.discrepancy.impact.search.other_minima import lowest
from impactscope.discrepancy.impact.search.outcome import (
    Found,
    Outcome,
    chance_of,
    with_findings,
)
from impactscope.discrepancy.impact.search.prediction_misfit import (
    further_misfit,
    prediction_misfit,
)
from impactscope.discrepancy.impact.search.pruning import (
    drop_idle,
    in_the_place_of,
    join_relatives,
    no_weight_along,
)
from impactscope.discrepancy.time_limit import time_left
from impactscope.errors import ImpactscopeError

__all__ = ['check_held_out', 'fit_together']

_NOT_QUITE = 0.03  # share of what findings gain in the fitted recordings
_CONFIRMED = 4  # candidates that are held against the held-out recordings
_OPEN = 10.0  # of the criterion, within which they decide between a finding and its rivals
_MADE_GOOD = 0.5  # of what held-out recordings are missed by, that a rival may leave
_HELD_UP = 20.0  # of the criterion: what a push costs beyond a weight, whose numbers are fewer
_TEN_TO_ONE = 4.6  # of the criterion
_RIVALS = 6  # of a finding, that are held against them; the others would pass for unlikely


def check_held_out(
    outcome: Outcome, thresholds: Thresholds, most: int, window: float = math.inf
) -> None:
    """Predict the held-out recordings; of at most ``most`` findings keep what they bear out.

    ``window``: the shortest that decides whether a finding is needed, s after the onset.
    """
    held_out = outcome.final.model.data.held_out
    outcome.held_out_baseline = held_out_fit(outcome.baseline, held_out, outcome.window)
    outcome.held_out_final = outcome.held_out_baseline
    if outcome.accepted:
        outcome.held_out_final = held_out_fit(outcome.final, held_out, outcome.window)
    if outcome.held_out_final is None:
        return
    before = len(outcome.accepted)
    _confirm(outcome, thresholds, most)
    if 0 < before < len(outcome.accepted):
        borne_out = outcome.final
        drop_idle(outcome, thresholds, window)
        if outcome.final is not borne_out:
            outcome.held_out_final = held_out_fit(outcome.final, held_out, outcome.window)
    for confirmed in outcome.accepted[before:]:
        join_relatives(outcome, confirmed)
    _judge_by_predictions(outcome, thresholds)
    _by_name(outcome)
    _by_what_strikes(outcome)
    weighed = outcome.final
    no_weight_along(outcome)
    if outcome.final is not weighed:
        outcome.held_out_final = held_out_fit(outcome.final, held_out, outcome.window)
        outcome.tests, outcome.modes = None, []


def _judge_by_predictions(outcome: Outcome, thresholds: Thresholds) -> None:
    """Take findings back, the last first, until the held-out recordings are not missed further.

    Before one may go, a rival that explains about as much and is likelier by them has its place.
    """
    held_out = outcome.final.model.data.held_out
    while outcome.accepted:
        _weigh_rivals(outcome, thresholds)
        before, after = outcome.held_out_baseline, outcome.held_out_final
        if before is None or after is None:
            return
        worse = further_misfit((outcome.baseline, before), (outcome.final, after))
        allowed = thresholds.held_out_loss * max(1.0, after.reduced)
        # beside another effect that is missing, too, a finding is not quite right
        gained = outcome.baseline.chi_square - outcome.final.chi_square
        if worse <= allowed + _NOT_QUITE * max(gained, 0.0):
            return
        dropped = outcome.accepted.pop()
        outcome.notes.append(
            f'The held-out recordings contradict what the fitted ones suggest: with '
            f'{dropped.label} chi-square rises by {worse:.1f}; it is not accepted.'
        )
        outcome.tests = None
        if outcome.accepted:
            outcome.final = with_findings(outcome, outcome.accepted, outcome.final.layout)
            outcome.held_out_final = held_out_fit(outcome.final, held_out, outcome.window)
        else:
            outcome.final, outcome.held_out_final = outcome.baseline, before


def _weigh_rivals(outcome: Outcome, thresholds: Thresholds) -> None:
    """Weigh the last finding and its rivals by the held-out recordings, too."""
    if not outcome.accepted or outcome.held_out_final is None:
        return
    mine = _found_last(outcome)
    label = mine.candidate.label
    rivals = outcome.rivals.get(label, [])
    allowed = _allowed(outcome, thresholds)
    if outcome.held_out_final.reduced > allowed:
        weighed = _weighed_together(outcome, outcome.held_out_final, mine, allowed)
    else:
        weighed = _weighed_by_prediction(outcome, outcome.held_out_final, mine)
    known = [weighed[i][0] if i in weighed else rival for i, rival in enumerate(rivals)]
    outcome.rivals[label] = known
    better = [w for w in weighed.values() if w[0].criterion < mine.criterion]
    if not better:
        return
    best, predicted = min(better, key=lambda pair: pair[0].criterion)
    _put_last(outcome, best, predicted, [mine, *known])


def _allowed(outcome: Outcome, thresholds: Thresholds) -> float:
    """Reduced chi-square of held-out recordings, above which they are missed."""
    return thresholds.unexplained_ratio * max(1.0, outcome.final.reduced)


def _weighed_by_prediction(
    outcome: Outcome, held_out: Fit, mine: Found
) -> dict[int, tuple[Found, Fit]]:
    """Rivals by their number, weighed by what they predict, and that.

    Of two that explain the fitted recordings about alike, what predicts the others better is
    likelier.
    """
    weighed: dict[int, tuple[Found, Fit]] = {}
    for i, rival, predicted in _predicted(outcome, mine, mine.criterion + _OPEN):
        worse = further_misfit((outcome.final, held_out), (rival.fit, predicted))
        more = worse / max(1.0, predicted.reduced)
        weighed[i] = _with_held_out(rival, rival.criterion, more), predicted
        if len(weighed) == _RIVALS:
            break
    return weighed


def _weighed_together(
    outcome: Outcome, held_out: Fit, mine: Found, allowed: float
) -> dict[int, tuple[Found, Fit]]:
    """The same where held-out recordings are missed: by a fit to all, and further rivals, too.

    What contacts amplify is no measure of how right a prediction is. Where it does not explain
    the miss, a rival has to make good half of that at least: what shows in these recordings alone
    is no evidence for the law that bends to it most easily.
    """
    final = outcome.final

    def cost(found: Found, own: Fit, predicted: Fit) -> float:
        together = fit_together(own, predicted, [*outcome.accepted[:-1], found.candidate])
        return math.inf if together is None else _cost(outcome, mine, found, together)

    weighed: dict[int, tuple[Found, Fit]] = {}
    known = cost(mine, final, held_out)
    missed = prediction_misfit(final, held_out)
    open_until = mine.criterion + max(_OPEN, (missed - 1.0) * held_out.layout.size)
    most = 1.0 + _MADE_GOOD * (missed - 1.0) if missed > allowed else math.inf
    for i, rival, predicted in _predicted(outcome, mine, open_until):
        if math.isinf(known) or prediction_misfit(rival.fit, predicted) > most:
            continue
        ahead = cost(rival, rival.fit, predicted) - known
        fitted = _cost(outcome, mine, rival, rival.fit) - _cost(outcome, mine, mine, final)
        alone = mine.criterion + fitted
        weighed[i] = _with_held_out(rival, alone, ahead - fitted), predicted
        if len(weighed) == _RIVALS:
            break
    return weighed


def _with_held_out(rival: Found, criterion: float, more: float) -> Found:
    """A rival by the fitted recordings alone, and what those held out add to its criterion."""
    return dataclasses.replace(rival, criterion=criterion + more, held_out=more)


def _cost(outcome: Outcome, mine: Found, found: Found, fitted: Fit) -> float:
    """Chi-square of a fit in a finding's place, its numbers' price and its doubt on top."""
    priced = found.candidate.price(mine.gain, found.fit)
    spread = max(1.0, outcome.final.reduced)
    return fitted.chi_square / spread + priced + found.candidate.doubt_at(fitted.values)


def _predicted(
    outcome: Outcome, mine: Found, open_until: float
) -> Iterator[tuple[int, Found, Fit]]:
    """The likeliest rivals of the last finding: number, rival, the held-out recordings by it.

    ``open_until``: the criterion until which they are looked at.
    """
    rivals = outcome.rivals.get(mine.candidate.label, [])
    for i, rival in sorted(enumerate(rivals), key=lambda pair: pair[1].criterion):
        if not _in_its_place(outcome, rival):
            continue
        if rival.criterion >= open_until or not time_left('rivals by what they predict'):
            return
        predicted = held_out_fit(rival.fit, outcome.final.model.data.held_out, outcome.window)
        if predicted is not None:
            yield i, rival, predicted


def fit_together(final: Fit, held_out: Fit, candidates: Sequence[Candidate]) -> Fit | None:
    """One set of numbers for the recordings that were fitted and those held out; None: none.

    ``candidates``: what the fit has beyond the baseline.
    """
    model = dataclasses.replace(final.model, data=held_out.model.data)
    layout = model.layout((*final.layout.blows, *held_out.layout.blows), final.layout.window)
    try:
        together = fit(model, layout, model.vector({**final.values, **held_out.values}))
    except ImpactscopeError:
        return None
    return lowest(together, candidates)


def _in_its_place(outcome: Outcome, rival: Found) -> bool:
    """Whether a rival was fitted in the last finding's place: to as much, beside the same."""
    return _stands_beside(outcome, rival, outcome.accepted[:-1])


def _stands_beside(outcome: Outcome, found: Found, others: Sequence[Candidate]) -> bool:
    """Whether a fit to as much has what it is of, beside ``others`` as they are accepted now.

    A fit from before one of these took a plainer or a fuller form has what it was then.
    """
    final, made = outcome.final.model, found.fit.model
    kept = {c.label for c in others}
    gone = {f.key for c in outcome.accepted if c.label not in kept for f in c.free}
    beside = {f.key for f in final.free} - gone
    there = {f.key for f in made.free}
    back = gone & {f.key for f in outcome.baseline.model.free}  # as the baseline has them
    more = there - {f.key for f in found.candidate.free} - back
    alike = all(made.constants.get(k) == v for c in others for k, v in c.constants.items())
    same = found.fit.layout.size == outcome.final.layout.size and alike
    return not found.refused and same and beside <= there and more <= beside


def _found_last(outcome: Outcome) -> Found:
    """The last finding as it is fitted now; when it was found the window may have been shorter."""
    return dataclasses.replace(outcome.found[outcome.accepted[-1].label], fit=outcome.final)


def _put_last(outcome: Outcome, best: Found, predicted: Fit, others: list[Found]) -> None:
    outcome.put_in_place([outcome.accepted[-1]], best, others)
    outcome.final, outcome.held_out_final = best.fit, predicted
    outcome.tests, outcome.modes = None, []


def _by_name(outcome: Outcome) -> None:
    """The likeliest name of what was found last, everything that goes by it together.

    Filters of four orders that explain as much are one answer: together they may be likelier
    than a clock that is ahead of each of them. So are numbers of the simulation of which any may
    be wrong: a further branch of the layer that does what each of them does is not likelier.
    """
    if not outcome.accepted or outcome.held_out_final is None:
        return
    candidate = outcome.accepted[-1]
    rivals = outcome.rivals.get(candidate.label, [])
    mine = _found_last(outcome)

    def cost(form: Found) -> float:
        if not candidate.channel:
            return form.criterion
        # anew: rivals were weighed in other fits
        return _cost(outcome, mine, form, form.fit) + form.held_out

    forms: dict[str, list[Found]] = {}
    for form in (mine, *rivals):
        if form.candidate.channel == candidate.channel and _in_its_place(outcome, form):
            forms.setdefault(form.candidate.name, []).append(form)
    total = {
        name: np.logaddexp.reduce([-0.5 * cost(f) for f in same]) for name, same in forms.items()
    }
    likeliest = max(total, key=lambda name: total[name], default=candidate.name)
    if likeliest == candidate.name:
        return
    best = min(forms[likeliest], key=cost)
    predicted = held_out_fit(best.fit, outcome.final.model.data.held_out, outcome.window)
    if predicted is None:
        return
    _put_last(outcome, best, predicted, [f for f in (mine, *rivals) if f is not best])


def _by_what_strikes(outcome: Outcome) -> None:
    """Where robots alone strike, a push in the place of a weight that was found last.

    If it explains about as much: the weight of a robot rests on its joints.
    """
    weighs = outcome.accepted and outcome.accepted[-1].name == 'gravity_load'
    if not weighs or outcome.held_out_final is None:
        return
    kinds = {blow.recording.kind for blow in outcome.final.model.data.blows}
    if kinds - {'tap'} != {'robot'}:
        return
    mine = _found_last(outcome)
    rivals = outcome.rivals.get(mine.candidate.label, [])
    pushes = [r for r in rivals if r.candidate.name == 'external_push']
    for push in pushes:
        if push.criterion > mine.criterion + _HELD_UP or not _in_its_place(outcome, push):
            continue
        predicted = held_out_fit(push.fit, outcome.final.model.data.held_out, outcome.window)
        if predicted is not None:
            others = [mine, *(r for r in rivals if r is not push)]
            likelier = dataclasses.replace(push, criterion=mine.criterion - _TEN_TO_ONE)
            _put_last(outcome, likelier, predicted, others)
            return


def _confirm(outcome: Outcome, thresholds: Thresholds, most: int) -> None:
    """Accept what the fitted recordings only suggest where the held-out ones bear it out.

    Nothing is fitted to these, so their chi-square counts beside that of the fit; but by no more
    than what this gains, for a late contact amplifies whatever moves it. Where they are missed
    for that they are fitted as well. With both it has to be likelier than nothing.
    """
    held_out = outcome.final.model.data.held_out
    while len(outcome.accepted) < most and outcome.held_out_final is not None:
        if not time_left('what the fitted recordings only suggest'):
            return
        able = []
        now, before = outcome.final, outcome.held_out_final
        missed = before.reduced > _allowed(outcome, thresholds)
        suspects = [i for i in outcome.last[:_CONFIRMED] if _suggested(outcome, i, thresholds)]
        together = fit_together(now, before, outcome.accepted) if suspects and missed else None
        for item in suspects:
            predicted = held_out_fit(item.fit, held_out, outcome.window)
            if predicted is None:
                continue
            if missed:
                worse = _worse_together(outcome, together, item, predicted)
            else:
                worse = further_misfit((now, before), (item.fit, predicted))
            more = min(-worse / max(1.0, predicted.reduced), item.gain)
            gain, criterion = item.gain + more, item.criterion - more
            chance = chance_of(item.candidate, item.fit, gain, outcome.looks)
            if worse < -1.0 and criterion < 0.0 and chance < thresholds.false_finding:
                borne_out = dataclasses.replace(
                    item, gain=gain, p_value=chance, criterion=criterion
                )
                able.append((borne_out, predicted))
        if not able:
            return
        best, predicted = min(able, key=lambda pair: pair[0].criterion)
        outcome.accepted.append(best.candidate)
        outcome.found[best.candidate.label] = best
        # what they predict is weighed beside what this one does, if at all
        outcome.rivals[best.candidate.label] = [
            in_the_place_of(best, best.fit, f.candidate, f.fit, outcome.looks)
            for f in outcome.last
            if f.candidate is not best.candidate and f.fit.layout.size == best.fit.layout.size
        ]
        outcome.p_value = min(outcome.p_value, best.p_value)
        outcome.final, outcome.held_out_final = best.fit, predicted
        outcome.tests, outcome.last = None, []


def _suggested(outcome: Outcome, item: Found, thresholds: Thresholds) -> bool:
    """Whether the fitted recordings suggest a further finding, beside what is accepted."""
    wanted = least_gain(item.candidate.cost, outcome.looks, thresholds.false_finding)
    known = item.candidate.label in {c.label for c in outcome.accepted}
    enough = item.gain >= 0.3 * wanted and not known
    return enough and _stands_beside(outcome, item, outcome.accepted)


def _worse_together(outcome: Outcome, now: Fit | None, item: Found, predicted: Fit) -> float:
    """Rise of chi-square of held-out recordings with a further finding, if all are fitted.

    What a fit leaves open of its numbers is allowed for in a prediction as if blows followed it
    in proportion. Where contacts amplify it by far, what is missed so says nothing.

    ``now``: the fit to all without the finding; infinite where either fit is not to be had.
    """
    then = fit_together(item.fit, predicted, [*outcome.accepted, item.candidate])
    if now is None or then is None:
        return math.inf
    return (then.chi_square - now.chi_square) - (item.fit.chi_square - outcome.final.chi_square)
