"""Joint fits of several effects where the residual is noise; each is made once."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.fits.innovations import innovations
from impactscope.discrepancy.driven.fits.linearisation import linearised
from impactscope.discrepancy.driven.fits.simulation_error import Fit, fit
from impactscope.discrepancy.driven.fits.weighted_residuals import numbers_of
from impactscope.discrepancy.driven.models.measuring_chain import filter_of
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import Term, key
from impactscope.discrepancy.driven.search.screening import (
    HOPE,
    Prospect,
    ScreenedStart,
    of_each_shape,
    prospects,
    screened,
)
from impactscope.discrepancy.processes import in_processes

__all__ = ['Fits', 'labels_of', 'measured_by']

Array = NDArray[np.float64]

TOLERANCE = 1e-6  # of chi-square, at which a trial fit ends
BRIEF, EVALUATIONS = 5, 15  # at first, and then where it is worth it
# of an axis, over its value: by which moments of breaking away between samples move a number
LEAST_STD = 1e-5
ROUGH_STD = 0.03  # by which numbers with rough slopes differ from one start to another
LONG = 40  # where everything depends on it
SHAPES = 6  # of an effect that are tried beside others
LOST = 1000.0  # chi-square by which a fit is behind the best
POLISHED = 'polished'
# of the low-pass that is looked for before its other orders are: one with a delay shows that
# first, while what orders without one do to a signal has nothing in common
FIRST_ORDER, FIRST_ORDERS_WITHOUT_DELAY = 2, (1, 2)


class Fits:
    """Joint fits, each made once."""

    def __init__(self, model: Model, segments: Sequence[Segment], baseline: Fit) -> None:
        self.model, self.segments, self.baseline = model, segments, baseline
        self.known: dict[frozenset[str], Fit] = {labels_of(baseline.terms): baseline}
        self._smaller: set[tuple[Fit, frozenset[str]]] = set()  # fitted from a larger one already
        self.look_around(baseline)

    def look_around(self, place: Fit) -> None:
        """Look at every candidate beside a fit, near which the search will be."""
        self.place, self.here = place, linearised(self.model, place, self.segments)
        # a low-pass shows little of an axis' motion: of what order it is matters
        first = [t for t in self.model.terms if self.model.drifts or _looked_at(t)]
        self.looks = screened(self.model, place, first, self.segments)
        self.looks_of_all: list[ScreenedStart] | None = None  # with recordings held out, if asked
        # what is tuned in every fit; its derivatives change little from one to the next
        self.tuned: Array | None = None
        if not self.model.drifts:  # where errors add up they change
            count = len(numbers_of(self.model, self.baseline.terms))
            self.tuned = -self.here.slopes[:, :count]

    def shown_by_all(self, base: Fit) -> list[Prospect]:
        """What all recordings together, those held out among them, show beside a fit.

        Slow or far motions may be in those held out alone; fitted it is to the others.
        """
        opened = [dataclasses.replace(s, held_out=False) for s in self.segments]
        if self.looks_of_all is None:
            terms = {look.term.label: look.term for look in self.looks}
            self.looks_of_all = screened(self.model, self.place, list(terms.values()), opened)
        able = [
            look for look in self.looks_of_all if all(look.term.stands_with(o) for o in base.terms)
        ]
        return [p for p in prospects(self.model, base, able, opened) if p.gain >= HOPE]

    def make(
        self,
        base: Fit,
        terms: tuple[Term, ...],
        initial: Mapping[str, float],
        other: Mapping[str, float] | None = None,
    ) -> Fit:
        """The fit with these terms, the better one where there are two starts."""
        names = labels_of(terms)
        if names not in self.known:
            self.known[names] = self._better_of(base, terms, initial, other, self._least())
        return self.known[names]

    def make_each(
        self,
        base: Fit,
        chosen: Sequence[Prospect],
        improved: Callable[[Prospect], Prospect] = lambda prospect: prospect,
    ) -> list[Fit]:
        """Fits with one term more each, side by side but for the first, the most promising.

        ``improved`` gives a better start of a prospect, just before it is fitted.
        """

        def made(prospect: Prospect, least: float) -> Fit:
            begun = improved(prospect)
            terms = (*base.terms, begun.term)
            return self._better_of(base, terms, begun.initial, begun.other, least)

        names = [labels_of((*base.terms, p.term)) for p in chosen]
        new = {n: p for n, p in zip(names, chosen, strict=True) if n not in self.known}
        first, rest = list(new.items())[:1], list(new.items())[1:]
        for name, prospect in first:
            self.known[name] = made(prospect, self._least())
        least = self._least()
        found = in_processes(lambda item: made(item[1], least), rest)
        self.known.update(zip((name for name, _ in rest), found, strict=True))
        return [self.known[name] for name in names]

    def _better_of(
        self,
        base: Fit,
        terms: tuple[Term, ...],
        initial: Mapping[str, float],
        other: Mapping[str, float] | None,
        least: float,
    ) -> Fit:
        tries = [self._fit(base, terms, initial, least)]
        # with one number alone, or one way to be large, both starts end in the same place
        if other is not None and len(terms[-1].numbers) > 1:
            tries.append(self._fit(base, terms, other, least))
        return min(tries, key=self.misfit)

    def _least(self) -> float:
        return min(self.misfit(f) for f in self.known.values())

    def _fit(
        self, base: Fit, terms: tuple[Term, ...], initial: Mapping[str, float], least: float
    ) -> Fit:
        """A fit that is ended early where it is far behind the ``least`` misfit that is known."""
        scaled = tuple(measured_by(t, initial) for t in terms)
        whole = labels_of(self.baseline.terms) <= labels_of(terms)
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
            if made.evaluations < evaluations or self._behind(made, least):
                break
            values, starts = dict(made.values), made.starts
        return made

    def _to_the_end(self, made: Fit) -> Fit:
        return fit(
            self.model, made.terms, self.segments, made.values, made.starts, LONG, TOLERANCE
        )

    def _behind(self, made: Fit, least: float) -> bool:
        """Whether a fit is so far from the best that its last digits do not matter."""
        excess = self.misfit(made) - least
        return excess > max(LOST, 0.5 * (self.misfit(self.place) - least))

    def without(self, base: Fit, terms: tuple[Term, ...]) -> Fit:
        """The fit with fewer terms, from where the larger one has ended, too."""
        return self.without_each(base, [terms])[0]

    def without_each(self, base: Fit, fewer: Sequence[tuple[Term, ...]]) -> list[Fit]:
        """Fits with fewer terms each, side by side, from where the larger one has ended, too."""
        least = self._least()

        def made(terms: tuple[Term, ...]) -> Fit:
            # a companion that only helped the fit on its way must not stay
            return self._to_the_end(self._fit(base, terms, {}, least))

        names = [labels_of(terms) for terms in fewer]
        bare = labels_of(self.baseline.terms)
        todo = [
            (n, terms)
            for n, terms in zip(names, fewer, strict=True)
            if n != bare and (base, n) not in self._smaller
        ]
        self._smaller.update((base, n) for n, _ in todo)
        for again in in_processes(lambda item: made(item[1]), todo):
            self._better(again)
        return [self.baseline if n == bare else self.known[n] for n in names]

    def once_more(self, base: Fit, terms: tuple[Term, ...], initial: Mapping[str, float]) -> Fit:
        """The fit with these terms from another place: the better one where it was made before."""
        return self._better(self.trial(base, terms, initial))

    def trial(self, base: Fit, terms: tuple[Term, ...], initial: Mapping[str, float]) -> Fit:
        """A fit with these terms from another place, which is not kept."""
        return self._fit(base, terms, initial, self._least())

    def from_each_shape(self, base: Fit, term: Term) -> None:
        """A term beside others from each of the shapes that promise most there.

        The best of these fits is followed to its end.
        """
        looks = [look for look in self.looks if look.term.label == term.label]
        chosen = of_each_shape(self.model, base, looks, self.segments)[:SHAPES]
        made = [self.trial(base, (*base.terms, p.term), p.initial) for p in chosen]
        if made:
            self._better(self._to_the_end(min(made, key=self.misfit)))

    def put(self, made: Fit) -> Fit:
        """The fit that counts as the one with its terms from now on."""
        self.known[labels_of(made.terms)] = made
        return made

    def _better(self, again: Fit) -> Fit:
        names = labels_of(again.terms)
        known = self.known.get(names)
        if known is None or self.misfit(again) < self.misfit(known):
            self.known[names] = again
        return self.known[names]

    def take(self, made: Fit) -> Fit:
        """A fit that was made elsewhere, converged here."""
        names = labels_of(made.terms)
        if names not in self.known:
            self.known[names] = fit(
                self.model, made.terms, self.segments, made.values, made.starts, 3 * EVALUATIONS
            )
        return self.known[names]

    def misfit(self, made: Fit) -> float:
        """Chi-square on the fitted recordings."""
        pairs = zip(self.segments, made.residuals, strict=True)
        return float(sum(np.sum(innovations(s, r) ** 2) for s, r in pairs if not s.held_out))

    def polish(self, made: Fit) -> Fit:
        """A fit once more, with every derivative taken anew."""
        return self.polish_each([made])[0]

    def polish_each(self, made: Sequence[Fit]) -> list[Fit]:
        """Several fits once more, side by side, with every derivative taken anew."""
        rough = [f for f in made if f.label != POLISHED and f is not self.baseline]
        for better in in_processes(self._polished, rough):
            self.known[labels_of(better.terms)] = better
        return [self.known[labels_of(f.terms)] for f in made]

    def _polished(self, made: Fit) -> Fit:
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
        return dataclasses.replace(better, label=POLISHED, std=std)


def measured_by(term: Term, initial: Mapping[str, float]) -> Term:
    """A term whose amounts are measured by the values that they start from.

    Amounts in one unit are one law's: one that starts from next to none is as large as the rest.
    """
    sizes: dict[str, float] = {}
    for n in term.numbers:
        if n.name in term.amounts:
            size = abs(initial.get(key(term, n), 0.0))
            sizes[n.unit] = max(sizes.get(n.unit, 0.0), size)
    numbers = []
    for n in term.numbers:
        size = sizes.get(n.unit, 0.0) if n.name in term.amounts else 0.0
        numbers.append(dataclasses.replace(n, scale=size) if size > 0.0 else n)
    return dataclasses.replace(term, numbers=tuple(numbers))


def _looked_at(term: Term) -> bool:
    if term.name != 'low_pass_filter':
        return True
    order, both = filter_of(term)
    return order in FIRST_ORDERS_WITHOUT_DELAY if both else order == FIRST_ORDER


def labels_of(terms: Sequence[Term]) -> frozenset[str]:
    """Labels of terms, which name a model."""
    return frozenset(t.label for t in terms)
