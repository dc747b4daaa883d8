import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import lsim

from impactscope.errors import ConfigurationError
from impactscope.physics import shock_response as sr
from impactscope.physics.sensor_model import PAPER_SENSOR, SensorModel

TIME = np.linspace(0, 0.2, 40001)


def simulated(force, sensor):
    system = ([sensor.stiffness], [sensor.mass, sensor.damping_constant, sensor.stiffness])
    return lsim(system, force, TIME)[1]


@pytest.mark.parametrize('zeta', [0.0, 0.07, 0.9999999, 1.0, 2.5])
@pytest.mark.parametrize('contact', [5e-3, 1 / 64.74, 50e-3])
def test_pulses_agree_with_a_simulated_sensor(zeta, contact):
    sensor = SensorModel.from_modal(32.37, zeta, 69e3)
    inside = contact >= TIME
    sine = np.where(inside, np.sin(np.pi * TIME / contact), 0.0)
    versine = np.where(inside, (1 - np.cos(2 * np.pi * TIME / contact)) / 2, 0.0)
    for force, response in (
        (sine, sr.half_sine_response(TIME, contact, sensor)),
        (versine, sr.versine_response(TIME, contact, sensor)),
    ):
        np.testing.assert_allclose(response, simulated(force, sensor), atol=2e-5)


def test_resonance_without_damping_has_its_own_limit():
    sensor = SensorModel.from_modal(32.0, 0.0, 69e3)
    near = [sr.half_sine_response(TIME, 1 / 64 * (1 + e), sensor) for e in (-1e-5, 0.0, 1e-5)]
    np.testing.assert_allclose(near[0], near[1], atol=1e-4)
    np.testing.assert_allclose(near[2], near[1], atol=1e-4)


def test_double_step():
    response = sr.staircase_response(TIME, [0.0, 0.05], [1.0, -1.0], PAPER_SENSOR)
    w, zeta = PAPER_SENSOR.natural_angular_frequency, PAPER_SENSOR.damping_ratio
    overshoot = 1 + math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2))
    assert response.max() == pytest.approx(overshoot, abs=1e-4)
    force = np.where(TIME < 0.05, 1.0, 0.0)
    step = TIME[1] * w  # lsim takes the edge as a ramp of one sample
    np.testing.assert_allclose(response, simulated(force, PAPER_SENSOR), atol=step)


@pytest.mark.parametrize(
    ('milliseconds', 'ratio'),
    [(5, 0.57), (8.6, 0.93), (15, 1.39), (25.5, 1.60), (30, 1.59), (50, 1.34), (100, 1.09)],
)
def test_peak_error_of_the_papers_sensor(milliseconds, ratio):
    assert sr.peak_ratio(0.07, milliseconds * 1e-3 * 32.37) == pytest.approx(ratio, abs=5e-3)


def test_critically_damped_sensor_reads_low_throughout():
    assert sr.peak_ratio(1.0, 0.010 * 32.37) == pytest.approx(0.43, abs=5e-3)
    assert sr.peak_ratio(1.0, 0.030 * 32.37) == pytest.approx(0.81, abs=5e-3)
    assert sr.largest_peak_ratio(1.0) == (math.inf, 1.0)
    assert sr.unity_contact_ratio(1.0) == math.inf


def test_where_under_reading_turns_into_over_reading():
    assert sr.unity_contact_ratio(0.07) / 32.37 == pytest.approx(9.4e-3, abs=5e-5)
    contact, ratio = sr.largest_peak_ratio(0.07)
    assert contact / 32.37 == pytest.approx(25.5e-3, abs=5e-4)
    assert ratio == pytest.approx(1.603, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 1.5), st.floats(0.02, 12))
@example(0.03125, 0.5)  # the peak comes right before the force ends
@example(2.3e-308, 0.5)  # resonance, as good as no damping
def test_peak_ratio_is_the_largest_of_a_dense_response(zeta, ratio):
    sensor = SensorModel.from_modal(1.0, zeta, 1.0)
    t = np.linspace(0, ratio + 3, 60001)
    dense = sr.half_sine_response(t, ratio, sensor)[t <= ratio + 0.75].max()
    assert sr.peak_ratio(zeta, ratio) == pytest.approx(dense, abs=1e-5)


def test_short_blows_follow_their_impulse():
    # A blow far shorter than the period: peak = impulse x w, impulse 2 Tc/pi.
    assert sr.peak_ratio(0.0, 1e-3) == pytest.approx(2 * math.pi * 2e-3 / math.pi, rel=1e-4)


def test_map_is_the_function_on_a_grid():
    grid = sr.peak_ratio_map([0.07, 1.0], [0.3, 1.0, 3.0])
    assert grid.shape == (2, 3)
    assert grid[1, 2] == sr.peak_ratio(1.0, 3.0)


@pytest.mark.parametrize(
    ('zeta', 'tolerance'), [(0.07, 0.05), (0.5, 0.05), (0.02, 0.1), (1.0, 0.02)]
)
def test_every_longer_contact_is_read_within_tolerance(zeta, tolerance):
    least = sr.shortest_contact_ratio(zeta, tolerance)
    longer = np.linspace(least + 1e-6, 6 * least, 400)
    assert np.abs(sr.peak_ratio_map(zeta, longer) - 1).max() <= tolerance + 1e-9
    assert abs(sr.peak_ratio(zeta, least - 1e-3) - 1) > tolerance


def test_a_better_sensor_is_lighter_and_damped():
    best = sr.required_sensor(5e-3, 0.05, 75e3)
    assert 0.4 < best.sensor.damping_ratio < 0.7
    for zeta in (0.07, 0.4, 1.0):
        other = sr.required_sensor(5e-3, 0.05, 75e3, damping_ratio=zeta)
        assert other.largest_plate_mass < best.largest_plate_mass
    contact = np.geomspace(5e-3, 0.5, 60) * best.sensor.natural_frequency
    assert np.abs(sr.peak_ratio_map(best.sensor.damping_ratio, contact) - 1).max() < 0.0501
    assert best.largest_plate_mass < PAPER_SENSOR.mass / 10


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigurationError, match='contact time'):
        sr.half_sine_response(TIME, 0.0, PAPER_SENSOR)
    with pytest.raises(ConfigurationError, match='damping ratio'):
        sr.peak_ratio(-0.1, 1.0)
    with pytest.raises(ConfigurationError, match=r'\(0, 1\)'):
        sr.shortest_contact_ratio(0.5, 0.0)
    with pytest.raises(ConfigurationError, match='no contact'):
        sr.shortest_contact_ratio(0.0, 1e-4)
