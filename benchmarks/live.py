"""The live graph under load: blocks lost, headroom, delay to the verdict, share of the processor.

The drivers run in processes of their own, the analysis in this one, over real DDS. Recordings are
made here: hammer taps on the simulated bench, four channels of 51.2 kS/s each.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import rclpy
from machine import describe
from rclpy.signals import SignalHandlerOptions

from impactscope.inputs import recorded_items
from impactscope.nodes.graph import Bench, BenchOptions
from impactscope.nodes.run import Spinner
from impactscope.nodes.synchroniser import SynchroniserNode
from impactscope.physics.twin.bench import Bench as SimulatedBench
from impactscope.physics.twin.bench import HammerTap
from impactscope.physics.twin.measurement import DEFAULT_CHAIN
from impactscope.physics.twin.stream import Campaign, ScheduledBlow, stream
from impactscope.recordings import RecordingWriter, open_recording
from impactscope.records import NANOSECONDS, ComplianceVerdict

RATE = 51_200.0  # Hz, each of four channels
START_NS = 1_704_067_200 * NANOSECONDS


def make_recording(
    path: Path, duration: float, block_duration: float, interval: float = 1.5
) -> int:
    """Taps every ``interval`` s; returns how many blocks the file holds."""
    count = int((duration - 2.0) / interval)
    strengths = np.random.default_rng(1).uniform(60.0, 300.0, count)
    campaign = Campaign(
        'taps',
        'hammer taps',
        tuple(
            ScheduledBlow(1.5 + i * interval, HammerTap(strength, 0.004))
            for i, strength in enumerate(strengths)
        ),
        duration,
        bench=SimulatedBench(damper=None),
        chain={name: replace(chain, sample_rate=RATE) for name, chain in DEFAULT_CHAIN.items()},
    )
    blocks = 0
    with RecordingWriter(path, compression='none', flush_interval=0) as writer:
        for block in stream(campaign, seed=1, start_ns=START_NS).blocks(block_duration):
            device = 'acceleration' if block.channel.startswith('acceleration') else 'force'
            writer.write_block(block, f'/bench/{device}_samples')
            blocks += not block.is_end
    return blocks


@contextmanager
def drivers(parameters: dict[str, object]) -> Iterator[list[psutil.Process]]:
    """Both driver nodes, each in a process of its own, as the launch files start them."""
    started = []
    for name in ('force_driver', 'accelerometer_driver'):
        command = [f'{sys.prefix}/lib/impactscope/{name}', '--ros-args', '-r', '__ns:=/bench']
        for key, value in parameters.items():
            text = '[' + ', '.join(value) + ']' if isinstance(value, tuple) else value
            command += ['-p', f'{key}:={text}']
        started.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
    try:
        time.sleep(2.5)  # they are up; data begins at start_at
        yield [psutil.Process(one.pid) for one in started]
    finally:
        for one in started:
            one.send_signal(signal.SIGINT)
        for one in started:
            one.wait(20)


def run_graph(path: Path, rate: float) -> tuple[float, float, list[float], int, int]:
    """Wall time, processor time, delays to the verdict (s), blocks taken, samples lost."""
    with open_recording(path) as recording:
        first = next(iter(recorded_items(recording)))
    channels = ('force', 'acceleration.plate', 'acceleration.impactor', 'acceleration.base')
    start_at = time.time() + 6.0
    common = {
        'source': 'replay',
        'replay.bag': str(path),
        'replay.rate': rate,
        'start_at': start_at,
        'replay.lead': 12.0,  # the pace of the replay is not what is measured
        'wait_for_subscribers': ('synced', 'events'),
    }
    arrivals: dict[int, float] = {}
    options = BenchOptions(
        stages={
            'synchroniser': {'channels': channels, 'longest_wait': 30.0},
            'fitter': {'spring_stiffness': 69_000.0, 'spring_stiffness_std': 500.0},
        },
        serve_test_points=False,
    )
    process = psutil.Process()
    with Bench(options) as bench, drivers(common) as processes:
        usage = [process, *processes]

        def on_verdict(verdict: ComplianceVerdict) -> None:
            arrivals[verdict.event_ids[0]] = time.time()

        bench.collector.on_verdict = on_verdict
        cpu = sum(sum(one.cpu_times()[:2]) for one in usage)
        started = time.time()
        while not bench.is_done:
            time.sleep(0.005)
        wall = time.time() - max(started, start_at)
        used = sum(sum(one.cpu_times()[:2]) for one in usage) - cpu
        bench.finish()
        delays = []
        for result in bench.collector.results:
            event = result.event
            end_ns = event.window_start_ns + event.values.shape[1] / event.sample_rate * 1e9
            due = start_at + (end_ns - first.stamp_ns) / 1e9 / (rate or 1.0)
            delays.append(arrivals[event.event_id] - due)
        statistics = bench.synchroniser.statistics.values()
        return (
            wall,
            used,
            delays,
            sum(item.blocks for item in statistics),
            sum(item.lost_samples for item in statistics),
        )


PLAYER = """
import sys, time, rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.serialization import serialize_message
from impactscope.nodes import qos
count, rate = int(sys.argv[1]), float(sys.argv[2])
rclpy.init()
node = Node('player', namespace='bench')
out = node.create_publisher(WrenchStamped, 'ft/wrench', qos.WRENCH_IN)
messages = []
for index in range(count):
    message = WrenchStamped()
    stamp = message.header.stamp
    stamp.sec, stamp.nanosec = divmod(round(10**18 + index / rate * 1e9), 10**9)
    message.wrench.force.z = float(index)
    messages.append(serialize_message(message))
while not out.get_subscription_count():
    time.sleep(0.05)
time.sleep(0.5)
start = time.perf_counter()
for first in range(0, count, 10):
    ahead = start + first / rate - time.perf_counter()
    if ahead > 0:
        time.sleep(ahead)
    for message in messages[first:first + 10]:
        out.publish(message)
print(count / (time.perf_counter() - start))
time.sleep(1.0)
"""


def run_stamped(rate: float, duration: float) -> tuple[int, int, float, float]:
    """Messages sent and taken, the rate reached by the sender, processor share of the node."""
    count = int(rate * duration)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        from rclpy.parameter import Parameter

        node = SynchroniserNode(
            namespace='bench',
            parameter_overrides=[
                Parameter('channels', value=['force']),
                Parameter('inputs', value=['wrench ft/wrench force.z force']),
                Parameter('input_rate', value=rate),
            ],
        )
        process = psutil.Process()
        with Spinner([node]):
            sender = subprocess.Popen(
                [sys.executable, '-c', PLAYER, str(count), str(rate)],
                stdout=subprocess.PIPE,
                text=True,
            )
            while node.received == 0:
                time.sleep(0.05)
            begun, cpu = time.perf_counter(), sum(process.cpu_times()[:2])
            output, _ = sender.communicate(timeout=120 + duration)
            wall = time.perf_counter() - begun - 1.0
            used = sum(process.cpu_times()[:2]) - cpu
            return count, node.received, float(output), used / wall
    finally:
        rclpy.try_shutdown()


def main(argv: list[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='12 s instead of 60 s')
    quick = parser.parse_args(argv).quick
    duration = 12.0 if quick else 60.0
    print(describe())
    print(f'force and three accelerometers, {RATE:g} S/s each, {duration:g} s of data')
    with tempfile.TemporaryDirectory() as folder:
        for block_duration in (0.02, 0.01):
            path = Path(folder) / f'{block_duration}.mcap'
            sent = make_recording(path, duration, block_duration)
            wall, used, delays, taken, lost = run_graph(path, 1.0)
            bound = 1.25 * block_duration + 0.002
            p50, p99, worst = np.percentile(delays, [50, 99, 100]) * 1e3
            print(
                f'live, {block_duration * 1e3:g} ms blocks: {taken} of {sent} blocks, '
                f'{lost} samples lost, {len(delays)} blows; end of window to verdict '
                f'p50 {p50:.1f} ms, p99 {p99:.1f} ms, worst {worst:.1f} ms '
                f'(1.25 blocks + 2 ms = {bound * 1e3:.1f} ms); '
                f'processor {100 * used / wall:.0f} % of one core'
            )
            runs = [run_graph(path, 0.0) for _ in range(2 if quick else 5)]
            speeds = sorted(duration / wall for wall, *_ in runs)
            used = np.median([used for _, used, *_ in runs])
            print(
                f'as fast as it goes, {block_duration * 1e3:g} ms blocks, {len(runs)} runs: '
                f'{min(taken for *_, taken, _ in runs)} of {sent} blocks, '
                f'{max(lost for *_, lost in runs)} samples lost at worst; '
                f'{np.median(speeds):.1f} [{speeds[0]:.1f}, {speeds[-1]:.1f}] times real time, '
                f'processor {used / duration * 1e3:.0f} ms for 1 s of data'
            )
    for rate in (5_000.0, 10_000.0, 20_000.0):
        sent, taken, reached, share = run_stamped(rate, 3.0 if quick else 10.0)
        print(
            f'one WrenchStamped a sample at {rate:g}/s (sender reached {reached:.0f}/s): '
            f'{taken} of {sent} taken, processor {100 * share:.0f} % of one core'
        )
    return 0


if __name__ == '__main__':
    sys.exit(main())
