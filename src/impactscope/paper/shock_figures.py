"""Fig. 9 of the paper, drawn anew and made quantitative: a map, and what a better sensor needs."""

from __future__ import annotations

import math

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from impactscope.paper import published
from impactscope.paper.shock_rows import (
    FIG_9_CONTACTS,
    FIG_9_SENSORS,
    PEAK_ERROR,
    fig_9_reading,
)
from impactscope.physics.sensor_model import PAPER_SENSOR
from impactscope.physics.shock_response import (
    largest_peak_ratio,
    peak_ratio_map,
    required_sensor,
    shortest_contact_ratio,
    unity_contact_ratio,
)
from impactscope.report.chart import Axis, Cells, Line, Mark, Panel, Points, draw_chart

__all__ = ['shock_figures']

Array = NDArray[np.float64]

_LOW, _MIDDLE, _HIGH = (20, 80, 140), (250, 250, 248), (179, 23, 31)
_STEPS = 24  # of colour to either side


def shock_figures() -> list[Markup]:
    """The six panels, the peak error over contact time, the map, and the design chart."""
    return [_panels(), _error_curve(), _map(), _design()]


def _panels() -> Markup:
    panels = []
    for sensor in FIG_9_SENSORS:
        for letter, (shape, duration) in zip('abc', FIG_9_CONTACTS, strict=True):
            end = duration + max(0.25 * duration, 0.15 if sensor.damping_ratio < 1 else 0.05)
            time = np.linspace(-0.05 * end, end, 1500)
            inside = (time >= 0) & (time <= duration)
            height = np.ones(time.size) if shape == 'step' else np.sin(np.pi * time / duration)
            force = np.where(inside, height, 0.0)
            reading = fig_9_reading(time, shape, duration, sensor)
            panels.append(
                Panel(
                    Axis('time / ms'),
                    Axis('force over peak force', (-1.3, 1.95)),
                    (
                        Line('contact force', 1e3 * time, force, 'main'),
                        Line('reading', 1e3 * time, reading, 'second'),
                    ),
                    title=f'({letter}) {shape}, {1e3 * duration:.0f} ms, '
                    f'ζ = {sensor.damping_ratio:.3g}: peak {float(reading.max()):.2f}',
                )
            )
    return draw_chart(
        'Fig. 9  What the sensor reads of an impact (closed form)',
        'Contact force and reading for three contacts, damping ratio 0.07 above and 1 below.',
        tuple(panels),
        columns=3,
        height=210,
        caption=(
            'The paper says of column (c) that the peak is underestimated. With ζ = 0.07 it is '
            'overestimated by a little, with ζ = 1 underestimated by more than half.',
        ),
    )


def _error_curve() -> Markup:
    ratios = np.geomspace(0.06, 8.0, 140)
    lines = []
    for zeta, style in ((0.07, 'main'), (0.3, 'third'), (0.55, 'second'), (1.0, 'grey')):
        values = peak_ratio_map([zeta], ratios)[0]
        lines.append(
            Line(f'ζ = {zeta:g}', 1e3 * ratios / PAPER_SENSOR.natural_frequency, values, style)
        )
    fn = PAPER_SENSOR.natural_frequency
    at, worst = largest_peak_ratio(0.07)
    return draw_chart(
        'Fig. 9, continued  Peak of the reading over peak of the force (closed form)',
        'Ratio of the peaks of half-sine contacts over the contact time for four dampings.',
        (
            Panel(
                Axis('contact time / ms, at f_n = 32.3 Hz', logarithmic=True),
                Axis('peak reading over peak force', (0.0, 1.85)),
                tuple(lines),
                marks=(
                    Mark('x', 10.0, 'paper: cannot be measured below 10 ms'),
                    Mark('y', 1.0, 'read right', 'grey'),
                ),
            ),
        ),
        height=300,
        caption=(
            f'Below {1e3 * unity_contact_ratio(0.07) / fn:.1f} ms this sensor under-reads; from '
            f'there to beyond 100 ms it over-reads, by {100 * (worst - 1):.0f} % near '
            f'{1e3 * at / fn:.0f} ms. The paper names only the first.',
        ),
    )


def _colour(ratio: float) -> str:
    """Blue where the peak is read too low, red where too high, pale where right."""
    share = float(np.clip(abs(ratio - 1) / 0.7, 0.0, 1.0)) ** 0.7
    share = round(_STEPS * share) / _STEPS
    end = _LOW if ratio < 1 else _HIGH
    mixed = [round(m + share * (e - m)) for m, e in zip(_MIDDLE, end, strict=True)]
    return '#{:02x}{:02x}{:02x}'.format(*mixed)


def _crossing(x: Array, excess: Array, i: int) -> float:
    """Where ``excess`` passes zero between i and i + 1, on a logarithmic axis."""
    share = excess[i] / (excess[i] - excess[i + 1])
    return float(x[i] * (x[i + 1] / x[i]) ** share)


def _first(x: Array, excess: Array) -> float:
    """First zero from below; NaN where there is none."""
    found = np.flatnonzero((excess[:-1] < 0) & (excess[1:] >= 0))
    return _crossing(x, excess, int(found[0])) if found.size else math.nan


def _last(x: Array, excess: Array) -> float:
    """Last zero from above; NaN where there is none."""
    found = np.flatnonzero((excess[:-1] > 0) & (excess[1:] <= 0))
    return _crossing(x, excess, int(found[-1])) if found.size else math.nan


def _map() -> Markup:
    x_edges, y_edges = np.geomspace(0.1, 10.0, 67), np.linspace(0.0, 1.2, 41)
    x, y = np.sqrt(x_edges[1:] * x_edges[:-1]), 0.5 * (y_edges[1:] + y_edges[:-1])
    values = peak_ratio_map(y, x)
    colours = tuple(tuple(_colour(float(v)) for v in line) for line in values)
    unity = np.array([_first(x, v - 1) for v in values])
    trusted = np.array([_last(x, np.abs(v - 1) - PEAK_ERROR) for v in values])
    fn = PAPER_SENSOR.natural_frequency
    best = required_sensor(0.01, PEAK_ERROR, published.SPRING_STIFFNESS).sensor
    fig_9 = [(duration * fn, s.damping_ratio) for s in FIG_9_SENSORS for duration in (0.01,)]
    return draw_chart(
        'Map of the peak error (closed form)',
        'Peak of the reading over peak of a half-sine force, over contact time and damping.',
        (
            Panel(
                Axis('contact time over natural period, T_c f_n', (0.1, 10.0), logarithmic=True),
                Axis('damping ratio ζ', (0.0, 1.2)),
                (
                    Line('read right; left of it too low', unity, y, 'grey'),
                    Line(
                        f'right of it, every peak is within {100 * PEAK_ERROR:.0f} %',
                        trusted,
                        y,
                        'third',
                    ),
                ),
                (
                    Points(
                        'Fig. 9c, ζ = 0.07 and ζ = 1',
                        [a for a, _ in fig_9],
                        [b for _, b in fig_9],
                        'published',
                        'diamond',
                    ),
                ),
                (Mark('y', published.DAMPING_RATIO, "the paper's sensor"),),
                Cells(x_edges, y_edges, colours),
                texts=((0.42, 0.75, 'reads too low'), (1.0, 0.2, 'reads too high')),
            ),
        ),
        height=340,
        caption=(
            'Blue: peak read too low; red: too high; the deeper, the more, up to 70 %.',
            f'The green line turns back at ζ = {best.damping_ratio:.2f}: more damping costs '
            'bandwidth, less lets the plate ring.',
        ),
    )


def _design() -> Markup:
    contacts = np.geomspace(3e-3, 0.2, 40)
    lines = []
    for zeta, style in ((None, 'second'), (0.7, 'third'), (1.0, 'grey'), (0.0692, 'main')):
        # Needs scale with the contact time squared: one requirement gives the whole line.
        need = required_sensor(0.01, PEAK_ERROR, published.SPRING_STIFFNESS, zeta)
        name = f'ζ = {need.sensor.damping_ratio:.2g}' + (' (best)' if zeta is None else '')
        lines.append(
            Line(name, 1e3 * contacts, need.largest_plate_mass * (contacts / 0.01) ** 2, style)
        )
    zeta = published.DAMPING_RATIO
    trusted = shortest_contact_ratio(zeta, PEAK_ERROR) / PAPER_SENSOR.natural_frequency
    return draw_chart(
        'A better sensor: heaviest plate for a given shortest contact (closed form)',
        'Largest plate mass over the shortest contact that is to be read within 5 percent.',
        (
            Panel(
                Axis('shortest contact time / ms', (3.0, 200.0), logarithmic=True),
                Axis('plate mass / kg', (1e-3, 20.0), logarithmic=True),
                tuple(lines),
                (
                    Points(
                        f"the paper's sensor: trusted from {1e3 * trusted:.0f} ms on",
                        [1e3 * trusted],
                        [PAPER_SENSOR.mass],
                        'published',
                        'diamond',
                    ),
                ),
                (Mark('y', PAPER_SENSOR.mass, "the paper's plate, 1.67 kg", at_start=True),),
            ),
        ),
        height=320,
        caption=(
            f'Spring 69 N/mm, peak within {100 * PEAK_ERROR:.0f} %. Mass in proportion to '
            'stiffness and to the square of the contact time.',
        ),
    )
