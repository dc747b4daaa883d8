from __future__ import annotations

import math

import numpy as np
import pytest

from impactscope.detect import DetectorSettings
from impactscope.detect.plate_memory import PlateMemory

RATE = 5000.0


def ring_down(frequency, damping, amplitude, seed):
    t = np.arange(2500) / RATE
    w = 2 * math.pi * frequency
    noise = np.random.default_rng(seed).normal(0, 0.5, t.size)
    return amplitude * np.exp(-damping * w * t) * np.sin(w * math.sqrt(1 - damping**2) * t) + noise


def test_ring_downs_are_pooled_and_a_stray_one_does_no_harm():
    memory = PlateMemory(DetectorSettings())
    assert memory.model is None
    memory.learn(ring_down(24.0, 0.05, 200, 99), RATE, 0.5)
    for seed in range(8):
        memory.learn(ring_down(32.3, 0.07, 40, seed), RATE, 0.5)
    assert memory.model.natural_frequency == pytest.approx(2 * math.pi * 32.3, rel=2e-3)
    assert memory.model.damping_ratio == pytest.approx(0.07, rel=0.03)


def test_one_ring_down_is_its_own_median():
    memory = PlateMemory(DetectorSettings())
    memory.learn(ring_down(32.3, 0.07, 40, 0), RATE, 0.5)
    assert memory.model.natural_frequency == pytest.approx(2 * math.pi * 32.3, rel=5e-3)


def test_a_plate_that_is_given_is_not_learned():
    memory = PlateMemory(DetectorSettings(natural_frequency=30.0, damping_ratio=0.1))
    memory.learn(ring_down(24.0, 0.05, 200, 0), RATE, 0.5)
    assert memory.model.natural_frequency == pytest.approx(2 * math.pi * 30.0)
