"""Looks at each block that a device delivers and flags what is wrong with it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from impactscope.records import NANOSECONDS, Quality, SampleBlock

__all__ = ['BlockMonitor', 'MonitorStatistics']


@dataclasses.dataclass
class MonitorStatistics:
    """Counts since the driver was configured."""

    blocks: int = 0
    samples: int = 0
    lost_samples: int = 0
    clipped_blocks: int = 0
    not_finite_blocks: int = 0
    clock_jumps: int = 0
    stalls: int = 0


class BlockMonitor:
    """Adds quality flags to the blocks of one device; never changes a value.

    A stall is a block that came later than ``stall_time`` s after the end of the one before it
    was due; a clock jump is a device clock that disagrees with the sample count by more than
    ``clock_tolerance`` s from one block to the next.
    """

    def __init__(self, stall_time: float = 0.25, clock_tolerance: float = 1e-3) -> None:
        self.statistics = MonitorStatistics()
        self._stall_ns = round(stall_time * NANOSECONDS)
        self._clock_tolerance_ns = round(clock_tolerance * NANOSECONDS)
        self._last: dict[str, SampleBlock] = {}

    def check(self, block: SampleBlock) -> SampleBlock:
        """The block with the flags it deserves."""
        counts = self.statistics
        flags = block.quality
        values = block.values
        if values.size:
            # NaN passes through both; comparisons with it, also of an unknown range, are false.
            lowest, highest = float(values.min()), float(values.max())
            if not (math.isfinite(lowest) and math.isfinite(highest)):
                flags |= Quality.NOT_FINITE
                counts.not_finite_blocks += 1
                lowest, highest = _extremes(values)
            if highest >= block.range_max or lowest <= block.range_min:
                flags |= Quality.CLIPPED
                counts.clipped_blocks += 1
        last = self._last.get(block.channel)
        if last is not None and last.epoch == block.epoch:
            flags |= self._compare(last, block)
        self._last[block.channel] = block
        counts.blocks += 1
        counts.samples += values.size
        if flags == block.quality:
            return block
        return dataclasses.replace(block, quality=flags)

    def _compare(self, last: SampleBlock, block: SampleBlock) -> Quality:
        counts = self.statistics
        flags = Quality.NONE
        expected = last.first_index + last.values.size
        if block.first_index > expected:
            flags |= Quality.GAP_BEFORE
            counts.lost_samples += block.first_index - expected
        elapsed_ns = (block.first_index - last.first_index) / block.sample_rate * NANOSECONDS
        if block.device_time_ns >= 0 and last.device_time_ns >= 0 and block.values.size:
            shown_ns = block.device_time_ns - last.device_time_ns
            if abs(shown_ns - elapsed_ns) > self._clock_tolerance_ns:
                flags |= Quality.CLOCK_JUMP
                counts.clock_jumps += 1
        if (
            block.received_ns > 0
            and last.received_ns > 0
            and block.received_ns - last.received_ns - elapsed_ns > self._stall_ns
        ):
            flags |= Quality.STALLED
            counts.stalls += 1
        return flags


def _extremes(values: NDArray[np.float32]) -> tuple[float, float]:
    """The smallest and the largest of the values that are no NaN; NaN where there are none."""
    known = values[~np.isnan(values)]
    if not known.size:
        return math.nan, math.nan
    return float(known.min()), float(known.max())
