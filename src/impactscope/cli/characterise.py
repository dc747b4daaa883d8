"""``impactscope characterise``: constants from tests on a compression machine."""

import math
from typing import Annotated, Optional

import typer

from impactscope.cli.console import out
from impactscope.cli.options import (
    Channels,
    DisplacementChannel,
    DisplacementUncertainty,
    ForceChannel,
    ForceUncertainty,
    Inputs,
    Json,
    MappingFile,
    Report,
    SampleRate,
    SkipRows,
    StaticFile,
    TimeColumn,
    Touch,
    column_mapping,
)
from impactscope.records import Estimate

__all__ = ['characterise']

characterise = typer.Typer(
    no_args_is_help=True,
    help='Constants of a spring or a damper layer from its test on a compression machine.',
)


@characterise.command()
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
        mapping=column_mapping(mapping, channel, time_column, sample_rate, skip_rows),
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


@characterise.command()
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
        mapping=column_mapping(mapping, channel, time_column, sample_rate, skip_rows),
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
