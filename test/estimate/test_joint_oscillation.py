"""Several blows on one sensor."""

import math

import numpy as np
import pytest

from impactscope.errors import EstimationError, InputError
from impactscope.estimate.joint_oscillation import fit_jointly


def oscillation(n, rate=1000.0, frequency=32.3, damping=0.07, amplitude=60.0, phase=-1.2):
    time = np.arange(n) / rate
    wn = 2 * math.pi * frequency
    wd = wn * math.sqrt(1 - damping**2)
    return amplitude * np.exp(-damping * wn * time) * np.cos(wd * time + phase) + 2.0


def test_noise_free_spans_of_different_rates_and_lengths():
    spans = [oscillation(1000), oscillation(700, amplitude=10, phase=2), oscillation(4000, 5000.0)]
    joint = fit_jointly(spans, [1000.0, 1000.0, 5000.0])
    assert joint.natural_frequency.value == pytest.approx(32.3, rel=1e-9)
    assert joint.damping_ratio.value == pytest.approx(0.07, rel=1e-9)
    assert len(joint.blows) == 3


def test_shared_values_are_calibrated_and_better_than_one_blow():
    rng = np.random.default_rng(1)
    z, p, gain = [], [], []
    for _ in range(250):
        spans = [
            oscillation(1000, amplitude=rng.uniform(20, 80), phase=rng.uniform(-3, 3))
            + rng.uniform(0.3, 3) * rng.normal(size=1000)
            for _ in range(5)
        ]
        joint = fit_jointly(spans, 1000)
        frequency, damping = joint.natural_frequency, joint.damping_ratio
        z.append(((frequency.value - 32.3) / frequency.std, (damping.value - 0.07) / damping.std))
        p.append(joint.scatter_p)
        if joint.agree:
            gain.append(min(b.damping_ratio.std for b in joint.blows) > damping.std)
    assert np.std(z, axis=0) == pytest.approx([1, 1], abs=0.2)
    assert np.abs(np.mean(z, axis=0)).max() < 0.3
    assert np.mean(np.array(p) < 0.05) < 0.05 + 4 * math.sqrt(0.05 * 0.95 / 250)
    assert all(gain)


def test_equal_blows_average():
    rng = np.random.default_rng(2)
    spans = [oscillation(1000) + rng.normal(size=1000) for _ in range(4)]
    joint = fit_jointly(spans, 1000)
    single = np.mean([b.damping_ratio.std for b in joint.blows])
    assert joint.damping_ratio.std == pytest.approx(single / 2, rel=0.05)


def test_blows_that_differ_are_found_and_widen_the_uncertainty():
    rng = np.random.default_rng(3)
    spans = [
        oscillation(1000, damping=damping) + 0.3 * rng.normal(size=1000)
        for damping in (0.06, 0.07, 0.08)
    ]
    joint = fit_jointly(spans, 1000)
    assert not joint.agree
    assert joint.scatter_p < 1e-9
    assert joint.damping_birge > 5
    assert joint.damping_ratio.std > 0.003


def test_bad_input():
    with pytest.raises(InputError, match='at least 2'):
        fit_jointly([oscillation(500)], 1000)
    with pytest.raises(InputError, match='sample rates'):
        fit_jointly([oscillation(500)] * 2, [1000.0])
    with pytest.raises(EstimationError, match='span 2'):
        fit_jointly([oscillation(500), np.zeros(500)], 1000)
