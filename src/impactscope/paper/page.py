"""The page of ``impactscope paper``: what holds, what does not, all figures, the whole table."""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup, escape

from impactscope.paper import published
from impactscope.paper.blow_figures import blow_figures
from impactscope.paper.damper_figures import damper_figures
from impactscope.paper.row import Basis, PaperRow, Standing
from impactscope.paper.sensor_figures import sensor_figures
from impactscope.paper.shock_figures import shock_figures
from impactscope.paper.shock_rows import PEAK_ERROR
from impactscope.physics.sensor_model import PAPER_SENSOR
from impactscope.physics.shock_response import required_sensor, shortest_contact_ratio
from impactscope.report.numbers import format_number
from impactscope.report.page import render_page, write_page
from impactscope.version import __version__

__all__ = ['difference_text', 'render_paper', 'value_text', 'write_paper']

_INDEX = re.compile(r'(?<!\w)([A-Za-zΔζμτω])_([a-z0-9]{1,3})(?![\w])')


@dataclass(frozen=True, slots=True)
class _Line:
    """A row as the template prints it."""

    id: str
    section: str
    quantity: Markup
    unit: str
    paper: str
    computed: str
    difference: str
    standing: str
    remark: Markup


def value_text(item: PaperRow) -> str:
    """The computed value, with a digit or two more than the paper prints."""
    if item.basis is Basis.GIVEN:
        return f'{item.computed:.6g}'
    if item.unit == '1' and item.computed == round(item.computed):
        return f'{item.computed:.0f}'
    digits = len(item.printed.replace('.', '').lstrip('0')) + 1 if item.printed else 4
    return format_number(item.computed, max(4, digits))


def difference_text(item: PaperRow) -> str:
    """The difference to the paper, absolute and relative; empty where nothing is printed."""
    if item.difference is None:
        return ''
    if item.standing is Standing.HOLDS and abs(item.difference) < 1e-9:
        return '0'
    relative = item.relative_difference
    share = f' ({100 * relative:+.2g} %)' if relative is not None else ''
    return f'{item.difference:+.3g}{share}'


def _subscripts(text: str) -> Markup:
    """Escaped text in which ω_n reads as a letter with its index."""
    return Markup(_INDEX.sub(r'\1<sub>\2</sub>', str(escape(text))))  # noqa: S704  # escaped


def _line(item: PaperRow) -> _Line:
    return _Line(
        item.id,
        item.section.replace(' ', '\u00a0'),
        _subscripts(item.quantity),
        '' if item.unit == '1' else item.unit.replace(' ', '\u00a0'),
        item.printed,
        value_text(item),
        difference_text(item),
        item.standing.value,
        _subscripts(item.remark),
    )


def _disagreements(table: Sequence[PaperRow]) -> list[_Line]:
    """Where equations give another value than is printed; rows alike become one."""
    groups: dict[tuple[str, str], list[PaperRow]] = {}
    for item in table:
        if item.standing is Standing.DIFFERS and item.basis is Basis.EQUATION:
            groups.setdefault((item.section, item.remark), []).append(item)
    lines = []
    for group in groups.values():
        line = _line(group[0])
        if len(group) > 1:
            low, high = (f(group, key=lambda item: item.computed) for f in (min, max))
            quantity = group[0].quantity.partition(', d =')[0]
            line = dataclasses.replace(
                line,
                quantity=_subscripts(f'{quantity}, {len(group)} positions'),
                computed=f'{value_text(low)} to {value_text(high)}',
            )
        lines.append(line)
    return lines


def _conclusion() -> list[str]:
    """The design conclusion of the paper, in numbers."""
    fn, k = PAPER_SENSOR.natural_frequency, published.SPRING_STIFFNESS
    trusted = shortest_contact_ratio(published.DAMPING_RATIO, PEAK_ERROR) / fn
    best = required_sensor(0.01, PEAK_ERROR, k)
    zeta = best.sensor.damping_ratio
    damped = shortest_contact_ratio(zeta, PEAK_ERROR) / fn
    lightest = required_sensor(0.01, PEAK_ERROR, k, published.DAMPING_RATIO)
    percent = f'{100 * PEAK_ERROR:.0f} %'
    return [
        f"The paper's sensor (1.67 kg, ζ = 0.0692) reads peaks within {percent} only of contacts "
        f'longer than {1e3 * trusted:.0f} ms.',
        f'With the same plate and ζ = {zeta:.2f} it would from {1e3 * damped:.0f} ms on: damping '
        f'alone gains a factor of {trusted / damped:.0f}.',
        'For contacts from 10 ms on, at 69 N/mm, the plate may weigh '
        f'{best.largest_plate_mass:.2f} kg with ζ = {zeta:.2f}, but only '
        f'{1e3 * lightest.largest_plate_mass:.0f} g if the damping ratio stays at 0.0692: both '
        'are needed, and damping first.',
        'The permitted mass grows in proportion to the spring constant and to the square of the '
        'shortest contact time.',
    ]


def render_paper(parts: dict[str, Sequence[PaperRow]]) -> str:
    """One self-contained HTML page; ``parts`` maps headings to rows, in order."""
    table = [item for part in parts.values() for item in part]
    counts = Counter(item.standing for item in table)
    figures: list[tuple[str, str, list[Markup]]] = [
        ('sensor', 'The sensor: Fig. 6 to 8', sensor_figures()),
        ('contacts', 'Short contacts: Fig. 9 and the better sensor', shock_figures()),
        ('blows', 'Pendulum on the sensor: Fig. 10 and 11', blow_figures()),
        ('damper', 'Damper layer: Fig. 12 and 13', damper_figures()),
    ]
    return render_page(
        'paper.html.j2',
        title='The paper as running physics',
        version=__version__,
        rows_total=len(table),
        holds=counts[Standing.HOLDS],
        differs=counts[Standing.DIFFERS],
        recording=counts[Standing.RECORDING],
        not_printed=counts[Standing.NOT_PRINTED],
        disagreements=_disagreements(table),
        conclusion=[_subscripts(text) for text in _conclusion()],
        figures=figures,
        parts=[
            (f'part-{i}', heading, [_line(item) for item in part])
            for i, (heading, part) in enumerate(parts.items(), 1)
        ],
    )


def write_paper(parts: dict[str, Sequence[PaperRow]], path: Path) -> None:
    """Write :func:`render_paper` to ``path``; the file appears whole or not at all."""
    write_page(render_paper(parts), path)
