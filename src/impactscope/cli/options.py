"""Options that several commands have, and what they stand for."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from impactscope.errors import ConfigurationError
from impactscope.records import ContactKind, TestPoint

if TYPE_CHECKING:
    from impactscope.recordings import ColumnMapping


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
    Optional[Path],
    typer.Option(
        '--mapping',
        help='YAML file in place of --channel, --time-column and the like; it may scale channels '
        '(-1 turns the sign). Example: docs/convert.md.',
    ),
]
Channels = Annotated[
    Optional[list[str]],
    typer.Option(
        '--channel', help="Channel as 'name=column:unit', such as force=1:N. May be repeated."
    ),
]
TimeColumn = Annotated[
    str,
    typer.Option(
        '--time-column',
        help="Column of time as 'column:unit', such as 0:s; dates and times need no unit.",
    ),
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


def column_mapping(
    file: Path | None,
    channels: list[str] | None,
    time_column: str,
    sample_rate: float | None,
    skip_rows: int | None,
    *,
    transpose: bool = False,
) -> 'ColumnMapping | None':
    """The mapping of a file of columns as given; None where nothing was.

    Raises ConfigurationError where a mapping file and options say the same kind of thing twice.
    """
    from impactscope.recordings import ColumnMapping, time_and_unit

    if file is not None:
        given = {
            '--channel': bool(channels),
            '--time-column': bool(time_column),
            '--sample-rate': sample_rate is not None,
            '--skip-rows': skip_rows is not None,
            '--transpose': transpose,
        }
        twice = [option for option, told in given.items() if told]
        if twice:
            raise ConfigurationError(
                f'{", ".join(twice)} beside --mapping: write it into {file.name!r}, which says '
                'all of the columns, or leave the mapping out'
            )
        return ColumnMapping.from_yaml(file)
    if not channels:
        return None
    time, time_unit = time_and_unit(time_column)
    return ColumnMapping.from_strings(
        channels,
        time=time,
        time_unit=time_unit,
        sample_rate=sample_rate,
        skip_rows=skip_rows,
        transpose=transpose,
    )


def named_test_point(region: str, contact: Contact | None) -> TestPoint | None:
    """What was given of a test point; None where nothing was."""
    if not region and contact is None:
        return None
    kind = ContactKind.UNKNOWN if contact is None else ContactKind[contact.name.upper()]
    return TestPoint(id='command_line', body_region=region, contact=kind)
