"""The stages in a row: the same objects as in the live graph, without a graph.

``analyse`` reads a recording and gives what the nodes would have published, to the last bit.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from impactscope.comply import Compliance, JudgementRules, LimitSet, judge_recording, worst
from impactscope.configuration import load_limits, node_parameters, settings_from
from impactscope.detect import DetectorSettings, ImpactDetector
from impactscope.errors import MissingChannelError
from impactscope.estimate import (
    Fitter,
    FitterSettings,
    ImpactSettings,
    RepeatedBlows,
    estimate_impact,
)
from impactscope.inputs import Item, inputs_of, recorded_items, scan_channels
from impactscope.measurement_profile import MeasurementProfile
from impactscope.recordings import RecordingInfo, file_sha256, open_recording
from impactscope.records import (
    AnalysisResult,
    Channel,
    ComplianceVerdict,
    EventResult,
    ImpactEvent,
    Quality,
    SampleBlock,
    SensorSummary,
    SyncedBlock,
    TestPoint,
    Verdict,
    VerdictScope,
)
from impactscope.synchronise import Synchroniser, SynchroniserSettings, quality_notes
from impactscope.version import __version__

__all__ = [
    'AnalysisSettings',
    'Pipeline',
    'analyse',
    'load_settings',
    'summarise',
    'with_channels',
]


@dataclass(frozen=True)
class AnalysisSettings:
    """The settings of every stage."""

    channels: tuple[str, ...] = ()  # expected, the reference first; empty: all of a recording
    synchroniser: SynchroniserSettings = field(
        default_factory=lambda: SynchroniserSettings(('force',))
    )
    detector: DetectorSettings = field(default_factory=DetectorSettings)
    profile: MeasurementProfile = field(default_factory=MeasurementProfile)
    fitter: FitterSettings = field(default_factory=FitterSettings)
    impact: ImpactSettings = field(default_factory=ImpactSettings)
    limits: str = 'iso_ts_15066_2016'
    rules: JudgementRules = field(default_factory=JudgementRules)
    inputs: tuple[str, ...] = ()  # stamped samples: kind topic axis channel

    def as_dict(self) -> dict[str, dict[str, object]]:
        """Stage name, then parameter, then value: for reports."""
        return {
            'synchroniser': dataclasses.asdict(self.synchroniser),
            'impact_detector': dataclasses.asdict(self.detector),
            'measurement_profile': dataclasses.asdict(self.profile),
            'fitter': dataclasses.asdict(self.fitter) | dataclasses.asdict(self.impact),
            'compliance': {'limits': self.limits} | dataclasses.asdict(self.rules),
        }


def load_settings(path: Path | str) -> AnalysisSettings:
    """Settings from a parameter file of the nodes; raises ConfigurationError."""
    synchroniser = node_parameters(path, 'synchroniser')
    detector = node_parameters(path, 'impact_detector')
    fitter = node_parameters(path, 'fitter')
    compliance = node_parameters(path, 'compliance')
    channels = tuple(name for name in synchroniser.get('channels', ()) if name)
    return AnalysisSettings(
        channels=channels,
        synchroniser=settings_from(
            SynchroniserSettings, synchroniser, channels=channels or ('force',)
        ),
        detector=settings_from(DetectorSettings, detector),
        profile=settings_from(MeasurementProfile, compliance, 'profile.'),
        fitter=settings_from(FitterSettings, fitter),
        impact=settings_from(ImpactSettings, fitter, 'impact.'),
        limits=compliance.get('limits', AnalysisSettings.limits),
        rules=settings_from(JudgementRules, compliance, 'rules.'),
        inputs=tuple(item for item in synchroniser.get('inputs', ()) if item),
    )


def _nothing(_: object) -> None:
    """Take no notice."""


class Pipeline:
    """Blocks in, results of blows out. The channels must be known: see ``with_channels``."""

    def __init__(self, settings: AnalysisSettings, limits: LimitSet | None = None) -> None:
        self._synchroniser = Synchroniser(settings.synchroniser)
        self._detector = ImpactDetector(settings.detector, settings.profile)
        self._fitter = Fitter(settings.fitter)
        self._impact = settings.impact
        self._compliance = Compliance(
            limits or load_limits(settings.limits), settings.profile, settings.rules
        )
        self._points: dict[str, ComplianceVerdict] = {}
        self.qualities: dict[str, Quality] = {}
        self.grid_samples = 0
        self.grid_rate = 0.0

    @property
    def test_points(self) -> tuple[ComplianceVerdict, ...]:
        """The last word on each test point."""
        return tuple(self._points.values())

    @property
    def synchroniser(self) -> Synchroniser:
        """The first stage, for its statistics."""
        return self._synchroniser

    def push(self, item: Item) -> list[EventResult]:
        """Take a block or a test point; return the blows that are complete with it."""
        if isinstance(item, TestPoint):
            self._detector.take_test_point(item)
            self._keep(self._compliance.take_test_point(item))
            return []
        return self._detect(self._synchroniser.push(item))

    def flush(self) -> list[EventResult]:
        """The stream has ended."""
        results = self._detect(self._synchroniser.flush())
        for event in self._detector.flush():
            results.extend(self._judge(event))
        self._keep(self._compliance.flush())
        return results

    def notes(self) -> list[str]:
        """What a reader must know of the data's quality, in sentences."""
        return quality_notes(self._synchroniser.statistics)

    def _detect(self, blocks: Iterable[SyncedBlock]) -> list[EventResult]:
        results: list[EventResult] = []
        for block in blocks:
            self.grid_samples += block.values.shape[1]
            self.grid_rate = block.sample_rate
            for channel in block.channels:
                if channel.quality:
                    seen = self.qualities.get(channel.name, Quality.NONE)
                    self.qualities[channel.name] = seen | channel.quality
            for event in self._detector.push(block):
                results.extend(self._judge(event))
        return results

    def _judge(self, event: ImpactEvent) -> list[EventResult]:
        results: list[EventResult] = []
        for sensor in self._fitter.push(event):
            impact = estimate_impact(event, sensor, self._impact)
            verdicts = self._compliance.push(event)
            results.extend(
                EventResult(event, sensor, impact, verdict) for verdict in self._keep(verdicts)
            )
        return results

    def _keep(self, verdicts: Sequence[ComplianceVerdict]) -> list[ComplianceVerdict]:
        for verdict in verdicts:
            if verdict.scope is VerdictScope.TEST_POINT:
                self._points[verdict.test_point.id] = verdict
        return [verdict for verdict in verdicts if verdict.scope is VerdictScope.EVENT]


def analyse(
    path: Path | str,
    settings: AnalysisSettings | None = None,
    *,
    test_point: TestPoint | None = None,
    keep_samples: bool = True,
    progress: Callable[[float], None] = _nothing,
    on_result: Callable[[EventResult], None] = _nothing,
) -> AnalysisResult:
    """Analyse a recording from end to end.

    Args:
        path: MCAP file, SQLite file, or folder of a recording.
        settings: of the stages; the channels are those of the recording unless named there.
        test_point: what was tested, where the recording does not say so itself.
        keep_samples: whether the result keeps the samples of each blow, which a report draws;
            without them, memory does not grow with the recording.
        progress: called with the share that has been read, 0 to 1.
        on_result: called with each blow as soon as it is complete.

    Raises RecordingError where it cannot be read at all, and MissingChannelError where a channel
    that was asked for is not in it. Damage further on is a note of the result, whose verdict
    then is no better than INVALID.
    """
    settings = settings or AnalysisSettings()
    with (
        open_recording(path, tolerate_damage=True) as recording,
        ThreadPoolExecutor(1) as hashing,
    ):
        info = recording.info
        digest = hashing.submit(_digest, info)
        inputs = inputs_of(recording, settings.inputs)
        present = scan_channels(recording, inputs)
        settings = with_channels(settings, present)
        reference = settings.synchroniser.ordered[0]
        if reference not in present:
            raise MissingChannelError(
                f'{info.path.name!r} has no channel {reference!r}; '
                f'its channels are {", ".join(present) or "none"}'
            )
        pipeline = Pipeline(settings)
        results: list[EventResult] = []

        def take(found: list[EventResult]) -> None:
            for result in found:
                on_result(result)
                results.append(result if keep_samples else _without_samples(result))

        if test_point is not None:
            take(pipeline.push(test_point))
        span_ns = max(info.end_ns - info.start_ns, 1)
        channels: dict[str, Channel] = {}
        for item in recorded_items(recording, inputs):
            take(pipeline.push(item))
            if isinstance(item, SampleBlock):
                if item.channel not in channels:
                    channels[item.channel] = _channel_of(item)
                progress(min(max((item.stamp_ns - info.start_ns) / span_ns, 0.0), 1.0))
        take(pipeline.flush())
        progress(1.0)
        damage = tuple(str(item) for item in recording.damage)
        return summarise(
            source=info.path.name,
            sha256=digest.result(),
            settings=settings,
            channels=tuple(
                dataclasses.replace(c, quality=pipeline.qualities.get(c.name, Quality.NONE))
                for c in channels.values()
            ),
            duration=pipeline.grid_samples / pipeline.grid_rate if pipeline.grid_rate else 0.0,
            events=results,
            test_points=pipeline.test_points,
            notes=(*info.notes, *damage, *pipeline.notes()),
            damaged=bool(damage),
            provenance=info.provenance,
        )


def with_channels(settings: AnalysisSettings, present: Sequence[str]) -> AnalysisSettings:
    """Settings that expect the channels they name, or else those that are present."""
    channels = settings.channels or tuple(present)
    synchroniser = dataclasses.replace(settings.synchroniser, channels=channels)
    return dataclasses.replace(settings, channels=channels, synchroniser=synchroniser)


def summarise(
    *,
    source: str,
    sha256: str,
    settings: AnalysisSettings,
    channels: tuple[Channel, ...],
    duration: float,
    events: Sequence[EventResult],
    test_points: Sequence[ComplianceVerdict],
    notes: Sequence[str],
    damaged: bool = False,
    provenance: dict[str, str] | None = None,
) -> AnalysisResult:
    """The result of an analysis, offline or of a live graph, with the verdict over all."""
    verdict = judge_recording([*(item.verdict for item in events), *test_points])
    if damaged:
        verdict = worst([verdict, Verdict.INVALID])
    return AnalysisResult(
        source=source,
        sha256=sha256,
        software_version=__version__,
        parameters=settings.as_dict(),
        channels=channels,
        duration=duration,
        events=tuple(events),
        test_points=tuple(test_points),
        verdict=verdict,
        notes=tuple(notes),
        damaged=damaged,
        provenance=dict(provenance or {}),
        sensor=_sensor_of(events),
    )


def _sensor_of(events: Sequence[EventResult]) -> SensorSummary | None:
    """The last word on the sensor, as the fitter node says it."""
    stage = RepeatedBlows()
    summaries = [summary for item in events for summary in stage.push(item.sensor)]
    return summaries[-1] if summaries else None


def _without_samples(result: EventResult) -> EventResult:
    event = dataclasses.replace(result.event, values=result.event.values[:, :0].copy())
    return dataclasses.replace(result, event=event)


def _digest(info: RecordingInfo) -> str:
    """SHA-256 of the recording; of several files, of their digests in order."""
    digests = [file_sha256(path) for path in info.files]
    if len(digests) == 1:
        return digests[0]
    return hashlib.sha256(''.join(digests).encode()).hexdigest()


def _channel_of(block: SampleBlock) -> Channel:
    return Channel(
        block.channel,
        block.unit,
        block.frame_id,
        block.sample_rate,
        block.range_min,
        block.range_max,
    )
