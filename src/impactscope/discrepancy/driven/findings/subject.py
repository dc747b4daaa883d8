"""Everything that an answer is made from: campaign, model, fits, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from impactscope.discrepancy.campaign import Campaign
from impactscope.discrepancy.driven.adequacy.unmodelled_laws import Verdict
from impactscope.discrepancy.driven.model_selection.model_comparison import Judge
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import Term
from impactscope.discrepancy.driven.search.beam_search import Outcome
from impactscope.discrepancy.driven.systems.case import Case
from impactscope.discrepancy.driven.systems.modal import Modes

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
    def given(self) -> frozenset[tuple[str, str]]:
        """Names and channels of the effects that the baseline has, in whatever form."""
        return frozenset((t.name, t.channel) for t in self.outcome.baseline.terms)

    @property
    def new_terms(self) -> tuple[Term, ...]:
        """Effects that the best model has and the baseline has not.

        Another form of one that the baseline has is no finding.
        """
        given = self.given
        return tuple(t for t in self.outcome.best.terms if (t.name, t.channel) not in given)
