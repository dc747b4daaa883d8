from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from impactscope.estimate.free_oscillation import fit_free_oscillation
from impactscope.estimate.joint_oscillation import fit_jointly
from impactscope.estimate.repeated_blows import RepeatedBlows, summarise_blows
from impactscope.records import Estimate, SensorParameters

RATE = 1000.0
TIME = np.arange(1000) / RATE


def span(seed, amplitude=60.0, frequency=32.3, zeta=0.07, noise=1.0):
    wn = 2 * math.pi * frequency
    wave = np.exp(-zeta * wn * TIME) * np.cos(wn * math.sqrt(1 - zeta**2) * TIME + 0.4)
    return amplitude * wave + np.random.default_rng(seed).normal(0, noise, TIME.size)


def told(number, values):
    fit = fit_free_oscillation(values, RATE)
    return SensorParameters(
        number,
        1000 * number,
        valid=True,
        channel='force',
        natural_frequency=fit.natural_frequency,
        damping_ratio=fit.damping_ratio,
        amplitude=fit.amplitude,
        stiffness=Estimate(69e3, 500.0),
    )


def test_the_mean_is_the_joint_fit_of_all_samples():
    spans = [span(seed, amplitude) for seed, amplitude in enumerate((30, 50, 60, 80, 90))]
    summary = summarise_blows([told(k, values) for k, values in enumerate(spans)])
    joint = fit_jointly(spans, RATE)
    for mine, other in (
        (summary.natural_frequency, joint.natural_frequency),
        (summary.damping_ratio, joint.damping_ratio),
    ):
        assert abs(mine.value - other.value) < 0.2 * other.std
        assert mine.std == pytest.approx(other.std, rel=0.1)
    assert summary.scatter_p_value > 0.01
    assert summary.linearity_p_value > 1e-3
    assert summary.moving_mass.value == pytest.approx(69e3 / (2 * math.pi * 32.3) ** 2, rel=0.01)
    assert summary.moving_mass.std == pytest.approx(
        500 / 69e3 * summary.moving_mass.value, rel=0.1
    )


def test_blows_that_differ_are_seen_to_and_widen_the_mean():
    blows = [told(k, span(k, frequency=32.3 + 0.3 * (k % 2))) for k in range(6)]
    summary = summarise_blows(blows)
    assert summary.scatter_p_value < 1e-6
    assert summary.natural_frequency.std > 0.05
    assert abs(summary.natural_frequency.value - 32.45) < 2 * summary.natural_frequency.std


def test_damping_that_grows_with_the_blow_is_a_trend():
    strengths = (20, 40, 80, 160)
    blows = [
        told(k, span(k, a, zeta=0.05 + 0.01 * math.log(a / 20))) for k, a in enumerate(strengths)
    ]
    summary = summarise_blows(blows)
    assert summary.linearity_p_value < 1e-4
    assert abs(summary.damping_slope.value - 0.01) < 4 * summary.damping_slope.std


def test_equal_blows_show_no_trend():
    summary = summarise_blows([told(k, span(k)) for k in range(4)])
    assert math.isnan(summary.linearity_p_value)
    assert math.isnan(summary.frequency_slope.value)


def test_the_stage_speaks_from_the_second_telling_blow_on():
    stage = RepeatedBlows()
    blows = [told(k, span(k)) for k in range(1, 4)]
    dull = SensorParameters(9, 9, valid=False, reason='noise')
    assert stage.push(blows[0]) == []
    assert stage.push(dull) == []
    (second,) = stage.push(blows[1])
    assert second.natural_frequency == summarise_blows(blows[:2]).natural_frequency
    (third,) = stage.push(blows[2])
    assert third.event_ids == (1, 2, 3)
    assert third.stamp_ns == 3000
    assert third.natural_frequency.std < second.natural_frequency.std
    other = dataclasses.replace(blows[0], channel='force.2')
    assert stage.push(other) == []  # another channel is another sensor
    stage.flush()
    assert stage.push(blows[0]) == []


def test_memory_is_bounded():
    stage = RepeatedBlows()
    blow = told(1, span(1))
    for number in range(100):
        found = stage.push(dataclasses.replace(blow, event_id=number))
    assert found[0].event_ids == tuple(range(36, 100))
