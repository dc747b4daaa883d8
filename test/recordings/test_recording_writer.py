"""The writer: readable by others, safe to kill, refusing what would not be readable."""

import os
import struct
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from impactscope.errors import ConfigurationError, InputError, RecordingError
from impactscope.recordings import Delivery, RecordingWriter, open_recording
from impactscope.recordings.definitions import BLOCK_TYPE, reference_store, schema_text
from impactscope.records import SampleBlock, TestPoint


def test_others_read_what_was_written(bench, tmp_path):
    blocks = bench.blocks(10)
    path = bench.write(tmp_path / 'a.mcap', blocks, metadata={'provenance': {'licence': 'MIT'}})
    with path.open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        messages = list(reader.iter_messages())
        (metadata,) = reader.iter_metadata()
    assert len(messages) == 20
    assert {m[0].encoding for m in messages} == {'ros2msg'}
    assert {m[1].message_encoding for m in messages} == {'cdr'}
    assert (metadata.name, metadata.metadata) == ('provenance', {'licence': 'MIT'})
    with AnyReader([path]) as reader:  # by the recorded definitions alone
        found = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
        ]
    assert [m.channel for m in found] == [b.channel for b in blocks]
    assert np.array_equal(found[3].values, blocks[3].values)


def test_latched_topics_are_offered_transient_local(tmp_path):
    with RecordingWriter(tmp_path / 'a.mcap') as writer:
        writer.write_test_point(TestPoint(id='a', start_ns=1))
    with open_recording(tmp_path / 'a.mcap') as recording:
        (profile,) = yaml.safe_load(recording.info.topics[0].qos)
    assert profile['durability'] == 'transient_local'
    assert profile['reliability'] == 'reliable'
    assert profile['depth'] == 1
    assert profile['lifespan'] == {'sec': 9223372036, 'nsec': 854775807}
    (stream,) = yaml.safe_load(Delivery.STREAM.value)
    assert stream['durability'] == 'volatile'


def test_definitions_carry_comments_and_all_they_depend_on():
    text = schema_text('impactscope/msg/ImpactEvent')
    sections = text.split('=' * 80 + '\nMSG: ')
    assert {s.splitlines()[0] for s in sections[1:]} == {
        'std_msgs/Header',
        'builtin_interfaces/Time',
        'impactscope/Channel',
        'impactscope/Contact',
        'impactscope/TestPoint',
    }
    assert '# per channel' in text
    standard = schema_text('geometry_msgs/msg/WrenchStamped')
    assert 'MSG: geometry_msgs/Vector3\n' in standard


def test_messages_reach_the_file_without_close(bench, tmp_path):
    path = tmp_path / 'a.mcap'
    writer = RecordingWriter(path, flush_interval=0.1)
    writer.write_block(bench.block())
    for _ in range(100):
        time.sleep(0.05)
        with open_recording(path, tolerate_damage=True) as recording:
            if recording.info.message_count:
                assert sum(1 for _ in recording.records()) == 1
                break
    else:
        pytest.fail('nothing was flushed in 5 s')
    writer.write_block(bench.block('force', 1))
    writer.flush()
    with open_recording(path, tolerate_damage=True) as recording:
        assert recording.info.message_count == 2
    writer.close()
    writer.close()
    with open_recording(path) as recording:
        assert len(list(recording.records())) == 2


def test_several_threads_write_one_file(bench, tmp_path):
    with RecordingWriter(tmp_path / 'a.mcap', flush_interval=0.01, chunk_size=2000) as writer:

        def work(channel):
            for i in range(200):
                writer.write_block(bench.block(channel, i))

        threads = [threading.Thread(target=work, args=(c,)) for c in ('force', 'a', 'b')]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    with open_recording(tmp_path / 'a.mcap') as recording:
        assert [t.count for t in recording.info.topics] == [200, 200, 200]
        assert sum(1 for _ in recording.records()) == 600


def test_what_cannot_be_written_is_refused(bench, tmp_path):
    path = tmp_path / 'a.mcap'
    writer = RecordingWriter(path)
    with pytest.raises(InputError, match='no absolute ROS topic'):
        writer.write('force', BLOCK_TYPE, b'', 0)
    with pytest.raises(InputError, match='no absolute ROS topic'):
        writer.write('/a//b', BLOCK_TYPE, b'', 0)
    with pytest.raises(InputError, match='-1 ns'):
        writer.write('/force', BLOCK_TYPE, b'', -1)
    with pytest.raises(RecordingError, match='acme/msg/Gizmo'):
        writer.write('/gizmo', 'acme/msg/Gizmo', b'', 0)
    writer.write_block(bench.block())
    with pytest.raises(InputError, match='carries impactscope/msg/SampleBlock'):
        writer.write('/force', 'std_msgs/msg/Empty', b'', 0)
    with pytest.raises(InputError, match='does not fit'):
        writer.write_block(
            SampleBlock('force', 'N', 1.0, 0, -5, np.empty(0, np.float32), received_ns=1)
        )
    with pytest.raises(InputError, match='does not fit'):
        writer.write_test_point(TestPoint(id='a', repetition=-1, start_ns=1))
    writer.close()
    with pytest.raises(RecordingError, match='is closed'):
        writer.write_block(bench.block())
    with pytest.raises(RecordingError, match='exists already'):
        RecordingWriter(path)
    with pytest.raises(RecordingError, match='cannot be made'):
        RecordingWriter(tmp_path / 'no' / 'such' / 'a.mcap')
    for options in ({'compression': 'gzip'}, {'flush_interval': -1.0}, {'chunk_size': 0}):
        with pytest.raises(ConfigurationError, match=next(iter(options))):
            RecordingWriter(tmp_path / 'b.mcap', **options)
    RecordingWriter(path, overwrite=True).close()


LIMITED = """
import resource, sys, time
import numpy as np
from impactscope.errors import RecordingError
from impactscope.recordings import RecordingWriter
from impactscope.records import SampleBlock
writer = RecordingWriter(sys.argv[1], flush_interval=0.05, compression='none')
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    for i in range(1000):
        block = SampleBlock('force', 'N', 6400.0, i, 64 * i, np.zeros(64, np.float32))
        writer.write_block(block)
        time.sleep(0.002)
except RecordingError as error:
    print(error)
try:
    writer.close()
except RecordingError as error:
    print(error)
"""


def test_full_disk_is_told_and_what_is_written_stays(tmp_path):
    """The flushing thread meets the error; the caller hears of it at the next message."""
    done = subprocess.run(
        [sys.executable, '-c', LIMITED, str(tmp_path / 'a.mcap')],
        capture_output=True,
        text=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    assert done.stdout.splitlines() == ["'a.mcap' cannot be written: File too large"] * 2
    assert done.stderr == ''
    with open_recording(tmp_path / 'a.mcap', tolerate_damage=True) as recording:
        assert sum(1 for _ in recording.records()) > 10
    with pytest.raises(RecordingError, match="'full' cannot be written"):
        RecordingWriter('/dev/full', overwrite=True)


def test_any_known_type_can_be_written(tmp_path):
    store = reference_store()
    name = 'std_msgs/msg/String'
    data = bytes(store.serialize_cdr(store.types[name]('hostile <script> \x00'), name))
    with RecordingWriter(tmp_path / 'a.mcap') as writer:
        writer.write('/note', name, data, 1, 2)
    with open_recording(tmp_path / 'a.mcap') as recording:
        (raw,) = recording.raw()
        assert (raw.topic, raw.type, raw.log_ns, raw.publish_ns, raw.data) == (
            '/note', name, 1, 2, data,
        )  # fmt: skip
        assert struct.unpack_from('<I', raw.data, 4)[0] == len('hostile <script> \x00') + 1
