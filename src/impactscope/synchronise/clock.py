"""From a channel's sample index to time.

A clock sees the blocks of one channel and one activation of its device, in the order of their
indices, and says on which straight piece of time their samples lie. It depends on nothing but
this sequence. `StampClock` trusts the header stamps. A clock that estimates offset and drift
from device time and time of receipt has the same one method.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from impactscope.errors import ConfigurationError
from impactscope.records import NANOSECONDS, SampleBlock

__all__ = ['Clock', 'Reading', 'StampClock', 'TimeLine']


@dataclass(frozen=True, slots=True)
class TimeLine:
    """Sample ``index + n`` was taken at ``time_ns + fraction + n * period_ns``, in ns."""

    index: int
    time_ns: int
    fraction: float  # of a nanosecond, 0 up to 1
    period_ns: float

    def at(self, index: int) -> tuple[int, float]:
        """Time of a sample as whole nanoseconds and the fraction of one."""
        passed = self.fraction + (index - self.index) * self.period_ns
        whole = math.floor(passed)
        return self.time_ns + whole, passed - whole

    def continued(self, index: int, period_ns: float) -> TimeLine:
        """The line that goes on from a sample of this one with another period."""
        return TimeLine(index, *self.at(index), period_ns)


class Reading(NamedTuple):
    """What a clock says of a block."""

    line: TimeLine  # holds from the block's first sample on; the same object while nothing changes
    jumped: bool  # the clock was not continuous


class Clock(Protocol):
    """Places the samples of one channel, in one activation of its device, in time."""

    def observe(self, block: SampleBlock) -> Reading | None:
        """Take the next block; None while the clock cannot tell the time yet."""


class StampClock:
    """Header stamps, made continuous.

    The timeline is anchored at the first stamp and runs at the nominal rate. While stamps stay
    within ``tolerance`` of it nothing changes, so that results are the same to the last bit
    however the stream was cut. Beyond it the timeline is slewed towards the stamps, by at most
    ``slew``, never stepped. Beyond ``jump`` it is anchored anew, and the reading says so; it
    says so too when a stamp is earlier than the one before. Stamps of zero are ignored.

    Args:
        sample_rate: Hz, nominal.
        tolerance: s; 0 means one sample period, but at least 100 us.
        jump: s, the deviation that is a jump of the clock rather than drift or jitter.
        slew: largest rate of correction, s per s.

    Raises:
        ConfigurationError: a value is out of its range.
    """

    SETTLING = 1.0  # s in which a deviation would vanish if the slew were not bounded

    def __init__(
        self,
        sample_rate: float,
        tolerance: float = 0.0,
        jump: float = 0.02,
        slew: float = 500e-6,
    ) -> None:
        if not (math.isfinite(sample_rate) and sample_rate > 0):
            raise ConfigurationError(f'sample rate is {sample_rate} Hz; it must be above zero')
        for name, value in (('tolerance', tolerance), ('jump', jump), ('slew', slew)):
            if not (math.isfinite(value) and value >= 0):
                raise ConfigurationError(f'clock {name} is {value}; it must be zero or more')
        self._period_ns = NANOSECONDS / sample_rate
        self._tolerance_ns = tolerance * NANOSECONDS or max(self._period_ns, 1e5)
        self._jump_ns = max(jump * NANOSECONDS, self._tolerance_ns)
        self._slew = slew
        self._line: TimeLine | None = None
        self._last_stamp_ns = 0

    def observe(self, block: SampleBlock) -> Reading | None:
        """Take the next block; None until a stamp other than zero has come."""
        index, stamp_ns, line = block.first_index, block.stamp_ns, self._line
        if stamp_ns <= 0:
            return None if line is None else Reading(line, jumped=False)
        backwards = stamp_ns < self._last_stamp_ns
        self._last_stamp_ns = stamp_ns
        if line is None:
            self._line = TimeLine(index, stamp_ns, 0.0, self._period_ns)
            return Reading(self._line, jumped=False)

        time_ns, fraction = line.at(index)
        deviation = (stamp_ns - time_ns) - fraction
        if abs(deviation) > self._jump_ns:
            self._line = TimeLine(index, stamp_ns, 0.0, self._period_ns)
            return Reading(self._line, jumped=True)
        period_ns = self._period_ns
        if abs(deviation) > self._tolerance_ns:
            correction = deviation / (self.SETTLING * NANOSECONDS)
            period_ns *= 1.0 + min(max(correction, -self._slew), self._slew)
        if period_ns != line.period_ns:
            self._line = line = line.continued(index, period_ns)
        return Reading(line, backwards)
