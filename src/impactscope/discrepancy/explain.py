"""One question for every kind of campaign: what does the simulation leave out?"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence

from impactscope.discrepancy.answer import Answer
from impactscope.discrepancy.campaign import BaselineItem, Campaign, CampaignKind
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.impact import explain_impact
from impactscope.discrepancy.single_thread import single_threaded

__all__ = ['explain']


def _silent(share: float, text: str) -> None:
    """Progress that nobody wants to see."""


def explain(
    campaign: Campaign,
    baseline: Sequence[BaselineItem | str] | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Answer:
    """What the recordings of a campaign show that its simulation leaves out.

    Args:
        campaign: with samples in its recordings.
        baseline: in place of the campaign's own.
        progress: called with the share that is done, 0 to 1, and what is being done.

    Raises ConfigurationError where the description contradicts itself, and InputError where the
    recordings hold nothing that could be used.
    """
    tell = _silent if progress is None else progress
    if baseline is not None:
        items = tuple(b if isinstance(b, BaselineItem) else BaselineItem(b) for b in baseline)
        campaign = dataclasses.replace(campaign, baseline=items)
    started = time.perf_counter()
    with single_threaded():
        if campaign.kind is CampaignKind.IMPACT:
            answer = explain_impact(campaign, tell)
        else:
            answer = explain_driven(campaign, tell)
    tell(1.0, 'done')
    return dataclasses.replace(answer, duration_s=time.perf_counter() - started)
