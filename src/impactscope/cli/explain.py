"""``impactscope explain``: which physics a simulation leaves out."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from impactscope.cli.console import Bar, out
from impactscope.cli.options import Json
from impactscope.discrepancy.time_limit import WITHIN_S
from impactscope.report.numbers import NOT_KNOWN, readable_estimate

if TYPE_CHECKING:
    from impactscope.discrepancy.answer import Answer
    from impactscope.discrepancy.campaign import Campaign

__all__ = ['explain', 'print_answer', 'print_campaign']

_RULED_OUT = 5e-4  # probability, less than which reads 0.000


def explain(
    campaign: Annotated[Path, typer.Argument(help='Folder with campaign.yaml and recordings.')],
    json_file: Json = None,
    report: Annotated[
        Optional[Path],
        typer.Option('--report', '--html', help='Write a self-contained HTML report.'),
    ] = None,
    save_model: Annotated[
        Optional[Path],
        typer.Option('--save-model', help='Write campaign.yaml anew, with what was found.'),
    ] = None,
    within: Annotated[
        float,
        typer.Option(
            '--within',
            min=1.0,
            help='Seconds to answer in; what is left out for that is told. "inf": no limit.',
        ),
    ] = WITHIN_S,
    check: Annotated[
        bool,
        typer.Option('--check', help='Read the campaign, say what is in it, and end.'),
    ] = False,
) -> None:
    """Say which physics the simulation leaves out: where it differs, what is missing, how sure.

    The folder holds recordings and a campaign.yaml that says what stands on the bench and which
    mechanisms the simulation has; docs/explain.md describes it. Exit code 0: answered, also
    where nothing is missing.
    """
    from impactscope.campaign_files import explain_folder, load_campaign
    from impactscope.campaign_files import save_model as save

    if check:
        from impactscope.discrepancy.explain import check_baseline

        read = load_campaign(campaign)
        check_baseline(read)
        print_campaign(read)
        return
    with Bar(f'explaining {campaign.name}') as advance:
        answer = explain_folder(campaign, advance.describe, within_s=within)
    print_answer(answer)
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


def print_campaign(campaign: 'Campaign') -> None:
    """What a campaign holds, as it was read: nothing is fitted or judged."""
    out.print(
        f'[bold]{escape(campaign.name)}[/bold]: {campaign.kind.value}, the simulation has '
        f'{escape(", ".join(campaign.baseline_names) or "nothing that is named")}'
    )
    for recording in campaign.recordings:
        kind = f', {recording.kind}' if recording.kind else ''
        out.print(f'{escape(recording.file)} ({recording.role.value}{escape(kind)})')
        cut = math.isfinite(recording.start) or math.isfinite(recording.end)
        for channel in recording.channels.values():
            inside = recording.inside(channel.time)
            values = channel.values[inside]
            part = ''
            if cut and values.size:
                begin, end = np.round(channel.time[inside][[0, -1]], 9) + 0.0
                part = f', the part from {begin:.4g} to {end:.4g} s'
            lost = int(np.isnan(values).sum())
            clipped = int(((values <= channel.range_min) | (values >= channel.range_max)).sum())
            ends = 'no number'
            if lost < values.size:
                ends = f'{np.nanmin(values) + 0.0:.4g} to {np.nanmax(values) + 0.0:.4g}'
            out.print(
                f'  {escape(channel.name)}: {ends} {escape(channel.unit)}, '
                f'{values.size / channel.sample_rate:.4g} s at {channel.sample_rate:.6g} Hz{part}'
                + (f', [bold]{lost} samples lost[/bold]' if lost else '')
                + (f', [bold]{clipped} clipped[/bold]' if clipped else '')
                + ('' if campaign.uses(channel.name) else ', not used')
            )
    for note in campaign.notes:
        out.print(f'note: {escape(note)}')


def print_answer(answer: 'Answer') -> None:
    """The short answer: what is missing, how sure, what it changes, what to measure next.

    Numbers with their expanded uncertainty, k = 2.
    """
    out.print(f'[bold]{escape(answer.summary())}[/bold]')
    ruled_out: list[str] = []
    for finding in answer.ranking[:5]:
        place = f' of {finding.channel}' if finding.channel else ''
        if finding.name not in answer.accepted and finding.probability < _RULED_OUT:
            ruled_out.append(finding.name + place)
            continue
        mark = 'found' if finding.name in answer.accepted else 'tried'
        values = ', '.join(
            f'{name} {_value_of(item.value, item.std, item.unit)}'
            for name, item in finding.parameters.items()
        )
        out.print(
            f'  {mark} {escape(finding.name + place)}: probability {finding.probability:.3f}'
            f'{escape("; " + values) if values else ""}'
        )
        if finding.confused_with and mark == 'found':
            out.print(f'        cannot be told from: {escape(", ".join(finding.confused_with))}')
    if ruled_out:
        out.print(f'  ruled out: {escape(", ".join(dict.fromkeys(ruled_out)))}')
    _print_fit(answer)
    for note in answer.notes:
        out.print(f'note: {escape(note)}')
    for test in answer.next_tests:
        out.print(f'measure next: {escape(test)}')


def _value_of(value: float | str, std: float, unit: str) -> str:
    if isinstance(value, str):
        return value
    text, uncertainty, name = readable_estimate(value, std, unit)
    sure = '' if uncertainty in ('', NOT_KNOWN, '0') else f' ± {uncertainty}'
    return f'{text}{sure} {name}'.rstrip()


def _print_fit(answer: 'Answer') -> None:
    before, after = answer.fit.baseline, answer.fit.extended
    if not before.rmse:
        return
    table = Table()
    table.add_column('channel', no_wrap=True, min_width=max(map(len, before.rmse)))
    for name in ('baseline', 'extended', 'held out: baseline', 'extended', 'noise'):
        table.add_column(name, justify='right')
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
