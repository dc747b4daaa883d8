"""Spectral estimates against closed forms, eq. 28 against the paper's and the filter's own."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import EstimationError, InputError
from impactscope.estimate.spectrum import bandwidth, estimate_from_spectrum
from impactscope.records import Estimate


def oscillation(n, rate, frequency, damping, phase=-1.2, offset=2.0):
    time = np.arange(n) / rate
    wn = 2 * math.pi * frequency
    wd = wn * math.sqrt(1 - damping**2)
    return 60 * np.exp(-damping * wn * time) * np.cos(wd * time + phase) + offset


def test_bandwidth_of_the_paper():
    assert bandwidth(Estimate(32.37, 0), Estimate(0.07, 0)).value == pytest.approx(50.12, abs=5e-3)
    assert bandwidth(Estimate(32.37, 0), Estimate(1.0, 0)).value == pytest.approx(20.83, abs=5e-3)


@settings(max_examples=100, deadline=None)
@given(frequency=st.floats(0.1, 1e4), damping=st.floats(0, 3))
def test_gain_at_the_bandwidth_is_half_power(frequency, damping):
    ratio = bandwidth(Estimate(frequency, 0), Estimate(damping, 0)).value / frequency
    gain = 1 / abs(1 - ratio**2 + 2j * damping * ratio)
    assert gain == pytest.approx(math.sqrt(0.5), rel=1e-9)


def test_bandwidth_carries_uncertainty_and_covariance():
    rng = np.random.default_rng(1)
    cov = np.array([[0.2**2, 0.7 * 0.2 * 0.004], [0.7 * 0.2 * 0.004, 0.004**2]])
    drawn = rng.multivariate_normal([32.37, 0.07], cov, size=20_000)
    exact = Estimate(0.0, 0.0)
    values = [
        bandwidth(exact._replace(value=f), exact._replace(value=z)).value for f, z in drawn[:5000]
    ]
    stated = bandwidth(Estimate(32.37, 0.2), Estimate(0.07, 0.004), cov[0, 1])
    assert stated.std == pytest.approx(np.std(values), rel=0.06)


def test_bandwidth_of_unknown_uncertainty_is_nan():
    result = bandwidth(Estimate(32.37, math.nan), Estimate(0.07, 0.001))
    assert result.value == pytest.approx(50.12, abs=5e-3)
    assert math.isnan(result.std)


@pytest.mark.parametrize(('frequency', 'damping'), [(-1, 0.1), (10, -0.1)])
def test_bandwidth_refuses_negative_values(frequency, damping):
    with pytest.raises(InputError):
        bandwidth(Estimate(frequency, 0), Estimate(damping, 0))


@settings(max_examples=80, deadline=None)
@given(
    duration=st.floats(0.3, 4),
    frequency=st.floats(15, 150),
    damping=st.floats(0.01, 0.15),
    phase=st.floats(-math.pi, math.pi),
)
def test_stated_uncertainty_holds_the_truth(duration, frequency, damping, phase):
    y = oscillation(int(duration * 1000), 1000, frequency, damping, phase)
    result = estimate_from_spectrum(y, 1000)
    damped = frequency * math.sqrt(1 - damping**2)
    assert abs(result.frequency.value - damped) < 3 * result.frequency.std
    if not math.isnan(result.damping_ratio.value):
        assert abs(result.damping_ratio.value - damping) < 3 * result.damping_ratio.std


@pytest.mark.parametrize('duration', [0.2, 0.5, 1.0, 3.0])
def test_uncertainty_is_no_smaller_than_the_record_allows(duration):
    y = oscillation(int(duration * 1000), 1000, 32.3, 0.07)
    result = estimate_from_spectrum(y, 1000)
    assert result.resolution == pytest.approx(1 / duration)
    assert result.frequency.std >= result.resolution / math.sqrt(12) * (1 - 1e-9)


@pytest.mark.parametrize('duration', [0.15, 0.3, 1.0])
def test_record_length_is_taken_out_of_the_width(duration):
    """Short records widen the peak: uncorrected, 0.15 s would give half as much again."""
    y = oscillation(int(duration * 5000), 5000, 32.3, 0.07, offset=0)
    result = estimate_from_spectrum(y, 5000)
    uncorrected = 0.5 * result.half_power_width / result.frequency.value
    assert abs(result.damping_ratio.value - 0.07) < 0.012
    if duration < 0.2:
        assert uncorrected > 0.1


def test_undamped_line_is_not_resolved():
    y = np.cos(2 * math.pi * 50 * np.arange(1000) / 1000)
    result = estimate_from_spectrum(y, 1000)
    assert result.frequency.value == pytest.approx(50, abs=0.05)
    damping = result.damping_ratio
    assert math.isnan(damping.value) or damping.value < 2 * damping.std


def test_noise_widens_the_uncertainty():
    rng = np.random.default_rng(2)
    clean = oscillation(1000, 1000, 32.3, 0.07)
    errors, stated = [], []
    for _ in range(200):
        result = estimate_from_spectrum(clean + 19 * rng.normal(size=1000), 1000)
        errors.append(result.frequency.value - 32.22)
        stated.append(result.frequency.std)
    assert np.std(errors) < 1.2 * np.median(stated)


def test_constant_has_no_peak():
    with pytest.raises(EstimationError):
        estimate_from_spectrum(np.full(200, 3.0), 1000)
    with pytest.raises(InputError):
        estimate_from_spectrum(np.full(200, math.nan), 1000)
