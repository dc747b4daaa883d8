import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.report.axis import decades, nice_range, nice_ticks
from impactscope.report.figure import (
    COLUMNS,
    ROWS,
    Band,
    Dot,
    Figure,
    Lane,
    LimitLine,
    Rule,
    Series,
    draw_figure,
)

HOSTILE = '"><script>alert(1)</script>&\''


def figure(**changes):
    x = np.linspace(0.0, 10.0, 101)
    fields = {
        'title': 'Force', 'description': 'a ramp', 'x_label': 'Time', 'x_unit': 'ms',
        'y_label': 'Force', 'y_unit': 'N', 'x_range': (0.0, 10.0),
        'series': (Series('ramp', x, 10 * x),), 'y_range': (0.0, 100.0),
    }  # fmt: skip
    return Figure(**{**fields, **changes})


def parse(drawn):
    return ET.fromstring(str(drawn).replace('&nbsp;', ' '))


def points(root, name):
    """Columns and rows of a curve, decoded as the page's script decodes them; None at breaks."""
    (path,) = [p for p in root.iter('path') if p.get('data-name') == name]
    found, x, y, absolute = [], 0, 0, False
    tokens = re.findall(r'[Ml]|-?\d+', path.get('d'))
    while tokens:
        if tokens[0] in 'Ml':
            absolute = tokens.pop(0) == 'M'
            if absolute and found:
                found.append(None)
            continue
        a, b = int(tokens.pop(0)), int(tokens.pop(0))
        x, y = (a, b) if absolute else (x + a, y + b)
        found.append((x, y))
    return found


def test_a_ramp_runs_from_corner_to_corner():
    found = points(parse(draw_figure(figure())), 'ramp')
    assert found[0] == (0, ROWS)
    assert found[-1] == (COLUMNS, 0)
    for column, row in found:
        assert row == pytest.approx(ROWS - column * ROWS / COLUMNS, abs=1)


def test_a_gap_stays_a_gap():
    x = np.linspace(0, 10, 101)
    y = 10 * x
    y[40:45] = np.nan
    found = points(parse(draw_figure(figure(series=(Series('ramp', x, y),)))), 'ramp')
    assert found.count(None) == 1
    assert None not in (found[0], found[-1])


def test_logarithmic_rows_are_equal_for_equal_ratios():
    x = np.arange(4.0)
    drawn = draw_figure(
        figure(
            series=(Series('s', x, 10.0**x),),
            x_range=(0.0, 3.0), y_range=(1.0, 1000.0), logarithmic=True,
        )
    )  # fmt: skip
    rows = [row for _, row in points(parse(drawn), 's')]
    steps = np.diff(rows)
    assert (abs(steps - steps[0]) <= 1).all()
    assert steps[0] < 0


def test_texts_of_every_part_are_escaped():
    band = Band(1, 9, 'contact', HOSTILE, short=HOSTILE)
    x = np.linspace(0, 10, 50)
    drawn = str(
        draw_figure(
            figure(
                title=HOSTILE, description=HOSTILE, x_label=HOSTILE, x_unit=HOSTILE,
                y_label=HOSTILE, y_unit=HOSTILE, series=(Series(HOSTILE, x, x),), bands=(band,),
                limits=(LimitLine(50, 0, 10, HOSTILE, 'transient-limit'),),
                rules=(Rule(5, HOSTILE, 'fit'),), dots=(Dot(5, 5, HOSTILE),),
                lanes=(Lane(HOSTILE, (band,)),), dot_name=HOSTILE, caption=(HOSTILE,),
            )
        )
    )  # fmt: skip
    assert '<script' not in drawn
    root = parse(drawn)  # well formed: nothing broke out of its attribute
    assert {e.tag for e in root.iter()} <= {
        'figure', 'figcaption', 'h4', 'ul', 'li', 'div', 'span', 'svg', 'g', 'path', 'rect',
        'text', 'tspan', 'title',
    }  # fmt: skip


def test_limit_labels_do_not_overlap():
    lines = tuple(LimitLine(v, 0, 10, f'limit {v}', 'transient-limit') for v in (50.0, 50.5, 51.0))
    root = parse(draw_figure(figure(limits=lines)))
    heights = sorted(
        float(t.get('y')) for t in root.iter('text') if 'limit-label' in t.get('class')
    )
    assert len(heights) == 3
    assert min(np.diff(heights)) > 20


any_float = st.floats(width=32)


@given(st.lists(any_float, max_size=40), any_float, any_float, any_float, any_float, st.booleans())
def test_any_numbers_give_a_well_formed_figure(values, a, b, level, guard, logarithmic):
    y = np.asarray(values, dtype=float)
    drawn = draw_figure(
        figure(
            series=(Series('s', np.arange(y.size, dtype=float), y),), x_range=(a, b),
            y_range=None, bands=(Band(a, b, 'contact', 'c', low=level, high=guard),),
            limits=(LimitLine(level, a, b, 'limit', 'transient-limit'),),
            dots=(Dot(a, level, 'd'),), rules=(Rule(b, 'r', 'fit'),), logarithmic=logarithmic,
        )
    )  # fmt: skip
    parse(drawn)
    assert not re.search(r'="[^"]*\b(nan|inf)\b', str(drawn))


@given(st.floats(-1e9, 1e9), st.floats(1e-6, 1e9), st.integers(3, 12))
def test_ticks_are_round_and_inside(low, span, count):
    high = low + span
    if high - low < 1e-9 * max(abs(low), abs(high)):
        return
    ticks, decimals = nice_ticks(low, high, count)
    assert 2 <= len(ticks) <= max(count, 5) + 2
    assert all(low - 1e-6 * span <= tick <= high + 1e-6 * span for tick in ticks)
    assert len({f'{tick:.{decimals}f}' for tick in ticks}) == len(ticks)


def test_ranges_and_decades():
    assert nice_range(0.0, 100.0) == (-5.0, 105.0)
    low, high = nice_range(3.0, 3.0)
    assert low < 3.0 < high
    assert nice_range(np.nan, 1.0) == (0.0, 1.0)
    assert decades(0.05, 200.0) == [0.1, 1.0, 10.0, 100.0]
