"""From serialised messages of one topic to records."""

from __future__ import annotations

from typing import Any

import numpy as np

from impactscope.errors import RecordingError
from impactscope.records import SampleBlock, TestPoint

from .batch import Damage, MessageBatch
from .block_codec import BlockDecoder
from .definitions import (
    BLOCK_TYPE,
    DECODING_ERRORS,
    PACKAGE,
    TEST_POINT_TYPE,
    has_current_layout,
    type_known,
    typestore_for,
)
from .info import Reading
from .message_records import block_from_message, test_point_from_message
from .sample_run import SAMPLE_TYPES, SampleRun, decode_runs, runs_from_messages
from .source import Connection

__all__ = ['Item', 'TopicDecoder', 'reading_of']

Item = tuple[int, str, SampleBlock | TestPoint | SampleRun]
"""Log time in ns, topic, record."""


def reading_of(connection: Connection) -> Reading:
    """What a connection's messages become."""
    foreign = connection.definition_encoding not in ('', 'ros2msg')
    if connection.encoding != 'cdr' or (foreign and connection.definition):
        return Reading.UNREADABLE
    if connection.type == BLOCK_TYPE:
        return Reading.BLOCKS
    if connection.type == TEST_POINT_TYPE:
        return Reading.TEST_POINTS
    if connection.type in SAMPLE_TYPES:
        return Reading.SAMPLES
    if connection.type.startswith(f'{PACKAGE}/') and type_known(connection.type):
        return Reading.RESULTS
    return Reading.OTHER


class TopicDecoder:
    """Decodes one connection's messages; what cannot be decoded is noted, never raised.

    Bytes are read by compiled or hand-written readers where the recording's definition of the
    type has the fields known here, and by the recording's own definition otherwise.
    """

    def __init__(self, connection: Connection, file: str) -> None:
        self.reading = reading_of(connection)
        self._topic = connection.topic
        self._type = connection.type
        self._text = connection.definition
        self._file = file
        self._direct = has_current_layout(connection.definition, connection.type)
        self._blocks = BlockDecoder()

    def message(self, batch: MessageBatch, row: int) -> Any:
        """One message, deserialised by rosbags; raises RecordingError where it cannot be."""
        start = int(batch.offset[row])
        data = batch.buffer[start : start + int(batch.length[row])]
        store = typestore_for(self._text, self._type)
        try:
            return store.deserialize_cdr(data, self._type)
        except DECODING_ERRORS as error:
            raise RecordingError(
                f'a message of {self._topic!r} is no {self._type} ({type(error).__name__})'
            ) from error

    def decode(self, batch: MessageBatch, damage: list[Damage]) -> list[Item]:
        """Records of all messages of a batch, which are all of this connection."""
        if self.reading is Reading.SAMPLES:
            return self._decode_samples(batch, damage)
        if self.reading is Reading.BLOCKS and self._direct:
            return self._decode_blocks(batch, damage)
        items: list[Item] = []
        convert = block_from_message if self.reading is Reading.BLOCKS else test_point_from_message
        for row, log_ns in enumerate(batch.log_ns.tolist()):
            try:
                items.append((log_ns, self._topic, convert(self.message(batch, row))))
            except (RecordingError, *DECODING_ERRORS) as error:
                self._note(damage, batch, log_ns, error)
        return items

    def _decode_blocks(self, batch: MessageBatch, damage: list[Damage]) -> list[Item]:
        items: list[Item] = []
        decode, buffer, topic = self._blocks.decode, batch.buffer, self._topic
        places = zip(
            batch.log_ns.tolist(), batch.offset.tolist(), batch.length.tolist(), strict=True
        )
        for row, (log_ns, offset, length) in enumerate(places):
            block = decode(buffer, offset, length)
            if block is None:  # big-endian, or malformed
                try:
                    block = block_from_message(self.message(batch, row))
                except (RecordingError, *DECODING_ERRORS) as error:
                    self._note(damage, batch, log_ns, error)
                    continue
            items.append((log_ns, topic, block))
        return items

    def _decode_samples(self, batch: MessageBatch, damage: list[Damage]) -> list[Item]:
        if (np.diff(batch.log_ns) < 0).any():
            batch = batch.take(np.argsort(batch.log_ns, kind='stable'))
        runs = None
        if self._direct:
            runs = decode_runs(
                self._topic, self._type, batch.octets, batch.offset, batch.length, batch.log_ns
            )
        if runs is None:
            messages: list[tuple[int, Any]] = []
            for row, log_ns in enumerate(batch.log_ns.tolist()):
                try:
                    message = self.message(batch, row)
                    runs_from_messages(self._topic, self._type, [(log_ns, message)])
                except (RecordingError, *DECODING_ERRORS) as error:
                    self._note(damage, batch, log_ns, error)
                else:
                    messages.append((log_ns, message))
            runs = runs_from_messages(self._topic, self._type, messages)
        return [(int(run.log_ns[0]), self._topic, run) for run in runs]

    def _note(
        self, damage: list[Damage], batch: MessageBatch, log_ns: int, error: Exception
    ) -> None:
        if len(damage) < 1000:
            what = f'the message of {self._topic!r} logged at {log_ns} ns is lost: {error}'
            damage.append(Damage(self._file, batch.origin, what))
