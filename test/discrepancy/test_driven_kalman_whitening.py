"""The force of a hammer, and residuals that its noise colours."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from impactscope.discrepancy.driven.noise.kalman_whitening import hammer_force, whitener
from impactscope.discrepancy.driven.noise.quantisation import step_of
from impactscope.discrepancy.driven.systems.plate import white_level
from impactscope.discrepancy.evidence import is_white

PERIOD = 1e-4
PLATE = (1.5, 20.0, 1.5 * (2 * math.pi * 30.0) ** 2)


def blow(samples=4000, begin=1000, length=60, peak=100.0, power=1.5):
    force = np.zeros(samples)
    force[begin : begin + length] = peak * np.sin(np.pi * np.arange(length) / length) ** power
    return force


def answer(force):
    """Acceleration of the plate under a force, in discrete time."""
    mass, damping, stiffness = PLATE
    rates = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    push, through = np.array([[0.0], [1 / mass]]), np.array([[1 / mass]])
    system = signal.cont2discrete((rates, push, rates[1:], through), PERIOD, 'zoh')
    above, below = signal.ss2tf(*system[:4])
    return signal.lfilter(above[0], below, force)


def test_the_force_is_zero_between_blows_and_keeps_its_impulse():
    rng = np.random.default_rng(1)
    true = blow() + blow(begin=2500, peak=30.0)
    found = hammer_force(true + 0.05 * rng.standard_normal(true.size) + 0.4, PERIOD)
    assert found is not None
    assert len(found.blows) == 2
    assert found.noise == pytest.approx(0.05, rel=0.1)
    outside = np.ones(true.size, dtype=bool)
    for first, last in found.blows:
        outside[first:last] = False
        impulse = np.sum(found.force[first:last]) - np.sum(true[first:last])
        assert abs(impulse) < 4 * 0.05 * math.sqrt(last - first)
    assert np.all(found.force[outside] == 0.0)
    assert np.all(true[outside] == 0.0)
    assert np.std((found.force - true)[~outside]) < 0.05  # smoothing takes some noise away


@given(st.floats(1.2, 3.0), st.integers(30, 120), st.floats(5.0, 500.0))
@settings(max_examples=30, deadline=None)
def test_smoothing_leaves_a_blow_as_it_is(power, length, peak):
    true = blow(length=length, peak=peak, power=power)
    noise = 0.02
    samples = true + noise * np.random.default_rng(2).standard_normal(true.size)
    found = hammer_force(samples, PERIOD)
    assert found is not None
    assert float(np.std((found.force - true)[980:1140])) < 1.2 * noise


@pytest.mark.parametrize('power', [1.0, 1.5, 2.0])
@pytest.mark.parametrize('length', [8, 16, 32, 80])
def test_smoothing_errs_less_than_the_noise(power, length):
    """Of few samples a parabola takes the crest away, alike in every blow: no noise does that."""
    true = blow(samples=2000, length=length, peak=200.0, power=power)
    noise, wrong, errors = 0.1, [], []
    for seed in range(30):
        samples = true + noise * np.random.default_rng(seed).standard_normal(true.size)
        found = hammer_force(samples, PERIOD)
        assert found is not None
        ((first, last),) = found.blows
        errors.append((found.force - true)[990 : 1010 + length] / noise)
        wrong.append(np.mean((found.force - true)[first:last] ** 2) / noise**2)
    assert np.mean(wrong) < 1.1
    assert np.sqrt(np.mean(np.mean(errors, axis=0) ** 2)) < 0.6  # what all blows have in common


@pytest.mark.parametrize('kind', ['shaker', 'quiet', 'spike', 'long'])
def test_what_is_no_hammer(kind):
    rng = np.random.default_rng(3)
    noise = 0.05 * rng.standard_normal(4000)
    force = {
        'shaker': 10.0 * rng.standard_normal(4000),
        'quiet': noise,
        'spike': noise + 50.0 * (np.arange(4000) == 1000),
        'long': noise + 20.0 * (np.arange(4000) > 3000) * (np.arange(4000) < 3999),
    }[kind]
    assert hammer_force(force, PERIOD if kind != 'long' else 1e-3) is None


def test_innovations_of_the_right_model_are_white_and_of_unit_variance():
    """The force's noise rings in the plate; the filter takes that out."""
    rng = np.random.default_rng(4)
    true = blow(samples=8000, begin=500)
    residuals, whitened = [], []
    for _ in range(12):
        error = 0.3 * rng.standard_normal(true.size)
        found = hammer_force(true + error, PERIOD)
        assert found is not None
        residual = answer(true) - answer(found.force) + 0.05 * rng.standard_normal(true.size)
        turn = whitener(PLATE, 2, PERIOD, 0.05, found, true.size)
        residuals.append(residual[600:])
        whitened.append(turn(residual)[600:])
    assert not is_white(np.concatenate(residuals))
    together = np.concatenate(whitened)
    assert is_white(together)
    assert np.mean(together**2) == pytest.approx(1.0, abs=5 * math.sqrt(2 / together.size))


def test_an_exact_force_leaves_residuals_as_they_are():
    residual = np.random.default_rng(5).standard_normal(500)
    turn = whitener(PLATE, 2, PERIOD, 0.5, None, residual.size)
    np.testing.assert_allclose(turn(residual), residual / 0.5, rtol=1e-12)


def test_level_of_noise_below_lines():
    rng = np.random.default_rng(6)
    time = PERIOD * np.arange(20_000)
    noise = 0.2 * rng.standard_normal(time.size)
    ringing = 5.0 * np.exp(-9.0 * time) * np.sin(2 * math.pi * 3600.0 * time)
    assert white_level(noise) == pytest.approx(0.2, rel=0.03)
    assert white_level(noise + ringing) == pytest.approx(0.2, rel=0.1)
    steps = 0.3 * np.round(noise / 0.3)
    assert white_level(steps) == pytest.approx(float(np.std(steps)), rel=0.03)


@given(st.floats(1e-3, 1.0), st.floats(0.5, 100.0))
@settings(max_examples=40, deadline=None)
def test_steps_of_a_channel(step, size):
    """Found in single precision however fine against the signal; none where there are none."""
    rng = np.random.default_rng(7)
    samples = size * np.sin(np.arange(4000) / 20.0) * np.exp(-np.arange(4000) / 900.0)
    samples = samples + 0.1 * rng.standard_normal(samples.size)
    assert step_of(samples.astype(np.float32).astype(float)) == 0.0
    rounded = (step * np.round(samples / step)).astype(np.float32).astype(float)
    assert step_of(rounded) == pytest.approx(step, rel=1e-3)
