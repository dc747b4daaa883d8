"""Node: cuts blows out of the synchronised stream. Topics ``synced`` in, ``events`` out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from impactscope import msg
from impactscope.detect import DetectorSettings, ImpactDetector
from impactscope.measurement_profile import MeasurementProfile
from impactscope.nodes import qos
from impactscope.nodes.base import StageNode
from impactscope.nodes.conversions import to_message, to_record
from impactscope.nodes.parameters import declare_settings, refuse_unknown
from impactscope.nodes.stream_codec import SyncedBlockReader
from impactscope.nodes.warm_up import warm_up_detector
from impactscope.records import Channel, ImpactEvent, SyncedBlock

__all__ = ['Detector']


class Detector(StageNode):
    """Runs :class:`~impactscope.detect.ImpactDetector` on a topic."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__('impact_detector', **keywords)
        settings = declare_settings(self, DetectorSettings)
        profile = declare_settings(self, MeasurementProfile, prefix='profile.')
        refuse_unknown(self)
        warm_up_detector()
        self._stage = ImpactDetector(settings, profile)
        self._publisher = self.create_publisher(msg.ImpactEvent, 'events', qos.EVENTS)
        self._read = SyncedBlockReader()
        self.ended = False
        self.duration = 0.0  # s of data seen
        self._channels: dict[str, Channel] = {}
        self._last_channels: tuple[Channel, ...] = ()
        self.create_subscription(
            msg.TestPoint, 'test_point', self.guard(self._on_test_point), qos.LATCHED
        )
        self.create_subscription(
            msg.SyncedBlock,
            'synced',
            self.guard(self._on_block),
            qos.SAMPLES,
            raw=True,
            qos_overriding_options=qos.OVERRIDES,
        )

    def _on_test_point(self, message: msg.TestPoint) -> None:
        self._stage.take_test_point(to_record(message))

    def _on_block(self, data: bytes) -> None:
        block = self._read(data)
        self._publish(self._stage.push(block))
        self.ended = block.is_end
        self._keep(block)

    def _keep(self, block: SyncedBlock) -> None:
        if block.channels is not self._last_channels:  # mostly they are the same object
            self._last_channels = block.channels
            for channel in block.channels:
                seen = self._channels.get(channel.name, channel)
                quality = seen.quality | channel.quality
                self._channels[channel.name] = replace(seen, quality=quality)
        if block.sample_rate:
            self.duration += block.values.shape[1] / block.sample_rate

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels that were seen, with all flags that were seen in them."""
        return tuple(self._channels.values())

    def finish(self) -> None:
        """Close an event that is open."""
        self._publish(self._stage.flush())

    def _publish(self, events: Iterable[ImpactEvent]) -> None:
        for event in events:
            self._publisher.publish(to_message(event))
            self.published += 1

    def state(self) -> tuple[str, dict[str, Any]]:
        """Counts of the stage."""
        return '', {'events': self.published, 'statistics': self._stage.statistics}
