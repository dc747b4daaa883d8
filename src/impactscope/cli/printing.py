"""How results are said on the terminal, and the exit code that they come to."""

import json
import math
import time
from pathlib import Path

from rich.markup import escape

from impactscope.cli.console import out
from impactscope.records import (
    AnalysisResult,
    ComplianceVerdict,
    Estimate,
    EventResult,
    SensorParameters,
    SensorSummary,
    Verdict,
)

__all__ = ['UNREADABLE', 'conclude', 'print_blow', 'print_summary', 'print_test_point']

EXIT = {
    Verdict.PASS: 0,
    Verdict.CONDITIONAL_PASS: 0,
    Verdict.CONDITIONAL_FAIL: 1,
    Verdict.FAIL: 1,
    Verdict.INVALID: 4,
    Verdict.INCOMPLETE: 5,
}
UNREADABLE = 3
LINEARITY_LIMIT = 1e-3  # p-value below which a dependence on the amplitude is said
STYLE = {
    Verdict.PASS: 'bold green',
    Verdict.CONDITIONAL_PASS: 'bold yellow',
    Verdict.CONDITIONAL_FAIL: 'bold dark_orange',
    Verdict.FAIL: 'bold red',
    Verdict.INVALID: 'bold magenta',
    Verdict.INCOMPLETE: 'bold',
}


def quantity(estimate: Estimate, scale: float, unit: str) -> str:
    """Value ± expanded uncertainty (k = 2), both to its second digit (JCGM 100)."""
    value, uncertainty = estimate.value * scale, 2 * estimate.std * scale
    if math.isnan(value):
        return '-'
    if not (math.isfinite(uncertainty) and uncertainty > 0):
        return f'{value:.4g} {unit}'.rstrip()
    decimals = min(max(1 - math.floor(math.log10(uncertainty)), 0), 12)
    return f'{value:.{decimals}f} ± {uncertainty:.{decimals}f} {unit}'.rstrip()


def print_blow(result: EventResult) -> None:
    """One blow: when, how hard, its verdict, and what it tells of impactor and sensor."""
    event, verdict = result.event, result.verdict
    clock = time.strftime('%H:%M:%S', time.gmtime(event.stamp_ns // 10**9))
    contacts = f'{len(event.contacts)} contact{"s" if len(event.contacts) != 1 else ""}'
    reason = verdict.reasons[0] if verdict.reasons else ''
    out.print(
        f'blow {event.event_id} at {clock}.{event.stamp_ns // 10**6 % 1000:03d}: '
        f'{contacts}, peak {quantity(result.impact.peak_force, 1, "N")}, '
        f'[{STYLE[verdict.verdict]}]{verdict.verdict.name}[/]. {escape(reason)}'
    )
    for line in (*_impactor_lines(result), *_sensor_lines(result.sensor)):
        out.print(f'  {escape(line)}')


def _impactor_lines(result: EventResult) -> list[str]:
    """What the blow tells of impactor and contact, as far as it does."""
    from impactscope.estimate import highest_speed

    impact = result.impact
    told = (
        ('speed', impact.impact_speed, 1, 'm/s'),
        ('effective mass', impact.effective_mass, 1, 'kg'),
        ('contact', impact.contact_time, 1e3, 'ms'),
        (
            'impulse of the reading' if impact.method == 'reading' else 'impulse',
            impact.impulse,
            1,
            'N s',
        ),
        ('contact force', impact.peak_contact_force, 1, 'N'),
        ('mass that rests on the plate', impact.coupled_mass, 1, 'kg'),
        ('the limit would be reached at', highest_speed(impact, result.verdict), 1, 'm/s'),
    )
    parts = [
        f'{name} {quantity(value, scale, unit)}'
        for name, value, scale, unit in told
        if math.isfinite(value.value)
    ]
    return [f'impactor: {", ".join(parts)}'] if parts else []


def _sensor_lines(sensor: SensorParameters) -> list[str]:
    """What the blow tells of the sensor, and why it is no more."""
    if sensor.modes:
        lines = [f'{sensor.channel}: {sensor.reason} (R² {sensor.r_squared:.3f})']
        return lines + [
            f'  {quantity(mode.natural_frequency, 1, "Hz")}, '
            f'damping ratio {quantity(mode.damping_ratio, 1, "")}'
            for mode in sensor.modes
        ]
    if not sensor.valid and math.isnan(sensor.linearity_p_value):
        return [f'sensor: cannot be estimated: {sensor.reason}'] if sensor.reason else []
    parts = [
        quantity(sensor.natural_frequency, 1, 'Hz'),
        f'damping ratio {quantity(sensor.damping_ratio, 1, "")}',
    ]
    if math.isfinite(sensor.moving_mass.value):
        parts.append(f'moving mass {quantity(sensor.moving_mass, 1, "kg")}')
    lines = [f'{"sensor" if sensor.valid else "not usable"}: {", ".join(parts)}']
    if sensor.reason:
        lines.append(f'  {sensor.reason}')
    if sensor.linearity_p_value < LINEARITY_LIMIT:
        lines.append(
            f'  depends on the amplitude: per e-fold {quantity(sensor.frequency_slope, 1, "Hz")} '
            f'and damping ratio {quantity(sensor.damping_slope, 1, "")}; small swings at '
            f'{quantity(sensor.small_amplitude_frequency, 1, "Hz")}'
        )
    return lines


def print_sensor(summary: SensorSummary) -> None:
    """What all blows say of the sensor together."""
    parts = [
        quantity(summary.natural_frequency, 1, 'Hz'),
        f'damping ratio {quantity(summary.damping_ratio, 1, "")}',
    ]
    if math.isfinite(summary.moving_mass.value):
        parts.append(f'moving mass {quantity(summary.moving_mass, 1, "kg")}')
    out.print(f'sensor over {len(summary.event_ids)} blows: {escape(", ".join(parts))}')
    if summary.scatter_p_value < LINEARITY_LIMIT:
        out.print('  the blows differ by more than their uncertainties: not one linear sensor')
    if summary.linearity_p_value < LINEARITY_LIMIT:
        out.print(
            '  it depends on how hard the plate is hit: per e-fold '
            f'{quantity(summary.frequency_slope, 1, "Hz")} and damping ratio '
            f'{quantity(summary.damping_slope, 1, "")}; look for missing physics with explain'
        )


def print_test_point(verdict: ComplianceVerdict) -> None:
    """The verdict of a test point and its first reason."""
    reason = verdict.reasons[0] if verdict.reasons else ''
    out.print(
        f'test point {escape(repr(verdict.test_point.id))}: '
        f'[{STYLE[verdict.verdict]}]{verdict.verdict.name}[/]. {escape(reason)}'
    )


def print_summary(result: AnalysisResult, *, test_points: bool = True) -> None:
    """What a recording or a run comes to as a whole."""
    for verdict in result.test_points if test_points else ():
        print_test_point(verdict)
    if result.sensor is not None:
        print_sensor(result.sensor)
    for note in result.notes:
        out.print(f'note: {escape(note)}')
    out.print(
        f'{escape(result.source)}: {len(result.events)} blow'
        f'{"s" if len(result.events) != 1 else ""} in {result.duration:.2f} s, '
        f'verdict [{STYLE[result.verdict]}]{result.verdict.name}[/]'
    )


def conclude(
    result: AnalysisResult,
    json_file: Path | None,
    report: Path | None,
    *,
    test_points: bool = True,
) -> int:
    """Print the summary, write what was asked for; returns the exit code."""
    print_summary(result, test_points=test_points)
    if json_file is not None:
        from impactscope.report.json_results import to_json

        json_file.write_text(json.dumps(to_json(result), indent=1) + '\n', encoding='utf-8')
        out.print(f'results: [bold]{escape(str(json_file))}[/bold]')
    if report is not None:
        from impactscope.report import write_report

        write_report(result, report)
        out.print(f'report: [bold]{escape(str(report))}[/bold]')
    return UNREADABLE if result.damaged and EXIT[result.verdict] != 1 else EXIT[result.verdict]
