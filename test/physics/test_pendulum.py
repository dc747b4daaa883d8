import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from impactscope.errors import ConfigurationError
from impactscope.physics.pendulum import Orientation, Pendulum

distances = st.floats(0.0, 0.29)
angles = st.floats(0.01, 1.5)


def test_equivalent_mass_of_the_stated_geometry():
    # Eq. 4 by hand: 0.698 * 0.29^2 / (3 * 0.26^2), and 0.25^2 / 0.26^2 more.
    assert Pendulum(mass_distance=0.0).equivalent_mass == pytest.approx(0.289455, rel=1e-5)
    assert Pendulum(mass_distance=0.25).equivalent_mass == pytest.approx(1.214013, rel=1e-5)


def test_weight_on_the_plate_spans_four_to_thirteen_newton():
    assert Pendulum(mass_distance=0.0).contact_weight() == pytest.approx(3.817, abs=1e-3)
    assert Pendulum(mass_distance=0.25).contact_weight() == pytest.approx(13.247, abs=1e-3)


@given(distances, angles)
def test_energy_of_the_equivalent_mass_is_the_released_one(distance, angle):
    pendulum = Pendulum(mass_distance=distance)
    for orientation in Orientation:
        speed = pendulum.impact_speed(angle, orientation)
        released = pendulum.potential_energy(angle, orientation)
        assert 0.5 * pendulum.equivalent_mass * speed**2 == pytest.approx(released)
        spin = pendulum.kinetic_energy(speed / pendulum.contact_distance)
        assert spin == pytest.approx(released)
        assert pendulum.release_angle(speed, orientation) == pytest.approx(angle, rel=1e-6)


@given(distances, angles)
def test_impact_speed_is_the_printed_formula(d, angle):
    p = Pendulum(mass_distance=d)
    numerator = 3 * (p.rod_mass * p.rod_length + 2 * d) * p.gravity
    common = numerator / (p.rod_mass * p.rod_length**2 + 3 * d**2)
    vertical = 0.26 * math.sqrt(common * math.sin(angle))
    horizontal = 0.26 * math.sqrt(common * (1 - math.cos(angle)))
    assert p.impact_speed(angle) == pytest.approx(vertical)
    assert p.impact_speed(angle, Orientation.HORIZONTAL) == pytest.approx(horizontal, rel=1e-6)


def test_weight_is_the_slope_of_potential_energy():
    p, step = Pendulum(), 1e-6
    for orientation in Orientation:
        for x in (-0.02, 0.0, 0.01):
            low, high = (math.asin(-(x + s) / p.contact_distance) for s in (step, -step))
            slope = p.potential_energy(high, orientation) - p.potential_energy(low, orientation)
            # The contact point moves by dx along its tangent, that is dx/cos(angle) of arc; the
            # force is the component along the sensor's axis times the lever, moment over l.
            arc = p.contact_distance * (high - low)
            weight = p.contact_weight(x, orientation)
            assert slope / arc == pytest.approx(weight, rel=1e-4, abs=1e-4)


def test_restoring_stiffness_gives_the_period_of_a_small_swing():
    p = Pendulum()
    stiffness = p.restoring_stiffness(Orientation.HORIZONTAL)
    assert p.swing_period == pytest.approx(2 * np.pi * math.sqrt(p.equivalent_mass / stiffness))
    swing = solve_ivp(
        lambda _t, y: [y[1], p.contact_weight(y[0], Orientation.HORIZONTAL) / p.equivalent_mass],
        (0, p.swing_period / 4),
        [1e-3, 0.0],
        rtol=1e-9,
        atol=1e-12,
    )
    assert swing.y[0, -1] == pytest.approx(0.0, abs=1e-7)
    assert p.restoring_stiffness() == 0.0


@pytest.mark.parametrize(
    'wrong',
    [
        {'rod_mass': -1.0},
        {'contact_distance': 0.0},
        {'gravity': math.nan},
        {'rod_mass': 0.0, 'moving_mass': 0.0},
    ],
)
def test_impossible_pendulums_are_refused(wrong):
    with pytest.raises(ConfigurationError, match='pendulum'):
        Pendulum(**wrong)


def test_impossible_releases_are_refused():
    with pytest.raises(ConfigurationError, match=r'-0\.1'):
        Pendulum().impact_speed(-0.1)
    with pytest.raises(ConfigurationError, match='99'):
        Pendulum().release_angle(99.0)
    with pytest.raises(ConfigurationError, match='reach'):
        Pendulum().contact_weight(0.3)
