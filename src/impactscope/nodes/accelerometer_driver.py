"""Node: the accelerometers. Lifecycle; publishes ``acceleration_samples``."""

from __future__ import annotations

from typing import Any

from impactscope.nodes.driver import Driver

__all__ = ['AccelerometerDriver']


class AccelerometerDriver(Driver):
    """Publishes the acceleration channels: plate, impactor, base, …"""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(
            'accelerometer_driver', 'acceleration_samples', ('acceleration',), **keywords
        )
