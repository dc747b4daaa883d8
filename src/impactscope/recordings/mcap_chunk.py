"""Chunks of an MCAP file: header, decompression, index of the messages inside."""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from numpy.typing import NDArray

from .batch import MessageBatch
from .mcap_kernels import count_records, index_records

__all__ = ['ChunkHeader', 'MalformedError', 'Walked', 'decompress', 'read_header', 'walk']

LARGEST_CHUNK = 1 << 30  # bytes uncompressed; writers make chunks of about a megabyte
_PIECE = 1 << 24  # bytes that may be allocated because a length says so
_TIMES = struct.Struct('<QQQII')  # start, end, uncompressed size, checksum, length of name
_SIZE = struct.Struct('<Q')


class MalformedError(Exception):
    """A record contradicts itself; says how, for a damage note."""


@dataclass(frozen=True, slots=True)
class ChunkHeader:
    """Where a chunk lies and what it states of itself."""

    offset: int  # of the record in the file
    start_ns: int
    end_ns: int
    uncompressed_size: int
    checksum: int  # CRC-32 of the uncompressed records; 0 where there is none
    compression: str
    data: int  # offset of the records in the file
    size: int  # of the records as stored, bytes
    torn: bool  # the file ends before the chunk does


def read_header(octets: NDArray[np.uint8], offset: int, stop: int) -> ChunkHeader:
    """Header of the chunk record at ``offset``, of a file that ends at ``stop``.

    Raises MalformedError where it cannot be the header of a chunk.
    """
    length = _SIZE.unpack(octets[offset + 1 : offset + 9].tobytes().ljust(8, b'\xff'))[0]
    head = octets[offset + 9 : min(stop, offset + 9 + 64)].tobytes()
    if len(head) < _TIMES.size:
        raise MalformedError('a chunk begins, of which too little is there')
    start_ns, end_ns, uncompressed_size, checksum, name_size = _TIMES.unpack_from(head)
    if name_size > 16 or len(head) < _TIMES.size + name_size + 8:
        raise MalformedError('a chunk names no compression that is known')
    name = head[_TIMES.size : _TIMES.size + name_size].decode('ascii', 'replace')
    size = _SIZE.unpack_from(head, _TIMES.size + name_size)[0]
    data = offset + 9 + _TIMES.size + name_size + 8
    torn = size > stop - data
    if name not in ('', 'zstd', 'lz4'):
        raise MalformedError(f'a chunk is compressed by {name!r}; only zstd and lz4 are read')
    if uncompressed_size > LARGEST_CHUNK:
        raise MalformedError(
            f'a chunk claims {uncompressed_size} bytes, more than {LARGEST_CHUNK}'
        )
    if length != data - offset - 9 + size:
        raise MalformedError('the lengths that a chunk states contradict each other')
    return ChunkHeader(
        offset,
        min(start_ns, (1 << 63) - 1),
        min(end_ns, (1 << 63) - 1),
        uncompressed_size,
        checksum,
        name,
        data,
        min(size, stop - data),
        torn,
    )


def _zstd_pieces(data: memoryview, chunk: ChunkHeader) -> Iterator[bytes]:
    decompressor = zstandard.ZstdDecompressor()
    stated = chunk.uncompressed_size
    if stated <= _PIECE and not chunk.torn and zstandard.frame_content_size(data) == stated:
        yield decompressor.decompress(data)
    else:  # by pieces: the frame's own size is not believed, and a torn one gives what it has
        yield from decompressor.read_to_iter(data, write_size=1 << 17)


def _lz4_pieces(data: memoryview, chunk: ChunkHeader) -> Iterator[bytes]:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    piece = max(1, min(chunk.uncompressed_size + 1, _PIECE))
    yield decompressor.decompress(data, max_length=piece)
    while not decompressor.eof and not decompressor.needs_input:
        yield decompressor.decompress(b'', max_length=piece)


def decompress(stored: memoryview, chunk: ChunkHeader) -> bytes:
    """The records of a compressed chunk, verified; of a torn one as many as can be had.

    Beyond 16 MB memory grows with what the data really gives, not with what it claims. Raises
    MalformedError where a whole chunk does not give what it states.
    """
    pieces_of = _zstd_pieces if chunk.compression == 'zstd' else _lz4_pieces
    pieces: list[bytes] = []
    total = 0
    try:
        for piece in pieces_of(stored, chunk):
            total += len(piece)
            if total > chunk.uncompressed_size:
                raise MalformedError('a chunk decompresses to more than it states')
            pieces.append(piece)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        if not chunk.torn:
            raise MalformedError('a chunk cannot be decompressed') from error
    records = pieces[0] if len(pieces) == 1 else b''.join(pieces)
    if not chunk.torn:
        verify(records, chunk)
    return records


def verify(records: bytes | memoryview, chunk: ChunkHeader) -> None:
    """Hold length and checksum against what the chunk states."""
    if len(records) != chunk.uncompressed_size:
        raise MalformedError(
            f'a chunk holds {len(records)} bytes instead of {chunk.uncompressed_size}'
        )
    if chunk.checksum and zlib.crc32(records) != chunk.checksum:
        raise MalformedError('a chunk fails its checksum')


class Walked(NamedTuple):
    """The messages of a range of records; ``connection`` still holds the file's channel ids."""

    batch: MessageBatch
    others: list[int]  # offsets of schemas, channels and the like
    end: int  # where the walk stopped


def walk(
    buffer: bytes | mmap.mmap, octets: NDArray[np.uint8], start: int, stop: int, origin: int
) -> Walked:
    """Index the records of ``octets[start:stop]`` up to the first that cannot be one."""
    messages, others, end = count_records(octets, start, stop)
    channel, log_ns, publish_ns, offset, length = np.empty((5, messages), np.int64)
    places = np.empty(others, np.int64)
    index_records(octets, start, end, channel, log_ns, publish_ns, offset, length, places)
    return Walked(
        MessageBatch(buffer, octets, channel, log_ns, publish_ns, offset, length, origin),
        places.tolist(),
        end,
    )
