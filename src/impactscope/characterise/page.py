"""Pages of static tests: constants with uncertainty, curves, residuals."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from markupsafe import Markup

from impactscope.characterise.further_tests import FurtherTest
from impactscope.characterise.static_test import StaticTest
from impactscope.estimate.damper_test import DamperTest
from impactscope.estimate.stiffness_test import CompressionTest
from impactscope.report.chart import Axis, Line, Panel, draw_chart
from impactscope.report.figure import Figure, Series, draw_figure
from impactscope.report.numbers import Quantity
from impactscope.report.page import render_page, write_page
from impactscope.version import __version__

__all__ = ['write_damper_page', 'write_spring_page']


def write_spring_page(
    test: StaticTest,
    result: CompressionTest,
    rows: list[Quantity],
    machine: Mapping[str, float],
    path: Path,
) -> None:
    """Write the page of a spring's test; OSError where it cannot be written."""
    lines = [Line('test', 1e3 * test.displacement, test.force)]
    panels = []
    if result.valid:
        ends = np.array(result.linear_range)
        forces = np.array(result.force_range)
        name = f'{result.stiffness.value / 1e3:.4g} N/mm over the linear range'
        lines.append(Line(name, 1e3 * ends, forces, 'second'))
        line = forces[0] + result.stiffness.value * (test.displacement - ends[0])
        panels.append(
            Panel(
                Axis('displacement / mm'),
                Axis('force less the line / N'),
                (Line('deviation', 1e3 * test.displacement, test.force - line, 'grey'),),
                title='deviation from the line',
            )
        )
    main = Panel(
        Axis('displacement / mm'), Axis('force / N'), tuple(lines), title='force over displacement'
    )
    figures = [
        draw_chart(
            'Spring test',
            'Force over displacement, and its deviation from the line found.',
            (main, *panels),
            columns=1 + len(panels),
            height=300,
        )
    ]
    _write('Spring test', test, result.valid, result.reason, '', rows, [], figures, machine, path)


def write_damper_page(
    test: StaticTest,
    result: DamperTest,
    rows: list[Quantity],
    further: list[FurtherTest],
    machine: Mapping[str, float],
    path: Path,
) -> None:
    """Write the page of a damper layer's test; OSError where it cannot be written."""
    series = [Series('test', test.time, test.force, 'pale')]
    lines = [Line('test', 1e3 * test.displacement, test.force)]
    if result.valid and result.layer is not None:
        model = result.layer.response(test.time, test.displacement, unilateral=True).force
        series += [
            Series('model', test.time, model, 'fit'),
            Series('residual', test.time, test.force - model, 'residual'),
        ]
        lines.append(Line('model', 1e3 * test.displacement, model, 'second'))
    figures = [
        draw_chart(
            'Force over displacement',
            'Hysteresis of the layer, and the model found.',
            (Panel(Axis('displacement / mm'), Axis('force / N'), tuple(lines)),),
            height=330,
        ),
        draw_figure(
            Figure(
                title='Force over time',
                description='Force of the test, of the model, and what is left.',
                x_label='time',
                x_unit='s',
                y_label='force',
                y_unit='N',
                x_range=(0.0, float(test.time[-1])),
                series=tuple(series),
                height=260,
            )
        ),
    ]
    if result.valid and result.layer is not None:
        frequency = np.geomspace(1e-3, 1e3, 300)
        x = Axis('frequency / Hz', (1e-3, 1e3), logarithmic=True)
        stiffness = np.abs(result.layer.dynamic_stiffness(frequency)) / 1e3
        loss = result.layer.loss_factor(frequency)
        figures.append(
            draw_chart(
                'What these constants say at other rates',
                'Dynamic stiffness and loss factor of the layer over frequency.',
                (
                    Panel(
                        x,
                        Axis('dynamic stiffness / (N/mm)', (0.0, 1.15 * float(stiffness.max()))),
                        (Line('', frequency, stiffness),),
                        title='stiffness',
                    ),
                    Panel(x, Axis('loss factor'), (Line('', frequency, loss),), title='loss'),
                ),
                columns=2,
                height=230,
                caption=('Nothing here beyond the rates tested is measured.',),
            )
        )
    _write(
        'Damper layer test',
        test,
        result.valid,
        result.reason,
        result.warning,
        rows,
        further,
        figures,
        machine,
        path,
    )


def _write(
    kind: str,
    test: StaticTest,
    valid: bool,
    reason: str,
    warning: str,
    rows: list[Quantity],
    further: list[FurtherTest],
    figures: list[Markup],
    machine: Mapping[str, float],
    path: Path,
) -> None:
    page = render_page(
        'characterise.html.j2',
        title=f'{kind}: {test.name}',
        kind=kind,
        test=test,
        valid=valid,
        reason=reason,
        warning=warning,
        rows=rows,
        further=[
            (item.name, _share(item.quick_branch), _share(item.constants)) for item in further
        ],
        figures=figures,
        machine=', '.join(
            f'{name.replace("_", " ")} {100 * value:g} %' for name, value in machine.items()
        ),
        version=__version__,
    )
    write_page(page, path)


def _share(value: float) -> str:
    return f'{100 * value:.2g} %' if value < 1 else 'left open'
