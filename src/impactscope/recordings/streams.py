"""The wanted channels of a recording as one stream."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping

from impactscope.errors import MissingChannelError, RecordingError
from impactscope.records import SampleBlock, TestPoint

from .info import Reading
from .reader import Recording
from .sample_run import SampleRun

__all__ = ['read_streams']


def read_streams(
    recording: Recording,
    channels: Mapping[str, str] | None = None,
    *,
    topics: Collection[str] | None = None,
) -> Iterator[SampleBlock | SampleRun | TestPoint]:
    """Blocks of the wanted channels, runs of single samples and test points, by log time.

    Args:
        recording: an open recording.
        channels: recorded channel name to the name it shall have; None: all, as recorded.
        topics: which topics to read; None: all that become records. Test points are always
            read. Runs are passed on as they are, for an assembler that knows their channels.

    Raises what ``Recording.records`` raises; RecordingError where two topics carry the same
    channel; MissingChannelError at the end where a wanted channel never came.
    """
    if topics is not None:
        points = {t.name for t in recording.info.topics if t.reading is Reading.TEST_POINTS}
        topics = sorted({*topics, *points})
    owner: dict[str, str] = {}
    for topic, _, record in recording.records(topics):
        if not isinstance(record, SampleBlock):
            yield record
            continue
        name = record.channel
        if channels is not None and name not in channels:
            owner.setdefault(name, topic)
            continue
        if owner.setdefault(name, topic) != topic:
            raise RecordingError(
                f'channel {name!r} is recorded on two topics, {owner[name]!r} and {topic!r}: '
                'name the topics to read'
            )
        if channels is not None and channels[name] != name:
            record = dataclasses.replace(record, channel=channels[name])
        yield record
    missing = sorted(set(channels or ()) - set(owner))
    if missing:
        raise MissingChannelError(
            f'{recording.info.path.name!r} has no channel {missing[0]!r}; '
            f'its channels are {", ".join(sorted(owner)) or "none"}'
        )
