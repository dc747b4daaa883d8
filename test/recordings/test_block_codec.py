"""CDR of SampleBlock against rosbags' serialiser, in both directions."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.recordings.block_codec import BlockDecoder, encode_block
from impactscope.recordings.definitions import BLOCK_TYPE, reference_store
from impactscope.recordings.message_records import block_from_message
from impactscope.records import Quality, SampleBlock

times = st.integers(0, (1 << 31) * 10**9 - 1)
texts = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=20)
floats = st.floats(width=32, allow_nan=True)


@st.composite
def blocks(draw):
    values = draw(st.lists(st.floats(width=32), max_size=20))
    return SampleBlock(
        channel=draw(texts),
        unit=draw(texts),
        sample_rate=draw(st.floats(allow_nan=False)),
        stamp_ns=draw(times),
        first_index=draw(st.integers(0, (1 << 64) - 1)),
        values=np.array(values, np.float32),
        epoch=draw(st.integers(0, (1 << 32) - 1)),
        device_time_ns=draw(st.integers(-(1 << 63), (1 << 63) - 1)),
        received_ns=draw(times),
        quality=Quality(draw(st.integers(0, 1023))),
        range_min=draw(floats),
        range_max=draw(floats),
        frame_id=draw(texts),
    )


@given(blocks())
@settings(max_examples=150, deadline=None)
def test_bytes_are_those_of_an_independent_serialiser(bench, block):
    store = reference_store()
    data = encode_block(block)
    assert bench.same(block, block_from_message(store.deserialize_cdr(data, BLOCK_TYPE)))
    message = store.deserialize_cdr(data, BLOCK_TYPE)
    assert bytes(store.serialize_cdr(message, BLOCK_TYPE)) == data


@given(st.lists(blocks(), min_size=1, max_size=4), st.integers(0, 9))
@settings(max_examples=100, deadline=None)
def test_decoder_returns_what_was_encoded_at_any_offset(bench, items, lead):
    decoder = BlockDecoder()  # one for all: names may change from block to block
    buffer = b'\xaa' * lead
    places = []
    for item in items:
        data = encode_block(item)
        places.append((len(buffer), len(data)))
        buffer += data
    for item, (offset, length) in zip(items, places, strict=True):
        assert bench.same(item, decoder.decode(buffer, offset, length))


def test_values_are_writable_and_aligned(bench):
    data = b'\0' * 3 + encode_block(bench.block())
    values = BlockDecoder().decode(data, 3, len(data) - 3).values
    assert values.flags.writeable
    assert values.flags.aligned
    assert values.dtype == np.float32


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_no_bytes_make_the_decoder_raise_or_read_beyond(bench, data):
    good = encode_block(bench.block(count=8))
    cut = data.draw(st.integers(0, len(good)))
    at = data.draw(st.integers(0, len(good) - 1))
    bad = bytearray(good)
    bad[at] = data.draw(st.integers(0, 255))
    decoder = BlockDecoder()
    decoder.decode(good, 0, len(good))
    for raw, length in ((good[:cut], cut), (bytes(bad), len(bad))):
        for subject in (decoder, BlockDecoder()):
            block = subject.decode(raw, 0, length)
            assert block is None or block.values.size <= 8
    assert BlockDecoder().decode(good[:-1], 0, len(good) - 1) is None


def test_field_out_of_range_is_refused(bench):
    block = bench.block()
    object.__setattr__(block, 'first_index', -1)
    with pytest.raises(struct.error):
        encode_block(block)
    assert math.isnan(SampleBlock('a', 'N', 1.0, 0, 0, np.empty(0, np.float32)).range_min)
