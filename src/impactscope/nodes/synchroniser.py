"""Node: puts all channels on one time base. Blocks and stamped samples in, ``synced`` out.

Inputs are topics of SampleBlock (parameter ``sample_topics``) and, sample by sample, topics of
standard types (parameter ``inputs``), each written as ``kind topic axis channel``, such as
``wrench ft_sensor/wrench force.z force`` or ``imu flange/imu linear_acceleration.x
acceleration.impactor``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import AccelStamped, WrenchStamped

from impactscope import msg
from impactscope.inputs import Input
from impactscope.nodes import qos, wire
from impactscope.nodes.base import STEADY, StageNode
from impactscope.nodes.block_joiner import BlockJoiner
from impactscope.nodes.conversions import time_message
from impactscope.nodes.parameters import declare, declare_settings, refuse_unknown
from impactscope.nodes.stream_codec import SampleBlockReader, SyncedBlockWriter
from impactscope.nodes.warm_up import warm_up_synchroniser
from impactscope.records import NANOSECONDS, SampleBlock, SyncedBlock
from impactscope.synchronise import (
    ChannelMirror,
    ChannelStatistics,
    SampleAssembler,
    Synchroniser,
    SynchroniserSettings,
    quality_notes,
)

__all__ = ['SynchroniserNode']

PAPER_BENCH = ('force', 'acceleration.plate', 'acceleration.impactor', 'acceleration.base')


class SynchroniserNode(StageNode):
    """Runs :class:`~impactscope.synchronise.Synchroniser` on topics."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__('synchroniser', **keywords)
        settings = declare_settings(self, SynchroniserSettings, channels=PAPER_BENCH)
        topics = declare(
            self, 'sample_topics', ('force_samples', 'acceleration_samples'), 'of SampleBlock'
        )
        inputs = declare(self, 'inputs', (), 'stamped samples: kind topic axis channel')
        input_rate = declare(
            self, 'input_rate', 0.0, 'nominal rate of stamped samples [Hz]; 0: estimated', low=0.0
        )
        self._idle_time = declare(
            self,
            'idle_time',
            5.0,
            'a stream that is silent this long has ended [s]; 0: never',
            low=0.0,
        )
        self._mirror_rate = declare(
            self, 'mirror_rate', 200.0, 'of the mirrored channels for plots [Hz]; 0: none', low=0.0
        )
        refuse_unknown(self)
        warm_up_synchroniser()
        self._stage = Synchroniser(settings)
        self._publisher = self.create_publisher(
            msg.SyncedBlock, 'synced', qos.SAMPLES, qos_overriding_options=qos.OVERRIDES
        )
        self._write = SyncedBlockWriter()
        self._joiner = BlockJoiner()
        self._will_publish = False
        self._progress = self.create_publisher(Time, 'synced_until', qos.SAMPLES)
        self._mirrors: dict[str, Any] = {}
        self._assemblers: list[SampleAssembler] = []
        for topic in topics:
            self.create_subscription(
                msg.SampleBlock,
                topic,
                self.guard(self._block_callback()),
                qos.SAMPLES,
                raw=True,
                qos_overriding_options=qos.OVERRIDES,
            )
        for text in inputs:
            self._add_input(text, input_rate)
        self._last_received = 0
        if self._idle_time > 0:
            self.create_timer(self._idle_time, self._end_if_idle, clock=STEADY)

    def _add_input(self, text: str, rate: float) -> None:
        item = Input.parse(text)
        read = wire.StampedValueReader(item.kind, item.axis)
        assembler = SampleAssembler(item.channel, item.unit, rate=rate)
        self._assemblers.append(assembler)
        self.create_subscription(
            read.message_type,
            item.topic,
            self.guard(self._sample_callback(read, assembler)),
            qos.WRENCH_IN,
            raw=True,
            qos_overriding_options=qos.OVERRIDES,
        )

    def _sample_callback(
        self, read: wire.StampedValueReader, assembler: SampleAssembler
    ) -> Callable[[bytes], None]:
        def on_sample(data: bytes) -> None:
            for block in assembler.push(*read(data)):
                self._take(block)

        return on_sample

    def _block_callback(self) -> Callable[[bytes], None]:
        read = SampleBlockReader()

        def on_block(data: bytes) -> None:
            self._take(read(data))

        return on_block

    def _end_if_idle(self) -> None:
        if self.received == self._last_received and self.received:
            self._end()
        self._last_received = self.received

    def _end(self) -> None:
        for assembler in self._assemblers:
            for block in assembler.end():
                self._take(block)
        self._publish(self._stage.flush())
        self._publish_held()

    def finish(self) -> None:
        """Publish what is complete; the stream has ended."""
        self._end()

    def _publish(self, blocks: Sequence[SyncedBlock]) -> None:
        """Publish blocks when all input that waits by now has been taken, or enough is held.

        Whoever keeps up with the samples thus gets each block at once; whoever has fallen behind
        gets fewer and longer ones, and catches up.
        """
        for block in blocks:
            for complete in self._joiner.push(block):
                self._send(complete)
        if blocks and not self._will_publish and self.executor is not None:
            self._will_publish = True
            self.executor.create_task(self._publish_held)  # comes after the callbacks now due

    def _publish_held(self) -> None:
        self._will_publish = False
        for block in self._joiner.flush():
            self._send(block)

    def _send(self, block: SyncedBlock) -> None:
        self._publisher.publish(self._write(block))
        self.published += 1
        if self._progress.get_subscription_count():
            duration = block.values.shape[1] / block.sample_rate if block.sample_rate else 0.0
            until_ns = block.stamp_ns + round(duration * NANOSECONDS)
            self._progress.publish(time_message(until_ns))

    def _take(self, block: SampleBlock) -> None:
        self._publish(self._stage.push(block))
        if self._mirror_rate > 0:
            self._publish_mirror(block)

    def _publish_mirror(self, block: SampleBlock) -> None:
        """Repeat a channel for plots, decimated with its peaks kept; its axis is z."""
        if block.channel not in self._mirrors:
            topic = 'mirror/' + re.sub(r'\W', '_', block.channel)
            kind = WrenchStamped if block.unit == 'N' else AccelStamped
            publisher = self.create_publisher(kind, topic, qos.MIRROR)
            self._mirrors[block.channel] = (ChannelMirror(self._mirror_rate), kind, publisher)
        mirror, kind, publisher = self._mirrors[block.channel]
        if publisher.get_subscription_count() == 0:
            return  # nobody looks
        for stamp_ns, value in zip(*mirror.push(block), strict=True):
            message = kind()
            message.header.stamp = time_message(int(stamp_ns))
            message.header.frame_id = block.frame_id
            vector = message.wrench.force if kind is WrenchStamped else message.accel.linear
            vector.z = float(value)
            publisher.publish(message)

    def state(self) -> tuple[str, dict[str, Any]]:
        """Counts for each channel; a warning where data was lost or refused."""
        warnings = []
        values: dict[str, Any] = {}
        for name, counts in self._stage.statistics.items():
            values[name] = counts
            if counts.lost_samples or counts.late or counts.refused:
                warnings.append(name)
        return (f'lost, late or refused data in {", ".join(warnings)}' if warnings else ''), values

    @property
    def statistics(self) -> Mapping[str, ChannelStatistics]:
        """Counts for each channel."""
        return self._stage.statistics

    def notes(self) -> list[str]:
        """What a reader must know of the data's quality, in sentences."""
        return quality_notes(self._stage.statistics)
