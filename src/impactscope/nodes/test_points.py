"""Node: what is being tested, told by services, published latched.

Services ``start_test_point`` and ``end_test_point``; topic ``test_point``.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from impactscope import msg, srv
from impactscope.nodes import qos
from impactscope.nodes.base import StageNode
from impactscope.nodes.conversions import to_message, to_record
from impactscope.nodes.parameters import refuse_unknown
from impactscope.records import TestPoint

__all__ = ['TestPoints']


class TestPoints(StageNode):
    """Holds the open test point; at most one is open at a time."""

    __test__ = False

    def __init__(self, **keywords: Any) -> None:
        super().__init__('test_points', **keywords)
        refuse_unknown(self)
        self._open: TestPoint | None = None
        self._used: set[str] = set()
        self._publisher = self.create_publisher(msg.TestPoint, 'test_point', qos.LATCHED)
        self.create_service(srv.StartTestPoint, 'start_test_point', self._start)
        self.create_service(srv.EndTestPoint, 'end_test_point', self._end)

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _start(
        self, request: srv.StartTestPoint.Request, response: srv.StartTestPoint.Response
    ) -> srv.StartTestPoint.Response:
        self.received += 1
        point = to_record(request.test_point)
        if not point.id:
            response.message = 'a test point needs an id'
        elif point.id in self._used:
            response.message = f'test point {point.id!r} has been used already; choose another id'
        elif self._open is not None:
            response.message = f'test point {self._open.id!r} is open; end it first'
        else:
            point = dataclasses.replace(point, start_ns=point.start_ns or self._now_ns(), end_ns=0)
            self._used.add(point.id)
            self._open = point
            self._publish(point)
            response.success = True
            response.message = f'test point {point.id!r} is open'
        return response

    def _end(
        self, request: srv.EndTestPoint.Request, response: srv.EndTestPoint.Response
    ) -> srv.EndTestPoint.Response:
        self.received += 1
        if self._open is None:
            response.message = 'no test point is open'
        elif request.id and request.id != self._open.id:
            response.message = f'test point {request.id!r} is not open, {self._open.id!r} is'
        else:
            point = dataclasses.replace(self._open, end_ns=self._now_ns())
            self._open = None
            self._publish(point)
            response.success = True
            response.message = f'test point {point.id!r} is closed'
        return response

    def _publish(self, point: TestPoint) -> None:
        self._publisher.publish(to_message(point))
        self.published += 1

    def state(self) -> tuple[str, dict[str, Any]]:
        """The open test point."""
        return '', {'open': self._open.id if self._open else ''}
