"""The topics of a bench: relative names, types, and how they are offered."""

from __future__ import annotations

from typing import Any, NamedTuple

from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile

from impactscope import msg
from impactscope.nodes import qos

__all__ = ['TOPICS', 'Topic']


class Topic(NamedTuple):
    """What goes over a topic, and how."""

    type: Any
    profile: QoSProfile

    @property
    def is_latched(self) -> bool:
        """Whether who comes late still gets the last messages."""
        return self.profile is qos.LATCHED


TOPICS = {
    'force_samples': Topic(msg.SampleBlock, qos.SAMPLES),
    'acceleration_samples': Topic(msg.SampleBlock, qos.SAMPLES),
    'test_point': Topic(msg.TestPoint, qos.LATCHED),
    'synced': Topic(msg.SyncedBlock, qos.SAMPLES),
    'synced_until': Topic(Time, qos.SAMPLES),
    'events': Topic(msg.ImpactEvent, qos.EVENTS),
    'sensor_parameters': Topic(msg.SensorParameters, qos.LATCHED),
    'sensor_summary': Topic(msg.SensorSummary, qos.LATCHED),
    'impact_parameters': Topic(msg.ImpactParameters, qos.LATCHED),
    'verdict': Topic(msg.ComplianceVerdict, qos.LATCHED),
    'model_mismatch': Topic(msg.ModelMismatch, qos.LATCHED),
}
