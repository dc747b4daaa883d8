"""The answer from the outcome of a search: findings, figures, saved model, next test."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from impactscope.discrepancy.answer import (
    Answer,
    Finding,
    Mismatch,
    ParameterEstimate,
    held_out_alone,
    stand_ins_told,
)
from impactscope.discrepancy.driven.findings.decision import Decision, decide
from impactscope.discrepancy.driven.findings.figures import (
    p_value_of,
    p_value_of_rest,
    p_value_of_wrong,
    places,
    table,
    traces,
)
from impactscope.discrepancy.driven.findings.free_swing import as_force, mass_of_free_swing
from impactscope.discrepancy.driven.findings.ranking import STATED, modal_finding
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.fits.innovations import innovations
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.fits.weighted_residuals import numbers_of
from impactscope.discrepancy.driven.models.terms import Term, key
from impactscope.discrepancy.lone_samples import Left, lone_samples_told

__all__ = ['describe']


def describe(subject: Subject) -> Answer:
    """The answer to a campaign."""
    told = decide(subject)
    s, base, final = told.subject, subject.outcome.baseline, told.final
    detected = bool(told.taken)
    subsystems = tuple(dict.fromkeys(f.subsystem for f in told.taken if f.subsystem))
    new = s.new_terms if s.modes is None else ()
    units = {k: n.unit for k, n in numbers_of(s.model, s.outcome.best.terms)}
    notes = list(s.notes)
    if told.left and not told.unexplained:
        notes.append(told.left)
    figures = table(s, base, final)
    tests = _tests(s, new, told.taken)
    if told.unexplained:
        tests = [*held_out_alone(figures, s.judge.thresholds.unexplained_ratio), *tests]
    return Answer(
        campaign=s.campaign.name,
        kind=s.campaign.kind.value,
        mismatch=Mismatch(
            detected,
            _p_value(told, s, final),
            places(s, base, final) if detected else (),
            subsystems,
        ),
        accepted=tuple(f.name for f in told.taken),
        ranking=(*told.taken, *told.others),
        fit=figures,
        unexplained=told.unexplained,
        unexplained_description=told.left if told.unexplained else '',
        next_tests=tuple(dict.fromkeys(tests)),
        baseline=s.campaign.baseline_names,
        baseline_parameters=_estimates(s, base, units),
        extended_parameters=_extended(s, base, final, units),
        model=_saved(s, told.kept, told.wrong),
        notes=(
            *notes,
            *stand_ins_told(t.name for t in told.stand_ins),
            *(() if told.unexplained else _lone_samples(s, final, told.taken)),
        ),
        traces=traces(s, base, final),
    )


def _lone_samples(s: Subject, final: Fit, findings: Sequence[Finding]) -> tuple[str, ...]:
    """Of a case whose noise is known; nothing of others."""
    if s.case is None:
        return ()
    left = (
        Left(segment.recording, segment.channel, segment.time, innovations(segment, residual))
        for segment, residual in zip(s.segments, final.residuals, strict=True)
    )
    return lone_samples_told(left, findings)


def _p_value(told: Decision, s: Subject, final: Fit) -> float:
    """Chance of all that is told where nothing is missing; of the rest, where that is told."""
    chances = [p_value_of(s, final), *map(p_value_of_wrong, told.wrong)]
    if s.verdict is None and any(f.name == 'unknown' for f in told.taken):
        chances.append(p_value_of_rest(s, final))
    return min(*chances, 1.0)


def _estimates(s: Subject, made: Fit, units: Mapping[str, str]) -> dict[str, ParameterEstimate]:
    mass = mass_of_free_swing(s)
    terms = {key(t, n): t for t in made.terms for n in t.numbers}
    found = {}
    for name, value in made.values.items():
        unit = units.get(name) or _unit_of(name)
        told = ParameterEstimate(value, made.std.get(name, math.nan), unit)
        found[name] = as_force(told, mass, terms.get(name))
    return found


def _unit_of(name: str) -> str:
    """Unit of a number that no model states: angular frequencies of modes."""
    return 'rad/s' if name.startswith('mode_') and name.endswith('.frequency') else ''


def _extended(
    s: Subject, base: Fit, final: Fit, units: Mapping[str, str]
) -> dict[str, ParameterEstimate]:
    """The numbers of the extended model; of a structure its modes beside the baseline's."""
    if s.modes is None:
        return _estimates(s, final, units)
    return {**_estimates(s, base, units), **modal_finding(s).parameters}


def _tests(s: Subject, new: Sequence[Term], taken: Sequence[Finding]) -> list[str]:
    tests = []
    if not s.judge.has_held_out:
        tests.append('a recording of another strength that is held out: it would test the answer')
    rivals = {name for f in taken for name in f.confused_with}
    for term in (*new, *s.model.terms):
        if term in new and not any(f.confused_with for f in taken if f.name == term.name):
            continue
        if term not in new and term.name not in rivals:
            continue
        tests.append(f'{term.name}: {term.test}')
    return tests


def _saved(s: Subject, new: Sequence[Term], corrected: Sequence[Finding]) -> dict[str, Any]:
    """The extended model as the baseline of a next search."""
    items: list[Any] = [
        {'name': item.name, 'values': dict(item.values)} if item.values else item.name
        for item in s.campaign.baseline
    ]
    best = s.outcome.best
    for term in new:
        values = {n.name: best.values[key(term, n)] for n in term.numbers}
        items.append({'name': term.name, 'values': values} if values else term.name)
    saved: dict[str, Any] = {'baseline': items, 'values': dict(best.values)}
    wrong = {str(f.parameters['name'].value) for f in corrected}
    if any(n.endswith('.gain') or n == f'gain.{s.campaign.input_channel}' for n in wrong):
        # the recorded force stays as it is: beside it all that is stated is off by the same factor
        wrong.update(name for name, _ in STATED if name in s.campaign.sensor)
    told = _estimates(s, best, {k: n.unit for k, n in numbers_of(s.model, best.terms)})
    saved['corrected'] = {
        f'sensor.{name}': told[fitted].value for name, fitted in STATED if name in wrong
    }
    stds = {name: item.std if math.isfinite(item.std) else 0.0 for name, item in told.items()}
    saved['sensor'] = {
        stated: {'value': told[fitted].value, 'std': stds[fitted]}
        for stated, fitted in STATED
        if stated in wrong
    }
    if s.modes is not None:
        saved['modes'] = len(s.modes.frequencies)
        saved['frequencies'] = list(s.modes.frequencies)
        saved['damping_ratios'] = list(s.modes.damping_ratios)
    return saved
