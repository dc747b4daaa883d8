"""Block means keep what a damped oscillation tells."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.estimate.averaging import amplitude_factor, average_blocks
from impactscope.estimate.free_oscillation import fit_free_oscillation


def oscillation(n, rate, frequency, damping, amplitude=60.0, phase=-1.2):
    time = np.arange(n) / rate
    wn = 2 * math.pi * frequency
    wd = wn * math.sqrt(1 - damping**2)
    return amplitude * np.exp(-damping * wn * time) * np.cos(wd * time + phase) + 2.0


@settings(max_examples=30, deadline=None)
@given(frequency=st.floats(10, 300), damping=st.floats(0, 0.3), n=st.integers(9000, 24_000))
def test_pole_and_amplitude_come_back_exactly(frequency, damping, n):
    rate = 12_800.0
    means, factor = average_blocks(oscillation(n, rate, frequency, damping), rate)
    assert means.size == n // factor
    assert rate / factor >= 20 * frequency
    fit = fit_free_oscillation(means, rate / factor)
    assert fit.natural_frequency.value == pytest.approx(frequency, rel=1e-7)
    assert fit.damping_ratio.value == pytest.approx(damping, abs=1e-7)
    shrunk = amplitude_factor(factor, fit.decay_rate.value, fit.damped_frequency.value, rate)
    assert fit.amplitude.value / shrunk == pytest.approx(60, rel=1e-6)


def test_nothing_is_lost_in_noise():
    rng = np.random.default_rng(1)
    rate = 51_200.0
    y = oscillation(51_200, rate, 32.3, 0.07) + 3 * rng.normal(size=51_200)
    means, factor = average_blocks(y, rate)
    assert factor > 20
    few, all_samples = fit_free_oscillation(means, rate / factor), fit_free_oscillation(y, rate)
    for name in ('natural_frequency', 'damping_ratio'):
        a, b = getattr(few, name), getattr(all_samples, name)
        assert a.std == pytest.approx(b.std, rel=0.1)
        assert abs(a.value - b.value) < 0.2 * b.std


def test_short_records_and_fast_lines_stay_as_they_are():
    short = oscillation(1000, 1000, 32.3, 0.07)
    assert average_blocks(short, 1000)[1] == 1
    assert average_blocks(short, 1000)[0] is short
    assert average_blocks(oscillation(20_000, 1000, 200, 0.001), 1000)[1] == 1


@pytest.mark.parametrize('factor', [1, 7, 40])
def test_amplitude_factor_is_the_blocks_own(factor):
    pole = np.exp(complex(-14.2, 2 * math.pi * 32.2) / 51_200)
    direct = abs(np.mean(pole ** np.arange(factor)))
    assert amplitude_factor(factor, 14.2, 32.2, 51_200.0) == pytest.approx(direct, rel=1e-9)
    assert amplitude_factor(factor, 0.0, 0.0, 51_200.0) == 1.0
