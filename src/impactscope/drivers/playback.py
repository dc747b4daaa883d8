"""A source that plays a sequence of blocks: a recording, or a bench simulated beforehand."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from impactscope.drivers.pace import Pace
from impactscope.records import NANOSECONDS, SampleBlock, TestPoint

__all__ = ['Playback']

Item = SampleBlock | TestPoint


def end_ns(block: SampleBlock) -> int:
    """Time at which a block is complete."""
    return block.stamp_ns + round(block.values.size / block.sample_rate * NANOSECONDS)


class Playback:
    """Plays blocks at their pace; implements :class:`~impactscope.drivers.source.Source`.

    Args:
        items: makes the sequence afresh, in order of time.
        wanted: whether this driver plays a channel; the others belong to another driver.
        pace: when a block is due; made at ``open`` from the time of the first item.
        restamp: shift all stamps so that the first item is at the pace's wall start (a simulated
            device is alive now), else keep them as recorded.
        add_end: a recording that stops without an end marker gets one for each channel.
    """

    def __init__(
        self,
        items: Callable[[], Iterable[Item]],
        wanted: Callable[[str], bool],
        pace: Callable[[int], Pace],
        *,
        restamp_to_ns: int | None = None,
        add_end: bool = True,
    ) -> None:
        self._items = items
        self._wanted = wanted
        self._make_pace = pace
        self._restamp_to_ns = restamp_to_ns
        self._add_end = add_end
        self._iterator: Iterator[Item] | None = None
        self._pending: Item | None = None
        self._last: dict[str, SampleBlock] = {}
        self._ended: set[str] = set()
        self._behind: dict[str, int] = {}
        self._base_index: dict[str, int] = {}
        self._shift_ns = 0
        self._epoch = 0
        self.pace: Pace | None = None
        self.ended = False
        self.test_points: list[
            TestPoint
        ] = []  # those that have become due, for the driver to take

    def open(self, epoch: int) -> None:
        """Go to the beginning; opened again, go on behind what was played, in a new epoch."""
        self._iterator = iter(self._items())
        self._pending = next(self._iterator, None)
        self._behind = {name: end_ns(block) for name, block in self._last.items()}
        self._base_index.clear()
        self._epoch = epoch
        self.ended = False
        if self._pending is None:
            self.ended = True
            return
        first = self._pending
        start_ns = first.start_ns if isinstance(first, TestPoint) else first.stamp_ns
        self._shift_ns = 0 if self._restamp_to_ns is None else self._restamp_to_ns - start_ns
        if self.pace is None:
            self.pace = self._make_pace(start_ns + self._shift_ns)

    def close(self) -> None:
        """Let go of the sequence."""
        self._iterator = None
        self._pending = None

    def read(self, timeout: float) -> list[SampleBlock]:
        """The next blocks that are due within ``timeout`` s; see ``Source``."""
        deadline = time.monotonic() + timeout
        blocks: list[SampleBlock] = []
        while self._pending is not None and self.pace is not None and not blocks:
            item = self._pending
            due_ns = _due_ns(item)
            remaining = max(deadline - time.monotonic(), 0.0)
            if not self.pace.wait(due_ns + self._shift_ns, remaining):
                return blocks
            self._advance()
            if isinstance(item, TestPoint):
                self.test_points.append(self._shifted(item))
            elif self._wanted(item.channel):
                blocks.extend(self._play(item))
        if self._pending is None and not self.ended and not blocks:
            self.ended = True
            return self._end_markers() if self._add_end else []
        if self.ended:
            time.sleep(timeout)
        return blocks

    def _advance(self) -> None:
        assert self._iterator is not None  # noqa: S101 - open() has been called
        self._pending = next(self._iterator, None)

    def _shifted(self, point: TestPoint) -> TestPoint:
        return dataclasses.replace(
            point,
            start_ns=point.start_ns + self._shift_ns if point.start_ns else 0,
            end_ns=point.end_ns + self._shift_ns if point.end_ns else 0,
        )

    def _play(self, block: SampleBlock) -> list[SampleBlock]:
        changes: dict[str, Any] = {}
        if self._restamp_to_ns is not None:
            changes['stamp_ns'] = block.stamp_ns + self._shift_ns
            changes['received_ns'] = time.time_ns()
        if self._epoch:
            if block.stamp_ns + self._shift_ns < self._behind.get(block.channel, 0):
                return []
            base = self._base_index.setdefault(block.channel, block.first_index)
            changes['first_index'] = block.first_index - base
            changes['epoch'] = block.epoch + self._epoch
        if changes:
            block = dataclasses.replace(block, **changes)
        self._last[block.channel] = block
        if block.is_end:
            self._ended.add(block.channel)
        return [block]

    def _end_markers(self) -> list[SampleBlock]:
        return [end_marker(block) for name, block in self._last.items() if name not in self._ended]


def _due_ns(item: Item) -> int:
    if isinstance(item, TestPoint):
        return item.end_ns or item.start_ns
    return end_ns(item)


def end_marker(last: SampleBlock) -> SampleBlock:
    """The block without values that says: nothing follows the given one in its epoch."""
    return dataclasses.replace(
        last,
        stamp_ns=end_ns(last),
        first_index=last.first_index + last.values.size,
        device_time_ns=-1,
        values=last.values[:0],
        quality=type(last.quality)(0),
    )
