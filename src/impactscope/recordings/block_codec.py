"""SampleBlock between CDR (XCDR version 1, little endian) and the project's record."""

from __future__ import annotations

import mmap
import struct

import numpy as np

from impactscope.records import NANOSECONDS, Quality, SampleBlock

__all__ = ['BlockDecoder', 'encode_block']

_STAMP = struct.Struct('<iI')
_LENGTH = struct.Struct('<I')
# sample_rate, device_time_ns, received, epoch, first_index, quality, range, length of values
_FIXED = struct.Struct('<dqiII4xQH2xffI')
_ENCAPSULATION = b'\x00\x01\x00\x00'


def _split(time_ns: int) -> tuple[int, int]:
    return divmod(time_ns, NANOSECONDS)


def _string(text: str, position: int) -> bytes:
    """Length, text, terminating zero; padded before so that the length is aligned to 4."""
    data = text.encode('utf-8') + b'\0'
    return b'\0' * (-position % 4) + _LENGTH.pack(len(data)) + data


def encode_block(block: SampleBlock) -> bytes:
    """Serialise a block. Raises struct.error where a field does not fit its message type."""
    body = _STAMP.pack(*_split(block.stamp_ns))
    for text in (block.frame_id, block.channel, block.unit):
        body += _string(text, len(body))
    body += b'\0' * (-len(body) % 8)
    fixed = _FIXED.pack(
        block.sample_rate,
        block.device_time_ns,
        *_split(block.received_ns),
        block.epoch,
        block.first_index,
        int(block.quality),
        block.range_min,
        block.range_max,
        block.values.size,
    )
    return _ENCAPSULATION + body + fixed + np.ascontiguousarray(block.values, '<f4').tobytes()


class BlockDecoder:
    """Reads the blocks of one topic.

    What a topic's blocks have in common (frame, channel, unit) stands at the front of each; it
    is parsed when it changes, and compared otherwise.
    """

    def __init__(self) -> None:
        self._front = b''
        self._start = 0  # of the fixed part, from the message's beginning
        self._names = ('', '', '')
        self._qualities: dict[int, Quality] = {0: Quality.NONE}

    def decode(self, buffer: bytes | mmap.mmap, offset: int, length: int) -> SampleBlock | None:
        """The block at this place, or None where it is not a little-endian SampleBlock."""
        start = self._start
        if (
            start == 0
            or length < start + _FIXED.size
            or buffer[offset + 12 : offset + start] != self._front
            or buffer[offset : offset + 2] != b'\x00\x01'
        ):
            if not self._parse_front(buffer[offset : offset + length]):
                return None
            start = self._start
        second, nanosecond = _STAMP.unpack_from(buffer, offset + 4)
        (
            sample_rate,
            device_time_ns,
            received_second,
            received_nanosecond,
            epoch,
            first_index,
            bits,
            range_min,
            range_max,
            count,
        ) = _FIXED.unpack_from(buffer, offset + start)
        if 4 * count > length - start - 56:
            return None
        if count:
            values = np.frombuffer(buffer, '<f4', count, offset + start + 56).copy()
        else:
            values = np.empty(0, np.float32)
        quality = self._qualities.get(bits)
        if quality is None:
            quality = self._qualities[bits] = Quality(bits)
        frame_id, channel, unit = self._names
        return SampleBlock(
            channel,
            unit,
            sample_rate,
            second * NANOSECONDS + nanosecond,
            first_index,
            values,
            epoch,
            device_time_ns,
            received_second * NANOSECONDS + received_nanosecond,
            quality,
            range_min,
            range_max,
            frame_id,
        )

    def _parse_front(self, data: bytes) -> bool:
        """Find the names and the fixed part; whether they are there in full."""
        if data[:2] != b'\x00\x01':
            return False
        position = 12
        names = []
        for _ in range(3):
            position += -position % 4
            if position + 4 > len(data):
                return False
            (size,) = _LENGTH.unpack_from(data, position)
            position += 4
            if size > len(data) - position:
                return False
            text = data[position : position + size].rstrip(b'\0')
            names.append(text.decode('utf-8', 'replace'))
            position += size
        position += -(position - 4) % 8
        if position + _FIXED.size > len(data):
            return False
        self._front = data[12:position]
        self._start = position
        self._names = (names[0], names[1], names[2])
        return True
