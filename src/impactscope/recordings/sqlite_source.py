"""A rosbag2 SQLite file (``.db3``), read row by row in order of time."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

import numpy as np

from impactscope.errors import RecordingError

from .batch import Damage, MessageBatch
from .info import AttachmentInfo
from .source import Connection

__all__ = ['MAGIC', 'SqliteSource']

MAGIC = b'SQLite format 3\0'
_BATCH_BYTES = 1 << 20
# The library decodes its own messages, which may quote what is damaged.
_ERRORS = (sqlite3.Error, UnicodeDecodeError)


class SqliteSource:
    """One ``.db3`` file, opened read-only.

    Raises RecordingError where it is damaged beyond opening or is no recording.
    """

    storage = 'sqlite3'

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: list[AttachmentInfo] = []
        self.damage: list[Damage] = []
        self.start_ns = self.end_ns = 0
        try:
            self._database = self._open()
        except _ERRORS as error:
            raise RecordingError(
                f'{path.name!r} is an SQLite file but cannot be read as a recording ({error})'
            ) from error

    def _open(self) -> sqlite3.Connection:
        base = f'file:{quote(str(self.path.resolve()))}'
        # A write-ahead log in a folder that cannot be written to needs `immutable`.
        for options in ('mode=ro', 'mode=ro&immutable=1'):
            database = sqlite3.connect(f'{base}?{options}', uri=True, check_same_thread=False)
            database.text_factory = lambda data: data.decode('utf-8', 'replace')
            try:
                self._describe(database)
            except sqlite3.OperationalError as error:
                database.close()
                if 'unable to open' not in str(error) and 'readonly' not in str(error):
                    raise
                problem = error
            except BaseException:
                database.close()
                raise
            else:
                return database
        raise problem

    def _describe(self, database: sqlite3.Connection) -> None:
        tables = {row[0] for row in database.execute('SELECT name FROM sqlite_master')}
        if not {'topics', 'messages'} <= tables:
            raise RecordingError(
                f'{self.path.name!r} is an SQLite file without the tables of a recording'
            )
        definitions: dict[str, tuple[str, str]] = {}
        if 'message_definitions' in tables:
            query = (
                'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
            )
            definitions = {str(t): (str(d), str(e)) for t, e, d in database.execute(query)}
        columns = {row[1] for row in database.execute('PRAGMA table_info(topics)')}
        qos = 'offered_qos_profiles' if 'offered_qos_profiles' in columns else "''"
        query = f'SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id'  # noqa: S608
        self.connections: list[Connection] = []
        self._index: dict[int, int] = {}
        for number, name, type_name, encoding, profiles in database.execute(query):
            definition = definitions.get(str(type_name), ('', ''))
            self._index[int(number)] = len(self.connections)
            self.connections.append(
                Connection(str(name), str(type_name), str(encoding), *definition, str(profiles))
            )
        self.counts = [0] * len(self.connections)
        try:
            query = 'SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id'
            for number, count in database.execute(query):
                if number in self._index:
                    self.counts[self._index[number]] = count
            query = 'SELECT MIN(timestamp), MAX(timestamp) FROM messages'
            start, end = database.execute(query).fetchone()
        except _ERRORS as error:
            what = f'the database is damaged ({error}): what cannot be read is lost'
            self.damage = [Damage(self.path.name, 0, what)]
        else:
            if isinstance(start, int) and isinstance(end, int):
                self.start_ns, self.end_ns = start, end

    def close(self) -> None:
        """Let go of the file."""
        self._database.close()

    def batches(
        self, wanted: Collection[int], damage: list[Damage]
    ) -> Iterator[list[MessageBatch]]:
        """Messages of the wanted connections in order of log time; adds to ``damage``."""
        numbers = [number for number, index in self._index.items() if index in set(wanted)]
        marks = ','.join('?' * len(numbers))
        query = (
            'SELECT topic_id, timestamp, data FROM messages '  # noqa: S608
            f'WHERE topic_id IN ({marks}) ORDER BY timestamp, id'
        )
        rows: list[tuple[int, int, bytes]] = []
        size = delivered = 0
        try:
            with closing(self._database.execute(query, numbers)) as cursor:
                for number, log_ns, data in cursor:
                    if not isinstance(log_ns, int) or not isinstance(data, bytes):
                        what = f'row {delivered} of its messages has no time or no content'
                        damage.append(Damage(self.path.name, 0, what))
                        continue
                    rows.append((self._index[number], log_ns, data))
                    size += len(data)
                    delivered += 1
                    if size >= _BATCH_BYTES:
                        yield [_pack(rows)]
                        rows, size = [], 0
        except _ERRORS as error:
            what = (
                f'the database is damaged after {delivered} messages ({error}); the rest is lost'
            )
            damage.append(Damage(self.path.name, 0, what))
        if rows:
            yield [_pack(rows)]


def _pack(rows: list[tuple[int, int, bytes]]) -> MessageBatch:
    connection, log_ns, data = zip(*rows, strict=True)
    buffer = b''.join(data)
    length = np.array([len(item) for item in data], np.int64)
    times = np.array(log_ns, np.int64)
    return MessageBatch(
        buffer,
        np.frombuffer(buffer or b'\0', np.uint8),
        np.array(connection, np.int64),
        times,
        times,
        np.cumsum(length) - length,
        length,
        0,
    )
