import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from impactscope.errors import ConfigurationError
from impactscope.physics import contact_model as cm

masses = st.floats(0.1, 100)


def test_permitted_speeds_of_the_hand():
    mass = cm.robot_effective_mass(13.8, 2.0)
    assert mass == pytest.approx(8.9)
    free, clamped = cm.reduced_mass(mass, 0.6), cm.reduced_mass(mass)
    for limit, body, speed in (
        (140, free, 0.682),
        (280, free, 1.364),
        (140, clamped, 0.171),
        (280, clamped, 0.343),
    ):
        assert cm.permitted_speed(limit, body, 75e3) == pytest.approx(speed, abs=6e-4)
    assert cm.free_force(100.0, mass, 0.6) == pytest.approx(25.1, abs=0.05)


@given(masses, masses, st.floats(1e3, 2e5), st.floats(0.01, 2))
def test_energy_force_and_speed_agree(robot, body, stiffness, speed):
    mu = cm.reduced_mass(robot, body)
    force = cm.peak_force(speed, mu, stiffness)
    assert cm.deformation_energy(force, stiffness) == pytest.approx(0.5 * mu * speed**2)
    assert cm.permitted_speed(force, mu, stiffness) == pytest.approx(speed)
    pressure = cm.peak_pressure(speed, mu, stiffness, 1e-4)
    assert cm.permitted_speed_by_pressure(pressure, 1e-4, mu, stiffness) == pytest.approx(speed)
    assert cm.scaled_speed(speed, force, force / 2) == pytest.approx(speed / 2)
    fixed = cm.peak_force(speed, robot, stiffness)
    assert cm.free_force(fixed, robot, body) == pytest.approx(force)
    assert mu < cm.reduced_mass(robot)


def test_two_bodies_integrated():
    robot, body, k, v = 4.0, 2.0, 30e3, 0.5
    mu = cm.reduced_mass(robot, body)
    time = np.linspace(0, cm.contact_time(mu, k), 2001)
    solved = solve_ivp(
        lambda _t, y: [y[2], y[3], -k * (y[0] - y[1]) / robot, k * (y[0] - y[1]) / body],
        (0, time[-1]),
        [0, 0, v, 0],
        t_eval=time,
        rtol=1e-9,
        atol=1e-12,
    )
    force = k * (solved.y[0] - solved.y[1])
    assert force.max() == pytest.approx(cm.peak_force(v, mu, k), rel=1e-5)
    assert force[-1] == pytest.approx(0.0, abs=1e-4)


def test_a_plastic_blow_loses_what_momentum_leaves():
    assert cm.energy_loss_share(1.67, 0.2895) == pytest.approx(0.85, abs=3e-3)
    assert cm.energy_loss_share(1.67, 1.214) == pytest.approx(0.58, abs=3e-3)
    assert cm.energy_loss_share(1.67, 1.214, 1.0) == 0.0


@pytest.mark.parametrize('value', [0.0, -1.0, math.nan, math.inf])
def test_values_out_of_range_are_named(value):
    with pytest.raises(ConfigurationError, match='stiffness'):
        cm.peak_force(1.0, 1.0, value)
    with pytest.raises(ConfigurationError, match='robot_mass'):
        cm.reduced_mass(value)


def test_restitution_and_payload_are_checked():
    with pytest.raises(ConfigurationError, match=r'1\.5'):
        cm.energy_loss_share(1.0, 1.0, 1.5)
    with pytest.raises(ConfigurationError, match='payload'):
        cm.robot_effective_mass(1.0, -1.0)
