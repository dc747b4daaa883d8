"""What recordings deliver: order, types, storages, definitions of other versions."""

import struct

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter

from impactscope.errors import MissingChannelError, RecordingError
from impactscope.recordings import (
    COLUMNS,
    Reading,
    RecordingWriter,
    SampleRun,
    file_sha256,
    open_recording,
)
from impactscope.recordings.block_codec import encode_block
from impactscope.recordings.definitions import BLOCK_TYPE, reference_store, schema_text
from impactscope.records import ContactKind, SampleBlock, TestPoint

WRENCH = 'geometry_msgs/msg/WrenchStamped'


def read(path, topics=None):
    with open_recording(path) as recording:
        return list(recording.records(topics))


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_blocks_come_back_in_order_of_time(bench, tmp_path, compression):
    blocks = bench.blocks(40)
    path = bench.write(tmp_path / 'a.mcap', blocks, compression=compression, chunk_size=4096)
    found = read(path)
    assert [item[1] for item in found] == sorted(b.received_ns for b in blocks)
    assert len(found) == len(blocks)
    for block, (topic, log_ns, record) in zip(blocks, found, strict=True):
        assert bench.same(block, record)
        assert topic == '/' + block.channel.replace('.', '/')
        assert log_ns == block.received_ns
    assert [i[0] for i in read(path, ['/force'])] == ['/force'] * 40


def test_info_tells_topics_span_and_provenance(bench, tmp_path):
    blocks = bench.blocks(5)
    path = bench.write(tmp_path / 'a.mcap', blocks, metadata={'provenance': {'origin': 'here'}})
    with open_recording(path) as recording:
        info = recording.info
    assert [(t.name, t.count, t.reading) for t in info.topics] == [
        ('/acceleration/plate', 5, Reading.BLOCKS),
        ('/force', 5, Reading.BLOCKS),
    ]
    assert (info.start_ns, info.end_ns) == (blocks[0].received_ns, blocks[-1].received_ns)
    assert info.provenance == {'origin': 'here'}
    assert info.message_count == 10
    assert not info.damage
    assert 'transient_local' not in info.topics[0].qos
    assert len(file_sha256(path)) == 64


def test_overlapping_chunks_are_merged(bench, tmp_path):
    """A writer that stores one channel after the other: every chunk of both overlaps."""
    first = [bench.block('force', i) for i in range(50)]
    second = [bench.block('acceleration.plate', i) for i in range(50)]
    path = bench.write(tmp_path / 'a.mcap', first + second, chunk_size=2000)
    found = read(path)
    times = [log_ns for _, log_ns, _ in found]
    assert times == sorted(times)
    assert len(found) == 100


def test_messages_outside_of_chunks_and_backward_steps(bench, tmp_path):
    path = tmp_path / 'a.mcap'
    blocks = bench.blocks(6)
    with path.open('wb') as file:
        writer = Writer(file, use_chunking=False, index_types=IndexType.NONE)
        writer.start(profile='ros2')
        schema = writer.register_schema(BLOCK_TYPE, 'ros2msg', schema_text(BLOCK_TYPE).encode())
        channel = writer.register_channel('/all', 'cdr', schema)
        for block in reversed(blocks):
            writer.add_message(channel, block.received_ns, encode_block(block), 1)
        writer.finish()
    times = [item[1] for item in read(path)]
    assert times == sorted(b.received_ns for b in blocks)


@pytest.mark.parametrize('storage', [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_rosbag2_folders_written_by_rosbags(bench, tmp_path, storage):
    store = reference_store()
    blocks = bench.blocks(20)
    folder = tmp_path / 'bag'
    with BagWriter(folder, version=9, storage_plugin=storage) as writer:
        connections = {
            c: writer.add_connection('/' + c.replace('.', '_'), BLOCK_TYPE, typestore=store)
            for c in ('force', 'acceleration.plate')
        }
        for block in blocks:
            writer.write(connections[block.channel], block.received_ns, encode_block(block))
    data = next(f for f in folder.iterdir() if f.suffix in ('.db3', '.mcap'))
    renamed = tmp_path / 'no_suffix_at_all'
    renamed.write_bytes(data.read_bytes())
    for path in (folder, data, renamed):
        found = read(path)
        assert all(bench.same(b, f[2]) for b, f in zip(blocks, found, strict=True))
    (folder / 'metadata.yaml').unlink()
    with open_recording(folder) as recording:
        assert 'metadata.yaml is missing' in recording.info.notes[0]
        assert len(list(recording.records())) == 40


def test_split_recording_is_one_stream_in_natural_order(bench, tmp_path):
    folder = tmp_path / 'bag'
    folder.mkdir()
    names = []
    for i in range(11):
        names.append(f'bag_{i}.mcap')
        bench.write(folder / names[-1], [bench.block('force', i)])
    for described in (False, True):
        if described:
            listing = ''.join(f'  - {n}\n' for n in names)
            text = f'rosbag2_bagfile_information:\n  relative_file_paths:\n{listing}'
            (folder / 'metadata.yaml').write_text(text)
        found = read(folder)
        assert [item[2].first_index for item in found] == [64 * i for i in range(11)]


def test_runs_of_single_samples(bench, tmp_path):
    rng = np.random.default_rng(3)
    path = tmp_path / 'a.mcap'
    count = 700
    values = rng.normal(size=(count, 6))
    imu = rng.normal(size=(count, 37))
    with RecordingWriter(path, chunk_size=8000, flush_interval=0) as writer:
        for i in range(count):
            stamp = bench.start_ns + i * 1_000_000
            frame = 'plate' if i < 500 else 'a_longer_frame'
            writer.write(
                '/wrench', WRENCH, bench.stamped(stamp, list(values[i]), frame), stamp + 7
            )
            data = bench.stamped(stamp, list(imu[i]), 'imu')
            writer.write('/imu', 'sensor_msgs/msg/Imu', data, stamp + 9)
    found = read(path)
    runs = [r for t, _, r in found if t == '/wrench']
    assert all(isinstance(r, SampleRun) for r in runs)
    assert len(runs) < 50
    assert np.array_equal(np.concatenate([r.values for r in runs]), values)
    stamps = np.concatenate([r.stamps_ns for r in runs])
    assert np.array_equal(stamps, bench.start_ns + np.arange(count) * 1_000_000)
    assert np.array_equal(np.concatenate([r.log_ns for r in runs]), stamps + 7)
    assert sum(len(r.values) for r in runs if r.frame_id == 'plate') == 500
    assert {r.frame_id for r in runs} == {'plate', 'a_longer_frame'}
    assert runs[0].columns[0] == 'wrench.force.x'
    got = np.concatenate([r.values for t, _, r in found if t == '/imu'])
    assert np.array_equal(got, imu[:, [25, 26, 27, 13, 14, 15]])


@pytest.mark.parametrize('type_name', sorted(COLUMNS))
@pytest.mark.parametrize('little_endian', [True, False])
def test_runs_agree_with_deserialised_messages(bench, tmp_path, type_name, little_endian):
    """Column names are paths in the message: hold the compiled walk against rosbags."""
    store = reference_store()
    size = {'sensor_msgs/msg/Imu': 37, 'geometry_msgs/msg/PointStamped': 3}.get(type_name, 6)
    path = tmp_path / 'a.mcap'
    with RecordingWriter(path, flush_interval=0) as writer:
        for i in range(5):
            doubles = [10.0 * i + k for k in range(size)]
            message = store.deserialize_cdr(bench.stamped(i, doubles), type_name)
            data = bytes(store.serialize_cdr(message, type_name, little_endian=little_endian))
            writer.write('/a', type_name, data, i)
    with open_recording(path) as recording:
        (run,) = [r for _, _, r in recording.records()]
        messages = [m for _, m in recording.messages('/a')]
    for row, message in zip(run.values, messages, strict=True):
        for value, column in zip(row, run.columns, strict=True):
            part = message
            for name in column.split('.'):
                part = getattr(part, name)
            assert value == part


def test_big_endian_blocks(bench, tmp_path):
    store = reference_store()
    block = bench.block()
    message = store.deserialize_cdr(encode_block(block), BLOCK_TYPE)
    data = bytes(store.serialize_cdr(message, BLOCK_TYPE, little_endian=False))
    with RecordingWriter(tmp_path / 'a.mcap') as writer:
        writer.write('/force', BLOCK_TYPE, data, 5)
    assert bench.same(block, read(tmp_path / 'a.mcap')[0][2])


def write_definition(path, fields, data):
    """A SampleBlock of another version."""
    parts = schema_text(BLOCK_TYPE).split('=' * 80)
    definition = ('=' * 80).join([fields, *parts[1:]])
    with RecordingWriter(path) as writer:
        writer.write('/force', BLOCK_TYPE, data, 5, definition=definition)


def test_older_definition_is_filled_with_defaults(tmp_path):
    fields = 'string channel\nstring unit\nfloat64 sample_rate\nfloat32[] values\n'
    data = b'\0\1\0\0' + struct.pack('<I6sxxI2sxx', 6, b'force\0', 2, b'N\0') + b'\0' * 4
    data += struct.pack('<dI2f', 1000.0, 2, 1.5, -2.5)
    write_definition(tmp_path / 'a.mcap', fields, data)
    block = read(tmp_path / 'a.mcap')[0][2]
    assert (block.channel, block.unit, block.sample_rate) == ('force', 'N', 1000.0)
    assert block.values.tolist() == [1.5, -2.5]
    assert block.device_time_ns == -1
    assert np.isnan(block.range_max)


def test_older_test_point_is_filled_with_defaults(tmp_path):
    data = b'\0\1\0\0' + struct.pack('<I3sxd', 3, b'p1\0', 0.25)
    with RecordingWriter(tmp_path / 'a.mcap') as writer:
        name = 'impactscope/msg/TestPoint'
        fields = 'string id\nfloat64 speed\n'
        writer.write('/test_point', name, data, 5, definition=fields)
    point = read(tmp_path / 'a.mcap')[0][2]
    assert (point.id, point.speed, point.contact) == ('p1', 0.25, ContactKind.UNKNOWN)
    assert np.isnan(point.spring_stiffness)
    assert point.end_ns == 0


def test_newer_definition_keeps_what_is_known(bench, tmp_path):
    own = schema_text(BLOCK_TYPE).split('=' * 80)[0]
    block = bench.block()
    data = encode_block(block) + struct.pack('<I6s', 6, b'extra\0')
    write_definition(tmp_path / 'a.mcap', own + 'string remark\n', data)
    assert bench.same(block, read(tmp_path / 'a.mcap')[0][2])


def test_reordered_definition_is_not_mistaken_for_the_current(bench, tmp_path):
    own = schema_text(BLOCK_TYPE).split('=' * 80)[0]
    lines = [s for s in own.splitlines() if s.startswith(('string channel', 'string unit'))]
    swapped = own.replace(lines[0], 'X').replace(lines[1], lines[0]).replace('X', lines[1])
    write_definition(tmp_path / 'a.mcap', swapped, encode_block(bench.block()))
    block = read(tmp_path / 'a.mcap')[0][2]
    assert (block.channel, block.unit) == ('N', 'force')


def test_test_points_and_results(tmp_path):
    point = TestPoint(
        id='hand 1', body_region='hands_fingers', contact=ContactKind.FREE, repetition=2,
        speed=0.25, spring_stiffness=75_000.0, notes='ünïcode', start_ns=5, end_ns=10**18 + 1,
        spring_stiffness_std=1.0,
    )  # fmt: skip
    store = reference_store()
    result = 'impactscope/msg/Estimate'
    message = store.types[result](2.5, 0.5)
    with RecordingWriter(tmp_path / 'a.mcap') as writer:
        writer.write_test_point(point)
        writer.write('/peak', result, bytes(store.serialize_cdr(message, result)), 7)
    with open_recording(tmp_path / 'a.mcap') as recording:
        assert [r for _, _, r in recording.records()] == [point]
        by_name = {t.name: t for t in recording.info.topics}
        assert 'transient_local' in by_name['/test_point'].qos
        assert by_name['/peak'].reading is Reading.RESULTS
        ((log_ns, found),) = recording.messages('/peak')
        assert (log_ns, found.value, found.std) == (7, 2.5, 0.5)
        raw = list(recording.raw())
        assert [m.log_ns for m in raw] == [7, point.end_ns]
        with pytest.raises(RecordingError, match='/peak'):
            list(recording.records(['/peak']))


def test_unknown_types_and_encodings_are_named_not_read(bench, tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile='ros2')
        schema = writer.register_schema('acme/msg/Gizmo', 'ros2msg', b'int32 a\n')
        gizmo = writer.register_channel('/gizmo', 'cdr', schema)
        schema = writer.register_schema(BLOCK_TYPE, 'ros2msg', schema_text(BLOCK_TYPE).encode())
        good = writer.register_channel('/force', 'cdr', schema)
        json = writer.register_channel('/json', 'json', schema)
        writer.add_message(gizmo, 1, b'\0\1\0\0\7\0\0\0', 1)
        writer.add_message(json, 2, b'{}', 2)
        writer.add_message(good, 3, encode_block(bench.block()), 3)
        writer.finish()
    with open_recording(path) as recording:
        assert [t for t, _, _ in recording.records()] == ['/force']
        reading = {t.name: (t.reading, t.count) for t in recording.info.topics}
        assert reading['/gizmo'] == (Reading.OTHER, 1)
        assert reading['/json'] == (Reading.UNREADABLE, 1)
        assert next(recording.messages('/gizmo'))[1].a == 7
        for topic in ('/gizmo', '/json'):
            with pytest.raises(RecordingError, match=topic):
                list(recording.records([topic]))
        with pytest.raises(RecordingError, match='json'):
            list(recording.messages('/json'))
        with pytest.raises(
            MissingChannelError, match="no topic '/nowhere'; its topics are /force"
        ):
            list(recording.records(['/nowhere']))
        with pytest.raises(TypeError):
            list(recording.records('/force'))


def test_what_is_no_recording_is_refused_in_a_sentence(bench, tmp_path):
    cases = {
        'empty': (b'', 'is empty'),
        'text': (b'time,force\n0,1\n', 'is not a recording'),
        'cut_magic': (b'\x89MCAP', 'is not a recording'),
        'sqlite': (b'SQLite format 3\0', 'cannot be read as a recording'),
    }
    for name, (content, message) in cases.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(RecordingError, match=message) as caught:
            open_recording(tmp_path / name)
        assert repr(name) in str(caught.value)
        assert '\n' not in str(caught.value)
    (tmp_path / 'folder').mkdir()
    with pytest.raises(RecordingError, match="'folder' holds neither"):
        open_recording(tmp_path / 'folder')
    with pytest.raises(RecordingError, match='there is no recording at'):
        open_recording(tmp_path / 'nothing')
    with RecordingWriter(tmp_path / 'bare.mcap'):
        pass
    with (
        open_recording(tmp_path / 'bare.mcap') as recording,
        pytest.raises(RecordingError, match='without any message'),
    ):
        list(recording.records())


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('a: [', 'does not describe'),
        ('[]', 'does not describe'),
        ('rosbag2_bagfile_information: {relative_file_paths: []}', 'names no files'),
        ('rosbag2_bagfile_information: {relative_file_paths: [../x.mcap]}', 'elsewhere'),
        ('rosbag2_bagfile_information: {relative_file_paths: [x.mcap]}', 'missing'),
        (
            'rosbag2_bagfile_information: {relative_file_paths: [x], compression_mode: FILE}',
            'compressed by file',
        ),
    ],
)
def test_hostile_descriptions_of_folders(bench, tmp_path, text, message):
    folder = tmp_path / 'bag'
    folder.mkdir()
    bench.write(tmp_path / 'x.mcap', [bench.block()])
    (folder / 'metadata.yaml').write_text(text)
    with pytest.raises(RecordingError, match=message):
        open_recording(folder)


def test_sqlite_without_the_tables_of_a_recording(tmp_path):
    import sqlite3

    path = tmp_path / 'a.db3'
    with sqlite3.connect(path) as database:
        database.execute('CREATE TABLE t (a)')
    database.close()
    with pytest.raises(RecordingError, match='without the tables'):
        open_recording(path)


def test_delivered_records_outlive_the_recording(bench, tmp_path):
    path = bench.write(tmp_path / 'a.mcap', bench.blocks(3), compression='none')
    with open_recording(path) as recording:
        records = list(recording.records())
    with pytest.raises(RecordingError, match='is closed'):
        next(recording.records())
    recording.close()
    path.unlink()
    assert isinstance(records[0][2], SampleBlock)
    assert records[4][2].values.tolist() == list(range(128, 192))
