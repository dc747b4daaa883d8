"""What streams, blocks of samples and of the grid, between bytes and records.

The objects that rclpy builds for a message, and takes apart again, cost more than everything
else that is done with a block; so publishers are given bytes here, and subscriptions deliver
them (``raw``). The layout is CDR, as the middleware itself would write it: four bytes of
encapsulation, then each field aligned to its own size, counted from there. What the blocks of
a stream have in common, names and channels, is made or parsed once and compared from then on.
"""

from __future__ import annotations

import dataclasses
import math
import struct

import numpy as np
from rclpy.serialization import deserialize_message

from impactscope import msg
from impactscope.errors import InputError
from impactscope.nodes.conversions import to_record
from impactscope.recordings.block_codec import BlockDecoder, encode_block
from impactscope.records import NANOSECONDS, Channel, Quality, SampleBlock, SyncedBlock

__all__ = ['SampleBlockReader', 'SyncedBlockReader', 'SyncedBlockWriter', 'write_sample_block']

_ENCAPSULATION = b'\x00\x01\x00\x00'  # CDR, little endian
_LENGTH = struct.Struct('<I')
_STAMP = struct.Struct('<iI')
_CHANNEL = struct.Struct('<dffH')  # native rate, range, quality
_GRID = struct.Struct('<dI4xQI')  # sample rate, epoch, first index, oversampling
_SAMPLES = struct.Struct('<II')  # grid samples, length of values
_MOST_KINDS = 64  # of what blocks on one topic have in common
_SAMPLE_FLAGS = 0x1F  # those that a SampleBlock carries


def write_sample_block(block: SampleBlock) -> bytes:
    """A block as its message's bytes; a stamp before 1970 is zero, which means: not known."""
    quality = Quality(block.quality & _SAMPLE_FLAGS)
    if block.stamp_ns < 0 or block.received_ns < 0 or quality != block.quality:
        block = dataclasses.replace(
            block,
            stamp_ns=max(block.stamp_ns, 0),
            received_ns=max(block.received_ns, 0),
            quality=quality,
        )
    return encode_block(block)


class SampleBlockReader:
    """Bytes of SampleBlocks, of any number of channels, to records.

    A range that is not known is ``math.nan`` itself, so that descriptions of a channel compare
    equal from block to block. What is not little endian is left to the middleware, which raises
    for what is no message.
    """

    def __init__(self) -> None:
        self._decoders: dict[bytes, BlockDecoder] = {}

    def __call__(self, data: bytes) -> SampleBlock:
        """The block in these bytes."""
        key = data[12:44]  # names, or most of them: what follows the rate is beyond this
        decoder = self._decoders.get(key)
        if decoder is None:
            if len(self._decoders) >= _MOST_KINDS:
                self._decoders.clear()
            decoder = self._decoders[key] = BlockDecoder()
        block = decoder.decode(data, 0, len(data))
        if block is None:
            block = to_record(deserialize_message(data, msg.SampleBlock))
        if math.isnan(block.range_min) or math.isnan(block.range_max):
            low, high = (
                math.nan if math.isnan(value) else value
                for value in (block.range_min, block.range_max)
            )
            block = dataclasses.replace(block, range_min=low, range_max=high)
        return block


class SyncedBlockWriter:
    """Records of the grid to the bytes of their messages."""

    def __init__(self) -> None:
        self._channels: tuple[Channel, ...] | None = None
        self._front = self._middle = b''

    def __call__(self, block: SyncedBlock) -> bytes:
        """The bytes; raises struct.error where a field does not fit its type."""
        if block.channels != self._channels:
            self._front, self._middle = _common_parts(block.channels)
            self._channels = block.channels
        values = np.ascontiguousarray(block.values, '<f4')
        return b''.join((
            _ENCAPSULATION,
            _STAMP.pack(*divmod(max(block.stamp_ns, 0), NANOSECONDS)),
            self._front,
            _GRID.pack(block.sample_rate, block.epoch, block.first_index, block.oversampling),
            self._middle,
            _SAMPLES.pack(values.shape[1], values.size),
            values.tobytes(),
        ))  # fmt: skip


def _common_parts(channels: tuple[Channel, ...]) -> tuple[bytes, bytes]:
    """What stands before and after the grid's description, each with the padding behind it."""
    front = bytearray(_STAMP.size)
    _put_text(front, channels[0].frame_id if channels else '')
    _align(front, 8)
    whole = front + bytes(_GRID.size) + _LENGTH.pack(len(channels))
    for channel in channels:
        for text in (channel.name, channel.unit, channel.frame_id):
            _put_text(whole, text)
        _align(whole, 8)
        whole += _CHANNEL.pack(
            channel.native_rate, channel.range_min, channel.range_max, int(channel.quality)
        )
    _align(whole, 4)
    return bytes(front[_STAMP.size :]), bytes(whole[len(front) + _GRID.size :])


def _align(data: bytearray, size: int) -> None:
    data += bytes(-len(data) % size)


def _put_text(data: bytearray, text: str) -> None:
    encoded = text.encode() + b'\0'
    _align(data, 4)
    data += _LENGTH.pack(len(encoded)) + encoded


class SyncedBlockReader:
    """Bytes of SyncedBlocks to records, whose values are a view of the bytes, not writable.

    Blocks of the same channels share one tuple of them. What is not little endian is left to
    the middleware, which raises for what is no message.
    """

    def __init__(self) -> None:
        self._front = self._middle = b''
        self._channels: tuple[Channel, ...] = ()

    def __call__(self, data: bytes) -> SyncedBlock:
        """The block in these bytes; raises InputError where values and channels do not fit."""
        grid = 12 + len(self._front)
        middle = grid + _GRID.size
        samples = middle + len(self._middle)
        if (
            not self._middle
            or len(data) < samples + _SAMPLES.size
            or data[:2] != _ENCAPSULATION[:2]
            or data[12:grid] != self._front
            or data[middle:samples] != self._middle
        ):
            record: SyncedBlock = to_record(deserialize_message(data, msg.SyncedBlock))
            self._front, self._middle = _common_parts(record.channels)
            self._channels = record.channels
            return record
        second, nanosecond = _STAMP.unpack_from(data, 4)
        sample_rate, epoch, first_index, oversampling = _GRID.unpack_from(data, grid)
        width, count = _SAMPLES.unpack_from(data, samples)
        if count != width * len(self._channels):
            raise InputError(
                f'a synchronised block has {count} values: '
                f'{width} samples of {len(self._channels)} channels are announced'
            )
        if len(data) < samples + _SAMPLES.size + 4 * count:
            raise InputError(f'a synchronised block of {len(data)} bytes is cut short')
        values = np.frombuffer(data, '<f4', count, samples + _SAMPLES.size)
        return SyncedBlock(
            second * NANOSECONDS + nanosecond,
            sample_rate,
            epoch,
            first_index,
            self._channels,
            values.reshape(len(self._channels), width),
            oversampling,
        )
