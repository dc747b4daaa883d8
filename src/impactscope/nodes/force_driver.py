"""Node: the force measuring device. Lifecycle; publishes ``force_samples``."""

from __future__ import annotations

from typing import Any

from impactscope.nodes.driver import Driver

__all__ = ['ForceDriver']


class ForceDriver(Driver):
    """Publishes the channels of force, torque and displacement: force, force.hammer, …"""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(
            'force_driver', 'force_samples', ('force', 'displacement', 'torque'), **keywords
        )
