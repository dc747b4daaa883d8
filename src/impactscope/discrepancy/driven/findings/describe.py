"""The answer from the outcome of a search: findings, figures, saved model, next test."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from impactscope.discrepancy.answer import (
    Answer,
    Finding,
    FitTable,
    Mismatch,
    ParameterEstimate,
    stand_ins_told,
)
from impactscope.discrepancy.driven.findings.figures import (
    left_over,
    p_value_of,
    places,
    table,
    traces,
)
from impactscope.discrepancy.driven.findings.free_swing import as_force, mass_of_free_swing
from impactscope.discrepancy.driven.findings.quantisation_steps import steps_found
from impactscope.discrepancy.driven.findings.ranking import (
    STATED,
    findings_of,
    modal_finding,
    unknown_finding,
    unlikely,
    wrong_parameters,
)
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.fits.simulation_error import Fit, numbers_of
from impactscope.discrepancy.driven.models.terms import Term, key
from impactscope.discrepancy.driven.search.beam_search import Outcome

__all__ = ['describe', 'leaves_most']

# of findings that looked certain so many were right among campaigns drawn at random
MOST = 0.95
MOST_BESIDE = 0.7  # where something that is not known stands beside them
MOST_OF_IT = 0.5  # of chi-square beyond what noise leaves
FAR_LEFT = 2.0  # reduced chi-square, beyond which what is left is no noise that was misjudged


def describe(s: Subject) -> Answer:
    """The answer to a campaign."""
    base = s.outcome.baseline
    final = s.modes.fit if s.modes is not None else s.outcome.best
    new = () if s.modes is not None else s.new_terms
    findings = [modal_finding(s)] if s.modes is not None else findings_of(s, new)
    accepted = ['further_modes'] if s.modes is not None else [t.name for t in new]
    steps = steps_found(s, final)
    findings[len(accepted) : len(accepted)] = steps
    accepted += [f.name for f in steps]
    wrong = wrong_parameters(s)
    findings[len(accepted) : len(accepted)] = wrong
    accepted += [f.name for f in wrong]
    instead = s.verdict is not None and s.verdict.left and s.verdict.instead
    if instead and table(s, base, final).loses:
        final = base
    stranger, sentence = left_over(s, base, final)
    doubted: frozenset[str] = frozenset()
    if new and sentence and not instead:
        doubted = unlikely(s, new)
        none = doubted == {t.name for t in new}
        if stranger and (none or leaves_most(table(s, base, final))):
            if s.verdict is None:
                rivals = (s.outcome.best, *s.outcome.rivals)
                return describe(
                    dataclasses.replace(s, outcome=Outcome(base, base, rivals, believed=False))
                )
            instead, final = True, base
        if none or instead:
            doubted = frozenset()
        accepted = [name for name in accepted if name not in doubted]
        findings.sort(key=lambda f: f.name in doubted)
    if s.verdict is not None and s.verdict.left:
        unknown = unknown_finding(s.verdict)
        if instead:
            findings.insert(0, unknown)
            accepted = ['unknown', *(f.name for f in (*steps, *wrong))]
            named = set(accepted)
            findings = [f for f in findings if f.name in named] + [
                f for f in findings if f.name not in named
            ]
        else:
            findings.insert(len(accepted), unknown)
            accepted.append('unknown')
    elif stranger:
        findings.insert(len(accepted), Finding('unknown', 1.0, 'unknown', sentence=sentence))
        accepted.append('unknown')
    beside = 'unknown' in accepted and len(accepted) > 1
    findings = [_modest(f, MOST_BESIDE if beside else MOST) for f in findings]
    detected = bool(accepted)
    # what findings leave is not known, be it an error of their laws or of all else in the model
    unexplained = stranger or bool(sentence and accepted)
    if unexplained and not stranger:
        sentence = f'More than noise is left, and not known what it is: {sentence}'
    taken = findings[: len(accepted)]
    subsystems = tuple(dict.fromkeys(f.subsystem for f in taken if f.subsystem))
    tests = tuple(dict.fromkeys(_tests(s, new, taken)))
    units = {k: n.unit for k, n in numbers_of(s.model, s.outcome.best.terms)}
    return Answer(
        campaign=s.campaign.name,
        kind=s.campaign.kind.value,
        mismatch=Mismatch(
            detected,
            p_value_of(s, final),
            places(s, base, final) if detected else (),
            subsystems,
        ),
        accepted=tuple(accepted),
        ranking=tuple(findings),
        fit=table(s, base, final),
        unexplained=unexplained,
        unexplained_description=sentence if unexplained else '',
        next_tests=tests,
        baseline=s.campaign.baseline_names,
        baseline_parameters=_estimates(s, base, units),
        extended_parameters=_extended(s, base, final, units),
        model=_saved(s, () if instead else tuple(t for t in new if t.name not in doubted), wrong),
        notes=(
            *s.notes,
            *(() if unexplained or not sentence else (sentence,)),
            *(
                stand_ins_told(t.name for t in new if instead or t.name in doubted)
                if final is not base
                else ()
            ),
        ),
        traces=traces(s, base, final),
    )


def leaves_most(fit: FitTable) -> bool:
    """Whether findings leave most of what there is beyond noise, and that is far more than noise.

    What is not known then bends whatever is fitted: names of such findings would be wrong ones.
    """
    pairs = [
        (fit.baseline.reduced_chi_square, fit.extended.reduced_chi_square),
        (fit.baseline.held_out_reduced_chi_square, fit.extended.held_out_reduced_chi_square),
    ]
    known = [(b, e) for b, e in pairs if math.isfinite(b) and math.isfinite(e)]
    return bool(known) and all(e > FAR_LEFT and e - 1 > MOST_OF_IT * (b - 1) for b, e in known)


def _modest(finding: Finding, most: float) -> Finding:
    """A finding with a probability that allows for what no likelihood knows."""
    return dataclasses.replace(finding, probability=min(most * finding.probability, most))


def _estimates(s: Subject, made: Fit, units: Mapping[str, str]) -> dict[str, ParameterEstimate]:
    mass = mass_of_free_swing(s)
    terms = {key(t, n): t for t in made.terms for n in t.numbers}
    return {
        name: as_force(
            ParameterEstimate(value, made.std.get(name, math.nan), units.get(name, '')),
            mass,
            terms.get(name),
        )
        for name, value in made.values.items()
    }


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
    if any(name.endswith('.gain') or name.startswith('gain.') for name in wrong):
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
