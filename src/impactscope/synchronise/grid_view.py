"""A channel's stream as seen from the grid: how far it reaches, and its values there."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from impactscope.records import Quality
from impactscope.signals.resample import HALF_TAPS, SINC_TABLE, resample_line
from impactscope.synchronise.channel_stream import FOREVER, ChannelStream, Segment
from impactscope.synchronise.clock import TimeLine

__all__ = ['GridView']

DISCONTINUITY = Quality.CLOCK_JUMP | Quality.GAP_BEFORE
SNAP_NS = 1.0  # stamps are whole nanoseconds: closer than this is the same instant


class GridView:
    """Fills one row of the grid from a channel's stream, forwards only.

    The grid is a `TimeLine` of grid indices. It may be exchanged for another; time then goes
    on, or is set back together with the channel's.
    """

    def __init__(self, stream: ChannelStream) -> None:
        self.stream = stream
        self._used = 0  # position up to which samples have been used
        self._mapped: tuple[TimeLine | None, Segment | None] = (None, None)
        self._map = (0.0, 1.0, 0.0, False)
        self._sure = (0, 0)  # grid indices known to lie on the newest segment

    def covered(self, grid: TimeLine, index: int) -> int:
        """Grid samples from ``index`` up to this one can be filled for good."""
        stream = self.stream
        self._sure = (0, 0)
        if stream.ended:
            return FOREVER
        for segment in stream.segments:
            start, stop = self._span(grid, segment)
            if segment.stop == FOREVER:
                if index < start and self._used > segment.first:
                    return index  # the grid's time was set back: wait whether this one's is, too
                self._sure = (start, stop)
                return max(index, stop) if stop > start else index
            if start <= index:
                index = max(index, stop)
        return index

    def reach(self, grid: TimeLine, segment: Segment) -> int:
        """As ``covered`` for the channel that the grid is locked to, on one of its segments."""
        start, stop = self._span(grid, segment)
        self._sure = (start, stop) if segment is self.stream.segments[-1] else (0, 0)
        return stop

    def _span(self, grid: TimeLine, segment: Segment) -> tuple[int, int]:
        """First grid index on a segment, and the one after the last that is known for good."""
        origin, step, snap, same_instants = self._onto(grid, segment)
        first = segment.first
        begin = self._used - first if self._used > first else 0
        if segment.ends:  # up to its last sample, with the taps there are
            stop = math.floor((segment.stop - 1 - first + snap - origin) / step) + 1
        else:
            known = self.stream.settled
            last = self.stream.segments[-1]
            if not (same_instants or last.ends or last.low != segment.low):
                known -= HALF_TAPS  # interpolation reaches this far ahead while samples follow
            if known > segment.stop:
                known = segment.stop
            stop = math.ceil((known - first - snap - origin) / step)
        return grid.index + math.ceil((begin - snap - origin) / step), grid.index + stop

    def fill(self, grid: TimeLine, begin: int, out: NDArray[np.float32]) -> Quality:
        """Grid samples from ``begin`` on into a row of shape (n_samples,); their flags."""
        sure = self._sure
        if sure[0] <= begin and begin + out.size <= sure[1]:
            return self._fill_from(self.stream.segments[-1], grid, begin, out)
        flags = Quality.NONE
        for first, last, segment in self._pieces(grid, begin, begin + out.size):
            part = out[first - begin : last - begin]
            if segment is None:
                part[:] = np.nan
                self.stream.counts.missing += part.size
                flags |= Quality.MISSING
            else:
                flags |= self._fill_from(segment, grid, first, part)
        return flags

    def _onto(self, grid: TimeLine, segment: Segment) -> tuple[float, float, float, bool]:
        """Origin and step of the grid in samples after ``segment.first``, what counts as the
        same instant, and whether every grid sample is at the instant of one of the channel's.
        """
        mapped = self._mapped
        if mapped[0] is not grid or mapped[1] is not segment:
            line = segment.line
            apart = (grid.time_ns - line.time_ns) + (grid.fraction - line.fraction)
            origin = apart / line.period_ns
            step = grid.period_ns / line.period_ns
            snap = SNAP_NS / line.period_ns
            same = step == 1.0 and abs(origin - round(origin)) <= snap
            self._mapped = (grid, segment)
            self._map = (origin, step, snap, same)
        return self._map

    def _pieces(
        self, grid: TimeLine, begin: int, end: int
    ) -> Iterator[tuple[int, int, Segment | None]]:
        """Cut grid indices into those on one segment each; None where there is none."""
        while begin < end:
            until = end
            for segment in tuple(self.stream.segments):
                start, stop = self._span(grid, segment)
                if segment.stop == FOREVER and start <= begin and not self._beyond(grid, begin):
                    stop = end  # with the taps there are: it has been waited for long enough
                if start <= begin < stop:
                    begin, first = min(stop, end), begin
                    yield first, begin, segment
                    break
                if begin < start:
                    until = min(until, start)
            else:
                yield begin, until, None
                begin = until

    def _beyond(self, grid: TimeLine, index: int) -> bool:
        """Whether a grid sample lies after the newest sample."""
        segment = self.stream.segments[-1]
        origin, step, snap, _ = self._onto(grid, segment)
        place = origin + (index - grid.index) * step
        return place > self.stream.end - 1 - segment.first + snap

    def _fill_from(
        self, segment: Segment, grid: TimeLine, index: int, out: NDArray[np.float32]
    ) -> Quality:
        origin, step, snap, same_instants = self._onto(grid, segment)
        stream, store = self.stream, self.stream.store
        ahead = index - grid.index
        low, high = max(segment.low, store.start), stream.end
        if segment is not stream.segments[-1] or segment.ends:
            ends = (s.stop for s in stream.segments if s.ends and s.low == segment.low)
            high = next(ends, high)
        resample_line(
            store.samples,
            low - store.start,
            high - store.start,
            segment.first - store.start,
            origin,
            step,
            ahead,
            snap,
            SINC_TABLE,
            out,
        )
        last = origin + (ahead + out.size - 1) * step
        lowest = segment.first + math.floor(origin + ahead * step + snap)
        highest = segment.first + math.ceil(last - snap)
        flags = Quality.NONE
        if store.has_flags:
            reach = 0 if same_instants else HALF_TAPS
            flags = store.flags(lowest - reach, highest + reach + 1)
            # Samples that no grid sample asked for may hold the cause.
            flags |= store.flags(self._used, lowest) & DISCONTINUITY
        if highest >= high or lowest < low:  # forced out too early; asked for too late
            known = math.floor((high - 1 - segment.first + snap - origin) / step) + 1 - ahead
            gone = math.ceil((low - segment.first - snap - origin) / step) - ahead
            absent = max(0, out.size - max(0, known)) + max(0, min(gone, out.size))
            stream.counts.missing += absent
            flags |= Quality.MISSING if absent else Quality.NONE
        self._used = max(self._used, segment.first + math.floor(last))
        stream.forget(self._used)
        return flags
