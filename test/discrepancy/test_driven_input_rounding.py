"""Rounding of an input that rests."""

import numpy as np
import pytest

from impactscope.discrepancy.driven.noise.input_rounding import rounding_of

STEP, NOISE, LONG = 0.01, 0.005, 500


def rounded(rng, stretches):
    """An input that rests at one level after the other, and what its rounding leaves."""
    sides = (-1.0) ** np.arange(stretches)  # so that no two neighbours read the same
    level = np.repeat(sides * rng.uniform(0.1, 1.0, stretches), LONG)
    coarse = STEP * np.round(level / STEP)
    return coarse, level - coarse


def test_stretches_have_an_error_of_their_own():
    rng = np.random.default_rng(1)
    samples, error = rounded(rng, 400)
    residual = error + NOISE * rng.standard_normal(error.size)
    white = rounding_of(samples, NOISE)(residual) / NOISE
    means = white.reshape(-1, LONG).mean(axis=1) * np.sqrt(LONG)
    assert np.var(residual.reshape(-1, LONG).mean(axis=1)) * LONG / NOISE**2 > 50.0
    assert np.var(means) == pytest.approx(1.0, rel=0.2)
    assert np.var(white) == pytest.approx(1.0, rel=0.02)


def test_an_offset_of_many_steps_stays():
    rng = np.random.default_rng(2)
    samples, error = rounded(rng, 20)
    residual = error + 10.0 * STEP + NOISE * rng.standard_normal(error.size)
    white = rounding_of(samples, NOISE)(residual) / NOISE
    assert abs(np.sum(white)) / np.sqrt(white.size) > 20.0


def test_noise_over_the_steps_leaves_nothing_to_do():
    rng = np.random.default_rng(3)
    samples = STEP * np.round(2.0 * STEP * rng.standard_normal(5000) / STEP)
    assert rounding_of(samples, NOISE) is None
    assert rounding_of(rng.standard_normal(5000), NOISE) is None
    assert rounding_of(samples, 0.0) is None
