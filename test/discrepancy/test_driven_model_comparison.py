"""How much coloured residuals count, and start values from the equation of motion."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from impactscope.campaign_files import read_channels
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.model_comparison import (
    WORTH,
    Judge,
    counting_samples,
    noise_share,
)
from impactscope.discrepancy.driven.models.model import Segment

BAGS = Path(__file__).resolve().parents[2] / 'bags'


def test_white_samples_all_count():
    residual = np.random.default_rng(1).standard_normal(20_000)
    assert counting_samples(residual) == pytest.approx(20_000, rel=0.03)


@given(st.floats(0.3, 0.97))
@settings(max_examples=20, deadline=None)
def test_coloured_samples_count_as_bartlett_says(memory):
    """For a first-order process the sum of squared correlations is (1 + a^2) / (1 - a^2)."""
    n = 40_000
    white = np.random.default_rng(2).standard_normal(n)
    residual = signal.lfilter([1.0], [1.0, -memory], white)
    expected = n * (1 - memory**2) / (1 + memory**2)
    assert counting_samples(residual) == pytest.approx(expected, rel=0.25)


def test_share_of_noise_in_a_slow_residual():
    t = np.linspace(0.0, 1.0, 5000)
    noise = 0.1 * np.random.default_rng(3).standard_normal(t.size)
    slow = np.sin(2 * math.pi * 3 * t)
    assert noise_share(noise, math.nan) > 0.9
    assert noise_share(slow + noise, math.nan) == pytest.approx(0.01 / 0.51, rel=0.1)
    assert noise_share(slow + noise, 0.1) == pytest.approx(0.01 / 0.51, rel=0.05)


def fits(residuals, added):
    return Fit((), {}, {}, (), tuple(residuals), added)


def segments(samples):
    rng = np.random.default_rng(4)
    return [
        Segment('r', 'c', 'm', held, 0.0, 1e-3, rng.standard_normal(samples), np.zeros(0))
        for held in (False, True)
    ]


@pytest.mark.parametrize(('gain', 'believed'), [(0.02, False), (0.25, True)])
def test_an_error_of_the_model_must_fall_by_a_tenth(gain, believed):
    """However long the recordings: slow residuals, a million times above the noise."""
    n = 50_000
    rng = np.random.default_rng(5)
    sections = signal.butter(2, 0.05, output='sos')
    slow = [signal.sosfilt(sections, rng.standard_normal(n)) for _ in range(2)]
    judge = Judge(segments(n), 10)
    small, large = fits(slow, 0), fits([r * math.sqrt(1 - gain) for r in slow], 1)
    assert max(judge.weights(small)) <= 1.01 * WORTH
    assert judge.better(small, large) is believed


def test_worse_predictions_are_refused():
    n = 5000
    rng = np.random.default_rng(6)
    fitted, held_out = rng.standard_normal(n), rng.standard_normal(n)
    judge = Judge(segments(n), 10)
    small = fits([fitted, held_out], 0)
    assert judge.better(small, fits([0.7 * fitted, 0.9 * held_out], 1))
    assert not judge.better(small, fits([0.7 * fitted, 1.1 * held_out], 1))


def test_what_is_not_seen_where_it_was_fitted_is_not_found():
    """A number that only helps to predict: a free swing's slight error of frequency, say."""
    n = 20_000
    slow = np.repeat(np.random.default_rng(7).standard_normal(n // 100), 100)
    judge = Judge(segments(n), 10)
    before = fits([slow, slow], 0)
    assert not judge.better(before, fits([0.9999 * slow, 0.5 * slow], 1))
    assert judge.better(before, fits([0.9 * slow, 0.5 * slow], 1))


def test_real_pendulum():
    """Fitted to swing 03, swings 01 and 02 are predicted (README of the recordings)."""
    recordings = [
        {'file': 'pendulum_swing_03.mcap', 'start': 0.5},
        {'file': 'pendulum_swing_01.mcap', 'start': 1.8, 'role': 'hold_out'},
        {'file': 'pendulum_swing_02.mcap', 'start': 1.8, 'role': 'hold_out'},
    ]
    bench = {'kind': 'driven', 'input': 'none', 'outputs': ['displacement.angle']}
    description = {
        'version': 1,
        'bench': bench,
        'baseline': ['linear_sensor'],
        'recordings': recordings,
    }
    campaign = parse_campaign(description).with_samples(lambda name: read_channels(BAGS / name))
    answer = explain_driven(campaign)
    assert set(answer.accepted) == {'restoring_force', 'coulomb_friction'}
    errors = [
        math.degrees(float(np.sqrt(np.mean((t.measured - t.extended) ** 2))))
        for t in answer.traces
    ]
    assert all(e < bound for e, bound in zip(errors, (0.66, 0.94, 1.8), strict=True))
