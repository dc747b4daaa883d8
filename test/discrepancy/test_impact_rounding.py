"""Noise behind a coarse converter: at rest it shows less than while the bench moves."""

from __future__ import annotations

import numpy as np
import pytest

from impactscope.discrepancy.campaign import CampaignRecording, ChannelSamples
from impactscope.discrepancy.impact.data.blows import _when_moving
from impactscope.discrepancy.impact.noise.rounding import moving_noise


@pytest.mark.parametrize('sigma', [0.4, 0.6, 1.5])
@pytest.mark.parametrize('level', [0.0, 0.3, 0.5])
def test_noise_of_a_moving_signal_is_told_at_rest_wherever_that_lies(sigma, level):
    rng = np.random.default_rng(4)
    step = 0.19
    at_rest = step * np.round(level + sigma * rng.standard_normal(4000))
    ramp = np.linspace(0.0, 80.0, 4000)
    moving = step * (np.round(ramp + sigma * rng.standard_normal(4000)) - ramp)
    told = moving_noise(at_rest, step)
    assert told == pytest.approx(step * np.sqrt(sigma**2 + 1 / 12), rel=0.05)
    assert told == pytest.approx(np.std(moving), rel=0.06)


def test_two_steps_tell_nothing():
    rng = np.random.default_rng(5)
    assert moving_noise(np.round(0.45 + 0.05 * rng.standard_normal(400)), 1.0) == 0.0
    assert moving_noise(np.zeros(50), 1.0) == 0.0


RATE, ONSET = 5000.0, 0.4
TIME = np.arange(round(0.6 * RATE)) / RATE


def recording(name, values, step):
    rounded = step * np.round(values / step)
    samples = ChannelSamples(name, 'x', RATE, 0.0, rounded, -np.inf, np.inf)
    return CampaignRecording('blow.mcap', 'pendulum', channels={name: samples})


@pytest.mark.parametrize(
    ('name', 'rest', 'told'),
    [
        ('force', 0.02, True),
        ('acceleration.impactor', 0.02, False),  # it swings before the blow
        ('force', np.where(TIME > 0.2, 4.0, 0.0), True),  # no level of its own: bounded
    ],
)
def test_a_coarse_channel_is_as_noisy_as_its_steps_allow(name, rest, told):
    step, sigma = 0.19, 0.06
    rng = np.random.default_rng(6)
    blow = np.where(TIME > ONSET, 60.0 * np.sin(300.0 * (TIME - ONSET)), 0.0)
    shown = recording(name, rest + blow + sigma * rng.standard_normal(TIME.size), step)
    at_rest = {name: 0.065}
    found = _when_moving([(shown, ONSET)], at_rest, {})
    if not told:
        assert found == {}
        return
    most = np.hypot(0.065, step / np.sqrt(12.0))
    assert found[name] == pytest.approx(np.hypot(sigma, step / np.sqrt(12.0)), rel=0.1)
    assert found[name] <= most
    assert _when_moving([(shown, ONSET)], at_rest, {name: 0.065}) == {}
    assert _when_moving([(shown, ONSET)], {name: 0.3}, {}) == {}
