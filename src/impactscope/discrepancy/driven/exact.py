"""The search where what a model leaves is the sensor's noise and nothing else.

Then effects of a thousandth of the signal can be told. Each step has three parts: every candidate
is looked at (:mod:`looks`); the best are fitted with everything else; chi-square on the fitted and
on the held-out recordings decides. Then backwards, and each effect against its rivals beside the
others.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.decide import Judge
from impactscope.discrepancy.driven.fitting import Fit, fit, numbers_of
from impactscope.discrepancy.driven.ladders import FRICTION
from impactscope.discrepancy.driven.looks import HOPE, Prospect, looks, prospects, wandered
from impactscope.discrepancy.driven.measuring import before_sampling, filter_of
from impactscope.discrepancy.driven.model import Model, Segment
from impactscope.discrepancy.driven.noise_judge import NoiseJudge, innovations
from impactscope.discrepancy.driven.search import Outcome, prune
from impactscope.discrepancy.driven.tangent import tangent
from impactscope.discrepancy.driven.terms import Term, key

__all__ = ['exact_search']

Array = NDArray[np.float64]
Tell = Callable[[float], None]

FITTED = 9  # candidates that are fitted at the first step; half as many later
CLOSE = 60.0  # chi-square within which a second model is kept beside the best
DEPTH = 3
TOLERANCE = 1e-6  # of chi-square, at which a trial fit ends
BRIEF, EVALUATIONS = 5, 15  # at first, and then where it is worth it
# of an axis, over its value: by which moments of breaking away between samples move a number
LEAST_STD = 1e-5
ROUGH_STD = 0.03  # by which numbers with rough slopes differ from one start to another
LONG = 40  # where everything depends on it
LOST = 1000.0  # chi-square by which a fit is behind the best
NEAR = 14.0  # chi-square within which a rival is fitted as carefully as the best
FAR = 10.0  # times the samples: chi-square from which a search goes on from what was found
POLISHED = 'polished'
DELAYS = ('clock_error', 'low_pass_filter')
EDGE = 64  # samples at either end
RELATIVES = ('stribeck_friction', 'asymmetric_friction')
FORM = 0.01  # of what a delay gains, that its form leaves open
FIRST_ORDER = 2  # of the low-pass that is looked for before its other orders are
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


class _Fits:
    """Joint fits, each made once."""

    def __init__(self, model: Model, segments: Sequence[Segment], baseline: Fit) -> None:
        self.model, self.segments, self.baseline = model, segments, baseline
        self.known: dict[frozenset[str], Fit] = {_labels(baseline.terms): baseline}
        self.look_around(baseline)

    def look_around(self, place: Fit) -> None:
        """Look at every candidate beside a fit, near which the search will be."""
        self.place, self.here = place, tangent(self.model, place, self.segments)
        # a low-pass shows little of an axis' motion: of what order it is matters
        first = [
            t
            for t in self.model.terms
            if t.name != 'low_pass_filter' or self.model.drifts or filter_of(t)[0] == FIRST_ORDER
        ]
        self.looks = looks(self.model, place, first, self.segments)
        # what is tuned in every fit; its derivatives change little from one to the next
        self.tuned: Array | None = None
        if not self.model.drifts:  # where errors add up they change
            count = len(numbers_of(self.model, self.baseline.terms))
            self.tuned = -self.here.slopes[:, :count]

    def make(
        self,
        base: Fit,
        terms: tuple[Term, ...],
        initial: Mapping[str, float],
        other: Mapping[str, float] | None = None,
    ) -> Fit:
        """The fit with these terms, the better one where there are two starts."""
        names = _labels(terms)
        if names not in self.known:
            tries = [self._fit(base, terms, initial)]
            # with one number alone, or one way to be large, both starts end in the same place
            if other is not None and len(terms[-1].numbers) > 1:
                tries.append(self._fit(base, terms, other))
            self.known[names] = min(tries, key=self._misfit)
        return self.known[names]

    def _fit(self, base: Fit, terms: tuple[Term, ...], initial: Mapping[str, float]) -> Fit:
        scaled = tuple(_measured_by(t, initial) for t in terms)
        whole = _labels(self.baseline.terms) <= _labels(terms)
        values, starts = {**base.values, **initial}, base.starts
        for evaluations in (BRIEF, EVALUATIONS):
            made = fit(
                self.model,
                scaled,
                self.segments,
                values,
                starts,
                evaluations,
                TOLERANCE,
                self.tuned if whole else None,
            )
            if made.evaluations < evaluations or self._behind(made):
                break
            values, starts = dict(made.values), made.starts
        return made

    def _to_the_end(self, made: Fit) -> Fit:
        return fit(
            self.model, made.terms, self.segments, made.values, made.starts, LONG, TOLERANCE
        )

    def _behind(self, made: Fit) -> bool:
        """Whether a fit is so far from the best that its last digits do not matter."""
        best = min(self._misfit(f) for f in self.known.values())
        excess = self._misfit(made) - best
        return excess > max(LOST, 0.5 * (self._misfit(self.place) - best))

    def without(self, base: Fit, terms: tuple[Term, ...]) -> Fit:
        """The fit with fewer terms, from where the larger one has ended, too."""
        names = _labels(terms)
        if names == _labels(self.baseline.terms):
            return self.baseline
        again = self._fit(base, terms, {})
        if self.model.drifts:  # a companion that only helped the fit on its way must not stay
            again = self._to_the_end(again)
        known = self.known.get(names)
        if known is None or self._misfit(again) < self._misfit(known):
            self.known[names] = again
        return self.known[names]

    def take(self, made: Fit) -> Fit:
        """A fit that was made elsewhere, converged here."""
        names = _labels(made.terms)
        if names not in self.known:
            self.known[names] = fit(
                self.model, made.terms, self.segments, made.values, made.starts, 3 * EVALUATIONS
            )
        return self.known[names]

    def _misfit(self, made: Fit) -> float:
        """Chi-square on the fitted recordings."""
        pairs = zip(self.segments, made.residuals, strict=True)
        return float(sum(np.sum(innovations(s, r) ** 2) for s, r in pairs if not s.held_out))

    def polish(self, made: Fit) -> Fit:
        """A fit once more, with every derivative taken anew."""
        if made.label != POLISHED and made is not self.baseline:
            names = _labels(made.terms)
            better = fit(
                self.model,
                made.terms,
                self.segments,
                made.values,
                made.starts,
                EVALUATIONS,
                TOLERANCE,
            )
            rough = {key(t, n) for t in made.terms if t.rough for n in t.numbers}
            least = LEAST_STD if self.model.drifts else 0.0
            std = {
                k: max(v, (ROUGH_STD if k in rough else least) * abs(better.values[k]))
                for k, v in better.std.items()
            }
            self.known[names] = dataclasses.replace(better, label=POLISHED, std=std)
        return self.known[_labels(made.terms)]


def _measured_by(term: Term, initial: Mapping[str, float]) -> Term:
    """A term whose amounts are measured by the values that they start from."""
    numbers = []
    for n in term.numbers:
        size = abs(initial.get(key(term, n), 0.0))
        numbers.append(
            dataclasses.replace(n, scale=size) if n.name in term.amounts and size > 0.0 else n
        )
    return dataclasses.replace(term, numbers=tuple(numbers))


def _labels(terms: Sequence[Term]) -> frozenset[str]:
    return frozenset(t.label for t in terms)


def exact_search(
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
    fits = _Fits(model, segments, baseline)
    beam = [baseline]
    if seed is not None and seed.terms:
        start = fits.take(seed)
        if judge.gain(baseline, start).fitted > FAR * sum(s.measured.size for s in segments):
            beam = [start]
            fits.look_around(start)
    for depth in range(DEPTH):
        grown: list[Fit] = []
        for base in beam:
            grown += _grow(fits, base, FITTED if depth == 0 else FITTED // 2)
        tell((depth + 1) / (DEPTH + 1))
        if not grown:
            break
        grown.sort(key=lambda f: judge.criterion(f, baseline))
        believed = [f for f in grown if judge.better(_best_parent(fits, f, judge), f)]
        if not believed:
            break
        level = judge.criterion(grown[0], baseline)
        close = [f for f in _distinct(grown) if judge.criterion(f, baseline) < level + CLOSE]
        beam = close[:2]
    best = min(fits.known.values(), key=lambda f: judge.criterion(f, baseline))
    best = _pruned(fits, best, judge)
    best = _pruned(fits, _plain_friction(fits, best, judge), judge)
    best = _pruned(fits, _other_friction(fits, best, judge), judge)
    best = _other_asymmetry(fits, best, judge)
    best = _against_rivals(fits, best, judge)
    best = _pruned(fits, _friction_of_baseline(fits, best, judge), judge)
    level = judge.criterion(best, baseline) + NEAR
    for made in [f for f in fits.known.values() if judge.criterion(f, baseline) < level]:
        fits.polish(made)
    best = min(fits.known.values(), key=lambda f: judge.criterion(f, baseline))
    best = _one_delay(fits, fits.polish(_pruned(fits, best, judge)), judge)
    if best is not baseline and not judge.better(baseline, best):
        best = baseline
    rivals = tuple(f for f in fits.known.values() if f is not best)
    return Outcome(baseline, best, rivals, best is not baseline)


def _grow(fits: _Fits, base: Fit, most: int) -> list[Fit]:
    """Fits with one term more; the friction family starts from its simplest member."""
    candidates = [look for look in fits.looks if all(look.term.stands_with(o) for o in base.terms)]
    here = fits.here if base is fits.place else None
    ranked = prospects(fits.model, base, candidates, fits.segments, here)
    made: list[Fit] = []
    names: dict[str, int] = {}
    for p in ranked:
        if len(made) >= most or p.gain < HOPE:
            break
        names[p.term.name] = names.get(p.term.name, 0) + 1
        if names[p.term.name] > 3:
            continue
        if p.term.rough and here is not None:
            begin = wandered(fits.model, base, p, fits.segments, here)
            p = dataclasses.replace(p, initial=begin, other=None)
        made.append(fits.make(base, (*base.terms, p.term), p.initial, p.other))
    best = max(ranked, key=lambda p: p.gain, default=None)
    forms: set[bool] = set()
    for p in ranked:
        if p.term.name == 'low_pass_filter' and best is not None and p.gain > 0.5 * best.gain:
            if before_sampling(p.term) not in forms:
                made += _other_orders(fits, base, p)
            forms.add(before_sampling(p.term))
    return made


def _other_orders(fits: _Fits, base: Fit, first: Prospect) -> list[Fit]:
    """The same low-pass with other orders, from the cut-off with the same delay."""
    made = []
    order, both = filter_of(first.term)
    (cutoff,) = first.initial.values()
    for term in fits.model.terms:
        if term.name != first.term.name or filter_of(term)[1] != both:
            continue
        if before_sampling(term) != before_sampling(first.term):
            continue
        ratio = 1.0 if both else LATE[filter_of(term)[0]] / LATE[order]
        number = term.numbers[0]
        initial = {key(term, number): min(cutoff * ratio, 0.95 * number.upper)}
        made.append(fits.make(base, (*base.terms, term), initial))
    return made


def _distinct(made: Sequence[Fit]) -> list[Fit]:
    """Fits in their order, of every set of names the first alone."""
    found: dict[frozenset[str], Fit] = {}
    for f in made:
        found.setdefault(frozenset(t.name for t in f.terms), f)
    return list(found.values())


def _best_parent(fits: _Fits, child: Fit, judge: Judge) -> Fit:
    names = _labels(child.terms)
    parents = [f for n, f in fits.known.items() if n < names and len(n) == len(names) - 1]
    return min(parents, key=lambda f: judge.criterion(f, fits.baseline), default=fits.baseline)


def _pruned(fits: _Fits, best: Fit, judge: Judge) -> Fit:
    return prune(best, fits.baseline, judge, fits.without)


def _plain_friction(fits: _Fits, best: Fit, judge: Judge) -> Fit:
    """A friction of several numbers against the one of the same force both ways.

    A search that goes on from a seed may never have tried it.
    """
    plain = next((t for t in fits.model.terms if t.label == 'coulomb_friction'), None)
    old = next((t for t in best.terms if t.name in FRICTION and len(t.numbers) > 1), None)
    if plain is None or old is None:
        return best
    sides = ('force_forward', 'force_backward', 'kinetic_force')
    forces = [best.values[key(old, n)] for n in old.numbers if n.name in sides]
    if not forces:
        return best
    rest = tuple(t for t in best.terms if t is not old)
    initial = {key(plain, plain.numbers[0]): sum(forces) / len(forces)}
    made = fits.make(best, (*rest, plain), initial)
    return best if judge.better(made, best) else made


def _other_friction(fits: _Fits, best: Fit, judge: Judge) -> Fit:
    """A friction that differs by direction against one with a peak at rest and an offset.

    The first of these is what the second looks like as long as one effect at a time is added.
    """
    old = next((t for t in best.terms if t.name == 'asymmetric_friction'), None)
    offset = next((t for t in fits.model.terms if t.name == 'offset'), None)
    if old is None or offset is None:
        return best
    forces = [best.values[key(old, n)] for n in old.numbers if n.name.startswith('force')]
    mean = sum(forces) / len(forces)
    rest = tuple(t for t in best.terms if t is not old)
    for term in fits.model.terms:
        if term.name != 'stribeck_friction' or not all(term.stands_with(t) for t in rest):
            continue
        terms = (*rest, offset, term)
        sizes = {'kinetic_force': 0.8 * mean, 'excess_force': 0.4 * mean}
        initial = {key(term, n): sizes.get(n.name, n.starts[0]) for n in term.numbers}
        initial[key(offset, offset.numbers[0])] = 0.5 * (forces[0] - forces[-1])
        speed = next(n for n in term.numbers if n.name == 'speed')
        later = {**initial, key(term, speed): speed.starts[len(speed.starts) // 2]}
        fits.make(best, terms, initial, later)
    return min(fits.known.values(), key=lambda f: judge.criterion(f, fits.baseline))


def _friction_of_baseline(fits: _Fits, best: Fit, judge: Judge) -> Fit:
    """A plain friction that the baseline has against its relatives, which stand in its place.

    They cannot be found beside it.
    """
    old = next((t for t in fits.baseline.terms if t.name == 'coulomb_friction'), None)
    if old is None:
        return best
    known = {n.name: fits.baseline.values[key(old, n)] for n in old.numbers}
    size = known.pop('force')
    known |= {'force_forward': size, 'force_backward': size}
    known |= {'kinetic_force': 0.9 * size, 'excess_force': 0.2 * size}
    for base in (fits.baseline, best):
        rest = tuple(t for t in base.terms if t is not old)
        for term in fits.model.terms:
            if term.name not in RELATIVES or not all(term.stands_with(t) for t in rest):
                continue
            first = {key(term, n): known.get(n.name, n.starts[0]) for n in term.numbers}
            last = {key(term, n): known.get(n.name, n.starts[-1]) for n in term.numbers}
            fits.make(base, (*rest, term), first, last)
    return min(fits.known.values(), key=lambda f: judge.criterion(f, fits.baseline))


def _other_asymmetry(fits: _Fits, best: Fit, judge: Judge) -> Fit:
    """A friction that differs by direction against an even one and a load that stays."""
    old = next((t for t in best.terms if t.name == 'asymmetric_friction'), None)
    even = next((t for t in fits.model.terms if t.label == 'coulomb_friction'), None)
    if old is None or even is None:
        return best
    forces = [best.values[key(old, n)] for n in old.numbers if n.name.startswith('force')]
    mean, load = sum(forces) / len(forces), 0.5 * (forces[-1] - forces[0])
    rest = tuple(t for t in best.terms if t is not old)
    stiffness = best.values.get('stiffness', 1.0)
    for offset in fits.model.terms:
        if offset.name == 'offset' and all(offset.stands_with(t) for t in (*rest, even)):
            size = load / stiffness if offset.output else load
            initial = {key(even, even.numbers[0]): mean, key(offset, offset.numbers[0]): size}
            fits.make(best, (*rest, even, offset), initial)
    return min(fits.known.values(), key=lambda f: judge.criterion(f, fits.baseline))


def _one_delay(fits: _Fits, best: Fit, judge: NoiseJudge) -> Fit:
    """A clock and a filter of which one does nearly all are one delay of a form not quite known.

    Together each can be large and undo the other; what they gain beyond one alone is then no
    more than the form of the filter (analogue, of samples, its order) leaves open, or is gained
    where a recording begins or ends.
    """
    both = [t for t in best.terms if t.name in DELAYS]
    if len(both) < len(DELAYS):
        return best
    others = frozenset(t.label for t in best.terms if t not in both)
    rest = fits.without(best, tuple(t for t in best.terms if t not in both))
    alone = [
        f
        for f in fits.known.values()
        if sum(t.name in DELAYS for t in f.terms) == 1
        and frozenset(t.label for t in f.terms if t.name not in DELAYS) == others
    ]
    if not alone:
        return best
    one = min(alone, key=lambda f: judge.criterion(f, fits.baseline))
    gain, whole = judge.gain(one, best), judge.gain(rest, best).fitted
    inside = _inside(one, best, fits.segments)
    slight = gain.fitted < FORM * whole or inside < judge.needed(gain)
    return fits.polish(one) if slight else best


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


def _against_rivals(fits: _Fits, best: Fit, judge: Judge) -> Fit:
    """Each of several terms against what could stand in its place beside the others."""
    given = _labels(fits.baseline.terms)
    new = [t for t in best.terms if t.label not in given]
    if len(new) > 1:
        for term in new:
            rest = tuple(t for t in best.terms if t.label != term.label)
            _grow(fits, fits.make(best, rest, {}), FITTED // 2)
        same = [f for f in fits.known.values() if f.added <= best.added]
        rival = min(same, key=lambda f: judge.criterion(f, fits.baseline))
        if judge.criterion(rival, fits.baseline) < judge.criterion(best, fits.baseline):
            return _pruned(fits, rival, judge)
    return best
