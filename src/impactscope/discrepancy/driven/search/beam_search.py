"""Beam search: forwards from the baseline with a few models side by side, then backwards.

Candidates are put in order by the share of the residual that their effect could explain once
everything that the model can re-tune has done so (projection of sensitivities); the most
promising are then really fitted. Ordering decides nothing: only fits and their predictions do.
Several models are kept at every step, so that a pair that only works together is found.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.fits.growing_windows import (
    fit_over_growing_windows,
    lost_count,
)
from impactscope.discrepancy.driven.fits.orthonormal import orthonormal
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit, sensitivities
from impactscope.discrepancy.driven.fits.weighted_residuals import channel_scales, in_units
from impactscope.discrepancy.driven.model_selection.model_comparison import Judge, noise_share
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import Number, Term, key
from impactscope.discrepancy.time_limit import time_left

__all__ = ['MOST_NUMBERS', 'Effort', 'Outcome', 'prospects', 'prune', 'search']

Array = NDArray[np.float64]
Start = Callable[[Sequence[Number], Sequence[Term], Sequence[Segment]], Mapping[str, float]]

MOST_NUMBERS = 3  # that may be added to the baseline; one more beside a law of as many
TIE = 2.0  # difference of two criteria that means nothing
ALL_NOISE = 0.9  # of a residual's power
BRIEF = 20  # evaluations after which it is seen which of two starts is better
CLEARLY = 2.0  # standard uncertainties from which an amount is there
AMOUNTS = frozenset(
    {
        'force',
        'force_forward',
        'force_backward',
        'kinetic_force',
        'excess_force',
        'coefficient',
        'corner',
        'difference',
        'cubic',
        'quadratic',
        'gap',
        'stiffness',
        'share',
        'value',
        'rate',
        'offset',
        'drift',
        'sine',
        'cosine',
    }
)
STRENGTHS = (0.2, 5.0)  # by how much a start may be stretched to what the projection asks for


@dataclass(frozen=True, slots=True)
class Effort:
    """How widely a search looks."""

    numbers: int = MOST_NUMBERS  # that may be added to the baseline
    depth: int = 3  # terms that may be added
    tried: int = 5  # candidates that are fitted from each model
    beam: int = 2  # models that are kept at each step
    least: float = 0.0  # chi-square of white noise that a candidate must promise for a fit


USUAL = Effort()


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What a search found; ``rivals`` are other fits, by the names of their terms."""

    baseline: Fit
    best: Fit
    rivals: tuple[Fit, ...]
    believed: bool  # whether the best model is more than the baseline


@dataclass(frozen=True, slots=True)
class _Prospect:
    term: Term
    initial: Mapping[str, float]
    share: float


def _labels(terms: Iterable[Term]) -> frozenset[str]:
    return frozenset(t.label for t in terms)


def _starts(term: Term) -> list[dict[str, float]]:
    """Values that a term is tried from: all firsts, all seconds, and mixed.

    With the baseline's numbers as they are; a law without numbers of its own, which only changes
    what these mean, is tried from those that it states as well.
    """
    choices = [n.starts for n in term.numbers]
    combined = itertools.islice(itertools.product(*choices), 6)
    own = [
        {key(term, n): v for n, v in zip(term.numbers, values, strict=True)} for values in combined
    ]
    return own if term.restart is None or term.numbers else [*own, dict(term.restart)]


def prospects(
    model: Model, base: Fit, candidates: Sequence[Term], segments: Sequence[Segment]
) -> list[_Prospect]:
    """Candidates in order of what they could explain of a fit's residual, best first."""
    residual, retuned = sensitivities(model, base, segments)
    basis = orthonormal(retuned)
    residual = residual - basis @ (basis.T @ residual)
    power = float(residual @ residual) + 1e-300
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    scales = channel_scales(segments)
    found = []
    for term in candidates:
        best: _Prospect | None = None
        for initial in _starts(term):
            values = {**base.values, **initial}
            parts = []
            for i in fitted:
                predicted = model.predict(values, (*base.terms, term), base.starts[i], segments[i])
                before = segments[i].measured - base.residuals[i]
                parts.append(in_units(predicted - before, segments[i], scales))
            change = np.concatenate(parts)
            whole = float(change @ change)
            if not np.isfinite(whole) or whole == 0.0:
                continue
            change = change - basis @ (basis.T @ change)
            length = float(change @ change)
            if length < 1e-16 * whole:
                continue
            along = float(change @ residual)
            share = along * abs(along) / (length * power)
            stretch = float(np.clip(along / length, *STRENGTHS))
            if len(term.numbers) == 1 and not term.restart:
                initial = {k: v * stretch for k, v in initial.items()}
            if best is None or share > best.share:
                best = _Prospect(term, initial, share)
        if best is not None:
            found.append(best)
    return sorted(found, key=lambda p: -p.share)


def _worth_a_fit(
    ordered: Sequence[_Prospect], segments: Sequence[Segment], effort: Effort
) -> list[_Prospect]:
    """The most promising candidates, and every law without numbers.

    A law that stands in the place of another, as the sine of a weight in that of a spring, changes
    everything at once: seen from the other law's best numbers it looks worse than it is.
    """
    samples = sum(s.measured.size for s in segments if not s.held_out)
    first = [p for p in ordered[: effort.tried] if p.share * samples >= effort.least]
    return [*first, *(p for p in ordered[effort.tried :] if not p.term.numbers)]


class _Fits:
    """Fits by the labels of their terms, each made once."""

    def __init__(
        self, model: Model, segments: Sequence[Segment], baseline: Fit, start: Start | None
    ) -> None:
        self.model = model
        self.segments = segments
        self.baseline = baseline
        self.start = start
        self.known: dict[frozenset[str], Fit] = {_labels(baseline.terms): baseline}

    def make(self, base: Fit, terms: tuple[Term, ...], initial: Mapping[str, float]) -> Fit:
        names = _labels(terms)
        if names not in self.known:
            tries = [{**base.values, **initial}]
            if self.start is not None:
                guessed = self.start(self.model.numbers, terms, self.segments)
                if guessed:
                    tries.append({**base.values, **initial, **guessed})
            made = [
                fit(self.model, terms, self.segments, t, base.starts, evaluations=BRIEF)
                for t in tries
            ]
            best = min(made, key=lambda f: f.cost)
            if len(made) > 1 or best.evaluations >= BRIEF:
                best = fit(self.model, terms, self.segments, best.values, best.starts)
            if lost_count(self.model, best, self.segments):
                whole = fit_over_growing_windows(self.model, terms, self.segments, tries[0], base)
                best = min(best, whole, key=lambda f: f.cost)
            self.known[names] = best
        return self.known[names]


def search(
    model: Model,
    baseline: Fit,
    segments: Sequence[Segment],
    judge: Judge,
    progress: Callable[[float], None] | None = None,
    effort: Effort = USUAL,
    start: Start | None = None,
) -> Outcome:
    """Find the smallest set of terms that the recordings cannot do without.

    ``start``: gives further values to set out from.
    """
    fits = _Fits(model, segments, baseline, start)
    beam = [baseline]
    for depth in range(effort.depth):
        if depth and not time_left('further effects'):
            break
        grown: list[Fit] = []
        for base in beam:
            room = _room(base, baseline, effort)
            candidates = [
                t
                for t in model.terms
                if len(t.numbers) <= room and all(t.stands_with(o) for o in base.terms)
            ]
            ordered = prospects(model, base, candidates, segments)
            for prospect in _worth_a_fit(ordered, segments, effort):
                grown.append(fits.make(base, (*base.terms, prospect.term), prospect.initial))
                if progress is not None:
                    share = len(grown) / (effort.tried * len(beam) + 1)
                    progress((depth + share) / effort.depth)
        grown = list({id(f): f for f in grown}.values())
        if not grown:
            break
        for f in grown:
            judge.weights(f)
        grown.sort(key=lambda f: judge.criterion(f, baseline))
        others = [
            fits.make(f, t, v) for f in grown[:1] for t, v in _siblings(model, f, baseline, effort)
        ]
        for f in others:
            judge.weights(f)
        grown = list({id(f): f for f in [*grown, *others]}.values())
        grown.sort(key=lambda f: judge.criterion(f, baseline))
        beam = [*grown[: effort.beam], *_in_plainer_form(grown[: effort.beam], grown)]
        if _only_noise(beam[0], segments):
            break
        if depth > 0 and not any(judge.better(_best_parent(fits, f, judge), f) for f in beam):
            break
    best = _chosen(fits, judge)
    if _evened(fits, best):
        best = _chosen(fits, judge)
    if best is not baseline:
        best = _polish(fits, best)
    level = judge.criterion(best, baseline)
    rivals = tuple(
        f
        for f in fits.known.values()
        if f is not best
        and (judge.criterion(f, baseline) > level or all(_there(f, t) for t in f.terms))
    )
    return Outcome(baseline, best, rivals, len(best.terms) > len(baseline.terms))


def _chosen(fits: _Fits, judge: Judge) -> Fit:
    """The best fit that is believed, all of whose effects are there."""
    baseline = fits.baseline
    given = _labels(baseline.terms)

    def sound(made: Fit) -> tuple[Term, ...]:
        return tuple(t for t in made.terms if t.label in given or _there(made, t))

    first = _plainest(list(fits.known.values()), judge, baseline)
    if sound(first) != first.terms:
        fits.make(first, sound(first), {})
    kept = [f for f in fits.known.values() if sound(f) == f.terms or f is baseline]
    best = _plainest(kept, judge, baseline)
    best = prune(
        best, baseline, judge, lambda fitted, fewer: [fits.make(fitted, f, {}) for f in fewer]
    )
    best = _in_plain_words(best, kept, judge, baseline)
    if best is not baseline and (sound(best) != best.terms or not judge.better(baseline, best)):
        return baseline
    return best


def _there(made: Fit, term: Term) -> bool:
    """Whether any amount of an effect is more than its own uncertainty.

    What predicts better with a number that may as well be none (a damping of any kind under an
    error that accumulates, say) names nothing.
    """
    amounts = [key(term, n) for n in term.numbers if n.name in AMOUNTS]
    stds = [made.std.get(k, math.nan) for k in amounts]
    if not all(math.isfinite(s) for s in stds):
        return True
    return not amounts or any(
        abs(made.values[k]) > CLEARLY * s for k, s in zip(amounts, stds, strict=True)
    )


def _evened(fits: _Fits, best: Fit) -> bool:
    """Try an even friction, alone and with a constant force, where one that differs was chosen.

    Steps that add one effect at a time come by the lopsided law first.
    """
    old = next((t for t in best.terms if t.name == 'asymmetric_friction'), None)
    by_label = {t.label: t for t in fits.model.terms}
    label = 'coulomb_friction' if old is None else old.label.replace('asymmetric', 'coulomb')
    even, load = by_label.get(label), by_label.get('offset')
    if old is None or even is None or load is None:
        return False
    forces = [best.values[key(old, n)] for n in old.numbers if n.name.startswith('force')]
    rest = tuple(t for t in best.terms if t is not old)
    initial = {key(even, even.numbers[0]): sum(forces) / len(forces)}
    fits.make(best, (*rest, even), initial)
    if load.stands_with(even) and all(load.stands_with(t) for t in rest):
        initial[key(load, load.numbers[0])] = 0.5 * (forces[-1] - forces[0])
        fits.make(best, (*rest, even, load), initial)
    return True


def _only_noise(made: Fit, segments: Sequence[Segment]) -> bool:
    """Whether a fit leaves the sensor's noise alone: nothing more can be found in this way."""
    pairs = zip(made.residuals, segments, strict=True)
    return all(noise_share(r, s.noise) > ALL_NOISE for r, s in pairs if not s.held_out)


def _plainest(fits: Sequence[Fit], judge: Judge, baseline: Fit) -> Fit:
    """The best fit, in plain words."""
    best = min(fits, key=lambda f: judge.criterion(f, baseline))
    return _in_plain_words(best, fits, judge, baseline)


def _in_plain_words(best: Fit, fits: Sequence[Fit], judge: Judge, baseline: Fit) -> Fit:
    """Of the fits that say the same as one, that with the fewest lopsided laws.

    Friction that differs by direction and friction beside a constant force are one law in two
    words: what rounding prefers must not name the finding.
    """
    most = judge.criterion(best, baseline) + TIE
    rows = [(_lopsided(f), judge.criterion(f, baseline), i) for i, f in enumerate(fits)]
    alike = [r for r, f in zip(rows, fits, strict=True) if f.added == best.added and r[1] < most]
    return fits[min(alike)[2]] if alike else best


def _lopsided(made: Fit) -> int:
    return sum(t.name.startswith('asymmetric_') for t in made.terms)


def _room(made: Fit, baseline: Fit, effort: Effort) -> int:
    """Numbers that may still be added: a law of many leaves room for one, such as a constant."""
    return effort.numbers + _more(made.terms, baseline, effort) - made.added + baseline.added


def _more(terms: Sequence[Term], baseline: Fit, effort: Effort) -> int:
    given = _labels(baseline.terms)
    return int(any(len(t.numbers) >= effort.numbers for t in terms if t.label not in given))


def _siblings(
    model: Model, made: Fit, baseline: Fit, effort: Effort
) -> list[tuple[tuple[Term, ...], dict[str, float]]]:
    """The same effects in their other forms, with the values that these share."""
    found = []
    for old in made.terms:
        for new in model.terms:
            if new.name != old.name or new.label == old.label:
                continue
            terms = tuple(new if t is old else t for t in made.terms)
            room = effort.numbers + _more(terms, baseline, effort) + baseline.added
            if sum(len(t.numbers) for t in terms) > room:
                continue
            had = {n.name: made.values[key(old, n)] for n in old.numbers}
            none = {n.name: 0.0 if n.lower <= 0.0 else n.starts[0] for n in new.numbers}
            values = {key(new, n): had.get(n.name, none[n.name]) for n in new.numbers}
            found.append((terms, values))
    return found


def _in_plainer_form(kept: Sequence[Fit], grown: Sequence[Fit]) -> list[Fit]:
    """The leading effects in the form with the fewest numbers, where no kept model has it.

    A richer form stands in for whatever else is missing, and leaves no numbers for that.
    """

    def names(made: Fit) -> frozenset[str]:
        return frozenset(t.name for t in made.terms)

    same = [f for f in grown if names(f) == names(kept[0])]
    plain = min(same, key=lambda f: f.added)
    spared = plain.added < min(f.added for f in same if f in kept)
    return [plain] if spared else []


def _best_parent(fits: _Fits, child: Fit, judge: Judge) -> Fit:
    """The best known fit with one term less."""
    names = _labels(child.terms)
    parents = [f for n, f in fits.known.items() if n < names and len(n) == len(names) - 1]
    if not parents:
        return fits.baseline
    return min(parents, key=lambda f: judge.criterion(f, fits.baseline))


def prune(
    best: Fit,
    baseline: Fit,
    judge: Judge,
    make_each: Callable[[Fit, list[tuple[Term, ...]]], list[Fit]],
) -> Fit:
    """Take away terms that the recordings can do without, the weakest first.

    ``make_each`` fits models of fewer terms, starting from the fit that it is given.
    """
    given = {t.label for t in baseline.terms}
    while best is not baseline:
        fewer = [
            tuple(t for t in best.terms if t.label != term.label)
            for term in best.terms
            if term.label not in given
        ]
        kept = [f for f in make_each(best, fewer) if not judge.better(f, best)]
        if not kept:
            break
        best = min(kept, key=lambda f: judge.criterion(f, baseline))
    return best


def _polish(fits: _Fits, best: Fit) -> Fit:
    """Fit once more from where it ended: a second start out of the same valley."""
    again = fit(fits.model, best.terms, fits.segments, best.values, best.starts, tolerance=FINE)
    chosen = again if again.cost <= best.cost else best
    chosen = dataclasses.replace(chosen, label='+'.join(t.label for t in chosen.terms))
    fits.known[_labels(chosen.terms)] = chosen
    return chosen
