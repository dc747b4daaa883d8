"""A load that stays on the device and becomes the zero level of the blow that follows.

A robot that clamps longer than a blow is followed, or a pendulum left lying on the plate, leaves
a force behind; the next blow is measured from there. One event cannot show this, two can: the
first says that a load remained, the second that its zero level stands higher by that load.
Drift of the zero level between blows that leave nothing behind is no load.
"""

from __future__ import annotations

import math

from impactscope.records import ImpactEvent, Quality

__all__ = ['RestingLoad']


class RestingLoad:
    """Follows the zero level from blow to blow. ``threshold`` (N) is what counts as a load."""

    def __init__(self, threshold: float) -> None:
        self._threshold = threshold
        self._unloaded = math.nan  # N, latest zero level without a load
        self._remained = False  # since then an event has left a load behind

    def before(self, event: ImpactEvent, channel: str) -> float:
        """The load in N that rested on the device before this blow; 0 where none is known.

        Blows are to be given once each, in order of time.
        """
        row = event.index_of(channel)
        if row is None or row >= len(event.zero_level):
            return 0.0
        zero = event.zero_level[row]
        if not math.isfinite(zero):
            return 0.0
        excess = zero - self._unloaded
        load = excess if self._remained and excess > self._threshold else 0.0
        if load == 0.0:
            self._unloaded = zero
            self._remained = False
        if row == 0:  # the level after a blow is known for this channel alone
            left = event.rest_level > self._threshold
            self._remained = self._remained or left or bool(event.quality & Quality.HELD)
        return load
