"""A batch of recorded messages: one buffer, and where in it each message lies."""

from __future__ import annotations

import heapq
import mmap
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ['Damage', 'MessageBatch', 'PendingBatch', 'in_time_order']

Int64Array = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Damage:
    """A place at which a recording could not be read, and what was lost there."""

    file: str
    offset: int  # bytes from the beginning of the file
    reason: str

    def __str__(self) -> str:
        return f'{self.file}: at byte {self.offset} {self.reason}'


@dataclass(frozen=True, slots=True, eq=False)
class MessageBatch:
    """Serialised messages; every array has shape (n_messages,) and one entry a message."""

    buffer: bytes | mmap.mmap
    octets: NDArray[np.uint8]  # the same memory
    connection: Int64Array  # index of the message's connection within its file
    log_ns: Int64Array
    publish_ns: Int64Array
    offset: Int64Array  # of the serialised message in the buffer
    length: Int64Array  # of the serialised message, bytes
    origin: int  # byte of the file at which the batch lies, for messages about damage

    def __len__(self) -> int:
        return len(self.log_ns)

    def take(self, rows: NDArray[np.bool_] | Int64Array) -> MessageBatch:
        """The same buffer with some of its messages."""
        return MessageBatch(
            self.buffer,
            self.octets,
            self.connection[rows],
            self.log_ns[rows],
            self.publish_ns[rows],
            self.offset[rows],
            self.length[rows],
            self.origin,
        )


@dataclass(frozen=True, slots=True)
class PendingBatch:
    """A batch that has not been read yet, and the earliest log time it states."""

    start_ns: int
    load: Callable[[], MessageBatch]


def in_time_order(pending: Iterable[PendingBatch]) -> Iterator[list[MessageBatch]]:
    """Load batches by stated start, and release messages once nothing earlier can come.

    Each list holds parts of batches that overlap in time; log times never run backwards from
    one list to the next. As many batches are held as overlap: one, for most recordings.
    """
    queue = [(batch.start_ns, order, batch) for order, batch in enumerate(pending)]
    heapq.heapify(queue)
    held: list[MessageBatch] = []
    while queue:
        batch = heapq.heappop(queue)[2].load()
        if len(batch):
            held.append(batch)
        if not queue:
            break
        horizon = queue[0][0]
        ready: list[MessageBatch] = []
        later: list[MessageBatch] = []
        for batch in held:
            due = batch.log_ns <= horizon
            if due.all():
                ready.append(batch)
            elif not due.any():
                later.append(batch)
            else:
                ready.append(batch.take(due))
                later.append(batch.take(~due))
        held = later
        if ready:
            yield ready
    if held:
        yield held
