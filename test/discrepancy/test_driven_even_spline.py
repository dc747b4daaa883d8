"""The compiled spline through even samples is SciPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import CubicSpline

from impactscope.discrepancy.driven.models.even_spline import between_even_samples


@given(
    arrays(np.float64, st.integers(4, 40), elements=st.floats(-1e3, 1e3)),
    arrays(np.float64, 20, elements=st.floats(-3.0, 43.0)),
)
def test_it_is_the_spline_of_scipy_within_and_beyond_the_samples(samples, places):
    expected = CubicSpline(np.arange(samples.size), samples)(places)
    error = np.abs(between_even_samples(samples, places) - expected)
    assert np.all(error <= 1e-9 * (1.0 + np.abs(expected) + np.max(np.abs(samples))))


def test_samples_stay_as_they_are():
    samples = np.random.default_rng(1).normal(size=50)
    assert between_even_samples(samples, np.arange(50.0)) == pytest.approx(samples, abs=1e-12)


@pytest.mark.parametrize('count', [1, 2, 3])
def test_few_samples_have_lines_between_them(count):
    samples = np.arange(count) * 2.0
    assert between_even_samples(samples, np.array([0.0, count - 1.0]))[-1] == samples[-1]
