import dataclasses
import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from impactscope import msg
from impactscope.errors import InputError
from impactscope.nodes.conversions import to_message, to_record
from impactscope.nodes.stream_codec import (
    SampleBlockReader,
    SyncedBlockReader,
    SyncedBlockWriter,
    write_sample_block,
)
from impactscope.records import Channel, Quality, SampleBlock, SyncedBlock

pytestmark = pytest.mark.ros

texts = st.text(st.characters(codec='utf-8', exclude_characters='\x00'), max_size=20)
finite = st.floats(-1e30, 1e30)
ranges = st.floats(-1e6, 1e6, width=32) | st.just(math.nan)
arrays = st.lists(st.floats(width=32), max_size=40).map(lambda v: np.array(v, np.float32))
stamps = st.integers(0, 2**31 * 10**9 - 1)

sample_blocks = st.builds(
    SampleBlock,
    channel=texts,
    unit=texts,
    sample_rate=finite,
    stamp_ns=stamps,
    first_index=st.integers(0, 2**64 - 1),
    values=arrays,
    epoch=st.integers(0, 2**32 - 1),
    device_time_ns=st.integers(-(2**63), 2**63 - 1),
    received_ns=stamps,
    quality=st.integers(0, 31).map(Quality),
    range_min=ranges,
    range_max=ranges,
    frame_id=texts,
)
channels = st.builds(
    Channel,
    name=texts,
    unit=texts,
    frame_id=texts,
    native_rate=finite,
    range_min=ranges,
    range_max=ranges,
    quality=st.integers(0, 1023).map(Quality),
)


@st.composite
def synced_blocks(draw):
    described = tuple(draw(st.lists(channels, max_size=4)))
    width = draw(st.integers(0, 9))
    size = len(described) * width
    values = np.arange(size, dtype=np.float32).reshape(len(described), width)
    return SyncedBlock(
        draw(stamps),
        draw(finite),
        draw(st.integers(0, 2**32 - 1)),
        draw(st.integers(0, 2**64 - 1)),
        described,
        values,
        draw(st.integers(0, 2**32 - 1)),
    )


def same(a, b):
    """Whether two records are, field by field; NaN equals NaN."""
    for item in dataclasses.fields(a):
        x, y = getattr(a, item.name), getattr(b, item.name)
        if item.name == 'channels':
            equal = len(x) == len(y) and all(map(same, x, y))
        elif isinstance(x, np.ndarray):
            equal = x.dtype == y.dtype and x.shape == y.shape
            equal = equal and np.array_equal(x, y, equal_nan=True)
        else:
            equal = x == y or (x != x and y != y)
        if not equal:
            return False
    return True


@given(st.lists(sample_blocks, min_size=1, max_size=4))
def test_sample_blocks_are_what_the_middleware_writes_and_reads(blocks):
    read = SampleBlockReader()
    for block in [*blocks, *blocks]:
        assert same(read(serialize_message(to_message(block))), block)
        data = write_sample_block(block)
        assert same(to_record(deserialize_message(data, msg.SampleBlock)), block)
        assert same(read(data), block)


@given(st.lists(synced_blocks(), min_size=1, max_size=4))
def test_synced_blocks_are_what_the_middleware_writes_and_reads(blocks):
    read, write = SyncedBlockReader(), SyncedBlockWriter()
    for block in [*blocks, *blocks]:
        assert same(read(serialize_message(to_message(block))), block)
        data = write(block)
        assert same(to_record(deserialize_message(data, msg.SyncedBlock)), block)
        assert same(read(data), block)
        assert same(read(data), block)


def bench_block(width=5, **changes):
    described = (Channel('force', 'N', 'plate'), Channel('acceleration.plate', 'm/s^2'))
    values = np.arange(2 * width, dtype=np.float32).reshape(2, width)
    block = SyncedBlock(10**18, 51_200.0, 1, 7, described, values)
    return dataclasses.replace(block, **changes)


def test_blocks_of_the_same_channels_share_their_description():
    read, write = SyncedBlockReader(), SyncedBlockWriter()
    first = read(write(bench_block()))
    second = read(write(bench_block(width=9, first_index=12)))
    assert second.channels is first.channels
    assert second.first_index == 12
    assert second.values.shape == (2, 9)


def test_what_a_stamp_or_flag_cannot_say_is_left_out():
    """As the conversion to a message does."""
    block = SampleBlock(
        'force', 'N', 1e3, -5, 0, np.zeros(3, np.float32), received_ns=-1,
        quality=Quality.CLIPPED | Quality.HELD,
    )  # fmt: skip
    read = SampleBlockReader()(write_sample_block(block))
    assert same(read, to_record(to_message(block)))
    assert (read.stamp_ns, read.received_ns, read.quality) == (0, 0, Quality.CLIPPED)


def test_an_unknown_range_compares_equal_from_block_to_block():
    block = SampleBlock('force', 'N', 1e3, 10**18, 0, np.zeros(3, np.float32))
    read, data = SampleBlockReader(), write_sample_block(block)
    assert (read(data).range_min, read(data).range_max) == (math.nan, math.nan)


def test_blocks_that_contradict_themselves_are_refused():
    read, write = SyncedBlockReader(), SyncedBlockWriter()
    whole = write(bench_block())
    read(whole)
    with pytest.raises(InputError, match='cut short'):
        read(whole[:-4])
    place = len(whole) - 4 * 10 - 8
    assert struct.unpack_from('<II', whole, place) == (5, 10)
    torn = bytearray(whole)
    struct.pack_into('<I', torn, place, 6)
    with pytest.raises(InputError, match='10 values: 6 samples of 2 channels'):
        read(bytes(torn))


def test_what_is_no_message_is_refused():
    for read in (SampleBlockReader(), SyncedBlockReader()):
        for data in (b'', b'\0\1\0\0', b'\0\1\0\0' + b'\xff' * 60):
            with pytest.raises(Exception, match=r'.'):
                read(data)
