"""The synchroniser passes on at once what it keeps up with, and a backlog in longer blocks."""

import gc
import time

import numpy as np
import pytest
from graph_tools import Ear, eventually, options, ros
from rclpy.node import Node

from impactscope import msg
from impactscope.nodes import qos
from impactscope.nodes.conversions import to_record
from impactscope.nodes.run import Spinner
from impactscope.nodes.stream_codec import write_sample_block
from impactscope.nodes.synchroniser import SynchroniserNode
from impactscope.records import SampleBlock

pytestmark = pytest.mark.ros

RATE, WIDTH = 1000.0, 20
START = 1_700_000_000 * 10**9


def block(number):
    first = number * WIDTH
    values = np.arange(first, first + WIDTH, dtype=np.float32)
    data = SampleBlock('force', 'N', RATE, START + first * 10**6, first, values)
    return write_sample_block(data)


def test_a_backlog_comes_in_longer_blocks_and_the_rest_at_once():
    waiting, slowly = 100, 10
    with ros():
        node = SynchroniserNode(**options(channels=['force']))
        ear = Ear(synced=(msg.SyncedBlock, qos.SAMPLES))
        player = Node('player', namespace='bench')
        out = player.create_publisher(msg.SampleBlock, 'force_samples', qos.SAMPLES)
        assert eventually(out.get_subscription_count)
        assert eventually(lambda: node.count_subscribers('synced'))
        for number in range(waiting):
            out.publish(block(number))
        time.sleep(0.5)  # all of it waits in the node's subscription
        with Spinner([node, ear]):
            heard = ear.heard['synced']

            def taken():
                return sum(item.samples for item in heard)

            assert eventually(lambda: taken() == waiting * WIDTH)
            backlog = len(heard)
            for number in range(waiting, waiting + slowly):
                out.publish(block(number))
                assert eventually(lambda n=number: taken() == (n + 1) * WIDTH)
        player.destroy_node()
    assert backlog == waiting * WIDTH / (0.1 * RATE)
    assert [item.samples for item in heard[backlog:]] == [*[WIDTH] * slowly, 0]
    values = np.hstack([to_record(item).values[0] for item in heard])
    assert np.array_equal(values, np.arange(values.size))
    assert [item.first_index for item in heard[:3]] == [0, 100, 200]


def test_what_is_there_from_the_start_is_kept_from_the_collector():
    """A full collection looks at what has come since, not at every library."""
    with ros():
        with Spinner([Node('idle', namespace='bench')]):
            assert gc.get_freeze_count() > 10_000
        assert gc.get_freeze_count() == 0
