"""The figures of one blow: force, contacts enlarged, other channels, free oscillation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impactscope.records import EventResult, ImpactEvent
from impactscope.report.event_time import (
    EventClock,
    event_clock,
    event_duration,
    event_samples,
    first_finite,
    printed_unit,
)
from impactscope.report.figure import Band, Dot, Figure, Lane, LimitLine, Series
from impactscope.report.numbers import format_number
from impactscope.report.ring_down_figures import ring_down_figures

__all__ = ['event_figures', 'transient_window_of']

FloatArray = NDArray[np.float64]

FORCE_POINTS = 2400
OTHER_POINTS = 1600
ENLARGE_BELOW = 0.6  # of the window; a contact longer than this needs no second figure
MOST_DOTS = 40
OTHER_SHORTEST = 0.25  # s, of the axis of channels beside the first


def transient_window_of(parameters: dict[str, dict[str, object]]) -> float:
    """The transient window in s as the stages' parameters state it; NaN where they do not."""
    for stage in parameters.values():
        nested = [value for value in stage.values() if isinstance(value, dict)]
        for mapping in (stage, *nested):
            value = mapping.get('transient_window')
            if isinstance(value, int | float) and not isinstance(value, bool):
                return float(value)
    return math.nan


def _was_judged(result: EventResult) -> bool:
    """Whether a force or a limit stands in the verdict at all."""
    verdict = result.verdict
    numbers = (
        verdict.transient_force.value,
        verdict.quasi_static_force.value,
        verdict.transient_limit,
        verdict.quasi_static_limit,
    )
    return any(map(math.isfinite, numbers))


def _phases(
    event: ImpactEvent, clock: EventClock, window: float, *, judged: bool
) -> tuple[list[Band], list[Lane]]:
    """Shading of the plot, and the strips above it that say the same in words."""
    low, high = clock.x_range
    bands, contact, judgement = [], [], []
    start, end = clock(event.contact_start), clock(event.contact_end)
    rest = clock(first_finite(event.event_end, event_duration(event)))
    if math.isfinite(start):
        before = Band(low, start, 'before', 'before')
        bands.append(before)
        contact.append(before)
        if judged and math.isfinite(window):
            turn = start + window * clock.factor
            judgement.append(Band(start, turn, 'transient', 'transient window', short='T'))
            if math.isfinite(end) and end > turn:
                judgement.append(Band(turn, end, 'quasi-static', 'quasi-static', short='S'))
    several = len(event.contacts) > 1
    for number, span in enumerate(event.contacts, start=1):
        name = f'contact {number}' if several else 'contact'
        band = Band(clock(span.start), clock(span.end), 'contact', name, short=str(number))
        if math.isfinite(band.start) and math.isfinite(band.end):
            bands.append(band)
            contact.append(band)
    if math.isfinite(end) and rest > end:
        ring = Band(end, rest, 'ring-down', 'ring-down')
        bands.append(ring)
        contact.append(ring)
        if rest < high:
            contact.append(Band(rest, high, 'before', 'rest'))
    lanes = [Lane('phase', tuple(contact))] if contact else []
    return bands, [Lane('judged as', tuple(judgement)), *lanes] if judgement else lanes


def _limits(
    result: EventResult, clock: EventClock, window: float
) -> tuple[list[LimitLine], list[Band]]:
    """Limit lines over the stretches in which they hold, guard band of the deciding one."""
    verdict, event = result.verdict, result.event
    low, high = clock.x_range
    start = first_finite(clock(event.contact_start), low)
    turn = start + window * clock.factor if math.isfinite(window) else high
    pairs = [
        (verdict.transient_limit, verdict.transient_force, start, min(turn, high), 'transient'),
        (verdict.quasi_static_limit, verdict.quasi_static_force, turn, high, 'quasi-static'),
    ]
    lines, bands, shares = [], [], []
    for level, force, begin, end, name in pairs:
        if math.isfinite(level) and (begin < end or not math.isfinite(window)):
            begin = begin if begin < end else low
            lines.append(LimitLine(level, begin, end, f'{name} limit', f'{name}-limit'))
            share = force.value / level if math.isfinite(force.value) and level else -math.inf
            shares.append(share)
    guard = verdict.guard_band
    if lines and math.isfinite(guard) and guard > 0:
        line = lines[int(np.argmax(shares))]
        name = f'guard band, limit ± {format_number(guard, 2)} N'
        bands.append(
            Band(line.start, line.end, 'guard', name, line.level - guard, line.level + guard)
        )
    return lines, bands


def _dots(
    event: ImpactEvent, clock: EventClock, time: FloatArray, values: FloatArray
) -> list[Dot]:
    """The peak of each contact, on the curve."""
    dots = []
    for number, span in enumerate(event.contacts[:MOST_DOTS], start=1):
        inside = (time >= span.start) & (time <= span.end) & np.isfinite(values)
        if inside.any():
            at = int(np.argmax(np.where(inside, values, -np.inf)))
            name = f'contact {number}: {format_number(float(values[at]))}'
            dots.append(Dot(clock(float(time[at])), float(values[at]), name))
    return dots


def _decimation_note(count: int, points: int) -> tuple[str, ...]:
    if count <= points:
        return ()
    return (f'{count} samples drawn as {points} points; every peak is kept.',)


def _force_figure(
    result: EventResult, title: str, start: float, end: float, window: float, *, limits: bool
) -> Figure:
    event = result.event
    channel = event.channels[0]
    clock = event_clock(event, start, end)
    time, values = event_samples(event, 0)
    is_force = channel.unit == 'N'
    bands, lanes = _phases(event, clock, window, judged=is_force and _was_judged(result))
    lines, guard = _limits(result, clock, window) if limits and is_force else ([], [])
    inside = np.isfinite(values) & (time >= start) & (time <= end)
    largest = 'no finite sample'
    if inside.any():
        largest = f'largest value {format_number(float(values[inside].max()))} {channel.unit}'
    caption = ['Time counts from first contact.']
    if not math.isfinite(event.zero_level[0] if event.zero_level else math.nan):
        caption.append('Zero level not known: values as recorded.')
    else:
        caption.append('Zero level removed.')
    if lines and not math.isfinite(window):
        caption.append('The length of the transient window is not stated with this result.')
    if math.isfinite(event.contact_end) and any(x.style == 'quasi-static-limit' for x in lines):
        caption.append('The quasi-static limit holds while contact lasts.')
    if not inside.any():
        caption.append('No finite samples here.')
    count = int(np.count_nonzero((time >= start) & (time <= end)))
    dots = _dots(event, clock, time, values)
    return Figure(
        title=title,
        description=f'{channel.name} over time, {largest}, '
        f'{len(event.contacts)} contact(s). The tables of this event give the same values.',
        x_label='Time after first contact',
        x_unit=clock.unit,
        y_label='Force' if is_force else channel.name,
        y_unit=channel.unit,
        x_range=clock.x_range,
        series=(
            Series(
                'measured force' if is_force else channel.name,
                clock.axis(time), values, 'measured', FORCE_POINTS,
            ),
        ),
        bands=(*bands, *guard),
        limits=tuple(lines),
        dots=tuple(dots),
        dot_name='largest of each contact' if dots else '',
        lanes=tuple(lanes),
        caption=(*caption, *_decimation_note(count, FORCE_POINTS)),
    )  # fmt: skip


def _enlarged(event: ImpactEvent, window: float) -> tuple[float, float] | None:
    """The stretch around the contacts, or None where the whole window shows them well."""
    start, end = event.contact_start, event.contact_end
    if not (math.isfinite(start) and math.isfinite(end)) or end <= start:
        return None
    length = min(end - start, first_finite(window, 0.5))
    begin = max(start - max(0.15 * length, min(length, 0.003)), 0.0)
    stop = start + length + max(0.4 * length, min(2.0 * length, 0.02))
    stop = min(stop, event_duration(event))
    if not begin < stop or stop - begin > ENLARGE_BELOW * event_duration(event):
        return None
    return begin, stop


def _other_figures(event: ImpactEvent, start: float, end: float) -> list[Figure]:
    """One figure for each channel beside the first."""
    figures = []
    clock = event_clock(event, start, end)
    for row, channel in enumerate(event.channels[1:], start=1):
        time, values = event_samples(event, row)
        inside = np.isfinite(values) & (time >= start) & (time <= end)
        if inside.any():
            largest = f'Largest magnitude {format_number(float(np.abs(values[inside]).max()))}'
            largest += f' {printed_unit(channel.unit)}.'
        else:
            largest = 'No finite samples here.'
        kind, _, place = channel.name.partition('.')
        acceleration = kind == 'acceleration'
        figures.append(
            Figure(
                title=f'Acceleration, {place}' if acceleration and place else channel.name,
                description=f'{channel.name} over time. {largest}',
                x_label='Time after first contact',
                x_unit=clock.unit,
                y_label='Acceleration' if acceleration else kind.capitalize(),
                y_unit=printed_unit(channel.unit),
                x_range=clock.x_range,
                series=(Series(channel.name, clock.axis(time), values, 'other', OTHER_POINTS),),
                bands=tuple(
                    Band(clock(c.start), clock(c.end), 'contact', 'contact')
                    for c in event.contacts
                    if math.isfinite(c.start) and math.isfinite(c.end)
                ),
                height=120,
                caption=(
                    largest,
                    *_decimation_note(
                        int(np.count_nonzero((time >= start) & (time <= end))), OTHER_POINTS
                    ),
                ),
            )
        )
    return figures


def event_figures(result: EventResult, window: float) -> tuple[list[Figure], list[Figure]]:
    """Figures of the blow and of its free oscillation.

    ``window`` is the transient window in s, NaN where it is not known. Both lists may be
    empty: an event without samples has nothing to draw.
    """
    event = result.event
    if event.values.size == 0 or event.sample_rate <= 0:
        return [], []
    whole = (0.0, event_duration(event))
    blow = [_force_figure(result, 'Force over the whole event', *whole, window, limits=True)]
    if event.channels[0].unit != 'N':
        blow = [_force_figure(result, event.channels[0].name, *whole, window, limits=False)]
    near = _enlarged(event, window)
    if near is not None:
        blow.append(_force_figure(result, 'Contact, enlarged', *near, window, limits=False))
    if near is not None:
        # A response rings on after a short contact: the other channels show more of it.
        near = near[0], min(max(near[1], near[0] + OTHER_SHORTEST), whole[1])
    blow += _other_figures(event, *(near or whole))
    return blow, ring_down_figures(event, result.sensor)
