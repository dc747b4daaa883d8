"""The simulated bench as a device, and as a recording."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path

from impactscope.physics.twin.campaigns import CAMPAIGNS, campaign
from impactscope.physics.twin.stream import Campaign, Stream, stream
from impactscope.recordings import RecordingWriter
from impactscope.records import NANOSECONDS, SampleBlock, TestPoint
from impactscope.version import __version__

__all__ = [
    'campaign_channels',
    'describe_campaigns',
    'simulated_items',
    'topic_of',
    'write_simulation',
]

Item = SampleBlock | TestPoint
# A simulation has no date of its own; one that is fixed makes the recording reproducible.
SIMULATION_START_NS = 1_704_067_200 * NANOSECONDS  # 2024-01-01T00:00:00Z


def describe_campaigns() -> dict[str, str]:
    """What each campaign is."""
    return {name: campaign(name).description for name in CAMPAIGNS}


def campaign_channels(name: str) -> tuple[str, ...]:
    """The channels of a campaign, the reference first."""
    return tuple(campaign(name).chain)


@lru_cache(maxsize=2)
def simulated_items(
    name: str, *, seed: int = 1, block_duration: float = 0.02, sample_rate: float = 0.0
) -> tuple[Item, ...]:
    """Blocks and test points of a campaign in order of time; kept, for the devices share it.

    Raises ConfigurationError for a campaign that is not known.
    """
    simulated = stream(_at_rate(campaign(name), sample_rate), seed, SIMULATION_START_NS)
    return tuple(_in_order(simulated, block_duration))


def _at_rate(plan: Campaign, sample_rate: float) -> Campaign:
    if not sample_rate:
        return plan
    chain = {
        channel: dataclasses.replace(device, sample_rate=sample_rate)
        for channel, device in plan.chain.items()
    }
    return dataclasses.replace(plan, chain=chain)


def _in_order(simulated: Stream, block_duration: float) -> Iterator[Item]:
    """Blocks when they are complete; a test point when it starts, and again when it ends."""
    points = [
        (time_ns, number, point)
        for number, whole in enumerate(simulated.test_points)
        for time_ns, point in (
            (whole.start_ns, dataclasses.replace(whole, end_ns=0)),
            (whole.end_ns, whole),
        )
        if time_ns
    ]
    points.sort(key=lambda item: item[:2])
    waiting: list[TestPoint] = [point for _, _, point in points]
    due_ns = [time_ns for time_ns, _, _ in points]
    for block in simulated.blocks(block_duration):
        while due_ns and due_ns[0] <= block.received_ns:
            del due_ns[0]
            yield waiting.pop(0)
        yield block
    yield from waiting


def topic_of(channel: str) -> str:
    """The topic on which a channel's driver publishes, in a bench without namespace."""
    device = 'acceleration' if channel.startswith('acceleration') else 'force'
    return f'/bench/{device}_samples'


def write_simulation(
    name: str,
    path: Path,
    *,
    seed: int = 1,
    sample_rate: float = 0.0,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write a campaign as a recording, as if a graph had recorded its drivers."""
    items = simulated_items(name, seed=seed, sample_rate=sample_rate)
    provenance = {
        'kind': 'simulated',
        'source': f'simulated: {campaign(name).description}',
        'campaign': name,
        'seed': str(seed),
        'software': f'impactscope {__version__}',
    }
    with RecordingWriter(
        path, metadata={'provenance': provenance}, flush_interval=0, overwrite=True
    ) as writer:
        for number, item in enumerate(items):
            if isinstance(item, TestPoint):
                writer.write_test_point(item, '/bench/test_point')
            else:
                writer.write_block(item, topic_of(item.channel))
            if progress is not None and number % 100 == 0:
                progress(number / len(items))
