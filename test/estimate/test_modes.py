from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from impactscope.analysis import analyse
from impactscope.errors import EstimationError, InputError
from impactscope.estimate.modes import fit_modes

RATE, SAMPLES = 5000.0, 4000
TIME = np.arange(SAMPLES) / RATE
THREE = ((60.0, 0.02, 30.0, 0.3), (66.0, 0.015, 12.0, 1.0), (410.0, 0.004, 5.0, 2.0))
BAGS = Path(__file__).parents[2] / 'bags'


def ringing(modes, time=TIME):
    """Sum of modes, each (natural frequency, damping ratio, amplitude, phase)."""
    total = np.zeros(time.size)
    for f, zeta, amplitude, phase in modes:
        wn = 2 * math.pi * f
        angle = wn * math.sqrt(1 - zeta**2) * time + phase
        total += amplitude * np.exp(-zeta * wn * time) * np.cos(angle)
    return total


def by_frequency(fit):
    return sorted(fit.modes, key=lambda mode: mode.natural_frequency.value)


def crb(modes, noise):
    """Cramér-Rao bounds of the parameters in white noise, shape (n_modes, 4)."""
    theta = np.array(modes, dtype=float).ravel()
    columns = []
    for k in range(theta.size):
        step = 1e-6 * max(1.0, abs(theta[k]))
        up, down = theta.copy(), theta.copy()
        up[k] += step
        down[k] -= step
        columns.append((ringing(up.reshape(-1, 4)) - ringing(down.reshape(-1, 4))) / (2 * step))
    jacobian = np.array(columns).T
    return noise * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian))).reshape(-1, 4)


def test_without_noise_the_modes_are_exact():
    fit = fit_modes(ringing(THREE), RATE)
    assert len(fit.modes) == 3
    for mode, (f, zeta, amplitude, _) in zip(by_frequency(fit), THREE, strict=True):
        assert mode.natural_frequency.value == pytest.approx(f, rel=1e-6)
        assert mode.damping_ratio.value == pytest.approx(zeta, rel=1e-4)
        assert mode.amplitude.value == pytest.approx(amplitude, rel=1e-4)
    assert fit.r_squared > 1 - 1e-8
    assert np.abs(fit.evaluate(TIME) - ringing(THREE)).max() < 1e-2


def test_close_modes_are_told_as_well_as_noise_allows():
    """60 and 66 Hz overlap: estimates scatter as the bound says, and intervals cover."""
    noise, rng = 1.0, np.random.default_rng(1)
    errors = []
    for _ in range(150):
        fit = fit_modes(ringing(THREE) + rng.normal(0, noise, SAMPLES), RATE)
        assert len(fit.modes) == 3
        errors.append(
            [
                (
                    mode.natural_frequency.value - f,
                    mode.natural_frequency.std,
                    mode.damping_ratio.value - zeta,
                    mode.damping_ratio.std,
                )
                for mode, (f, zeta, _, _) in zip(by_frequency(fit), THREE, strict=True)
            ]
        )
    errors = np.array(errors)
    bound = crb(THREE, noise)
    for k, parameter in ((0, 0), (2, 1)):
        assert np.all(errors[:, :, k].std(axis=0) < 1.25 * bound[:, parameter])
        covered = np.abs(errors[:, :, k]) < 1.96 * errors[:, :, k + 1]
        assert np.all(covered.mean(axis=0) > 0.85)
        assert covered.mean() > 0.9


def test_noise_is_no_mode():
    rng = np.random.default_rng(2)
    for _ in range(30):
        with pytest.raises(EstimationError, match='rings'):
            fit_modes(rng.normal(0, 1, SAMPLES), RATE)


def test_an_offset_and_a_creep_are_no_modes():
    fit = fit_modes(ringing(THREE[:1]) + 20.0 + 3.0 * np.exp(-TIME / 0.5), RATE)
    assert fit.modes[0].natural_frequency.value == pytest.approx(60.0, rel=2e-3)
    assert all(mode.natural_frequency.value > 3 * RATE / SAMPLES for mode in fit.modes)


def test_no_more_modes_than_wanted():
    assert len(fit_modes(ringing(THREE), RATE, most=2).modes) == 2


@pytest.mark.parametrize('bad', [np.zeros((2, 50)), np.full(50, math.nan)])
def test_what_is_no_row_of_numbers_is_refused(bad):
    with pytest.raises(InputError):
        fit_modes(bad, RATE)


def test_hammer_blows_on_a_structure_agree():
    """Five real blows: the modes that the package's modal search finds with the input known."""
    found = [analyse(BAGS / f'hammer_blow_{k}.mcap').events[0].sensor for k in range(1, 6)]
    for wanted, tolerance in ((900.0, 0.2), (2640.3, 0.1), (3668.9, 0.1)):
        values = []
        for sensor in found:
            assert sensor.channel == 'acceleration.structure'
            assert not sensor.valid
            assert 'modes ring' in sensor.reason
            assert sensor.r_squared > 0.98
            near = [m for m in sensor.modes if abs(m.natural_frequency.value - wanted) < 2]
            assert len(near) == 1
            values.append(near[0].natural_frequency)
        values = np.array(values)
        assert np.abs(values[:, 0] - wanted).max() < tolerance
        scatter = (values[:, 0] - values[:, 0].mean()) / values[:, 1]
        assert np.abs(scatter).max() < 4.5
