"""Commands that record and judge blows: analyse, replay, live."""

import dataclasses
import math
import time
from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.markup import escape

from impactscope.cli.console import Bar, out
from impactscope.cli.options import (
    ContactOption,
    Inputs,
    Json,
    ParamsFile,
    Region,
    Report,
    named_test_point,
)
from impactscope.cli.printing import conclude, print_blow, print_test_point

__all__ = ['analyse', 'live', 'replay']


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
    with Bar(f'reading {recording.name}') as advance:
        result = run(
            recording,
            settings,
            test_point=named_test_point(region, contact),
            keep_samples=report is not None,
            progress=advance,
            on_result=print_blow,
        )
    raise typer.Exit(conclude(result, json_file, report))


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

    with Bar(f'playing {recording.name}') as advance:
        result = replay_recording(
            recording,
            rate=rate,
            record_to=record_to,
            params_file=params_file,
            namespace=namespace,
            test_point=named_test_point(region, contact),
            inputs=tuple(inputs or ()),
            progress=advance,
            on_result=print_blow,
        )
    raise typer.Exit(conclude(result, json_file, report))


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
        on_result=print_blow,
        on_test_point=print_test_point,
    )
    raise typer.Exit(conclude(result, json_file, report, test_points=False))
