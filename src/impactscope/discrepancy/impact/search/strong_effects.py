"""Strong effects: fits that do not set out from a model that was bent to do without them.

Where much is missing, the numbers of a fitted model have gone far to make up for it, and from
there the right law with the right strength looks as bad as any other. Two places are better to
set out from: the first milliseconds, in which little has been bent yet, and the numbers that
another explanation has found.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.impact.candidates.candidate import Candidate, kin_of
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.fits.growing_windows import begun, fit_baseline, follow
from impactscope.discrepancy.impact.fits.least_squares import Fit, at_point, fit
from impactscope.discrepancy.impact.fits.start_values import cold_starts, placed
from impactscope.discrepancy.impact.models.bench_model import ImpactModel, Layout
from impactscope.discrepancy.impact.models.bench_parameters import ADDED_WEIGHT
from impactscope.discrepancy.impact.search.outcome import QUIET
from impactscope.discrepancy.impact.search.screening import Screening, Trial
from impactscope.discrepancy.processes import in_processes
from impactscope.errors import ImpactscopeError
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism

__all__ = [
    'from_first_contact',
    'from_taps',
    'from_within',
    'in_place_of',
    'race',
    'related',
    'with_its_numbers',
]

Array = NDArray[np.float64]

_RUNGS = (0.012, 0.02, 0.035, 0.06, 0.12, 0.25, 0.5)  # s, of taps and blows alike
_RUNNERS = (8, 6, 5, 4, 3, 3, 3)  # candidates that are fitted up to each rung
_BEHIND = 6.0  # times the least chi-square, at which a candidate leaves the race
_COLD = 2  # candidates that are fitted to all blows from a cold start
_SEEN = 60.0  # of chi-square, that a candidate must gain on the taps
_SAME_UNIT = 12  # starts from numbers of the same unit
_MET = 2.0  # reduced chi-square of the first contacts, up to which a candidate meets them
_REFINED = 2  # starts of a candidate that are refined
_APART = (0.002, 0.005, 0.012, 0.4)  # of a finding: between a fuller law's two numbers for it
_GO_ON = 4  # fits from there that are fitted further, the lowest ones


def _rung(model: ImpactModel, blows: Sequence[int], length: float, window: float) -> Layout:
    return model.layout(blows, min(length, window), taps=length)


def race(
    current: Fit, baseline_names: Sequence[str], window: float
) -> list[tuple[Candidate, Fit]]:
    """Candidates that were fitted from the first milliseconds on and came through; best first.

    The recordings are read as far as the model without them follows. Where it stops, candidates
    are tried at the numbers that it has up to there; the best are fitted, and followed over
    lengths that grow. Who falls behind leaves.

    Args:
        current: the model without them, fitted up to ``window`` s after the onset.
        baseline_names: mechanisms that the baseline has.
        window: s.
    """
    model, blows = current.model, current.layout.blows
    near = _first_fit(current, _rung(model, blows, _RUNGS[0], window))
    if near is None:
        return []
    first = 0
    while near.reduced < QUIET:
        first += 1
        if first == len(_RUNGS):
            return []
        part = _rung(model, blows, _RUNGS[first], window)
        if (longer := _fitted(model, part, near.x)) is None:
            return []
        if longer.reduced > QUIET:
            near = at_point(model, part, near.x)
            break
        near = longer
    runners = _ready(near, baseline_names)
    for length, most in zip(_RUNGS[first:], _RUNNERS[first:], strict=True):
        part = _rung(model, blows, length, window)
        runners = _further(runners, part, most)
    return _further(runners, current.layout, len(runners), settled=0.1)


def _fitted(model: ImpactModel, layout: Layout, x: Array) -> Fit | None:
    try:
        return fit(model, layout, x, iterations=12, settled=0.5)
    except ImpactscopeError:
        return None


def _first_fit(current: Fit, layout: Layout) -> Fit | None:
    """The first milliseconds without what is missing, from where that has bent the least."""
    model = current.model
    found = _fitted(model, layout, current.x)
    if found is not None and found.reduced < QUIET:
        return found
    tried = [found]
    for x in (current.x, _cold(current)):
        with contextlib.suppress(ImpactscopeError):
            short = placed(model, x, layout.blows, layout.blows)
            tried.append(_fitted(model, layout, x if short is None else short.x))
    return min((f for f in tried if f is not None), key=lambda f: f.chi_square, default=None)


def _cold(current: Fit) -> Array:
    """Numbers as they are stated, those of what was found already as they were fitted."""
    model = current.model
    tags = {effect.tag for effect in model.effects}
    own = [f.key.rsplit('.', 1)[0] in tags for f in model.free]
    return np.asarray(np.where(own, current.x, model.start()))


def _ready(near: Fit, baseline_names: Sequence[str]) -> list[tuple[Candidate, Fit]]:
    """Candidates at the start, the most promising of each kind first."""
    screening = Screening(near)

    def tried(candidate: Candidate) -> Trial | None:
        trials = screening.best(candidate)[:_REFINED]
        return screening.best_refined(trials) if trials else None

    trials = in_processes(tried, candidates(near, baseline_names))
    found = sorted((t for t in trials if t is not None), key=lambda t: -t.gain)
    seen: set[str] = set()
    ready = []
    for trial in found:
        kind = f'{trial.candidate.name}:{trial.candidate.channel}:{trial.candidate.parameter}'
        if kind in seen:
            continue
        seen.add(kind)
        start = dataclasses.replace(near, model=trial.model, x=trial.x)
        ready.append((trial.candidate, start))
        if len(ready) == _RUNNERS[0]:
            break
    return ready


def _further(
    runners: Sequence[tuple[Candidate, Fit]], layout: Layout, most: int, settled: float = 1.0
) -> list[tuple[Candidate, Fit]]:
    """The runners fitted over a further length, those that keep up, the best first."""
    best: dict[str, tuple[Candidate, Fit]] = {}
    for candidate, so_far in runners:
        with contextlib.suppress(ImpactscopeError):
            found = fit(so_far.model, layout, so_far.x, iterations=12, settled=settled)
            known = best.get(candidate.label)
            if known is None or found.chi_square < known[1].chi_square:
                best[candidate.label] = candidate, found
    arrived = sorted(best.values(), key=lambda item: item[1].chi_square)
    if not arrived:
        return []
    least = arrived[0][1].chi_square
    return [r for r in arrived[:most] if r[1].chi_square < _BEHIND * max(least, layout.size)]


def from_taps(baseline: Fit, baseline_names: Sequence[str]) -> list[tuple[Candidate, Fit]]:
    """What the taps alone say is missing, each then fitted to all blows from a cold start.

    Bare contacts follow each other within milliseconds, each amplifying what the one before has
    left: without the effect they are not met at all, and tell nothing of it. Taps are simple.
    """
    model = baseline.model
    taps = [i for i in model.data.fitted if model.data.blows[i].recording.kind == 'tap']
    if not taps:
        return []
    found: list[tuple[Candidate, Fit]] = []
    with contextlib.suppress(ImpactscopeError):
        start = min(cold_starts(model), key=lambda x: _tap_misfit(model, x, taps))
        alone = fit(model, model.layout(taps), start, settled=1.0)
        if alone.reduced < QUIET:
            return []
        for candidate, joint in race(alone, baseline_names, math.inf)[:_COLD]:
            if alone.chi_square - joint.chi_square < _SEEN * max(1.0, joint.reduced):
                continue
            extended, values = candidate.extend(model), joint.values
            extended.free = tuple(
                f if f.prior or f.blow is not None else dataclasses.replace(f, start=values[f.key])
                for f in extended.free
            )
            with contextlib.suppress(ImpactscopeError):
                found.append((candidate, fit_baseline(extended)))
    return sorted(found, key=lambda item: (-item[1].layout.size, item[1].reduced))


def from_first_contact(
    baseline: Fit, baseline_names: Sequence[str]
) -> list[tuple[Candidate, Fit]]:
    """What acts on the bench, each from a cold start, where that meets the first contacts.

    What is missing in the first contact itself bends everything from the first sample on: then no
    model without it is a place to set out from, not even for the first milliseconds.
    """
    found: list[tuple[Candidate, Fit]] = []
    seen: set[str] = set()
    for candidate in candidates(baseline, baseline_names):
        wrong = candidate.name == 'wrong_parameter'
        if candidate.channel or wrong or not candidate.free or candidate.name in seen:
            continue
        seen.add(candidate.name)
        start = candidate.starts[0]
        model = candidate.extend(baseline.model)
        model.free = tuple(
            dataclasses.replace(f, start=start[f.key]) if f.key in start else f for f in model.free
        )
        with contextlib.suppress(ImpactscopeError, ValueError):
            found.append((candidate, begun(model)))
    found = sorted((f for f in found if f[1].reduced < _MET), key=lambda f: f[1].chi_square)
    followed = []
    for candidate, short in found[:_COLD]:
        with contextlib.suppress(ImpactscopeError):
            followed.append((candidate, follow(short)))
    return sorted(followed, key=lambda item: (-item[1].layout.size, item[1].reduced))


def _tap_misfit(model: ImpactModel, x: Array, taps: Sequence[int]) -> float:
    residuals = model.residuals(x, model.layout(taps, _RUNGS[0]))
    return float(residuals @ residuals)


def related(leader: Candidate, listed: Sequence[Candidate]) -> list[Candidate]:
    """Candidates of the same family as the leading one."""
    kin = kin_of(leader)
    return [c for c in listed if c.name in kin and c.channel == leader.channel]


def in_place_of(leader: Fit, without: ImpactModel, candidate: Candidate) -> Fit | None:
    """A candidate fitted from the numbers that another explanation has found.

    Args:
        leader: a fit with the other explanation.
        without: the model with neither.
        candidate: what is to stand in the other one's place.

    All that both models have begins where the leader has it. The candidate's own numbers are
    those of the leader with the same unit where there are any, and otherwise those that the cheap
    trial at this place gives. None where nothing can be simulated.
    """
    known = leader.values
    x = without.vector(known)
    with contextlib.suppress(ImpactscopeError):
        place = at_point(without, leader.layout, x)
        screening = Screening(place)
        tried = screening.best(candidate)
        starts = [screening.refined(screening.scaled(t)).x for t in tried[:_REFINED]]
        model = candidate.extend(without)
        return _from_best(model, leader.layout, [*starts, *_its_numbers(leader, model, candidate)])
    return None


def with_its_numbers(leader: Fit, without: ImpactModel, candidate: Candidate) -> Fit | None:
    """A candidate fitted from the numbers of the same unit that another explanation has found.

    One law may hold another as a special case, and where numbers are known to a thousandth, a fit
    from anywhere else ends in another minimum. None where there are none of its units.
    """
    model = candidate.extend(without)
    with contextlib.suppress(ImpactscopeError):
        return _from_best(model, leader.layout, _its_numbers(leader, model, candidate))
    return None


def from_within(
    leader: Fit, without: ImpactModel, plain: Candidate, fuller: Candidate
) -> Fit | None:
    """The law that contains a finding, fitted from about the finding's numbers; None if it cannot.

    At the finding itself what it has further tells nothing, and no slope leads away from there.

    Args:
        leader: a fit with the finding.
        without: the model without it.
        plain: the finding, a law of one size.
        fuller: the law that contains it.
    """
    model = fuller.extend(without)
    (size,) = (leader.values[key] for key in plain.amplitudes)

    def begun(begin: tuple[Mapping[str, float], float]) -> Fit | None:
        start, apart = begin
        numbers = {**leader.values, **start}
        amounts = sorted(fuller.amplitudes, key=lambda key: -start.get(key, 0.0))
        for key, sign in zip(amounts, (1.0, -1.0), strict=False):
            numbers[key] = size * (1.0 + sign * apart)
        return fitted(model.vector(numbers))

    def fitted(x: Array) -> Fit | None:
        with contextlib.suppress(ImpactscopeError):
            return fit(model, leader.layout, x, iterations=12)
        return None

    tried = in_processes(begun, list(itertools.product(fuller.starts, _APART)))
    rough = sorted((f for f in tried if f is not None), key=lambda f: f.chi_square)
    # friction turns round in single samples: its chi-square is rough
    again = in_processes(fitted, [f.x for f in rough[:_GO_ON]])
    found = [leader, *rough, *(f for f in again if f is not None)]
    best = min(found, key=lambda f: f.chi_square)
    return None if best is leader else best


def _from_best(model: ImpactModel, layout: Layout, starts: Sequence[Array]) -> Fit | None:
    """The fit from the start that leaves least; None where none can be simulated."""
    best: tuple[float, Array] | None = None
    for start in starts:
        with contextlib.suppress(ImpactscopeError):
            residuals = model.residuals(start, layout)
            cost = float(residuals @ residuals)
            if math.isfinite(cost) and (best is None or cost < best[0]):
                best = cost, start
    return None if best is None else fit(model, layout, best[1], settled=0.1)


def _its_numbers(leader: Fit, model: ImpactModel, candidate: Candidate) -> list[Array]:
    """Starts of a candidate's model from those of a leader's numbers that have its units."""
    known = leader.values
    return [
        model.vector({**known, **numbers}) for numbers in _of_same_unit(known, leader, candidate)
    ]


def _of_same_unit(
    known: Mapping[str, float], leader: Fit, candidate: Candidate
) -> list[dict[str, float]]:
    """Numbers of a candidate taken from those of mechanisms that the leader has."""
    if candidate.name not in all_mechanisms() or candidate.fitted or candidate.channel:
        return []
    there: dict[str, list[float]] = {}
    for effect in leader.model.effects:
        for parameter in mechanism(effect.name).parameters:
            value = known.get(f'{effect.tag}.{parameter.name}')
            if value is not None and math.isfinite(value):
                there.setdefault(parameter.unit, []).append(value)
        load = known.get(f'{effect.tag}.{ADDED_WEIGHT}', 0.0)
        if load:
            there.setdefault('N', []).append(load)
    units = {f'{candidate.name}.{p.name}': p.unit for p in mechanism(candidate.name).parameters}
    defaults = dict(candidate.starts[0])
    lists = [
        there.get(units.get(f.key, ''), []) or [defaults.get(f.key, f.start)]
        for f in candidate.free
    ]
    if not any(units.get(f.key, '') in there for f in candidate.free):
        return []
    combinations = itertools.islice(itertools.product(*lists), _SAME_UNIT)
    return [
        {f.key: v for f, v in zip(candidate.free, values, strict=True)} for values in combinations
    ]
