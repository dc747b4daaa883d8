"""Which sources a driver node can have, and their parameters."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node

from impactscope.drivers.pace import Pace
from impactscope.drivers.playback import Playback
from impactscope.drivers.recorded import recorded_items
from impactscope.drivers.source import Source
from impactscope.errors import ConfigurationError
from impactscope.nodes.parameters import declare
from impactscope.records import NANOSECONDS

__all__ = ['KINDS', 'declare_options', 'make']

KINDS = ('simulated', 'replay')


def declare_options(node: Node) -> dict[str, Any]:
    """Declare the parameters of every kind of source; returns their values by name."""
    options: dict[str, Any] = {}

    def add(name: str, default: Any, doc: str, **limits: float) -> None:
        options[name] = declare(node, name, default, doc, **limits)

    add('start_at', 0.0, 'Unix time at which data begins [s]; 0: at activation', low=0.0)
    add('publish_test_points', False, 'publish the test points that the source knows')
    add('simulated.campaign', 'hand_pass', 'which blows the simulated bench gives')
    add('simulated.seed', 1, 'of the noise', low=0)
    add('simulated.block_duration', 0.02, 'of one block [s]', low=1e-4, high=1.0)
    add('simulated.sample_rate', 0.0, "of every channel [Hz]; 0: the campaign's own", low=0.0)
    add('replay.bag', '', 'recording to play')
    add('replay.rate', 1.0, 'of time; 0: as fast as the consumers take it', low=0.0)
    add('replay.lead', 1.5, 'at rate 0, how far ahead of the consumers [s of data]', low=0.1)
    add('replay.inputs', (), 'stamped samples in the recording: kind topic axis channel')
    add('replay.publish_clock', False, 'publish /clock; only one driver should')
    return options


def make(kind: str, options: Mapping[str, Any], wants: Callable[[str], bool]) -> Source:
    """The source of a kind; raises ConfigurationError for an unknown kind or a wrong option."""
    start_ns = round(options['start_at'] * NANOSECONDS)
    if kind == 'simulated':
        from impactscope.drivers.simulated import simulated_items  # compiled: only where needed

        items = simulated_items(
            options['simulated.campaign'],
            seed=options['simulated.seed'],
            block_duration=options['simulated.block_duration'],
            sample_rate=options['simulated.sample_rate'],
        )
        # Simulating takes a while; without a given start, the device begins when it is done.
        begin_ns = start_ns or time.time_ns()
        return Playback(
            lambda: items,
            wants,
            lambda data_ns: Pace(data_ns, rate=1.0, wall_start_ns=begin_ns),
            restamp_to_ns=begin_ns,
        )
    if kind == 'replay':
        bag = options['replay.bag']
        if not bag:
            raise ConfigurationError('replay.bag is empty; name the recording to play')
        inputs = options['replay.inputs']
        return Playback(
            lambda: recorded_items(bag, inputs),
            wants,
            lambda data_ns: Pace(
                data_ns,
                rate=options['replay.rate'],
                wall_start_ns=start_ns,
                lead=options['replay.lead'],
            ),
        )
    raise ConfigurationError(f'source {kind!r}; known are {", ".join(KINDS)}')
