"""Node: judges each blow and each test point against the limits.

``events`` and ``test_point`` in, ``verdict`` out, latched. The judgement rests on the event
alone: no estimator can delay or change it. It measures and judges; it is not a safety function,
and it never commands a robot.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from impactscope import msg
from impactscope.comply import Compliance, JudgementRules
from impactscope.configuration import load_limits
from impactscope.measurement_profile import MeasurementProfile
from impactscope.nodes import qos
from impactscope.nodes.base import StageNode
from impactscope.nodes.conversions import to_message, to_record
from impactscope.nodes.parameters import declare, declare_settings, refuse_unknown
from impactscope.records import ComplianceVerdict, VerdictScope

__all__ = ['ComplianceNode']


class ComplianceNode(StageNode):
    """Runs :class:`~impactscope.comply.Compliance` on events."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__('compliance', **keywords)
        limits = declare(
            self, 'limits', 'iso_ts_15066_2016', 'limit set: name in config/limits, or a file'
        )
        profile = declare_settings(self, MeasurementProfile, prefix='profile.')
        rules = declare_settings(self, JudgementRules, prefix='rules.')
        refuse_unknown(self)
        self._stage = Compliance(load_limits(limits), profile, rules)
        self._publisher = self.create_publisher(msg.ComplianceVerdict, 'verdict', qos.LATCHED)
        self._last = ''
        self.create_subscription(
            msg.TestPoint, 'test_point', self.guard(self._on_test_point), qos.LATCHED
        )
        self.create_subscription(msg.ImpactEvent, 'events', self.guard(self._on_event), qos.EVENTS)

    def _on_test_point(self, message: msg.TestPoint) -> None:
        self._publish(self._stage.take_test_point(to_record(message)))

    def _on_event(self, message: msg.ImpactEvent) -> None:
        self._publish(self._stage.push(to_record(message)))

    def finish(self) -> None:
        """Judge a test point that is still open."""
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
        return '', {'last': self._last}
