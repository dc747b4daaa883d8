"""Node: what each blow tells about sensor and impactor.

Topic ``events`` in; ``sensor_parameters``, ``impact_parameters`` and, of all blows together,
``sensor_summary`` out, latched.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from impactscope import msg
from impactscope.estimate import (
    Fitter,
    FitterSettings,
    ImpactSettings,
    RepeatedBlows,
    estimate_impact,
)
from impactscope.nodes import qos
from impactscope.nodes.base import STEADY, StageNode
from impactscope.nodes.conversions import to_message, to_record
from impactscope.nodes.parameters import declare_settings, refuse_unknown
from impactscope.nodes.warm_up import warm_up_fitter

__all__ = ['FitterNode']


class FitterNode(StageNode):
    """Runs :class:`~impactscope.estimate.Fitter` and the impact estimator on events."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__('fitter', **keywords)
        self._stage = Fitter(declare_settings(self, FitterSettings))
        self._impact = declare_settings(self, ImpactSettings, prefix='impact.')
        refuse_unknown(self)
        warm_up_fitter()
        self._sensor_publisher = self.create_publisher(
            msg.SensorParameters, 'sensor_parameters', qos.LATCHED
        )
        self._impact_publisher = self.create_publisher(
            msg.ImpactParameters, 'impact_parameters', qos.LATCHED
        )
        self._repeated = RepeatedBlows()
        self._summary_publisher = self.create_publisher(
            msg.SensorSummary, 'sensor_summary', qos.LATCHED
        )
        # A fit takes longer than a judgement, and nobody may have to wait for it: it is put off.
        self._waiting: deque[msg.ImpactEvent] = deque()
        self._timer = self.create_timer(0.002, self._fit_next, clock=STEADY)
        self._timer.cancel()
        self.create_subscription(msg.ImpactEvent, 'events', self.guard(self._on_event), qos.EVENTS)

    def _on_event(self, message: msg.ImpactEvent) -> None:
        self._waiting.append(message)
        self._timer.reset()

    def _fit_next(self) -> None:
        """Fit one event that waits; the timer lets whatever is due meanwhile go first."""
        if self._waiting:
            self._fit(self._waiting.popleft())
        if not self._waiting:
            self._timer.cancel()

    def _fit(self, message: msg.ImpactEvent) -> None:
        event = to_record(message)
        for sensor in self._stage.push(event):
            self._sensor_publisher.publish(to_message(sensor))
            impact = estimate_impact(event, sensor, self._impact)
            self._impact_publisher.publish(to_message(impact))
            for summary in self._repeated.push(sensor):
                self._summary_publisher.publish(to_message(summary))
            self.published += 1

    def finish(self) -> None:
        """Fit what still waits."""
        while self._waiting:
            self._fit(self._waiting.popleft())
