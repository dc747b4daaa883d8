import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from impactscope.errors import InputError
from impactscope.report.decimate import decimate_for_display


def test_one_sample_spikes_survive():
    values = np.sin(np.linspace(0, 20, 358_400))
    values[123_457], values[300_001] = 50.0, -40.0
    time = np.arange(values.size) / 51_200
    t, v = decimate_for_display(time, values, 2000)
    assert v.size <= 2000
    assert v.max() == 50.0
    assert v.min() == -40.0
    assert t[v.argmax()] == time[123_457]
    assert t[v.argmin()] == time[300_001]


def test_short_series_are_left_alone():
    t, v = decimate_for_display([0.0, 1.0, 2.0], [1.0, np.inf, 3.0], 4)
    np.testing.assert_array_equal(t, [0, 1, 2])
    np.testing.assert_array_equal(v, [1, np.nan, 3])


def test_missing_samples_break_the_line():
    values = np.ones(10_000)
    values[4000:4100] = np.nan
    t, v = decimate_for_display(np.arange(10_000.0), values, 500)
    broken = t[np.isnan(v)]
    assert broken.size
    assert ((broken >= 3900) & (broken <= 4200)).all()


@given(
    npst.arrays(np.float64, st.integers(0, 400), elements=st.floats(width=32)),
    st.integers(2, 60),
)
def test_every_point_is_a_sample_in_order_and_the_extremes_stay(values, points):
    time = np.arange(values.size, dtype=float)
    t, v = decimate_for_display(time, values, points)
    assert (np.diff(t) >= 0).all()
    good = np.isfinite(v)
    np.testing.assert_array_equal(v[good], values[t[good].astype(int)])
    finite = values[np.isfinite(values)]
    if finite.size:
        assert v[good].min() == finite.min()
        assert v[good].max() == finite.max()
    else:
        assert not good.any()
    if np.isfinite(values).all():
        assert good.all()
        assert v.size <= max(points, 2)


def test_bad_input_is_named():
    with pytest.raises(InputError, match=r'\(3,\).*\(4,\)'):
        decimate_for_display(np.zeros(3), np.zeros(4), 10)
    with pytest.raises(InputError, match='max_points is 1'):
        decimate_for_display(np.zeros(3), np.zeros(3), 1)
