"""One question for every kind of campaign: what does the simulation leave out?"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence

from scipy import stats

from impactscope.discrepancy.answer import Answer, Finding
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
    ranking = tuple(_as_far_as_known(finding, campaign) for finding in answer.ranking)
    elapsed = time.perf_counter() - started
    return dataclasses.replace(answer, ranking=ranking, duration_s=elapsed)


def _as_far_as_known(finding: Finding, campaign: Campaign) -> Finding:
    """A filter's cut-off with what its form leaves open of it.

    A filter that may as well be a delay shows nothing else: its cut-off is known to be high and
    has no interval. And nobody knows whether a filter was an analogue one or one of samples: the
    two differ by (pi f / f_s)^2 / 3 of the cut-off, by how the bilinear transform bends time. From
    half the sampling rate on it can only be an analogue one.
    """
    if finding.name != 'low_pass_filter' or 'cutoff' not in finding.parameters:
        return finding
    cutoff = finding.parameters['cutoff']
    std = math.nan
    rates = [
        r.channels[finding.channel].sample_rate
        for r in campaign.recordings
        if finding.channel in r.channels
    ]
    if 'clock_error' not in finding.confused_with and rates:
        value = float(cutoff.value)
        turns = value / min(rates)
        bent = value * (math.pi * turns) ** 2 / 3.0 if turns < 0.5 else 0.0
        std = math.hypot(cutoff.std, bent / stats.norm.ppf(0.975))
    parameters = {**finding.parameters, 'cutoff': dataclasses.replace(cutoff, std=std)}
    return dataclasses.replace(finding, parameters=parameters)
