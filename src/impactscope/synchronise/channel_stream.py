"""One channel's blocks, put in order and placed in time.

Samples stand at *positions*, which count on over activations of the device, with NaN for lost
ones. Straight *segments* of time carry positions to time. What a channel's stream becomes
depends on its own blocks and their order alone.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from impactscope.records import NANOSECONDS, Quality, SampleBlock
from impactscope.signals.resample import TAPS
from impactscope.synchronise.clock import Clock, TimeLine
from impactscope.synchronise.sample_store import SampleStore
from impactscope.synchronise.statistics import ChannelStatistics

__all__ = ['FOREVER', 'ChannelStream', 'Limits', 'Segment']

FOREVER = 1 << 62
FLOAT32 = np.dtype(np.float32)


class Limits(NamedTuple):
    """Bounds of one stream, in samples."""

    reorder: int  # a gap stays open for what comes late until this many samples follow it
    fill: int  # a longer gap is not kept as NaN: the stream begins anew after it
    keep: int  # at most this many samples are held


@dataclass(slots=True, eq=False)
class Segment:
    """Positions from ``first`` up to ``stop`` lie on one line of time."""

    first: int
    low: int  # where the uninterrupted stream that this belongs to began
    offset: int  # position minus the device's sample index
    epoch: int
    rate: float  # Hz, nominal
    line: TimeLine  # of positions
    stop: int = FOREVER
    ends: bool = False  # the stream ends at ``stop``: nothing to interpolate towards


@dataclass(slots=True)
class _Counts:
    blocks: int = 0
    samples: int = 0
    lost_samples: int = 0
    duplicates: int = 0
    late: int = 0
    out_of_order: int = 0
    missing: int = 0
    not_waited_for: int = 0
    clock_jumps: int = 0
    restarts: int = 0
    refused: int = 0
    refusal: str = ''


class ChannelStream:
    """Takes the blocks of one channel in whatever order they come.

    Args:
        name: of the channel.
        make_clock: a clock for the nominal rate in Hz.
        limits: bounds for the nominal rate in Hz.
    """

    def __init__(
        self,
        name: str,
        make_clock: Callable[[float], Clock],
        limits: Callable[[float], Limits],
    ) -> None:
        self.name = name
        self.ended = False
        self.latest: SampleBlock | None = None  # tells unit, frame and range
        self.segments: deque[Segment] = deque()
        self.store = SampleStore()
        self.counts = _Counts()
        self._make_clock = make_clock
        self._limits_for = limits
        self._limits = Limits(0, 0, 0)
        self._clock: Clock | None = None
        self._line: TimeLine | None = None  # what the clock said last
        self._gaps: deque[tuple[int, int]] = deque()  # still open for what comes late
        self._lost: deque[tuple[int, int]] = deque(maxlen=64)  # closed without
        self._stray: SampleBlock | None = None  # from far back: the first of a new beginning?
        self._previous_epoch: int | None = None

    @property
    def end(self) -> int:
        """Position after the newest sample."""
        return self.store.end

    @property
    def settled(self) -> int:
        """Samples before this position do not change any more."""
        return self._gaps[0][0] if self._gaps else self.store.end

    @property
    def newest_ns(self) -> int | None:
        """Time of the newest sample; None before the first."""
        return self.segments[-1].line.at(self.end - 1)[0] if self.segments else None

    def statistics(self, reference_ns: int | None) -> ChannelStatistics:
        """The counts so far, and how far this lags behind the time given."""
        newest = self.newest_ns
        lag = math.nan
        if newest is not None and reference_ns is not None:
            lag = (reference_ns - newest) / NANOSECONDS
        return ChannelStatistics(**dataclasses.asdict(self.counts), lag_s=lag)

    def forget(self, position: int) -> None:
        """Nothing before this position is asked for again, but by interpolation."""
        self.store.forget(position - TAPS)
        while len(self.segments) > 1 and self.segments[0].stop <= position:
            self.segments.popleft()

    def refuse(self, reason: str) -> None:
        """Count a block that is not taken, and why."""
        self.counts.refused += 1
        self.counts.refusal = reason

    def push(self, block: SampleBlock) -> None:
        """Take a block, or count why not. Raises nothing for what a device may send."""
        latest = self.latest
        if block.is_end:
            if latest is None or block.epoch == latest.epoch:
                self.close(block.first_index)
            return
        self.counts.blocks += 1
        if latest is not None and self._goes_on(block, latest):
            self._append(block, self.end)
            return
        reason = self._objection(block)
        if reason:
            self.refuse(reason)
            return
        if latest is None or self.ended or self._is_restart(block, latest):
            self._begin(block)
        elif block.epoch != latest.epoch:
            self.counts.late += 1  # a straggler of the activation before
        else:
            position = block.first_index + self.segments[-1].offset
            if position >= self.end:
                self._append(block, position)
            else:
                self._insert(block, position)

    def close(self, total: int = 0) -> None:
        """No further samples follow; ``total`` is how many the device has sent, 0 if unknown."""
        if self.segments and not self.ended:
            tail = total + self.segments[-1].offset - self.end
            if tail > 0:
                self.counts.lost_samples += tail
                self.store.flag(self.end - 1, self.end, Quality.GAP_BEFORE)
            self._end_stream()
        self.ended = True

    # -- which blocks are taken, and as what ---------------------------------------------------

    def _goes_on(self, block: SampleBlock, latest: SampleBlock) -> bool:
        """Whether this is simply the next block, as nearly all are."""
        values = block.values
        return (
            not self.ended
            and self._stray is None
            and block.epoch == latest.epoch
            and block.first_index + self.segments[-1].offset == self.store.end
            and block.sample_rate == latest.sample_rate
            and block.unit == latest.unit
            and values.dtype == FLOAT32
            and values.ndim == 1
        )

    def _objection(self, block: SampleBlock) -> str:
        values, rate, latest = block.values, block.sample_rate, self.latest
        if values.ndim != 1 or values.dtype != FLOAT32:
            return f'values are {values.dtype} of shape {values.shape}, not float32 of shape (n,)'
        if not 0 < rate <= 1e8:  # NaN too
            return f'sample rate is {rate} Hz'
        if block.first_index < 0:
            return f'first index is {block.first_index}'
        if latest is None or self.ended or block.epoch != latest.epoch:
            if block.stamp_ns <= 0:
                return 'the stamp is zero, and no stamp before it tells the time'
            return ''
        if block.unit != latest.unit:
            return f'unit is {block.unit!r}; the channel is in {latest.unit!r}'
        if rate != latest.sample_rate:
            return f'sample rate is {rate:g} Hz; the channel has {latest.sample_rate:g} Hz'
        return ''

    def _is_restart(self, block: SampleBlock, latest: SampleBlock) -> bool:
        """Whether the device has started again: another epoch, or two blocks from far back."""
        if block.epoch not in (latest.epoch, self._previous_epoch):
            return True
        stray, self._stray = self._stray, None
        if block.epoch == latest.epoch:
            behind = self.end - (block.first_index + self.segments[-1].offset + block.values.size)
            if behind < self._limits.fill:
                return False
        # One block from far back is late. If the next goes on from it, a recording was started
        # again, or a device that does not count its activations; the first of them is lost.
        self._stray = block
        return (
            stray is not None
            and stray.epoch == block.epoch
            and stray.first_index + stray.values.size == block.first_index
        )

    def _begin(self, block: SampleBlock) -> None:
        """The first block of an activation of the device."""
        if self.latest is not None:
            self.counts.restarts += 1
            self._previous_epoch = None if self.ended else self.latest.epoch
        if self.segments and not self.ended:
            self._end_stream()
        self._limits = self._limits_for(block.sample_rate)
        self._clock = self._make_clock(block.sample_rate)
        self.store.keep = self._limits.keep
        self._stray = None
        self.ended = False
        self._lost.clear()
        self._start_stream(block)

    def _insert(self, block: SampleBlock, position: int) -> None:
        """A block older than the newest: into gaps still open; what is beyond them is counted."""
        stop = position + block.values.size
        fresh = 0
        gaps: deque[tuple[int, int]] = deque()
        for begin, end in self._gaps:
            left, right = max(begin, position), min(end, stop)
            if left >= right:
                gaps.append((begin, end))
                continue
            self.store.write(block, left, left - position, right - position)
            fresh += right - left
            gaps.extend(gap for gap in ((begin, left), (right, end)) if gap[0] < gap[1])
        self._gaps = gaps
        self.counts.samples += fresh
        self.counts.out_of_order += fresh > 0
        late = max(0, min(stop, self.segments[-1].low) - position)
        late += sum(max(0, min(stop, b) - max(position, a)) for a, b in self._lost)
        self.counts.late += late > 0
        old = min(stop, self.end) - position
        self.counts.duplicates += old > fresh + late
        if stop > self.end:
            seen = self.end - position
            tail = dataclasses.replace(
                block,
                first_index=block.first_index + seen,
                values=block.values[seen:],
                stamp_ns=0,  # the clock goes on: this stamp is of a sample already placed
            )
            self._append(tail, self.end)

    # -- the stream as it grows ----------------------------------------------------------------

    def _append(self, block: SampleBlock, position: int) -> None:
        lost = position - self.end
        if lost > self._limits.fill:
            self.counts.lost_samples += lost
            self._end_stream()
            self.store.flag(self.end + TAPS, self.end + TAPS + 1, Quality.GAP_BEFORE)
            self._start_stream(block)
            return
        if lost:
            self._gaps.append((self.end, position))
            self.store.extend_missing(lost)
        last = self.segments[-1]
        self._place(block, last.low, last.offset)
        self._append_values(block)

    def _start_stream(self, block: SampleBlock) -> None:
        """Leave enough NaN behind that nothing is interpolated across, and begin."""
        if self.segments:
            self.store.extend_missing(TAPS)
        self._place(block, self.end, self.end - block.first_index)
        self._append_values(block)

    def _end_stream(self) -> None:
        while self._gaps:
            self._close_gap()
        last = self.segments[-1]
        last.stop = self.end
        last.ends = True

    def _place(self, block: SampleBlock, low: int, offset: int) -> None:
        """Ask the clock; begin a segment where it says something new."""
        assert self._clock is not None  # noqa: S101 - made with the first block
        reading = self._clock.observe(block)
        assert reading is not None  # noqa: S101 - the first block of an activation has a stamp
        line = reading.line
        if reading.jumped:
            self.counts.clock_jumps += 1
            self.store.flag(self.end, self.end + 1, Quality.CLOCK_JUMP)
        last = self.segments[-1] if self.segments else None
        if last is not None and not last.ends:
            if line is self._line:
                return
            last.stop = self.end
        self._line = line
        line = TimeLine(line.index + offset, line.time_ns, line.fraction, line.period_ns)
        # A line may begin before the segment: after a gap too long to keep.
        line = line if line.index == self.end else line.continued(self.end, line.period_ns)
        self.segments.append(Segment(self.end, low, offset, block.epoch, block.sample_rate, line))

    def _append_values(self, block: SampleBlock) -> None:
        size = block.values.size
        self.store.extend(size)
        self.store.write(block, self.end - size, 0, size)
        self.counts.samples += size
        self.latest = block
        while self._gaps and self.end - self._gaps[0][1] >= self._limits.reorder:
            self._close_gap()
        while len(self.segments) > 1 and self.segments[0].stop <= self.store.start:
            self.segments.popleft()

    def _close_gap(self) -> None:
        begin, end = self._gaps.popleft()
        self.counts.lost_samples += end - begin
        self._lost.append((begin, end))
        self.store.flag(begin, end + 1, Quality.GAP_BEFORE)
