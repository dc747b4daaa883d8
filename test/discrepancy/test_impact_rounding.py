"""Noise behind a coarse converter: at rest it shows less than while the bench moves."""

from __future__ import annotations

import numpy as np
import pytest

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
