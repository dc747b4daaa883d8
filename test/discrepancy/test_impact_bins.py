"""Which samples of a channel count: those that a coarse converter rounds, not those cut off."""

from __future__ import annotations

import math

import numpy as np
import pytest

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.impact.bins import _clipping

RATE, STEP = 10_000.0, 0.33


def force(limit: float) -> ChannelSamples:
    """A blow of 100 N and 30 ms on a coarse converter, maybe cut off."""
    time = np.arange(4000) / RATE
    share = np.clip((time - 0.1) / 0.03, 0.0, 1.0)
    noise = 0.05 * np.random.default_rng(12).standard_normal(time.size)
    values = np.minimum(100.0 * np.sin(np.pi * share) + noise, limit)
    return ChannelSamples('force', 'N', RATE, 0.0, STEP * np.round(values / STEP))


def test_a_round_top_on_a_coarse_converter_is_not_cut_off():
    channel = force(math.inf)
    assert _clipping(channel.values, channel, 8, STEP) == math.inf


@pytest.mark.parametrize('limit', [95.0, 80.0, 40.0])
def test_a_flat_top_is(limit):
    channel = force(limit)
    found = _clipping(channel.values, channel, 8, STEP)
    assert found == pytest.approx(limit, abs=STEP)
