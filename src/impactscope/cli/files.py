"""Commands about files: simulate, conceal, info, convert, paper."""

import dataclasses
import time
from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.markup import escape
from rich.table import Table

from impactscope.cli.console import Bar, err, out
from impactscope.cli.options import (
    Channels,
    Json,
    MappingFile,
    Report,
    SampleRate,
    SkipRows,
    TimeColumn,
    column_mapping,
)
from impactscope.cli.printing import UNREADABLE
from impactscope.errors import ConfigurationError

__all__ = ['conceal', 'convert', 'info', 'paper', 'simulate']


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
    with Bar(f'simulating {campaign}') as advance:
        write_simulation(campaign, target, seed=seed, sample_rate=sample_rate, progress=advance)
    out.print(f'wrote [bold]{escape(str(target))}[/bold] ({target.stat().st_size / 1e6:.1f} MB)')


def conceal(
    effects: Annotated[
        Optional[list[str]],
        typer.Argument(
            metavar='[EFFECT]...',
            help='name:parameter=value,... or name@channel:parameter=value,...; without any, '
            'or with the word none, nothing is hidden.',
        ),
    ] = None,
    output: Annotated[Path, typer.Option('--output', '-o', help='Folder of the campaign.')] = Path(
        'concealed'
    ),
    bare: Annotated[bool, typer.Option('--bare', help='Without the damper layer.')] = False,
    seed: Annotated[int, typer.Option(help='Of noise and releases.', min=0)] = 1,
    blows: Annotated[int, typer.Option(help='Pendulum blows, beside two taps.')] = 6,
    sample_rate: Annotated[float, typer.Option(help='Of every channel, Hz.')] = 5000.0,
    duration: Annotated[float, typer.Option(help='Of every recording, s.')] = 1.0,
    list_effects: Annotated[bool, typer.Option('--list', help='List the effects.')] = False,
) -> None:
    """Simulate a campaign with effects that its campaign.yaml does not tell, for explain to find.

    Example: impactscope conceal coulomb_friction:force=0.5 -o practice
    """
    from impactscope.drivers.simulated_campaign import (
        describe_effects,
        parse_effect,
        write_campaign,
    )

    if list_effects:
        table = Table('effect', 'parameters, unit (default)', 'what it is', 'law')
        table.columns[0].no_wrap = True
        for column in table.columns[1:]:
            column.overflow = 'fold'  # no formula is cut off
        for row in describe_effects():
            table.add_row(*map(escape, row))
        out.print(table)
        return
    hidden = [parse_effect(text) for text in effects or () if text != 'none']
    with Bar('simulating the blows') as advance:
        write_campaign(
            output,
            hidden,
            layered=not bare,
            seed=seed,
            blows=blows,
            sample_rate=sample_rate,
            duration=duration,
            progress=advance,
        )
    out.print(
        f'wrote [bold]{escape(str(output))}[/bold]; next: impactscope explain '
        f'{escape(str(output))} --report why.html'
    )


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


def convert(
    source: Annotated[Path, typer.Argument(help='CSV, NumPy or MATLAB file.')],
    destination: Annotated[Optional[Path], typer.Argument(help='MCAP file to write.')] = None,
    mapping: MappingFile = None,
    channel: Channels = None,
    time_column: TimeColumn = '',
    sample_rate: SampleRate = None,
    skip_rows: SkipRows = None,
    transpose: Annotated[bool, typer.Option(help='Channels are rows, not columns.')] = False,
    resample: Annotated[
        bool, typer.Option('--resample', help='Times are uneven: to an even grid.')
    ] = False,
    overwrite: Annotated[bool, typer.Option(help='Replace an existing recording.')] = False,
) -> None:
    """Turn CSV, NumPy or MATLAB data into a recording. Without a destination: describe the file.

    Example: impactscope convert blow.csv blow.mcap --time-column 0:s --channel force=1:N

    A sign is turned by `scale: -1` of a channel in a mapping file (--mapping; docs/convert.md).
    """
    from impactscope import recordings

    if destination is None:
        for line in recordings.describe(source, skip_rows=skip_rows, transpose=transpose):
            out.print(escape(line))
        return
    columns = column_mapping(
        mapping, channel, time_column, sample_rate, skip_rows, transpose=transpose
    )
    if columns is None:
        raise ConfigurationError(
            'name the channels: --channel name=column:unit, or --mapping FILE'
        )
    if resample:
        columns = dataclasses.replace(columns, resample=True)
    made = recordings.convert(source, destination, columns, overwrite=overwrite)
    written: dict[tuple[int, float], list[str]] = {}
    for name, count, rate in zip(made.channels, made.counts, made.rates, strict=True):
        written.setdefault((count, rate), []).append(name)
    told = '; '.join(
        f'{escape(", ".join(names))}, {count} samples each at {rate:g} Hz'
        for (count, rate), names in written.items()
    )
    out.print(f'wrote [bold]{escape(str(destination))}[/bold]: {told}')
    if made.quality:
        out.print(f'quality flags: {", ".join(str(flag.name) for flag in made.quality)}')
    for note in made.notes:
        out.print(f'note: {escape(note)}')


def paper(json_file: Json = None, report: Report = None) -> None:
    """Every number of the paper computed anew beside the printed one; its figures redrawn."""
    from impactscope.paper import main as run

    with Bar('computing the paper') as advance:
        code = run(json_file, report, out, advance)
    raise typer.Exit(code)
