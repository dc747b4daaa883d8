"""Fuller forms of a finding, once a window is long enough to tell more of it.

A robot that pushes on is a force that rises and stays, as long as nobody has seen it end. Friction
that is higher at rest is found as plain friction first, with what is left of another kind.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence

from impactscope.discrepancy.evidence import family_p_value, information
from impactscope.discrepancy.impact.candidates.candidate import Candidate, contains
from impactscope.discrepancy.impact.candidates.catalogue import LEFT_ALONE, candidates
from impactscope.discrepancy.impact.candidates.channel_effects import (
    cutoff_of,
    delay_of,
    delays_like,
)
from impactscope.discrepancy.impact.fits.least_squares import Fit, fit
from impactscope.discrepancy.impact.models.bench_model import Free
from impactscope.discrepancy.impact.search.outcome import Found, Outcome, evidence_for
from impactscope.discrepancy.impact.search.strong_effects import from_within
from impactscope.discrepancy.time_limit import time_left
from impactscope.errors import ImpactscopeError
from impactscope.physics.mechanisms.registry import mechanism

__all__ = ['filter_in_place_of_two', 'fuller', 'law_in_place_of_two', 'law_that_contains']

_STARTS = {'hold': (0.03, 0.1, 0.3), 'fall': (0.03, 0.15)}  # s
_LONGEST = 10.0  # s
_ITERATIONS = 12
_SLIGHT = 1000.0  # of chi-square, that a finding in the place of a law's rest may explain


def fuller(current: Fit, outcome: Outcome, false_finding: float, sound: Fit | None = None) -> Fit:
    """The fit with each finding in its fuller form, where that explains more than chance does.

    What was found is changed in ``outcome``.

    Args:
        current: the fit as it is.
        outcome: what was found.
        false_finding: probability that chance is given.
        sound: the last fit at the noise, of a shorter window: what the fuller form adds had not
            begun by then, and its numbers have not been led astray by it.
    """
    for plain in list(outcome.accepted):
        form = _form(plain)
        if form is None:
            continue
        more = [f for f in form.free if f not in plain.free]
        model = current.model.extended(free=more)
        best: Fit | None = None
        for values in _starts(plain, more, current, sound):
            x = model.vector(values)
            try:
                made = fit(model, current.layout, x, iterations=_ITERATIONS)
            except ImpactscopeError:
                continue
            if best is None or made.chi_square < best.chi_square:
                best = made
        if best is None:
            continue
        gain = evidence_for(best, current)
        if family_p_value(max(gain, 0.0), len(more), len(LEFT_ALONE)) > false_finding:
            continue
        known = dataclasses.replace(outcome.found[plain.label], candidate=form, fit=best)
        outcome.put_in_place([plain], known, outcome.rivals.get(plain.label, ()))
        outcome.last, outcome.tests = [], None
        current = best
    return current


def law_that_contains(
    current: Fit, outcome: Outcome, baseline_names: Sequence[str], false_finding: float
) -> Fit | None:
    """The fit with a law that contains a finding in its place, where chance explains less.

    What was found is changed in ``outcome``. None where no such law explains more.
    """
    laws_of_one = [c for c in outcome.accepted if len(c.amplitudes) == 1 and not c.channel]
    listed = candidates(outcome.baseline, baseline_names) if laws_of_one else []
    for plain in laws_of_one:
        laws = [c for c in listed if contains(c, plain)]
        if not laws:
            continue
        without = outcome.model_with(c for c in outcome.accepted if c is not plain)
        best: Found | None = None
        for law in laws:
            made = from_within(current, without, plain, law)
            if made is None:
                continue
            known, more = outcome.found[plain.label], law.cost - plain.cost
            gain = evidence_for(made, current)
            chance = family_p_value(max(gain, 0.0), more, len(laws))
            criterion = known.criterion + information(-gain, more, current.layout.size)
            if chance < false_finding and (best is None or criterion < best.criterion):
                best = Found(law, made, known.gain + gain, known.p_value, criterion)
        if best is not None:
            rivals = [outcome.found[plain.label], *outcome.rivals.get(plain.label, ())]
            outcome.put_in_place([plain], best, rivals)
            outcome.last, outcome.tests = [], None
            return best.fit
    return None


def law_in_place_of_two(
    current: Fit, outcome: Outcome, baseline_names: Sequence[str]
) -> Fit | None:
    """The fit with a law that contains a finding in place of it and of another one.

    Friction that is higher at rest is found as plain friction first, and what is left of it then
    looks like damping in the same place. The law must explain as much as both, and its numbers
    cost less than theirs and the choice of a further effect. What was found is changed in
    ``outcome``; None where there is no such law.
    """
    if len(outcome.accepted) < 2:
        return None
    listed = candidates(outcome.baseline, baseline_names)
    names = {c.name for c in outcome.accepted}
    for plain, other in itertools.permutations(outcome.accepted, 2):
        first, beyond = (outcome.found.get(c.label) for c in (plain, other))
        apart = other.subsystem != plain.subsystem or plain.channel or other.channel
        if apart or len(plain.amplitudes) != 1 or not other.free:
            continue
        if first is None or beyond is None or beyond.gain > _SLIGHT:
            continue  # what is left of a law is little beside what was found of it
        without = outcome.model_with(c for c in outcome.accepted if c not in (plain, other))
        gain = first.gain + beyond.gain
        price = plain.price(first.gain, current) + other.price(beyond.gain, current)
        price += 2.0 * math.log(len(listed))
        best: Found | None = None
        for law in listed:
            if not contains(law, plain) or law.name in names:
                continue
            made = from_within(current, without, plain, law)
            if made is None:
                continue
            criterion = law.price(gain, made) - evidence_for(made, current)
            if criterion < min(price, math.inf if best is None else best.criterion):
                best = Found(law, made, gain, first.p_value, criterion)
        if best is None:
            continue
        best = dataclasses.replace(best, criterion=best.criterion - gain)
        rivals = [first, *outcome.rivals.get(plain.label, ())]
        outcome.put_in_place([plain, other], best, rivals)
        outcome.last, outcome.tests = [], None
        return best.fit
    return None


def filter_in_place_of_two(current: Fit, outcome: Outcome) -> Fit | None:
    """The fit with one filter in place of a filter and a late clock in the same channel.

    A filter of a wrong order beside something that is not known yet is mended by a clock as soon
    as that is known. The filter must explain as much as both, and pay less. What was found is
    changed in ``outcome``; None where there is no such filter.
    """
    filters = [c for c in outcome.accepted if c.name == 'low_pass_filter']
    clocks = [c for c in outcome.accepted if c.name == 'clock_error']
    pairs = [(f, c) for f in filters for c in clocks if f.channel == c.channel]
    if not pairs or not time_left('one filter in place of a filter and a clock'):
        return None
    wrong, clock = pairs[0]
    model = outcome.model_with(c for c in outcome.accepted if c not in (wrong, clock))
    first, beyond = outcome.found[wrong.label], outcome.found[clock.label]
    gain = max(first.gain, beyond.gain)
    dearer = clock.price(beyond.gain, current)
    best: Found | None = None
    for candidate, cutoff in _filters_like(wrong, clock, current):
        extended = candidate.extend(model)
        x = extended.vector({**current.values, candidate.free[0].key: cutoff})
        try:
            made = fit(extended, current.layout, x, settled=0.1)
        except ImpactscopeError:
            continue
        worse = (made.chi_square - current.chi_square) / max(1.0, current.reduced)
        doubt = candidate.doubt_at(made.values) - wrong.doubt_at(current.values)
        if worse + doubt < min(dearer, math.inf if best is None else best.criterion):
            best = Found(candidate, made, gain - worse, first.p_value, worse + doubt)
    if best is None:
        return None
    best = dataclasses.replace(best, criterion=first.criterion + best.criterion - dearer)
    outcome.put_in_place([wrong, clock], best, outcome.rivals.get(wrong.label, ()))
    outcome.last, outcome.tests = [], None
    return best.fit


def _filters_like(
    wrong: Candidate, clock: Candidate, current: Fit
) -> Iterator[tuple[Candidate, float]]:
    """Filters that may be as late as a filter and a clock together, with cut-offs to start."""
    channel, tag = wrong.channel, wrong.effects[0].tag
    order = round(wrong.constants[f'{tag}.order'])
    late = current.values[f'{clock.effects[0].tag}.offset']
    if not wrong.constants[f'{tag}.zero_phase']:
        late += delay_of(order, current.values[f'{tag}.cutoff'])
    cutoff = current.values[f'{tag}.cutoff'] if late <= 0.0 else cutoff_of(order, late)
    data = current.model.data
    rate = next(b.channels[channel].sample_rate for b in data.blows if channel in b.channels)
    for candidate, start in delays_like(wrong, {f'{tag}.cutoff': cutoff}, rate, data.channels):
        if candidate.name == 'low_pass_filter':
            yield candidate, start
    yield wrong, cutoff


def _starts(
    plain: Candidate, more: Sequence[Free], current: Fit, sound: Fit | None
) -> Iterator[dict[str, float]]:
    """Values from which the fuller form is fitted."""
    choices = {f.key: _STARTS[f.key.rpartition('.')[2]] for f in more}
    for start in itertools.product(*choices.values()):
        yield {**current.values, **dict(zip(choices, start, strict=True))}
    if sound is None or not {f.key for f in plain.free} <= set(sound.values):
        return
    tag = plain.effects[0].tag
    up = sum(sound.values.get(f'{tag}.{name}', 0.0) for name in ('start', 'rise'))
    if math.isfinite(sound.layout.window) and f'{tag}.hold' in choices:
        choices[f'{tag}.hold'] = (max(sound.layout.window - up, 0.0),)
    for start in itertools.product(*choices.values()):
        yield {**current.values, **sound.values, **dict(zip(choices, start, strict=True))}


def _form(plain: Candidate) -> Candidate | None:
    """The fuller form of a candidate that has one."""
    names = LEFT_ALONE.get(plain.name, ())
    if not names:
        return None
    tag = plain.effects[0].tag
    free = []
    for p in mechanism(plain.name).parameters:
        if p.name in names:
            middle = _STARTS[p.name][1]
            logarithmic = p.lower > 0.0
            scale = 0.05 if logarithmic else 0.1 * middle
            free.append(Free(f'{tag}.{p.name}', middle, scale, p.lower, _LONGEST, logarithmic))
    if any(f.key in {g.key for g in plain.free} for f in free):
        return None
    constants = {k: v for k, v in plain.constants.items() if k not in {f.key for f in free}}
    return dataclasses.replace(
        plain, label=f'{plain.label} (that ends)', free=(*plain.free, *free), constants=constants
    )
