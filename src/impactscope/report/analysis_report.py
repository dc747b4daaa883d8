"""The report of one analysed recording: one HTML file, verdict first."""

from __future__ import annotations

import math
import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import AnalysisResult, Channel, ComplianceVerdict, Verdict
from impactscope.report.event_figures import transient_window_of
from impactscope.report.event_report import (
    EventReport,
    ForceRow,
    force_rows,
    region_words,
    report_event,
    sensor_summary_rows,
    test_point_rows,
)
from impactscope.report.numbers import NOT_KNOWN, format_given, format_number, format_stamp
from impactscope.report.page import render_page, write_page
from impactscope.report.plain_text import flatten
from impactscope.report.verdict_words import VerdictWords, quality_sentences, verdict_words

__all__ = ['render_report', 'write_report']

MOST_REASONS = 8
WORST_FIRST = (
    Verdict.FAIL,
    Verdict.CONDITIONAL_FAIL,
    Verdict.INVALID,
    Verdict.INCOMPLETE,
    Verdict.CONDITIONAL_PASS,
    Verdict.PASS,
)


@dataclass(frozen=True, slots=True)
class _TestPointReport:
    """The verdict over the repetitions of one test point, as the template prints it."""

    name: str
    region: str
    verdict: VerdictWords
    reasons: tuple[str, ...]
    forces: tuple[ForceRow, ...]
    spread: str
    events: tuple[tuple[int, int], ...]  # position in the page, id of the event
    rows: tuple[tuple[str, str], ...]


def _test_point(verdict: ComplianceVerdict, result: AnalysisResult) -> _TestPointReport:
    point = verdict.test_point
    judged = set(verdict.event_ids)
    events = tuple(
        (position, item.event.event_id)
        for position, item in enumerate(result.events, start=1)
        if item.event.event_id in judged and item.verdict.test_point.id == point.id
    )
    return _TestPointReport(
        name=point.id or 'without a name',
        region=region_words(point.body_region),
        verdict=verdict_words(verdict.verdict),
        reasons=verdict.reasons,
        forces=force_rows(verdict),
        spread=format_number(verdict.spread, 3),
        events=events,
        rows=tuple(row for row in test_point_rows(point) if row[0] != 'Repetition'),
    )


def _leading_reasons(result: AnalysisResult) -> list[str]:
    """Why the recording is judged as it is: the reasons of whatever bears the same verdict."""
    if not result.events and not result.test_points:
        return ['No blow was found in this recording: there is nothing to judge.']
    reasons: dict[str, None] = {}
    for verdict in result.test_points:
        if verdict.verdict == result.verdict:
            name = verdict.test_point.id or 'without a name'
            for reason in verdict.reasons[:2]:
                reasons[f'Test point {name}: {reason}'] = None
    if not reasons:
        for item in result.events:
            if item.verdict.verdict == result.verdict:
                for reason in item.verdict.reasons[:2]:
                    reasons[f'Event {item.event.event_id}: {reason}'] = None
    found = list(reasons)
    if len(found) > MOST_REASONS:
        rest = len(found) - MOST_REASONS
        return [*found[:MOST_REASONS], f'{rest} more; see the tables below.']
    return found


def _named_once(values: list[str]) -> str:
    """The distinct names in order of appearance, or that none is stated."""
    return '; '.join(dict.fromkeys(value for value in values if value)) or 'not stated'


def _range(channel: Channel) -> str:
    if math.isnan(channel.range_min) and math.isnan(channel.range_max):
        return NOT_KNOWN
    return f'{format_given(channel.range_min)} to {format_given(channel.range_max)}'


def _transient_window(result: AnalysisResult) -> float:
    """From the parameters; failing that from the default profile, where it was the one used."""
    window = transient_window_of(result.parameters)
    default = MeasurementProfile()
    if math.isnan(window) and all(
        item.verdict.measurement_profile == default.label for item in result.events
    ):
        return default.transient_window
    return window


def render_report(result: AnalysisResult) -> str:
    """One self-contained HTML page for an analysed recording.

    The same result gives the same page, byte for byte. Raises InputError where an event's
    samples and channels do not match.
    """
    window = _transient_window(result)
    described = frozenset(v.test_point.id for v in result.test_points if v.test_point.id)
    events: list[EventReport] = [
        report_event(item, position, window, described)
        for position, item in enumerate(result.events, 1)
    ]
    verdicts = [*(item.verdict for item in result.events), *result.test_points]
    counts = Counter(item.verdict.verdict for item in result.events)
    first = min((item.event.stamp_ns for item in result.events), default=None)
    return render_page(
        'report.html.j2',
        title=f'Impact test report: {result.source}',
        result=result,
        verdict=verdict_words(result.verdict),
        reasons=_leading_reasons(result),
        counts=[(verdict_words(v), counts[v]) for v in WORST_FIRST if counts[v]],
        first_blow=format_stamp(first) if first is not None else 'none',
        duration=f'{format_number(result.duration)} s' if result.duration > 0 else NOT_KNOWN,
        limit_set=_named_once([v.limit_set for v in verdicts]),
        profile=_named_once([v.measurement_profile for v in verdicts]),
        decision_rule=_named_once([v.decision_rule for v in verdicts]),
        events=events,
        sensor=sensor_summary_rows(result.sensor) if result.sensor is not None else (),
        test_points=[_test_point(verdict, result) for verdict in result.test_points],
        channels=[
            (
                channel,
                format_number(channel.native_rate) if channel.native_rate else 'not known',
                _range(channel),
                quality_sentences(channel.quality),
            )
            for channel in result.channels
        ],
        parameters=[(stage, flatten(values)) for stage, values in result.parameters.items()],
        provenance=flatten(result.provenance),
    )


def write_report(result: AnalysisResult, path: str | os.PathLike[str]) -> None:
    """Write :func:`render_report` to ``path``; the file appears whole or not at all.

    Raises InputError as :func:`render_report` does, OSError where ``path`` cannot be written.
    """
    write_page(render_report(result), Path(path))
