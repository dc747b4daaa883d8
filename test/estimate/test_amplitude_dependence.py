"""Frequency and damping along the decay, on linear plates and on plates with dry friction."""

import math
from pathlib import Path

import numpy as np
import pytest

from impactscope.errors import EstimationError, InputError
from impactscope.estimate.amplitude_dependence import amplitude_dependence
from impactscope.estimate.free_oscillation import fit_free_oscillation
from impactscope.recordings import open_recording, read_streams
from impactscope.records import SampleBlock

BAGS = Path(__file__).parents[2] / 'bags'

RATE = 1000.0
FREQUENCY = 32.3


def oscillation(n, damping=0.07, amplitude=60.0, phase=-1.2):
    time = np.arange(n) / RATE
    wn = 2 * math.pi * FREQUENCY
    wd = wn * math.sqrt(1 - damping**2)
    return amplitude * np.exp(-damping * wn * time) * np.cos(wd * time + phase)


def with_dry_friction(n, damping, friction, amplitude=60.0):
    """Spring force in N of a plate let go at rest; exact, half-swing after half-swing.

    While the plate moves one way, Coulomb friction of ``friction`` N only shifts the level
    about which it swings; it sticks where the spring cannot overcome it.
    """
    wn = 2 * math.pi * FREQUENCY
    wd = wn * math.sqrt(1 - damping**2)
    half = math.pi / wd
    time = np.arange(n) / RATE
    force = np.full(n, math.nan)
    turn, begin = amplitude, 0.0
    while begin <= time[-1]:
        if abs(turn) <= friction:
            force[time >= begin] = turn
            break
        level = math.copysign(friction, turn)
        inside = (time >= begin) & (time < begin + half)
        u = time[inside] - begin
        swing = np.cos(wd * u) + damping * wn / wd * np.sin(wd * u)
        force[inside] = level + (turn - level) * np.exp(-damping * wn * u) * swing
        turn = level - (turn - level) * math.exp(-damping * wn * half)
        begin += half
    return force


@pytest.mark.parametrize('damping', [0.03, 0.07])
@pytest.mark.parametrize('friction', [0.5, 1.0, 2.0])
def test_r_squared_conceals_friction_and_the_slope_shows_it(damping, friction):
    noise = 0.2 * np.random.default_rng(1).normal(size=1000)
    y = with_dry_friction(1000, damping, friction) + noise
    fit = fit_free_oscillation(y, RATE)
    assert fit.r_squared > 0.97
    assert fit.damping_ratio.value > 1.2 * damping  # wrong, and not by the stated uncertainty
    found = amplitude_dependence(y, RATE)
    assert found.damping_p < 1e-6
    assert found.damping_slope.value < 0  # damping rises as the amplitude falls
    # Without what varies as one over the amplitude the viscous damping is left.
    large, _ = found.viscous_damping
    assert large == pytest.approx(damping, abs=0.35 * (fit.damping_ratio.value - damping))


def test_quadratic_damping_has_the_other_sign():
    decay, strength = 6.0, 1.0
    time = np.arange(1000) / RATE
    envelope = 60 / ((1 + strength) * np.exp(decay * time) - strength)
    y = envelope * np.cos(2 * math.pi * FREQUENCY * time)
    found = amplitude_dependence(y + 0.1 * np.random.default_rng(2).normal(size=1000), RATE)
    assert found.damping_slope.value > 0
    assert found.damping_p < 1e-6
    _, small = found.viscous_damping
    assert small == pytest.approx(decay / (2 * math.pi * FREQUENCY), rel=0.2)


def test_hardening_spring_shows_in_the_frequency():
    """The phase of a weakly damped plate whose frequency grows by 2 % at 60 N."""
    time = np.arange(1000) / RATE
    decay = 14.0
    turned = time + 0.02 * (1 - np.exp(-2 * decay * time)) / (2 * decay)
    y = 60 * np.exp(-decay * time) * np.cos(2 * math.pi * FREQUENCY * turned)
    found = amplitude_dependence(y + 0.1 * np.random.default_rng(3).normal(size=1000), RATE)
    assert found.frequency_p < 1e-6
    assert found.frequency_slope.value > 0
    assert found.frequency[0] > found.frequency[-1]


@pytest.mark.parametrize('noise', [0.1, 0.6, 2.0])
def test_false_findings_on_linear_plates_are_as_stated(noise):
    rng = np.random.default_rng(4)
    trials = 500
    p = np.empty((trials, 3))
    for k in range(trials):
        found = amplitude_dependence(oscillation(1000) + noise * rng.normal(size=1000), RATE)
        p[k] = found.frequency_p, found.damping_p, found.p_value
    for level in (0.01, 0.05, 0.2):
        spread = math.sqrt(level * (1 - level) / trials)
        rates = np.mean(p[:, :2] < level, axis=0)
        assert np.abs(rates - level).max() < 4.5 * spread
    assert np.mean(p[:, 2] < 0.05) < 0.05 + 4.5 * math.sqrt(0.05 * 0.95 / trials)


def test_noise_free_linear_plate_is_the_same_all_along():
    found = amplitude_dependence(oscillation(600), RATE)
    assert found.damping_ratio == pytest.approx(np.full(found.time.size, 0.07), abs=1e-8)
    assert found.frequency == pytest.approx(np.full(found.time.size, FREQUENCY), rel=1e-8)
    expected = 60 * np.exp(-0.07 * 2 * math.pi * FREQUENCY * found.time)
    assert found.amplitude == pytest.approx(expected, rel=1e-6)


def test_too_little_to_see():
    with pytest.raises(EstimationError, match='windows'):
        amplitude_dependence(oscillation(80), RATE)
    with pytest.raises(InputError, match='periods'):
        amplitude_dependence(oscillation(800), RATE, periods=0.5)


def test_real_pendulum_shows_bearing_friction_and_the_sine():
    """Free swings of a real pendulum: R² 0.98 for a line that is wrong in both respects.

    Friction in the bearing makes the damping rise as the swing falls; the restoring torque
    grows as the sine of the angle, so the frequency rises: by theta²/16 of its small-angle value.
    """
    with open_recording(BAGS / 'pendulum_swing_03.mcap') as recording:
        blocks = [b for b in read_streams(recording) if isinstance(b, SampleBlock)]
    angle = np.concatenate([b.values for b in blocks]).astype(float)[124:]
    rate = blocks[0].sample_rate
    assert fit_free_oscillation(angle, rate).r_squared > 0.98
    found = amplitude_dependence(angle, rate)
    assert found.damping_p < 1e-6
    assert found.damping_slope.value < 0
    assert found.frequency_p < 1e-6
    assert found.frequency_slope.value < 0
    # The first window spans two swings that fall from 1 rad: theta² averages over them.
    largest, smallest = found.amplitude[0], found.amplitude[-1]
    drop = 1 - found.frequency[0] / found.frequency[-1]
    assert drop == pytest.approx((largest**2 - smallest**2) / 16, rel=0.25)
