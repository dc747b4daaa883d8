"""What a storage format offers the reader."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from .batch import Damage, MessageBatch
from .info import AttachmentInfo

__all__ = ['Connection', 'Source']


@dataclass(frozen=True, slots=True)
class Connection:
    """One topic as one file declares it."""

    topic: str
    type: str
    encoding: str  # of the messages
    definition: str  # text of the message definition; empty where absent
    definition_encoding: str
    qos: str


class Source(Protocol):
    """One file of a recording, opened. Connections are counted from 0 within the file."""

    path: Path
    storage: str
    connections: list[Connection]
    counts: list[int]  # messages by connection
    start_ns: int  # 0 where there are no messages
    end_ns: int
    metadata: dict[str, dict[str, str]]
    attachments: list[AttachmentInfo]
    damage: list[Damage]  # what was found on opening

    def batches(
        self, wanted: Collection[int], damage: list[Damage]
    ) -> Iterator[list[MessageBatch]]:
        """Messages of the wanted connections in order of log time; adds to ``damage``."""

    def close(self) -> None:
        """Let go of the file."""
