"""Gains over the dispersion that is left."""

import numpy as np
import pytest

from impactscope.discrepancy.driven.model_selection.overdispersion import levels_above, worth_of

N = 20000


def test_noise_has_no_level_above_itself():
    rng = np.random.default_rng(1)
    assert np.mean(levels_above(rng.standard_exponential(N), 1.0) > 1.0) < 0.05


def test_a_gain_in_noise_is_what_it_is():
    rng = np.random.default_rng(2)
    noise, shape = rng.standard_normal(N), np.sin(0.3 * np.arange(N))
    before = noise + 0.1 * shape
    gain = float(before @ before - noise @ noise)
    assert worth_of([before], [noise]) == pytest.approx([gain], rel=0.05)


def test_noise_taken_for_too_small_makes_gains_small():
    rng = np.random.default_rng(3)
    noise, shape = 1.2 * rng.standard_normal(N), np.sin(0.3 * np.arange(N))
    before = noise + 0.1 * shape
    gain = float(before @ before - noise @ noise)
    assert worth_of([before], [noise])[0] == pytest.approx(gain / 1.44, rel=0.06)


def test_a_line_is_measured_by_its_neighbours():
    """Noise that is strong in one band alone: a line in the band counts less than one outside."""
    rng = np.random.default_rng(4)
    spectrum = np.fft.rfft(rng.standard_normal(N))
    spectrum[400:600] *= 3.0
    noise = np.fft.irfft(spectrum, N)
    worth = []
    for line in (500, 3000):
        before = noise + 0.1 * np.sin(2.0 * np.pi * line * np.arange(N) / N)
        gain = float(before @ before - noise @ noise)
        worth.append(worth_of([before], [noise])[0] / gain)
    assert worth[0] == pytest.approx(1.0 / 9.0, rel=0.3)
    assert worth[1] > 0.75


def test_a_blow_is_measured_by_what_is_left_of_it():
    rng = np.random.default_rng(5)
    noise = rng.standard_normal(N)
    noise[5000:5200] *= 5.0
    before = noise.copy()
    before[5000:5200] += 2.0
    gain = float(before @ before - noise @ noise)
    assert worth_of([before], [noise])[0] < 0.1 * gain


def _worth_of_a_level(louder: float) -> tuple[float, float]:
    """Of a level in five recordings, each alone and together, over its gain; 8 draws."""
    alone = together = gain = 0.0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        before, after = [], []
        for n in (9000, 11000, 13000, 14000, 12500):
            spectrum = np.fft.rfft(rng.standard_normal(n))
            spectrum[0] = 0.0
            spectrum[1:9] *= louder
            after.append(np.fft.irfft(spectrum, n))
            before.append(after[-1] + 0.02)
        alone += sum(worth_of(before, after))
        together += sum(worth_of(before, after, ['acceleration'] * 5))
        apart = sum(worth_of(before, after, [f'channel {k}' for k in range(5)]))
        assert apart == pytest.approx(sum(worth_of(before, after)))
        gain += sum(float(b @ b - a @ a) for b, a in zip(before, after, strict=True))
    return alone / gain, together / gain


def test_slow_noise_of_a_channel_is_seen_by_its_recordings_together():
    """Forty lines of five recordings tell what the eight of each do not: a level is in them."""
    alone, together = _worth_of_a_level(louder=1.6)
    assert alone > 0.65
    assert together < 0.55


def test_white_noise_of_several_recordings_takes_little_from_a_level():
    _, together = _worth_of_a_level(louder=1.0)
    assert together > 0.95
