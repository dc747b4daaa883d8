"""What became of a channel's blocks, for /diagnostics and for the notes of a report."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ['ChannelStatistics']


@dataclass(frozen=True, slots=True)
class ChannelStatistics:
    """Counts since the synchroniser was made."""

    blocks: int = 0  # received, without end markers
    samples: int = 0  # taken in
    lost_samples: int = 0  # never came, by the index
    duplicates: int = 0  # blocks with samples already seen; those samples were dropped
    late: int = 0  # blocks with samples that came after their place was closed; dropped
    out_of_order: int = 0  # blocks that came after a later one and were put in their place
    missing: int = 0  # grid samples without data of this channel
    not_waited_for: int = 0  # of these, those it was too late for: it lagged by longest_wait
    clock_jumps: int = 0
    restarts: int = 0  # activations of the device after the first
    refused: int = 0  # blocks that contradict their channel
    refusal: str = ''  # why, for the last of them
    lag_s: float = math.nan  # newest sample of the reference minus newest of this one
