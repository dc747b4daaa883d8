"""Reading recordings: times real time, beside rosbags' AnyReader on the same file."""

from __future__ import annotations

import argparse
import os
import statistics
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from impactscope.recordings import RecordingWriter, SampleRun, open_recording
from impactscope.records import SampleBlock

START_NS = 1_700_000_000_000_000_000
CHANNELS = ('force', 'acceleration.plate', 'acceleration.impactor', 'acceleration.base')
TYPES = ('WrenchStamped', 'AccelStamped', 'AccelStamped', 'AccelStamped')


def write_blocks(path: Path, seconds: float, compression: str) -> None:
    """Four channels of 51.2 kS/s in blocks of 20 ms."""
    rng = np.random.default_rng(1)
    with RecordingWriter(path, compression=compression, flush_interval=0) as writer:
        for i in range(round(seconds / 0.02)):
            for channel in CHANNELS:
                stamp_ns = START_NS + i * 20_000_000
                values = rng.normal(size=1024).astype(np.float32)
                writer.write_block(
                    SampleBlock(
                        channel,
                        'N' if channel == 'force' else 'm/s^2',
                        51_200.0,
                        stamp_ns,
                        i * 1024,
                        values,
                        received_ns=stamp_ns + 20_000_000,
                        frame_id='plate',
                    )
                )


def write_samples(path: Path, seconds: float, compression: str) -> None:
    """Four topics of 1 kHz, one sample a message."""
    frame = b'plate\0'
    body = struct.Struct(f'<4siII{len(frame)}s6x6d')
    with RecordingWriter(path, compression=compression, flush_interval=0) as writer:
        for i in range(round(seconds * 1000)):
            stamp_ns = START_NS + i * 1_000_000
            second, nanosecond = divmod(stamp_ns, 1_000_000_000)
            data = body.pack(
                b'\0\1\0\0', second, nanosecond, len(frame), frame, i, 1.0, 2.0, 3.0, 4.0, 5.0
            )
            for channel, kind in zip(CHANNELS, TYPES, strict=True):
                topic = '/' + channel.replace('.', '/')
                writer.write(topic, f'geometry_msgs/msg/{kind}', data, stamp_ns + 200_000)


def read_here(path: Path) -> int:
    """Samples that the package's reader delivers."""
    count = 0
    with open_recording(path) as recording:
        for _, _, record in recording.records():
            if isinstance(record, SampleBlock):
                count += record.values.size
            elif isinstance(record, SampleRun):
                count += len(record.values)
    return count


def read_anyreader(path: Path) -> int:
    """Samples that AnyReader delivers, deserialised."""
    count = 0
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            values = getattr(message, 'values', None)
            count += len(values) if values is not None else 1
    return count


def measure(read: Callable[[Path], int], path: Path, trials: int) -> tuple[int, list[float]]:
    """Samples and the seconds that each trial took, after one that warms up."""
    count = read(path)
    times = []
    for _ in range(trials):
        start = time.perf_counter()
        if read(path) != count:
            raise RuntimeError(f'{read.__name__} did not deliver the same twice')
        times.append(time.perf_counter() - start)
    return count, times


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='10 s instead of 60 s of recording')
    parser.add_argument('--trials', type=int, default=7)
    options = parser.parse_args(argv)
    seconds = 10.0 if options.quick else 60.0
    print(
        f'reading {seconds:g} s of recording, four channels; median [least, most] of '
        f'{options.trials} trials, times real time; {os.cpu_count()} cores, '
        f'Python {sys.version.split()[0]}, NumPy {np.__version__}'
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, write, expected in (
            ('blocks, 51.2 kS/s', write_blocks, 4 * 51_200 * seconds),
            ('one sample a message, 1 kHz', write_samples, 4 * 1_000 * seconds),
        ):
            for compression in ('none', 'lz4', 'zstd'):
                path = Path(folder) / f'{compression}_{write.__name__}.mcap'
                write(path, seconds, compression)
                medians = {}
                for reader in (read_here, read_anyreader):
                    slow = reader is read_anyreader and write is write_samples
                    count, times = measure(reader, path, 2 if slow else options.trials)
                    if count != round(expected):
                        raise RuntimeError(f'{reader.__name__}: {count}, not {expected:g} samples')
                    medians[reader] = statistics.median(times)
                    print(
                        f'  {name}, chunks {compression:4} {path.stat().st_size / 1e6:6.1f} MB  '
                        f'{reader.__name__:14} {seconds / medians[reader]:7.1f} '
                        f'[{seconds / max(times):.1f}, {seconds / min(times):.1f}]'
                        f'{" (2 trials)" if slow else ""}'
                    )
                ratio = medians[read_anyreader] / medians[read_here]
                print(f'    {ratio:.1f} times AnyReader')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
