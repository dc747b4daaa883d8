"""Node: records every topic of the bench to MCAP, as it goes over the wire.

Topics are found by looking at the graph, so that what is added to a bench is recorded too.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from impactscope.errors import ConfigurationError
from impactscope.nodes.base import STEADY, StageNode
from impactscope.nodes.parameters import declare, refuse_unknown
from impactscope.nodes.topics import TOPICS
from impactscope.recordings import Delivery, RecordingWriter
from impactscope.version import __version__

__all__ = ['Recorder']

_NEVER = ('/rosout', '/parameter_events', '/clock')


class Recorder(StageNode):
    """Writes what it hears; flushed often enough that a killed process loses at most a second."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__('recorder', **keywords)
        path = declare(self, 'path', '', 'file to write; empty: named by the time of the start')
        self._wanted = declare(self, 'topics', (), 'topics to record; empty: all of the namespace')
        self._left_out = declare(
            self,
            'leave_out',
            ('synced', 'synced_until'),
            'topics not to record: they follow from others',
        )
        notes = _pairs(declare(self, 'provenance', (), 'notes for the file: key=value'))
        refuse_unknown(self)
        target = Path(path or time.strftime('impactscope_%Y%m%d_%H%M%S.mcap'))
        target.parent.mkdir(parents=True, exist_ok=True)
        self.path = target
        self._writer = RecordingWriter(
            target,
            metadata={'provenance': {'software': f'impactscope {__version__}', **notes}},
            overwrite=True,
        )
        self._closed = False
        self._bytes = 0
        self._waiting: list[tuple[str, str, bytes, Delivery]] = []
        self._topics: set[str] = set()
        self._subscribe_known()
        self._discover()
        self.create_timer(0.2, self._discover, clock=STEADY)

    def _is_wanted(self, topic: str) -> bool:
        namespace = self.get_namespace().rstrip('/') + '/'
        if topic in _NEVER:
            return False
        if self._wanted:
            return topic in {self.resolve_topic_name(name) for name in self._wanted}
        if topic in {self.resolve_topic_name(name) for name in self._left_out}:
            return False
        if topic.startswith(namespace + 'mirror/'):
            return False
        return topic.startswith(namespace) or topic == '/diagnostics'

    def _subscribe_known(self) -> None:
        """The bench's own topics, before anybody publishes on them."""
        for name, (kind, profile) in TOPICS.items():
            topic = self.resolve_topic_name(name)
            if self._is_wanted(topic):
                self._subscribe(topic, kind, profile)

    def _discover(self) -> None:
        for topic, types in self.get_topic_names_and_types():
            if topic in self._topics or not self._is_wanted(topic):
                continue
            offers = [offer.qos_profile for offer in self.get_publishers_info_by_topic(topic)]
            if not offers:
                continue
            kind = _message_class(types[0])
            if kind is None:
                self._topics.add(topic)
                self.get_logger().warning(
                    f'recorder: {topic} of type {types[0]} is not known here'
                )
                continue
            self._subscribe(topic, kind, _what_all_offer(offers))

    def _subscribe(self, topic: str, kind: Any, profile: QoSProfile) -> None:
        self._topics.add(topic)
        latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        delivery = Delivery.LATCHED if latched else Delivery.STREAM
        package = kind.__module__.partition('.')[0]
        callback = self._callback(topic, f'{package}/msg/{kind.__name__}', delivery)
        self.create_subscription(kind, topic, self.guard(callback), profile, raw=True)

    def _callback(self, topic: str, type_name: str, delivery: Delivery) -> Callable[[bytes], None]:
        def on_message(data: bytes) -> None:
            if self._closed:
                return
            self._bytes += len(data)
            self._waiting.append((topic, type_name, data, delivery))
            now_ns = int(self.get_clock().now().nanoseconds)
            if now_ns == 0:  # simulated time has not begun: there is no time to log it at
                return
            self._write_waiting(now_ns)

        return on_message

    def _write_waiting(self, now_ns: int) -> None:
        for topic, type_name, data, delivery in self._waiting:
            self._writer.write(topic, type_name, data, now_ns, delivery=delivery)
        self._waiting.clear()

    def finish(self) -> None:
        """Write what waits, and close the file."""
        self._write_waiting(int(self.get_clock().now().nanoseconds))
        self._close()

    def _close(self) -> None:
        self._closed = True
        self._writer.close()

    def destroy_node(self) -> None:
        """Close the file and go."""
        self._close()
        super().destroy_node()

    def state(self) -> tuple[str, dict[str, Any]]:
        """What has been written."""
        return '', {'file': self.path.name, 'bytes': self._bytes, 'topics': len(self._topics)}


def _what_all_offer(offers: Sequence[QoSProfile]) -> QoSProfile:
    """The most that can be asked for without losing a publisher."""
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=2000,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _message_class(type_name: str) -> Any:
    package, _, name = type_name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        return None


def _pairs(texts: Iterable[str]) -> dict[str, str]:
    pairs = {}
    for text in texts:
        key, found, value = text.partition('=')
        if not found:
            raise ConfigurationError(f'recorder: provenance {text!r}; written as key=value')
        pairs[key.strip()] = value.strip()
    return pairs
