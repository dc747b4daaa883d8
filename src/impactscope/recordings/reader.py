"""Open recordings: MCAP files, rosbag2 folders and rosbag2 SQLite files."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
import yaml

from impactscope.errors import MissingChannelError, RecordingError, TornRecordingError
from impactscope.records import SampleBlock, TestPoint

from .batch import Damage, MessageBatch
from .info import Reading, RecordingInfo, TopicInfo
from .mcap_source import MAGIC as MCAP_MAGIC
from .mcap_source import McapSource
from .sample_run import SampleRun
from .source import Source
from .sqlite_source import MAGIC as SQLITE_MAGIC
from .sqlite_source import SqliteSource
from .topic_decoder import Item, TopicDecoder, reading_of

__all__ = ['RawMessage', 'Recording', 'open_recording']

_DECODED = frozenset({Reading.BLOCKS, Reading.SAMPLES, Reading.TEST_POINTS})


class RawMessage(NamedTuple):
    """A message as it was recorded."""

    topic: str
    type: str
    log_ns: int
    publish_ns: int
    data: bytes  # serialised, with its encapsulation header


class Recording:
    """A recording of one or several files, read as a stream: memory does not grow with it.

    Made by :func:`open_recording`; also a context manager. With ``tolerate_damage`` a damaged
    recording ends without an exception, and ``damage`` tells what was lost. A chunk that is cut
    gives its whole messages; one that fails its checksum gives none, since altered samples are
    no measurement.
    """

    def __init__(
        self,
        path: Path,
        sources: list[Source],
        *,
        notes: tuple[str, ...] = (),
        damage: tuple[Damage, ...] = (),
        tolerate_damage: bool = False,
    ) -> None:
        self._path = path
        self._sources = sources
        self._tolerate_damage = tolerate_damage
        self._closed = False
        self._opening_damage = (*damage, *(d for s in sources for d in s.damage))
        self.damage: tuple[Damage, ...] = self._opening_damage
        self.info = _describe(path, sources, notes, self.damage)

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the files; records that were delivered stay valid."""
        self._closed = True
        for source in self._sources:
            source.close()

    def records(
        self, topics: Collection[str] | None = None
    ) -> Iterator[tuple[str, int, SampleBlock | TestPoint | SampleRun]]:
        """Topic, log time in ns and record, in order of log time.

        A SampleRun stands where its first sample stands. Without ``topics`` all that become
        records are read and others are left aside (``info`` names them).

        Raises MissingChannelError where a topic is not there, RecordingError where a topic that
        was asked for is of a type that does not become records or where the recording holds no
        messages at all, and TornRecordingError at the end, after everything readable, where
        something was damaged.
        """
        self._check(topics, _DECODED)
        damage = list(self._opening_damage)
        for source in self._sources:
            decoders = {
                index: TopicDecoder(connection, source.path.name)
                for index, connection in enumerate(source.connections)
                if reading_of(connection) in _DECODED
                and (topics is None or connection.topic in topics)
            }
            for parts in source.batches(decoders, damage):
                for log_ns, topic, record in _decode(parts, decoders, damage):
                    yield topic, log_ns, record
        self._finish(damage)

    def raw(self, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
        """Messages as they were recorded, of any type, in order of log time.

        Raises as :meth:`records` does.
        """
        self._check(topics, frozenset(Reading))
        damage = list(self._opening_damage)
        for source in self._sources:
            for batch, row in self._rows(source, topics, damage):
                connection = source.connections[int(batch.connection[row])]
                start = int(batch.offset[row])
                yield RawMessage(
                    connection.topic,
                    connection.type,
                    int(batch.log_ns[row]),
                    int(batch.publish_ns[row]),
                    bytes(batch.buffer[start : start + int(batch.length[row])]),
                )
        self._finish(damage)

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Log time in ns and message, deserialised by the recording's own definition.

        For any type, results of older versions among them; slow beside :meth:`records`.
        Raises as :meth:`records` does, and RecordingError where a message cannot be read.
        """
        self._check([topic], frozenset(Reading) - {Reading.UNREADABLE})
        damage = list(self._opening_damage)
        for source in self._sources:
            decoders = {
                index: TopicDecoder(connection, source.path.name)
                for index, connection in enumerate(source.connections)
                if connection.topic == topic
            }
            for batch, row in self._rows(source, [topic], damage):
                message = decoders[int(batch.connection[row])].message(batch, row)
                yield int(batch.log_ns[row]), message
        self._finish(damage)

    def _rows(
        self, source: Source, topics: Collection[str] | None, damage: list[Damage]
    ) -> Iterator[tuple[MessageBatch, int]]:
        wanted = [
            index
            for index, connection in enumerate(source.connections)
            if topics is None or connection.topic in topics
        ]
        for parts in source.batches(wanted, damage):
            places = [
                (log_ns, number, row)
                for number, batch in enumerate(parts)
                for row, log_ns in enumerate(batch.log_ns.tolist())
            ]
            places.sort()
            for _, number, row in places:
                yield parts[number], row

    def _check(self, topics: Collection[str] | None, readings: Collection[Reading]) -> None:
        if isinstance(topics, str):
            raise TypeError(f'topics is the string {topics!r}; a collection of strings is needed')
        if self._closed:
            raise RecordingError(f'{self._path.name!r} is closed')
        if not self.info.message_count and not self.info.damage:
            raise RecordingError(f'{self._path.name!r} is a recording without any message')
        for topic in topics or ():
            found = [item for item in self.info.topics if item.name == topic]
            if not found:
                names = ', '.join(sorted({item.name for item in self.info.topics})) or 'none'
                raise MissingChannelError(
                    f'{self._path.name!r} has no topic {topic!r}; its topics are {names}'
                )
            for item in found:
                if item.reading not in readings:
                    raise RecordingError(
                        f'topic {topic!r} is of type {item.type!r} encoded as '
                        f'{item.encoding!r}: {item.reading.value}'
                    )

    def _finish(self, damage: list[Damage]) -> None:
        self.damage = tuple(damage)
        if damage and not self._tolerate_damage:
            more = f' (and {len(damage) - 1} further places)' if len(damage) > 1 else ''
            raise TornRecordingError(f'{damage[0]}{more}')


def _decode(
    parts: list[MessageBatch], decoders: dict[int, TopicDecoder], damage: list[Damage]
) -> list[Item]:
    """Records of batches that overlap in time, in order of log time."""
    items: list[Item] = []
    for batch in parts:
        for index in np.unique(batch.connection).tolist():
            rows = batch.connection == index
            part = batch if rows.all() else batch.take(rows)
            items.extend(decoders[index].decode(part, damage))
    items.sort(key=lambda item: item[0])
    return items


def _describe(
    path: Path, sources: list[Source], notes: tuple[str, ...], damage: tuple[Damage, ...]
) -> RecordingInfo:
    topics: dict[tuple[str, str, str], TopicInfo] = {}
    for source in sources:
        for connection, count in zip(source.connections, source.counts, strict=True):
            key = (connection.topic, connection.type, connection.encoding)
            before = topics[key].count if key in topics else 0
            topics[key] = TopicInfo(
                connection.topic,
                connection.type,
                before + count,
                reading_of(connection),
                connection.encoding,
                connection.definition,
                connection.qos,
            )
    filled = [source for source in sources if any(source.counts)]
    metadata: dict[str, dict[str, str]] = {}
    for source in sources:
        metadata.update(source.metadata)
    return RecordingInfo(
        path=path,
        storage=sources[0].storage,
        files=tuple(source.path for source in sources),
        size=sum(source.path.stat().st_size for source in sources),
        topics=tuple(sorted(topics.values(), key=lambda item: (item.name, item.type))),
        message_count=sum(sum(source.counts) for source in sources),
        start_ns=min((source.start_ns for source in filled), default=0),
        end_ns=max((source.end_ns for source in filled), default=0),
        metadata=metadata,
        attachments=tuple(item for source in sources for item in source.attachments),
        damage=damage,
        notes=notes,
    )


def _natural(path: Path) -> list[tuple[int, int, str]]:
    """Sort key by which part 10 of a split recording follows part 9."""
    parts = re.findall(r'\d+|\D+', path.name)
    return [(0, int(p), '') if p.isdecimal() else (1, 0, p) for p in parts]


def _files_of_folder(folder: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Files of a rosbag2 folder in order, and what is to be noted."""
    description = folder / 'metadata.yaml'
    if not description.is_file():
        found = [f for f in folder.iterdir() if f.suffix in ('.mcap', '.db3') and f.is_file()]
        if not found:
            raise RecordingError(
                f'folder {folder.name!r} holds neither metadata.yaml nor .mcap or .db3 files'
            )
        note = 'metadata.yaml is missing: the recorder was interrupted'
        return sorted(found, key=_natural), (note,)
    try:
        content = yaml.safe_load(description.read_text(encoding='utf-8'))
        bag = content['rosbag2_bagfile_information']
        names = [str(name) for name in bag['relative_file_paths']]
        compression = str(bag.get('compression_mode') or 'none')
    except (yaml.YAMLError, LookupError, TypeError, AttributeError, ValueError, OSError) as error:
        raise RecordingError(
            f'{folder.name}/metadata.yaml does not describe a rosbag2 recording '
            f'({type(error).__name__})'
        ) from error
    if compression.lower() != 'none':
        raise RecordingError(
            f'{folder.name!r} is compressed by {compression.lower()}; only MCAP chunks may be '
            'compressed (`ros2 bag convert` writes it anew)'
        )
    files = []
    for name in names:
        file = folder / name.replace('\0', '')
        if not file.resolve().is_relative_to(folder.resolve()):
            raise RecordingError(f'{folder.name}/metadata.yaml names a file elsewhere: {name!r}')
        if not file.is_file():
            raise RecordingError(f'{folder.name}/metadata.yaml names {name!r}, which is missing')
        files.append(file)
    if not files:
        raise RecordingError(f'{folder.name}/metadata.yaml names no files')
    return files, ()


def _open_file(path: Path) -> Source:
    with path.open('rb') as file:
        head = file.read(16)
    if not head:
        raise RecordingError(f'{path.name!r} is empty (0 bytes)')
    if head == SQLITE_MAGIC:
        return SqliteSource(path)
    if head.startswith(MCAP_MAGIC):
        return McapSource(path)
    raise RecordingError(
        f'{path.name!r} is not a recording: it begins with {head[:8]!r}, '
        'which is neither MCAP nor SQLite'
    )


def open_recording(path: str | Path, *, tolerate_damage: bool = False) -> Recording:
    """Open a recording by what it holds, not by its name.

    Args:
        path: an MCAP file, a rosbag2 ``.db3`` file, or a rosbag2 folder of such files.
        tolerate_damage: whether damage is told in ``Recording.damage`` alone, instead of by a
            TornRecordingError after everything readable.

    Raises RecordingError where it is missing, empty or not a recording.
    """
    path = Path(path)
    sources: list[Source] = []
    damage: list[Damage] = []
    try:
        if path.is_dir():
            files, notes = _files_of_folder(path)
        elif path.exists():
            files, notes = [path], ()
        else:
            raise RecordingError(f'there is no recording at {str(path)!r}')
        for file in files:
            try:
                sources.append(_open_file(file))
            except RecordingError as error:
                if len(files) == 1:
                    raise
                damage.append(Damage(file.name, 0, f'the file cannot be read: {error}'))
        if not sources:
            raise RecordingError(f'no file of {path.name!r} can be read: {damage[0]}')
    except OSError as error:
        raise RecordingError(f'{path.name!r} cannot be read: {error.strerror}') from error
    return Recording(
        path, sources, notes=notes, damage=tuple(damage), tolerate_damage=tolerate_damage
    )
