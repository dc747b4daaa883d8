"""A stretch of one channel's samples, addressed by position, with flags on them."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from impactscope.records import Quality, SampleBlock

__all__ = ['SampleStore']


class _Flagged(NamedTuple):
    start: int
    stop: int
    flags: Quality


@njit(cache=True)  # type: ignore[untyped-decorator]
def _take(
    values: NDArray[np.float32], least: float, most: float, out: NDArray[np.float32]
) -> tuple[bool, int, int, int, int]:
    """Copy, infinities as NaN.

    Returns whether all is well; first and last sample that is clipped, and that is not finite.
    """
    lowest, highest = np.float32(least), np.float32(most)  # rounded as the samples are
    clean = True
    for k in range(values.size):
        value = values[k]
        out[k] = value
        # Finite, and short of both limits; a limit of NaN is never reached.
        clean &= (value - value == 0) & (not (value >= highest)) & (not (value <= lowest))
    clipped_first, clipped_last, odd_first, odd_last = -1, -1, -1, -1
    if clean:
        return True, clipped_first, clipped_last, odd_first, odd_last
    for k in range(values.size):
        value = values[k]
        if value >= highest or value <= lowest:
            clipped_last = k
            if clipped_first < 0:
                clipped_first = k
        if not math.isfinite(value):
            out[k] = math.nan
            odd_last = k
            if odd_first < 0:
                odd_first = k
    return False, clipped_first, clipped_last, odd_first, odd_last


class SampleStore:
    """Samples at positions ``start`` up to ``end``; grows at the end, forgets at the start."""

    def __init__(self) -> None:
        self.samples = np.empty(0, dtype=np.float32)  # samples[0] stands at ``start``
        self.start = 0
        self.end = 0
        self.keep = 0  # no more samples than this are held
        self.used = 0  # positions before this are not asked for again
        self._flagged: deque[_Flagged] = deque(maxlen=4096)

    def extend(self, size: int) -> None:
        """Make room for ``size`` more samples at the end."""
        if self.end + size - self.start > self.samples.size:
            self._make_room(size)
        self.end += size

    def extend_missing(self, size: int) -> None:
        """Append ``size`` NaN."""
        self.extend(size)
        at = self.end - size - self.start
        self.samples[at : at + size] = np.nan

    def write(self, block: SampleBlock, position: int, begin: int, end: int) -> None:
        """Put samples begin .. end - 1 of a block where they belong; flag what is odd."""
        values = block.values if end - begin == block.values.size else block.values[begin:end]
        at = position - self.start
        clean, clipped_first, clipped_last, odd_first, odd_last = _take(
            values, block.range_min, block.range_max, self.samples[at : at + values.size]
        )
        if block.quality:
            self.flag(position, position + values.size, block.quality)
        if clean:
            return
        if clipped_first >= 0:
            self.flag(position + clipped_first, position + clipped_last + 1, Quality.CLIPPED)
        if odd_first >= 0:
            self.flag(position + odd_first, position + odd_last + 1, Quality.NOT_FINITE)

    def _make_room(self, size: int) -> None:
        least = self.end + size - self.keep
        self.used = max(self.used, min(least, self.end))
        oldest = min(max(self.used, least, self.start), self.end)
        kept = self.samples[oldest - self.start : self.end - self.start]
        if (kept.size + size) * 2 > self.samples.size:
            samples = np.empty(max(4096, (kept.size + size) * 4), dtype=np.float32)
            samples[: kept.size] = kept
            self.samples = samples
        else:
            self.samples[: kept.size] = kept.copy()
        self.start = oldest

    def flag(self, start: int, stop: int, flags: Quality) -> None:
        """Flag the samples from ``start`` up to ``stop``."""
        if self._flagged:
            last = self._flagged[-1]
            if last.flags == flags and last.start <= start <= last.stop:
                self._flagged.pop()
                start, stop = last.start, max(stop, last.stop)
        self._flagged.append(_Flagged(start, stop, flags))

    @property
    def has_flags(self) -> bool:
        """Whether any sample held may be flagged."""
        return bool(self._flagged)

    def flags(self, start: int, stop: int) -> Quality:
        """Flags of the samples from ``start`` up to ``stop``."""
        flags = Quality.NONE
        for item in self._flagged:
            if item.start < stop and item.stop > start:
                flags |= item.flags
        return flags

    def forget(self, position: int) -> None:
        """Samples before this position are not asked for again."""
        if position > self.used:
            self.used = position
        while self._flagged and self._flagged[0].stop < self.used:
            self._flagged.popleft()
