"""A force that repeats with the position of an axis; laws of an axis that are one law."""

import dataclasses

import numpy as np
import pytest

from impactscope.discrepancy.driven.guess import position_ripple
from impactscope.discrepancy.driven.model import Segment, inside_samples

RATE = 1000.0


def segment(ripple, period=0.012, friction=5.0):
    """Force of a known motion by the equation of motion itself."""
    time = np.arange(8000) / RATE
    turn = 2.0 * np.pi * 0.6
    x = 0.05 * np.sin(turn * time) + 0.02 * np.sin(2.3 * turn * time)
    v = 0.05 * turn * np.cos(turn * time) + 0.02 * 2.3 * turn * np.cos(2.3 * turn * time)
    a = -(turn**2) * (0.05 * np.sin(turn * time) + 0.02 * 2.3**2 * np.sin(2.3 * turn * time))
    force = 20.0 * a + 60.0 * v + friction * np.sign(v) + 2.0
    force += ripple * np.sin(2.0 * np.pi * x / period)
    x = x + 1e-7 * np.random.default_rng(1).standard_normal(time.size)
    drive = inside_samples(force, 1, held=True)
    return Segment('r0', 'displacement.axis', 'm', False, 0.0, 1.0 / RATE, x, drive)


@pytest.mark.parametrize('period', [0.008, 0.02])
def test_the_period_of_a_ripple(period):
    assert position_ripple([segment(3.0, period)]) == pytest.approx(period, rel=0.02)


def test_usual_forces_do_not_repeat_with_the_position():
    assert position_ripple([segment(0.0)]) is None


def test_a_speed_says_nothing_of_it():
    assert position_ripple([dataclasses.replace(segment(3.0), derivative=1)]) is None
