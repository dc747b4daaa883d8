"""What the report says of one blow: tables, notes and figures, ready for the template."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from markupsafe import Markup

from impactscope.errors import InputError
from impactscope.estimate import highest_speed
from impactscope.records import (
    ComplianceVerdict,
    Estimate,
    EventResult,
    ImpactEvent,
    ImpactParameters,
    SensorParameters,
    SensorSummary,
    TestPoint,
)
from impactscope.report.event_figures import event_figures
from impactscope.report.figure import draw_figure
from impactscope.report.numbers import (
    NOT_KNOWN,
    Quantity,
    format_estimate,
    format_given,
    format_number,
    format_quantity,
    format_stamp,
)
from impactscope.report.plain_text import printable
from impactscope.report.ring_down import has_fit
from impactscope.report.verdict_words import (
    CONTACT_WORDS,
    VerdictWords,
    quality_sentences,
    verdict_words,
)

__all__ = [
    'EventReport',
    'ForceRow',
    'force_rows',
    'region_words',
    'report_event',
    'sensor_summary_rows',
    'test_point_rows',
]

MOST_CONTACTS = 20
LONGEST_NAME = 60
LONGEST_UNIT = 16
NOT_STATED = 'not stated'


@dataclass(frozen=True, slots=True)
class ForceRow:
    """A judged force beside its limit, in N as printed."""

    name: str
    symbol: str
    value: str
    uncertainty: str
    limit: str
    share: str  # of the limit, in percent
    known: bool


@dataclass(frozen=True, slots=True)
class EventReport:
    """One blow as the template prints it."""

    position: int  # from 1; anchors and headings count by it
    event_id: int
    when: str
    title: str
    verdict: VerdictWords
    reasons: tuple[str, ...]
    test_point: TestPoint
    region: str
    test_rows: tuple[tuple[str, str], ...]
    forces: tuple[ForceRow, ...]
    judgement: tuple[Quantity, ...]
    validity: str
    contacts: tuple[tuple[str, ...], ...]
    more_contacts: int
    contact_unit: str  # of the peaks
    impact: tuple[Quantity, ...]
    impact_note: str
    sensor: tuple[Quantity, ...]
    modes: tuple[tuple[Quantity, ...], ...]
    sensor_note: str
    quality: tuple[str, ...]
    channel_quality: tuple[tuple[str, str], ...]
    blow_figures: tuple[Markup, ...]
    ring_figures: tuple[Markup, ...]


def region_words(name: str) -> str:
    """A body region's name for people: 'hands_fingers' reads 'hands / fingers'."""
    return name.replace('_', ' / ') if name else NOT_STATED


def force_rows(verdict: ComplianceVerdict) -> tuple[ForceRow, ...]:
    """Transient and quasi-static force of a verdict, each beside its limit."""
    rows = []
    for name, symbol, force, limit in (
        ('Transient force', 'T', verdict.transient_force, verdict.transient_limit),
        ('Quasi-static force', 'S', verdict.quasi_static_force, verdict.quasi_static_limit),
    ):
        value, uncertainty = format_estimate(force)
        known = math.isfinite(force.value)
        share = '-'
        if known and math.isfinite(limit) and limit > 0:
            share = f'{format_number(100 * force.value / limit, 3)} %'
        rows.append(
            ForceRow(
                name,
                symbol,
                value if known else 'none' if symbol == 'S' else NOT_KNOWN,
                uncertainty,
                format_given(limit) if math.isfinite(limit) else 'none',
                share,
                known,
            )
        )
    return tuple(rows)


def test_point_rows(point: TestPoint) -> tuple[tuple[str, str], ...]:
    """What was tested, row by row; what is missing is said to be."""
    stiffness = NOT_STATED
    if math.isfinite(point.spring_stiffness):
        value, uncertainty = format_estimate(
            Estimate(point.spring_stiffness, point.spring_stiffness_std), 1e-3
        )
        stiffness = f'{format_given(point.spring_stiffness * 1e-3)} N/mm'
        if uncertainty and uncertainty != NOT_KNOWN:
            stiffness = f'({value} ± {uncertainty}) N/mm (k = 2)'
    repetition = NOT_STATED
    if point.repetition:
        planned = f' of {point.repetitions_planned}' if point.repetitions_planned else ''
        repetition = f'{point.repetition}{planned}'
    speed = f'{format_given(point.speed)} m/s' if math.isfinite(point.speed) else NOT_STATED
    return (
        ('Test point', point.id or NOT_STATED),
        ('Body region', region_words(point.body_region)),
        ('Contact', CONTACT_WORDS[point.contact]),
        ('Repetition', repetition),
        ('Robot', point.robot or NOT_STATED),
        ('Tool and payload', point.tool or NOT_STATED),
        ('Pose', point.pose or NOT_STATED),
        ('Commanded speed', speed),
        ('Measuring device', point.device or NOT_STATED),
        ('Spring', stiffness),
        ('Damper', point.damper or NOT_STATED),
        *([('Notes', point.notes)] if point.notes else []),
    )


test_point_rows.__test__ = False  # type: ignore[attr-defined]  # not a test for pytest


def _judgement(verdict: ComplianceVerdict, impact: ImpactParameters) -> tuple[Quantity, ...]:
    rows = []
    if math.isfinite(verdict.guard_band):
        text = format_number(verdict.guard_band, 2)
        rows.append(Quantity('Guard band (half-width)', text, '', 'N'))
    if math.isfinite(verdict.reconstructed_peak_force):
        std = impact.peak_contact_force.std
        rows.append(
            format_quantity(
                'Contact force, reconstructed (diagnostic, not judged)',
                Estimate(verdict.reconstructed_peak_force, std),
                'N',
            )
        )
    return tuple(rows)


def _validity(verdict: ComplianceVerdict) -> str:
    """How far the device's own dynamics changed the peak, in a sentence."""
    read, true = verdict.transient_force.value, verdict.reconstructed_peak_force
    if not (math.isfinite(read) and math.isfinite(true)) or true <= 0:
        return ''
    change = 100 * (read / true - 1)
    word = 'over' if change > 0 else 'under'
    return (
        f"The device's own dynamics made it read {format_number(abs(change), 2)} % {word} the "
        'reconstructed contact force. The reading is what the limits presume and what is judged.'
    )


def _contact_rows(event: ImpactEvent) -> tuple[tuple[str, ...], ...]:
    origin = event.contact_start if math.isfinite(event.contact_start) else 0.0
    rows = []
    for number, c in enumerate(event.contacts[:MOST_CONTACTS], start=1):
        rows.append((
            str(number),
            format_number((c.start - origin) * 1e3),
            format_number((c.end - c.start) * 1e3),
            format_number(c.peak_force),
            format_number((c.peak_time - origin) * 1e3),
            format_number(c.impulse),
        ))  # fmt: skip
    return tuple(rows)


def _impact_rows(impact: ImpactParameters, verdict: ComplianceVerdict) -> tuple[Quantity, ...]:
    rows = [
        format_quantity('Peak force, as measured', impact.peak_force, 'N'),
        format_quantity('Peak contact force, reconstructed', impact.peak_contact_force, 'N'),
        format_quantity('Duration of first contact', impact.contact_time, 'ms', scale=1e3),
        format_quantity('Impulse of first contact', impact.impulse, 'N s'),
        format_quantity('Speed at first contact', impact.impact_speed, 'm/s'),
        format_quantity('Effective mass of the impactor', impact.effective_mass, 'kg'),
        format_quantity('Energy stored in the spring', impact.transferred_energy, 'J'),
    ]
    further = (
        ('Frequency of plate and impactor together', impact.coupled_frequency, 'Hz'),
        ('Mass of the impactor, from that frequency', impact.coupled_mass, 'kg'),
        ('Speed at which the transient limit is reached', highest_speed(impact, verdict), 'm/s'),
    )
    rows += [format_quantity(*row) for row in further if math.isfinite(row[1].value)]
    return tuple(rows)


def _sensor_rows(sensor: SensorParameters, unit: str) -> tuple[Quantity, ...]:
    rows = [
        format_quantity('Natural frequency', sensor.natural_frequency, 'Hz'),
        format_quantity('Damped frequency', sensor.damped_frequency, 'Hz'),
        format_quantity('Damping ratio', sensor.damping_ratio, ''),
        format_quantity('Bandwidth (-3 dB)', sensor.bandwidth, 'Hz'),
        format_quantity('Spring stiffness (given)', sensor.stiffness, 'N/mm', scale=1e-3),
        format_quantity('Moving mass', sensor.moving_mass, 'kg'),
        format_quantity('Damping constant', sensor.damping_constant, 'N s/m'),
        format_quantity('Amplitude at the start of the span', sensor.amplitude, unit),
        format_quantity('Offset', sensor.offset, unit),
        format_quantity('Frequency from the spectrum', sensor.spectral_frequency, 'Hz'),
        format_quantity('Damping ratio from the spectrum', sensor.spectral_damping_ratio, ''),
    ]
    if math.isfinite(sensor.linearity_p_value):
        rows += [
            format_quantity(
                'Frequency at small amplitude', sensor.small_amplitude_frequency, 'Hz'
            ),
            format_quantity('Change of frequency per e-fold', sensor.frequency_slope, 'Hz'),
            format_quantity('Change of damping ratio per e-fold', sensor.damping_slope, ''),
        ]
        text = format_number(sensor.linearity_p_value, 2)
        rows.append(Quantity('Chance of such changes if linear', text, '', ''))
    if math.isfinite(sensor.r_squared):
        rows.append(Quantity('R² of the fit', format_number(sensor.r_squared, 5), '', ''))
    if math.isfinite(sensor.rmse):
        rows.append(Quantity('RMSE of the fit', format_number(sensor.rmse, 3), '', unit))
    return tuple(rows)


def _mode_rows(sensor: SensorParameters, unit: str) -> tuple[tuple[Quantity, ...], ...]:
    """Frequency, damping ratio and amplitude of each mode."""
    return tuple(
        (
            format_quantity('Natural frequency', mode.natural_frequency, 'Hz'),
            format_quantity('Damping ratio', mode.damping_ratio, ''),
            format_quantity('Amplitude', mode.amplitude, unit),
        )
        for mode in sensor.modes
    )


def sensor_summary_rows(summary: SensorSummary) -> tuple[Quantity, ...]:
    """What all blows tell of the sensor together, row by row."""
    rows = [
        format_quantity('Natural frequency', summary.natural_frequency, 'Hz'),
        format_quantity('Damping ratio', summary.damping_ratio, ''),
    ]
    if math.isfinite(summary.moving_mass.value):
        rows.append(format_quantity('Moving mass', summary.moving_mass, 'kg'))
    text = format_number(summary.scatter_p_value, 2)
    rows.append(Quantity('Chance of such scatter on one linear sensor', text, '', ''))
    if math.isfinite(summary.linearity_p_value):
        rows += [
            format_quantity('Change of frequency per e-fold', summary.frequency_slope, 'Hz'),
            format_quantity('Change of damping ratio per e-fold', summary.damping_slope, ''),
        ]
        text = format_number(summary.linearity_p_value, 2)
        rows.append(Quantity('Chance of such changes if linear', text, '', ''))
    return tuple(rows)


def _note(valid: bool, reason: str, method: str, what: str) -> str:
    if valid:
        return f'Method: {method}.' if method else ''
    return f'{what}: {reason or "no reason was given"}.'.replace('..', '.')


def _fit_to_print(result: EventResult) -> EventResult:
    """The same with names and units of channels that a figure can hold."""
    channels = tuple(
        dataclasses.replace(
            c, name=printable(c.name, LONGEST_NAME), unit=printable(c.unit, LONGEST_UNIT)
        )
        for c in result.event.channels
    )
    event = dataclasses.replace(result.event, channels=channels)
    channel = printable(result.sensor.channel, LONGEST_NAME)
    sensor = dataclasses.replace(result.sensor, channel=channel)
    return dataclasses.replace(result, event=event, sensor=sensor)


def report_event(
    result: EventResult, position: int, window: float, described: frozenset[str] = frozenset()
) -> EventReport:
    """Everything the template needs of one blow.

    ``position`` counts the events from 1; ``window`` is the transient window in s, NaN where
    it is not known; ``described`` names the test points that the page describes elsewhere.
    Raises InputError where samples and channels do not match.
    """
    event, verdict = result.event, result.verdict
    if event.values.ndim != 2 or event.values.shape[0] != len(event.channels):
        raise InputError(
            f'event {event.event_id}: values have shape {event.values.shape} '
            f'with {len(event.channels)} channels'
        )
    result = _fit_to_print(result)
    event = result.event
    blow, ring = event_figures(result, window) if event.channels else ([], [])
    point = verdict.test_point if verdict.test_point.id else event.test_point
    row = event.index_of(result.sensor.channel)
    unit = event.channels[row if row is not None else 0].unit if event.channels else ''
    title = f'Event {event.event_id}'
    if point.id:
        title += f', test point {point.id}'
        title += f', repetition {point.repetition}' if point.repetition else ''
    return EventReport(
        position=position,
        event_id=event.event_id,
        when=format_stamp(event.stamp_ns),
        title=title,
        verdict=verdict_words(verdict.verdict),
        reasons=verdict.reasons,
        test_point=point,
        region=region_words(point.body_region),
        test_rows=() if point.id in described else test_point_rows(point),
        forces=force_rows(verdict),
        judgement=_judgement(verdict, result.impact),
        validity=_validity(verdict),
        contacts=_contact_rows(event),
        contact_unit=event.channels[0].unit if event.channels else '',
        more_contacts=max(len(event.contacts) - MOST_CONTACTS, 0),
        impact=_impact_rows(result.impact, verdict) if result.impact.valid else (),
        impact_note=_note(
            result.impact.valid, result.impact.reason, result.impact.method, 'Not estimated'
        ),
        sensor=()
        if result.sensor.modes or not has_fit(result.sensor)
        else _sensor_rows(result.sensor, unit),
        modes=_mode_rows(result.sensor, unit),
        sensor_note=_note(
            result.sensor.valid,
            result.sensor.reason,
            result.sensor.method,
            'Not the constants of a sensor' if has_fit(result.sensor) else 'Not identified',
        ),
        quality=tuple(quality_sentences(event.quality)),
        channel_quality=tuple(
            (c.name, sentence) for c in event.channels for sentence in quality_sentences(c.quality)
        ),
        blow_figures=tuple(draw_figure(figure) for figure in blow),
        ring_figures=tuple(draw_figure(figure) for figure in ring),
    )
