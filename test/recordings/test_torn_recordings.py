"""Recordings that are cut, altered or left by a killed writer."""

import os
import signal
import sqlite3
import struct
import subprocess
import sys
import time
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from impactscope.errors import ImpactscopeError, RecordingError, TornRecordingError
from impactscope.recordings import RecordingWriter, open_recording

COMPRESSIONS = ['none', 'lz4', 'zstd']


class Database(bytes):
    def __repr__(self):
        return 'database'


class Files(dict):
    def __repr__(self):
        return 'files'


@pytest.fixture(scope='module')
def sound(bench, tmp_path_factory):
    """By compression: bytes of a recording, and per chunk (start, end, keys of its messages)."""
    files = Files()
    folder = tmp_path_factory.mktemp('sound')
    for compression in COMPRESSIONS:
        path = folder / f'{compression}.mcap'
        with RecordingWriter(path, compression=compression, chunk_size=3000) as writer:
            for i, block in enumerate(bench.blocks(30)):
                writer.write_block(block, log_ns=bench.start_ns + i)
        data = path.read_bytes()
        delivered, _ = read(path)
        chunks, position, left = [], 8, list(delivered)
        while position < len(data) - 8:
            size = 9 + struct.unpack_from('<Q', data, position + 1)[0]
            if data[position] == 6:
                end_ns = struct.unpack_from('<Q', data, position + 17)[0]
                mine = [key for key in left if key[1] <= end_ns]
                left = left[len(mine) :]
                chunks.append((position, position + size, mine))
            position += size
        assert not left
        assert len(chunks) > 5
        files[compression] = (data, chunks)
    return files


def read(path):
    """Keys of what was delivered, and the error at the end."""
    keys = []
    try:
        with open_recording(path) as recording:
            for topic, log_ns, record in recording.records():
                keys.append((topic, log_ns, record.first_index, record.values.tobytes()))
    except ImpactscopeError as error:
        return keys, error
    return keys, None


@pytest.mark.parametrize('compression', COMPRESSIONS)
@given(st.data())
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_truncation_loses_nothing_before_it(sound, tmp_path, compression, data):
    content, chunks = sound[compression]
    cut = data.draw(st.integers(0, len(content) - 1))
    path = tmp_path / 'cut.mcap'
    path.write_bytes(content[:cut])
    keys, error = read(path)
    everything = [key for _, _, mine in chunks for key in mine]
    whole = [key for _, end, mine in chunks if end <= cut for key in mine]
    assert isinstance(error, RecordingError)
    assert keys == everything[: len(keys)]
    assert len(keys) >= len(whole)
    if cut >= 30:
        assert isinstance(error, TornRecordingError) or not whole
    if isinstance(error, TornRecordingError):
        assert 'at byte' in str(error)


def test_torn_uncompressed_chunk_gives_its_whole_messages(sound, tmp_path):
    content, chunks = sound['none']
    start, end, mine = chunks[-1]
    (tmp_path / 'a').write_bytes(content[: end - 1])
    keys, error = read(tmp_path / 'a')
    before = sum(len(m) for s, _, m in chunks if s < start)
    assert len(keys) == before + len(mine) - 1
    assert f'at byte {start}' in str(error)


@pytest.mark.parametrize('compression', COMPRESSIONS)
@given(st.data())
@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_altered_bytes_lose_nothing_before_them_and_invent_nothing(
    sound, tmp_path, compression, data
):
    content, chunks = sound[compression]
    at = data.draw(st.integers(8, len(content) - 1))
    size = data.draw(st.integers(1, 12))
    junk = data.draw(st.binary(min_size=size, max_size=size))
    altered = content[:at] + junk + content[at + size :]
    (tmp_path / 'a').write_bytes(altered)
    keys, _ = read(tmp_path / 'a')
    everything = {key for _, _, mine in chunks for key in mine}
    whole = {key for _, end, mine in chunks if end <= at for key in mine}
    assert whole <= set(keys)
    if chunks[0][0] <= at:
        assert set(keys) <= everything
    assert len(keys) == len(set(keys))


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_garbage_in_the_middle_is_stepped_over(sound, tmp_path, compression):
    content, chunks = sound[compression]
    start, end, mine = chunks[2]
    for junk in (b'\xff' * (end - start), b'\0' * (end - start), os.urandom(end - start)):
        (tmp_path / 'a').write_bytes(content[:start] + junk + content[end:])
        keys, error = read(tmp_path / 'a')
        lost = {key for _, _, m in chunks for key in m} - set(keys)
        assert isinstance(error, TornRecordingError)
        assert str(start) in str(error)
        assert set(mine) <= lost
        if junk[0] in (0, 255) and junk == junk[:1] * len(junk):
            assert lost == set(mine)


def test_damage_can_be_tolerated(sound, tmp_path):
    content, chunks = sound['zstd']
    start, _, mine = chunks[3]
    altered = bytearray(content)
    altered[start + 100] ^= 0xFF
    (tmp_path / 'a').write_bytes(altered)
    with open_recording(tmp_path / 'a', tolerate_damage=True) as recording:
        assert not recording.damage
        count = sum(1 for _ in recording.records())
        (damage,) = recording.damage
    assert damage.offset == start
    assert 'lost' in damage.reason
    assert count == sum(len(m) for _, _, m in chunks) - len(mine)


def chunk(uncompressed_size, compression, records, size=None):
    body = struct.pack('<QQQII', 1, 2, uncompressed_size, 0, len(compression)) + compression
    body += struct.pack('<Q', len(records) if size is None else size) + records
    return b'\x06' + struct.pack('<Q', len(body)) + body


@pytest.mark.parametrize(
    'record',
    [
        chunk(1 << 62, b'zstd', b'abc'),
        chunk(1 << 29, b'zstd', b'abc'),
        chunk(1 << 29, b'lz4', b'abc'),
        chunk(10, b'brotli', b'abc'),
        chunk(10, b'', b'abc', size=1 << 63),
        chunk(3, b'', b'abc'),
        chunk(9, b'', b'\x05' + b'\xff' * 8),
        b'\x06' + b'\xff' * 60,
        b'\x05' + struct.pack('<Q', 3) + b'abc',
        b'\x05' + struct.pack('<Q', 22) + b'\xff' * 22,
        b'\x0c' + struct.pack('<Q', 8) + b'\xff' * 8,
        b'\x04' + struct.pack('<Q', 4) + b'\x01\0\x01\0',
        b'\x42' * 40,
    ],
)
def test_absurd_records_are_noted_and_bounded(sound, tmp_path, record):
    content, chunks = sound['none']
    at = chunks[1][0]
    (tmp_path / 'a').write_bytes(content[:at] + record + content[at:])
    keys, error = read(tmp_path / 'a')
    assert isinstance(error, TornRecordingError)
    assert set(keys) >= set(chunks[0][2])


def test_compression_bomb_is_stopped_at_what_it_states(sound, tmp_path):
    import zstandard

    content, chunks = sound['none']
    bomb = zstandard.compress(bytes(1 << 26))
    at = chunks[1][0]
    record = chunk(1000, b'zstd', bomb)
    (tmp_path / 'a').write_bytes(content[:at] + record + content[at:])
    with open_recording(tmp_path / 'a', tolerate_damage=True) as recording:
        assert sum(1 for _ in recording.records()) == sum(len(m) for _, _, m in chunks)
        assert 'more than it states' in ' '.join(map(str, recording.damage))


def test_malformed_message_in_a_sound_file_is_named(bench, tmp_path):
    from impactscope.recordings.definitions import BLOCK_TYPE

    wrench = 'geometry_msgs/msg/WrenchStamped'
    with RecordingWriter(tmp_path / 'a.mcap') as writer:
        writer.write_block(bench.block('force', 0))
        writer.write('/force', BLOCK_TYPE, b'\0\1\0\0abc', bench.start_ns + 11_000_000)
        writer.write_block(bench.block('force', 1))
        for i in range(3):
            data = bench.stamped(i, [1.0] * 6)
            writer.write('/w', wrench, data if i != 1 else data[:-1], i)
    records, values = [], 0
    with open_recording(tmp_path / 'a.mcap', tolerate_damage=True) as recording:
        for topic, _, record in recording.records():
            records.append(topic)
            values += len(record.values) if topic == '/w' else 0
        assert len(recording.damage) == 2
        assert '/force' in str(recording.damage)
        assert str(bench.start_ns + 11_000_000) in str(recording.damage)
    assert records.count('/force') == 2
    assert values == 2


def test_message_count_is_held_against_the_statistics(sound, tmp_path):
    """A chunk whose kind is altered into a private one would be skipped without a word."""
    content, chunks = sound['none']
    altered = bytearray(content)
    altered[chunks[2][0]] = 0x86
    (tmp_path / 'a').write_bytes(altered)
    _, error = read(tmp_path / 'a')
    assert 'messages are stated' in str(error)


def test_altered_summary_is_not_believed(sound, tmp_path):
    content, _ = sound['zstd']
    start = struct.unpack_from('<Q', content, len(content) - 8 - 20)[0]
    at = content.index(b'/force', start)
    altered = content[:at] + b'/farce' + content[at + 6 :]
    (tmp_path / 'a').write_bytes(altered)
    keys, error = read(tmp_path / 'a')
    assert {key[0] for key in keys} == {'/force', '/acceleration/plate'}
    assert 'checksum' in str(error)
    crc = zlib.crc32(altered[start:-12])
    assert struct.unpack_from('<I', content, len(content) - 12)[0] != crc


def test_last_part_of_a_split_recording_may_be_empty(bench, tmp_path):
    folder = tmp_path / 'bag'
    folder.mkdir()
    bench.write(folder / 'bag_0.mcap', bench.blocks(3))
    (folder / 'bag_1.mcap').write_bytes(b'')
    keys, error = read(folder)
    assert len(keys) == 6
    assert 'bag_1.mcap' in str(error)


@pytest.fixture(scope='module')
def database(bench, tmp_path_factory):
    """Bytes of a .db3 of 60 messages as rosbag2 lays it out."""
    from impactscope.recordings.block_codec import encode_block
    from impactscope.recordings.definitions import BLOCK_TYPE

    path = tmp_path_factory.mktemp('db') / 'a.db3'
    connection = sqlite3.connect(path)
    connection.executescript(
        'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
        'serialization_format TEXT, offered_qos_profiles TEXT);'
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
        'data BLOB);'
        'CREATE INDEX timestamp_idx ON messages (timestamp ASC);'
    )
    connection.execute(f"INSERT INTO topics VALUES (1, '/force', '{BLOCK_TYPE}', 'cdr', '')")
    for i in range(60):
        block = bench.block('force', i)
        row = (block.received_ns, encode_block(block))
        connection.execute('INSERT INTO messages VALUES (NULL, 1, ?, ?)', row)
    connection.commit()
    connection.close()
    return Database(path.read_bytes())


def test_schema_that_is_no_text(database, tmp_path):
    (tmp_path / 'a.db3').write_bytes(database[:3749] + b'\x80' + database[3750:])
    _, error = read(tmp_path / 'a.db3')
    assert isinstance(error, RecordingError)


@given(st.data())
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_damaged_databases_never_raise_anything_else(database, tmp_path, data):
    path = tmp_path / 'a.db3'
    path.write_bytes(database)
    keys, error = read(path)
    assert error is None
    assert [key[2] for key in keys] == [64 * i for i in range(60)]
    altered = bytearray(database)
    if data.draw(st.booleans()):
        altered = altered[: data.draw(st.integers(1, len(altered)))]
    for _ in range(data.draw(st.integers(0, 5))):
        altered[data.draw(st.integers(0, len(altered) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(altered)
    read(path)


WRITER = """
import sys, time, numpy as np
from impactscope.recordings import RecordingWriter
from impactscope.records import SampleBlock
writer = RecordingWriter(sys.argv[1], compression=sys.argv[2], flush_interval=0.2)
i = 0
while True:
    now = time.time_ns()
    block = SampleBlock('force', 'N', 6400.0, now, 64 * i, np.zeros(64, np.float32))
    writer.write_block(block, log_ns=now)
    sys.stdout.write(f'{i}\\n')
    sys.stdout.flush()
    i += 1
    time.sleep(0.005)
"""


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_killed_writer_loses_less_than_a_second(tmp_path, compression):
    path = tmp_path / 'killed.mcap'
    process = subprocess.Popen(
        [sys.executable, '-c', WRITER, str(path), compression],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    for _ in range(150):
        process.stdout.readline()
    time.sleep(0.05)
    killed_ns = time.time_ns()
    process.send_signal(signal.SIGKILL)
    written = 149 + len(process.stdout.read().splitlines())
    process.wait()
    process.stdout.close()
    keys, error = read(path)
    assert isinstance(error, TornRecordingError)
    indices = np.array([key[2] for key in keys]) // 64
    assert np.array_equal(indices, np.arange(len(indices)))
    assert written - len(indices) < 200  # 1 s at 5 ms a block
    assert killed_ns - keys[-1][1] < 1_000_000_000


def test_killed_recording_is_recovered_by_the_mcap_library(tmp_path, bench):
    from mcap.reader import NonSeekingReader

    path = bench.write(tmp_path / 'a.mcap', bench.blocks(30), chunk_size=3000)
    content = path.read_bytes()
    end = content.rindex(b'\x0f' + struct.pack('<Q', 4))  # before the closing records
    path.write_bytes(content[:end])
    with path.open('rb') as file:
        found = 0
        try:
            for _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                found += 1
        except Exception:
            pass
    assert found == 60
    assert len(read(path)[0]) == 60
