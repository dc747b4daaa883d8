"""Slow noise of driven campaigns: no finding, and effects beside it are still found."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.slow_noise import _by_levels

RATE, SAMPLES = 2000.0, 3000


def slow_noise(rng, size):
    """Parts that forget within times a factor of four apart, of equal variance."""
    total = np.zeros(size)
    for keep in (0.9, 0.975, 0.99375, 0.9984, 0.9996, 0.9999):
        fresh = rng.standard_normal(size + 20_000) * np.sqrt(1.0 - keep**2)
        total += signal.lfilter([1.0], [1.0, -keep], fresh)[20_000:]
    return total


def campaign(seed, after=lambda y: y):
    """A chain with white noise at both ends and slow noise at its output."""
    rng = np.random.default_rng(seed)
    entries, channels = [], {}
    time = np.arange(SAMPLES) / RATE
    for i in range(5):
        phases = rng.uniform(0.0, 2.0 * np.pi, 12)
        tones = 3.0 * 1.37 ** np.arange(12)
        true = 4.0 * np.sum(np.sin(2.0 * np.pi * np.outer(tones, time) + phases[:, None]), axis=0)
        raw = true + 0.05 * rng.standard_normal(SAMPLES)
        noise = 0.2 * rng.standard_normal(SAMPLES) + 0.06 * slow_noise(rng, SAMPLES)
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 4 else 'fit'})
        channels[file] = {
            name: ChannelSamples(name, 'm/s^2', RATE, 0.0, values)
            for name, values in (
                ('acceleration.raw', raw),
                ('acceleration.processed', after(true) + noise),
            )
        }
    bench = {'kind': 'chain', 'input': 'acceleration.raw', 'output': 'acceleration.processed'}
    data = {'version': 1, 'bench': bench, 'recordings': entries}
    return parse_campaign(data).with_samples(channels.__getitem__)


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_slow_noise_is_nothing_that_is_missing(seed):
    answer = explain_driven(campaign(seed))
    assert answer.accepted == ()
    assert not answer.unexplained


def test_an_effect_is_found_beside_slow_noise():
    answer = explain_driven(campaign(4, lambda y: np.clip(y, -14.0, 14.0)))
    assert answer.accepted == ('saturation',)


def test_levels_that_agree_show_no_slow_noise():
    rng = np.random.default_rng(5)
    white = [rng.standard_normal(1000) for _ in range(5)]
    assert _by_levels(white) is None
    assert _by_levels([1.0 + r for r in white]) is None  # a level that all share


def test_levels_that_differ_do():
    rng = np.random.default_rng(6)
    levels = 0.3 * np.array([-1.2, -0.8, 0.4, 1.6, -1.0, 0.2, 1.3, -0.5])
    apart = [rng.standard_normal(1000) + level for level in levels]
    colour = _by_levels(apart)
    assert colour is not None
    ((level, corner),) = colour.parts
    assert corner == 0.0
    assert 0.2 < np.sqrt(1.5 * level) < 0.6
