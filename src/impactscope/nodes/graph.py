"""A whole bench in one process: the same nodes as the launch files start, one by one."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import rclpy
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from impactscope import msg
from impactscope.nodes import qos
from impactscope.nodes.accelerometer_driver import AccelerometerDriver
from impactscope.nodes.collector import Collector
from impactscope.nodes.compliance import ComplianceNode
from impactscope.nodes.conversions import to_message
from impactscope.nodes.driver import Driver
from impactscope.nodes.fitter import FitterNode
from impactscope.nodes.force_driver import ForceDriver
from impactscope.nodes.impact_detector import Detector
from impactscope.nodes.recorder import Recorder
from impactscope.nodes.run import Spinner
from impactscope.nodes.synchroniser import SynchroniserNode
from impactscope.nodes.test_points import TestPoints
from impactscope.records import ComplianceVerdict, EventResult, TestPoint

__all__ = ['Bench', 'BenchOptions']


@dataclass(frozen=True)
class BenchOptions:
    """What runs, and with which parameters.

    ``drivers`` and ``stages`` map a node's name to parameters that go over the parameter file's.
    With ``start_delay`` the data of all drivers begin together, that many seconds after the
    stages are up: a host that is slow to start them would get what is past by then in one burst,
    one device's before the other's.
    """

    namespace: str = 'bench'
    params_file: Path | None = None
    drivers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    stages: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    record_to: Path | None = None
    serve_test_points: bool = True
    use_sim_time: bool = False
    start_delay: float | None = None


_DRIVERS = {'force_driver': ForceDriver, 'accelerometer_driver': AccelerometerDriver}


class Bench:
    """The running graph, as a context manager; leaving it flushes every stage in turn.

    Raises ConfigurationError on entry where a parameter is refused.
    """

    def __init__(
        self,
        options: BenchOptions,
        on_result: Callable[[EventResult], None] | None = None,
        on_test_point: Callable[[ComplianceVerdict], None] | None = None,
    ) -> None:
        self._options = options
        self._callbacks = (on_result, on_test_point)
        self._spinner: Spinner | None = None
        self._owns_rclpy = False
        self.drivers: list[Driver] = []
        self.nodes: list[Node] = []

    def _keywords(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        options = self._options
        overrides = dict(parameters)
        if options.use_sim_time:
            overrides['use_sim_time'] = True
        arguments = ['--ros-args']
        if options.params_file is not None:
            arguments += ['--params-file', str(options.params_file)]
        return {
            'namespace': options.namespace,
            'cli_args': arguments,
            'parameter_overrides': [
                Parameter(key, value=list(value) if isinstance(value, tuple) else value)
                for key, value in overrides.items()
            ],
        }

    def __enter__(self) -> Bench:
        options = self._options
        if not rclpy.ok():
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            self._owns_rclpy = True
        try:
            self._build()
        except BaseException:
            for node in self.nodes:
                node.destroy_node()
            self._shutdown()
            raise
        self._spinner = Spinner(self.nodes)
        self._spinner.__enter__()
        # The drivers come last: whoever listens is there before the first block.
        delay = options.start_delay
        start = {} if delay is None else {'start_at': time.time() + delay}
        for name, parameters in options.drivers.items():
            driver = _DRIVERS[name](**self._keywords(start | dict(parameters)))
            self.drivers.append(driver)
            self._spinner.add_first(driver)
        return self

    def _build(self) -> None:
        options = self._options

        def add(kind: Any, name: str, **parameters: Any) -> Any:
            given = {**options.stages.get(name, {}), **parameters}
            node = kind(**self._keywords(given))
            node.get_logger().set_level(LoggingSeverity.WARN)  # results come by the collector
            self.nodes.append(node)
            return node

        if options.serve_test_points:
            add(TestPoints, 'test_points')
        self.synchroniser = add(SynchroniserNode, 'synchroniser')
        self.detector = add(Detector, 'impact_detector')
        # Whoever subscribes first is called first: the verdict does not wait for the fit.
        self.compliance = add(ComplianceNode, 'compliance')
        self.fitter = add(FitterNode, 'fitter')
        self.collector = Collector(*self._callbacks, **self._keywords({}))
        self.nodes.append(self.collector)
        if options.record_to is not None:
            add(Recorder, 'recorder', path=str(options.record_to))

    @property
    def drivers_ended(self) -> bool:
        """Whether every driver has played all it had."""
        return all(driver.ended.is_set() for driver in self.drivers)

    def wait_until_ended(
        self, tick: Callable[[], None] = lambda: None, timeout: float = float('inf')
    ) -> bool:
        """Wait until the drivers have no more and every event is judged; whether they have."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            tick()
            self.check()
            if self.is_done:
                return True
            time.sleep(0.02)
        return False

    @property
    def is_done(self) -> bool:
        """Whether the drivers have no more and every blow is judged."""
        judged = len(self.collector.results)
        return self.drivers_ended and self.detector.ended and judged >= self.detector.published

    def announce(self, point: TestPoint) -> None:
        """Publish a test point, latched."""
        publisher = self.collector.create_publisher(msg.TestPoint, 'test_point', qos.LATCHED)
        publisher.publish(to_message(point))

    def finish(self) -> None:
        """Flush every stage in turn; what comes of it reaches the collector."""
        if self._spinner is not None:
            self._spinner.finish()

    def check(self) -> None:
        """Raise what went wrong in a callback, if anything did."""
        if self._spinner is not None and self._spinner.error is not None:
            raise self._spinner.error

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if self._spinner is not None:
                self._spinner.__exit__(kind, error, trace)
        finally:
            self._shutdown()

    def _shutdown(self) -> None:
        if self._owns_rclpy:
            rclpy.try_shutdown()
