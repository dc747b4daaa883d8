"""From an open event to its record: window, contacts, levels, flags."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impactscope.detect.contacts import ContactRules, find_contacts, moving_mean
from impactscope.detect.history import History
from impactscope.detect.plate_memory import PlateMemory
from impactscope.detect.settings import DetectorSettings
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import (
    NANOSECONDS,
    Channel,
    Contact,
    ImpactEvent,
    Quality,
    SyncedBlock,
)

__all__ = [
    'Layout',
    'Opening',
    'build_event',
    'contact_threshold',
    'contacts_of',
    'opened_reading',
    'smoothed_peak',
]


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """What stays the same over an epoch."""

    channels: tuple[Channel, ...]
    epoch: int
    grid_rate: float  # Hz
    oversampling: int
    row: int  # of the trigger channel
    stride: int  # columns from one of its samples to the next
    hop: int  # its samples in a hop
    scales: NDArray[np.int64]  # lengths of the averaging windows, in its samples

    def fits(self, record: SyncedBlock) -> bool:
        """Whether a block continues the same epoch."""
        return (
            record.epoch == self.epoch
            and record.sample_rate == self.grid_rate
            and record.oversampling == self.oversampling
            and len(record.channels) == len(self.channels)
            and all(
                a.name == b.name and a.unit == b.unit
                for a, b in zip(record.channels, self.channels, strict=True)
            )
        )


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """What was known when a blow was found. Arrays have the trigger channel first."""

    trigger: int  # grid index by which the blow had begun
    zero: NDArray[np.float64]  # level of each channel before
    noise: NDArray[np.float64]  # standard deviation of each channel before
    sigma: NDArray[np.float64]  # of the trigger channel: of a sample, then of each window
    contact_force: float  # below it, and below noise, there is no contact
    drift: float  # of the zero level as last seen, a grid sample
    in_newtons: bool
    quality: Quality


def opened_reading(
    layout: Layout,
    history: History,
    opening: Opening,
    polarity: int,
    begin: int,
    retained: int,
    stop: int,
) -> tuple[int, NDArray[np.float64]]:
    """First grid index and samples of the trigger channel, zero level off, blows positive.

    From ``retained`` grid samples before the trigger, or the stream's first sample ``begin``.
    """  # fmt: skip
    earliest = max(begin, opening.trigger - retained)
    slack = (opening.trigger - earliest) // layout.stride * layout.stride
    start = opening.trigger - slack
    row = history.view(start, stop)[layout.row, :: layout.stride].astype(np.float64)
    reading = (row - opening.zero[0]) * (polarity or 1)
    return start, np.abs(reading) if polarity == 0 else reading


def contact_threshold(opening: Opening, settings: DetectorSettings) -> float:
    """Reading above which there is contact, or ringing."""
    return max(opening.contact_force, settings.release * float(opening.sigma[1]))


def smoothed_peak(reading: NDArray[np.float64], n: int) -> float:
    """Largest moving mean of n samples; non-finite samples count as zero."""
    return float(moving_mean(reading, n).max())


def contacts_of(
    layout: Layout,
    opening: Opening,
    settings: DetectorSettings,
    profile: MeasurementProfile,
    plates: PlateMemory,
    reading: NDArray[np.float64],
    trigger: int,
    quiet: int | None,
) -> tuple[Contact, ...]:
    """The contacts of a blow, times in s after the reading's first sample.

    Args:
        layout: of the stream.
        opening: what was known before the blow.
        settings: of the detector.
        profile: the rules of the measurement.
        plates: what is known of the sensor's plate; learns from this event.
        reading: as from :func:`opened_reading`.
        trigger: sample of it by which the blow had begun.
        quiet: sample of it from which the plate is at rest and free of load, or None.
    """
    native = layout.grid_rate / layout.stride
    rules = ContactRules(
        rate=native,
        threshold=contact_threshold(opening, settings),
        smoothing=int(layout.scales[0]),
        hold=max(round(profile.contact_end_hold * native), 1),
        noise=float(opening.sigma[0]),
        smoothed_noise=float(opening.sigma[1]),
    )
    contacts = find_contacts(reading, trigger, rules)
    if not opening.in_newtons:
        return contacts[:1]  # a position's or acceleration's further half-waves press on nothing
    if quiet is not None:
        plates.learn(reading[round(contacts[-1].end * native) : quiet], native, rules.noise)
    if plates.model is None:
        return contacts
    return find_contacts(reading, trigger, rules, plates.model)


def build_event(
    layout: Layout,
    history: History,
    opening: Opening,
    profile: MeasurementProfile,
    contacts: tuple[Contact, ...],
    reading: NDArray[np.float64],
    threshold: float,
    *,
    begin: int,
    start: int,
    retained: int,
    stop: int,
    quality: Quality,
    rest_from: int | None,
    torn: Sequence[int] = (),
) -> ImpactEvent:
    """Cut the event out of the history.

    Args:
        layout: of the stream.
        history: holds the window.
        opening: what was known before the blow.
        profile: the rules of the measurement.
        contacts: times from grid index ``start`` on.
        reading: of the trigger channel from there on.
        threshold: of contact, in the reading's unit.
        begin: grid index of the stream's first sample.
        start: grid index of the reading's first sample.
        retained: grid samples before the trigger that the history holds for certain.
        stop: grid index one beyond the window.
        quality: flags of how the event ended.
        rest_from: grid index from which the signal is at rest; None where it never was.
        torn: rows beside the trigger that the stream's end cut off in their ring-down.
    """
    rate = layout.grid_rate
    native = rate / layout.stride
    earliest = max(begin, opening.trigger - retained)
    onset = contacts[0].start
    if start == begin and onset == 0:
        quality |= Quality.TORN  # the stream began inside the blow
    rest = math.nan
    if rest_from is not None:
        rest = float(np.mean(reading[(rest_from - start) // layout.stride :]))
    end = contacts[-1].end
    last = (stop - 1 - start) / rate
    if Quality.HELD in quality:
        end = min(onset + profile.longest_hold, last)
        contacts = (*contacts[:-1], replace(contacts[-1], end=end))
    elif Quality.TORN in quality and opening.in_newtons and reading[-1] > threshold:
        end = last

    lead = math.ceil((profile.pre_trigger - onset) * native - 1e-6)
    first = start - min(lead, (start - earliest) // layout.stride) * layout.stride
    offset = (first - start) / rate
    order = [layout.row, *(c for c in range(len(layout.channels)) if c != layout.row)]
    values = np.ascontiguousarray(history.view(first, stop)[order])
    values.flags.writeable = False
    flags = history.flags(first, stop)
    channels = tuple(
        _judged(
            layout.channels[c],
            flags[c] | (Quality.TORN if c in torn else Quality.NONE),
            values[k],
        )
        for k, c in enumerate(order)
    )
    event_end = rest_from if rest_from is not None and Quality.HELD not in quality else stop
    window_start_ns = history.stamp(first)
    length = (stop - first) / rate
    moved = tuple(_shifted(contact, -offset, length) for contact in contacts)
    return ImpactEvent(
        event_id=0,  # numbered by the detector
        stamp_ns=window_start_ns + round((onset - offset) * NANOSECONDS),
        window_start_ns=window_start_ns,
        sample_rate=rate,
        channels=channels,
        values=values,
        contacts=moved,
        contact_start=onset - offset,
        contact_end=min(end - offset, length),
        event_end=(event_end - first) / rate,
        zero_level=tuple(map(float, opening.zero)),
        noise_std=tuple(map(float, opening.noise)),
        rest_level=rest,
        quality=quality | opening.quality | channels[0].quality,
        oversampling=layout.oversampling if layout.row == 0 else 1,
    )


def _shifted(contact: Contact, by: float, latest: float) -> Contact:
    """A contact on another time, its end no later than the window's, which rounding may pass."""
    return replace(
        contact,
        start=contact.start + by,
        end=min(contact.end + by, latest),
        peak_time=contact.peak_time + by,
    )


def _judged(channel: Channel, flags: Quality, values: NDArray[np.float32]) -> Channel:
    """The channel with the flags of its blocks and of the window's own values."""
    quality = flags
    if np.isnan(values).any() and not flags & (Quality.GAP_BEFORE | Quality.NOT_FINITE):
        quality |= Quality.MISSING
    if np.isinf(values).any():
        quality |= Quality.NOT_FINITE
    if (values >= channel.range_max).any() or (values <= channel.range_min).any():
        quality |= Quality.CLIPPED
    return replace(channel, quality=quality)
