"""All that could be missing from a model: every mechanism, and every stated number.

Candidates are made from the registry of mechanisms: a further mechanism is a further candidate,
without a word here. Only where start values depend on the recordings (travel, resonances) does
this module know a parameter by its name.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.candidates.channel_effects import chain_candidates
from impactscope.discrepancy.impact.candidates.motion_scales import LARGEST_FREQUENCY, MotionScales
from impactscope.discrepancy.impact.candidates.stated_numbers import wrong_numbers
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.models.baseline import STRUCTURE, implied_shares
from impactscope.discrepancy.impact.models.bench_model import ActiveEffect, Free, ImpactModel
from impactscope.physics.mechanisms.mechanism import Mechanism, Parameter
from impactscope.physics.mechanisms.registry import all_mechanisms

__all__ = ['LEFT_ALONE', 'candidates']

_DIRECT = ('quantisation',)  # seen in the samples themselves, not by a fit
LEFT_ALONE = {  # parameters that are not fitted at first: a push is not seen to end; see `fuller`
    'external_push': ('hold', 'fall'),
}
_VANISHES = {'base_compliance': 'mass'}  # numbers at whose infinity an effect is absent
_RINGS_ON = ('base_compliance',)  # effects with a motion of their own, which a tap excites
_PULSE_KNOWN = 0.3  # relative, of a tap's duration
# Hz, where a part may ring
_RINGS = tuple(float(f) for f in np.geomspace(20.0, 0.95 * LARGEST_FREQUENCY, 35))
_MOST_STARTS = 42  # of a candidate
_WEIGHTS = ('gravity_load', 'restoring_force')
_TIED = 1.0  # of chi-square, by which what not all blows have alike has to explain more


def candidates(fit: Fit, campaign_baseline: Sequence[str]) -> list[Candidate]:
    """All candidates for a model, with starts that suit the recordings."""
    model = fit.model
    scales = MotionScales(fit)
    present = {e.tag for e in model.effects}
    found: list[Candidate] = []
    for kind in all_mechanisms().values():
        if kind.name in _DIRECT or kind.name in STRUCTURE:
            continue
        if not kind.needs <= scales.there:
            continue
        if kind.on_channel:
            for channel in model.data.channels:
                if f'{kind.name}:{channel}' not in present:
                    found.extend(chain_candidates(kind, channel, scales))
        elif kind.name not in present:
            found.extend(_bench_candidates(kind, model, scales))
    found.extend(wrong_numbers(model))
    return [c for c in found if not _is_there(c, campaign_baseline)]


def _is_there(candidate: Candidate, baseline: Sequence[str]) -> bool:
    return candidate.name == 'unilateral_contact' and candidate.name in baseline


def _bench_candidates(
    kind: Mechanism, model: ImpactModel, scales: MotionScales
) -> Iterator[Candidate]:
    active = ActiveEffect(kind.name)
    kept = LEFT_ALONE.get(kind.name, ())
    vanishes = _VANISHES.get(kind.name)
    fitted = [p for p in kind.parameters if p.name not in kept]
    constants = {f'{active.tag}.{p.name}': p.default for p in kind.parameters if p.name in kept}
    starts = _starts(kind, fitted, scales)
    candidate = Candidate(
        label=kind.name,
        name=kind.name,
        subsystem=kind.subsystem.value,
        free=(
            *(_free(active.tag, p, scales) for p in fitted),
            *(_pulses(model) if kind.name in _RINGS_ON else ()),
        ),
        effects=(active,),
        constants=constants,
        starts=starts,
        amplitudes={
            f'{active.tag}.{p.name}': p.absent
            for p in fitted
            if p.absent is not None and math.isfinite(p.absent)
        }
        | {f'{active.tag}.{p.name}': math.inf for p in fitted if p.name == vanishes},
        along=tuple(f'{active.tag}.{p.name}' for p in fitted if p.with_strength),
    )
    yield candidate
    strikers = {model.data.blows[i].recording.kind for i in model.data.fitted} - {'tap'}
    for striker in kind.alone_in:
        if striker in strikers and len(strikers) > 1:
            yield _of_one_kind(candidate, striker, model)
    shares = implied_shares(model, kind.name) if kind.name in _WEIGHTS else {}
    if shares and len(set(shares.values())) > 1:
        yield Candidate(
            label=f'{kind.name} (by geometry)',
            name=kind.name,
            subsystem=kind.subsystem.value,
            free=candidate.free,
            effects=(ActiveEffect(kind.name, shares=f'{kind.name}.share'),),
            constants={**constants, **shares},
            starts=starts,
            amplitudes=candidate.amplitudes,
            doubt=_TIED,
        )


def _of_one_kind(candidate: Candidate, striker: str, model: ImpactModel) -> Candidate:
    """The same where one kind of impactor strikes, and absent from all other blows."""
    others = [i for i, b in enumerate(model.data.blows) if b.recording.kind != striker]
    absent = {f'{key}@{i}': value for key, value in candidate.amplitudes.items() for i in others}
    return dataclasses.replace(
        candidate,
        label=f'{candidate.label} ({striker} alone)',
        constants={**candidate.constants, **absent},
        striker=striker,
        doubt=candidate.doubt + _TIED,
    )


def _pulses(model: ImpactModel) -> Iterator[Free]:
    """Durations of the taps: what rings beside the plate tells how long the hammer pushed."""
    for i in model.data.fitted:
        blow, key = model.data.blows[i], f'tap_duration@{i}'
        if blow.recording.kind == 'tap' and key in model.constants:
            known = model.constants[key]
            longest = min(3.0 * known, 0.9 * (blow.settled - blow.onset) + 1e-3)
            yield Free(
                key,
                known,
                0.02,
                0.3 * known,
                max(longest, 1.1 * known),
                logarithmic=True,
                prior=(known, _PULSE_KNOWN * known),
                blow=i,
            )


def _free(tag: str, parameter: Parameter, scales: MotionScales) -> Free:
    """A mechanism's parameter as a number to be fitted."""
    lower, upper = parameter.lower, parameter.upper
    middle = abs(parameter.start[len(parameter.start) // 2])
    key = f'{tag}.{parameter.name}'
    if parameter.name == 'frequency':
        upper = min(upper, 2 * LARGEST_FREQUENCY)
    if parameter.name in ('travel', 'yield_displacement'):
        upper = min(upper, 3 * scales.travel)
    if parameter.name == 'start':
        lower, upper = 0.0, 0.6
    if parameter.name == 'rise':
        upper = 1.0
    if parameter.absent is None and parameter.logarithmic and lower > 0:
        return Free(key, middle, 0.05, lower, upper, logarithmic=True)
    if parameter.name == 'damping_ratio':
        return Free(key, middle, 0.01, 1e-3, min(upper, 0.9))
    scale = 0.02 if parameter.absent == 1.0 else max(0.1 * middle, 1e-9)
    return Free(key, middle, scale, lower, upper)


def _starts(
    kind: Mechanism, fitted: Sequence[Parameter], scales: MotionScales
) -> tuple[Mapping[str, float], ...]:
    lists = []
    for p in fitted:
        values: tuple[float, ...] = p.start
        if p.name == 'travel':
            values = tuple(share * scales.travel for share in (0.4, 0.6, 0.75, 0.9))
        elif p.name == 'yield_displacement':
            values = tuple(share * scales.travel for share in (0.02, 0.1, 0.4))
        elif p.name == 'speed':
            values = tuple(share * scales.speed for share in (0.02, 0.1, 0.4))
        elif p.name == 'gap':
            values = tuple(share * scales.travel for share in (0.003, 0.05))
        elif p.name == _VANISHES.get(kind.name):
            values = (100.0,)  # its strength is found by scaling
        elif p.name == 'start' and kind.name == 'external_push':
            values = (0.0, 0.015, 0.05, 0.15)
        elif p.name == 'rise':
            values = (0.01, 0.03, 0.1)
        elif p.name == 'frequency':
            channel = 'acceleration.base' if 'base' in kind.name else 'acceleration.impactor'
            seen = 0.5 * max(scales.rates.values())
            rings = (f for f in _RINGS if f < seen)
            values = tuple(dict.fromkeys((*scales.resonances.get(channel, ()), *rings)))
        elif p.absent is not None and math.isfinite(p.absent):
            values = p.start[:1]  # its strength is found by scaling
        lists.append(values)
    tag = kind.name
    combinations = itertools.islice(itertools.product(*lists), _MOST_STARTS)
    return tuple(
        {f'{tag}.{p.name}': v for p, v in zip(fitted, combination, strict=True)}
        for combination in combinations
    )
