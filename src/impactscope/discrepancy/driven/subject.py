"""All that an answer is made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from impactscope.discrepancy.campaign import Campaign
from impactscope.discrepancy.driven.case import Case
from impactscope.discrepancy.driven.decide import Judge
from impactscope.discrepancy.driven.modal import Modes
from impactscope.discrepancy.driven.model import Model, Segment
from impactscope.discrepancy.driven.search import Outcome
from impactscope.discrepancy.driven.strangers import Verdict
from impactscope.discrepancy.driven.terms import Term

__all__ = ['Subject']


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """All that an answer is made from."""

    campaign: Campaign
    model: Model
    segments: Sequence[Segment]
    judge: Judge
    outcome: Outcome
    modes: Modes | None
    notes: tuple[str, ...]
    case: Case | None = None  # where the residual is noise
    verdict: Verdict | None = None  # on what the vocabulary lacks, there

    @property
    def new_terms(self) -> tuple[Term, ...]:
        """Effects that the best model has and the baseline has not."""
        given = {t.label for t in self.outcome.baseline.terms}
        return tuple(t for t in self.outcome.best.terms if t.label not in given)
