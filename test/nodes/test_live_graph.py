"""The live graph on real DDS says what the offline analysis says, to the last bit."""

import dataclasses
import math
import time

import numpy as np
import pytest

from impactscope.analysis import analyse, load_settings
from impactscope.configuration import bags_folder
from impactscope.drivers.simulated import write_simulation
from impactscope.errors import ConfigurationError, MissingChannelError
from impactscope.inputs import scan_channels
from impactscope.live import replay_recording, run_live
from impactscope.nodes.graph import Bench
from impactscope.recordings import open_recording, read_streams
from impactscope.records import SampleBlock, Verdict

pytestmark = pytest.mark.ros

BAGS = sorted(path.name for path in bags_folder().glob('*.mcap'))


def differences(a, b, where=''):
    """Where two results differ; NaN equals NaN."""
    if isinstance(a, np.ndarray):
        return [] if np.array_equal(a, b, equal_nan=True) else [where]
    if dataclasses.is_dataclass(a):
        return [
            found
            for item in dataclasses.fields(a)
            for found in differences(
                getattr(a, item.name), getattr(b, item.name), f'{where}.{item.name}'
            )
        ]
    if isinstance(a, tuple):
        if len(a) != len(b):
            return [f'{where}: {len(a)} and {len(b)} items']
        pairs = enumerate(zip(a, b, strict=True))
        return [found for i, (x, y) in pairs for found in differences(x, y, f'{where}[{i}]')]
    if isinstance(a, float) and math.isnan(a) and math.isnan(b):
        return []
    return [] if a == b else [f'{where}: {a!r} and {b!r}']


def assert_same(offline, live):
    assert differences(offline.events, live.events, 'events') == []
    assert differences(offline.test_points, live.test_points, 'test_points') == []
    assert differences(offline.sensor, live.sensor, 'sensor') == []
    assert live.verdict is offline.verdict
    assert live.duration == pytest.approx(offline.duration)
    assert live.sha256 == offline.sha256


def test_there_are_recordings():
    assert len(BAGS) >= 8


@pytest.mark.parametrize('name', BAGS)
def test_replay_as_fast_as_it_goes_equals_analysis(name):
    path = bags_folder() / name
    assert_same(analyse(path), replay_recording(path, rate=0.0))


@pytest.mark.parametrize('name', [n for n in BAGS if not n.startswith('simulated')])
def test_the_live_fitter_tells_what_real_recordings_show(name):
    """A structure of several modes, a pendulum whose frequency falls with its amplitude."""
    (result,) = replay_recording(bags_folder() / name, rate=0.0).events
    sensor = result.sensor
    assert sensor.reason
    assert not sensor.valid
    if name.startswith('hammer'):
        first = [mode for mode in sensor.modes if abs(mode.natural_frequency.value - 900) < 1]
        assert first[0].natural_frequency.std < 0.2
        assert first[0].damping_ratio.value == pytest.approx(0.0013, abs=3e-4)
    else:
        assert sensor.frequency_slope.value < -20 * sensor.frequency_slope.std
        assert sensor.small_amplitude_frequency.value == pytest.approx(1.74, abs=0.05)
        assert 0.01 < sensor.damping_ratio.value < 0.05


def test_the_summary_over_blows_is_published_and_recorded(tmp_path):
    path, copy = bags_folder() / 'simulated_taps.mcap', tmp_path / 'copy.mcap'
    live = replay_recording(path, rate=0.0, record_to=copy)
    with open_recording(copy) as recording:
        (topic,) = [t for t in recording.info.topics if t.name.endswith('sensor_summary')]
    assert topic.type == 'impactscope/msg/SensorSummary'
    assert topic.count == len(live.events) - 1
    assert live.sensor.event_ids == tuple(item.event.event_id for item in live.events)
    assert live.sensor.natural_frequency.std < 0.01


def test_replay_at_speed_equals_analysis():
    path = bags_folder() / 'hammer_blow_2.mcap'
    assert_same(analyse(path), replay_recording(path, rate=4.0))


def test_what_the_recorder_wrote_is_what_was_played(tmp_path):
    path = bags_folder() / 'hammer_blow_3.mcap'
    copy = tmp_path / 'copy.mcap'
    live = replay_recording(path, rate=0.0, record_to=copy)
    with open_recording(copy) as recording:
        assert set(scan_channels(recording)) == {'force.hammer', 'acceleration.structure'}
        kinds = {topic.type for topic in recording.info.topics}
        assert {'impactscope/msg/ImpactEvent', 'impactscope/msg/ComplianceVerdict'} <= kinds
    again = analyse(copy)
    assert differences(again.events, live.events, 'events') == []


def test_the_simulated_bench_live(tmp_path):
    """Real time, real clock: stamps differ from a simulation on file, forces do not."""
    target = tmp_path / 'live.mcap'
    seen = []
    result = run_live(campaign='hand_pass', record_to=target, on_result=seen.append)
    assert result.verdict is Verdict.PASS
    assert len(result.events) == len(seen) == 3
    assert not any(note for note in result.notes)
    assert_same(dataclasses.replace(analyse(target), sha256=''), result)
    on_file = tmp_path / 'simulated.mcap'
    write_simulation('hand_pass', on_file)
    for ours, theirs in zip(result.events, analyse(on_file).events, strict=True):
        peak, expected = ours.impact.peak_force.value, theirs.impact.peak_force.value
        assert peak == pytest.approx(expected, rel=1e-3)


def test_data_begin_once_the_stages_are_up(monkeypatch, tmp_path):
    """What is past by then comes in one burst: all of one device's before the other's."""
    build, up_at = Bench._build, []

    def slowly(bench):
        build(bench)
        time.sleep(1.0)
        up_at.append(time.time_ns())

    monkeypatch.setattr(Bench, '_build', slowly)
    target = tmp_path / 'live.mcap'
    run_live(campaign='hand_pass', duration=4.0, record_to=target)
    with open_recording(target) as recording:
        begin = {}
        for item in read_streams(recording):
            if isinstance(item, SampleBlock):
                begin.setdefault(item.channel, item.stamp_ns)
    assert len(begin) == 4
    assert all(stamp > up_at[0] for stamp in begin.values())


def test_two_benches_side_by_side(tmp_path):
    """Under namespaces of their own, neither hears the other."""
    import concurrent.futures

    import rclpy

    rclpy.init()
    try:
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            runs = [
                pool.submit(replay_recording, bags_folder() / name, rate=2.0, namespace=namespace)
                for name, namespace in (
                    ('hammer_blow_1.mcap', 'left'),
                    ('hammer_blow_2.mcap', 'right'),
                )
            ]
            left, right = (run.result(60) for run in runs)
    finally:
        rclpy.shutdown()
    assert_same(analyse(bags_folder() / 'hammer_blow_1.mcap'), left)
    assert_same(analyse(bags_folder() / 'hammer_blow_2.mcap'), right)


def test_wrong_parameters_are_refused_in_a_sentence(tmp_path):
    params = tmp_path / 'params.yaml'
    for text, words in (
        ('impact_detector: {ros__parameters: {thresh: 3.0}}', 'unknown parameter thresh'),
        ('impact_detector: {ros__parameters: {threshold: -3.0}}', 'threshold'),
        ('impact_detector: {ros__parameters: {threshold: high}}', 'threshold'),
        ('compliance: {ros__parameters: {limits: none_such}}', 'none_such'),
    ):
        params.write_text(f'/**:\n  {text}\n', encoding='utf-8')
        with pytest.raises(ConfigurationError, match=words):
            replay_recording(bags_folder() / 'hammer_blow_1.mcap', params_file=params)


def test_a_reference_that_is_not_there(tmp_path):
    params = tmp_path / 'params.yaml'
    params.write_text(
        '/**:\n  synchroniser: {ros__parameters: {channels: [nothing]}}\n', encoding='utf-8'
    )
    with pytest.raises(MissingChannelError, match='nothing'):
        analyse(bags_folder() / 'hammer_blow_1.mcap', load_settings(params))
