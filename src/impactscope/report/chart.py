"""Charts with free axes: curves in any order, logarithmic axes, coloured maps, several panels.

The figures of :mod:`impactscope.report.figure` are time series that can be enlarged; what the
paper draws over frequency or displacement, and maps, are drawn here. Every text is escaped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike, NDArray

from impactscope.report.axis import nice_range, nice_ticks
from impactscope.report.numbers import format_given
from impactscope.report.plain_text import printable

__all__ = ['Axis', 'Cells', 'Line', 'Mark', 'Panel', 'Points', 'draw_chart']

Array = NDArray[np.float64]

WIDTH, LEFT, RIGHT, TOP, BOTTOM, GAP = 1000, 62, 14, 26, 46, 14
COLOURS = {
    'main': '#14508c',
    'pale': '#7ea6d3',
    'second': '#c2410c',
    'third': '#0f6a73',
    'grey': '#4b5563',
    'published': '#b3171f',
}
DASHES = {'pale': '', 'second': '7 4', 'published': '3 3', 'third': '9 3 2 3'}
_MOST_POINTS = 3000  # of a curve


@dataclass(frozen=True, slots=True)
class Line:
    """A curve through points of shape (n,), in their order; ``style`` names its colour."""

    name: str
    x: ArrayLike
    y: ArrayLike
    style: str = 'main'


@dataclass(frozen=True, slots=True)
class Points:
    """Single points of shape (n,); ``shape`` is circle, square, diamond or cross."""

    name: str
    x: ArrayLike
    y: ArrayLike
    style: str = 'main'
    shape: str = 'circle'


@dataclass(frozen=True, slots=True)
class Mark:
    """A line across the panel at a value of the x or y axis, with its name beside it."""

    axis: str  # x or y
    value: float
    name: str
    style: str = 'published'
    at_start: bool = False  # the name stands at the axis' beginning, for a y value


@dataclass(frozen=True, slots=True)
class Cells:
    """A coloured map: edges (n_x + 1,) and (n_y + 1,), colours (n_y, n_x) as #rrggbb."""

    x_edges: Array
    y_edges: Array
    colours: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Axis:
    """Name with unit, range (None: what the data needs), and whether it is logarithmic."""

    name: str
    range: tuple[float, float] | None = None
    logarithmic: bool = False


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes with what it shows."""

    x: Axis
    y: Axis
    lines: tuple[Line, ...] = ()
    points: tuple[Points, ...] = ()
    marks: tuple[Mark, ...] = ()
    cells: Cells | None = None
    title: str = ''
    texts: tuple[tuple[float, float, str], ...] = ()  # x, y, words


def _extent(values: list[Array], logarithmic: bool) -> tuple[float, float]:
    """A range that shows all values that the axis can show; never empty."""
    joined = np.concatenate([*values, np.zeros(0)])
    shown = joined[np.isfinite(joined) & ((joined > 0) | (not logarithmic))]
    if logarithmic:
        low, high = (float(shown.min()), float(shown.max())) if shown.size else (1.0, 10.0)
        return low / 1.1, high * 1.1
    return nice_range(float(shown.min()), float(shown.max())) if shown.size else (0.0, 1.0)


class _Scale:
    """From values of one axis to pixels."""

    def __init__(self, axis: Axis, values: list[Array], start: float, end: float) -> None:
        if axis.range is not None:
            low, high = axis.range
        else:
            low, high = _extent(values, axis.logarithmic)
        self.low, self.high, self.logarithmic = low, high, axis.logarithmic
        self._a, self._b = self._value(low), self._value(high)
        self._start, self._end = start, end

    def _value(self, value: float) -> float:
        return math.log10(max(value, 1e-300)) if self.logarithmic else value

    def at(self, values: ArrayLike) -> Array:
        v = np.asarray(values, np.float64)
        if self.logarithmic:
            v = np.log10(np.maximum(v, 1e-300))
        share = np.clip((v - self._a) / (self._b - self._a), -0.5, 1.5)
        return np.asarray(self._start + share * (self._end - self._start))

    def ticks(self, count: int) -> list[tuple[float, str]]:
        if not self.logarithmic:
            ticks, decimals = nice_ticks(self.low, self.high, count)
            return [(t, f'{t:.{decimals}f}') for t in ticks]
        first, last = math.floor(self._a - 1e-9), math.ceil(self._b + 1e-9)
        steps = (1, 2, 5) if self._b - self._a < 3.2 else (1,)
        ticks = [m * 10.0**e for e in range(first, last + 1) for m in steps]
        inside = (t for t in ticks if self.low * (1 - 1e-9) <= t <= self.high * (1 + 1e-9))
        return [(t, format_given(t)) for t in inside]


def draw_chart(
    title: str,
    description: str,
    panels: tuple[Panel, ...],
    *,
    columns: int = 1,
    height: int = 300,
    caption: tuple[str, ...] = (),
) -> Markup:
    """Panels side by side as an HTML ``figure``; ``height`` is that of one panel's plot.

    Titles must differ within a page: the drawing's inner names come from them.
    """
    total_rows = -(-len(panels) // columns)
    pitch_x = WIDTH / columns
    head = TOP if any(panel.title for panel in panels) else GAP
    slug = '-'.join(''.join(c if c.isalnum() else ' ' for c in title.lower()).split())
    pitch_y = head + height + BOTTOM + GAP
    parts = [
        _panel(
            panel,
            f'clip-{slug}-{i}',
            (i % columns) * pitch_x + LEFT,
            (i // columns) * pitch_y + head,
            pitch_x - LEFT - RIGHT,
            height,
        )
        for i, panel in enumerate(panels)
    ]
    svg = Markup(
        '<svg viewBox="0 0 {} {}" width="100%" font-size="12" role="img" aria-label="{}">{}</svg>'
    ).format(
        WIDTH,
        total_rows * pitch_y - GAP,
        printable(f'{title}. {description}'),
        Markup('').join(parts),
    )
    words = Markup(' ').join(Markup('<span>{}</span>').format(s) for s in caption)
    return Markup('<figure><h4>{}</h4>{}{}<figcaption>{}</figcaption></figure>').format(
        title, _legend(panels), svg, words
    )


def _panel(
    panel: Panel, clip: str, left: float, top: float, width: float, height: float
) -> Markup:
    shown: list[Line | Points] = [*panel.lines, *panel.points]
    xs = [np.atleast_1d(np.asarray(item.x, np.float64)) for item in shown]
    ys = [np.atleast_1d(np.asarray(item.y, np.float64)) for item in shown]
    ys += [np.array([mark.value]) for mark in panel.marks if mark.axis == 'y']
    x = _Scale(panel.x, xs, left, left + width)
    y = _Scale(panel.y, ys, top + height, top)
    inside = Markup('').join(
        [
            _cells(panel.cells, x, y),
            *(_line(line, x, y) for line in panel.lines),
            *(_mark_line(mark, x, y, left, top, width, height) for mark in panel.marks),
        ]
    )
    frame = Markup(
        '<clipPath id="{}"><rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/></clipPath>'
        '{}<g clip-path="url(#{})">{}</g>{}'
        '<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}" fill="none" stroke="#8b96a3"/>'
    ).format(
        clip, left, top, width, height, _axes(panel, x, y, left, top, width, height), clip, inside,
        Markup('').join(_points(item, x, y) for item in panel.points), left, top, width, height,
    )  # fmt: skip
    labels = [_mark_label(m, x, y, left, top, width, height) for m in panel.marks]
    labels += [
        _text(float(x.at(a)), float(y.at(b)), words, 'middle') for a, b, words in panel.texts
    ]
    if panel.title:
        labels.append(
            Markup('<text x="{:.1f}" y="{:.1f}" font-weight="600">{}</text>').format(
                left, top - 9, panel.title
            )
        )
    return frame + Markup('').join(labels)


def _axes(
    panel: Panel, x: _Scale, y: _Scale, left: float, top: float, width: float, height: float
) -> Markup:
    parts = []
    for value, text in x.ticks(max(4, int(width / 75))):
        at = float(x.at(value))
        parts.append(
            Markup('<path class="grid" d="M{:.1f} {:.1f}v{:.1f}"/>').format(at, top, height)
        )
        parts.append(_text(at, top + height + 16, text, 'middle'))
    for value, text in y.ticks(max(4, int(height / 45))):
        at = float(y.at(value))
        zero = ' zero' if value == 0 else ''
        parts.append(
            Markup('<path class="grid{}" d="M{:.1f} {:.1f}h{:.1f}"/>').format(
                zero, left, at, width
            )
        )
        parts.append(_text(left - 6, at + 4, text, 'end'))
    parts.append(_text(left + width / 2, top + height + 36, panel.x.name, 'middle'))
    parts.append(
        Markup(
            '<text transform="translate({:.1f} {:.1f}) rotate(-90)" text-anchor="middle">{}</text>'
        ).format(left - 46, top + height / 2, panel.y.name)
    )
    return Markup('').join(parts)


def _text(x: float, y: float, words: str, anchor: str) -> Markup:
    return Markup('<text x="{:.1f}" y="{:.1f}" text-anchor="{}">{}</text>').format(
        x, y, anchor, words
    )


def _stroke(style: str) -> Markup:
    dash = DASHES.get(style, '')
    extra = Markup(' stroke-dasharray="{}"').format(dash) if dash else ''
    return Markup('fill="none" stroke="{}"{}').format(COLOURS[style], extra)


def _line(line: Line, x: _Scale, y: _Scale) -> Markup:
    px, py = x.at(line.x), y.at(line.y)
    keep = slice(None, None, max(1, px.size // _MOST_POINTS))
    pieces: list[str] = []
    pen = False
    for a, b in zip(px[keep].tolist(), py[keep].tolist(), strict=True):
        if not (math.isfinite(a) and math.isfinite(b)):
            pen = False
            continue
        pieces.append(f'{"L" if pen else "M"}{a:.1f} {b:.1f}')
        pen = True
    return Markup('<path {} stroke-width="1.6" stroke-linejoin="round" d="{}"/>').format(
        _stroke(line.style), ''.join(pieces)
    )


_SHAPES = {
    'circle': 'M-4 0a4 4 0 1 0 8 0a4 4 0 1 0 -8 0z',
    'square': 'M-3.6 -3.6h7.2v7.2h-7.2z',
    'diamond': 'M0 -5L5 0L0 5L-5 0z',
    'cross': 'M-4 -4L4 4M-4 4L4 -4',
}


def _marker(item: Points) -> Markup:
    colour = COLOURS[item.style]
    fill = 'none' if item.shape in {'cross', 'square'} else colour
    return Markup('d="{}" fill="{}" stroke="{}" stroke-width="1.8"').format(
        _SHAPES[item.shape], fill, colour
    )


def _points(item: Points, x: _Scale, y: _Scale) -> Markup:
    px, py = np.atleast_1d(x.at(item.x)), np.atleast_1d(y.at(item.y))
    return Markup('').join(
        Markup(
            '<path transform="translate({:.1f} {:.1f})" {}><title>{}</title></path>'
        ).format(a, b, _marker(item), item.name)
        for a, b in zip(px.tolist(), py.tolist(), strict=True)
        if math.isfinite(a) and math.isfinite(b)
    )  # fmt: skip


def _mark_line(
    mark: Mark, x: _Scale, y: _Scale, left: float, top: float, width: float, height: float
) -> Markup:
    if mark.axis == 'x':
        path = f'M{float(x.at(mark.value)):.1f} {top:.1f}v{height:.1f}'
    else:
        path = f'M{left:.1f} {float(y.at(mark.value)):.1f}h{width:.1f}'
    return Markup('<path {} stroke-width="1.5" d="{}"/>').format(_stroke(mark.style), path)


def _mark_label(
    mark: Mark, x: _Scale, y: _Scale, left: float, top: float, width: float, height: float
) -> Markup:
    if mark.axis == 'x':
        at = float(x.at(mark.value))
        side = at > left + 0.6 * width
        return Markup(
            '<text x="{:.1f}" y="{:.1f}" text-anchor="{}" font-size="11.5">{}</text>'
        ).format(at + (-5 if side else 5), top + height - 8, 'end' if side else 'start', mark.name)
    at = float(y.at(mark.value))
    low = at < top + 18
    edge = left + 6 if mark.at_start else left + width - 6
    return Markup(
        '<text x="{:.1f}" y="{:.1f}" text-anchor="{}" font-size="11.5">{}</text>'
    ).format(edge, at + (13 if low else -5), 'start' if mark.at_start else 'end', mark.name)


def _cells(cells: Cells | None, x: _Scale, y: _Scale) -> Markup:
    if cells is None:
        return Markup('')
    px, py = x.at(cells.x_edges).tolist(), y.at(cells.y_edges).tolist()
    parts = []
    for j, line in enumerate(cells.colours):
        start = 0
        for i in range(1, len(line) + 1):
            if i < len(line) and line[i] == line[start]:
                continue  # neighbours of one colour become one rectangle
            parts.append(
                f'<path fill="{line[start]}" d="M{px[start]:.1f} {py[j]:.1f}H{px[i]:.1f}'
                f'V{py[j + 1]:.1f}H{px[start]:.1f}z"/>'
            )
            start = i
    inner = Markup(''.join(parts))  # noqa: S704  # numbers and colours of our own making
    return Markup('<g shape-rendering="crispEdges">{}</g>').format(inner)


def _legend(panels: tuple[Panel, ...]) -> Markup:
    entries: dict[str, Markup] = {}
    for panel in panels:
        for line in panel.lines:
            sample = Markup('<path {} stroke-width="1.8" d="M0 6H28"/>').format(
                _stroke(line.style)
            )
            entries.setdefault(line.name, sample)
        for item in panel.points:
            sample = Markup('<path transform="translate(14 6)" {}/>').format(_marker(item))
            entries.setdefault(item.name, sample)
    if len(entries) < 2 and not any(panel.points for panel in panels):
        return Markup('')
    return Markup('<ul class="legend">{}</ul>').format(
        Markup('').join(
            Markup(
                '<li><svg viewBox="0 0 28 12" width="28" height="12" aria-hidden="true">{}</svg> '
                '{}</li>'
            ).format(sample, name)
            for name, sample in entries.items()
            if name
        )
    )
