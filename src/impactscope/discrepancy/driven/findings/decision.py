"""What an answer names, what of it is left out again, and what stays unknown."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

from impactscope.discrepancy.answer import Finding, FitTable, suspects
from impactscope.discrepancy.driven.findings.figures import left_over, table
from impactscope.discrepancy.driven.findings.quantisation_steps import steps_found
from impactscope.discrepancy.driven.findings.ranking import (
    findings_of,
    modal_finding,
    unknown_finding,
    unlikely,
    wrong_parameters,
)
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.terms import Term
from impactscope.discrepancy.driven.search.beam_search import Outcome
from impactscope.discrepancy.evidence import BESIDE_UNKNOWN

__all__ = ['Decision', 'decide', 'leaves_most']

# of findings that looked certain so many were right among campaigns drawn at random
MOST = 0.95
MOST_OF_IT = 0.5  # of chi-square beyond what noise leaves
FAR_LEFT = 2.0  # reduced chi-square, beyond which what is left is no noise that was misjudged


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """What is accepted, and on which fit it stands.

    ``subject``: that of the answer; without its outcome where nothing of that can be named.
    ``final``: the fit whose figures are told. ``taken``: accepted findings. ``others``: what else
    was tried. ``wrong``: of those taken, the numbers that are stated wrongly. ``kept``: effects
    of the saved model. ``stand_ins``: effects of the final fit that are not named. ``left``: a
    sentence on what is left beyond noise, else empty. ``unexplained``: whether that is a finding.
    """

    subject: Subject
    final: Fit
    taken: tuple[Finding, ...]
    others: tuple[Finding, ...]
    wrong: tuple[Finding, ...]
    kept: tuple[Term, ...]
    stand_ins: tuple[Term, ...]
    left: str
    unexplained: bool


def decide(s: Subject) -> Decision:
    """Decide what of an outcome is named.

    Something unknown either takes the place of all that the search has found, or stands beside
    what is likelier there than not.
    """
    base = s.outcome.baseline
    final = s.outcome.best if s.modes is None else s.modes.fit
    new = s.new_terms if s.modes is None else ()
    found = findings_of(s, new) if s.modes is None else [modal_finding(s)]
    count = len(new) if s.modes is None else 1
    named, others = found[:count], found[count:]
    wrong = wrong_parameters(s)
    signs = [*steps_found(s, final), *wrong]  # stand whatever the laws are
    instead = s.verdict is not None and s.verdict.left and s.verdict.instead
    figures = table(s, base, final)
    if instead and figures.loses:
        final = base
    stranger, left = left_over(s, base, final)
    doubted: frozenset[str] = frozenset()
    if new and left and not instead:
        doubted = unlikely(s, new)
        # what is not known has bent a law that does not predict
        none = doubted == {t.name for t in new} or (stranger and figures.loses)
        if stranger and (none or leaves_most(figures)):
            if s.verdict is None:
                return decide(_without_findings(s))
            instead, final = True, base
        if none:
            doubted = frozenset()
    if instead:
        doubted = frozenset(f.name for f in named)
    unknown = _unknown(s, left if stranger else '')
    taken = [*(f for f in named if f.name not in doubted), *signs]
    taken = [*unknown, *taken] if instead else [*taken, *unknown]
    dropped = [f for f in named if f.name in doubted]
    others = [*dropped, *others] if instead else [*others, *dropped]
    most = BESIDE_UNKNOWN if unknown and len(taken) > 1 else MOST
    if not taken:
        others = suspects(others, s.judge.thresholds.confusable)
    # what findings leave is not known, be it an error of their laws or of all else in the model
    strange = next((f.sentence for f in taken if f.name == 'unknown'), '')
    unexplained = stranger or bool(left and taken)
    if unexplained and not stranger:
        left = f'More than noise is left, and not known what it is: {left}'
    elif not left and strange:
        left, unexplained = strange, True
    kept = tuple(t for t in new if t.listed and t.name not in doubted)
    return Decision(
        s,
        final,
        _modest(taken, most),
        _modest(others, most),
        tuple(wrong),
        kept,
        tuple(t for t in new if t not in kept) if final is not base else (),
        left,
        unexplained,
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


def _without_findings(s: Subject) -> Subject:
    base, rivals = s.outcome.baseline, (s.outcome.best, *s.outcome.rivals)
    return dataclasses.replace(s, outcome=Outcome(base, base, rivals, believed=False))


def _unknown(s: Subject, left: str) -> list[Finding]:
    """The finding that something is missing that is not known, if so."""
    if s.verdict is not None and s.verdict.left:
        return [unknown_finding(s.verdict)]
    return [Finding('unknown', 1.0, 'unknown', sentence=left)] if left else []


def _modest(findings: Sequence[Finding], most: float) -> tuple[Finding, ...]:
    """Findings with probabilities that allow for what no likelihood knows."""
    return tuple(
        dataclasses.replace(f, probability=min(most * f.probability, most)) for f in findings
    )
