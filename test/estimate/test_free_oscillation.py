"""Fit of the free oscillation against closed forms, the Cramér-Rao bound and other fitters."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import curve_fit

from impactscope.errors import EstimationError, InputError
from impactscope.estimate.free_oscillation import fit_free_oscillation

PAPER_FREQUENCY = 203.2 / (2 * math.pi)  # Hz, section 3.1.1
PAPER_DAMPING = 0.0692


def oscillation(time, frequency, damping, amplitude=60.0, phase=-1.2, offset=2.0):
    """Eq. 27; frequency is the natural one in Hz."""
    wn = 2 * math.pi * frequency
    wd = wn * math.sqrt(1 - damping**2)
    return amplitude * np.exp(-damping * wn * time) * np.cos(wd * time + phase) + offset


def eq26(t, b1, b2, b3, b4, b5):
    return b1 * np.exp(-b2 * t) * np.cos(2 * np.pi / b3 * t + b4) + b5


def cramer_rao(time, frequency, damping, amplitude, phase, noise):
    """Bound on the standard deviations of eq. 27's parameters, by central differences."""
    p = np.array([frequency, damping, amplitude, phase, 0.0])
    columns = []
    for k in range(5):
        step = np.zeros(5)
        step[k] = 1e-6 * max(abs(p[k]), 1.0)
        columns.append((oscillation(time, *(p + step)) - oscillation(time, *(p - step))) / 2e-6)
        columns[-1] /= max(abs(p[k]), 1.0)
    j = np.array(columns).T
    return noise * np.sqrt(np.diag(np.linalg.inv(j.T @ j)))


def test_noise_free_to_rounding():
    t = np.arange(1000) / 1000
    fit = fit_free_oscillation(oscillation(t, 32.3, 0.07), 1000)
    assert fit.natural_frequency.value == pytest.approx(32.3, rel=1e-9)
    assert fit.damping_ratio.value == pytest.approx(0.07, rel=1e-9)
    assert fit.amplitude.value == pytest.approx(60, rel=1e-9)
    assert fit.phase.value == pytest.approx(-1.2, rel=1e-9)
    assert fit.offset.value == pytest.approx(2, rel=1e-9)
    assert fit.damped_frequency.value == pytest.approx(32.3 * math.sqrt(1 - 0.07**2), rel=1e-9)
    assert fit.decay_rate.value == pytest.approx(0.07 * 2 * math.pi * 32.3, rel=1e-9)
    assert fit.rmse < 1e-9
    assert fit.r_squared == pytest.approx(1, abs=1e-12)
    assert fit.white


def test_paper_values_come_back():
    t = np.arange(2000) / 2000
    fit = fit_free_oscillation(oscillation(t, PAPER_FREQUENCY, PAPER_DAMPING), 2000)
    assert 2 * math.pi * fit.natural_frequency.value == pytest.approx(203.2, rel=1e-9)
    # What follows from the equations, where the paper prints 202.0 rad/s.
    assert 2 * math.pi * fit.damped_frequency.value == pytest.approx(202.713, abs=5e-4)
    assert 69000 / (2 * math.pi * fit.natural_frequency.value) ** 2 == pytest.approx(
        1.67, abs=2e-3
    )


@settings(max_examples=60, deadline=None)
@given(
    frequency=st.floats(6, 200),
    damping=st.floats(0.0, 0.4),
    amplitude=st.floats(1e-3, 1e5),
    phase=st.floats(-math.pi, math.pi),
    relative_offset=st.floats(-10, 10),
    duration=st.floats(0.6, 2.0),
)
def test_any_oscillation_is_recovered(
    frequency, damping, amplitude, phase, relative_offset, duration
):
    t = np.arange(int(duration * 1000)) / 1000
    offset = relative_offset * amplitude
    fit = fit_free_oscillation(oscillation(t, frequency, damping, amplitude, phase, offset), 1000)
    assert fit.natural_frequency.value == pytest.approx(frequency, rel=1e-7)
    assert fit.damping_ratio.value == pytest.approx(damping, abs=1e-7)
    assert fit.amplitude.value == pytest.approx(amplitude, rel=1e-6)
    assert math.cos(fit.phase.value - phase) == pytest.approx(1, abs=1e-9)
    assert fit.offset.value == pytest.approx(offset, abs=1e-6 * amplitude)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-4, 1e4), shift=st.floats(-1e3, 1e3))
def test_unit_and_offset_do_not_matter(seed, scale, shift):
    t = np.arange(500) / 1000
    y = oscillation(t, 32.3, 0.07) + np.random.default_rng(seed).normal(size=t.size)
    one, other = fit_free_oscillation(y, 1000), fit_free_oscillation(scale * (y + shift), 1000)
    assert other.natural_frequency.value == pytest.approx(one.natural_frequency.value, rel=1e-6)
    assert other.damping_ratio.std == pytest.approx(one.damping_ratio.std, rel=1e-4)
    assert other.amplitude.value == pytest.approx(scale * one.amplitude.value, rel=1e-5)
    assert other.offset.value == pytest.approx(scale * (one.offset.value + shift), rel=1e-5)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), factor=st.floats(0.1, 10))
def test_time_scales(seed, factor):
    t = np.arange(500) / 1000
    y = oscillation(t, 32.3, 0.07) + np.random.default_rng(seed).normal(size=t.size)
    one, other = fit_free_oscillation(y, 1000), fit_free_oscillation(y, 1000 * factor)
    assert other.natural_frequency.value == pytest.approx(
        factor * one.natural_frequency.value, rel=1e-9
    )
    assert other.damping_ratio.value == pytest.approx(one.damping_ratio.value, rel=1e-9)


@pytest.mark.parametrize('decibel', [40, 20, 10])
def test_efficient_unbiased_and_covering(decibel):
    """Looser than the benchmark, which has the trials to be strict."""
    rng = np.random.default_rng(decibel)
    t = np.arange(1000) / 1000
    noise = 60 / 10 ** (decibel / 20)
    bound = cramer_rao(t, 32.3, 0.07, 60, -1.2, noise)
    clean = oscillation(t, 32.3, 0.07)
    trials = 600
    values = np.empty((trials, 4))
    for k in range(trials):
        fit = fit_free_oscillation(clean + noise * rng.normal(size=t.size), 1000)
        values[k] = (*fit.natural_frequency, *fit.damping_ratio)
    for column, truth, limit in ((0, 32.3, bound[0]), (2, 0.07, bound[1])):
        error = values[:, column] - truth
        assert error.std() == pytest.approx(limit, rel=0.13)  # 4.5 standard errors
        assert abs(error.mean()) < 4.5 * limit / math.sqrt(trials)
        covered = np.mean(np.abs(error) < 1.96 * values[:, column + 1])
        assert 0.915 < covered < 0.985


def test_joint_covariance_is_right():
    rng = np.random.default_rng(7)
    t = np.arange(400) / 1000
    clean = oscillation(t, 32.3, 0.07)
    rows, covariances = [], []
    for _ in range(800):
        fit = fit_free_oscillation(clean + rng.normal(size=t.size), 1000)
        rows.append(
            [e.value for e in (fit.natural_frequency, fit.damping_ratio, fit.amplitude)]
            + [fit.phase.value, fit.offset.value]
        )
        covariances.append(fit.covariance)
    seen, stated = np.cov(np.array(rows).T), np.mean(covariances, axis=0)
    scale = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    assert np.abs(seen / scale - stated / scale).max() < 0.2


def test_never_fails_where_curve_fit_from_the_truth_succeeds():
    rng = np.random.default_rng(11)
    for _ in range(60):
        rate = float(rng.choice([1000.0, 5000.0]))
        t = np.arange(int(rate * rng.uniform(0.3, 1.5))) / rate
        frequency = math.exp(rng.uniform(math.log(5 / t[-1]), math.log(rate / 5)))
        damping = math.exp(rng.uniform(math.log(0.003), math.log(0.4)))
        noise = 10 ** rng.uniform(-3, -0.9)
        phase, offset = rng.uniform(-math.pi, math.pi), rng.normal()
        decay = damping * 2 * math.pi * frequency
        if 0.25 * rate / decay / noise**2 < 60:  # too little to see, for anyone
            continue
        y = oscillation(t, frequency, damping, 1, phase, offset)
        y += noise * rng.normal(size=t.size)
        damped = frequency * math.sqrt(1 - damping**2)
        best, _ = curve_fit(eq26, t, y, p0=[1, decay, 1 / damped, phase, offset])
        residual = np.sum((y - eq26(t, *best)) ** 2)
        fit = fit_free_oscillation(y, rate)
        assert fit.rmse**2 * y.size <= residual * (1 + 1e-6)


def test_agrees_with_lmfit():
    import lmfit

    rng = np.random.default_rng(3)
    t = np.arange(1000) / 1000
    y = oscillation(t, 32.3, 0.07) + 0.6 * rng.normal(size=t.size)
    other = lmfit.Model(eq26).fit(y, t=t, b1=55, b2=13, b3=1 / 32, b4=-1.1, b5=1.5)
    fit = fit_free_oscillation(y, 1000)
    assert fit.decay_rate.value == pytest.approx(other.params['b2'].value, rel=1e-4)
    assert fit.decay_rate.std == pytest.approx(other.params['b2'].stderr, rel=0.02)
    assert fit.amplitude.std == pytest.approx(other.params['b1'].stderr, rel=0.02)
    assert 1 / fit.damped_frequency.value == pytest.approx(other.params['b3'].value, rel=1e-6)


def test_model_and_residual():
    rng = np.random.default_rng(5)
    t = np.arange(800) / 1000
    y = oscillation(t, 32.3, 0.07) + rng.normal(size=t.size)
    fit = fit_free_oscillation(y, 1000)
    assert np.sqrt(np.mean(fit.residuals(y) ** 2)) == pytest.approx(fit.rmse, rel=1e-9)
    assert fit.evaluate(0.0) == pytest.approx(
        fit.amplitude.value * math.cos(fit.phase.value) + fit.offset.value
    )
    assert fit.r_squared == pytest.approx(1 - fit.rmse**2 / y.var(), rel=1e-9)


def test_start_leads_to_the_same_minimum():
    rng = np.random.default_rng(6)
    t = np.arange(800) / 1000
    y = oscillation(t, 32.3, 0.07) + rng.normal(size=t.size)
    own, given_start = fit_free_oscillation(y, 1000), fit_free_oscillation(y, 1000, start=(31, 10))
    assert own.natural_frequency.value == pytest.approx(
        given_start.natural_frequency.value, abs=1e-2 * own.natural_frequency.std
    )


def test_coloured_noise_widens_the_uncertainty():
    """Noise below 100 Hz has ten times the density at 32 Hz that its variance suggests."""
    rng = np.random.default_rng(8)
    t = np.arange(10_000) / 10_000
    clean = oscillation(t, 32.3, 0.07)
    errors, stated = [], []
    for _ in range(150):
        spectrum = np.fft.rfft(rng.normal(size=t.size))
        spectrum[101:] = 0
        fit = fit_free_oscillation(clean + np.fft.irfft(spectrum, t.size), 10_000)
        assert not fit.white
        errors.append(fit.natural_frequency.value - 32.3)
        stated.append(fit.natural_frequency.std)
    assert np.std(errors) / math.sqrt(np.mean(np.square(stated))) == pytest.approx(1, abs=0.3)


def test_white_noise_is_called_white():
    rng = np.random.default_rng(9)
    t = np.arange(1000) / 1000
    clean = oscillation(t, 32.3, 0.07)
    white = [fit_free_oscillation(clean + rng.normal(size=1000), 1000).white for _ in range(300)]
    assert np.mean(white) > 0.99


def test_noise_alone_is_not_significant():
    rng = np.random.default_rng(10)
    taken = 0
    for _ in range(300):
        try:
            taken += fit_free_oscillation(rng.normal(size=500), 1000).significance < 1e-3
        except EstimationError:
            continue
    assert taken <= 3


@pytest.mark.parametrize(
    ('values', 'rate', 'error', 'words'),
    [
        (np.zeros((2, 50)), 1000, InputError, 'shape'),
        (np.zeros(50), 0, InputError, 'rate'),
        (np.zeros(50), math.nan, InputError, 'rate'),
        (np.r_[np.zeros(50), math.nan], 1000, InputError, 'finite'),
        (np.r_[np.zeros(50), math.inf], 1000, InputError, 'finite'),
        (np.zeros(50), 1000, EstimationError, 'vary'),
        (np.full(50, 7.5), 1000, EstimationError, 'vary'),
        (np.arange(5.0), 1000, EstimationError, '5 samples'),
    ],
)
def test_bad_input(values, rate, error, words):
    with pytest.raises(error, match=words):
        fit_free_oscillation(values, rate)


def test_start_outside_the_band_is_refused():
    with pytest.raises(InputError, match='start'):
        fit_free_oscillation(np.arange(50.0), 1000, start=(600, 1))


@pytest.mark.parametrize('periods', [0.3, 0.7])
def test_less_than_a_period_cannot_tell(periods):
    t = np.arange(200) / 1000
    y = oscillation(t, periods / t[-1], 0.05) + 0.1 * np.random.default_rng(1).normal(size=200)
    with pytest.raises(EstimationError):
        fit_free_oscillation(y, 1000)


def test_overdamped_response_cannot_tell():
    t = np.arange(1000) / 1000
    y = 60 * (np.exp(-20 * t) - np.exp(-60 * t))
    with pytest.raises(EstimationError):
        fit_free_oscillation(y + 0.01 * np.random.default_rng(2).normal(size=1000), 1000)
