"""The low-pass of samples in closed form, against SciPy's general design."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from impactscope.physics.mechanisms.low_pass_filter import (
    forgets_by,
    forwards,
    forwards_and_backwards,
    low_pass,
)

RATE = 5000.0  # Hz

orders = st.integers(1, 8)
cutoffs = st.floats(math.log(2.0), math.log(0.49 * RATE)).map(math.exp)  # Hz


@given(orders, cutoffs)
def test_it_is_the_butterworth_of_the_general_design(order: int, cutoff: float) -> None:
    lines = np.linspace(0.0, 0.5 * RATE, 200)
    mine = signal.sosfreqz(low_pass(order, cutoff, RATE), lines, fs=RATE)[1]
    general = signal.butter(order, cutoff, fs=RATE, output='sos')
    np.testing.assert_allclose(
        mine, signal.sosfreqz(general, lines, fs=RATE)[1], rtol=0.0, atol=1e-9
    )


@given(orders, cutoffs)
def test_each_section_passes_what_stays(order: int, cutoff: float) -> None:
    sections = low_pass(order, cutoff, RATE)
    assert sections.shape == (math.ceil(order / 2), 6)
    gains = np.sum(sections[:, :3], axis=1) / np.sum(sections[:, 3:], axis=1)
    np.testing.assert_allclose(gains, 1.0, rtol=1e-8)
    np.testing.assert_allclose(forwards(sections, np.full(50, 3.0), 3.0), 3.0, rtol=1e-8)


@given(orders, st.floats(20.0, 0.49 * RATE))
def test_its_state_at_rest_and_how_it_forgets(order: int, cutoff: float) -> None:
    sections = low_pass(order, cutoff, RATE)
    samples = np.random.default_rng(order).standard_normal(60)
    begun = 2.5 * signal.sosfilt_zi(sections)
    general = signal.sosfilt(sections, samples, zi=begun)[0]
    np.testing.assert_allclose(forwards(sections, samples, 2.5), general, atol=1e-8)
    poles = signal.sos2zpk(sections)[1]
    # two poles that are one are found to the root of a digit
    assert forgets_by(sections) == pytest.approx(float(np.max(np.abs(poles))), abs=1e-7)


def test_smoothing_forgets_as_it_keeps() -> None:
    assert forgets_by(np.array([[0.1, 0.0, 0.0, 1.0, -0.9, 0.0]])) == pytest.approx(0.9)


@pytest.mark.parametrize('order', [1, 2, 3, 4, 8])
def test_both_ways_it_goes_on_at_the_ends_as_scipy_does(order: int) -> None:
    samples = np.cumsum(np.random.default_rng(order).standard_normal(400))
    general = signal.butter(order, 300.0, fs=RATE, output='sos')
    mine = forwards_and_backwards(low_pass(order, 300.0, RATE), samples)
    np.testing.assert_allclose(mine, signal.sosfiltfilt(general, samples), atol=1e-9)


def test_both_ways_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match='9 samples are too few'):
        forwards_and_backwards(low_pass(2, 300.0, RATE), np.zeros(9))
