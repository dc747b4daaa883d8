"""Figures as inline SVG: curves, limits, phases.

A figure is plain data; :func:`draw_figure` turns it into markup in which every text is
escaped. The curves lie in a nested ``svg`` of whole-number coordinates, of which the page's
small script shows a part when the reader zooms, and from which it reads the values under the
cursor: the data stands in the page once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from impactscope.report.axis import decades, nice_range, nice_ticks
from impactscope.report.decimate import decimate_for_display
from impactscope.report.numbers import format_given
from impactscope.report.plain_text import printable

__all__ = ['Band', 'Dot', 'Figure', 'Lane', 'LimitLine', 'Rule', 'Series', 'draw_figure']

FloatArray = NDArray[np.float64]

WIDTH, LEFT, RIGHT = 1000, 66, 128
PLOT_WIDTH = WIDTH - LEFT - RIGHT
LANE_HEIGHT, LANE_GAP, TOP, BOTTOM = 17, 3, 8, 42
COLUMNS = 40_000  # whole-number steps of the time axis: fine enough to zoom
ROWS = 8_000  # of the value axis
CHARACTER = 6.4  # width of one character of a label, roughly
LABEL_LINE = 13


@dataclass(frozen=True, slots=True)
class Series:
    """A curve; ``x`` and ``y`` have shape (n,), NaN breaks it. ``style`` is a CSS class."""

    name: str
    x: FloatArray
    y: FloatArray
    style: str = 'measured'
    max_points: int = 2400


@dataclass(frozen=True, slots=True)
class Band:
    """A shaded stretch of the x axis, over the whole height or from ``low`` to ``high``."""

    start: float
    end: float
    style: str
    name: str = ''
    low: float = math.nan
    high: float = math.nan
    short: str = ''  # shown in a lane where the name does not fit


@dataclass(frozen=True, slots=True)
class LimitLine:
    """A level that holds over a stretch of the x axis, named at the right."""

    level: float
    start: float
    end: float
    label: str
    style: str


@dataclass(frozen=True, slots=True)
class Rule:
    """A line across the plot at one x, named in the legend."""

    x: float
    name: str
    style: str


@dataclass(frozen=True, slots=True)
class Dot:
    """A marked point of a curve."""

    x: float
    y: float
    name: str


@dataclass(frozen=True, slots=True)
class Lane:
    """A strip above the plot that names stretches of the x axis in words."""

    name: str
    spans: tuple[Band, ...]


@dataclass(frozen=True, slots=True)
class Figure:
    """What one figure shows; x in ``x_unit``, y in ``y_unit``, both as printed."""

    title: str
    description: str  # for those who cannot see it
    x_label: str
    x_unit: str
    y_label: str
    y_unit: str
    x_range: tuple[float, float]
    series: tuple[Series, ...]
    bands: tuple[Band, ...] = ()
    limits: tuple[LimitLine, ...] = ()
    rules: tuple[Rule, ...] = ()
    dots: tuple[Dot, ...] = ()
    lanes: tuple[Lane, ...] = ()
    height: int = 300  # of the plot
    y_range: tuple[float, float] | None = None  # default: all curves and limits
    logarithmic: bool = False  # value axis
    dot_name: str = ''  # in the legend
    caption: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Scale:
    """From values to whole-number coordinates of the plot."""

    x0: float
    x1: float
    y0: float
    y1: float
    logarithmic: bool

    def column(self, x: float) -> int:
        share = (x - self.x0) / (self.x1 - self.x0)
        return round(COLUMNS * min(max(share, -1.0), 2.0)) if math.isfinite(share) else 0

    def row(self, y: float) -> int:
        return int(self.rows(np.asarray([y]))[0])

    def columns(self, x: FloatArray) -> NDArray[np.int64]:
        share = (x - self.x0) / (self.x1 - self.x0)
        return np.rint(COLUMNS * np.clip(share, -1.0, 2.0)).astype(np.int64)

    def rows(self, y: FloatArray) -> NDArray[np.int64]:
        if self.logarithmic:
            y = np.log10(np.maximum(y, 1e-300))
        share = (self.y1 - y) / (self.y1 - self.y0)
        return np.rint(ROWS * np.clip(np.nan_to_num(share), -1.0, 2.0)).astype(np.int64)


def _value_range(figure: Figure) -> tuple[float, float]:
    """Range of the value axis; exponents of ten where it is logarithmic."""
    if figure.y_range is not None:
        low, high = figure.y_range
    else:
        x0, x1 = figure.x_range
        shown = [s.y[(s.x >= x0) & (s.x <= x1) & np.isfinite(s.y)] for s in figure.series]
        levels = [v for line in figure.limits if math.isfinite(v := line.level)]
        levels += [v for band in figure.bands for v in (band.low, band.high) if math.isfinite(v)]
        values = np.concatenate([*shown, np.asarray(levels, dtype=np.float64)])
        if values.size == 0:
            return 0.0, 1.0
        low, high = float(values.min()), float(values.max())
    if figure.logarithmic:
        high = high if high > 0 else 1.0
        low = max(low, high * 1e-4)
        return math.log10(low) - 0.1, math.log10(high) + 0.25
    return nice_range(low, high) if figure.y_range is None else (low, high)


def _path(scale: _Scale, series: Series, x_range: tuple[float, float]) -> str:
    """Path data in relative whole numbers, one subpath for each unbroken stretch."""
    inside = np.flatnonzero((series.x >= x_range[0]) & (series.x <= x_range[1]))
    if inside.size == 0:
        return ''
    part = slice(max(inside[0] - 1, 0), inside[-1] + 2)
    x, y = decimate_for_display(series.x[part], series.y[part], series.max_points)
    columns, rows, good = scale.columns(x), scale.rows(y), np.isfinite(y) & np.isfinite(x)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(np.int8), [0]])))
    pieces = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        steps = np.empty((stop - start - 1, 2), dtype=np.int64)
        steps[:, 0] = np.diff(columns[start:stop])
        steps[:, 1] = np.diff(rows[start:stop])
        line = ' '.join(map(str, steps.ravel().tolist())) or '0 0'
        pieces.append(f'M{columns[start]} {rows[start]}l{line}')
    return ''.join(pieces).replace(' -', '-')


def _band(scale: _Scale, band: Band, height: int = ROWS) -> Markup:
    start, end = scale.column(band.start), scale.column(band.end)
    top, bottom = 0, height
    if math.isfinite(band.low) and math.isfinite(band.high):
        top, bottom = scale.row(band.high), scale.row(band.low)
    return Markup(
        '<rect class="{}" x="{}" y="{}" width="{}" height="{}"><title>{}</title></rect>'
    ).format(band.style, start, top, max(end - start, 0), max(bottom - top, 0), band.name)


def _floating(scale: _Scale, band: Band, y: float) -> Markup:
    """A label in the middle of a band, hidden where the band is too narrow for it."""
    x0, x1 = max(scale.column(band.start), 0), min(scale.column(band.end), COLUMNS)
    width = (x1 - x0) * PLOT_WIDTH / COLUMNS
    texts = [text for text in (band.name, band.short) if CHARACTER * len(text) + 4 <= width]
    return Markup(
        '<text class="lane-label floating" data-a="{}" data-b="{}" data-name="{}" '
        'data-short="{}" data-character="{}" x="{:.1f}" y="{:.1f}">{}</text>'
    ).format(
        scale.column(band.start), scale.column(band.end), band.name, band.short, CHARACTER,
        LEFT + (x0 + x1) / 2 * PLOT_WIDTH / COLUMNS, y, texts[0] if texts else '',
    )  # fmt: skip


def _lanes(scale: _Scale, figure: Figure) -> Markup:
    parts = []
    for index, lane in enumerate(figure.lanes):
        y = TOP + index * (LANE_HEIGHT + LANE_GAP)
        rectangles = Markup('').join(_band(scale, span, 10) for span in lane.spans)
        parts.append(
            Markup(
                '<text class="lane-name" x="{}" y="{}">{}</text><svg class="pan" x="{}" y="{}" '
                'width="{}" height="{}" viewBox="0 0 {} 10" preserveAspectRatio="none">{}</svg>{}'
            ).format(
                LEFT + PLOT_WIDTH + 8, y + LANE_HEIGHT - 4.5, lane.name, LEFT, y, PLOT_WIDTH,
                LANE_HEIGHT, COLUMNS, rectangles,
                Markup('').join(
                    _floating(scale, s, y + LANE_HEIGHT - 4.5) for s in lane.spans if s.name
                ),
            )
        )  # fmt: skip
    return Markup('').join(parts)


def _value_axis(scale: _Scale, figure: Figure, top: float) -> Markup:
    """Grid lines and numbers of the value axis."""
    if scale.logarithmic:
        ticks, decimals = decades(10.0**scale.y0, 10.0**scale.y1), -1
    else:
        ticks, decimals = nice_ticks(scale.y0, scale.y1, max(4, figure.height // 45))
    parts = []
    for tick in ticks:
        y = top + scale.row(tick) * figure.height / ROWS
        text = f'{tick:.{decimals}f}' if decimals >= 0 else f'{tick:g}'
        zero = ' zero' if tick == 0 else ''
        parts.append(
            Markup(
                '<path class="grid{}" d="M{} {:.1f}h{}"/><text class="tick-y" x="{}" y="{:.1f}">'
                '{}</text>'
            ).format(zero, LEFT, y, PLOT_WIDTH, LEFT - 6, y + 4, text)
        )
    middle = top + figure.height / 2
    parts.append(
        Markup(
            '<text class="axis-label" transform="translate(14 {:.1f}) rotate(-90)">{}</text>'
        ).format(middle, f'{figure.y_label} / {figure.y_unit}')
    )
    return Markup('').join(parts)


def _time_axis(scale: _Scale, figure: Figure, top: float) -> Markup:
    """Grid lines and numbers of the x axis; the script draws them anew after zooming."""
    ticks, decimals = nice_ticks(scale.x0, scale.x1, 10)
    bottom = top + figure.height
    parts = []
    for tick in ticks:
        x = LEFT + scale.column(tick) * PLOT_WIDTH / COLUMNS
        parts.append(
            Markup(
                '<path class="grid" d="M{:.1f} {:.1f}v{}"/><text class="tick-x" x="{:.1f}" '
                'y="{:.1f}">{}</text>'
            ).format(x, top, figure.height, x, bottom + 16, f'{tick:.{decimals}f}')
        )
    label = Markup('<text class="axis-label" x="{}" y="{:.1f}">{}</text>').format(
        LEFT + PLOT_WIDTH / 2, bottom + 34, f'{figure.x_label} / {figure.x_unit}'
    )
    return Markup('<g class="x-axis">{}</g>{}').format(Markup('').join(parts), label)


def _limit_labels(scale: _Scale, figure: Figure, top: float) -> Markup:
    """Names of the limits beside the plot, pushed apart where they would overlap."""
    parts = []
    lowest = -math.inf
    for line in sorted(figure.limits, key=lambda item: -item.level):
        y = top + scale.row(line.level) * figure.height / ROWS
        y = max(y, lowest)
        lowest = y + 2.4 * LABEL_LINE
        parts.append(
            Markup(
                '<text class="limit-label {}" x="{}" y="{:.1f}">{}<tspan x="{}" dy="{}">{}'
                '</tspan></text>'
            ).format(
                line.style, WIDTH - RIGHT + 8, y, line.label, WIDTH - RIGHT + 8, LABEL_LINE,
                f'{format_given(line.level)} {figure.y_unit}',
            )
        )  # fmt: skip
    return Markup('').join(parts)


def _plot(scale: _Scale, figure: Figure) -> Markup:
    """Everything inside the axes."""
    parts = [_band(scale, band) for band in figure.bands]
    for line in figure.limits:
        start, end = scale.column(line.start), scale.column(line.end)
        parts.append(
            Markup('<path class="limit {}" d="M{} {}H{}"/>').format(
                line.style, start, scale.row(line.level), end
            )
        )
    parts += [
        Markup('<path class="rule {}" d="M{} 0V{}"><title>{}</title></path>').format(
            rule.style, scale.column(rule.x), ROWS, rule.name
        )
        for rule in figure.rules
    ]
    parts += [
        Markup('<path class="curve {}" data-name="{}" d="{}"/>').format(
            series.style, series.name, _path(scale, series, figure.x_range)
        )
        for series in figure.series
    ]
    # A line without length and with round ends stays round however the plot is stretched.
    parts += [
        Markup('<path class="dot" d="M{} {}h0"><title>{}</title></path>').format(
            scale.column(dot.x), scale.row(dot.y), dot.name
        )
        for dot in figure.dots
    ]
    return Markup('').join(parts)


def _legend(figure: Figure) -> Markup:
    """The names of curves and rules with a sample of each line."""
    entries = [(s.style, 'curve', s.name) for s in figure.series]
    entries += [(r.style, 'rule', r.name) for r in figure.rules]
    entries += [(line.style, 'limit', line.label) for line in figure.limits]
    if len(entries) == 1 and not figure.dot_name:
        return Markup('')  # one curve: the title names it
    items = Markup('').join(
        Markup(
            '<li><svg viewBox="0 0 28 8" width="28" height="8" aria-hidden="true">'
            '<path class="{} {}" d="M0 4H28"/></svg> {}</li>'
        ).format(kind, style, name)
        for style, kind, name in entries
    )
    if figure.dot_name:
        items += Markup(
            '<li><svg viewBox="0 0 12 8" width="12" height="8" aria-hidden="true">'
            '<path class="dot" d="M6 4h0"/></svg> {}</li>'
        ).format(figure.dot_name)
    return Markup('<ul class="legend">{}</ul>').format(items)


def draw_figure(figure: Figure) -> Markup:
    """The figure as an HTML ``figure`` element with an inline SVG, legend and caption."""
    x0, x1 = figure.x_range
    if not (math.isfinite(x0) and math.isfinite(x1)) or x1 <= x0:
        x0, x1 = 0.0, 1.0
    y0, y1 = _value_range(figure)
    scale = _Scale(x0, x1, y0, y1, figure.logarithmic)
    lanes = len(figure.lanes) * (LANE_HEIGHT + LANE_GAP)
    top = TOP + lanes + (LANE_GAP if lanes else 0)
    height = top + figure.height + BOTTOM
    described = printable(f'{figure.title}. {figure.description}')
    svg = Markup(
        '<svg class="figure" viewBox="0 0 {} {}" role="img" aria-label="{}" '
        'data-x0="{:.9g}" data-x1="{:.9g}" data-y0="{:.9g}" data-y1="{:.9g}" data-log="{}" '
        'data-xunit="{}" data-yunit="{}" data-left="{}" data-width="{}" data-top="{}" '
        'data-height="{}" data-columns="{}" data-rows="{}">{}{}{}{}'
        '<svg class="pan plot" x="{}" y="{}" width="{}" height="{}" viewBox="0 0 {} {}" '
        'preserveAspectRatio="none">{}</svg><rect class="frame" x="{}" y="{}" width="{}" '
        'height="{}"/></svg>'
    ).format(
        WIDTH, height, described, x0, x1, y0, y1, int(figure.logarithmic),
        figure.x_unit, figure.y_unit, LEFT, PLOT_WIDTH, top, figure.height, COLUMNS, ROWS,
        _time_axis(scale, figure, top), _value_axis(scale, figure, top), _lanes(scale, figure),
        _limit_labels(scale, figure, top), LEFT, top, PLOT_WIDTH, figure.height, COLUMNS, ROWS,
        _plot(scale, figure), LEFT, top, PLOT_WIDTH, figure.height,
    )  # fmt: skip
    caption = Markup(' ').join(Markup('<span>{}</span>').format(s) for s in figure.caption)
    return Markup(
        '<figure><h4>{}</h4>{}<div class="canvas">{}</div><figcaption>{}</figcaption></figure>'
    ).format(figure.title, _legend(figure), svg, caption)
