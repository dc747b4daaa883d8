"""Fig. 12 and 13 of the paper, drawn anew: cyclic test of the damper layer."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from impactscope.estimate.stiffness_test import split_strokes
from impactscope.paper.damper_rows import PAPER_PEAK_FORCE, damper_fit, unseen_force
from impactscope.paper.recordings import damper_test
from impactscope.physics.damper_layer import PAPER_LAYER_SH10
from impactscope.physics.twin.bench import IMPACT_RATE_LAYER
from impactscope.report.chart import Axis, Line, Panel, Points, draw_chart
from impactscope.report.figure import Figure, LimitLine, Series, draw_figure

__all__ = ['damper_figures']


def damper_figures() -> list[Markup]:
    """Fig. 12, Fig. 13, and what the layer does at other rates."""
    return [_hysteresis(), _fifth_cycle(), _rates()]


def _hysteresis() -> Markup:
    test = damper_test()
    return draw_chart(
        'Fig. 12  Five cycles on the SH10 layer at 10 mm/min (simulated)',
        'Force over displacement of five cycles of growing displacement.',
        (
            Panel(
                Axis('displacement / mm'),
                Axis('force / N', (-8.0, 190.0)),
                (Line('simulated test', 1e3 * test.displacement, test.force),),
                (
                    Points(
                        'paper: 175 N at "about 4 mm"',
                        [4.0],
                        [PAPER_PEAK_FORCE],
                        'published',
                        'diamond',
                    ),
                ),
            ),
        ),
        height=320,
        caption=(
            f"By the paper's constants the force at 4 mm is {test.true_force.max():.0f} N. The "
            'indenter cannot pull: near zero it leaves the layer, which recovers over seconds.',
        ),
    )


def _fifth_cycle() -> Markup:
    test, fit = damper_test(), damper_fit()
    strokes = split_strokes(test.displacement)
    inside = slice(strokes[-2][0], strokes[-1][1])
    assert fit.layer is not None  # noqa: S101  # the simulated test can be identified
    model = fit.layer.response(test.time, test.displacement, unilateral=True).force[inside]
    time = test.time[inside] - test.time[inside.start]
    end = float(time[-1])
    return draw_figure(
        Figure(
            title='Fig. 13  Fifth cycle and eq. 29 (simulated)',
            description='Force of the fifth cycle with the fitted model and what is left.',
            x_label='time',
            x_unit='s',
            y_label='force',
            y_unit='N',
            x_range=(0.0, end),
            series=(
                Series('simulated test', time, test.force[inside], 'pale'),
                Series('eq. 29, all cycles fitted at once', time, model, 'fit'),
                Series('residual', time, test.force[inside] - model, 'residual'),
            ),
            limits=(LimitLine(PAPER_PEAK_FORCE, 0.0, end, 'paper: maximum', 'transient-limit'),),
            height=260,
            caption=(
                f'RMSE of this fit {fit.cycle_rmse[-1]:.2f} N, the noise put in; paper: 0.857 N, '
                'largest error 6.1 N.',
            ),
        )
    )


def _rates() -> Markup:
    frequency = np.geomspace(1e-3, 1e3, 400)
    layers = (
        (PAPER_LAYER_SH10, 'constants of 10 mm/min', 'main'),
        (IMPACT_RATE_LAYER, 'with branches assumed at impact rate', 'second'),
    )
    x = Axis('frequency / Hz', (1e-3, 1e3), logarithmic=True)
    stiffness = tuple(
        Line(name, frequency, np.abs(layer.dynamic_stiffness(frequency)) / 1e3, style)
        for layer, name, style in layers
    )
    loss = tuple(
        Line(name, frequency, layer.loss_factor(frequency), style) for layer, name, style in layers
    )
    return draw_chart(
        'What one rate does not tell (closed form)',
        'Dynamic stiffness and loss factor of the layer over frequency.',
        (
            Panel(
                x, Axis('dynamic stiffness / (N/mm)', (0.0, 260.0)), stiffness, title='stiffness'
            ),
            Panel(x, Axis('loss factor', (0.0, 0.6)), loss, title='loss factor'),
        ),
        columns=2,
        height=250,
        caption=(
            'Both layers give the same cyclic test at 10 mm/min within '
            f'{unseen_force():.1f} N. The branches at impact rate are an assumption; only a test '
            'at impact rate can replace them.',
        ),
    )
