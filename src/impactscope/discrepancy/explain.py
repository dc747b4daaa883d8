"""One question for every kind of campaign: what does the simulation leave out?"""

from __future__ import annotations

import dataclasses
import difflib
import math
import time
from collections.abc import Callable, Sequence

from scipy import stats

from impactscope.discrepancy.answer import Answer, Finding
from impactscope.discrepancy.campaign import BaselineItem, Campaign, CampaignKind
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.systems.linear_baseline import LINEAR
from impactscope.discrepancy.impact import explain_impact
from impactscope.discrepancy.impact.models.baseline import STRUCTURE
from impactscope.discrepancy.single_thread import single_threaded
from impactscope.discrepancy.time_limit import time_limited
from impactscope.errors import ConfigurationError
from impactscope.physics.mechanisms.registry import all_mechanisms

__all__ = ['check_baseline', 'explain']

FILTERS_DELAY = 1.6  # samples, of a filter of order 8 whose cut-off is half the rate
_CUT_SHORT = ' Not all that is known here was tried for it: the time was over.'
DRIFTS = 3.0  # standard deviations
THINNED = 10.0  # times the rate, at which a filter of samples may have run


def _silent(share: float, text: str) -> None:
    """Progress that nobody wants to see."""


def check_baseline(campaign: Campaign) -> None:
    """Raises ConfigurationError for a name that no campaign of that kind knows."""
    basis = STRUCTURE if campaign.kind is CampaignKind.IMPACT else LINEAR
    known = (*basis, *all_mechanisms())
    for name in campaign.baseline_names:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            meant = f' (is {near[0]!r} meant?)' if near else ''
            raise ConfigurationError(
                f'{campaign.name}: baseline names {name!r}, which is not known for a campaign of '
                f'kind {campaign.kind.value}{meant}; known are {", ".join(known)}'
            )


def explain(
    campaign: Campaign,
    baseline: Sequence[BaselineItem | str] | None = None,
    progress: Callable[[float, str], None] | None = None,
    within_s: float = math.inf,
) -> Answer:
    """What the recordings of a campaign show that its simulation leaves out.

    Args:
        campaign: with samples in its recordings.
        baseline: in place of the campaign's own.
        progress: called with the share that is done, 0 to 1, and what is being done.
        within_s: time after which the search only finishes what an answer cannot do without; the
            answer's notes tell what was left out.

    Raises ConfigurationError where the description contradicts itself, and InputError where the
    recordings hold nothing that could be used.
    """
    tell = _silent if progress is None else progress
    if baseline is not None:
        items = tuple(b if isinstance(b, BaselineItem) else BaselineItem(b) for b in baseline)
        campaign = dataclasses.replace(campaign, baseline=items)
    check_baseline(campaign)
    started = time.perf_counter()
    with single_threaded(), time_limited(within_s) as limit:
        if campaign.kind is CampaignKind.IMPACT:
            answer = explain_impact(campaign, tell)
        else:
            answer = explain_driven(campaign, tell)
    tell(1.0, 'done')
    ranking = tuple(
        _filter_or_delay(_as_far_as_known(finding, campaign), campaign)
        for finding in answer.ranking
    )
    elapsed = time.perf_counter() - started
    notes = (*answer.notes, *limit.told)
    said = answer.unexplained_description
    if answer.unexplained and limit.left_out:
        said += _CUT_SHORT
    return dataclasses.replace(
        answer,
        ranking=ranking,
        notes=notes,
        unexplained_description=said,
        duration_s=elapsed,
    )


def _as_far_as_known(finding: Finding, campaign: Campaign) -> Finding:
    """A filter's cut-off with what its form leaves open of it.

    A filter that may as well be a delay shows nothing else: its cut-off is known to be high and
    has no interval. And nobody knows whether a filter was an analogue one or one of samples: the
    two differ by (pi f / f_s)^2 / 3 of the cut-off, by how the bilinear transform bends time. From
    half the sampling rate on it is an analogue one, or one of samples that were thinned out later.
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
        turns = turns if turns < 0.5 else turns / THINNED
        bent = value * (math.pi * turns) ** 2 / 3.0
        std = math.hypot(cutoff.std, bent / stats.norm.ppf(0.975))
    parameters = {**finding.parameters, 'cutoff': dataclasses.replace(cutoff, std=std)}
    return dataclasses.replace(finding, parameters=parameters)


def _filter_or_delay(finding: Finding, campaign: Campaign) -> Finding:
    """A clock's small offset with what else it may be: a filter above half the sampling rate.

    A Butterworth filter of order n and cut-off f delays what lies far below f by
    1 / (2 pi f sin(pi / 2n)) and weakens it by less than can be seen. At order 8 and half the
    sampling rate that is 1.6 samples; a filter in another channel makes this one early.
    """
    offset = finding.parameters.get('offset')
    drift = finding.parameters.get('drift')
    if (
        finding.name != 'clock_error'
        or offset is None
        or 'low_pass_filter' in finding.confused_with
    ):
        return finding
    drifts = drift is not None and abs(float(drift.value)) > DRIFTS * drift.std > 0.0
    rates = [c.sample_rate for r in campaign.recordings for c in r.channels.values()]
    if drifts or abs(float(offset.value)) > FILTERS_DELAY / max(rates, default=math.inf):
        return finding
    alike = (*finding.confused_with, 'low_pass_filter')
    return dataclasses.replace(finding, confused_with=alike)
