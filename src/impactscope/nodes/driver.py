"""What the driver nodes share: a lifecycle around a source, an acquisition thread, flags.

The acquisition thread only reads, checks and publishes; everything ROS calls back runs in the
executor. A source that dies is closed and opened again, in a new epoch, until it delivers or
the node is deactivated.
"""

from __future__ import annotations

import threading
import time
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rosgraph_msgs.msg import Clock as ClockMessage

from impactscope import msg
from impactscope.drivers.faults import FaultySource, parse_faults
from impactscope.drivers.monitor import BlockMonitor
from impactscope.drivers.playback import end_ns
from impactscope.drivers.source import Source, SourceError
from impactscope.errors import ConfigurationError, ImpactscopeError
from impactscope.nodes import qos, sources
from impactscope.nodes.conversions import time_message, time_ns, to_message
from impactscope.nodes.diagnostics import ERROR, OK, WARN, Diagnostics, Report
from impactscope.nodes.parameters import declare, refuse_unknown
from impactscope.nodes.stream_codec import write_sample_block

__all__ = ['Driver']


class Driver(LifecycleNode):
    """A lifecycle node that publishes one device's blocks of samples.

    Args:
        name: of the node.
        topic: relative name of the topic that its blocks go to.
        prefixes: a channel belongs to this device if its name begins with one of these.
        keywords: passed on to the ROS node (namespace, parameter overrides, …).
    """

    def __init__(self, name: str, topic: str, prefixes: tuple[str, ...], **keywords: Any) -> None:
        super().__init__(name, **keywords)
        self._prefixes = prefixes
        get = self._declare
        self._kind = get('source', 'simulated', f'kind of source: {", ".join(sources.KINDS)}')
        self._channels = get('channels', (), 'channels to publish; empty: all of this device')
        self._autostart = get('autostart', True, 'configure and activate without a manager')
        self._retry = get(
            'retry_time', 0.5, 'wait before opening a dead device again [s]', low=0.0
        )
        self._stall_time = get(
            'stall_time', 0.25, 'a block later than this is stalled [s]', low=0.0
        )
        self._clock_tolerance = get(
            'clock_tolerance', 1e-3, 'device clock against sample count [s]', low=0.0
        )
        self._wait_for = get(
            'wait_for_subscribers',
            (),
            'topics that must have a subscriber before the first block, as topic or topic:count',
        )
        self._wait_time = get('wait_time', 10.0, 'wait no longer for subscribers [s]', low=0.0)
        self._faults = get('faults', (), 'faults to rehearse, kind@seconds[:duration]')
        self._options = sources.declare_options(self)
        self._topic = topic
        refuse_unknown(self)
        parse_faults(self._faults)

        self._publisher = self.create_publisher(
            msg.SampleBlock, topic, qos.SAMPLES, qos_overriding_options=qos.OVERRIDES
        )
        self._clock_publisher = (
            self.create_publisher(ClockMessage, '/clock', 10)
            if self._options['replay.publish_clock']
            else None
        )
        self._point_publisher = (
            self.create_publisher(msg.TestPoint, 'test_point', qos.LATCHED)
            if self._options['publish_test_points']
            else None
        )
        if self._options['replay.rate'] == 0 and self._kind == 'replay':
            self.create_subscription(Time, 'synced_until', self._on_progress, qos.SAMPLES)
        self._source: Source | None = None
        self._monitor = BlockMonitor(self._stall_time, self._clock_tolerance)
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._epoch = -1
        self._trouble = ''
        self._recoveries = 0
        self._last_delivery = time.monotonic()
        self._delivering = False
        self.ended = threading.Event()  # the source has no more
        self._diagnostics = Diagnostics(self, self._report)
        if self._autostart:
            self._start()

    def _declare(self, name: str, default: Any, doc: str, **limits: float) -> Any:
        return declare(self, name, default, doc, **limits)

    def _start(self) -> None:
        """Configure and activate; raises ConfigurationError with the reason where that fails."""
        if self.trigger_configure() != TransitionCallbackReturn.SUCCESS:
            reason = f'{self.get_name()}: {self._trouble}'
            self.destroy_node()
            raise ConfigurationError(reason)
        self.trigger_activate()

    def wants(self, channel: str) -> bool:
        """Whether a channel belongs to this device."""
        if self._channels:
            return channel in self._channels
        return channel.startswith(self._prefixes)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the source; a wrong parameter is said in a sentence."""
        try:
            source = sources.make(self._kind, self._options, self.wants)
            faults = parse_faults(self._faults)
            self._source = FaultySource(source, faults) if faults else source
        except ImpactscopeError as error:
            self.get_logger().error(f'{self.get_name()} cannot be configured: {error}')
            self._trouble = str(error)
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start acquiring, in a new epoch."""
        self._stop.clear()
        self.ended.clear()
        self._thread = threading.Thread(target=self._acquire, name=self.get_name(), daemon=True)
        self._thread.start()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop acquiring."""
        self.halt()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of the source."""
        self.halt()
        self._source = None
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop for good."""
        self.halt()
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """Stop acquiring and go."""
        self.halt()
        super().destroy_node()

    def halt(self) -> None:
        """Stop acquiring; what was read has been published."""
        self._stop.set()
        self._delivering = False
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _acquire(self) -> None:
        source = self._source
        if source is None:
            return
        self._await_subscribers()
        self._last_delivery = time.monotonic()
        self._delivering = True
        while not self._stop.is_set():
            self._epoch += 1
            try:
                source.open(self._epoch)
                while not self._stop.is_set():
                    self._publish(source.read(0.1))
                    if getattr(source, 'ended', False):
                        self.ended.set()
            except SourceError as error:
                self._say(f'{error}; opening the device again')
                self._recoveries += 1
            except ImpactscopeError as error:  # a recording that cannot be read further
                self._say(str(error))
                self.ended.set()
                return
            finally:
                source.close()
            self._stop.wait(self._retry)

    def _say(self, trouble: str) -> None:
        self._trouble = trouble
        self.get_logger().error(f'{self.get_name()}: {trouble}')

    def _publish(self, blocks: list[Any]) -> None:
        source: Any = self._source
        if blocks:
            self._last_delivery = time.monotonic()
        for block in blocks:
            self._publisher.publish(write_sample_block(self._monitor.check(block)))
            if self._clock_publisher is not None:
                self._clock_publisher.publish(ClockMessage(clock=time_message(end_ns(block))))
        if blocks and self._trouble and self._epoch > 0:
            self._trouble = ''
        points = getattr(source, 'test_points', None)
        while points:
            point = points.pop(0)
            if self._point_publisher is not None:
                self._point_publisher.publish(to_message(point))

    def _await_subscribers(self) -> None:
        missing = list(self._wait_for)
        waited = 0.0
        while missing and waited < self._wait_time and not self._stop.is_set():
            missing = [text for text in missing if not self._has_subscribers(text)]
            if missing:
                self._stop.wait(0.05)
                waited += 0.05
        if missing and not self._stop.is_set():
            self.get_logger().warning(
                f'{self.get_name()}: nobody listens to {", ".join(missing)} after '
                f'{self._wait_time} s; going on'
            )
        self._stop.wait(0.1)  # discovery is seen here a moment before data can flow there

    def _has_subscribers(self, text: str) -> bool:
        topic, _, count = text.partition(':')
        return bool(self.count_subscribers(topic) >= int(count or 1))

    def _on_progress(self, message: Time) -> None:
        source: Any = self._source
        pace = getattr(source, 'pace', None)
        if pace is not None:
            pace.progress(time_ns(message))

    def _report(self) -> Report:
        counts = self._monitor.statistics
        values = {
            'source': self._kind,
            'epoch': self._epoch,
            'recoveries': self._recoveries,
            'ended': self.ended.is_set(),
            **{name: getattr(counts, name) for name in counts.__dataclass_fields__},
        }
        if self._trouble:
            return ERROR, self._trouble, values
        silent = time.monotonic() - self._last_delivery
        if self._delivering and not self.ended.is_set() and silent > 1.0 + self._stall_time:
            return WARN, f'no data for {silent:.1f} s', values
        if counts.stalls or counts.lost_samples or counts.clock_jumps or counts.not_finite_blocks:
            return WARN, 'delivered with faults; see the counts', values
        return OK, 'acquiring' if self._thread is not None else 'not active', values
