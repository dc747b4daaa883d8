"""What ``impactscope paper`` does: compute the table, print it, write JSON and page."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from impactscope.errors import ConfigurationError
from impactscope.paper.page import difference_text, value_text, write_paper
from impactscope.paper.row import PaperRow, Standing
from impactscope.paper.table import PARTS
from impactscope.version import __version__

__all__ = ['main', 'to_json']

_DIFFERENCE = 12  # columns of the longest part of a difference
_WIDE = 130  # columns of a terminal from which on the remarks fit beside the numbers
_STYLE = {
    Standing.HOLDS: 'green',
    Standing.DIFFERS: 'bold red',
    Standing.RECORDING: '',
    Standing.NOT_PRINTED: '',
}


def to_json(table: list[PaperRow]) -> dict[str, Any]:
    """The table as plain JSON values."""
    return {
        'schema_version': 1,
        'software_version': __version__,
        'paper': 'doi:10.3390/machines12010026',
        'rows': [item.to_json() for item in table],
    }


def main(
    json_file: Path | None,
    report: Path | None,
    console: Console,
    progress: Callable[[float], None] | None = None,
) -> int:
    """Print the table on ``console``; write the JSON and the page where asked for.

    Returns the exit code 0. Raises ConfigurationError where a file cannot be written.
    """
    parts: dict[str, list[PaperRow]] = {}
    for done, (heading, compute) in enumerate(PARTS.items(), 1):
        parts[heading] = compute()
        if progress is not None:
            progress(done / (len(PARTS) + (report is not None)))
    table = [item for part in parts.values() for item in part]
    wide = console.width >= _WIDE
    for heading, part in parts.items():
        console.print(_printed(heading, part, remarks=wide))
    if not wide:
        console.print(f'remarks: on a terminal of {_WIDE} columns, in the JSON and on the page')
    counts = Counter(item.standing for item in table)
    console.print(
        f'{len(table)} rows: {counts[Standing.HOLDS]} hold, {counts[Standing.DIFFERS]} differ, '
        f'{counts[Standing.RECORDING]} depend on recordings that are not public, '
        f'{counts[Standing.NOT_PRINTED]} are not printed in the paper'
    )
    try:
        if json_file is not None:
            text = json.dumps(to_json(table), indent=1, ensure_ascii=False) + '\n'
            json_file.write_text(text, encoding='utf-8')
            console.print(f'table: [bold]{escape(str(json_file))}[/bold]')
        if report is not None:
            write_paper(dict(parts), report)
            console.print(f'page: [bold]{escape(str(report))}[/bold]')
    except OSError as error:
        raise ConfigurationError(
            f'{error.filename} cannot be written: {error.strerror}'
        ) from error
    return 0


def _printed(heading: str, part: list[PaperRow], *, remarks: bool) -> Table:
    table = Table(title=escape(heading), title_justify='left', title_style='bold', expand=False)
    table.add_column('where', no_wrap=True)
    table.add_column('quantity', min_width=16, ratio=3)
    table.add_column('unit', no_wrap=True)
    for name in ('paper', 'computed'):
        table.add_column(name, justify='right', no_wrap=True)
    # In a narrow table the share in percent goes below the difference.
    table.add_column('difference', justify='right', no_wrap=remarks, min_width=_DIFFERENCE)
    if remarks:
        table.add_column('remark', min_width=20, ratio=4)
    for item in part:
        style = _STYLE[item.standing]
        difference = difference_text(item).replace(' %', '%')
        cells = [
            escape(item.section),
            escape(item.quantity),
            '' if item.unit == '1' else escape(item.unit),
            item.printed,
            value_text(item),
            f'[{style}]{difference}[/]' if style and difference else difference,
        ]
        table.add_row(*cells, *([escape(item.remark)] if remarks else []))
    return table
