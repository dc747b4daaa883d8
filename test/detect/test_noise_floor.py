from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.detect.noise_floor import (
    NoiseFloor,
    hop_variances,
    quantum,
    quiet_powers,
    window_lengths,
)


@given(st.integers(2, 20), st.integers(4, 2000))
def test_windows_grow_to_a_hop(shortest, hop):
    lengths = window_lengths(shortest, hop)
    assert lengths[-1] == hop
    assert (np.diff(lengths) > 0).all()
    assert lengths[0] == min(shortest, hop) or lengths.size == 1


def test_powers_of_white_noise_fall_with_the_window():
    samples = np.random.default_rng(0).normal(5, 2.0, 200_000)
    scales = window_lengths(4, 100)
    powers = quiet_powers(samples, scales, 100, 6.5)
    assert powers == pytest.approx([4.0, *(4.0 / scales)], rel=0.1)


def test_what_changes_is_not_quiet():
    rng = np.random.default_rng(0)
    t = np.arange(2000) / 10_000
    noise = rng.normal(0, 1, t.size)
    scales = window_lengths(4, 100)
    assert quiet_powers(noise, scales, 100, 6.5) is not None
    ringing = 10 * np.exp(-14 * t) * np.cos(203 * t)
    assert quiet_powers(noise + ringing, scales, 100, 6.5) is None
    assert quiet_powers(noise + 50 * (t > 0.1), scales, 100, 6.5) is None
    noise[3] = math.nan
    assert quiet_powers(noise, scales, 100, 6.5) is None


def test_a_constant_signal_is_quiet():
    assert quiet_powers(np.full(2000, 3.0), window_lengths(4, 100), 100, 6.5) is not None


def test_steps_of_a_coarse_encoder_are_seen():
    assert quantum(np.repeat([1.0, 1.25, 1.0, 1.5], 100)) == 0.25
    assert quantum(np.random.default_rng(0).normal(0, 1, 400)) == 0.0


def test_hop_variances_leave_slow_motion_out():
    t = np.arange(10_000) / 10_000
    values = np.stack([np.sin(t), np.random.default_rng(0).normal(0, 2, t.size)])
    slow, noisy = hop_variances(values.astype(np.float32), 100)
    assert slow < 1e-4
    assert noisy == pytest.approx(4.0, rel=0.05)


def test_settling_gives_level_and_noise_of_every_channel():
    rng = np.random.default_rng(0)
    values = np.stack([rng.normal(3, 1, 4000), np.full(4000, np.nan), rng.normal(-2, 5, 4000)])
    scales = window_lengths(4, 50)
    floor = NoiseFloor(3, 50, scales, 100)
    powers = quiet_powers(values[0], scales, 50, 6.5)
    floor.settle(values.astype(np.float32), 0, 1, 79.0, powers, 6.5)
    level, noise = floor.channel_levels()
    assert floor.level(80.0) == pytest.approx(3, abs=0.1)
    assert level == pytest.approx([3, math.nan, -2], abs=0.3, nan_ok=True)
    assert noise == pytest.approx([1, math.nan, 5], rel=0.1, nan_ok=True)
