"""Screening: every candidate from its start values, projected on the residual.

Each is simulated once beside the baseline; what it could take away beside any other model follows
by projection. Looking decides nothing but what is fitted.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from impactscope.discrepancy.driven.fits.linearisation import Linearisation, change, linearised
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import Number, Term, key

__all__ = [
    'HOPE',
    'Prospect',
    'ScreenedStart',
    'of_each_shape',
    'prospects',
    'refined_start',
    'screened',
]

Array = NDArray[np.float64]

WANDER, WANDERED = (0.3, -0.1, 0.03), 120  # relative first steps, evaluations, without slopes
SCALINGS = 3  # of an effect that is not straight in its amount
HOPE = 8.0  # chi-square below which the first look leaves a candidate alone


@dataclass(frozen=True, slots=True)
class Prospect:
    """A start of a candidate and the chi-square that it promises."""

    term: Term
    initial: Mapping[str, float]
    gain: float
    other: Mapping[str, float] | None = None  # the next best start
    as_is: float = 0.0  # what the start takes away without being scaled


@dataclass(frozen=True, slots=True, eq=False)
class ScreenedStart:
    """What a term does to the baseline's prediction from one start; rows (c, n) by amount."""

    term: Term
    start: Mapping[str, float]
    rows: NDArray[np.float32]

    def prospect(self, here: Linearisation, plate: Mapping[str, float]) -> Prospect:
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
            gain = gain if factors[0] > 0.0 else 0.0
            return Prospect(self.term, found, gain, as_is=here.taken(self.rows[0].astype(float)))
        for n, factor in zip(amounts, factors, strict=True):
            name = key(self.term, n)
            value = self.start[name] * float(np.clip(factor, -1e3, 1e3))
            if not n.lower <= value <= n.upper and len(amounts) == 1:
                gain = 0.0
            found[name] = min(max(value, n.lower + 1e-3 * n.scale), n.upper)
        return Prospect(self.term, found, gain, as_is=gain)


def _on_soft_base(plate: Mapping[str, float], mass: float, frequency: float) -> dict[str, float]:
    """The plate's stiffness that keeps its natural frequency on a base that gives way."""
    load = plate.get('stiffness', 0.0)  # mass of the plate times its natural frequency squared
    if load == 0.0:
        return {}
    natural = load / plate['mass']
    base = mass * ((2.0 * math.pi * frequency) ** 2 - natural)
    stiffer = load * base / (base - load) if base != load else load
    return {'stiffness': stiffer} if stiffer > 0.0 else {}


def screened(
    model: Model, made: Fit, terms: Sequence[Term], segments: Sequence[Segment]
) -> list[ScreenedStart]:
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
            found.append(ScreenedStart(term, start, np.stack(rows).astype(np.float32)))
    return found


def prospects(
    model: Model,
    made: Fit,
    candidates: Sequence[ScreenedStart],
    segments: Sequence[Segment],
    here: Linearisation | None = None,
) -> list[Prospect]:
    """The best start of every candidate, by the chi-square that it could take away."""
    here = linearised(model, made, segments) if here is None else here
    best: dict[str, list[Prospect]] = {}
    for look in candidates:
        best.setdefault(look.term.label, []).append(look.prospect(here, made.values))
    found = []
    for tried in best.values():
        tried.sort(key=_near, reverse=True)
        again = sorted((_again(model, made, p, here, segments) for p in tried[:2]), key=_sound)
        other = again[0].initial if len(again) > 1 and again[0].gain > HOPE else None
        found.append(dataclasses.replace(again[-1], other=other))
    return sorted(found, key=lambda p: -p.gain)


def of_each_shape(
    model: Model, made: Fit, candidates: Sequence[ScreenedStart], segments: Sequence[Segment]
) -> list[Prospect]:
    """The best start of every shape of some candidates, beside a fit, the best one first."""
    here = linearised(model, made, segments)
    best: dict[tuple[str, ...], Prospect] = {}
    for look in candidates:
        amounts = {key(look.term, n) for n in look.term.numbers if n.name in look.term.amounts}
        shape = look.term.label, *(f'{k} {v}' for k, v in look.start.items() if k not in amounts)
        now = look.prospect(here, made.values)
        if shape not in best or _near(now) > _near(best[shape]):
            best[shape] = now
    return sorted((p for p in best.values() if p.gain >= HOPE), key=lambda p: -p.gain)


def _near(prospect: Prospect) -> tuple[float, bool, float]:
    """How likely a fit from a start ends where it should.

    A start of the right shape and a thousandth of the size is far from there, and so is one that
    spoils more than its shape could bring.
    """
    return prospect.as_is if prospect.as_is >= HOPE else 0.0, *_sound(prospect)


def _sound(prospect: Prospect) -> tuple[bool, float]:
    spoils = not prospect.term.amounts and prospect.as_is < -prospect.gain
    return not spoils, prospect.gain


def _starts(term: Term) -> list[dict[str, float]]:
    combined = itertools.product(*(n.starts for n in term.numbers))
    return [
        {key(term, n): v for n, v in zip(term.numbers, values, strict=True)} for values in combined
    ]


def refined_start(
    model: Model, made: Fit, prospect: Prospect, segments: Sequence[Segment], here: Linearisation
) -> Mapping[str, float]:
    """A start improved without slopes, beside a fit that re-tunes itself (Nelder and Mead)."""
    terms = (*made.terms, prospect.term)
    names = [key(prospect.term, n) for n in prospect.term.numbers]
    lower = np.array([max(n.lower, 1e-3 * prospect.initial[k]) for k, n in _named(prospect.term)])
    upper = np.array([n.upper for n in prospect.term.numbers])
    begin = np.log(np.array([max(prospect.initial[k], 1e-300) for k in names]))

    def values_of(q: Array) -> dict[str, float]:
        held = np.clip(np.exp(q), lower, upper)
        return {k: float(v) for k, v in zip(names, held, strict=True)}

    def cost(q: Array) -> float:
        effect = change(model, made, terms, {**made.values, **values_of(q)}, segments)
        return -here.taken(effect) if np.all(np.isfinite(effect)) else 0.0

    for step in WANDER:
        corners = np.vstack([begin, begin + step * np.eye(begin.size)])
        options = {'maxfev': WANDERED, 'initial_simplex': corners, 'xatol': 1e-4, 'fatol': 0.1}
        begin = optimize.minimize(cost, begin, method='Nelder-Mead', options=options).x
    return values_of(begin)


def _named(term: Term) -> list[tuple[str, Number]]:
    return [(key(term, n), n) for n in term.numbers]


def _again(
    model: Model, made: Fit, prospect: Prospect, here: Linearisation, segments: Sequence[Segment]
) -> Prospect:
    """A promising start, simulated beside the fit itself.

    An effect that is not straight in its amount is scaled anew by what it does there: one step
    from a start that is far too large leads to another that is too large.
    """
    if prospect.gain < HOPE:
        return prospect
    tried = prospect
    for _ in range(SCALINGS):
        values = {**made.values, **tried.initial}
        effect = change(model, made, (*made.terms, tried.term), values, segments)
        if not np.all(np.isfinite(effect)):
            return dataclasses.replace(prospect, gain=0.0)
        taken = here.taken(effect)
        if taken >= HOPE:
            return dataclasses.replace(tried, gain=taken)
        if len(prospect.term.amounts) != 1:
            break
        tried = ScreenedStart(tried.term, tried.initial, effect[None].astype(np.float32)).prospect(
            here, made.values
        )
        if tried.gain < HOPE:
            break
    # the fit has to find it
    return dataclasses.replace(prospect, gain=0.5 * prospect.gain)
