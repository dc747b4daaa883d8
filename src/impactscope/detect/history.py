"""The latest stretch of a stream, all channels, addressed by grid index."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from impactscope.records import NANOSECONDS, Quality

__all__ = ['History']


class History:
    """Keeps what was appended from the index last given to :meth:`drop_before` on.

    Args:
        n_channels: rows.
        rate: Hz, of the grid.
        first_index: grid index of the first column to come.
    """

    def __init__(self, n_channels: int, rate: float, first_index: int) -> None:
        self.rate = rate
        self.values = np.empty((n_channels, 4096), dtype=np.float32)
        self.first = first_index  # grid index of column 0
        self.stop = first_index  # one beyond the newest
        self._kept = first_index
        self._flags: deque[tuple[int, int, tuple[Quality, ...]]] = deque()  # start, stop
        self._stamps: deque[tuple[int, int]] = deque()  # index, ns: the timeline from there on

    def append(self, values: NDArray[np.float32], flags: tuple[Quality, ...]) -> None:
        """Add columns; ``values`` has shape (n_channels, n)."""
        n = values.shape[1]
        end = self.stop - self.first + n
        if end > self.values.shape[1]:
            self._make_room(n)
            end = self.stop - self.first + n
        self.values[:, end - n : end] = values
        self.stop += n
        if any(flags):
            self._flags.append((self.stop - n, self.stop, flags))

    def _make_room(self, n: int) -> None:
        kept = self.values[:, self._kept - self.first : self.stop - self.first]
        needed = kept.shape[1] + n
        capacity = self.values.shape[1]
        # Copied at most once for each column that passes: room for as much again as is kept.
        if 2 * needed > capacity or 16 * needed < capacity:
            values = np.empty((self.values.shape[0], max(4096, 4 * needed)), dtype=np.float32)
            values[:, : kept.shape[1]] = kept
            self.values = values
        else:
            self.values[:, : kept.shape[1]] = kept
        self.first = self._kept

    def drop_before(self, index: int) -> None:
        """What lies before the index is needed no more."""
        self._kept = max(self._kept, min(index, self.stop))
        while self._flags and self._flags[0][1] <= self._kept:
            self._flags.popleft()
        while len(self._stamps) > 1 and self._stamps[1][0] <= self._kept:
            self._stamps.popleft()

    @property
    def kept(self) -> int:
        """Lowest index that can still be read."""
        return self._kept

    def column(self, index: int) -> int:
        """Column of a grid index in ``values``."""
        return index - self.first

    def view(self, start: int, stop: int) -> NDArray[np.float32]:
        """Columns from ``start`` to ``stop``, shape (n_channels, stop - start); not a copy."""
        return self.values[:, start - self.first : stop - self.first]

    def flags(self, start: int, stop: int) -> tuple[Quality, ...]:
        """Flags per channel of every block that overlaps the columns ``start`` to ``stop``."""
        collected = [Quality.NONE] * self.values.shape[0]
        for first, end, flags in self._flags:
            if first < stop and end > start:
                collected = [a | b for a, b in zip(collected, flags, strict=True)]
        return tuple(collected)

    def anchor(self, index: int, stamp_ns: int) -> None:
        """Say that a grid index has this time; holds until the next anchor."""
        self._stamps.append((index, stamp_ns))

    def stamp(self, index: int) -> int:
        """Time of a grid index in ns."""
        origin, stamp_ns = self._stamps[0]
        for candidate in self._stamps:
            if candidate[0] > index:
                break
            origin, stamp_ns = candidate
        return stamp_ns + round((index - origin) * NANOSECONDS / self.rate)
