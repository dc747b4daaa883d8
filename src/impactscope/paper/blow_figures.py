"""Fig. 10 and 11 of the paper, drawn anew: equivalent mass, and blows on both benches."""

from __future__ import annotations

import math

import numpy as np
from markupsafe import Markup

from impactscope.paper import published
from impactscope.paper.blow_rows import coupled_masses
from impactscope.paper.recordings import pendulum_blow
from impactscope.physics.pendulum import Orientation, Pendulum
from impactscope.physics.sensor_model import PAPER_SENSOR
from impactscope.physics.twin.bench import IMPACT_RATE_LAYER, PAPER_LAYER
from impactscope.report.chart import Axis, Line, Mark, Panel, Points, draw_chart
from impactscope.report.figure import Band, Figure, LimitLine, Series, draw_figure

__all__ = ['blow_figures']


def blow_figures() -> list[Markup]:
    """Fig. 10, why it holds only in part, and Fig. 11 for both orientations."""
    return [_masses(), _bouncing(), *(_blow(orientation) for orientation in Orientation)]


def _masses() -> Markup:
    found = [coupled_masses(d) for d in published.MASS_DISTANCES]
    at = np.array([1e3 * item.distance for item in found])
    fine = np.linspace(0.0, 0.25, 60)
    equation = [PAPER_SENSOR.mass + Pendulum(mass_distance=float(d)).equivalent_mass for d in fine]
    return draw_chart(
        'Fig. 10  Mass of plate and pendulum (simulated)',
        'Mass from the common oscillation over the position of the adjustable mass.',
        (
            Panel(
                Axis('position of the adjustable mass d / mm', (-8.0, 258.0)),
                Axis('m + M / kg', (1.4, 3.05)),
                (Line('eq. 4 and the plate of 1.67 kg', 1e3 * fine, equation),),
                (
                    Points('eq. 26, contact kept', at, [i.kept for i in found], 'third'),
                    Points(
                        'eq. 26, contact lost as in a blow from 10°',
                        at,
                        [i.lost for i in found],
                        'published',
                        'cross',
                    ),
                    Points(
                        'eq. 26 after the last return of contact',
                        at,
                        [i.late for i in found],
                        'second',
                        'square',
                    ),
                ),
                (
                    Mark(
                        'y',
                        1.67,
                        'printed in 2.1 as least equivalent mass: 1.67 kg',
                        'grey',
                        at_start=True,
                    ),
                    Mark('y', 2.68, 'printed in 2.1 as greatest: 2.68 kg', 'grey', at_start=True),
                ),
            ),
        ),
        height=330,
        caption=(
            'The paper prints no values of Fig. 10, only "a strong correlation". The fit finds '
            'the mass where the pendulum stays on the plate, and misses it where it bounces, as '
            f'it does from 10°: by up to {100 * max(abs(i.bias) for i in found):.0f} %.',
        ),
    )


def _bouncing() -> Markup:
    blow, kept = pendulum_blow(0.25), pendulum_blow(0.25, kept=True)
    end = 0.5
    bands = tuple(
        Band(c.start, min(c.end, end), 'contact', 'contact')
        for c in blow.contacts
        if c.start < end
    )
    return draw_figure(
        Figure(
            title='Why: a blow from 10°, d = 250 mm, without damper (simulated)',
            description='Reading with contact lost and found, and with contact kept.',
            x_label='time',
            x_unit='s',
            y_label='force',
            y_unit='N',
            x_range=(0.03, end),
            series=(
                Series('contact lost and found', blow.time, blow['force']),
                Series('contact kept', kept.time, kept['force'], 'fit'),
            ),
            bands=bands,
            height=240,
            caption=('Shaded: contact. In between the plate swings alone, at its own 32 Hz.',),
        )
    )


def _blow(orientation: Orientation) -> Markup:
    vertical = orientation is Orientation.VERTICAL
    assumed = pendulum_blow(0.25, orientation, IMPACT_RATE_LAYER)
    paper = pendulum_blow(0.25, orientation, PAPER_LAYER)
    end = 1.0
    rest = Pendulum(mass_distance=0.25).contact_weight() if vertical else 0.0
    bands = tuple(
        Band(c.start, min(c.end, end), 'contact', 'contact')
        for c in assumed.contacts
        if c.start < end
    )
    letter = 'a' if vertical else 'b'
    words = 'paper: positive' if vertical else 'paper: null'
    return draw_figure(
        Figure(
            title=f'Fig. 11{letter}  Blow on the damper, {orientation.value} sensor (simulated)',
            description='Reading of a blow from 10 degrees with the mass at 250 mm.',
            x_label='time',
            x_unit='s',
            y_label='force',
            y_unit='N',
            x_range=(0.0, end),
            series=(
                Series('layer, constants of 10 mm/min', paper.time, paper['force'], 'pale'),
                Series('layer, branches assumed at impact rate', assumed.time, assumed['force']),
            ),
            bands=bands,
            limits=(LimitLine(round(rest, 1), 0.7, end, words, 'transient-limit'),),
            height=240,
            caption=(
                f'{math.degrees(published.RELEASE_ANGLE):.0f}° and d = 250 mm; shaded: contact '
                'with the impact-rate layer. With the constants of 10 mm/min the layer loses '
                'next to nothing and the pendulum bounces on.',
            ),
        )
    )
