"""How fast a recording is analysed from end to end, and how much memory that takes.

Two kinds of recordings, made here: blocks of four channels at 51.2 kS/s, and one message a
sample (a wrench and three accelerations at 1 kHz, uncompressed). Beside them, in the same run,
rosbags' AnyReader that only deserialises the same file.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import live
import numpy as np
from machine import describe
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from impactscope.analysis import analyse
from impactscope.recordings import RecordingWriter, open_recording

SAMPLE_RATE = 1000.0  # Hz
START_NS = 1_704_067_200 * 10**9


def make_single_samples(path: Path, duration: float) -> None:
    """Four topics with one message a sample: taps every 1.5 s and their ring-down."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    time_type = types['builtin_interfaces/msg/Time']
    header = types['std_msgs/msg/Header']
    vector = types['geometry_msgs/msg/Vector3']
    wrench = types['geometry_msgs/msg/WrenchStamped'], types['geometry_msgs/msg/Wrench']
    accel = types['geometry_msgs/msg/AccelStamped'], types['geometry_msgs/msg/Accel']
    count = round(duration * SAMPLE_RATE)
    t = np.arange(count) / SAMPLE_RATE
    since = np.maximum(t - 1.5, 0.0) % 1.5
    ringing = 60.0 * np.exp(-14.0 * since) * np.sin(202.0 * since) * (t > 1.5)
    noise = np.random.default_rng(1).normal(0.0, 0.2, (4, count))
    zero = vector(0.0, 0.0, 0.0)
    topics = [('/ft/force', wrench)]
    topics += [(f'/acceleration/{name}', accel) for name in ('plate', 'impactor', 'base')]
    with RecordingWriter(path, compression='none', flush_interval=0) as writer:
        for index in range(count):
            stamp_ns = START_NS + round(index / SAMPLE_RATE * 1e9)
            head = header(time_type(*divmod(stamp_ns, 10**9)), 'sensor')
            for row, (topic, (kind, body)) in enumerate(topics):
                value = ringing[index] * (row < 2) + noise[row, index]
                message = kind(head, body(vector(0.0, 0.0, float(value)), zero))
                name = kind.__msgtype__
                writer.write(topic, name, bytes(store.serialize_cdr(message, name)), stamp_ns)


def deserialise_all(path: Path) -> float:
    """Seconds that AnyReader takes to deserialise every message."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with open_recording(path) as recording:
        for topic in recording.info.topics:
            if topic.type.startswith('impactscope/'):
                store.register(get_types_from_msg(topic.definition, topic.type))
    started = time.perf_counter()
    with AnyReader([path], default_typestore=store) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
    return time.perf_counter() - started


MEMORY = """
import json, sys, threading, time
from impactscope.analysis import analyse
def anonymous():
    for line in open('/proc/self/status'):
        if line.startswith('RssAnon'):
            return int(line.split()[1]) / 1024
analyse(sys.argv[1], keep_samples=False)
peak = [0.0]
def watch():
    while True:
        peak[0] = max(peak[0], anonymous())
        time.sleep(0.002)
before = anonymous()
threading.Thread(target=watch, daemon=True).start()
analyse(sys.argv[2], keep_samples=False)
print(json.dumps([before, peak[0]]))
"""


def peak_memory(warm: Path, path: Path) -> float:
    """Peak anonymous memory in MB of a fresh process that analyses a file."""
    done = subprocess.run(
        [sys.executable, '-c', MEMORY, str(warm), str(path)],
        capture_output=True,
        text=True,
        check=True,
    )
    return float(json.loads(done.stdout)[1])


def main(argv: list[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='15 s of data instead of 60 s')
    parser.add_argument('--trials', type=int, default=5)
    given = parser.parse_args(argv)
    duration = 15.0 if given.quick else 60.0
    print(describe())
    with tempfile.TemporaryDirectory() as folder:
        blocks, samples = Path(folder) / 'blocks.mcap', Path(folder) / 'samples.mcap'
        rare = Path(folder) / 'rare.mcap'
        live.make_recording(rare, duration, 0.02, interval=5.0)
        live.make_recording(blocks, duration, 0.02, interval=1.5)
        make_single_samples(samples, duration)
        for title, path, wanted in (
            ('blocks, 4 channels of 51.2 kS/s, a blow every 5 s', rare, 100),
            ('the same, a blow every 1.5 s', blocks, 100),
            ('one message a sample, 4 topics of 1 kHz', samples, 50),
        ):
            events = len(analyse(path).events)  # loads compiled code, too
            times, cpu = [], []
            for _ in range(given.trials):
                started, used = time.perf_counter(), time.process_time()
                analyse(path)
                times.append(time.perf_counter() - started)
                cpu.append(time.process_time() - used)
            peer = deserialise_all(path)
            print(
                f'{title}: {duration:g} s of data, {events} blows, in '
                f'{np.median(times):.2f} s [{min(times):.2f}, {max(times):.2f}]: '
                f'{duration / np.median(times):.0f} times real time (wanted {wanted}), by '
                f'processor time {duration / np.median(cpu):.0f}; AnyReader, deserialising alone: '
                f'{duration / peer:.0f}'
            )
        short, long = Path(folder) / 'short.mcap', Path(folder) / 'long.mcap'
        live.make_recording(short, duration / 4, 0.02)
        live.make_recording(long, 2 * duration, 0.02)
        for path in (short, long):
            print(
                f'peak anonymous memory, {path.stat().st_size / 1e6:.0f} MB recording: '
                f'{peak_memory(short, path):.0f} MB'
            )
    return 0


if __name__ == '__main__':
    sys.exit(main())
