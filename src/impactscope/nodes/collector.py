"""Node: gathers what the graph says of each blow, for a report or a console."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from impactscope import msg
from impactscope.nodes import qos
from impactscope.nodes.base import StageNode
from impactscope.nodes.conversions import to_record
from impactscope.nodes.parameters import refuse_unknown
from impactscope.records import (
    ComplianceVerdict,
    EventResult,
    ImpactEvent,
    ImpactParameters,
    SensorParameters,
    VerdictScope,
)

__all__ = ['Collector']


class Collector(StageNode):
    """Puts event, parameters and verdict together by the event's number.

    Args:
        on_result: called with each blow once all four are there.
        on_test_point: called with each verdict on a test point.
        keywords: for the ROS node.
    """

    def __init__(
        self,
        on_result: Callable[[EventResult], None] | None = None,
        on_test_point: Callable[[ComplianceVerdict], None] | None = None,
        **keywords: Any,
    ) -> None:
        super().__init__('collector', **keywords)
        refuse_unknown(self)
        self.results: list[EventResult] = []
        self.test_points: dict[str, ComplianceVerdict] = {}
        self._on_result = on_result
        self._on_test_point = on_test_point
        self.on_verdict: Callable[[ComplianceVerdict], None] | None = None
        self._parts: dict[int, dict[type, Any]] = {}
        for kind, topic, profile in (
            (msg.ImpactEvent, 'events', qos.EVENTS),
            (msg.SensorParameters, 'sensor_parameters', qos.LATCHED),
            (msg.ImpactParameters, 'impact_parameters', qos.LATCHED),
            (msg.ComplianceVerdict, 'verdict', qos.LATCHED),
        ):
            self.create_subscription(kind, topic, self.guard(self._on_message), profile)

    def _on_message(self, message: Any) -> None:
        record = to_record(message)
        if isinstance(record, ComplianceVerdict) and record.scope is VerdictScope.TEST_POINT:
            self.test_points[record.test_point.id] = record
            if self._on_test_point is not None:
                self._on_test_point(record)
            return
        if isinstance(record, ComplianceVerdict) and self.on_verdict is not None:
            self.on_verdict(record)
        number = record.event_ids[0] if isinstance(record, ComplianceVerdict) else record.event_id
        parts = self._parts.setdefault(number, {})
        parts[type(record)] = record
        if len(parts) == 4:
            del self._parts[number]
            result = EventResult(
                parts[ImpactEvent],
                parts[SensorParameters],
                parts[ImpactParameters],
                parts[ComplianceVerdict],
            )
            self.results.append(result)
            if self._on_result is not None:
                self._on_result(result)
