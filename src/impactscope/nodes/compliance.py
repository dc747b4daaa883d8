"""Node: judges each blow and each test point against the limits.

``events`` in, with ``sensor_parameters`` and ``impact_parameters`` for the statement of
validity; ``verdict`` out, latched. It measures and judges. It is not a safety function, and it
never commands a robot.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from impactscope import msg
from impactscope.comply import Compliance, JudgementRules
from impactscope.configuration import load_limits
from impactscope.measurement_profile import MeasurementProfile
from impactscope.nodes import qos
from impactscope.nodes.base import STEADY, StageNode
from impactscope.nodes.conversions import to_message, to_record
from impactscope.nodes.parameters import declare, declare_settings, refuse_unknown
from impactscope.records import (
    ComplianceVerdict,
    ImpactEvent,
    ImpactParameters,
    SensorParameters,
    VerdictScope,
)

__all__ = ['ComplianceNode']


@dataclass
class _Pending:
    event: ImpactEvent | None = None
    sensor: SensorParameters | None = None
    impact: ImpactParameters | None = None
    since: float = field(default_factory=time.monotonic)

    @property
    def is_complete(self) -> bool:
        return None not in (self.event, self.sensor, self.impact)


class ComplianceNode(StageNode):
    """Runs :class:`~impactscope.comply.Compliance` on events.

    A blow is judged as soon as its parameters are there, and without them after
    ``parameters_wait``: the judgement itself rests on the event alone.
    """

    def __init__(self, **keywords: Any) -> None:
        super().__init__('compliance', **keywords)
        limits = declare(
            self, 'limits', 'iso_ts_15066_2016', 'limit set: name in config/limits, or a file'
        )
        self._wait = declare(
            self, 'parameters_wait', 1.0, 'judge without the fitter after this time [s]', low=0.0
        )
        profile = declare_settings(self, MeasurementProfile, prefix='profile.')
        rules = declare_settings(self, JudgementRules, prefix='rules.')
        refuse_unknown(self)
        self._stage = Compliance(load_limits(limits), profile, rules)
        self._publisher = self.create_publisher(msg.ComplianceVerdict, 'verdict', qos.LATCHED)
        self._last = ''
        self._pending: dict[int, _Pending] = {}
        self.create_subscription(
            msg.TestPoint, 'test_point', self.guard(self._on_test_point), qos.LATCHED
        )
        for kind, topic, profile_of in (
            (msg.ImpactEvent, 'events', qos.EVENTS),
            (msg.SensorParameters, 'sensor_parameters', qos.EVENTS),
            (msg.ImpactParameters, 'impact_parameters', qos.EVENTS),
        ):
            self.create_subscription(kind, topic, self.guard(self._on_part), profile_of)
        self.create_timer(0.1, self._judge_overdue, clock=STEADY)

    def _on_test_point(self, message: msg.TestPoint) -> None:
        self._publish(self._stage.take_test_point(to_record(message)))

    def _on_part(self, message: Any) -> None:
        record = to_record(message)
        pending = self._pending.setdefault(record.event_id, _Pending())
        if isinstance(record, ImpactEvent):
            pending.event = record
        elif isinstance(record, SensorParameters):
            pending.sensor = record
        else:
            pending.impact = record
        # In the order of the events: the stage judges repetitions as they come.
        for number in sorted(self._pending):
            if not self._pending[number].is_complete:
                break
            self._judge(number)

    def _judge_overdue(self) -> None:
        now = time.monotonic()
        for number in sorted(self._pending):
            pending = self._pending[number]
            if now - pending.since < self._wait:
                break
            self._judge(number)

    def _judge(self, number: int) -> None:
        pending = self._pending.pop(number)
        if pending.event is not None:
            self._publish(
                self._stage.push(pending.event, sensor=pending.sensor, impact=pending.impact)
            )

    def finish(self) -> None:
        """Judge what is waiting, and a test point that is still open."""
        for number in sorted(self._pending):
            self._judge(number)
        self._publish(self._stage.flush())

    def _publish(self, verdicts: Iterable[ComplianceVerdict]) -> None:
        for verdict in verdicts:
            self._publisher.publish(to_message(verdict))
            self.published += 1
            what = (
                f'test point {verdict.test_point.id!r}'
                if verdict.scope is VerdictScope.TEST_POINT
                else f'blow {verdict.event_ids[0]}'
            )
            reason = verdict.reasons[0] if verdict.reasons else ''
            self._last = f'{what}: {verdict.verdict.name}. {reason}'
            self.get_logger().info(self._last)

    def state(self) -> tuple[str, dict[str, Any]]:
        """The last verdict."""
        return '', {'last': self._last, 'waiting': len(self._pending)}
