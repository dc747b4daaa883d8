"""What a recording holds."""

from __future__ import annotations

import enum
import hashlib
from dataclasses import dataclass, field
from pathlib import Path

from .batch import Damage

__all__ = ['AttachmentInfo', 'Reading', 'RecordingInfo', 'TopicInfo', 'file_sha256']


class Reading(enum.Enum):
    """What a topic's messages become."""

    BLOCKS = 'blocks of samples'
    SAMPLES = 'one sample a message'
    TEST_POINTS = 'test points'
    RESULTS = 'results'
    OTHER = 'another type, not read'
    UNREADABLE = 'an encoding that is not read'


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """One topic of one type."""

    name: str
    type: str
    count: int
    reading: Reading
    encoding: str = 'cdr'
    definition: str = ''  # text of the message definition as recorded; empty where absent
    qos: str = ''  # the profiles that were offered, YAML as rosbag2 writes it


@dataclass(frozen=True, slots=True)
class AttachmentInfo:
    """A file within the recording."""

    name: str
    media_type: str
    size: int  # bytes


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """Topics, span and provenance of a recording."""

    path: Path
    storage: str  # 'mcap' or 'sqlite3'
    files: tuple[Path, ...]
    size: int  # bytes of all files
    topics: tuple[TopicInfo, ...]
    message_count: int
    start_ns: int  # log time of the first message; 0 where there is none
    end_ns: int
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: tuple[AttachmentInfo, ...] = ()
    damage: tuple[Damage, ...] = ()  # what was seen to be damaged on opening
    notes: tuple[str, ...] = ()  # what else a reader should know

    @property
    def duration(self) -> float:
        """Span of the log times in s."""
        return (self.end_ns - self.start_ns) / 1e9

    @property
    def provenance(self) -> dict[str, str]:
        """Where the data comes from, as the recording states it; empty where it does not."""
        return self.metadata.get('provenance', {})


def file_sha256(path: Path) -> str:
    """SHA-256 of a file in hexadecimal, read piece by piece."""
    with path.open('rb') as file:
        return hashlib.file_digest(file, 'sha256').hexdigest()
