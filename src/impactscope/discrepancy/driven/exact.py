"""The search where what a model leaves is the sensor's noise and nothing else.

Then every sample counts, the fall of chi-square is that of Wilks' theorem, and effects of a
thousandth of the signal can be told. Each step has three parts: every candidate is simulated from
a ladder of start values and projected on what the model cannot re-tune; the best are fitted with
everything else; chi-square on the fitted and on the held-out recordings decides. Then backwards,
and each effect against its rivals beside the others.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.decide import Gain, Judge
from impactscope.discrepancy.driven.fitting import Fit, fit, numbers_of
from impactscope.discrepancy.driven.measuring import filter_of
from impactscope.discrepancy.driven.model import Model, Segment
from impactscope.discrepancy.driven.search import Outcome, prune
from impactscope.discrepancy.driven.terms import Term, key
from impactscope.discrepancy.evidence import Thresholds, family_p_value, least_gain

__all__ = ['NoiseJudge', 'exact_search', 'innovations', 'tangent']

Array = NDArray[np.float64]
Tell = Callable[[float], None]

PRICE = 7.0  # chi-square that a further number must bring to be preferred
LOOKS = 60  # independent candidates, about
FITTED = 9  # candidates that are fitted at the first step; half as many later
HOPE = 8.0  # chi-square below which the first look leaves a candidate alone
CLOSE = 60.0  # chi-square within which a second model is kept beside the best
DEPTH = 3
TOLERANCE = 1e-6  # of chi-square, at which a trial fit ends
EVALUATIONS = 15
NEAR = 14.0  # chi-square within which a rival is fitted as carefully as the best
POLISHED = 'polished'
STEP = 1e-4
FIRST_ORDER = 2  # of the low-pass that is looked for before its other orders are
LATE = {1: 1.0, 2: 1.414, 3: 2.0, 4: 2.613, 6: 3.864, 8: 5.126}  # delay times corner, 1/(2 pi)


def innovations(segment: Segment, residual: Array) -> Array:
    """A residual, whitened and in units of its noise, shape (n,)."""
    assert segment.whitener is not None  # noqa: S101 - only such segments come here
    return segment.whitener(residual)


class NoiseJudge(Judge):
    """Chi-square decides: residuals are the sensor's noise."""

    def __init__(
        self,
        segments: Sequence[Segment],
        loud: Sequence[float] | None = None,
        thresholds: Thresholds | None = None,
    ) -> None:
        """``loud``: by segment, chi-square that the force's noise brings in by direct passage."""
        super().__init__(segments, LOOKS, thresholds)
        self.loud = tuple(loud) if loud is not None else (0.0,) * len(segments)
        self._known: dict[int, tuple[float, ...]] = {}

    def chi_squares(self, made: Fit) -> tuple[float, ...]:
        """Chi-square of each segment.

        A low-pass smooths the force's noise in the prediction, which is no merit of its own: what
        that brings is added again.
        """
        if id(made) not in self._known:
            parts = [innovations(s, r) for s, r in zip(self.segments, made.residuals, strict=True)]
            smooth = _share_beyond(made, 1.0 / self.segments[0].period)
            self._known[id(made)] = tuple(
                float(p @ p) + smooth * loud for p, loud in zip(parts, self.loud, strict=True)
            )
            self._keep.append(made)
        return self._known[id(made)]

    def weights(self, fit: Fit) -> tuple[float, ...]:  # noqa: ARG002
        """Samples that count in each segment: all."""
        return tuple(float(s.measured.size) for s in self.segments)

    def gain(self, small: Fit, large: Fit, weights: Sequence[float] | None = None) -> Gain:  # noqa: ARG002
        """Fall of chi-square from one fit to another."""
        fitted = held_out = count = 0.0
        pairs = zip(self.segments, self.chi_squares(small), self.chi_squares(large), strict=True)
        for segment, before, after in pairs:
            if segment.held_out:
                held_out += before - after
            else:
                fitted += before - after
                count += segment.measured.size
        worse = held_out < -self.thresholds.held_out_loss - 0.1 * max(fitted, 0.0)
        return Gain(fitted, held_out, worse, large.added - small.added, count)

    def needed(self, gain: Gain) -> float:
        """Gain from which the larger model is believed."""
        return least_gain(max(gain.numbers, 1), self.looks, self.thresholds.false_finding)

    def criterion(self, fit: Fit, reference: Fit) -> float:
        """Minus the gain over a reference, and a price for every number: smaller is better."""
        return -self.gain(reference, fit).total + PRICE * (fit.added - reference.added)

    def p_value(self, small: Fit, large: Fit) -> float:
        """Chance of such a gain where nothing is missing."""
        gain = self.gain(small, large)
        return family_p_value(max(gain.total, 0.0), max(gain.numbers, 1), self.looks)


def _share_beyond(made: Fit, rate: float) -> float:
    """Share of white noise that a fit's low-pass takes away; 0 without one."""
    for term in made.terms:
        if term.name == 'low_pass_filter':
            return max(1.0 - 2.0 * made.values[f'{term.label}.cutoff'] / rate, 0.0)
    return 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Tangent:
    """A fit's whitened residual and what its numbers can re-tune, on the fitted recordings."""

    residual: Array  # projected, shape (n,)
    basis: Array  # orthonormal rows, shape (k, n)
    slopes: Array  # of the prediction by the fit's numbers over their scales, shape (n, k)

    def explained(self, columns: Array) -> tuple[float, Array]:
        """Chi-square that columns, shape (c, n), could take away, and by which factors."""
        seen = columns @ self.basis.T
        gram = columns @ columns.T - seen @ seen.T
        along = columns @ self.residual
        size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        factors = np.linalg.lstsq(gram / np.outer(size, size), along / size, rcond=1e-9)[0] / size
        return float(factors @ along), np.asarray(factors)

    def taken(self, column: Array) -> float:
        """Chi-square that a change, shape (n,), takes away as it is."""
        seen = self.basis @ column
        return float(2.0 * (column @ self.residual) - column @ column + seen @ seen)


def tangent(model: Model, made: Fit, segments: Sequence[Segment]) -> Tangent:
    """Linear picture of a fit."""
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    residual = np.concatenate([innovations(segments[i], made.residuals[i]) for i in fitted])
    columns = []
    for name, number in numbers_of(model, made.terms):
        step = STEP * number.scale
        moved = {**made.values, name: made.values[name] + step}
        columns.append(change(model, made, made.terms, moved, segments) / STEP)
    matrix = np.stack(columns, axis=1)
    size = np.linalg.norm(matrix, axis=0)
    u, s, _ = np.linalg.svd(matrix / np.where(size > 0.0, size, 1.0), full_matrices=False)
    basis = np.ascontiguousarray(u[:, s > 1e-9 * s[0]].T)
    return Tangent(residual - basis.T @ (basis @ residual), basis, matrix)


def change(
    model: Model,
    made: Fit,
    terms: tuple[Term, ...],
    values: Mapping[str, float],
    segments: Sequence[Segment],
) -> Array:
    """Whitened change of the prediction on the fitted recordings, shape (n,)."""
    parts = []
    for i, segment in enumerate(segments):
        if segment.held_out:
            continue
        predicted = model.predict(values, terms, made.starts[i], segment)
        parts.append(innovations(segment, predicted - (segment.measured - made.residuals[i])))
    return np.concatenate(parts)


@dataclass(frozen=True, slots=True)
class _Prospect:
    term: Term
    initial: Mapping[str, float]
    gain: float
    other: Mapping[str, float] | None = None  # the next best start


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """What a term does to the baseline's prediction from one start; rows (c, n) by amount."""

    term: Term
    start: Mapping[str, float]
    rows: NDArray[np.float32]

    def prospect(self, here: Tangent, plate: Mapping[str, float]) -> _Prospect:
        """What it could explain beside a fit, linearly."""
        gain, factors = here.explained(self.rows.astype(np.float64))
        found = dict(self.start)
        amounts = [n for n in self.term.numbers if n.name in self.term.amounts]
        if not amounts:
            for n in self.term.numbers:
                if f'/{n.name}' in self.term.amounts and factors[0] > 0.0:
                    name = key(self.term, n)
                    value = self.start[name] / float(np.clip(factors[0], 1e-2, 1e6))
                    found[name] = min(max(value, n.lower + 1e-3 * n.scale), n.upper)
                    found |= _on_soft_base(
                        plate, found[name], found[f'{self.term.label}.frequency']
                    )
            return _Prospect(self.term, found, gain if factors[0] > 0.0 else 0.0)
        for n, factor in zip(amounts, factors, strict=True):
            name = key(self.term, n)
            value = self.start[name] * float(np.clip(factor, -1e3, 1e3))
            if not n.lower <= value <= n.upper and len(amounts) == 1:
                gain = 0.0
            found[name] = min(max(value, n.lower + 1e-3 * n.scale), n.upper)
        return _Prospect(self.term, found, gain)


def _on_soft_base(plate: Mapping[str, float], mass: float, frequency: float) -> dict[str, float]:
    """The plate's stiffness that keeps its natural frequency on a base that gives way."""
    load = plate['stiffness']  # mass of the plate times its natural frequency squared
    natural = load / plate['mass']
    base = mass * ((2.0 * math.pi * frequency) ** 2 - natural)
    stiffer = load * base / (base - load) if base != load else load
    return {'stiffness': stiffer} if stiffer > 0.0 else {}


def looks(
    model: Model, made: Fit, terms: Sequence[Term], segments: Sequence[Segment]
) -> list[_Look]:
    """Every term from every start, simulated once beside the baseline.

    Beside other models the same is taken: effects that are small against the motion add up.
    """
    found = []
    for term in terms:
        both = (*made.terms, term)
        for start in _starts(term):
            whole = change(model, made, both, {**made.values, **start}, segments)
            if not np.all(np.isfinite(whole)) or float(whole @ whole) < 1e-12:
                continue
            rows = [whole]
            amounts = [n for n in term.numbers if n.name in term.amounts]
            if len(amounts) > 1:
                rows = []
                for n in amounts:
                    half = {**made.values, **start, key(term, n): 0.5 * start[key(term, n)]}
                    rows.append(2.0 * (whole - change(model, made, both, half, segments)))
            found.append(_Look(term, start, np.stack(rows).astype(np.float32)))
    return found


def prospects(
    model: Model,
    made: Fit,
    candidates: Sequence[_Look],
    segments: Sequence[Segment],
    here: Tangent | None = None,
) -> list[_Prospect]:
    """The best start of every candidate, by the chi-square that it could take away."""
    here = tangent(model, made, segments) if here is None else here
    best: dict[str, list[_Prospect]] = {}
    for look in candidates:
        best.setdefault(look.term.label, []).append(look.prospect(here, made.values))
    found = []
    for tried in best.values():
        tried.sort(key=lambda p: -p.gain)
        again = sorted((_again(model, made, p, here, segments) for p in tried[:2]), key=_gained)
        other = again[0].initial if len(again) > 1 and again[0].gain > HOPE else None
        found.append(dataclasses.replace(again[-1], other=other))
    return sorted(found, key=lambda p: -p.gain)


def _gained(prospect: _Prospect) -> float:
    return prospect.gain


def _starts(term: Term) -> list[dict[str, float]]:
    combined = itertools.product(*(n.starts for n in term.numbers))
    return [
        {key(term, n): v for n, v in zip(term.numbers, values, strict=True)} for values in combined
    ]


def _again(
    model: Model, made: Fit, prospect: _Prospect, here: Tangent, segments: Sequence[Segment]
) -> _Prospect:
    """A promising start, simulated beside the fit itself."""
    if prospect.gain < HOPE or not prospect.term.amounts:
        return prospect
    values = {**made.values, **prospect.initial}
    effect = change(model, made, (*made.terms, prospect.term), values, segments)
    if not np.all(np.isfinite(effect)):
        return dataclasses.replace(prospect, gain=0.0)
    taken = here.taken(effect)
    if taken >= HOPE:
        return dataclasses.replace(prospect, gain=taken)
    # not straight in its amount: the fit has to find it
    return dataclasses.replace(prospect, gain=0.5 * prospect.gain)


class _Fits:
    """Joint fits, each made once."""

    def __init__(self, model: Model, segments: Sequence[Segment], baseline: Fit) -> None:
        self.model, self.segments, self.baseline = model, segments, baseline
        self.here = tangent(model, baseline, segments)
        first = [
            t for t in model.terms if t.name != 'low_pass_filter' or filter_of(t)[0] == FIRST_ORDER
        ]
        self.looks = looks(model, baseline, first, segments)
        self.known: dict[frozenset[str], Fit] = {_labels(baseline.terms): baseline}

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
        values = {**base.values, **initial}
        return fit(
            self.model,
            scaled,
            self.segments,
            values,
            base.starts,
            EVALUATIONS,
            TOLERANCE,
            -self.here.slopes,
        )

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
            self.known[names] = dataclasses.replace(better, label=POLISHED)
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
) -> Outcome:
    """Find the smallest set of terms that chi-square cannot do without."""
    tell = progress or (lambda _share: None)
    fits = _Fits(model, segments, baseline)
    beam = [baseline]
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
    best = _against_rivals(fits, best, judge)
    level = judge.criterion(best, baseline) + NEAR
    for made in [f for f in fits.known.values() if judge.criterion(f, baseline) < level]:
        fits.polish(made)
    best = min(fits.known.values(), key=lambda f: judge.criterion(f, baseline))
    best = fits.polish(_pruned(fits, best, judge))
    if best is not baseline and not judge.better(baseline, best):
        best = baseline
    rivals = tuple(f for f in fits.known.values() if f is not best)
    return Outcome(baseline, best, rivals, best is not baseline)


def _grow(fits: _Fits, base: Fit, most: int) -> list[Fit]:
    """Fits with one term more; the friction family starts from its simplest member."""
    candidates = [look for look in fits.looks if all(look.term.stands_with(o) for o in base.terms)]
    here = fits.here if base is fits.baseline else None
    ranked = prospects(fits.model, base, candidates, fits.segments, here)
    made: list[Fit] = []
    names: dict[str, int] = {}
    for p in ranked:
        if len(made) >= most or p.gain < HOPE:
            break
        names[p.term.name] = names.get(p.term.name, 0) + 1
        if names[p.term.name] > 3:
            continue
        made.append(fits.make(base, (*base.terms, p.term), p.initial, p.other))
    best = max(ranked, key=lambda p: p.gain, default=None)
    for p in ranked:
        if p.term.name == 'low_pass_filter' and best is not None and p.gain > 0.5 * best.gain:
            made += _other_orders(fits, base, p)
            break
    return made


def _other_orders(fits: _Fits, base: Fit, first: _Prospect) -> list[Fit]:
    """The same low-pass with other orders, from the cut-off with the same delay."""
    made = []
    order, both = filter_of(first.term)
    (cutoff,) = first.initial.values()
    for term in fits.model.terms:
        if term.name != first.term.name or filter_of(term)[1] != both:
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
    return prune(best, fits.baseline, judge, lambda fitted, rest: fits.make(fitted, rest, {}))


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


def reduced(judge: NoiseJudge, made: Fit) -> float:
    """Chi-square of a fit over the number of samples, on the fitted recordings."""
    pairs = zip(judge.segments, judge.chi_squares(made), strict=True)
    rows = [(c, s.measured.size) for s, c in pairs if not s.held_out]
    return math.fsum(c for c, _ in rows) / max(sum(n for _, n in rows), 1)
