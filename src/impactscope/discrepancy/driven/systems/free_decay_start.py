"""Tests whether a free decay was recorded from before it was free: held, pushed, let go slowly."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from impactscope.discrepancy.campaign import Campaign, CampaignKind
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.systems.linear_baseline import Start, linear_start
from impactscope.errors import ImpactscopeError

__all__ = ['forced_beginning']

TRIED = 6  # half periods that are left out
MOST = 0.2  # of the shortest recording
# times by which the share of the signal that a linear decay leaves falls: that of a cubic spring
# falls by 16 where the amplitude halves
FALLS = 30.0
AS_GOOD = 2.0  # times what is left at best


def forced_beginning(campaign: Campaign, begun: Start) -> str:
    """From where on recordings are free, in a sentence; empty where that changes little.

    Args:
        campaign: of kind driven without an input.
        begun: its linear baseline.
    """
    values = begun.linear.values
    if campaign.kind is not CampaignKind.DRIVEN or campaign.input_channel:
        return ''
    if not values.get('stiffness', 0.0) > 0.0:
        return ''
    turns = math.sqrt(values['stiffness'] / values.get('mass', 1.0)) / (2.0 * math.pi)
    shortest = min(s.measured.size * s.period for s in begun.segments)
    whole = _left(begun.segments, begun.linear.residuals)
    seen: list[tuple[float, float, Start]] = []
    for late in (0.5 * (k + 1) / turns for k in range(TRIED)):
        if late > MOST * shortest:
            break
        try:
            without = linear_start(_later(campaign, begun, late), [])
        except ImpactscopeError:
            break
        seen.append((late, _left(without.segments, without.linear.residuals), without))
    least = min((left for _, left, _ in seen), default=math.inf)
    if not whole > FALLS * least:
        return ''
    late, left, without = next(s for s in seen if s[1] <= AS_GOOD * least)
    starts = dict.fromkeys(f'{s.recording} {s.begin:.3g} s' for s in without.segments)
    return (
        f'Without the first {late:.3g} s a linear decay leaves {math.sqrt(left):.2g} of the '
        f'signal, with them {math.sqrt(whole):.2g}: it may have been held or pushed until then. '
        f'A `start` of each recording leaves that out: {", ".join(starts)}.'
    )


def _later(campaign: Campaign, begun: Start, late: float) -> Campaign:
    """The campaign with recordings that begin later, by so many s."""
    first = {s.recording: s.begin for s in begun.segments}
    recordings = tuple(
        dataclasses.replace(r, start=first[r.file] + late) if r.file in first else r
        for r in campaign.recordings
    )
    return dataclasses.replace(campaign, recordings=recordings)


def _left(segments: Sequence[Segment], residuals: Sequence[np.ndarray]) -> float:
    """Power of what is left of all recordings, over their own."""
    power = sum(float(np.sum(s.measured**2)) for s in segments)
    return sum(float(np.sum(r**2)) for r in residuals) / (power or 1.0)
