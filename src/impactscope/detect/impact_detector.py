"""The detector of blows: a stream of synchronised channels in, one event for each blow out."""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass, fields, replace

from impactscope.detect.epoch_scan import EpochScan
from impactscope.detect.settings import DetectorSettings
from impactscope.errors import InputError
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import ImpactEvent, Quality, SyncedBlock, TestPoint

__all__ = ['DetectorStatistics', 'ImpactDetector']

TEST_POINTS = 64  # remembered


@dataclass(frozen=True, slots=True)
class DetectorStatistics:
    """What the detector has seen since it was made."""

    blocks: int = 0
    samples: int = 0  # grid samples
    events: int = 0
    torn: int = 0  # events cut by the stream's begin or end
    without_contact: int = 0  # disturbances that never reached the profile's contact force
    duplicates: int = 0  # grid samples that had been seen before
    lost: int = 0  # grid samples that never came
    clock_jumps: int = 0
    missing_channel: int = 0  # blocks without the trigger channel
    relearned: int = 0  # times that the noise floor was lost and learned anew


class ImpactDetector:
    """Finds blows; implements ``Stage[SyncedBlock, ImpactEvent]``.

    The events do not depend on how the stream was cut into blocks; an event comes out of the
    push that completes it. Memory is bounded by the profile's longest hold and ring-down.

    Args:
        settings: detection in sigma and N.
        profile: what counts as contact, held, at rest.
    """

    def __init__(
        self,
        settings: DetectorSettings | None = None,
        profile: MeasurementProfile | None = None,
    ) -> None:
        self.settings = settings or DetectorSettings()
        self.profile = profile or MeasurementProfile()
        self._counts: Counter[str] = Counter()
        self._test_points: deque[TestPoint] = deque(maxlen=TEST_POINTS)
        self._scan: EpochScan | None = None

    @property
    def statistics(self) -> DetectorStatistics:
        """Counters for diagnostics."""
        return DetectorStatistics(
            **{item.name: self._counts[item.name] for item in fields(DetectorStatistics)}
        )

    @property
    def noise_floor(self) -> tuple[float, float]:
        """Zero level and noise of the trigger channel as now known, in its unit; or NaN."""
        return self._scan.noise_floor if self._scan else (math.nan, math.nan)

    def take_test_point(self, test_point: TestPoint) -> None:
        """Take note of a test point, or of its end; later events are assigned to it."""
        for place, known in enumerate(self._test_points):
            if (known.id, known.start_ns) == (test_point.id, test_point.start_ns):
                del self._test_points[place]
                break
        self._test_points.append(test_point)

    def push(self, record: SyncedBlock) -> list[ImpactEvent]:
        """Take a block; return the events that it completes.

        Raises InputError where the block's shape or rate contradicts its description.
        """
        if record.is_end:
            return self.flush()
        if record.values.shape[0] != len(record.channels):
            raise InputError(
                f'a block has {record.values.shape[0]} rows for {len(record.channels)} channels'
            )
        if not (math.isfinite(record.sample_rate) and record.sample_rate > 0):
            raise InputError(f'a block has a sample rate of {record.sample_rate!r} Hz')
        events: list[ImpactEvent] = []
        if self._scan is None or not self._scan.fits(record):
            events += self.flush()
            names = [channel.name for channel in record.channels]
            wanted = self.settings.channel
            if wanted and wanted not in names:
                self._counts['missing_channel'] += 1
                return events
            row = names.index(wanted) if wanted else 0
            self._scan = EpochScan(record, row, self.settings, self.profile, self._counts)
        self._counts['blocks'] += 1
        closed = self._scan.append(record)
        closed += self._scan.advance()
        if closed:
            events += self._numbered(closed)
        return events

    def flush(self) -> list[ImpactEvent]:
        """The stream has ended: close an open event as torn, and start afresh."""
        if self._scan is None:
            return []
        events = self._numbered(self._scan.finish())
        self._scan = None
        return events

    def _numbered(self, events: list[ImpactEvent]) -> list[ImpactEvent]:
        """The events with their numbers and test points."""
        numbered = []
        for event in events:
            self._counts['events'] += 1
            self._counts['torn'] += int(Quality.TORN in event.quality)
            numbered.append(
                replace(
                    event,
                    event_id=self._counts['events'],
                    test_point=self._test_point_at(event.stamp_ns),
                )
            )
        return numbered

    def _test_point_at(self, stamp_ns: int) -> TestPoint:
        for test_point in reversed(self._test_points):
            if test_point.holds(stamp_ns):
                return test_point
        return TestPoint()
