"""What the stage nodes share: diagnostics, counting, and a guard around each callback."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from impactscope.errors import ImpactscopeError
from impactscope.nodes.diagnostics import ERROR, OK, WARN, Diagnostics, Report

__all__ = ['STEADY', 'StageNode']

STEADY = Clock(clock_type=ClockType.STEADY_TIME)


class StageNode(Node):
    """A node around a stage.

    A record that a stage refuses is counted and said, and the node lives on: one bad block must
    not end a measurement.
    """

    def __init__(self, name: str, **keywords: Any) -> None:
        super().__init__(name, **keywords)
        self.received = 0
        self.published = 0
        self.refused = 0
        self._trouble = ''
        self._diagnostics = Diagnostics(self, self._report)

    def guard(self, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """The callback, counted, with errors said instead of raised into the executor."""

        def guarded(message: Any) -> None:
            self.received += 1
            try:
                callback(message)
            except ImpactscopeError as error:
                self.refused += 1
                self._trouble = str(error)
                self.get_logger().error(f'{self.get_name()}: {error}', throttle_duration_sec=1.0)
            except Exception as error:  # noqa: BLE001 - a fault of ours must not end a measurement
                self.refused += 1
                self._trouble = f'{type(error).__name__}: {error}'
                self.get_logger().error(
                    f'{self.get_name()}: unexpected\n{traceback.format_exc()}',
                    throttle_duration_sec=1.0,
                )

        return guarded

    def state(self) -> tuple[str, dict[str, Any]]:
        """A warning (empty: none) and values for ``/diagnostics``; stages override."""
        return '', {}

    def _report(self) -> Report:
        warning, values = self.state()
        values = {
            'received': self.received,
            'published': self.published,
            'refused': self.refused,
            **values,
        }
        if self._trouble:
            trouble, self._trouble = self._trouble, ''
            return ERROR, trouble, values
        if warning:
            return WARN, warning, values
        return OK, 'running', values
