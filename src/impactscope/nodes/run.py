"""Running nodes: one single-threaded executor, SIGINT ends cleanly with everything flushed."""

from __future__ import annotations

import gc
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from impactscope.errors import ImpactscopeError

__all__ = ['Spinner', 'run']


DRAIN = 10.0  # s


class Spinner:
    """Spins nodes in a thread of its own, as a context manager; leaving it finishes them.

    Nodes finish in the order given, upstream first, and what one publishes while finishing
    still reaches the next: the executor runs on until it is idle.
    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        self._nodes = list(nodes)
        self._executor = EventsExecutor()
        for node in self._nodes:
            self._executor.add_node(node)
        self._stop = Future()
        self._thread = threading.Thread(target=self._spin, name='spin', daemon=True)
        self.error: BaseException | None = None

    def _spin(self) -> None:
        try:
            while not self._stop.done() and rclpy.ok():
                self._executor.spin_until_future_complete(self._stop, timeout_sec=0.2)
        except ExternalShutdownException:
            pass
        except BaseException as error:  # noqa: BLE001 - handed to the thread that waits
            self.error = error

    def add_first(self, node: Node) -> None:
        """Take one more node, upstream of the others."""
        self._nodes.insert(0, node)
        self._executor.add_node(node)

    def __enter__(self) -> Spinner:
        # Libraries and nodes stay as long as this runs: a full collection that looks at all of
        # them again would hold up a verdict by a tenth of a second.
        gc.collect()
        gc.freeze()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.finish()
        for node in self._nodes:
            node.destroy_node()
        self._executor.shutdown()
        gc.unfreeze()

    def finish(self) -> None:
        """Stop spinning and let each node bring to an end what it has open; once."""
        if self._stop.done():
            return
        self._stop.set_result(None)
        self._thread.join()
        for node in self._nodes:  # whoever acquires stops first: else there is no end
            halt = getattr(node, 'halt', None)
            if halt is not None:
                halt()
        self._drain()
        for node in self._nodes:
            finish = getattr(node, 'finish', None)
            if finish is not None and rclpy.ok():
                finish()
            self._drain()

    def _drain(self) -> None:
        """Run callbacks that are due, until none has come for a moment; ``DRAIN`` s at most."""
        if not rclpy.ok():
            return
        wake = Future()
        idle = 0
        deadline = time.monotonic() + DRAIN
        while idle < 3 and time.monotonic() < deadline:
            before = _count_callbacks(self._nodes)
            self._executor.spin_until_future_complete(wake, timeout_sec=0.02)
            idle = idle + 1 if _count_callbacks(self._nodes) == before else 0


def _count_callbacks(nodes: Sequence[Any]) -> int:
    return sum(getattr(node, 'received', 0) for node in nodes)


def run(make_node: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Run one node until SIGINT or SIGTERM; returns the exit code (2: wrong configuration)."""
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    try:
        try:
            node = make_node()
        except ImpactscopeError as error:
            sys.stderr.write(f'impactscope: {error}\n')
            return 2
        with Spinner([node]) as spinner:
            while not ended.wait(0.2):
                if spinner.error is not None:
                    raise spinner.error
        return 0
    finally:
        rclpy.try_shutdown()
