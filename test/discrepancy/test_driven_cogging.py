"""A force that repeats with the position of an axis; laws of an axis that are one law."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.driven import explain as explaining
from impactscope.discrepancy.driven.adequacy.cogging import cogging_of_motion, periods_to_try
from impactscope.discrepancy.driven.fits.equation_error import position_cogging
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import inside_samples

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
    assert position_cogging([segment(3.0, period)]) == pytest.approx(period, rel=0.02)


def test_usual_forces_do_not_repeat_with_the_position():
    assert position_cogging([segment(0.0)]) is None


def test_a_speed_says_nothing_of_it():
    assert position_cogging([dataclasses.replace(segment(3.0), derivative=1)]) is None


@pytest.mark.parametrize(('left', 'told'), [(0.1, False), (0.6, True)])
def test_a_ripple_is_in_the_way_of_a_search_that_has_left_much(left, told):
    """One that leaves a hundredth of the power that was missed has followed the motion."""
    whole = segment(3.0)
    missed = np.sin(np.arange(whole.measured.size) / 300.0)
    baseline, best = (SimpleNamespace(residuals=[size * missed]) for size in (1.0, left))
    outcome = SimpleNamespace(baseline=baseline, best=best)
    assert (explaining._ripple(outcome, [whole]) is not None) is told


def recorded(amplitude, friction=0.0, seed=5):
    """An axis in closed loop; what its plain law leaves of the position, by recording.

    The law has the wrong numbers that a fit of it would have.
    """
    segments, left = [], []
    rng = np.random.default_rng(seed)
    for i in range(3):
        turns = 2.0 * np.pi * np.array([0.31, 0.83, 1.7]) * (1.0 + 0.2 * i)
        phases = rng.uniform(0.0, 2.0 * np.pi, 3)
        count, steps = 6000, 4
        measured, force = np.empty(count), np.empty(count)
        plain = np.empty(count)
        x = v = p = w = 0.0
        for k in range(count):
            t = k / RATE
            ramp = min(2.0 * t, 1.0)
            wanted = ramp * 0.02 * np.sum(np.sin(turns * t + phases) / (1.0, 2.0, 4.0))
            held = 900.0 * (30.0 * (wanted - x) - v)
            measured[k], force[k], plain[k] = x, held, p
            for _ in range(steps):
                against = 90.0 * v + amplitude * np.sin(2.0 * np.pi * x / 0.012)
                against += friction * np.tanh(v / 1e-4)
                v += (held - against) / 24.0 / RATE / steps
                x += v / RATE / steps
                w += (held - 90.3 * w) / 24.05 / RATE / steps
                p += w / RATE / steps
        measured = 1e-6 * np.rint(1e6 * measured)
        drive = inside_samples(force, 1, held=True)
        segments.append(
            Segment(f'r{i}', 'x', 'm', i == 2, 0.0, 1.0 / RATE, measured, drive),
        )
        left.append(measured - plain)
    values = {'mass': 24.05, 'damping': 90.3}
    none = np.zeros(2)
    return Fit((), values, {}, (none,) * 3, tuple(left), 0), segments


def test_a_ripple_that_drowns_in_the_accelerations_shows_in_the_motion():
    made, segments = recorded(0.05)
    assert position_cogging(segments) is None
    shown = cogging_of_motion(made, segments)
    assert shown is not None
    assert float(re.search(r'every (\S+) m', shown[0].law)[1]) == pytest.approx(0.012, rel=0.01)
    assert shown[0].p_value < 1e-6
    assert shown[1] < 0.05


def test_dry_friction_is_no_ripple():
    assert cogging_of_motion(*recorded(0.0, friction=0.5)) is None


def test_a_rounded_position_is_no_ripple():
    assert cogging_of_motion(*recorded(0.0)) is None


def test_periods_are_tried_as_far_as_samples_follow_and_time_allows():
    time = np.arange(4000) / RATE
    slow = [0.05 * np.sin(2.0 * np.pi * 0.5 * time)]
    tried = periods_to_try(slow, 0.1)
    assert tried[0] == 2.0
    assert 200.0 < tried[-1] < 250.0  # 0.11 mm from sample to sample is a quarter of 0.44 mm
    fast = periods_to_try([slow[0][::10]], 0.1)
    assert 18.0 < fast[-1] < 26.0
    assert periods_to_try([np.repeat(slow[0], 100)], 0.1)[-1] < 82.0
    assert periods_to_try([np.zeros(100)], 0.1).size == 0
