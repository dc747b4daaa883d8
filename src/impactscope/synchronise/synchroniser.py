"""All channels of a bench on one grid, locked to the samples of a reference channel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError
from impactscope.records import Channel, Quality, SampleBlock, SyncedBlock
from impactscope.synchronise.channel_stream import FOREVER, ChannelStream, Limits, Segment
from impactscope.synchronise.clock import Clock, StampClock, TimeLine
from impactscope.synchronise.grid_view import GridView
from impactscope.synchronise.statistics import ChannelStatistics

__all__ = ['Synchroniser', 'SynchroniserSettings']

LARGEST_BLOCK = 240_000  # bytes of values; larger messages are ten times slower to deliver
MOST_SAMPLES = 4_000_000  # held of a channel, whatever its rate
LONGEST_SLIVER = 0.004  # s
RATE_TOLERANCE = 1e-6  # relative; rates closer than this are the same


@dataclass(frozen=True, slots=True)
class SynchroniserSettings:
    """What to put on the grid, and how long to wait for it; times in s of data.

    Raises ConfigurationError on construction where a value is out of its range.
    """

    channels: tuple[str, ...]  # expected; blocks of others are counted and ignored
    reference: str = ''  # whose samples the grid is locked to; '' means the first channel
    grid_rate: float = 0.0  # Hz, at least; 0 means at least the fastest channel
    longest_wait: float = 2.0  # for a channel that lags behind the reference
    reorder_wait: float = 0.25  # a gap is kept open this long for a block that comes late
    clock_tolerance: float = 0.0  # 0 means one sample period, but at least 100 us
    clock_jump: float = 0.02
    clock_slew: float = 500e-6  # s per s

    def __post_init__(self) -> None:
        if not self.channels or len(set(self.channels)) != len(self.channels):
            raise ConfigurationError(
                f'synchroniser: channels are {self.channels!r}; '
                'at least one is needed, and each name once'
            )
        if self.reference and self.reference not in self.channels:
            raise ConfigurationError(
                f'synchroniser: reference {self.reference!r} is not among the channels '
                f'{", ".join(self.channels)}'
            )
        for name in (
            'grid_rate', 'longest_wait', 'reorder_wait',
            'clock_tolerance', 'clock_jump', 'clock_slew',
        ):  # fmt: skip
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ConfigurationError(
                    f'synchroniser: {name} is {value!r}; it must be a finite number, zero or more'
                )
        if self.longest_wait == 0:
            raise ConfigurationError('synchroniser: longest_wait is 0 s; it must be above zero')

    @property
    def ordered(self) -> tuple[str, ...]:
        """The channels as they stand on the grid: the reference first."""
        first = self.reference or self.channels[0]
        return (first, *(name for name in self.channels if name != first))


class Synchroniser:
    """Stage from blocks of samples to synchronised blocks.

    The grid's rate is the reference channel's times a whole number, at least that of the
    fastest channel, fixed once every expected channel has been seen or ``longest_wait`` of the
    reference has passed. The reference's own samples stand on it untouched, and so does a
    channel whose samples fall on the same instants; everything else is interpolated by
    `impactscope.signals.resample`.

    A stretch of the grid comes out as soon as every channel covers it with all that the
    interpolation reaches for, or has ended, or lags by more than ``longest_wait`` (NaN, flagged
    MISSING). Until a channel lags that long, the grid depends neither on how the blocks of
    different channels interleave nor on how streams without loss were cut into blocks, to the
    last bit. Lost samples are NaN, as is what would have to be interpolated across them. At
    the ends of a stream the taps that exist are used: nothing is lost there.

    A new epoch of the reference begins a new grid; one of another channel is placed by its
    stamps. Blocks that contradict their channel are counted and refused: see ``statistics``.
    """

    def __init__(self, settings: SynchroniserSettings) -> None:
        self.settings = settings
        self._unknown: dict[str, int] = {}
        self._names = settings.ordered
        self._streams = {name: self._make_stream(name) for name in self._names}
        self._start_afresh()

    def _make_stream(self, name: str) -> ChannelStream:
        return ChannelStream(name, self._make_clock, self._limits)

    def _start_afresh(self) -> None:
        for name, stream in self._streams.items():
            fresh = self._make_stream(name)
            fresh.counts = stream.counts
            self._streams[name] = fresh
        self._views = [GridView(stream) for stream in self._streams.values()]
        self._reference = self._streams[self._names[0]]
        self._segment: Segment | None = None  # of the reference, on which the grid goes on
        self._grid = TimeLine(0, 0, 0.0, 1.0)  # of grid indices, while on this segment
        self._patience = 0  # samples of the reference that wait for a channel that lags
        self._next = 0  # grid index, position of the reference times oversampling
        self._oversampling = 1
        self._grid_rate = 0.0  # 0 until it is fixed
        self._waiting_for: ChannelStream | None = None  # without it the grid does not go on
        self._pushed: ChannelStream | None = None
        self._closed = True  # no block has come out since the last end marker
        self._described: dict[str, tuple[tuple[object, ...], Channel]] = {}

    def _make_clock(self, rate: float) -> Clock:
        s = self.settings
        return StampClock(rate, s.clock_tolerance, s.clock_jump, s.clock_slew)

    def _limits(self, rate: float) -> Limits:
        wait = self.settings.longest_wait * rate
        return Limits(
            reorder=math.ceil(min(self.settings.reorder_wait * rate, wait, MOST_SAMPLES / 4)),
            fill=math.ceil(min(wait, MOST_SAMPLES / 4)),
            keep=math.ceil(min(max(4 * wait, 65_536), MOST_SAMPLES)),
        )

    @property
    def statistics(self) -> dict[str, ChannelStatistics]:
        """Counts per expected channel."""
        newest = self._reference.newest_ns
        return {name: stream.statistics(newest) for name, stream in self._streams.items()}

    @property
    def unknown_channels(self) -> dict[str, int]:
        """Blocks received per channel that is not expected; the first 64 such names."""
        return dict(self._unknown)

    def push(self, record: SampleBlock) -> list[SyncedBlock]:
        """Take a block of any channel; return what of the grid is complete with it."""
        stream = self._streams.get(record.channel)
        if stream is None:
            if record.channel in self._unknown or len(self._unknown) < 64:
                self._unknown[record.channel] = self._unknown.get(record.channel, 0) + 1
            return []
        if stream is not self._reference and self._too_fast(stream, record):
            return []
        stream.push(record)
        self._pushed = stream
        waiting = self._waiting_for
        if (
            waiting is None
            or stream is waiting
            or (stream is self._reference and self._overdue() > self._next)
        ):
            return self._emit()
        return []

    def flush(self) -> list[SyncedBlock]:
        """End all streams as if each had sent its end marker, and start afresh."""
        for stream in self._streams.values():
            stream.close()
        blocks = self._emit()
        self._start_afresh()
        return blocks

    def _too_fast(self, stream: ChannelStream, block: SampleBlock) -> bool:
        """Refuse a channel that came after the grid was fixed and would alias on it."""
        limit = self._grid_rate * (1 + RATE_TOLERANCE)
        if not 0 < limit < block.sample_rate or block.is_end:
            return False
        stream.counts.blocks += 1
        stream.refuse(
            f'sample rate is {block.sample_rate:g} Hz; the grid was fixed at '
            f'{self._grid_rate:g} Hz before this channel came (set grid_rate)'
        )
        return True

    # -- the grid ------------------------------------------------------------------------------

    def _emit(self) -> list[SyncedBlock]:
        blocks: list[SyncedBlock] = []
        self._waiting_for = None
        while self._find_segment(blocks):
            limit = self._limit()
            if limit > self._next:
                self._emit_until(limit, blocks)
            if self._is_waiting():
                return blocks
        if self._reference.ended and not self._closed and self._at_end():
            blocks.append(self._end_marker())
            self._grid_rate = 0.0
        return blocks

    def _is_waiting(self) -> bool:
        return self._waiting_for is not None

    def _at_end(self) -> bool:
        newest = self._reference.segments[-1]
        return self._segment is newest and self._next >= self._stop(newest)

    def _find_segment(self, blocks: list[SyncedBlock]) -> bool:
        """Go to the segment of the reference that the next grid sample lies on, if any."""
        current = self._segment
        if current is not None and self._next < self._stop(current):
            return True
        for segment in self._reference.segments:
            if current is not None and segment.first <= current.first:
                continue
            if current is None or segment.low != current.low:
                if not self._fix_grid(segment):
                    return False
                if not self._closed and self._starts_over(segment):
                    blocks.append(self._end_marker())
            line, ratio = segment.line, self._oversampling
            self._grid = TimeLine(
                line.index * ratio, line.time_ns, line.fraction, line.period_ns / ratio
            )
            self._segment = segment
            self._next = segment.first * ratio
            return True
        return False

    def _stop(self, segment: Segment) -> int:
        """Grid index after the last one on a segment."""
        if segment.stop == FOREVER:
            return FOREVER
        if segment.ends:  # nothing to interpolate towards after the last sample
            return (segment.stop - 1) * self._oversampling + 1
        return segment.stop * self._oversampling

    def _starts_over(self, segment: Segment) -> bool:
        """Whether indices start anew although the epoch does not say so."""
        before = self._segment
        if before is None or segment.epoch != before.epoch:
            return False
        return segment.first - segment.offset < before.stop - before.offset

    def _fix_grid(self, segment: Segment) -> bool:
        """Choose the grid's rate for a stream of the reference, once it can be known."""
        self._patience = math.ceil(
            min(self.settings.longest_wait * segment.rate, MOST_SAMPLES / 2)
        )
        streams = self._streams.values()
        unseen = any(s.latest is None and not s.ended for s in streams)
        if unseen and self._reference.end - segment.first <= self._patience:
            return False
        rates = [s.latest.sample_rate for s in streams if s.latest is not None]
        fastest = max(self.settings.grid_rate, segment.rate, *rates)
        self._oversampling = math.ceil(fastest / segment.rate * (1 - RATE_TOLERANCE))
        self._grid_rate = segment.rate * self._oversampling
        return True

    def _overdue(self) -> int:
        """Grid index up to which has been waited for long enough."""
        return (self._reference.end - self._patience) * self._oversampling

    def _limit(self) -> int:
        """Grid index up to which to go now; notes on which channel it depends to go further."""
        segment, newest = self._segment, self._reference.latest
        assert segment is not None  # noqa: S101 - a segment was found
        assert newest is not None  # noqa: S101
        grid, index, stop = self._grid, self._next, self._stop(segment)
        end = self._views[0].reach(grid, segment)
        covered = [end, *(view.covered(grid, index) for view in self._views[1:])]
        # Channels that come together cover the grid to within a sample of each other; without
        # a least length, every other block would hold that one sample.
        few = min(newest.values.size / 4, LONGEST_SLIVER * segment.rate) * self._oversampling
        least = max(1, math.floor(few))
        limit = min(covered)
        if limit < min(index + least, stop):
            limit = index
        waited = min(self._overdue(), end)
        if waited > limit:
            for view, last in zip(self._views, covered, strict=True):
                view.stream.counts.not_waited_for += max(0, waited - max(last, limit))
            limit = waited
        enough = min(limit + least, stop)
        lacking = [v.stream for v, c in zip(self._views, covered, strict=True) if c < enough]
        # Whichever came last will most often come last again.
        came_last = self._pushed if limit > index and self._pushed in lacking else None
        self._waiting_for = came_last or (lacking[-1] if lacking else None)
        return limit

    def _emit_until(self, limit: int, blocks: list[SyncedBlock]) -> None:
        most = max(1, LARGEST_BLOCK // (4 * len(self._views)))
        while self._next < limit:
            index = self._next
            values = np.empty((len(self._views), min(limit - index, most)), dtype=np.float32)
            channels = tuple(
                self._describe(view.stream, view.fill(self._grid, index, row))
                for view, row in zip(self._views, values, strict=True)
            )
            blocks.append(self._block(channels, values))
            self._next = index + values.shape[1]
            self._closed = False

    def _block(self, channels: tuple[Channel, ...], values: NDArray[np.float32]) -> SyncedBlock:
        segment = self._segment
        assert segment is not None  # noqa: S101 - a segment was found
        whole, fraction = self._grid.at(self._next)
        return SyncedBlock(
            stamp_ns=whole + (fraction >= 0.5),
            sample_rate=self._grid_rate,
            epoch=segment.epoch,
            first_index=self._next - segment.offset * self._oversampling,
            channels=channels,
            values=values,
            oversampling=self._oversampling,
        )

    def _end_marker(self) -> SyncedBlock:
        """A block without samples, of the stream that has come to its end."""
        self._closed = True
        channels = tuple(self._describe(s, Quality.NONE) for s in self._streams.values())
        return self._block(channels, np.empty((len(channels), 0), dtype=np.float32))

    def _describe(self, stream: ChannelStream, flags: Quality) -> Channel:
        block = stream.latest
        if block is None:
            return Channel(stream.name, '', quality=flags)
        key = (
            block.unit, block.frame_id, block.sample_rate,
            block.range_min, block.range_max, flags,
        )  # fmt: skip
        known = self._described.get(stream.name)
        if known is not None and known[0] == key:
            return known[1]
        channel = Channel(stream.name, *key)
        self._described[stream.name] = (key, channel)
        return channel
