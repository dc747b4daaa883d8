"""The small records of an MCAP file: schemas, channels, statistics, metadata, attachments."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from .info import AttachmentInfo
from .mcap_chunk import MalformedError

__all__ = ['Cursor', 'McapChannel', 'McapSchema', 'Statistics']

_U16 = struct.Struct('<H')
_U32 = struct.Struct('<I')
_U64 = struct.Struct('<Q')


class Cursor:
    """Reads fields one after another; MalformedError where the content ends too soon."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._position = 0

    def _take(self, size: int) -> bytes:
        end = self._position + size
        if end > len(self._content):
            raise MalformedError('a record is shorter than its fields')
        part = self._content[self._position : end]
        self._position = end
        return part

    @property
    def left(self) -> int:
        """Bytes that have not been read."""
        return len(self._content) - self._position

    def u16(self) -> int:
        """Unsigned, two bytes."""
        return int(_U16.unpack(self._take(2))[0])

    def u32(self) -> int:
        """Unsigned, four bytes."""
        return int(_U32.unpack(self._take(4))[0])

    def u64(self) -> int:
        """Unsigned, eight bytes."""
        return int(_U64.unpack(self._take(8))[0])

    def text(self) -> str:
        """Text after its length in four bytes."""
        return self._take(self.u32()).decode('utf-8', 'replace')

    def mapping(self) -> dict[str, str]:
        """Pairs of texts after their total length in four bytes."""
        inner = Cursor(self._take(self.u32()))
        pairs = {}
        while inner.left:
            key = inner.text()
            pairs[key] = inner.text()
        return pairs

    def counts(self) -> dict[int, int]:
        """Pairs of a two-byte and an eight-byte number after their total length."""
        inner = Cursor(self._take(self.u32()))
        pairs = {}
        while inner.left:
            key = inner.u16()
            pairs[key] = inner.u64()
        return pairs


@dataclass(frozen=True, slots=True)
class McapSchema:
    """A type's definition."""

    id: int
    name: str
    encoding: str
    text: str

    @classmethod
    def parse(cls, content: bytes) -> McapSchema:
        """Raises MalformedError."""
        cursor = Cursor(content)
        return cls(cursor.u16(), cursor.text(), cursor.text(), cursor.text())


@dataclass(frozen=True, slots=True)
class McapChannel:
    """A topic."""

    id: int
    schema_id: int
    topic: str
    encoding: str
    metadata: dict[str, str]

    @classmethod
    def parse(cls, content: bytes) -> McapChannel:
        """Raises MalformedError."""
        cursor = Cursor(content)
        return cls(cursor.u16(), cursor.u16(), cursor.text(), cursor.text(), cursor.mapping())


@dataclass(frozen=True, slots=True)
class Statistics:
    """What the file's writer counted."""

    messages: int
    start_ns: int
    end_ns: int
    counts: dict[int, int]

    @classmethod
    def parse(cls, content: bytes) -> Statistics:
        """Raises MalformedError."""
        cursor = Cursor(content)
        messages = cursor.u64()
        cursor.u16()  # schemas
        for _ in range(4):  # channels, attachments, metadata, chunks
            cursor.u32()
        return cls(messages, cursor.u64(), cursor.u64(), cursor.counts())


def parse_metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Name and pairs; raises MalformedError."""
    cursor = Cursor(content)
    return cursor.text(), cursor.mapping()


def parse_attachment(content: bytes) -> AttachmentInfo:
    """From the beginning of an attachment; raises MalformedError."""
    cursor = Cursor(content)
    cursor.u64()  # log time
    cursor.u64()  # creation time
    return AttachmentInfo(cursor.text(), cursor.text(), cursor.u64())
