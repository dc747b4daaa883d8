import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import freqresp

from impactscope.errors import ConfigurationError
from impactscope.physics.sensor_model import (
    PAPER_SENSOR,
    SensorModel,
    bandwidth_ratio,
    free_motion,
)

ratios = st.floats(0.0, 3.0)


def test_the_papers_sensor():
    assert PAPER_SENSOR.mass == pytest.approx(1.671, abs=1e-3)
    assert PAPER_SENSOR.natural_angular_frequency == pytest.approx(203.2)
    assert PAPER_SENSOR.damping_ratio == pytest.approx(0.0692)
    # 202.7 rad/s follows; the paper prints 202.0.
    assert 2 * math.pi * PAPER_SENSOR.damped_frequency == pytest.approx(202.71, abs=0.01)
    assert PAPER_SENSOR.resonance_frequency == pytest.approx(32.19, abs=0.01)
    assert PAPER_SENSOR.time_constant == pytest.approx(9.84e-3, rel=1e-3)
    assert PAPER_SENSOR.decay_time == pytest.approx(71.1e-3, rel=1e-3)
    assert 32.37 * bandwidth_ratio(0.07) == pytest.approx(50.12, abs=0.01)
    assert 32.37 * bandwidth_ratio(1.0) == pytest.approx(20.83, abs=0.01)


@given(st.floats(0.01, 2.0))
def test_bandwidth_is_three_decibel_down(zeta):
    sensor = SensorModel.from_modal(30.0, zeta, 50e3)
    assert abs(sensor.frequency_response(sensor.bandwidth)) == pytest.approx(math.sqrt(0.5))


@given(st.floats(0.01, 0.7))
def test_resonance_is_the_largest_response(zeta):
    sensor = SensorModel.from_modal(30.0, zeta, 50e3)
    f = np.linspace(0, 60, 20001)
    gain = np.abs(sensor.frequency_response(f))
    assert gain.max() == pytest.approx(sensor.resonance_peak, rel=1e-4)
    assert abs(f[gain.argmax()] - sensor.resonance_frequency) < 0.2


def test_responses_agree_with_an_independent_implementation():
    s = PAPER_SENSOR
    f = np.geomspace(0.1, 1e3, 50)
    _, expected = freqresp(
        ([s.stiffness], [s.mass, s.damping_constant, s.stiffness]), 2 * np.pi * f
    )
    np.testing.assert_allclose(s.frequency_response(f), expected, rtol=1e-12)
    np.testing.assert_allclose(s.compliance(f) * s.stiffness, expected, rtol=1e-12)
    decibel, phase = s.bode(f)
    np.testing.assert_allclose(10 ** (decibel / 20) * np.exp(1j * np.radians(phase)), expected)
    assert phase.min() > -180
    assert phase.max() < 0


@given(ratios, st.integers(-100, 100), st.integers(-100, 100))
def test_free_motion_satisfies_the_equation_of_motion(zeta, x0, v0):
    assume(x0 or v0)
    w, x0 = 200.0, x0 / 100
    result = solve_ivp(
        lambda _t, y: [y[1], -2 * zeta * w * y[1] - w * w * y[0]],
        (0, 0.05),
        [x0, v0],
        t_eval=np.linspace(0, 0.05, 21),
        method='DOP853',
        rtol=1e-10,
        atol=1e-12,
    )
    x, v = free_motion(result.t, w, zeta, x0, v0)
    scale = abs(x0) + abs(v0) / w
    np.testing.assert_allclose(x / scale, result.y[0] / scale, atol=1e-6)
    np.testing.assert_allclose(v / scale / w, result.y[1] / scale / w, atol=1e-6)


def test_free_motion_is_smooth_through_critical_damping():
    near = [free_motion(0.01, 200.0, z, 1.0, 30.0)[0] for z in (1 - 1e-9, 1.0, 1 + 1e-9)]
    np.testing.assert_allclose(near, near[1], rtol=1e-8)


def test_free_motion_stays_finite_for_long_times():
    x, v = free_motion(1e4, 200.0, [0.0, 0.5, 1.0, 50.0], 1.0, 0.0)
    assert np.isfinite(x).all()
    assert np.isfinite(v).all()


@given(st.floats(0.1, 1e3), st.floats(0, 3), st.floats(1.0, 1e6))
def test_modal_round_trip(frequency, zeta, stiffness):
    sensor = SensorModel.from_modal(frequency, zeta, stiffness)
    assert sensor.natural_frequency == pytest.approx(frequency)
    assert sensor.damping_ratio == pytest.approx(zeta, abs=1e-12)


def test_undamped_limits():
    sensor = SensorModel(1.0, 100.0, 0.0)
    assert sensor.resonance_peak == math.inf
    assert sensor.decay_time == math.inf


@pytest.mark.parametrize('wrong', [(0.0, 1.0, 1.0), (1.0, math.nan, 1.0), (1.0, 1.0, -1.0)])
def test_impossible_sensors_are_refused(wrong):
    with pytest.raises(ConfigurationError, match='sensor'):
        SensorModel(*wrong)
    with pytest.raises(ConfigurationError, match='natural frequency'):
        SensorModel.from_modal(0.0, 0.1, 1.0)
