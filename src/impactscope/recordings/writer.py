"""Write MCAP recordings as rosbag2 does, so that a kill at any moment loses little."""

from __future__ import annotations

import contextlib
import enum
import os
import re
import struct
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, Writer

from impactscope.errors import ConfigurationError, InputError, RecordingError
from impactscope.records import SampleBlock, TestPoint
from impactscope.version import __version__

from .block_codec import encode_block
from .definitions import BLOCK_TYPE, DECODING_ERRORS, TEST_POINT_TYPE, schema_text
from .message_records import encode_test_point

__all__ = ['Delivery', 'RecordingWriter']

_COMPRESSIONS = {
    'none': CompressionType.NONE,
    'zstd': CompressionType.ZSTD,
    'lz4': CompressionType.LZ4,
}
_TOPIC = re.compile(r'(/[A-Za-z_][A-Za-z0-9_]*)+')
_FOR_EVER = 'sec: 9223372036\n    nsec: 854775807'
_PROFILE = """- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline:
    {for_ever}
  lifespan:
    {for_ever}
  liveliness: automatic
  liveliness_lease_duration:
    {for_ever}
  avoid_ros_namespace_conventions: false"""


class Delivery(enum.Enum):
    """How a topic was offered, kept so that a player offers it alike."""

    STREAM = _PROFILE.format(depth=200, durability='volatile', for_ever=_FOR_EVER)
    LATCHED = _PROFILE.format(depth=1, durability='transient_local', for_ever=_FOR_EVER)


@dataclass(frozen=True, slots=True)
class _Topic:
    channel: int
    type: str


class RecordingWriter:
    """Appends messages and records to a new MCAP file; safe to use from several threads.

    A thread of its own closes the current chunk, and has the system write it to the disk,
    every ``flush_interval`` seconds: whatever ends the process, all that is older is in the
    file, and a reader finds it. Also a context manager; :meth:`close` writes the index.

    Args:
        path: of the file to make.
        metadata: named groups of key and value, for example ``{'provenance': {...}}``.
        compression: 'zstd', 'lz4' or 'none'.
        chunk_size: bytes at which a chunk is closed before its time.
        flush_interval: s; 0 leaves flushing to chunk size and close.
        overwrite: whether an existing file is replaced.

    Raises RecordingError where the file exists or cannot be made, and ConfigurationError for
    an unknown compression or an interval or size out of range.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
        compression: str = 'zstd',
        chunk_size: int = 1 << 20,
        flush_interval: float = 0.5,
        overwrite: bool = False,
    ) -> None:
        if compression not in _COMPRESSIONS:
            raise ConfigurationError(
                f'compression is {compression!r}; known are {", ".join(_COMPRESSIONS)}'
            )
        if not 0 <= flush_interval <= 60:
            raise ConfigurationError(f'flush_interval is {flush_interval!r} s; it must be 0 to 60')
        if not 1 <= chunk_size <= 1 << 28:
            raise ConfigurationError(f'chunk_size is {chunk_size!r} bytes; it must be 1 to 2**28')
        self.path = Path(path)
        try:
            self._file = self.path.open('wb' if overwrite else 'xb')
        except FileExistsError as error:
            raise RecordingError(f'{self.path.name!r} exists already') from error
        except OSError as error:
            raise RecordingError(f'{str(path)!r} cannot be made: {error.strerror}') from error
        self._writer = Writer(
            self._file, compression=_COMPRESSIONS[compression], chunk_size=chunk_size
        )
        self._lock = threading.Lock()
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[str, int] = {}
        self._unflushed = False
        self._failure: OSError | None = None
        self._closing = threading.Event()
        self._interval = flush_interval
        try:
            self._writer.start(profile='ros2', library=f'impactscope {__version__}')
            for name, pairs in (metadata or {}).items():
                self._writer.add_metadata(name, {str(k): str(v) for k, v in pairs.items()})
            self._flush()
        except OSError as error:
            self._abandon(error)
            raise self._error() from error
        self._thread = threading.Thread(
            target=self._flush_regularly, name=f'flush {self.path.name}', daemon=True
        )
        if flush_interval > 0:
            self._thread.start()

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def write(
        self,
        topic: str,
        type_name: str,
        cdr: bytes,
        log_ns: int,
        publish_ns: int | None = None,
        *,
        delivery: Delivery = Delivery.STREAM,
        definition: str | None = None,
    ) -> None:
        """Append a serialised message.

        Args:
            topic: absolute name; its type and delivery are those of its first message.
            type_name: for example ``geometry_msgs/msg/WrenchStamped``.
            cdr: the message with its encapsulation header.
            log_ns: when it was received, ns.
            publish_ns: when it was published, ns; ``log_ns`` where it is not known.
            delivery: how the topic was offered.
            definition: text of the type's definition; None for the one known here.

        Raises InputError for a topic that is no ROS name or changes its type, or for a time
        below zero; RecordingError where no definition of the type is known, where the file
        cannot be written, or after close.
        """
        publish_ns = log_ns if publish_ns is None else publish_ns
        if log_ns < 0 or publish_ns < 0:
            raise InputError(f'a message of {topic!r} has the time {min(log_ns, publish_ns)} ns')
        with self._lock:
            self._check()
            known = self._topics.get(topic) or self._declare(
                topic, type_name, delivery, definition
            )
            if known.type != type_name:
                raise InputError(f'topic {topic!r} carries {known.type}, not {type_name}')
            self._unflushed = True
            try:
                self._writer.add_message(known.channel, log_ns, cdr, publish_ns)
            except OSError as error:
                self._failure = error
                raise self._error() from error

    def write_block(
        self, block: SampleBlock, topic: str | None = None, log_ns: int | None = None
    ) -> None:
        """Append a block.

        Args:
            block: what to write.
            topic: by default the channel's name with slashes for points.
            log_ns: by default when the block was received, or its stamp where that is unknown.

        Raises as :meth:`write` does, and InputError where a field does not fit its message.
        """
        topic = topic or '/' + block.channel.replace('.', '/')
        try:
            data = encode_block(block)
        except struct.error as error:
            raise InputError(
                f'a block of channel {block.channel!r} does not fit its message ({error})'
            ) from error
        self.write(
            topic,
            BLOCK_TYPE,
            data,
            log_ns if log_ns is not None else block.received_ns or block.stamp_ns,
            block.received_ns or None,
        )

    def write_test_point(
        self, point: TestPoint, topic: str = '/test_point', log_ns: int | None = None
    ) -> None:
        """Append a test point, latched; by default at its end, or at its start while open."""
        try:
            data = encode_test_point(point)
        except DECODING_ERRORS as error:
            raise InputError(
                f'test point {point.id!r} does not fit its message ({error})'
            ) from error
        if log_ns is None:
            log_ns = point.end_ns or point.start_ns
        self.write(topic, TEST_POINT_TYPE, data, log_ns, delivery=Delivery.LATCHED)

    def add_metadata(self, name: str, pairs: Mapping[str, str]) -> None:
        """Add a named group of key and value."""
        with self._lock:
            self._check()
            self._writer.add_metadata(name, dict(pairs))
            self._unflushed = True

    def flush(self) -> None:
        """Close the current chunk and have all written to the disk."""
        try:
            with self._lock:
                self._check()
                self._flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            self._failure = error
            raise self._error() from error

    def close(self) -> None:
        """Write the index and close the file; a second call does nothing."""
        if self._closing.is_set():
            return
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
        with self._lock:
            try:
                if self._failure is None:
                    self._writer.finish()  # type: ignore[no-untyped-call]
                    self._file.flush()
                    os.fsync(self._file.fileno())
                    self._file.close()
            except OSError as error:
                self._failure = error
            if self._failure is not None:
                self._abandon(self._failure)
        if self._failure is not None:
            raise self._error() from self._failure

    def _declare(
        self, topic: str, type_name: str, delivery: Delivery, definition: str | None
    ) -> _Topic:
        if not _TOPIC.fullmatch(topic):
            raise InputError(f'{topic!r} is no absolute ROS topic name')
        schema = self._schemas.get(type_name)
        if schema is None:
            text = schema_text(type_name) if definition is None else definition
            schema = self._writer.register_schema(type_name, 'ros2msg', text.encode())
            self._schemas[type_name] = schema
        channel = self._writer.register_channel(
            topic, 'cdr', schema, {'offered_qos_profiles': delivery.value}
        )
        self._topics[topic] = _Topic(channel, type_name)
        return self._topics[topic]

    def _check(self) -> None:
        if self._failure is not None:
            raise self._error() from self._failure
        if self._closing.is_set():
            raise RecordingError(f'{self.path.name!r} is closed')

    def _error(self) -> RecordingError:
        reason = self._failure.strerror if self._failure else ''
        return RecordingError(f'{self.path.name!r} cannot be written: {reason}')

    def _abandon(self, failure: OSError) -> None:
        """Close a file that cannot be written; what is in it stays."""
        self._failure = failure
        with contextlib.suppress(OSError):  # closing tries to write what is left
            self._file.close()

    def _flush(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._unflushed = False

    def _flush_regularly(self) -> None:
        """Flush under the lock, wait for the disk outside of it."""
        while not self._closing.wait(self._interval):
            try:
                with self._lock:
                    if not self._unflushed:
                        continue
                    self._flush()
                os.fsync(self._file.fileno())
            except OSError as error:
                self._failure = error
                return
