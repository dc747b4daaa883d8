"""From a recording to the blocks of samples that the stages take.

Blocks pass as recorded; topics with one sample a message are put together to blocks on the way,
by the same assembler that the live graph uses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from impactscope.errors import ConfigurationError, MissingChannelError
from impactscope.recordings import Reading, Recording, SampleRun, read_streams
from impactscope.records import NANOSECONDS, SampleBlock, TestPoint
from impactscope.synchronise import SampleAssembler

__all__ = ['Input', 'Item', 'channel_order', 'inputs_of', 'recorded_items', 'scan_channels']

Item = SampleBlock | TestPoint

# kind -> message type, column that stands for an axis without its part's name, unit by part
_KINDS = {
    'wrench': ('geometry_msgs/msg/WrenchStamped', 'wrench.'),
    'accel': ('geometry_msgs/msg/AccelStamped', 'accel.'),
    'imu': ('sensor_msgs/msg/Imu', ''),
    'point': ('geometry_msgs/msg/PointStamped', ''),
}
_UNITS = {
    'force': 'N',
    'torque': 'N m',
    'linear': 'm/s^2',
    'linear_acceleration': 'm/s^2',
    'angular': 'rad/s^2',
    'angular_velocity': 'rad/s',
    'point': 'm',
}


@dataclass(frozen=True, slots=True)
class Input:
    """One component of a topic of stamped samples, and the channel it becomes."""

    kind: str  # wrench, accel, imu or point
    topic: str
    axis: str  # such as force.z
    channel: str
    unit: str

    @classmethod
    def parse(cls, text: str) -> Input:
        """From its written form ``kind topic axis channel``; raises ConfigurationError."""
        parts = text.split()
        if len(parts) != 4 or parts[0] not in _KINDS:
            raise ConfigurationError(
                f'input {text!r}; written as: kind topic axis channel, '
                f'with kind one of {", ".join(_KINDS)}'
            )
        kind, topic, axis, channel = parts
        part, _, letter = axis.partition('.')
        if part not in _UNITS or letter not in {'x', 'y', 'z'}:
            raise ConfigurationError(f'input {text!r}: axis {axis!r} is not one such as force.z')
        return cls(kind, topic, axis, channel, _UNITS[part])

    @property
    def type_name(self) -> str:
        """The full name of the message type."""
        return _KINDS[self.kind][0]

    @property
    def column(self) -> str:
        """The name of the column in a run of samples."""
        return _KINDS[self.kind][1] + self.axis


def inputs_of(recording: Recording, written: Sequence[str] = ()) -> tuple[Input, ...]:
    """The inputs as written, or, for a recording without blocks, one for each stamped topic.

    By default the sensor's axis is z: ``force.z``, ``linear.z``, ``linear_acceleration.z``; one
    wrench is the channel ``force``, an acceleration is ``acceleration.<end of the topic's name>``.
    A point may be anything: it is read where it is named.
    """
    if written:
        return tuple(Input.parse(text) for text in written)
    topics = recording.info.topics
    if any(topic.reading is Reading.BLOCKS for topic in topics):
        return ()
    found = []
    names = {type_name: kind for kind, (type_name, _) in _KINDS.items()}
    wrenches = sum(topic.type == _KINDS['wrench'][0] for topic in topics)
    for topic in topics:
        kind = names.get(topic.type)
        if kind is None or kind == 'point':
            continue
        last = topic.name.rstrip('/').rsplit('/', 1)[-1]
        if kind == 'wrench':
            found.append(
                Input(
                    kind, topic.name, 'force.z', 'force' if wrenches == 1 else f'force.{last}', 'N'
                )
            )
        else:
            axis = 'linear.z' if kind == 'accel' else 'linear_acceleration.z'
            found.append(Input(kind, topic.name, axis, f'acceleration.{last}', 'm/s^2'))
    return tuple(found)


def recorded_items(recording: Recording, inputs: Sequence[Input] = ()) -> Iterator[Item]:
    """Blocks and test points of a recording, in order of their time of recording.

    Raises MissingChannelError where a topic of an input is not there, and RecordingError where
    the recording cannot be read further; what was readable has been delivered before.
    """
    topics = {topic.name: topic for topic in recording.info.topics}
    assemblers: dict[str, list[tuple[Input, SampleAssembler]]] = {}
    for item in inputs:
        if item.topic not in topics:
            raise MissingChannelError(
                f'topic {item.topic!r} is not in the recording; there are '
                f'{", ".join(topics) or "none"}'
            )
        if topics[item.topic].type != item.type_name:
            raise MissingChannelError(
                f'topic {item.topic!r} is of type {topics[item.topic].type}, not {item.type_name}'
            )
        assembler = SampleAssembler(item.channel, item.unit)
        assemblers.setdefault(item.topic, []).append((item, assembler))
    wanted = [
        name
        for name, topic in topics.items()
        if topic.reading in {Reading.BLOCKS, Reading.TEST_POINTS} or name in assemblers
    ]
    for record in read_streams(recording, topics=wanted):
        if isinstance(record, SampleRun):
            for item, assembler in assemblers[record.topic]:
                column = record.columns.index(item.column)
                yield from assembler.extend(record.stamps_ns, record.values[:, column])
        else:
            yield record
    for pairs in assemblers.values():
        for _, assembler in pairs:
            yield from assembler.end()


def scan_channels(
    recording: Recording, inputs: Sequence[Input] = (), span: float = 2.0
) -> tuple[str, ...]:
    """Channels of the first ``span`` s of each topic of a recording, the reference first.

    Raises as :func:`recorded_items` does, but not for damage further on.
    """
    names = [item.channel for item in inputs]
    missing = {topic.name for topic in recording.info.topics if topic.reading is Reading.BLOCKS}
    limit_ns = 0
    if missing:
        for name, log_ns, record in recording.records(sorted(missing)):
            if isinstance(record, SampleBlock):
                names.append(record.channel)
            if name in missing:  # another device, which may have begun later
                missing.remove(name)
                limit_ns = log_ns + round(span * NANOSECONDS)
            if not missing and log_ns > limit_ns:
                break
    if not names:
        topics = ', '.join(topic.name for topic in recording.info.topics) or 'none'
        raise MissingChannelError(
            f'{recording.info.path.name!r} holds no samples; its topics are {topics}'
        )
    return channel_order(names)


def channel_order(names: Sequence[str]) -> tuple[str, ...]:
    """Channels with the reference first: the measured force, another force, then the rest."""

    def rank(name: str) -> tuple[int, str]:
        if name == 'force':
            return 0, name
        return (1 if name.startswith('force') else 2), name

    return tuple(sorted(dict.fromkeys(names), key=rank))
