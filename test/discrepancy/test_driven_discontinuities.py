"""Motions that begin or turn suddenly: where they break, and the course through them."""

import numpy as np
import pytest

from impactscope.discrepancy.driven.data.discontinuities import discontinuities_of, noise_beside
from impactscope.discrepancy.driven.data.trajectory import trajectory_of

RATE = 1000.0
TIME = np.arange(2000) / RATE


def half_sine(begin: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and speed of a half sine of 0.1 s."""
    turn = 10.0 * np.pi * (TIME - begin)
    on = (turn > 0.0) & (turn < np.pi)
    return np.sin(turn) * on, 10.0 * np.pi * np.cos(turn) * on


@pytest.mark.parametrize('begin', [0.6, 0.6003, 0.7777])
@pytest.mark.parametrize('noise', [1e-6, 1e-4])
def test_a_jump_of_the_speed_is_placed_between_samples(begin, noise):
    position, _ = half_sine(begin)
    samples = position + noise * np.random.default_rng(2).standard_normal(TIME.size)
    found = discontinuities_of(samples, noise_beside(samples))
    for expected in (begin, begin + 0.1):
        near = min(found, key=lambda b: abs(b.place - expected * RATE))
        assert near.place == pytest.approx(expected * RATE, abs=0.05)
        assert near.smooth == 0


def test_a_jump_of_the_acceleration_lets_the_speed_go_through():
    step = np.clip((TIME - 0.6) / 0.1, 0.0, 1.0)
    samples = 0.5 - 0.5 * np.cos(np.pi * step)
    samples = samples + 1e-5 * np.random.default_rng(3).standard_normal(TIME.size)
    found = discontinuities_of(samples, noise_beside(samples))
    assert [b.smooth for b in found] == [1, 1]
    assert [b.place for b in found] == pytest.approx([600.0, 700.0], abs=0.5)


def test_a_smooth_motion_does_not_break():
    samples = np.sin(10.0 * np.pi * TIME)
    samples = samples + 1e-5 * np.random.default_rng(4).standard_normal(TIME.size)
    assert discontinuities_of(samples, noise_beside(samples)) == []


def test_noise_is_read_beside_breaks():
    position, _ = half_sine(0.5)
    samples = position + 1e-4 * np.random.default_rng(5).standard_normal(TIME.size)
    assert noise_beside(samples) == pytest.approx(1e-4, rel=0.1)


@pytest.mark.parametrize('noise', [0.0, 1e-5])
def test_the_speed_is_right_up_to_the_break(noise):
    position, speed = half_sine(0.6)
    samples = position + noise * np.random.default_rng(6).standard_normal(TIME.size)
    course = trajectory_of(samples, 1.0 / RATE, 0)
    largest = 10.0 * np.pi
    beside = np.min(np.abs(np.subtract.outer(TIME, [0.6, 0.7])), axis=1) > 1.5 / RATE
    error = np.abs(course.motion[1] - speed)[beside] / largest
    assert np.sqrt(np.mean(error**2)) < 1e-5 + 5.0 * noise
    # samples beside a break hardly count: the speed there is not known
    near = np.min(np.abs(np.subtract.outer(TIME, [0.6, 0.7])), axis=1) < 0.9 / RATE
    assert np.all(course.ends[1, near] > (0.1 * largest) ** 2)
