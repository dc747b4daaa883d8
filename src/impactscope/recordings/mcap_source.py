"""An MCAP file, mapped into memory and read chunk by chunk, sound or torn."""

from __future__ import annotations

import contextlib
import functools
import mmap
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import RecordingError

from .batch import Damage, MessageBatch, PendingBatch, in_time_order
from .info import AttachmentInfo
from .mcap_chunk import ChunkHeader, MalformedError, Walked, decompress, read_header, verify, walk
from .mcap_kernels import BAD, CHUNK, FULL, MESSAGE, find_chunk, scan_records
from .mcap_records import (
    McapChannel,
    McapSchema,
    Statistics,
    parse_attachment,
    parse_metadata,
)
from .source import Connection

__all__ = ['MAGIC', 'McapSource']

MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL = 2, 3, 4
_DATA_END = 15
_ATTACHMENT, _STATISTICS, _METADATA = 9, 11, 12
_LARGEST_SMALL_RECORD = 1 << 24  # bytes; a definition, a topic or a metadata record
_KEPT_MAPPED = 1 << 26  # bytes of the file behind the reader that stay resident
_LAST = (1 << 63) - 1
_UNCLOSED = (
    'the recording ends without its closing records: it was cut off, or its writer was killed'
)


@dataclass(frozen=True, slots=True)
class _Messages:
    """Consecutive messages outside of any chunk."""

    offset: int
    size: int
    start_ns: int


class McapSource:
    """One MCAP file.

    Opening hops over the records without reading chunks; only where the file lacks its closing
    records (topics, counts) is it read through once to find them.

    Raises RecordingError where the file is empty or is no MCAP file.
    """

    storage = 'mcap'
    _statistics: Statistics | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: list[AttachmentInfo] = []
        self.damage: list[Damage] = []
        self.start_ns = self.end_ns = 0
        self._schemas: dict[int, McapSchema] = {}
        self._channels: dict[int, McapChannel] = {}
        self._parts: list[ChunkHeader | _Messages] = []
        self._released = 0
        with path.open('rb') as file:
            if not file.read(1):
                raise RecordingError(f'{path.name!r} is empty (0 bytes)')
            self._buffer = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        if self._buffer[:8] != MAGIC:
            raise RecordingError(f'{path.name!r} does not begin like an MCAP file')
        self._octets = np.frombuffer(self._buffer, np.uint8)
        closed = len(self._buffer) >= 16 and self._buffer[-8:] == MAGIC
        self._stop = len(self._buffer) - (8 if closed else 0)
        self._in_summary = False
        self._trusted = closed and self._summary_sound()
        footer = self._scan()
        self._counts: Counter[int] = Counter()
        if self._trusted and self._statistics and (self._channels or not self._parts):
            self._counts.update(self._statistics.counts)
            if self._statistics.messages:
                self.start_ns = self._statistics.start_ns
                self.end_ns = self._statistics.end_ns
        else:
            if not self.damage and not (closed and footer):
                self._note(self.damage, len(self._buffer), _UNCLOSED)
            elif not self.damage and not self._trusted:
                self._note(self.damage, self._stop, 'the closing records fail their checksum')
            self._survey()
        self._ids = list(self._channels)
        self.counts = [self._counts.get(number, 0) for number in self._ids]
        self.connections = [self._connection(self._channels[number]) for number in self._ids]
        self._lookup = np.full(1 << 16, -1, np.int64)
        self._lookup[self._ids] = np.arange(len(self._ids))

    def close(self) -> None:
        """Let go of the file; what was delivered stays valid."""
        self._octets = np.empty(0, np.uint8)
        with contextlib.suppress(BufferError):  # a batch refers to it: the last one closes it
            self._buffer.close()

    def batches(
        self, wanted: Collection[int], damage: list[Damage]
    ) -> Iterator[list[MessageBatch]]:
        """Messages of the wanted connections in order of log time; adds to ``damage``."""
        mask = np.zeros(len(self._ids) + 1, bool)  # the last entry: channels nobody declared
        mask[list(wanted)] = True
        found = Counter[str]()

        def load(part: ChunkHeader | _Messages) -> MessageBatch:
            walked = self._read(part, damage)
            if walked is None:
                return _nothing(self._octets)
            batch = walked.batch
            connection = self._lookup[batch.connection]
            found['messages'] += len(batch)
            unknown = int(np.count_nonzero(connection < 0))
            if unknown:
                what = f'{unknown} messages belong to no topic that the recording describes'
                self._note(damage, part.offset, what)
            batch.connection[:] = connection
            keep = mask[connection]
            return batch if keep.all() else batch.take(keep)

        def compare() -> MessageBatch:
            stated = self._statistics.messages if self._statistics else found['messages']
            if stated != found['messages'] and not damage:
                what = f'{stated} messages are stated, {found["messages"]} were found'
                self._note(damage, self._stop, what)
            return _nothing(self._octets)

        self._released = 0
        pending = [PendingBatch(p.start_ns, functools.partial(load, p)) for p in self._parts]
        pending.append(PendingBatch(_LAST, compare))
        return in_time_order(pending)

    def _scan(self) -> bool:
        """Find chunks, loose messages and the small records; whether the footer is there."""
        capacity = 1 << 14
        opcodes = np.empty(capacity, np.uint8)
        offsets, lengths, starts = (np.empty(capacity, np.int64) for _ in range(3))
        position, footer, state = 8, False, FULL
        while state != 0:
            count, position, state = scan_records(
                self._octets, position, self._stop, opcodes, offsets, lengths, starts
            )
            # The indices of messages are the most frequent records, and are not needed.
            rows = np.flatnonzero(opcodes[:count] != 7).tolist()
            for opcode, offset, length, start in zip(
                opcodes[rows].tolist(),
                offsets[rows].tolist(),
                lengths[rows].tolist(),
                starts[rows].tolist(),
                strict=True,
            ):
                footer = footer or opcode == _FOOTER
                if opcode == MESSAGE:
                    self._parts.append(_Messages(offset, length, start))
                elif opcode == CHUNK:
                    self._add_chunk(offset)
                else:
                    self._small_record(opcode, offset, offset + 9, length)
            if state == BAD:
                position = self._resume(position)
                if position < 0:
                    break
        return footer

    def _summary_sound(self) -> bool:
        """Whether the footer is where it should be, and its checksum of the summary right."""
        footer = self._stop - 29  # opcode, length, start, start of offsets, checksum
        if footer < 8 or self._buffer[footer : footer + 9] != b'\x02\x14' + bytes(7):
            return False
        start = int.from_bytes(self._buffer[footer + 9 : footer + 17], 'little')
        checksum = int.from_bytes(self._buffer[self._stop - 4 : self._stop], 'little')
        if not checksum or not start:
            return start <= footer
        if not 8 <= start <= footer:
            return False
        with memoryview(self._buffer) as whole, whole[start : self._stop - 4] as summary:
            return zlib.crc32(summary) == checksum

    def _add_chunk(self, offset: int) -> None:
        try:
            self._parts.append(read_header(self._octets, offset, self._stop))
        except MalformedError as error:
            self._note(self.damage, offset, f'{error}; its messages are lost')

    def _resume(self, position: int) -> int:
        """After a record that cannot be one: note it, find the next chunk, or -1."""
        following: int = find_chunk(self._octets, position + 1, self._stop)
        if self._octets[position] == CHUNK and following < 0:
            try:
                chunk = read_header(self._octets, position, self._stop)
            except MalformedError:
                pass
            else:
                self._parts.append(chunk)
                what = 'the recording ends inside a chunk; what follows there is lost'
                self._note(self.damage, position, what)
                return -1
        if following < 0:
            what = f'the last {self._stop - position} bytes are no whole record'
        else:
            what = f'{following - position} bytes are no record; what they held is lost'
        self._note(self.damage, position, what)
        return following

    def _small_record(self, opcode: int, offset: int, content: int, length: int) -> None:
        if opcode == _DATA_END:
            self._in_summary = True
        if opcode not in (_SCHEMA, _CHANNEL, _STATISTICS, _METADATA, _ATTACHMENT):
            return
        if self._in_summary and not self._trusted:
            return
        try:
            if opcode == _ATTACHMENT:
                head = self._buffer[content : content + min(length, 1 << 16)]
                self.attachments.append(parse_attachment(head))
                return
            data = self._buffer[content : content + min(length, _LARGEST_SMALL_RECORD)]
            if opcode == _STATISTICS:
                self._statistics = Statistics.parse(data)
            elif opcode == _METADATA:
                name, pairs = parse_metadata(data)
                self.metadata[name] = pairs
            else:
                self._declare(opcode, data)
        except MalformedError as error:
            self._note(self.damage, offset, str(error))

    def _declare(self, opcode: int, content: bytes) -> None:
        """The first description of a channel or schema holds, unless the summary repeats it."""
        if opcode == _SCHEMA:
            schema = McapSchema.parse(content)
            if self._in_summary or schema.id not in self._schemas:
                self._schemas[schema.id] = schema
        elif opcode == _CHANNEL:
            channel = McapChannel.parse(content)
            if self._in_summary or channel.id not in self._channels:
                self._channels[channel.id] = channel

    def _connection(self, channel: McapChannel) -> Connection:
        schema = self._schemas.get(channel.schema_id)
        return Connection(
            channel.topic,
            schema.name if schema else '',
            channel.encoding,
            schema.text if schema else '',
            schema.encoding if schema else '',
            channel.metadata.get('offered_qos_profiles', ''),
        )

    def _survey(self) -> None:
        """Read everything once for what the closing records would have said."""
        ignored: list[Damage] = []  # each pass notes it anew
        self._in_summary = False
        first, last = _LAST, -1
        for part in self._parts:
            walked = self._read(part, ignored)
            if walked is None:
                continue
            batch = walked.batch
            for position in walked.others:
                opcode = int(batch.octets[position])
                head = position + 9
                size = int.from_bytes(batch.octets[position + 1 : head].tobytes(), 'little')
                if opcode in (_SCHEMA, _CHANNEL) and size <= _LARGEST_SMALL_RECORD:
                    try:
                        self._declare(opcode, batch.octets[head : head + size].tobytes())
                    except MalformedError as error:
                        self._note(self.damage, part.offset, str(error))
            if len(batch):
                first = min(first, int(batch.log_ns.min()))
                last = max(last, int(batch.log_ns.max()))
                numbers, counts = np.unique(batch.connection, return_counts=True)
                self._counts.update(dict(zip(numbers.tolist(), counts.tolist(), strict=True)))
        if last >= 0:
            self.start_ns, self.end_ns = first, last

    def _read(self, part: ChunkHeader | _Messages, damage: list[Damage]) -> Walked | None:
        self._release(part.offset)
        if isinstance(part, _Messages):
            stop = part.offset + part.size
            return walk(self._buffer, self._octets, part.offset, stop, part.offset)
        stop = part.data + part.size
        try:
            with memoryview(self._buffer) as whole, whole[part.data : stop] as stored:
                if part.compression:
                    records = decompress(stored, part)
                elif not part.torn:
                    verify(stored, part)
        except MalformedError as error:
            span = f'log times {part.start_ns} to {part.end_ns} ns'
            self._note(damage, part.offset, f'{error}; its messages are lost ({span})')
            return None
        if part.compression:
            octets = np.frombuffer(records or b'\0', np.uint8)[: len(records)]
            walked = walk(records, octets, 0, len(octets), part.offset)
            stop = len(octets)
        else:
            walked = walk(self._buffer, self._octets, part.data, stop, part.offset)
        if walked.end != stop and not part.torn:
            what = 'a chunk holds something that is no record; what follows there is lost'
            self._note(damage, part.offset, what)
        return walked

    def _release(self, position: int) -> None:
        """Give pages far behind back, so that memory stays flat however long the file is."""
        page = mmap.PAGESIZE
        behind = (position - _KEPT_MAPPED) // page * page
        if behind - self._released >= _KEPT_MAPPED:
            self._buffer.madvise(mmap.MADV_DONTNEED, self._released, behind - self._released)
            self._released = behind

    def _note(self, damage: list[Damage], offset: int, reason: str) -> None:
        if len(damage) < 1000:
            damage.append(Damage(self.path.name, offset, reason))


def _nothing(octets: NDArray[np.uint8]) -> MessageBatch:
    none = np.empty(0, np.int64)
    return MessageBatch(b'', octets, none, none, none, none, none, 0)
