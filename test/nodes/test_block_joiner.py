import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.nodes.block_joiner import BlockJoiner
from impactscope.records import Channel, Quality, SyncedBlock

pytestmark = pytest.mark.ros

RATE = 51_200.0
START = 10**18
CHANNELS = (Channel('force', 'N'), Channel('acceleration.plate', 'm/s^2'))


def block(first, width, **changes):
    values = np.arange(2 * first, 2 * (first + width), dtype=np.float32).reshape(width, 2).T
    stamp = START + round(first / RATE * 1e9)
    made = SyncedBlock(stamp, RATE, 0, first, CHANNELS, values)
    return dataclasses.replace(made, **changes)


def through(joiner, blocks):
    return [out for item in blocks for out in joiner.push(item)] + joiner.flush()


@given(st.lists(st.integers(1, 3000), min_size=1, max_size=30))
def test_nothing_is_lost_and_what_comes_out_is_long(widths):
    firsts = np.cumsum([0, *widths])
    pieces = [block(int(f), w) for f, w in zip(firsts, widths, strict=False)]
    joined = through(BlockJoiner(), pieces)
    whole = block(0, sum(widths))
    assert np.array_equal(np.hstack([item.values for item in joined]), whole.values)
    stop = 0
    for item in joined:
        assert item.first_index == stop
        assert item.stamp_ns == block(stop, 1).stamp_ns
        stop += item.values.shape[1]
    for item in joined[:-1]:
        assert item.values.shape[1] >= 0.1 * RATE
    assert len(joined) <= len(pieces)


def test_one_block_passes_as_it_is():
    joiner, only = BlockJoiner(), block(0, 1024)
    assert joiner.push(only) == []
    assert joiner.flush() == [only]
    assert joiner.flush() == []


@pytest.mark.parametrize(
    'changes',
    [
        {'first_index': 1025},
        {'epoch': 1},
        {'oversampling': 2},
        {'sample_rate': RATE / 2},
        {'stamp_ns': block(1024, 1).stamp_ns + 3},
        {'channels': (dataclasses.replace(CHANNELS[0], quality=Quality.CLIPPED), CHANNELS[1])},
    ],
)
def test_blocks_that_a_consumer_could_tell_apart_stay_apart(changes):
    joiner = BlockJoiner()
    first, second = block(0, 1024), block(1024, 1024, **changes)
    assert joiner.push(first) == []
    assert joiner.push(second) == [first]
    assert joiner.flush() == [second]


def test_an_end_marker_waits_for_nothing():
    joiner = BlockJoiner()
    first, end = block(0, 1024), block(1024, 0)
    assert end.is_end
    assert joiner.push(first) == []
    assert joiner.push(end) == [first, end]
    assert joiner.flush() == []


def test_no_message_grows_beyond_what_is_quick_to_deliver():
    rate = 1e6
    joiner = BlockJoiner(longest=1.0)
    pieces = [
        dataclasses.replace(block(first, 10_000, sample_rate=rate), stamp_ns=START + first * 1000)
        for first in range(0, 100_000, 10_000)
    ]
    joined = through(joiner, pieces)
    assert len(joined) < len(pieces)
    assert all(item.values.nbytes <= 240_000 for item in joined)
