"""The command line ``impactscope``.

Exit codes: 0 done, and where something was judged it is PASS or CONDITIONAL_PASS; 1 FAIL or
CONDITIONAL_FAIL; 2 wrong usage or configuration; 3 a recording cannot be read, or not to its
end; 4 INVALID; 5 INCOMPLETE.
"""

import dataclasses
import io
import json
import math
import sys
import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional, Self

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from impactscope.errors import ConfigurationError, ImpactscopeError, RecordingError
from impactscope.records import (
    AnalysisResult,
    ComplianceVerdict,
    ContactKind,
    Estimate,
    EventResult,
    SensorParameters,
    SensorSummary,
    TestPoint,
    Verdict,
)
from impactscope.version import __version__

if TYPE_CHECKING:
    from impactscope.discrepancy.answer import Answer
    from impactscope.recordings import ColumnMapping

__all__ = ['app', 'main']

app = typer.Typer(
    name='impactscope',
    help=(
        'Live impact testing of collaborative robots: record the blow, identify the sensor, '
        'judge against contact limits.\n\n'
        'Start with [bold]impactscope demo[/bold], or analyse a recording: '
        '[bold]impactscope analyse bags/simulated_hand_pass.mcap --report report.html[/bold].\n\n'
        'Exit codes: 0 passed or done, 1 failed, 2 wrong usage, 3 unreadable recording, '
        '4 invalid, 5 incomplete. It measures and judges; it is not a safety function and never '
        'commands a robot.'
    ),
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode='rich',
    pretty_exceptions_enable=False,
)
out = Console(highlight=False)
err = Console(stderr=True, highlight=False)

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
_STYLE = {
    Verdict.PASS: 'bold green',
    Verdict.CONDITIONAL_PASS: 'bold yellow',
    Verdict.CONDITIONAL_FAIL: 'bold dark_orange',
    Verdict.FAIL: 'bold red',
    Verdict.INVALID: 'bold magenta',
    Verdict.INCOMPLETE: 'bold',
}


class Contact(StrEnum):
    """How the body part is held."""

    constrained = 'constrained'
    free = 'free'


ParamsFile = Annotated[
    Optional[Path],
    typer.Option('--params-file', '-p', help='ROS 2 parameter file; the same for all commands.'),
]
Report = Annotated[
    Optional[Path], typer.Option('--report', help='Write a self-contained HTML report.')
]
Json = Annotated[Optional[Path], typer.Option('--json', help='Write the results as JSON.')]
Region = Annotated[
    str, typer.Option('--region', help='Body region, such as hands_fingers, if not recorded.')
]
ContactOption = Annotated[
    Optional[Contact],
    typer.Option('--contact', help='Body part clamped or free, if not recorded.'),
]
Inputs = Annotated[
    Optional[list[str]],
    typer.Option(
        '--input',
        help="Topic of stamped samples, as 'wrench /ft/wrench force.z force'. May be repeated.",
    ),
]


MappingFile = Annotated[
    Optional[Path], typer.Option('--mapping', help='YAML file that maps columns to channels.')
]
Channels = Annotated[
    Optional[list[str]],
    typer.Option(
        '--channel', help="Channel as 'name=column:unit', such as force=1:N. May be repeated."
    ),
]
TimeColumn = Annotated[
    str, typer.Option('--time-column', help="Column of time as 'column:unit', such as 0:s.")
]
SampleRate = Annotated[
    Optional[float],
    typer.Option('--sample-rate', help='Hz, where there is no column of time.', min=0.0),
]
SkipRows = Annotated[
    Optional[int],
    typer.Option('--skip-rows', help='Header rows to skip; found if not given.', min=0),
]
StaticFile = Annotated[
    Path,
    typer.Argument(help='Recording, or a file of columns, with force and displacement.'),
]
ForceChannel = Annotated[str, typer.Option('--force', help='Channel of the force.')]
DisplacementChannel = Annotated[
    str, typer.Option('--displacement', help='Channel of the displacement.')
]
Touch = Annotated[
    float, typer.Option('--touch', help='Displacement at which the force begins, mm.')
]
ForceUncertainty = Annotated[
    float,
    typer.Option('--force-uncertainty', help='Standard, of the calibration, relative.', min=0.0),
]
DisplacementUncertainty = Annotated[
    float,
    typer.Option(
        '--displacement-uncertainty', help='Standard, of the calibration, relative.', min=0.0
    ),
]


def _version(wanted: bool) -> None:
    if wanted:
        out.print(f'impactscope {__version__}')
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option('--version', callback=_version, is_eager=True, help='Say the version.')
    ] = False,
) -> None:
    """Options of every command."""


@app.command()
def analyse(
    recording: Annotated[Path, typer.Argument(help='MCAP or SQLite file, or a bag folder.')],
    json_file: Json = None,
    report: Report = None,
    params_file: ParamsFile = None,
    region: Region = '',
    contact: ContactOption = None,
    inputs: Inputs = None,
) -> None:
    """Analyse a recording without a running graph: blows, sensor, verdict."""
    from impactscope.analysis import AnalysisSettings, load_settings
    from impactscope.analysis import analyse as run

    settings = load_settings(params_file) if params_file else AnalysisSettings()
    if inputs:
        settings = dataclasses.replace(settings, inputs=tuple(inputs))
    with _progress(f'reading {recording.name}') as advance:
        result = run(
            recording,
            settings,
            test_point=_test_point(region, contact),
            keep_samples=report is not None,
            progress=advance,
            on_result=_print_blow,
        )
    raise typer.Exit(_conclude(result, json_file, report))


@app.command()
def replay(
    recording: Annotated[Path, typer.Argument(help='MCAP or SQLite file, or a bag folder.')],
    rate: Annotated[
        float, typer.Option(help='Of time; 0: as fast as the graph takes it.', min=0.0)
    ] = 1.0,
    record_to: Annotated[
        Optional[Path], typer.Option('--record-to', help='Record the whole graph to MCAP.')
    ] = None,
    json_file: Json = None,
    report: Report = None,
    params_file: ParamsFile = None,
    namespace: Annotated[str, typer.Option(help='Of the bench in the graph.')] = 'bench',
    region: Region = '',
    contact: ContactOption = None,
    inputs: Inputs = None,
) -> None:
    """Play a recording through the live ROS 2 graph, with /clock, and judge it."""
    from impactscope.live import replay_recording

    with _progress(f'playing {recording.name}') as advance:
        result = replay_recording(
            recording,
            rate=rate,
            record_to=record_to,
            params_file=params_file,
            namespace=namespace,
            test_point=_test_point(region, contact),
            inputs=tuple(inputs or ()),
            progress=advance,
            on_result=_print_blow,
        )
    raise typer.Exit(_conclude(result, json_file, report))


@app.command()
def live(
    params_file: ParamsFile = None,
    duration: Annotated[
        float, typer.Option(help='End after this many seconds; 0: at Ctrl-C.', min=0.0)
    ] = 0.0,
    record_to: Annotated[
        Optional[Path], typer.Option('--record-to', help='File; default: named by the time.')
    ] = None,
    json_file: Json = None,
    report: Report = None,
    namespace: Annotated[str, typer.Option(help='Of the bench in the graph.')] = 'bench',
    simulated: Annotated[
        str, typer.Option(help='Campaign of the simulated bench instead of devices.')
    ] = '',
) -> None:
    """Run the bench live: drivers, analysis and recorder, until Ctrl-C."""
    from impactscope.live import run_live

    target = record_to or Path(time.strftime('impactscope_%Y%m%d_%H%M%S.mcap'))
    out.print(f'recording to [bold]{escape(str(target))}[/bold]; Ctrl-C ends')
    result = run_live(
        params_file=params_file,
        campaign=simulated,
        duration=duration or math.inf,
        record_to=target,
        namespace=namespace,
        on_result=_print_blow,
        on_test_point=_print_test_point,
    )
    raise typer.Exit(_conclude(result, json_file, report, test_points=False))


@app.command()
def simulate(
    campaign: Annotated[
        str, typer.Argument(help='Name of the campaign; see --list.')
    ] = 'hand_pass',
    output: Annotated[
        Optional[Path], typer.Option('--output', '-o', help='MCAP file to write.')
    ] = None,
    seed: Annotated[int, typer.Option(help='Of the noise.', min=0)] = 1,
    sample_rate: Annotated[
        float, typer.Option(help="Of every channel, Hz; 0: the campaign's own.", min=0.0)
    ] = 0.0,
    list_campaigns: Annotated[bool, typer.Option('--list', help='List the campaigns.')] = False,
) -> None:
    """Simulate a campaign of blows on the paper's bench and write it as a recording."""
    from impactscope.drivers.simulated import describe_campaigns, write_simulation

    if list_campaigns:
        table = Table('campaign', 'what it is')
        for name, text in describe_campaigns().items():
            table.add_row(escape(name), escape(text))
        out.print(table)
        return
    target = output or Path(f'simulated_{campaign}.mcap')
    with _progress(f'simulating {campaign}') as advance:
        write_simulation(campaign, target, seed=seed, sample_rate=sample_rate, progress=advance)
    out.print(f'wrote [bold]{escape(str(target))}[/bold] ({target.stat().st_size / 1e6:.1f} MB)')


@app.command()
def info(
    recording: Annotated[Path, typer.Argument(help='MCAP or SQLite file, or a bag folder.')],
) -> None:
    """Say what a recording holds: topics, channels, span, provenance, damage."""
    from impactscope.inputs import scan_channels
    from impactscope.recordings import Reading, open_recording

    with open_recording(recording, tolerate_damage=True) as opened:
        what = opened.info
        started = time.strftime('%Y-%m-%d %H:%M:%S', time.gmtime(what.start_ns // 10**9))
        out.print(
            f'[bold]{escape(what.path.name)}[/bold]: {what.storage}, {what.size / 1e6:.1f} MB, '
            f'{what.message_count} messages, {what.duration:.3f} s from {started} UTC'
        )
        table = Table('topic', 'type', 'messages', 'read as')
        for topic in what.topics:
            table.add_row(
                escape(topic.name), escape(topic.type), str(topic.count), topic.reading.value
            )
        out.print(table)
        if any(topic.reading is Reading.BLOCKS for topic in what.topics):
            out.print(f'channels: {escape(", ".join(scan_channels(opened)))}')
        for key, value in what.provenance.items():
            out.print(f'{escape(key)}: {escape(value)}')
        for note in what.notes:
            out.print(f'note: {escape(note)}')
        for damage in opened.damage:
            err.print(f'[red]damage:[/red] {escape(str(damage))}')
        if opened.damage:
            raise typer.Exit(UNREADABLE)


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(help='CSV, NumPy or MATLAB file.')],
    destination: Annotated[Optional[Path], typer.Argument(help='MCAP file to write.')] = None,
    mapping: MappingFile = None,
    channel: Channels = None,
    time_column: TimeColumn = '',
    sample_rate: SampleRate = None,
    skip_rows: SkipRows = None,
    transpose: Annotated[bool, typer.Option(help='Channels are rows, not columns.')] = False,
    overwrite: Annotated[bool, typer.Option(help='Replace an existing recording.')] = False,
) -> None:
    """Turn CSV, NumPy or MATLAB data into a recording. Without a destination: describe the file.

    Example: impactscope convert blow.csv blow.mcap --time-column 0:s --channel force=1:N
    """
    from impactscope import recordings

    if destination is None:
        for line in recordings.describe(source, skip_rows=skip_rows, transpose=transpose):
            out.print(escape(line))
        return
    columns = _mapping(mapping, channel, time_column, sample_rate, skip_rows, transpose=transpose)
    if columns is None:
        raise ConfigurationError(
            'name the channels: --channel name=column:unit, or --mapping FILE'
        )
    made = recordings.convert(source, destination, columns, overwrite=overwrite)
    out.print(
        f'wrote [bold]{escape(str(destination))}[/bold]: {escape(", ".join(made.channels))}, '
        f'{made.samples} samples each at {made.sample_rate:g} Hz'
    )
    if made.quality:
        out.print(f'quality flags: {", ".join(str(flag.name) for flag in made.quality)}')


@app.command()
def paper(json_file: Json = None, report: Report = None) -> None:
    """Every number of the paper computed anew beside the printed one; its figures redrawn."""
    from impactscope.paper import main as run

    with _progress('computing the paper') as advance:
        code = run(json_file, report, out, advance)
    raise typer.Exit(code)


@app.command()
def explain(
    campaign: Annotated[Path, typer.Argument(help='Folder with campaign.yaml and recordings.')],
    json_file: Json = None,
    report: Report = None,
    save_model: Annotated[
        Optional[Path],
        typer.Option('--save-model', help='Write campaign.yaml anew, with what was found.'),
    ] = None,
) -> None:
    """Say which physics the simulation leaves out: where it differs, what is missing, how sure.

    The folder holds recordings and a campaign.yaml that says what stands on the bench and which
    mechanisms the simulation has; docs/explain.md describes it. Exit code 0: answered, also
    where nothing is missing.
    """
    from impactscope.campaign_files import explain_folder
    from impactscope.campaign_files import save_model as save

    with _progress(f'explaining {campaign.name}') as advance:
        answer = explain_folder(campaign, advance.describe)
    out.print(f'[bold]{escape(answer.summary())}[/bold]')
    for finding in answer.ranking[:5]:
        mark = 'found' if finding.name in answer.accepted else '     '
        values = ', '.join(
            f'{name} {_value_of(item.value, item.std)} {item.unit}'.rstrip()
            for name, item in finding.parameters.items()
        )
        out.print(
            f'  {mark} {finding.name}: probability {finding.probability:.3f}'
            f'{escape("; " + values) if values else ""}'
        )
    _print_fit(answer)
    for note in answer.notes:
        out.print(f'note: {escape(note)}')
    for test in answer.next_tests:
        out.print(f'measure next: {escape(test)}')
    if json_file is not None:
        text = json.dumps(answer.to_json(), indent=1)
        json_file.write_text(text + '\n', encoding='utf-8')
        out.print(f'answer: [bold]{escape(str(json_file))}[/bold]')
    if report is not None:
        from impactscope.report.explain_report import write_explanation

        write_explanation(answer, report)
        out.print(f'report: [bold]{escape(str(report))}[/bold]')
    if save_model is not None:
        save(campaign, answer, save_model)
        out.print(f'model: [bold]{escape(str(save_model))}[/bold]')


characterise_app = typer.Typer(
    no_args_is_help=True,
    help='Constants of a spring or a damper layer from its test on a compression machine.',
)
app.add_typer(characterise_app, name='characterise')


@characterise_app.command()
def spring(
    file: StaticFile,
    mapping: MappingFile = None,
    channel: Channels = None,
    time_column: TimeColumn = '',
    sample_rate: SampleRate = None,
    skip_rows: SkipRows = None,
    inputs: Inputs = None,
    force_channel: ForceChannel = 'force',
    displacement_channel: DisplacementChannel = 'displacement.crosshead',
    touch: Touch = 0.0,
    force_uncertainty: ForceUncertainty = 0.005,
    displacement_uncertainty: DisplacementUncertainty = 0.005,
    tolerance: Annotated[
        float, typer.Option(help='Of linearity: share of the largest force.', min=0.0)
    ] = 0.01,
    frequency: Annotated[
        Optional[float], typer.Option(help='Natural frequency, Hz, for the moving mass.', min=0.0)
    ] = None,
    frequency_std: Annotated[
        float, typer.Option(help='Its standard uncertainty, Hz.', min=0.0)
    ] = math.nan,
    json_file: Json = None,
    report: Report = None,
) -> None:
    """Stiffness, linearity and hysteresis of a spring from a compression test.

    Example: impactscope characterise spring test.csv --time-column 0:s --channel force=2:N
    --channel displacement.crosshead=1:mm
    """
    from impactscope.characterise import main as run

    code = run(
        'spring',
        file,
        out,
        mapping=_mapping(mapping, channel, time_column, sample_rate, skip_rows),
        inputs=tuple(inputs or ()),
        force=force_channel,
        displacement=displacement_channel,
        touch=1e-3 * touch,
        force_uncertainty=force_uncertainty,
        displacement_uncertainty=displacement_uncertainty,
        tolerance=tolerance,
        frequency=None if frequency is None else Estimate(frequency, frequency_std),
        json_file=json_file,
        report=report,
    )
    raise typer.Exit(code)


@characterise_app.command()
def damper(
    file: StaticFile,
    mapping: MappingFile = None,
    channel: Channels = None,
    time_column: TimeColumn = '',
    sample_rate: SampleRate = None,
    skip_rows: SkipRows = None,
    inputs: Inputs = None,
    force_channel: ForceChannel = 'force',
    displacement_channel: DisplacementChannel = 'displacement.crosshead',
    touch: Touch = 0.0,
    force_uncertainty: ForceUncertainty = 0.005,
    displacement_uncertainty: DisplacementUncertainty = 0.005,
    branches: Annotated[
        int, typer.Option(help='Maxwell branches; 0: as many as the data supports.', min=0, max=6)
    ] = 1,
    json_file: Json = None,
    report: Report = None,
) -> None:
    """Stiffness and damping constants of a damper layer from cyclic ramps.

    Example: impactscope characterise damper test.mcap --input 'wrench /machine/load force.z force'
    --input 'point /machine/crosshead point.z displacement.crosshead'
    """
    from impactscope.characterise import main as run

    code = run(
        'damper',
        file,
        out,
        mapping=_mapping(mapping, channel, time_column, sample_rate, skip_rows),
        inputs=tuple(inputs or ()),
        force=force_channel,
        displacement=displacement_channel,
        touch=1e-3 * touch,
        force_uncertainty=force_uncertainty,
        displacement_uncertainty=displacement_uncertainty,
        branches=branches,
        json_file=json_file,
        report=report,
    )
    raise typer.Exit(code)


@app.command()
def demo(
    output: Annotated[
        Path, typer.Option('--output', '-o', help='Folder for what is made.')
    ] = Path('out'),
) -> None:
    """Run the live graph on a real recording and on a simulated campaign; leave reports."""
    from impactscope.live import demo_steps
    from impactscope.report import write_report

    for step in demo_steps(output):
        out.rule(escape(step.title))
        result = step.run(on_result=_print_blow, on_test_point=_print_test_point)
        _print_summary(result, test_points=False)
        report = output / f'demo_{step.name}.html'
        write_report(result, report)
        out.print(f'report: [bold]{escape(str(report))}[/bold]')


def _mapping(
    file: Path | None,
    channels: list[str] | None,
    time_column: str,
    sample_rate: float | None,
    skip_rows: int | None,
    *,
    transpose: bool = False,
) -> 'ColumnMapping | None':
    """The mapping of a file of columns as given; None where nothing was."""
    from impactscope.recordings import ColumnMapping

    if file is not None:
        return ColumnMapping.from_yaml(file)
    if not channels:
        return None
    column, _, unit = time_column.rpartition(':')
    return ColumnMapping.from_strings(
        channels,
        time=(int(column) if column.isdecimal() else column) if column else None,
        time_unit=unit or 's',
        sample_rate=sample_rate,
        skip_rows=skip_rows,
        transpose=transpose,
    )


def _test_point(region: str, contact: Contact | None) -> TestPoint | None:
    if not region and contact is None:
        return None
    kind = ContactKind.UNKNOWN if contact is None else ContactKind[contact.name.upper()]
    return TestPoint(id='command_line', body_region=region, contact=kind)


def _value_of(value: float | str, std: float) -> str:
    if isinstance(value, str):
        return value
    return f'{value:.4g}' if math.isnan(std) else f'{value:.4g} ± {2 * std:.2g}'


def _print_fit(answer: 'Answer') -> None:
    before, after = answer.fit.baseline, answer.fit.extended
    if not before.rmse:
        return
    table = Table('channel', 'baseline', 'extended', 'held out: baseline', 'extended', 'noise')
    for name in before.rmse:
        cells = (
            before.rmse.get(name, math.nan),
            after.rmse.get(name, math.nan),
            before.held_out_rmse.get(name, math.nan),
            after.held_out_rmse.get(name, math.nan),
            answer.fit.noise_floor.get(name, math.nan),
        )
        table.add_row(escape(name), *('-' if math.isnan(c) else f'{c:.3g}' for c in cells))
    out.print(table)


class _Bar:
    """Progress on stderr, shown only where something takes longer than a moment."""

    def __init__(self, title: str) -> None:
        self._progress = Progress(
            TextColumn('{task.description}'),
            BarColumn(),
            TextColumn('{task.percentage:>3.0f}%'),
            TimeRemainingColumn(),
            console=err,
            transient=True,
            redirect_stdout=err.is_terminal,
        )
        self._task = self._progress.add_task(escape(title), total=1.0)
        self._started = time.monotonic()
        self._running = False

    def __call__(self, share: float) -> None:
        if not self._running and time.monotonic() - self._started > 0.5:
            self._progress.start()
            self._running = True
        self._progress.update(self._task, completed=share)

    def describe(self, share: float, text: str) -> None:
        """Progress with a word on what is being done."""
        self._progress.update(self._task, description=escape(text))
        self(share)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._running:
            self._progress.stop()


def _progress(title: str) -> '_Bar':
    return _Bar(title)


def _quantity(estimate: Estimate, scale: float, unit: str) -> str:
    """Value ± expanded uncertainty (k = 2), both to its second digit (JCGM 100)."""
    value, uncertainty = estimate.value * scale, 2 * estimate.std * scale
    if math.isnan(value):
        return '-'
    if not (math.isfinite(uncertainty) and uncertainty > 0):
        return f'{value:.4g} {unit}'.rstrip()
    decimals = min(max(1 - math.floor(math.log10(uncertainty)), 0), 12)
    return f'{value:.{decimals}f} ± {uncertainty:.{decimals}f} {unit}'.rstrip()


def _print_blow(result: EventResult) -> None:
    event, verdict = result.event, result.verdict
    clock = time.strftime('%H:%M:%S', time.gmtime(event.stamp_ns // 10**9))
    contacts = f'{len(event.contacts)} contact{"s" if len(event.contacts) != 1 else ""}'
    reason = verdict.reasons[0] if verdict.reasons else ''
    out.print(
        f'blow {event.event_id} at {clock}.{event.stamp_ns // 10**6 % 1000:03d}: '
        f'{contacts}, peak {_quantity(result.impact.peak_force, 1, "N")}, '
        f'[{_STYLE[verdict.verdict]}]{verdict.verdict.name}[/]. {escape(reason)}'
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
        f'{name} {_quantity(value, scale, unit)}'
        for name, value, scale, unit in told
        if math.isfinite(value.value)
    ]
    return [f'impactor: {", ".join(parts)}'] if parts else []


def _sensor_lines(sensor: SensorParameters) -> list[str]:
    """What the blow tells of the sensor, and why it is no more."""
    if sensor.modes:
        lines = [f'{sensor.channel}: {sensor.reason} (R² {sensor.r_squared:.3f})']
        return lines + [
            f'  {_quantity(mode.natural_frequency, 1, "Hz")}, '
            f'damping ratio {_quantity(mode.damping_ratio, 1, "")}'
            for mode in sensor.modes
        ]
    if not sensor.valid and math.isnan(sensor.linearity_p_value):
        return [f'sensor: cannot be estimated: {sensor.reason}'] if sensor.reason else []
    parts = [
        _quantity(sensor.natural_frequency, 1, 'Hz'),
        f'damping ratio {_quantity(sensor.damping_ratio, 1, "")}',
    ]
    if math.isfinite(sensor.moving_mass.value):
        parts.append(f'moving mass {_quantity(sensor.moving_mass, 1, "kg")}')
    lines = [f'{"sensor" if sensor.valid else "not usable"}: {", ".join(parts)}']
    if sensor.reason:
        lines.append(f'  {sensor.reason}')
    if sensor.linearity_p_value < LINEARITY_LIMIT:
        lines.append(
            f'  depends on the amplitude: per e-fold {_quantity(sensor.frequency_slope, 1, "Hz")} '
            f'and damping ratio {_quantity(sensor.damping_slope, 1, "")}; small swings at '
            f'{_quantity(sensor.small_amplitude_frequency, 1, "Hz")}'
        )
    return lines


def _print_sensor(summary: SensorSummary) -> None:
    """What all blows say of the sensor together."""
    parts = [
        _quantity(summary.natural_frequency, 1, 'Hz'),
        f'damping ratio {_quantity(summary.damping_ratio, 1, "")}',
    ]
    if math.isfinite(summary.moving_mass.value):
        parts.append(f'moving mass {_quantity(summary.moving_mass, 1, "kg")}')
    out.print(f'sensor over {len(summary.event_ids)} blows: {escape(", ".join(parts))}')
    if summary.scatter_p_value < LINEARITY_LIMIT:
        out.print('  the blows differ by more than their uncertainties: not one linear sensor')
    if summary.linearity_p_value < LINEARITY_LIMIT:
        out.print(
            '  it depends on how hard the plate is hit: per e-fold '
            f'{_quantity(summary.frequency_slope, 1, "Hz")} and damping ratio '
            f'{_quantity(summary.damping_slope, 1, "")}; look for missing physics with explain'
        )


def _print_test_point(verdict: ComplianceVerdict) -> None:
    reason = verdict.reasons[0] if verdict.reasons else ''
    out.print(
        f'test point {escape(repr(verdict.test_point.id))}: '
        f'[{_STYLE[verdict.verdict]}]{verdict.verdict.name}[/]. {escape(reason)}'
    )


def _print_summary(result: AnalysisResult, *, test_points: bool = True) -> None:
    for verdict in result.test_points if test_points else ():
        _print_test_point(verdict)
    if result.sensor is not None:
        _print_sensor(result.sensor)
    for note in result.notes:
        out.print(f'note: {escape(note)}')
    out.print(
        f'{escape(result.source)}: {len(result.events)} blow'
        f'{"s" if len(result.events) != 1 else ""} in {result.duration:.2f} s, '
        f'verdict [{_STYLE[result.verdict]}]{result.verdict.name}[/]'
    )


def _conclude(
    result: AnalysisResult,
    json_file: Path | None,
    report: Path | None,
    *,
    test_points: bool = True,
) -> int:
    _print_summary(result, test_points=test_points)
    if json_file is not None:
        from impactscope.report.json_results import to_json

        json_file.write_text(json.dumps(to_json(result), indent=1) + '\n', encoding='utf-8')
        out.print(f'results: [bold]{escape(str(json_file))}[/bold]')
    if report is not None:
        from impactscope.report import write_report

        write_report(result, report)
        out.print(f'report: [bold]{escape(str(report))}[/bold]')
    return UNREADABLE if result.damaged and EXIT[result.verdict] != 1 else EXIT[result.verdict]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # who reads a pipe sees each blow at once
    try:
        code = app(arguments, standalone_mode=False)
    except typer.Exit as stop:
        return int(stop.exit_code)
    except (typer.Abort, KeyboardInterrupt):
        err.print('interrupted')
        return 130
    except ConfigurationError as error:
        return _fail(error, 2)
    except RecordingError as error:
        return _fail(error, UNREADABLE)
    except ImpactscopeError as error:
        return _fail(error, 2)
    except Exception as error:
        usage = getattr(error, 'format_message', None)  # click's own errors of usage
        if usage is None:
            raise
        error.show()  # type: ignore[attr-defined]
        return int(getattr(error, 'exit_code', 2))
    return code if isinstance(code, int) else 0


def _fail(error: Exception, code: int) -> int:
    err.print(f'[red]impactscope:[/red] {escape(str(error))}')
    return code


if __name__ == '__main__':
    sys.exit(main())
