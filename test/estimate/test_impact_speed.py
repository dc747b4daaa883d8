import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from impactscope.errors import ConfigurationError, EstimationError, InputError
from impactscope.estimate.impact_speed import (
    integrate_span,
    speed_from_contact,
    speed_from_release,
    speed_from_swing,
)
from impactscope.physics.pendulum import Orientation, Pendulum
from impactscope.physics.sensor_model import PAPER_SENSOR
from impactscope.physics.twin.bench import Bench, PendulumBlow
from impactscope.physics.twin.simulate import simulate
from impactscope.records import Estimate

RATE = 10e3


def test_release_carries_every_uncertainty():
    pendulum = Pendulum()
    stds = {'moving_mass': 0.01, 'mass_distance': 1e-3, 'contact_distance': 1e-3}
    angle = Estimate(math.radians(10), math.radians(0.5))
    found = speed_from_release(pendulum, angle, uncertainties=stds)
    rng = np.random.default_rng(1)
    drawn = [
        dataclasses.replace(
            pendulum,
            **{name: rng.normal(getattr(pendulum, name), std) for name, std in stds.items()},
        ).impact_speed(rng.normal(*angle))
        for _ in range(4000)
    ]
    assert found.value == pendulum.impact_speed(angle.value)
    assert found.std == pytest.approx(np.std(drawn), rel=0.05)


@pytest.mark.parametrize('orientation', list(Orientation))
def test_swing_agrees_with_release(orientation):
    pendulum, start = Pendulum(), math.radians(20)
    turn = math.cos if orientation is Orientation.VERTICAL else math.sin
    factor = pendulum.mass_moment * pendulum.gravity / pendulum.inertia

    def hit(_t, y):
        return y[0]

    hit.terminal = True
    solved = solve_ivp(
        lambda _t, y: [-y[1], factor * turn(y[0])],
        (0, 2),
        [start, 0.0],
        events=hit,
        dense_output=True,
        rtol=1e-10,
        atol=1e-12,
    )
    time = np.arange(0, solved.t_events[0][0], 1 / RATE)
    angle = solved.sol(time)[0]
    arc = pendulum.contact_distance
    felt = np.array([(arc * factor - pendulum.gravity) * turn(a) for a in angle])
    noisy = felt + np.random.default_rng(0).normal(0, 0.1, felt.size)
    found = speed_from_swing(
        noisy, RATE, pendulum, Estimate(start, 0.002), orientation, noise_std=0.1, offset_std=0.05
    )
    expected = pendulum.impact_speed(start, orientation)
    assert found.value == pytest.approx(expected, abs=3e-3)
    assert 0 < found.std < 0.05


def contact(mass, speed, layer, lag, push=0.0, exponent=1.0):
    """One contact on a plate on its spring: deceleration and plate displacement."""
    plate_mass, k, c = 1.67, 69e3, 47.0

    def force(y):
        squeeze = np.maximum(y[2] - y[0], 0.0)
        rate = lag * (y[3] - y[1])
        law = layer * (squeeze**exponent / 3e-3 ** (exponent - 1) + rate)
        return np.where(y[2] > y[0], np.maximum(law, 0), 0)

    y = solve_ivp(
        lambda _t, y: [
            y[1],
            (force(y) - c * y[1] - k * y[0]) / plate_mass,
            y[3],
            (push - force(y)) / mass,
        ],
        (0, 0.1),
        [0, 0, 0, speed],
        t_eval=np.arange(0, 0.1, 1 / RATE),
        max_step=1e-4,
        rtol=1e-8,
        atol=1e-11,
    ).y
    f = force(y)
    end = int(np.argmax(f[5:] == 0)) + 5
    return ((f - push) / mass)[:end], y[0][:end], f[:end]


@pytest.mark.parametrize('mass', [1.0, 3.0, 10.0])
@pytest.mark.parametrize('lag', [0.0, 1e-3, 2e-3])
@pytest.mark.parametrize('push', [0.0, 13.0])
@pytest.mark.parametrize('exponent', [1.0, 1.5])
def test_contact_closes_the_gap_whatever_its_law(mass, lag, push, exponent):
    deceleration, plate, force = contact(mass, 0.5, 60e3, lag, push, exponent)
    noisy = deceleration + np.random.default_rng(0).normal(0, 0.08, deceleration.size)
    found = speed_from_contact(noisy, plate, force, RATE, noise_std=0.08, end_std=1e-4)
    assert found.value == pytest.approx(0.5, rel=0.01 if exponent == 1 else 0.035)
    assert abs(found.value - 0.5) < 3 * found.std


def test_a_layer_that_relaxes_is_squeezed_by_more_than_a_lag():
    """The twin's layer at impact rate has two quick branches: parting says too little."""
    pendulum = Pendulum(mass_distance=0.25)
    for angle in (8, 30):
        blow = PendulumBlow(pendulum, math.radians(angle))
        found = simulate(Bench(), blow, sample_rate=RATE, duration=0.05)
        span = found.contacts[0]
        inside = (found.time >= span.start) & (found.time <= span.end)
        speed = speed_from_contact(
            -found['acceleration.impactor'][inside],
            found['force'][inside] / PAPER_SENSOR.stiffness,
            found.contact_force[inside],
            RATE,
        )
        truth = pendulum.impact_speed(math.radians(angle))
        assert speed.value == pytest.approx(truth, rel=0.04)
        assert abs(speed.value - truth) < 2 * speed.std


def test_integral_between_samples():
    t = np.arange(0, 1.01, 0.1)
    assert integrate_span(t**1, 10.0, 0.05, 0.55) == pytest.approx((0.55**2 - 0.05**2) / 2)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match='no wings'):
        speed_from_release(Pendulum(), Estimate(0.1, 0.0), uncertainties={'wings': 1.0})
    with pytest.raises(ConfigurationError, match='above'):
        speed_from_release(Pendulum(), Estimate(-0.1, 0.0))
    with pytest.raises(EstimationError, match='approach'):
        speed_from_swing(np.full(100, -50.0), RATE, Pendulum(), Estimate(0.1, 0.0))
    with pytest.raises(InputError, match='finite'):
        speed_from_swing(np.full(100, np.nan), RATE, Pendulum(), Estimate(0.1, 0.0))
    with pytest.raises(EstimationError, match='3 samples'):
        speed_from_contact(np.ones(3), np.ones(3), np.ones(3), RATE)
    with pytest.raises(EstimationError, match='noise'):
        speed_from_contact(np.ones(50), np.zeros(50), np.ones(50), RATE, offset_std=1.0)
