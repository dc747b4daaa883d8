"""Times and samples of one event as its figures count them: from first contact."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.records import ImpactEvent

__all__ = [
    'EventClock',
    'event_clock',
    'event_duration',
    'event_samples',
    'first_finite',
    'printed_unit',
]

FloatArray = NDArray[np.float64]

SECONDS_FROM = 2.0  # s: axes longer than this count in s, shorter ones in ms


@dataclass(frozen=True, slots=True)
class EventClock:
    """Times of an event relative to first contact, in the unit of the axis."""

    origin: float  # s after the window's start
    start: float  # of the axis, s after first contact
    end: float
    factor: float
    unit: str

    def __call__(self, seconds: float) -> float:
        """From s after the window's start to the axis."""
        return (seconds - self.origin) * self.factor

    def axis(self, seconds: FloatArray) -> FloatArray:
        """From s after the window's start to the axis, shape (n,)."""
        return (seconds - self.origin) * self.factor

    @property
    def x_range(self) -> tuple[float, float]:
        """Both ends of the axis, in its unit."""
        return self.start * self.factor, self.end * self.factor


def event_clock(event: ImpactEvent, start: float, end: float) -> EventClock:
    """A clock whose axis runs from ``start`` to ``end``, s after the window's start."""
    origin = event.contact_start if math.isfinite(event.contact_start) else 0.0
    factor, unit = (1.0, 's') if end - start > SECONDS_FROM else (1e3, 'ms')
    return EventClock(origin, start - origin, end - origin, factor, unit)


def first_finite(*candidates: float) -> float:
    """The first finite one; NaN where there is none."""
    return next((value for value in candidates if math.isfinite(value)), math.nan)


def event_samples(event: ImpactEvent, row: int) -> tuple[FloatArray, FloatArray]:
    """Times (s after the window's start) and values, zero level removed where it is known.

    Of the reference channel only its own samples: the grid may be finer than it.
    """
    stride = max(event.oversampling, 1) if row == 0 else 1
    values = event.values[row, ::stride].astype(np.float64)
    zero = event.zero_level[row] if row < len(event.zero_level) else math.nan
    rate = event.sample_rate / stride if event.sample_rate > 0 else 1.0
    return np.arange(values.size) / rate, values - (zero if math.isfinite(zero) else 0.0)


def event_duration(event: ImpactEvent) -> float:
    """Length of the event's window in s."""
    return event.values.shape[1] / event.sample_rate if event.sample_rate > 0 else 0.0


def printed_unit(unit: str) -> str:
    """A unit as people write it."""
    return unit.replace('^2', '²').replace('^3', '³')
