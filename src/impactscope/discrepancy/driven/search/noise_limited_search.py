"""The search where a right model leaves the sensor's noise and nothing else.

Then effects of a thousandth of the signal can be told. Each step has three parts: every candidate
is looked at (:mod:`screening`); the best are fitted with everything else; chi-square on the
fitted and on the held-out recordings decides. Then backwards, and each effect against its rivals
beside the others.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.fits.innovations import innovations
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.chi_square import DELAYING, NoiseJudge, reduced
from impactscope.discrepancy.driven.model_selection.model_comparison import Judge
from impactscope.discrepancy.driven.models.measuring_chain import before_sampling, filter_of
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import key
from impactscope.discrepancy.driven.search.alternative_laws import (
    base_in_place_of_play,
    friction_of_baseline,
    other_asymmetry,
    other_friction,
    other_levels,
    other_zero,
    peak_at_rest,
    plain_friction,
    spring_beside_stop,
    spring_of_position,
    uneven_friction,
    weight_in_place_of_cube,
)
from impactscope.discrepancy.driven.search.beam_search import Outcome, prune
from impactscope.discrepancy.driven.search.joint_fits import Fits, labels_of
from impactscope.discrepancy.driven.search.other_minima import (
    foretelling,
    starts_to_either_side,
)
from impactscope.discrepancy.driven.search.screening import (
    HOPE,
    Prospect,
    prospects,
    refined_start,
    screened,
)
from impactscope.discrepancy.time_limit import time_left

__all__ = ['from_those_left_behind', 'noise_limited_search']

Array = NDArray[np.float64]
Tell = Callable[[float], None]

FITTED = 9  # candidates that are fitted at the first step; half as many later
CLOSE = 60.0  # chi-square within which a second model is kept beside the best
DEPTH = 3
BEHIND = 3  # effects, from which the search is made once more
NEAR = 14.0  # chi-square within which a rival is fitted as carefully as the best
FAR = 10.0  # times the samples: chi-square from which a search goes on from what was found
EDGE = 64  # samples at either end
MORE = 0.25  # of reduced chi-square, that is more than noise
OF_ALL = 3  # candidates that are fitted because all recordings together show them
OPEN = 6.0  # of a criterion: one in twenty, less than which rules nothing out
MUCH = 0.5  # of what the best candidate explains
FORM = 0.01  # of what a delay gains, that its form leaves open
LATE = {
    1: 1.0,
    2: 1.414,
    3: 2.0,
    4: 2.613,
    5: 3.236,
    6: 3.864,
    7: 4.494,
    8: 5.126,
}  # delay times corner, 1/(2 pi)


def noise_limited_search(
    model: Model,
    baseline: Fit,
    segments: Sequence[Segment],
    judge: NoiseJudge,
    progress: Tell | None = None,
    seed: Fit | None = None,
) -> Outcome:
    """Find the smallest set of terms that chi-square cannot do without.

    ``seed``: a fit of the same model that another search has found, to go on from.
    """
    tell = progress or (lambda _share: None)
    judge.reference = baseline
    fits = Fits(model, segments, baseline)
    beam = [baseline]
    if seed is not None and seed.terms:
        start = fits.take(seed)
        if judge.gain(baseline, start).fitted > FAR * sum(s.measured.size for s in segments):
            beam = [start, *_without_delays(fits, start)]
            fits.look_around(start)
    for depth in range(DEPTH):
        if depth and not time_left('further effects'):
            break
        grown: list[Fit] = []
        for base in beam:
            grown += _grow(fits, base, judge, FITTED if depth == 0 else FITTED // 2)
        tell((depth + 1) / (DEPTH + 1))
        if not grown:
            break
        grown.sort(key=lambda f: judge.criterion(f, baseline))
        believed = [f for f in grown if judge.better(_best_parent(fits, f, judge), f)]
        level = judge.criterion(grown[0], baseline)
        # of two that are missing each may be hidden by what the other one leaves
        hidden = depth == 0 and level < 0.0 and _far_from_noise(judge, baseline)
        if not believed and not hidden:
            break
        close = [f for f in _distinct(grown) if judge.criterion(f, baseline) < level + CLOSE]
        beam = close[:2]
    return _finished(fits, judge)


def from_those_left_behind(model: Model, outcome: Outcome, judge: NoiseJudge) -> Outcome:
    """The search once more, from effects that were far behind the best one alone.

    An effect that makes up for two others stands before each of them alone, and beside it neither
    is worth anything.
    """
    baseline, size = outcome.baseline, len(outcome.baseline.terms) + 1
    known = (outcome.best, *outcome.rivals)
    new = labels_of(outcome.best.terms) - labels_of(baseline.terms)
    alone = [f for f in known if len(f.terms) == size and not labels_of(f.terms) >= new]
    much = MUCH * judge.gain(baseline, outcome.best).fitted
    able = [f for f in alone if judge.gain(baseline, f).fitted > much]
    able.sort(key=lambda f: judge.criterion(f, baseline))
    behind = _distinct(able)[:BEHIND]
    if not behind:
        return outcome
    fits = Fits(model, judge.segments, baseline)
    fits.known.update((labels_of(f.terms), f) for f in known)
    for base in behind:
        _grow(fits, base, judge, FITTED // 2)
    return _finished(fits, judge)


def _finished(fits: Fits, judge: NoiseJudge) -> Outcome:
    """The best of all fits without what it can do without, each effect against its rivals."""
    baseline = fits.baseline
    best = min(fits.known.values(), key=lambda f: judge.criterion(f, baseline))
    best = _pruned(fits, _each_from_other_starts(fits, best, judge), judge)
    best = _pruned(fits, spring_beside_stop(fits, best, judge), judge)
    best = _pruned(fits, weight_in_place_of_cube(fits, best, judge), judge)
    best = base_in_place_of_play(fits, best, judge)
    best = _pruned(fits, uneven_friction(fits, best, judge), judge)
    best = _pruned(fits, peak_at_rest(fits, best, judge), judge)
    best = _pruned(fits, plain_friction(fits, best, judge), judge)
    best = _pruned(fits, other_friction(fits, best, judge), judge)
    best = other_asymmetry(fits, best, judge)
    best = _pruned(fits, other_levels(fits, best, judge), judge)
    best = _pruned(fits, other_zero(fits, best, judge), judge)
    best = _against_rivals(fits, best, judge)
    best = _pruned(fits, friction_of_baseline(fits, best, judge), judge)
    level = judge.criterion(best, baseline) + NEAR
    fits.polish_each([f for f in fits.known.values() if judge.criterion(f, baseline) < level])
    best = min(fits.known.values(), key=lambda f: judge.criterion(f, baseline))
    best = plain_friction(fits, fits.polish(_pruned(fits, best, judge)), judge)
    best = _one_delay(fits, fits.polish(best), judge)
    best = _form_of_delay(fits, best, judge)
    best = _whole_clock(fits, best, judge)
    best = spring_of_position(fits, best, judge)
    if best is not baseline and not judge.better(baseline, best):
        best = baseline
    rivals = tuple(f for f in fits.known.values() if f is not best)
    return Outcome(baseline, best, rivals, best is not baseline)


def _without_delays(fits: Fits, start: Fit) -> list[Fit]:
    """What was found without its clock or its filter: other delays may do as well."""
    delays = [t for t in start.terms if t.name in DELAYING]
    return fits.without_each(start, [tuple(t for t in start.terms if t != d) for d in delays])


def _far_from_noise(judge: NoiseJudge, made: Fit) -> bool:
    """Whether more than noise is left of the recordings that were fitted, by its size alone."""
    return reduced(judge, made) > 1.0 + MORE


def _grow(fits: Fits, base: Fit, judge: NoiseJudge, most: int) -> list[Fit]:
    """Fits with one term more; the friction family starts from its simplest member."""
    candidates = [look for look in fits.looks if all(look.term.stands_with(o) for o in base.terms)]
    here = fits.here if base is fits.place else None
    ranked = prospects(fits.model, base, candidates, fits.segments, here)
    chosen: list[Prospect] = []
    names: dict[str, int] = {}
    for p in ranked:
        if len(chosen) >= most or p.gain < HOPE:
            break
        names[p.term.name] = names.get(p.term.name, 0) + 1
        if names[p.term.name] <= 3:
            chosen.append(p)

    def improved(p: Prospect) -> Prospect:
        if not p.term.rough or here is None:
            return p
        begin = refined_start(fits.model, base, p, fits.segments, here)
        return dataclasses.replace(p, initial=begin, other=None)

    made = fits.make_each(base, chosen, improved)
    if judge.has_held_out:  # which alone may have slow or far motions, and not look missed
        made += fits.make_each(base, fits.shown_by_all(base)[:OF_ALL])
    best = max(ranked, key=lambda p: p.gain, default=None)
    forms: set[tuple[bool, bool]] = set()
    for p in ranked:
        if p.term.name == 'low_pass_filter' and best is not None and p.gain > 0.5 * best.gain:
            form = before_sampling(p.term), filter_of(p.term)[1]
            if form not in forms:
                made += _other_orders(fits, base, p)
            forms.add(form)
    return _from_either_side(fits, made, base, judge)


def _from_either_side(fits: Fits, made: Sequence[Fit], base: Fit, judge: NoiseJudge) -> list[Fit]:
    """Fits of which those with something that rings set out once more, where they explain much.

    They have minima at other frequencies: from either side of the one at which each ended. Of
    minima that are as deep in what is fitted, recordings that were held out tell which it is.
    """
    gained = [judge.gain(base, f).fitted for f in made]
    much = max(MUCH * max(gained, default=0.0), CLOSE)

    def better(one: Fit, gain: float) -> Fit:
        term = one.terms[-1]
        rings = not term.output and 'frequency' in {n.name for n in term.numbers}
        if not rings or gain < much:
            return one
        begun = starts_to_either_side(one, [term])
        tried = [one, *(fits.trial(one, one.terms, begin) for begin in begun)]
        return fits.put(min(foretelling(judge, tried), key=fits.misfit))

    return [better(f, gain) for f, gain in zip(made, gained, strict=True)]


def _other_orders(fits: Fits, base: Fit, first: Prospect) -> list[Fit]:
    """The same low-pass with other orders: from the cut-off with the same delay, or looked for.

    Without a delay, each order weakens the signal after a law of its own.
    """
    order, both = filter_of(first.term)
    (cutoff,) = first.initial.values()
    others = [
        t
        for t in fits.model.terms
        if t.name == first.term.name
        and filter_of(t)[1] == both
        and before_sampling(t) == before_sampling(first.term)
    ]
    here = fits.here if base is fits.place else None

    def begun(p: Prospect) -> Prospect:
        if both:
            seen = screened(fits.model, fits.place, [p.term], fits.segments)
            (best,) = prospects(fits.model, base, seen, fits.segments, here)
            return best
        number, ratio = p.term.numbers[0], LATE[filter_of(p.term)[0]] / LATE[order]
        initial = {key(p.term, number): min(cutoff * ratio, 0.95 * number.upper)}
        return dataclasses.replace(p, initial=initial)

    return fits.make_each(base, [Prospect(t, {}, 0.0) for t in others], begun)


def _distinct(made: Sequence[Fit]) -> list[Fit]:
    """Fits in their order, of every set of names the first alone."""
    found: dict[frozenset[str], Fit] = {}
    for f in made:
        found.setdefault(frozenset(t.name for t in f.terms), f)
    return list(found.values())


def _best_parent(fits: Fits, child: Fit, judge: Judge) -> Fit:
    names = labels_of(child.terms)
    parents = [f for n, f in fits.known.items() if n < names and len(n) == len(names) - 1]
    return min(parents, key=lambda f: judge.criterion(f, fits.baseline), default=fits.baseline)


def _pruned(fits: Fits, best: Fit, judge: Judge) -> Fit:
    return prune(best, fits.baseline, judge, fits.without_each)


def _one_delay(fits: Fits, best: Fit, judge: NoiseJudge) -> Fit:
    """A clock and a filter of which one does nearly all are one delay of a form not quite known.

    Together each can be large and undo the other; what they gain beyond one alone is then no
    more than the form of the filter (analogue, of samples, its order) leaves open, or is gained
    where a recording begins or ends.
    """
    both = [t for t in best.terms if t.name in DELAYING]
    if len(both) < len(DELAYING):
        return best
    others = frozenset(t.label for t in best.terms if t not in both)
    rest = fits.without(best, tuple(t for t in best.terms if t not in both))
    alone = [
        f
        for f in fits.known.values()
        if sum(t.name in DELAYING for t in f.terms) == 1
        and frozenset(t.label for t in f.terms if t.name not in DELAYING) == others
    ]
    if not alone:
        return best
    one = min(alone, key=lambda f: judge.criterion(f, fits.baseline))
    gain, whole = judge.gain(one, best), judge.gain(rest, best).fitted
    inside = _inside(one, best, fits.segments)
    slight = gain.fitted < FORM * whole or inside < judge.needed(gain)
    return fits.polish(one) if slight else best


def _form_of_delay(fits: Fits, best: Fit, judge: NoiseJudge) -> Fit:
    """The best model without a gain that only makes up for the form of a delay.

    A filter far above the signal weakens it by next to nothing, and by how much hangs on its form.
    """
    gains = [t for t in best.terms if t.name == 'wrong_parameter' and not t.own]
    delays = [t for t in best.terms if t.name in DELAYING]
    if not gains or not delays:
        return best
    as_stated = fits.without(best, tuple(t for t in best.terms if t not in gains))
    in_time = fits.without(best, tuple(t for t in best.terms if t not in delays))
    by_gain, by_delay = judge.gain(as_stated, best), judge.gain(in_time, best)
    slight = by_gain.fitted + by_gain.held_out < FORM * (by_delay.fitted + by_delay.held_out)
    return fits.polish(as_stated) if slight else best


def _whole_clock(fits: Fits, best: Fit, judge: NoiseJudge) -> Fit:
    """The best model with offset and rate of a clock, where either alone would do.

    The interval of one alone would say that the other one is exactly right.
    """
    mine = next((t for t in best.terms if t.name == 'clock_error'), None)
    if mine is None or len(mine.numbers) > 1:
        return best
    forms = [
        t
        for t in fits.model.terms
        if t.name == 'clock_error' and t.channel == mine.channel and t is not mine
    ]
    others = frozenset(t.label for t in best.terms if t is not mine)
    told = [fits.known[n] for t in forms if (n := others | {t.label}) in fits.known]
    either = [f for f in told if f.added <= best.added]
    level = judge.criterion(best, fits.baseline) + OPEN
    if all(judge.criterion(f, fits.baseline) > level for f in either):
        return best
    both = next((t for t in forms if len(t.numbers) > 1), None)
    if both is None:
        return best
    whole = fits.polish(fits.make(best, (*(t for t in best.terms if t is not mine), both), {}))
    return whole if judge.better(fits.baseline, whole) else best


def _inside(one: Fit, other: Fit, segments: Sequence[Segment]) -> float:
    """Fall of chi-square from one fit to another, but for the first and last samples.

    What a delay does there hangs on what came before, which nobody has recorded.
    """
    gain = 0.0
    for s, old, new in zip(segments, one.residuals, other.residuals, strict=True):
        if not s.held_out:
            fall = innovations(s, old) ** 2 - innovations(s, new) ** 2
            gain += float(np.sum(fall[EDGE:-EDGE]))
    return gain


def _each_from_other_starts(fits: Fits, best: Fit, judge: NoiseJudge) -> Fit:
    """Each of several effects that has a shape from the starts that promise most beside the rest.

    Found alone it made up for the others, as a stop from the middle on does for a spring: no slope
    leads back from there.
    """
    given = labels_of(fits.baseline.terms)
    new = [t for t in best.terms if t.label not in given]
    shaped = [t for t in new if any(n.name not in t.amounts for n in t.numbers)]
    if len(new) < 2 or not shaped:
        return best
    for term in shaped:
        others = fits.make(best, tuple(t for t in best.terms if t is not term), {})
        fits.from_each_shape(others, term)
    return min(fits.known.values(), key=lambda f: judge.criterion(f, fits.baseline))


def _against_rivals(fits: Fits, best: Fit, judge: NoiseJudge) -> Fit:
    """Each of several terms against what could stand in its place beside the others."""
    given = labels_of(fits.baseline.terms)
    new = [t for t in best.terms if t.label not in given]
    if len(new) > 1:
        for term in new:
            rest = tuple(t for t in best.terms if t.label != term.label)
            _grow(fits, fits.make(best, rest, {}), judge, FITTED // 2)
        same = [f for f in fits.known.values() if f.added <= best.added]
        rival = min(same, key=lambda f: judge.criterion(f, fits.baseline))
        if judge.criterion(rival, fits.baseline) < judge.criterion(best, fits.baseline):
            return _pruned(fits, rival, judge)
    return best
