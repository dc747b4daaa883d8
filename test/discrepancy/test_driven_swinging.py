"""What recordings show of a force that swings in time, at all frequencies at once."""

import numpy as np
import pytest

from impactscope.discrepancy.driven.adequacy.swinging import (
    answers_of_swings,
    frequencies,
    swings_seen,
)

SAMPLES, PERIOD = 400, 0.01
TIME = PERIOD * np.arange(SAMPLES)
PULSE = 0.8 ** np.arange(60.0)
HIGHEST = 20.0  # Hz


def shape(seed):
    """A motion that has ended before the recording does."""
    found = np.random.default_rng(seed).standard_normal(SAMPLES)
    found[-60:] = 0.0
    return found


def answer(shape, frequency, phase):
    swung = shape * np.sin(2.0 * np.pi * frequency * TIME + phase)
    return np.convolve(swung, PULSE)[:SAMPLES]


@pytest.mark.parametrize('line', [0, 7, 100, 333])
def test_each_frequency_is_as_if_it_had_been_tried_alone(line):
    x, residual = shape(1), np.random.default_rng(2).standard_normal(SAMPLES)
    seen = answers_of_swings(residual, x, PULSE, SAMPLES)
    frequency = frequencies(SAMPLES, PERIOD)[line]
    sine, cosine = (answer(x, frequency, phase) for phase in (0.0, 0.5 * np.pi))
    assert seen.along[line] == pytest.approx(residual @ cosine - 1j * (residual @ sine))
    assert seen.power[line] == pytest.approx(0.5 * (sine @ sine + cosine @ cosine))


@pytest.mark.parametrize(('phases', 'way'), [((0.4, 0.4, 0.4), 0), ((0.4, 2.5, 4.6), 1)])
def test_a_weak_swing_is_seen_with_one_phase_and_with_many(phases, way):
    rng = np.random.default_rng(3)
    seen = []
    for i, phase in enumerate(phases):
        x = shape(10 + i)
        residual = 0.25 * answer(x, 7.3, phase) + rng.standard_normal(SAMPLES)
        seen.append(answers_of_swings(residual, x, PULSE, SAMPLES))
    found = swings_seen(seen, frequencies(SAMPLES, PERIOD), HIGHEST)[way]
    assert found[0] == pytest.approx(7.3, abs=0.13)
    assert max(found) <= HIGHEST
    assert min(abs(a - b) for a in found for b in found if a != b) > 3 * 0.125


def test_recordings_of_a_mass_at_rest_show_no_swing():
    none = np.zeros(SAMPLES)
    seen = [answers_of_swings(none, none, PULSE, SAMPLES)]
    assert swings_seen(seen, frequencies(SAMPLES, PERIOD), HIGHEST) == ([], [])
