import re

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.report.chart import Axis, Cells, Line, Mark, Panel, Points, draw_chart


def drawn(**parts):
    axes = {'x': Axis('x'), 'y': Axis('y')} | parts
    return str(draw_chart('title', 'words', (Panel(**axes),)))


def path_of(svg):
    found = re.search(r'stroke-width="1.6"[^>]*d="([^"]*)"', svg).group(1)
    return [tuple(map(float, p)) for p in re.findall(r'[ML](-?[\d.]+) (-?[\d.]+)', found)]


def test_linear_axis_places_points_in_proportion():
    svg = drawn(
        x=Axis('x', (0.0, 2.0)),
        y=Axis('y', (0.0, 1.0)),
        lines=(Line('a', [0, 1, 2], [0, 0.5, 1]),),
    )
    (x0, y0), (x1, y1), (x2, y2) = path_of(svg)
    assert x1 - x0 == x2 - x1 > 0
    assert y0 - y1 == y1 - y2 > 0  # up is less


def test_logarithmic_axis_places_decades_evenly():
    svg = drawn(
        x=Axis('x', (1.0, 100.0), logarithmic=True),
        y=Axis('y', (0.0, 1.0)),
        lines=(Line('a', [1, 10, 100], [0, 0, 0]),),
    )
    (x0, _), (x1, _), (x2, _) = path_of(svg)
    assert abs((x1 - x0) - (x2 - x1)) <= 0.11
    assert '>10<' in svg
    assert '>100<' in svg


def test_curves_may_go_back_and_breaks_are_kept():
    svg = drawn(lines=(Line('a', [0, 1, 0.5, np.nan, 0.2, 0.1], [0, 1, 2, 3, 4, 5]),))
    found = re.search(r'stroke-width="1.6"[^>]*d="([^"]*)"', svg).group(1)
    assert found.count('M') == 2
    assert found.count('L') == 3


def test_every_text_is_escaped():
    bad = '<script>"x"</script>'
    svg = str(
        draw_chart(
            bad,
            bad,
            (
                Panel(
                    Axis(bad),
                    Axis(bad),
                    (Line(bad, [0, 1], [0, 1]),),
                    (Points(bad, [0.5], [0.5], shape='cross'),),
                    (Mark('y', 0.5, bad), Mark('x', 0.5, bad)),
                    title=bad,
                    texts=((0.5, 0.5, bad),),
                ),
            ),
            caption=(bad,),
        )
    )
    assert '<script' not in svg
    assert '"x"' not in svg


def test_neighbouring_cells_of_one_colour_become_one_shape():
    cells = Cells(
        np.arange(4.0), np.arange(3.0), (('#111111', '#111111', '#222222'), ('#333333',) * 3)
    )
    svg = drawn(x=Axis('x', (0.0, 3.0)), y=Axis('y', (0.0, 2.0)), cells=cells)
    assert svg.count('fill="#111111"') == 1
    assert svg.count('fill="#222222"') == 1
    assert svg.count('fill="#333333"') == 1


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), min_size=1, max_size=8),
    st.booleans(),
)
def test_any_values_give_finite_coordinates(values, logarithmic):
    svg = drawn(
        y=Axis('y', logarithmic=logarithmic), lines=(Line('a', np.arange(len(values)), values),)
    )
    assert not re.search(r'\b(nan|inf)\b', svg)
