"""Quality of service, by kind of data, in one place.

A subscriber matches a publisher only where it asks for no more than is offered. Publishers here
are reliable, so viewers may subscribe best-effort.
"""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

__all__ = ['DIAGNOSTICS', 'EVENTS', 'LATCHED', 'MIRROR', 'OVERRIDES', 'SAMPLES', 'WRENCH_IN']

# At 20 ms a block this is 80 s of one channel, or 20 s of four channels on one topic: what a
# consumer may fall behind, while it is started for instance, before data is lost.
SAMPLES = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=4000, reliability=ReliabilityPolicy.RELIABLE
)
# One message a sample: a second at 10 kHz.
WRENCH_IN = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=10_000, reliability=ReliabilityPolicy.RELIABLE
)
# Large and rare; a late viewer asks the recording.
EVENTS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=50, reliability=ReliabilityPolicy.RELIABLE
)
# Results, seen by whoever comes late.
LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=50,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# For plots only: a slow viewer must not hold up the bench.
MIRROR = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.BEST_EFFORT
)
DIAGNOSTICS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=50, reliability=ReliabilityPolicy.RELIABLE
)

# Users may override history, depth and reliability by parameter, as usual in ROS 2.
OVERRIDES = QoSOverridingOptions.with_default_policies()
