import numpy as np
import pytest

from impactscope.errors import ConfigurationError, InputError
from impactscope.signals.filters import CHANNEL_CLASSES, channel_class_filter, design_frequency

RATE = 51_200.0


def gain(frequency: float, channel_class: int, standard: str) -> float:
    time = np.arange(int(RATE)) / RATE
    middle = slice(int(0.3 * RATE), int(0.7 * RATE))
    filtered = channel_class_filter(
        np.sin(2 * np.pi * frequency * time), RATE, channel_class, standard
    )
    basis = np.exp(-2j * np.pi * frequency * time)[middle] * np.hanning(middle.stop - middle.start)
    return abs(filtered[middle] @ basis) / abs(
        np.sin(2 * np.pi * frequency * time)[middle] @ basis
    )


@pytest.mark.parametrize('standard', ['SAE J211', 'ISO 6487'])
@pytest.mark.parametrize(
    ('channel_class', 'corner'), [(60, 100.0), (180, 300.0), (600, 1000.0), (1000, 1650.0)]
)
def test_three_decibels_at_the_corner_of_the_class(channel_class, corner, standard):
    level = 20 * np.log10(gain(corner, channel_class, standard))
    assert level == pytest.approx(-3.0, abs=0.15)
    assert gain(corner / 10, channel_class, standard) == pytest.approx(1.0, abs=1e-3)
    assert 20 * np.log10(gain(corner * 4, channel_class, standard)) < -40


def test_design_frequencies():
    assert design_frequency(180) == pytest.approx(373.95)
    assert design_frequency(180, 'ISO 6487') == pytest.approx(375.0)


@pytest.mark.parametrize(('channel_class', 'loss'), [(60, 0.087), (180, 0.001)])
def test_loss_at_the_peak_of_a_free_hand_blow(channel_class, loss):
    # An 8.6 ms half-sine at 10 kHz: the losses stated in the project's collection of standards.
    time = np.arange(-0.05, 0.06, 1e-4)
    blow = np.where((time >= 0) & (time <= 0.0086), np.sin(np.pi * time / 0.0086), 0.0)
    peak = channel_class_filter(blow, 10_000.0, channel_class).max()
    assert 1 - peak / blow.max() == pytest.approx(loss, abs=0.003)


def test_no_phase_shift_and_no_step_at_the_ends():
    time = np.arange(2000) / 10_000
    ramp = 3.0 + 50.0 * time
    assert np.allclose(channel_class_filter(ramp, 10_000, 180), ramp, atol=1e-6)
    rows = np.stack([ramp, -ramp])
    assert np.allclose(channel_class_filter(rows, 10_000, 60), rows, atol=1e-6)


@pytest.mark.parametrize('size', [2, 3, 10])
def test_short_signals(size):
    assert channel_class_filter(np.ones(size), 10_000, 180).shape == (size,)


@pytest.mark.parametrize(
    ('values', 'rate', 'channel_class', 'standard', 'error', 'words'),
    [
        (np.ones(100), 10_000, 90, 'SAE J211', ConfigurationError, '90'),
        (np.ones(100), 10_000, 180, 'DIN', ConfigurationError, 'DIN'),
        (np.ones(100), 500, 180, 'SAE J211', InputError, '500'),
        (np.ones(100), np.nan, 180, 'SAE J211', InputError, 'nan'),
        (np.array([1.0, np.nan]), 10_000, 180, 'SAE J211', InputError, 'NaN'),
        (np.ones(1), 10_000, 180, 'SAE J211', InputError, r'\(1,\)'),
    ],
)
def test_bad_input(values, rate, channel_class, standard, error, words):
    with pytest.raises(error, match=words):
        channel_class_filter(values, rate, channel_class, standard)


def test_every_class_is_known():
    assert [design_frequency(c) for c in CHANNEL_CLASSES] == sorted(
        2.0775 * c for c in CHANNEL_CLASSES
    )
