"""Wanted channels of a recording as one stream."""

import itertools

import pytest

from impactscope.errors import MissingChannelError, RecordingError
from impactscope.recordings import RecordingWriter, SampleRun, open_recording, read_streams
from impactscope.records import SampleBlock, TestPoint


@pytest.fixture
def path(bench, tmp_path):
    path = tmp_path / 'a.mcap'
    with RecordingWriter(path) as writer:
        writer.write_test_point(TestPoint(id='t', start_ns=bench.start_ns))
        for block in bench.blocks(10):
            writer.write_block(block)
        for i in range(5):
            data = bench.stamped(bench.start_ns + i, [float(i)] * 6)
            log_ns = bench.start_ns + 10**9 + i
            writer.write('/wrench', 'geometry_msgs/msg/WrenchStamped', data, log_ns)
    return path


def test_all_channels_test_points_and_runs(path):
    with open_recording(path) as recording:
        kinds = [type(r) for r in read_streams(recording)]
    assert kinds == [TestPoint] + [SampleBlock] * 20 + [SampleRun]


def test_wanted_channels_are_renamed_and_others_left_out(path):
    with open_recording(path) as recording:
        blocks = [
            r
            for r in read_streams(recording, {'force': 'force.hammer'})
            if isinstance(r, SampleBlock)
        ]
    assert {b.channel for b in blocks} == {'force.hammer'}
    assert [b.first_index for b in blocks] == [64 * i for i in range(10)]


def test_topics_limit_what_is_read_but_test_points_always_come(path):
    with open_recording(path) as recording:
        kinds = [type(r) for r in read_streams(recording, topics=['/force'])]
    assert kinds == [TestPoint] + [SampleBlock] * 10


def test_missing_channel_is_named_after_the_rest(path):
    with open_recording(path) as recording:
        stream = read_streams(recording, {'force': 'force', 'torque': 'torque'})
        assert len(list(itertools.islice(stream, 12))) == 12
        with pytest.raises(MissingChannelError, match=r"no channel 'torque'; .*plate, force"):
            next(stream)


def test_one_channel_on_two_topics_is_refused(bench, tmp_path):
    path = tmp_path / 'b.mcap'
    with RecordingWriter(path) as writer:
        writer.write_block(bench.block(), '/left/force')
        writer.write_block(bench.block(), '/right/force')
    with open_recording(path) as recording:
        with pytest.raises(RecordingError, match='two topics'):
            list(read_streams(recording))
        assert len(list(read_streams(recording, topics=['/left/force']))) == 1
