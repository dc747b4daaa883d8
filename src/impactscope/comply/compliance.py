"""The compliance stage: blows and test points in, verdicts out.

It measures and judges. It is not a safety function: nothing may be switched by its verdicts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from impactscope.comply.judge import judge
from impactscope.comply.limits import LimitSet
from impactscope.comply.resting_load import RestingLoad
from impactscope.comply.rules import JudgementRules
from impactscope.comply.severity import worst
from impactscope.comply.test_points import judge_test_point
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import (
    ComplianceVerdict,
    ImpactEvent,
    ImpactParameters,
    SensorParameters,
    TestPoint,
    Verdict,
    VerdictScope,
)

__all__ = ['Compliance', 'final_verdicts', 'judge_recording']

_Key = tuple[str, int]


@dataclass(slots=True)
class _Record:
    """What is known of one test point so far."""

    test_point: TestPoint
    blows: list[ComplianceVerdict] = field(default_factory=list)
    reported: bool = False  # a verdict over its present blows has been given


class Compliance:
    """Stage[ImpactEvent, ComplianceVerdict] with :meth:`take_test_point` beside it.

    Every blow gets its verdict at once. A test point gets one when it ends, and a new one that
    takes the place of the former whenever a further blow of it arrives after that: blows are
    found only when they have come to rest, often after the end was declared. Repetitions that
    are started and ended one by one under the same id belong to one test point.
    """

    def __init__(
        self,
        limits: LimitSet | None,
        profile: MeasurementProfile,
        rules: JudgementRules | None = None,
    ) -> None:
        self.limits = limits
        self.profile = profile
        self.rules = rules or JudgementRules()
        self._records: dict[_Key, _Record] = {}
        self._load = RestingLoad(profile.contact_end_force)

    def take_test_point(self, test_point: TestPoint) -> list[ComplianceVerdict]:
        """Note that a test point began or ended; where it ended, return its verdict.

        A verdict that was given already is not repeated: latched messages come again. One that
        is announced with its end, as recordings and simulations do, waits for its blows.
        """
        key = _key(test_point)
        record = self._records.get(key)
        if record is None:
            self._records[key] = _Record(test_point)
            return []
        if repr(test_point) != repr(record.test_point):  # NaN equals NaN here
            record.test_point = test_point
            record.reported = False
        return self._report(record)

    def push(
        self,
        record: ImpactEvent,
        *,
        sensor: SensorParameters | None = None,
        impact: ImpactParameters | None = None,
    ) -> list[ComplianceVerdict]:
        """Judge one blow; with it comes the new verdict of its test point if that has ended."""
        point = record.test_point
        if not _is_stated(point):
            point = self._open_at(record.stamp_ns) or point
        verdict = judge(
            record,
            self.limits,
            self.profile,
            rules=self.rules,
            test_point=point,
            sensor=sensor or self.rules.sensor,
            impact=impact,
            resting_load=self._load.before(record, self.rules.force_channel),
        )
        if not _is_stated(point):
            return [verdict]
        known = self._records.setdefault(_key(point), _Record(point))
        # A blow that is delivered again is no further repetition.
        known.blows = [blow for blow in known.blows if blow.stamp_ns != verdict.stamp_ns]
        known.blows.append(verdict)
        known.reported = False
        return [verdict, *self._report(known)]

    def flush(self) -> list[ComplianceVerdict]:
        """Judge the test points that are still open as if they ended here, and start afresh."""
        verdicts = [
            self._judge(record, ended=record.test_point.end_ns != 0)
            for record in self._records.values()
            if not record.reported
        ]
        self._records.clear()
        self._load = RestingLoad(self.profile.contact_end_force)
        return verdicts

    def _open_at(self, stamp_ns: int) -> TestPoint | None:
        """The latest test point that holds a blow at this time."""
        holding = (
            record.test_point
            for record in self._records.values()
            if record.test_point.holds(stamp_ns)
        )
        return max(holding, key=lambda point: point.start_ns, default=None)

    def _report(self, record: _Record) -> list[ComplianceVerdict]:
        if record.test_point.end_ns == 0 or record.reported:
            return []
        record.reported = True
        return [self._judge(record, ended=True)]

    def _judge(self, record: _Record, *, ended: bool) -> ComplianceVerdict:
        return judge_test_point(
            record.test_point, record.blows, self.limits, self.profile, self.rules, ended=ended
        )


def final_verdicts(verdicts: Iterable[ComplianceVerdict]) -> list[ComplianceVerdict]:
    """Of the verdicts over test points the last of each, in order of first appearance."""
    last: dict[_Key, ComplianceVerdict] = {}
    for verdict in verdicts:
        if verdict.scope is VerdictScope.TEST_POINT:
            last[_key(verdict.test_point)] = verdict
    return list(last.values())


def judge_recording(verdicts: Iterable[ComplianceVerdict]) -> Verdict:
    """The verdict of a whole recording from all that the stage returned for it.

    The worst of every blow and every test point's last verdict; INCOMPLETE where nothing was
    judged.
    """
    every = list(verdicts)
    blows = [verdict for verdict in every if verdict.scope is VerdictScope.EVENT]
    if not blows:
        return worst([Verdict.INCOMPLETE, *(verdict.verdict for verdict in every)])
    return worst(verdict.verdict for verdict in (*blows, *final_verdicts(every)))


def _is_stated(point: TestPoint) -> bool:
    return bool(point.id) or point.start_ns != 0


def _key(point: TestPoint) -> _Key:
    """A test point is told by its id; where it has none, by its start."""
    return (point.id, 0) if point.id else ('', point.start_ns)
