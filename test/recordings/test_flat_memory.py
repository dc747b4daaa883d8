"""Peak anonymous memory does not grow with the length of a recording."""

import os
import subprocess
import sys

import pytest

from impactscope.recordings import RecordingWriter
from impactscope.recordings.block_codec import encode_block
from impactscope.recordings.definitions import BLOCK_TYPE

READ = """
import sys, threading
from impactscope.recordings import open_recording
def anonymous():
    for line in open('/proc/self/smaps_rollup'):
        if line.startswith('Anonymous:'):
            return int(line.split()[1])
peak = resident = 0
with open_recording(sys.argv[1]) as recording:
    for i, (_, _, record) in enumerate(recording.records()):
        if i % 10 == 0:
            peak = max(peak, anonymous())
print(max(peak, anonymous()))
"""


def peak_kilobytes(path):
    done = subprocess.run(
        [sys.executable, '-c', READ, str(path)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    return int(done.stdout)


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_ten_times_the_recording_takes_no_more_memory(bench, tmp_path, compression):
    data = encode_block(bench.block('force', 0, count=60_000, rate=51_200.0))
    sizes = {}
    for count in (80, 800):  # 19 and 192 MB of samples
        path = tmp_path / f'{count}.mcap'
        with RecordingWriter(path, compression=compression, flush_interval=0) as writer:
            for i in range(count):
                writer.write('/force', BLOCK_TYPE, data, i)
        if not sizes:
            peak_kilobytes(path)  # compiled code is cached from here on
        sizes[count] = (len(data) * count, 1024 * peak_kilobytes(path))
        path.unlink()
    growth = sizes[800][1] - sizes[80][1]
    assert growth < 0.03 * (sizes[800][0] - sizes[80][0])
