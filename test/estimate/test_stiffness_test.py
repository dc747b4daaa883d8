import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import InputError
from impactscope.estimate.stiffness_test import analyse_compression, moving_mass, split_strokes
from impactscope.records import Estimate

SPEED = 1e-3 / 60  # m/s, the paper's 1 mm/min


def ramps(peaks, rate=2.0):
    corners = [0.0]
    for peak in peaks:
        corners += [peak, 0.0]
    turns = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(corners)) / SPEED)))
    time = np.arange(0, turns[-1], 1 / rate)
    return np.interp(time, turns, corners)


def spring(u, stiffness=69e3, seed=0, noise=0.5, friction=0.0):
    rng = np.random.default_rng(seed)
    return stiffness * u + friction * np.sign(np.gradient(u)) + rng.normal(0, noise, u.size)


def test_single_compression():
    u = ramps([4e-3])[: int(4e-3 / SPEED * 2)]
    found = analyse_compression(u, spring(u))
    assert found.valid
    assert found.stiffness.value == pytest.approx(69e3, rel=2e-3)
    assert found.strokes == 1
    assert found.linearity_error < 5e-3
    assert math.isnan(found.hysteresis)
    assert found.r_squared > 0.999


def test_cycles_with_friction_show_their_hysteresis():
    u = ramps([4e-3] * 3)
    found = analyse_compression(u, spring(u, friction=3.0))
    low, high = found.force_range
    assert found.strokes == 6
    assert found.stiffness.value == pytest.approx(69e3, rel=3e-3)
    assert found.hysteresis * (high - low) == pytest.approx(6.0, abs=1.5)
    assert found.energy_loss == pytest.approx(6.0 / (69e3 * 2e-3), rel=0.3)


def test_toe_and_end_stop_drop_out():
    u = ramps([5e-3])[: int(5e-3 / SPEED * 2)]
    bent = spring(np.maximum(u - 0.4e-3, 0.0)) + 400e3 * np.maximum(u - 4.5e-3, 0.0)
    found = analyse_compression(u, bent)
    assert found.stiffness.value == pytest.approx(69e3, rel=5e-3)
    assert found.linear_range[0] == pytest.approx(0.4e-3, abs=0.25e-3)
    assert found.linear_range[1] == pytest.approx(4.5e-3, abs=0.25e-3)


def test_a_slightly_curved_spring_tells_its_linearity_error():
    u = ramps([4e-3])[: int(4e-3 / SPEED * 2)]
    force = 69e3 * u * (1 + 0.02 * u / 4e-3)
    found = analyse_compression(u, force)
    # Best line through a parabola of sag s: the largest deviation is 2/3 of the edge's, s/6.
    assert found.linearity_error == pytest.approx(0.02 / 6, rel=0.15)


def test_uncertainty_is_calibrated():
    rng = np.random.default_rng(8)
    u = ramps([3e-3] * 2)
    scores = []
    for seed in range(200):
        gain = rng.normal(1, 0.005) / rng.normal(1, 0.005)
        found = analyse_compression(u, gain * spring(u, seed=seed))
        scores.append((found.stiffness.value - 69e3) / found.stiffness.std)
    assert np.mean(np.abs(scores) < 1.96) > 0.92
    assert 0.8 < np.std(scores) < 1.2


def test_noise_alone_is_calibrated_too():
    u = ramps([3e-3] * 2)
    exact = {'force_uncertainty': 0.0, 'displacement_uncertainty': 0.0}
    scores = []
    for seed in range(200):
        found = analyse_compression(u, spring(u, seed=seed, noise=2.0), **exact)
        scores.append((found.stiffness.value - 69e3) / found.stiffness.std)
    assert np.mean(np.abs(scores) < 1.96) > 0.9


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 5), st.floats(0, 2e-6))
def test_strokes_are_counted_through_noise(cycles, noise):
    u = ramps([3e-3] * cycles)
    u = u + np.random.default_rng(cycles).normal(0, noise, u.size)
    strokes = split_strokes(u)
    assert len(strokes) == 2 * cycles
    assert strokes[0][0] == 0
    assert strokes[-1][1] == u.size


def test_moving_mass_of_the_paper():
    mass = moving_mass(Estimate(69e3, 690.0), Estimate(203.2 / 2 / math.pi, 0.16))
    assert mass.value == pytest.approx(1.671, abs=1e-3)
    assert mass.std == pytest.approx(mass.value * math.hypot(0.01, 2 * 0.16 / 32.34), rel=1e-3)


def test_what_cannot_be_told_is_unusable():
    u = ramps([4e-3])
    rng = np.random.default_rng(0)
    cases = [
        (u[:10], spring(u)[:10], '10 samples'),
        (np.zeros(200), rng.normal(0, 1, 200), 'never rises'),
        (u, rng.normal(0, 1, u.size), ''),
        (u, -spring(u), 'straight'),
        (1e3 * u, 1e-3 * spring(u, noise=0.0), 'units'),
        (u[::-1][u.size // 2 :], spring(u)[::-1][u.size // 2 :], 'never rises'),
    ]
    for displacement, force, reason in cases:
        found = analyse_compression(displacement, force)
        assert not found.valid, reason
        assert reason in found.reason
        assert math.isnan(found.stiffness.value)
    with pytest.raises(InputError, match='differ'):
        analyse_compression(u, u[:-1])
    with pytest.raises(InputError, match='moving mass'):
        moving_mass(Estimate(), Estimate(1.0, 0.0))
