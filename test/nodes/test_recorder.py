import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from graph_tools import Ear, eventually, options, ros, spinning
from rclpy.node import Node

from impactscope import msg
from impactscope.nodes import qos
from impactscope.nodes.conversions import to_message
from impactscope.nodes.recorder import Recorder
from impactscope.recordings import open_recording
from impactscope.records import SampleBlock, TestPoint

pytestmark = pytest.mark.ros


def block(index):
    values = np.full(20, index, np.float32)
    return SampleBlock('force', 'N', 1000.0, 10**18 + index * 10**6, index, values)


def recorder_command(path):
    code = "from impactscope.nodes.main import main; raise SystemExit(main('recorder'))"
    given = ['--ros-args', '-r', '__ns:=/bench', '-p', f'path:={path}']
    return [sys.executable, '-c', code, *given]


def test_what_goes_over_the_wire_is_in_the_file(tmp_path):
    path = tmp_path / 'deep' / 'record.mcap'
    with ros():
        node = Recorder(**options(path=str(path), provenance=['operator=A. Tester']))
        player = Node('player', namespace='bench')
        samples = player.create_publisher(msg.SampleBlock, 'force_samples', qos.SAMPLES)
        points = player.create_publisher(msg.TestPoint, 'test_point', qos.LATCHED)
        extra = player.create_publisher(msg.Estimate, 'something_else', 10)
        with spinning(node):
            assert eventually(lambda: samples.get_subscription_count())
            assert eventually(lambda: extra.get_subscription_count())
            points.publish(to_message(TestPoint(id='hand <b>1</b>', start_ns=10**18)))
            for index in range(0, 2000, 20):
                samples.publish(to_message(block(index)))
            extra.publish(msg.Estimate(value=1.0))
            assert eventually(lambda: node.received >= 102)
            node.finish()
        player.destroy_node()
    with open_recording(path) as recording:
        topics = {topic.name: topic for topic in recording.info.topics}
        assert topics['/bench/force_samples'].count == 100
        assert topics['/bench/something_else'].count == 1
        assert 'transient_local' in topics['/bench/test_point'].qos
        assert recording.info.provenance['operator'] == 'A. Tester'
        records = [record for _, _, record in recording.records()]
    assert [r.first_index for r in records if isinstance(r, SampleBlock)] == list(
        range(0, 2000, 20)
    )
    assert [r.id for r in records if isinstance(r, TestPoint)] == ['hand <b>1</b>']


def test_killed_at_any_moment_it_loses_at_most_the_last_second(tmp_path):
    path = tmp_path / 'killed.mcap'
    command = recorder_command(path)
    with ros():
        player = Node('player', namespace='bench')
        out = player.create_publisher(msg.SampleBlock, 'force_samples', qos.SAMPLES)
        with subprocess.Popen(command, env=os.environ) as process:
            assert eventually(out.get_subscription_count)
            time.sleep(0.3)
            sent = []
            for index in range(0, 3000, 20):
                out.publish(to_message(block(index)))
                sent.append(time.monotonic())
                time.sleep(0.02)
            killed = time.monotonic()
            process.send_signal(signal.SIGKILL)
        player.destroy_node()
    with open_recording(path, tolerate_damage=True) as recording:
        kept = sum(isinstance(record, SampleBlock) for _, _, record in recording.records())
    older = sum(moment < killed - 1.0 for moment in sent)
    assert older > 50
    assert kept >= older


def test_interrupted_it_closes_the_file(tmp_path):
    path = tmp_path / 'closed.mcap'
    with ros():
        player = Ear()
        out = player.create_publisher(msg.SampleBlock, 'force_samples', qos.SAMPLES)
        command = recorder_command(path)
        with subprocess.Popen(command, env=os.environ) as process:
            assert eventually(out.get_subscription_count)
            time.sleep(0.3)
            for index in range(0, 200, 20):
                out.publish(to_message(block(index)))
            time.sleep(0.5)
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 0
        player.destroy_node()
    with open_recording(path) as recording:
        assert recording.info.damage == ()
        assert sum(isinstance(r, SampleBlock) for _, _, r in recording.records()) == 10
