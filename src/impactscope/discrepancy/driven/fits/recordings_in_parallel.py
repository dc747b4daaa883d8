"""Work on the segments of a campaign, in a thread for each recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.parallel import in_parallel

__all__ = ['by_recording']

_Result = TypeVar('_Result')

_LEAST = 5000  # samples, below which threads cost more than they save


def by_recording(
    work: Callable[[int], _Result], chosen: Sequence[int], segments: Sequence[Segment]
) -> list[_Result]:
    """``work`` on each of some segments, by number; results in the order of ``chosen``.

    Channels of one recording share its motion: they follow each other in one thread.
    """
    if sum(segments[i].measured.size for i in chosen) < _LEAST:
        return [work(i) for i in chosen]
    groups: dict[str, list[int]] = {}
    for i in chosen:
        groups.setdefault(segments[i].recording, []).append(i)
    parts = in_parallel(lambda group: [(i, work(i)) for i in group], list(groups.values()))
    made = dict(pair for part in parts for pair in part)
    return [made[i] for i in chosen]
