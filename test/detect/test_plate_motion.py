from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from impactscope.detect.plate_motion import (
    PlateModel,
    fit_pulse,
    fit_ring_down,
    pulse_response,
)

PLATE = PlateModel(203.2, 0.07)
RATE = 10_000.0


def response(times, start, duration, shape, plate=PLATE):
    basis = np.empty((3, times.size))
    pulse_response(
        times[0],
        times[1] - times[0],
        start,
        duration,
        plate.natural_frequency,
        plate.damping_ratio,
        basis,
    )
    return np.asarray(shape) @ basis


@given(st.floats(0.002, 0.05), st.floats(0.0, 0.02), st.floats(0.01, 0.9), st.integers(1, 3))
def test_the_response_solves_the_equation_of_motion(duration, start, damping, term):
    plate = PlateModel(203.2, damping)
    times = np.arange(900) * 1e-4
    shape = np.eye(3)[term - 1]

    def motion(t, state):
        inside = start < t < start + duration
        push = math.sin(term * math.pi * (t - start) / duration) if inside else 0.0
        reading, rate = state
        w = plate.natural_frequency
        return [rate, w * w * (push - reading) - 2 * damping * w * rate]

    exact = solve_ivp(
        motion, (0, times[-1]), [0, 0], t_eval=times, rtol=1e-7, atol=1e-9, max_step=5e-4
    ).y[0]
    assert response(times, start, duration, shape, plate) == pytest.approx(exact, abs=2e-4)


@pytest.mark.parametrize('duration', [0.003, 0.009, 0.015, 0.03])
@pytest.mark.parametrize('shape', [(100, 0, 0), (100, 12, 5), (100, -10, 3)])
def test_a_clean_contact_is_found_within_tens_of_microseconds(duration, shape):
    times = np.arange(1200) / RATE
    reading = response(times, 0.02, duration, shape)
    fit = fit_pulse(reading, RATE, PLATE, 0.024, 0.01)
    assert fit.start == pytest.approx(0.02, abs=1e-4)
    assert fit.duration == pytest.approx(duration, abs=2e-4)


def test_errors_of_a_noisy_contact_stay_near_the_cramer_rao_bound():
    times = np.arange(1200) / RATE
    reading = response(times, 0.02, 0.009, (100, 0, 0))
    sigma = reading.max() / 30
    step = 1e-6
    slopes = np.stack(
        [
            (response(times, 0.02 + step, 0.009, (100, 0, 0)) - reading) / step,
            (response(times, 0.02, 0.009 + step, (100, 0, 0)) - reading) / step,
            reading,
        ]
    )
    bound = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T))) * sigma
    rng = np.random.default_rng(2)
    fits = [
        fit_pulse(reading + rng.normal(0, sigma, times.size), RATE, PLATE, 0.024, sigma)
        for _ in range(60)
    ]
    starts = np.array([fit.start for fit in fits]) - 0.02
    durations = np.array([fit.duration for fit in fits]) - 0.009
    # The shape is left free as well, which costs.
    assert np.sqrt(np.mean(starts**2)) < 2.0 * bound[0]
    assert np.sqrt(np.mean(durations**2)) < 2.0 * bound[1]


def test_two_contacts_are_not_one():
    times = np.arange(1200) / RATE
    reading = response(times, 0.02, 0.009, (100, 0, 0)) + response(times, 0.036, 0.009, (90, 0, 0))
    fit = fit_pulse(reading, RATE, PLATE, 0.024, 0.01)
    assert fit is None or fit.rms > 0.5


def test_a_reading_with_gaps_cannot_be_fitted():
    assert fit_pulse(np.full(500, np.nan), RATE, PLATE, 0.01, 0.1) is None
    assert fit_ring_down(np.full(500, np.nan), RATE, 0.1) is None
    assert fit_pulse(np.zeros(5), RATE, PLATE, 0.0, 0.1) is None


@pytest.mark.parametrize('frequency', [15.0, 32.3, 150.0])
@pytest.mark.parametrize('damping', [0.02, 0.07, 0.2])
def test_the_plate_is_learned_from_its_ring_down(frequency, damping):
    plate = PlateModel(2 * math.pi * frequency, damping)
    times = np.arange(int(25 / frequency * RATE)) / RATE
    noise = np.random.default_rng(1).normal(0, 0.05, times.size)
    reading = response(times, 0.0, 0.2 / frequency, (50, 0, 0), plate)
    begin = int(0.3 / frequency * RATE)
    found, _ = fit_ring_down((reading + noise)[begin:], RATE, 0.05)
    assert found.natural_frequency == pytest.approx(plate.natural_frequency, rel=0.002)
    assert found.damping_ratio == pytest.approx(damping, rel=0.02)


def test_noise_two_modes_and_creep_are_no_ring_down():
    times = np.arange(5000) / RATE
    noise = np.random.default_rng(1).normal(0, 1.0, times.size)
    fall = np.exp(-10 * times)
    assert fit_ring_down(noise, RATE, 1.0) is None
    two = 50 * fall * (np.cos(200 * times) + np.cos(520 * times))
    assert fit_ring_down(two + noise, RATE, 1.0) is None
    assert fit_ring_down(50 * np.exp(-20 * times) + noise, RATE, 1.0) is None
