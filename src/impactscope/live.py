"""Running the graph from the command line: a replay, a live bench, the demonstration."""

from __future__ import annotations

import dataclasses
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from impactscope.analysis import AnalysisSettings, load_settings, summarise, with_channels
from impactscope.configuration import bags_folder, config_folder
from impactscope.inputs import channel_order, inputs_of, scan_channels
from impactscope.nodes.graph import Bench, BenchOptions
from impactscope.recordings import file_sha256, open_recording
from impactscope.records import (
    AnalysisResult,
    Channel,
    ComplianceVerdict,
    EventResult,
    TestPoint,
)

__all__ = ['DemoStep', 'demo_steps', 'replay_recording', 'run_live']

START_DELAY = 0.5  # s after the stages are up, at which data begin


def _nothing(_: Any) -> None:
    """Take no notice."""


@contextmanager
def _until_signal() -> Iterator[threading.Event]:
    """An event that SIGINT or SIGTERM sets; handlers are put back afterwards."""
    ended = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield ended
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda *_: ended.set()) for number in numbers]
    try:
        yield ended
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def replay_recording(
    path: Path,
    *,
    rate: float = 1.0,
    record_to: Path | None = None,
    params_file: Path | None = None,
    namespace: str = 'bench',
    test_point: TestPoint | None = None,
    inputs: tuple[str, ...] = (),
    progress: Callable[[float], None] = _nothing,
    on_result: Callable[[EventResult], None] = _nothing,
) -> AnalysisResult:
    """Play a recording through the graph and gather what it says.

    Raises RecordingError and ConfigurationError as ``analyse`` does.
    """
    settings = load_settings(params_file) if params_file else AnalysisSettings()
    with open_recording(path, tolerate_damage=True) as recording:
        what = recording.info
        found = inputs_of(recording, inputs or settings.inputs)
        settings = with_channels(settings, scan_channels(recording, found))
        provenance = what.provenance
    written = tuple(f'{i.kind} {i.topic} {i.axis} {i.channel}' for i in found)
    channels = settings.synchroniser.channels
    common = {
        'source': 'replay',
        'replay.bag': str(path),
        'replay.rate': float(rate),
        'replay.inputs': written or ('',),
        'wait_for_subscribers': ('synced', 'events'),
    }
    drivers: dict[str, dict[str, Any]] = {}
    accelerations = tuple(name for name in channels if name.startswith('acceleration'))
    others = tuple(name for name in channels if name not in accelerations)
    # Whoever has the reference keeps the clock; a recording may lack one of the devices.
    if others:
        drivers['force_driver'] = {**common, 'channels': others}
    if accelerations:
        drivers['accelerometer_driver'] = {**common, 'channels': accelerations}
    first = next(iter(drivers))
    drivers[first] |= {'publish_test_points': True, 'replay.publish_clock': True}
    options = BenchOptions(
        namespace=namespace,
        params_file=params_file,
        drivers=drivers,
        stages={'synchroniser': {'channels': channels}},
        record_to=record_to,
        serve_test_points=False,
        use_sim_time=True,
        start_delay=START_DELAY,
    )
    with _until_signal() as ended, Bench(options, on_result) as bench:
        if test_point is not None:
            bench.announce(test_point)

        def tick() -> None:
            progress(min(bench.detector.duration / max(what.duration, 1e-9), 1.0))
            if ended.is_set():
                raise KeyboardInterrupt

        bench.wait_until_ended(tick)
        bench.finish()
        progress(1.0)
        digest = file_sha256(what.files[0]) if len(what.files) == 1 else ''
        damage = tuple(str(item) for item in what.damage)
        return _result(
            bench,
            settings,
            source=what.path.name,
            sha256=digest,
            damage=damage,
            provenance=provenance,
        )


def run_live(
    *,
    params_file: Path | None = None,
    campaign: str = '',
    seed: int = 1,
    duration: float = float('inf'),
    record_to: Path | None = None,
    namespace: str = 'bench',
    on_result: Callable[[EventResult], None] = _nothing,
    on_test_point: Callable[[ComplianceVerdict], None] = _nothing,
) -> AnalysisResult:
    """Run a bench until Ctrl-C, ``duration`` s, or the end of a simulated campaign."""
    settings = load_settings(params_file) if params_file else AnalysisSettings()
    common: dict[str, Any] = {'wait_for_subscribers': ('synced', 'events')}
    stages: dict[str, dict[str, Any]] = {}
    if campaign:
        from impactscope.drivers.simulated import campaign_channels, simulated_items

        simulated_items(campaign, seed=seed)  # before the bench starts: both devices share it
        common |= {
            'source': 'simulated',
            'simulated.campaign': campaign,
            'simulated.seed': seed,
        }
        settings = with_channels(settings, channel_order(campaign_channels(campaign)))
        stages['synchroniser'] = {'channels': settings.synchroniser.channels}
    options = BenchOptions(
        namespace=namespace,
        params_file=params_file,
        drivers={
            'force_driver': {**common, 'publish_test_points': bool(campaign)},
            'accelerometer_driver': common,
        },
        stages=stages,
        record_to=record_to,
        serve_test_points=not campaign,
        start_delay=START_DELAY if campaign else None,
    )
    deadline = time.monotonic() + duration
    with _until_signal() as ended, Bench(options, on_result, on_test_point) as bench:
        while not ended.wait(0.05) and time.monotonic() < deadline:
            bench.check()
            if campaign and bench.is_done:
                break
        bench.finish()
        source = record_to.name if record_to else campaign or 'live'
        return _result(bench, settings, source=source)


@dataclass(frozen=True)
class DemoStep:
    """One part of the demonstration: what it shows, how to run it, and its report's name."""

    title: str
    name: str
    run: Callable[..., AnalysisResult]


def demo_steps(folder: Path) -> list[DemoStep]:
    """The live graph on a real recording, and on simulated campaigns in real time."""
    folder.mkdir(parents=True, exist_ok=True)

    def hammer(**callbacks: Any) -> AnalysisResult:
        bag = bags_folder() / 'hammer_blow_1.mcap'
        callbacks.pop('on_test_point')
        return replay_recording(bag, record_to=folder / 'demo_hammer.mcap', **callbacks)

    def simulated(campaign: str) -> Callable[..., AnalysisResult]:
        def run(**callbacks: Any) -> AnalysisResult:
            target = folder / f'demo_{campaign}.mcap'
            result = run_live(
                params_file=config_folder() / 'bench.yaml',
                campaign=campaign,
                record_to=target,
                **callbacks,
            )
            return dataclasses.replace(result, sha256=file_sha256(target))

        return run

    return [
        DemoStep('A real instrumented hammer blow, replayed through the graph', 'hammer', hammer),
        DemoStep('Hammer taps: the sensor is identified (simulated)', 'taps', simulated('taps')),
        DemoStep(
            'Blows on a hand, within the limits (simulated)', 'hand_pass', simulated('hand_pass')
        ),
        DemoStep('The same, too fast (simulated)', 'hand_fail', simulated('hand_fail')),
    ]


def _result(
    bench: Bench,
    settings: AnalysisSettings,
    *,
    source: str,
    sha256: str = '',
    damage: tuple[str, ...] = (),
    provenance: dict[str, str] | None = None,
) -> AnalysisResult:
    events = sorted(bench.collector.results, key=lambda item: item.event.event_id)
    channels: dict[str, Channel] = {}
    for channel in bench.detector.channels:
        channels.setdefault(channel.name, channel)
    return summarise(
        source=source,
        sha256=sha256,
        settings=settings,
        channels=tuple(channels.values()),
        duration=bench.detector.duration,
        events=events,
        test_points=tuple(bench.collector.test_points.values()),
        notes=(*damage, *bench.synchroniser.notes()),
        damaged=bool(damage),
        provenance=provenance,
    )
