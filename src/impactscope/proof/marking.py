"""Mark one answer of an engine against what was concealed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from .effect import DRY_FRICTIONS
from .evidence_map import BIN
from .ideal_observer import chance_of_name, chance_of_set

__all__ = ['DETECTABLE', 'Mark', 'mark', 'truths']

DETECTABLE = 1.0  # d' below which the right answer is: nothing
SHOWN = 5.0  # d' of all recordings, from which what the held-out ones alone show may be named

# Conventions the vocabulary leaves open: factors by which a right value may differ.
_CONVENTIONS: Mapping[tuple[str, str], tuple[float, ...]] = {
    ('clearance', 'gap'): (1.0, 0.5),  # whole or half width
    ('clock_error', 'offset'): (1.0, -1.0),  # which clock is late
    ('clock_error', 'drift'): (1.0, -1.0),
}


@dataclass
class Mark:
    """What one answer is worth; None where the question does not arise."""

    campaign: str
    category: str
    detectability: float
    truth: tuple[str, ...]
    answered: bool
    accepted: tuple[str, ...] = ()
    first: str = ''  # what the engine would name first: a mechanism, 'unknown' or 'nothing'
    finding: bool = False
    name_first: bool | None = None
    family_first: bool | None = None
    right_set: bool | None = None
    exact_set: bool | None = None
    subsystem: bool | None = None
    evidence_inside: float | None = None  # share of d'² inside the named regions
    time_named: float | None = None  # s of channels named as regions
    parameter_errors: dict[str, float] = field(default_factory=dict)
    covered: dict[str, bool] = field(default_factory=dict)
    held_out_ratio: float | None = None
    held_out_limit: float | None = None  # of that ratio, which the best fits keep in 95 %
    probability: float | None = None
    ideal_name: float | None = None  # chance that an ideal observer has the first name right
    ideal_set: float | None = None  # and the set
    unknown: bool | None = None
    parameter_named: bool | None = None
    seconds: float = math.nan
    kind: str = 'impact'
    coloured: bool = False  # whether the noise is not white


_FAMILY = dict.fromkeys(DRY_FRICTIONS, DRY_FRICTIONS[0])


def truths(answer: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The concealed parts that can be seen at all.

    Steps always can: the values stand on a lattice, whatever they add to the noise.
    """
    return [
        p
        for p in answer['parts']
        if p['detectability'] >= DETECTABLE or p['name'] == 'quantisation'
    ]


def mark(
    campaign: str, answer: Mapping[str, Any], reply: Mapping[str, Any] | None, seconds: float
) -> Mark:
    """Mark the reply (parsed JSON, or None where there is none) of an engine.

    Args:
        campaign: its name.
        answer: what was sealed.
        reply: as the format of the answers says; missing parts count as not answered.
        seconds: taken.
    """
    parts = truths(answer)
    outside = any(p['family'] == 'outside' for p in parts)
    names = tuple('unknown' if p['family'] == 'outside' else str(p['name']) for p in parts)
    result = Mark(
        campaign,
        str(answer['category']),
        min((float(p['detectability']) for p in parts), default=float(answer['detectability'])),
        names,
        reply is not None,
        seconds=seconds,
        kind=str(answer.get('kind', 'impact')),
        coloured=any(
            c.get('poles') or c.get('step') for c in (answer.get('colours') or {}).values()
        ),
    )
    confusable = set(answer.get('confusable') or {})
    if names and not outside:
        result.ideal_name = chance_of_name(parts, confusable)
        result.ideal_set = chance_of_set(parts, confusable)
    if reply is None:
        if names:
            result.name_first = result.family_first = result.right_set = result.exact_set = False
            result.unknown = False if outside else None
        return result
    ranking = [r for r in reply.get('ranking') or [] if isinstance(r, Mapping)]
    accepted = tuple(str(a) for a in reply.get('accepted') or [])
    unexplained = _truthy(reply.get('unexplained'))
    detected = bool((reply.get('mismatch') or {}).get('detected', False))
    tolerated = set(answer.get('tolerated') or [])
    if names:  # beside what can be seen; alone, below that d', every finding is a false one
        tolerated |= {p['name'] for p in answer['parts'] if p.get('by_all', 0.0) >= SHOWN}
    tolerated -= set(names)
    # part of the noise, or shown by held-out recordings alone: neither right nor wrong to name
    if tolerated & set(accepted):
        accepted = tuple(a for a in accepted if a not in tolerated)
        ranking = [r for r in ranking if r.get('name') not in tolerated]
        detected = detected and bool(accepted)
    result.accepted = accepted
    result.finding = bool(accepted) or detected or unexplained
    entry: dict[str, Mapping[str, Any]] = {}
    for told_first in ranking:
        entry.setdefault(str(told_first.get('name')), told_first)
    result.first = _first(accepted, ranking, unexplained)
    if names:
        _mark_names(result, names, entry, confusable, unexplained, outside=outside)
        _mark_place(result, parts, reply, answer)
        for part in parts:
            told_of = _told_of(part, ranking)
            if told_of is not None and part['name'] != 'wrong_parameter':
                _mark_parameters(result, part, told_of)
        if ranking and _number(ranking[0].get('probability')) is not None:
            result.probability = _number(ranking[0].get('probability'))
        if any(p['family'] in ('parameter', 'label') for p in parts):
            told = (entry.get('wrong_parameter') or {}).get('parameters') or {}
            wanted = str(parts[0]['parameters'].get('name'))
            result.parameter_named = _last_part(wanted) == _last_part(_text(told.get('name')))
            if result.parameter_named:
                _mark_parameters(result, parts[0], entry['wrong_parameter'])
    result.held_out_ratio = _held_out(reply.get('fit') or {}, answer.get('noise') or {})
    result.held_out_limit = _number(answer.get('prediction_limit'))
    return result


def _first(accepted: tuple[str, ...], ranking: list[Mapping[str, Any]], unexplained: bool) -> str:
    """A mechanism only where the engine stands by one."""
    if accepted:
        order = [str(r.get('name')) for r in ranking if str(r.get('name')) in accepted]
        return order[0] if order else accepted[0]
    return 'unknown' if unexplained else 'nothing'


def _mark_names(
    result: Mark,
    names: tuple[str, ...],
    entry: Mapping[str, Mapping[str, Any]],
    confusable: set[str],
    unexplained: bool,
    *,
    outside: bool,
) -> None:
    said = set(result.accepted)
    if outside:
        # a stranger that the data cannot tell from the library may be called by its name
        result.unknown = unexplained or 'unknown' in said or bool(said & confusable)
        result.name_first = result.family_first = result.right_set = result.unknown
        result.exact_set = result.unknown
        return

    def stands_for(claim: str, truth: str) -> bool:
        if claim == truth:
            return True
        others = {str(c) for c in (entry.get(claim) or {}).get('confused_with') or []}
        return claim in confusable and truth in others

    first = next(iter(entry), result.first) if not said else result.first
    result.name_first = any(stands_for(first, n) for n in names)
    family = _FAMILY.get(first, first)
    result.family_first = result.name_first or family in {_FAMILY.get(n, n) for n in names}
    result.exact_set = said == set(names)
    left = list(names)
    matched = True
    for claim in sorted(said, key=lambda c: c not in names):
        hit = next((n for n in left if stands_for(claim, n)), None)
        if hit is None:
            matched = False
        else:
            left.remove(hit)
    result.right_set = matched and not left


def _mark_place(
    result: Mark,
    parts: Iterable[Mapping[str, Any]],
    reply: Mapping[str, Any],
    answer: Mapping[str, Any],
) -> None:
    mismatch = reply.get('mismatch') or {}
    told = {
        str(s.get('name', s.get('subsystem'))) if isinstance(s, Mapping) else str(s)
        for s in mismatch.get('subsystems') or []
    }
    wanted = {str(p['subsystem']) for p in parts}
    result.subsystem = wanted <= told
    evidence: Mapping[str, Mapping[str, Mapping[str, float]]] = answer.get('evidence') or {}
    regions = [r for r in mismatch.get('regions') or [] if isinstance(r, Mapping)]
    if not evidence:
        return
    inside = total = 0.0
    for recording, channels in evidence.items():
        for channel, bins in channels.items():
            for number, weight in bins.items():
                middle = (int(number) + 0.5) * BIN
                total += weight
                inside += weight * any(_covers(r, recording, channel, middle) for r in regions)
    result.evidence_inside = inside / total if total else None
    result.time_named = sum(
        (_number(r.get('end_s')) or 0.0) - (_number(r.get('start_s')) or 0.0) for r in regions
    )


def _covers(region: Mapping[str, Any], recording: str, channel: str, moment: float) -> bool:
    named = str(region.get('recording', ''))
    if named.removesuffix('.mcap') != recording.removesuffix('.mcap'):
        return False
    if str(region.get('channel', '')) != channel:
        return False
    start, end = _number(region.get('start_s')), _number(region.get('end_s'))
    return start is not None and end is not None and start - BIN <= moment <= end + BIN


def _told_of(
    part: Mapping[str, Any], ranking: Sequence[Mapping[str, Any]]
) -> Mapping[str, Any] | None:
    """The first entry of a concealed part's name, one of its channel before others."""
    named = [r for r in ranking if r.get('name') == part['name']]
    channel = part['parameters'].get('channel')
    return next((r for r in named if r.get('channel') == channel), named[0] if named else None)


def _mark_parameters(result: Mark, part: Mapping[str, Any], entry: Mapping[str, Any]) -> None:
    told = entry.get('parameters') or {}
    for name, true in part['parameters'].items():
        given = told.get(name)
        if not isinstance(true, int | float) or not isinstance(given, Mapping) or true == 0:
            continue
        value, std = _number(given.get('value')), _number(given.get('std'))
        if value is None:
            continue
        factors = _CONVENTIONS.get((str(part['name']), name), (1.0,))
        error = min(abs(value - f * true) for f in factors)
        key = f'{part["name"]}.{name}'
        result.parameter_errors[key] = error / abs(true)
        if std is not None and std > 0:
            result.covered[key] = error <= 1.959964 * std


def _held_out(fit: object, noise: Mapping[str, float]) -> float | None:
    """Largest ratio of held-out RMSE to the noise over the channels.

    The noise is the one the channel was given; the engine's own figure where that is not known.
    """
    if not isinstance(fit, Mapping):
        return None
    extended = fit.get('extended') or {}
    errors, floor = extended.get('held_out_rmse'), noise or fit.get('noise_floor')
    if not isinstance(errors, Mapping):
        return None
    ratios = []
    for channel, error in errors.items():
        level = floor.get(channel) if isinstance(floor, Mapping) else floor
        top, bottom = _number(error), _number(level)
        if top is not None and bottom:
            ratios.append(top / bottom)
    return max(ratios) if ratios else None


def _truthy(value: object) -> bool:
    if isinstance(value, Mapping):
        return any(
            bool(value.get(key))
            for key in ('value', 'found', 'present', 'unexplained', 'detected')
        )
    return bool(value)


def _text(value: object) -> str:
    return str(value.get('value') if isinstance(value, Mapping) else value)


def _last_part(name: str) -> str:
    """Of a number's name: an answer may leave out to what it belongs."""
    return name.split('@')[0].rsplit('.', 1)[-1]


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None
