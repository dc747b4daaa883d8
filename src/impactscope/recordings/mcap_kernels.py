"""Compiled walks over the records of an MCAP file.

Layout by the MCAP specification, version 0: a record is one byte of opcode, eight bytes of
length (little endian) and the content. No length is believed beyond the bytes at hand.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    'BAD',
    'CHUNK',
    'FULL',
    'MESSAGE',
    'count_records',
    'find_chunk',
    'index_records',
    'scan_records',
]

MESSAGE, CHUNK = 5, 6
GROUP = 1 << 20  # bytes of consecutive unchunked messages that are read at once
END, FULL, BAD = 0, 1, 2


@njit(cache=True, inline='always')  # type: ignore[untyped-decorator]
def _unsigned(octets: NDArray[np.uint8], at: int, size: int) -> int:
    """Little-endian integer; a value of 2**63 or more comes out negative."""
    value = np.int64(0)
    for i in range(size):
        value |= np.int64(octets[at + i]) << np.int64(8 * i)
    return int(value)


@njit(cache=True)  # type: ignore[untyped-decorator]
def scan_records(
    octets: NDArray[np.uint8],
    start: int,
    stop: int,
    opcodes: NDArray[np.uint8],
    offsets: NDArray[np.int64],
    lengths: NDArray[np.int64],
    starts: NDArray[np.int64],
) -> tuple[int, int, int]:
    """Hop over top-level records; fill opcode, offset of the record, and content length.

    Consecutive messages become one entry, whose length counts their headers too and whose
    start is their earliest log time (0 for other records). Returns (entries, position, state):
    END at ``stop``, FULL where the arrays are, BAD at a record that cannot be one.
    """
    count = 0
    position = start
    grouped = False
    while position < stop:
        if stop - position < 9:
            return count, position, BAD
        opcode = octets[position]
        length = _unsigned(octets, position + 1, 8)
        known = 0 < opcode <= 15 or opcode >= 128
        if not known or length < 0 or length > stop - position - 9:
            return count, position, BAD
        log_ns = np.int64(0)
        if opcode == MESSAGE:
            if length < 22:
                return count, position, BAD
            log_ns = _unsigned(octets, position + 15, 8)
            if log_ns < 0:
                return count, position, BAD
        if opcode == MESSAGE and grouped and lengths[count - 1] < GROUP:
            lengths[count - 1] += 9 + length
            starts[count - 1] = min(starts[count - 1], log_ns)
        else:
            if count == len(opcodes):
                return count, position, FULL
            opcodes[count] = opcode
            offsets[count] = position
            grouped = opcode == MESSAGE
            lengths[count] = 9 + length if grouped else length
            starts[count] = log_ns
            count += 1
        position += 9 + length
    return count, position, END


@njit(cache=True)  # type: ignore[untyped-decorator]
def find_chunk(octets: NDArray[np.uint8], start: int, stop: int) -> int:
    """First place from ``start`` that carries a chunk whose two lengths agree, or -1."""
    for position in range(start, stop - 49):
        if octets[position] != CHUNK:
            continue
        length = _unsigned(octets, position + 1, 8)
        if length < 40 or length > stop - position - 9:
            continue
        name = _unsigned(octets, position + 37, 4)
        if name not in (0, 3, 4) or length < 40 + name:
            continue
        if _unsigned(octets, position + 41 + name, 8) == length - 40 - name:
            return position
    return -1


@njit(cache=True)  # type: ignore[untyped-decorator]
def count_records(octets: NDArray[np.uint8], start: int, stop: int) -> tuple[int, int, int]:
    """Messages, other records, and where the walk ended (``stop`` where all is sound)."""
    messages = 0
    others = 0
    position = start
    while stop - position >= 9:
        length = _unsigned(octets, position + 1, 8)
        if length < 0 or length > stop - position - 9:
            break
        if octets[position] == MESSAGE:
            if length < 22 or _unsigned(octets, position + 15, 8) < 0:
                break
            messages += 1
        elif octets[position] == 0:
            break
        else:
            others += 1
        position += 9 + length
    return messages, others, position


@njit(cache=True)  # type: ignore[untyped-decorator]
def index_records(
    octets: NDArray[np.uint8],
    start: int,
    stop: int,
    channel: NDArray[np.int64],
    log_ns: NDArray[np.int64],
    publish_ns: NDArray[np.int64],
    offset: NDArray[np.int64],
    length: NDArray[np.int64],
    others: NDArray[np.int64],
) -> None:
    """Fill the index of a range that ``count_records`` has walked; arrays of those lengths."""
    m = 0
    o = 0
    position = start
    while position < stop:
        size = _unsigned(octets, position + 1, 8)
        if octets[position] == MESSAGE:
            channel[m] = _unsigned(octets, position + 9, 2)
            log_ns[m] = _unsigned(octets, position + 15, 8)
            publish_ns[m] = _unsigned(octets, position + 23, 8)
            offset[m] = position + 31
            length[m] = size - 22
            m += 1
        else:
            others[o] = position
            o += 1
        position += 9 + size
