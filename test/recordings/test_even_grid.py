"""Samples of uneven times on an even grid: exact cases, gaps, bad times."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from impactscope.errors import InputError
from impactscope.recordings.even_grid import LOST, even_grid


def test_even_times_stay_as_they_are():
    time = 3.0 + np.arange(50) / 200.0
    values = np.random.default_rng(0).normal(size=50)
    made = even_grid(time, [values])
    assert made.rate == 200.0
    assert (made.repeated, made.lost) == (0, 0)
    np.testing.assert_allclose(made.columns[0], values, atol=1e-9)


@example(seed=1, scatter=1e-13)  # its last time is by rounding before the grid's
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.45))
@settings(max_examples=30, deadline=None)
def test_a_line_is_a_line_whatever_the_times(seed, scatter):
    rng = np.random.default_rng(seed)
    time = np.arange(200) * 0.01 + rng.uniform(0.0, scatter * 0.01, 200)
    made = even_grid(time, [2.0 - 3.0 * time], rate=100.0)
    at = time[0] + np.arange(made.columns[0].size) / 100.0
    np.testing.assert_allclose(made.columns[0], 2.0 - 3.0 * at, atol=1e-9)


def test_steps_of_an_encoder_are_not_overshot():
    time = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 300))
    steps = np.floor(8.0 * time)
    made = even_grid(time, [steps], rate=1000.0)
    there = made.columns[0][np.isfinite(made.columns[0])]
    assert there.min() >= 0.0
    assert there.max() <= 7.0


def test_rows_of_one_time_count_as_their_mean():
    time = np.array([0.0, 0.1, 0.1, 0.2, 0.3])
    made = even_grid(time, [np.array([0.0, 1.0, 3.0, 4.0, 6.0])])
    assert made.repeated == 1
    np.testing.assert_allclose(made.columns[0], [0.0, 2.0, 4.0, 6.0])


def test_a_gap_and_missing_values_are_not_made_up():
    time = np.delete(np.arange(100) * 0.01, slice(40, 50))
    values = np.ones(time.size)
    values[70:80] = np.nan
    made = even_grid(time, [values], rate=100.0)
    lost = np.flatnonzero(np.isnan(made.columns[0]))
    np.testing.assert_array_equal(lost, [*range(40, 50), *range(80, 90)])
    assert made.lost == 20


def test_single_late_samples_are_filled_in():
    time = np.delete(np.arange(100) * 0.01, [40, 60])
    made = even_grid(time, [time], rate=100.0)
    assert LOST > 2.0
    assert made.lost == 0


def test_bad_times():
    values = np.zeros(3)
    with pytest.raises(InputError, match='row 2: the time runs backwards'):
        even_grid(np.array([0.0, 1.0, 0.5]), [values])
    with pytest.raises(InputError, match='row 1: the time is nan'):
        even_grid(np.array([0.0, np.nan, 1.0]), [values])
    with pytest.raises(InputError, match='different times'):
        even_grid(np.zeros(3), [values])
    with pytest.raises(InputError, match='finite samples'):
        even_grid(np.arange(3.0), [np.full(3, np.nan)])
