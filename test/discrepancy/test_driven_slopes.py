"""Slopes of a plate that rings for long: numbers that are known well only over each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from impactscope.discrepancy.driven.fits.linearisation import linearised
from impactscope.discrepancy.driven.fits.simulation_error import FINE, fit, sensitivities
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel, inside_samples
from impactscope.discrepancy.driven.models.terms import Number
from impactscope.discrepancy.driven.noise.spectral_whitening import whitening

RATE, SAMPLES, NOISE = 12800.0, 8000, 1.0
TRUE = {'mass': 18.4, 'damping': 280.0, 'stiffness': 18.4 * (2.0 * math.pi * 287.0) ** 2}
PLATE = OscillatorModel(
    tuple(Number(k, '', (v,), v, 1e-6 * v) for k, v in TRUE.items()), (), False, 1e-5, 0.02
)


def recordings(seed: int) -> list[Segment]:
    rng = np.random.default_rng(seed)
    time = np.arange(SAMPLES) / RATE
    made = []
    for i in range(3):
        share = np.clip((time - 0.02) / 1.5e-3, 0.0, 1.0)
        drive = inside_samples(3000.0 * (i + 1) * np.sin(np.pi * share) ** 2, 1, held=False)
        made.append(
            Segment(
                f'r{i}.mcap',
                'acceleration.plate',
                'm/s^2',
                False,
                0.0,
                1.0 / RATE,
                np.zeros(SAMPLES),
                drive,
                derivative=2,
                noise=NOISE,
                whitener=whitening(np.full(2, NOISE**2)),
            )
        )
    for segment in made:
        clean = PLATE.predict(TRUE, (), np.zeros(0), segment)
        segment.measured[:] = clean + NOISE * rng.standard_normal(SAMPLES)
    return made


@pytest.mark.parametrize('seed', range(4))
def test_a_fit_ends_in_its_minimum_from_wherever_it_comes(seed: int) -> None:
    """Mass and stiffness together tell the frequency 100 times as well as either of them."""
    segments = recordings(seed)
    costs = []
    for off in (1.0, 0.99, 1.01):
        begin = {k: off * v for k, v in TRUE.items()}
        found = fit(PLATE, (), segments, begin, tolerance=FINE)
        costs.append(found.cost * 3 * SAMPLES)
        for name, true in TRUE.items():
            assert abs(found.values[name] - true) < 4.0 * found.std[name]
    assert max(costs) - min(costs) < 0.1  # of chi-square


def test_what_a_model_re_tunes_is_that_of_a_small_step() -> None:
    """Mass, damping and stiffness together by as much change nothing but the gain."""
    segments = recordings(0)
    made = fit(PLATE, (), segments, TRUE, tolerance=FINE)
    clean = np.concatenate([s.measured - r for s, r in zip(segments, made.residuals, strict=True)])
    clean /= NOISE
    slopes = sensitivities(PLATE, made, segments)[1]
    basis = linearised(PLATE, made, segments).basis
    # by numbers over their scales: by all three together
    whole = slopes[:, :3] @ np.array([made.values[k] / TRUE[k] for k in TRUE])
    assert np.linalg.norm(whole + clean) < 0.02 * np.linalg.norm(clean)
    assert np.linalg.norm(clean - basis.T @ (basis @ clean)) < 0.02 * np.linalg.norm(clean)
