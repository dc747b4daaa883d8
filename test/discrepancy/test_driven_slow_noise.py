"""Slow noise of driven campaigns: no finding, and effects beside it are still found."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg, signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.noise.coloured_noise import Colour, forgetting
from impactscope.discrepancy.driven.systems import slow_noise as slow_noise_module
from impactscope.discrepancy.driven.systems.slow_noise import colour_of_recordings, like_noise

RATE, SAMPLES = 2000.0, 3000


def slow_noise(rng, size):
    """Parts that forget within times a factor of four apart, of equal variance."""
    total = np.zeros(size)
    for keep in (0.9, 0.975, 0.99375, 0.9984, 0.9996, 0.9999):
        fresh = rng.standard_normal(size + 20_000) * np.sqrt(1.0 - keep**2)
        total += signal.lfilter([1.0], [1.0, -keep], fresh)[20_000:]
    return total


def campaign(seed, after=lambda y: y, lowest=3.0, held_out=0.0):
    """A chain with white noise at both ends and slow noise at its output.

    ``lowest``: of its tones, Hz; ``held_out``: of a slow tone in the one that is held out.
    """
    rng = np.random.default_rng(seed)
    entries, channels = [], {}
    time = np.arange(SAMPLES) / RATE
    for i in range(5):
        phases = rng.uniform(0.0, 2.0 * np.pi, 12)
        tones = lowest * 1.37 ** np.arange(12)
        true = 4.0 * np.sum(np.sin(2.0 * np.pi * np.outer(tones, time) + phases[:, None]), axis=0)
        if i == 4:
            true = true + held_out * (1.0 - np.cos(2.0 * np.pi * 0.6 * time))
        raw = true + 0.05 * rng.standard_normal(SAMPLES)
        noise = 0.2 * rng.standard_normal(SAMPLES) + 0.06 * slow_noise(rng, SAMPLES)
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 4 else 'fit'})
        channels[file] = {
            name: ChannelSamples(name, 'm/s^2', RATE, 0.0, values)
            for name, values in (
                ('acceleration.raw', raw),
                ('acceleration.processed', after(true) + noise),
            )
        }
    bench = {'kind': 'chain', 'input': 'acceleration.raw', 'output': 'acceleration.processed'}
    data = {'version': 1, 'bench': bench, 'recordings': entries}
    return parse_campaign(data).with_samples(channels.__getitem__)


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_slow_noise_is_nothing_that_is_missing(seed):
    answer = explain_driven(campaign(seed))
    assert answer.accepted == ()
    assert not answer.unexplained


def test_an_effect_is_found_beside_slow_noise():
    answer = explain_driven(campaign(4, lambda y: np.clip(y, -14.0, 14.0)))
    assert answer.accepted == ('saturation',)


def test_a_slow_motion_that_is_held_out_shows_a_coupling():
    """The others hardly do, and slow noise hides that more is left of this one."""
    low = signal.butter(1, 0.06 / (0.5 * RATE), 'high')
    tested = campaign(2, lambda y: signal.lfilter(*low, y), lowest=15.0, held_out=4.0)
    assert explain_driven(tested).accepted == ('ac_coupling',)


def walk(rng, size):
    """A random walk whose steps are as large as white noise besides."""
    return rng.standard_normal(size) + np.cumsum(rng.standard_normal(size))


def forgetful(keep):
    """Noise that keeps a share of itself from one sample to the next, and nothing besides."""

    def made(rng, size):
        fresh = rng.standard_normal(size + 5000) * np.sqrt(1.0 - keep**2)
        return signal.lfilter([1.0], [1.0, -keep], fresh)[5000:]

    return made


def bare(seed, noise, after=lambda y: y):
    """A chain whose ends have noise without any white part, of one colour."""
    rng = np.random.default_rng(seed)
    entries, channels = [], {}
    time = np.arange(SAMPLES) / RATE
    for i in range(4):
        phases = rng.uniform(0.0, 2.0 * np.pi, 8)
        tones = 2.0 * np.sin(2.0 * np.pi * np.outer(np.geomspace(4.0, 60.0, 8), time).T + phases)
        true = tones.sum(axis=1) * np.hanning(SAMPLES)
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 3 else 'fit'})
        channels[file] = {
            name: ChannelSamples(name, 'm/s^2', RATE, 0.0, values + 0.02 * noise(rng, SAMPLES))
            for name, values in (
                ('acceleration.raw', true),
                ('acceleration.processed', after(true)),
            )
        }
    bench = {'kind': 'chain', 'input': 'acceleration.raw', 'output': 'acceleration.processed'}
    data = {'version': 1, 'bench': bench, 'recordings': entries}
    return parse_campaign(data).with_samples(channels.__getitem__)


@pytest.mark.parametrize('keep', [0.9, 0.99, 0.9985])
def test_slow_noise_of_both_ends_without_a_white_part(keep):
    """Where it is slow it is louder than a faint signal: no line of it may pass for one."""
    answer = explain_driven(bare(8, forgetful(keep)))
    assert answer.accepted == ()
    assert answer.fit.extended.reduced_chi_square == pytest.approx(1.0, abs=0.5)


def test_a_limit_is_found_beside_slow_noise_of_both_ends():
    answer = explain_driven(bare(8, forgetful(0.99), lambda y: np.clip(y, -5.0, 5.0)))
    assert answer.accepted == ('saturation',)
    limit = answer.findings[0].parameters['limit']
    assert limit.value == pytest.approx(5.0, abs=0.02)


def one_over_f(rng, size):
    """White noise and as much of one over f."""
    frequency = np.fft.rfftfreq(16 * size)
    frequency[0] = frequency[1]
    long = np.fft.irfft(np.fft.rfft(rng.standard_normal(16 * size)) / np.sqrt(frequency))
    return rng.standard_normal(size) + 0.5 * long[:size]


@pytest.mark.parametrize('make', [walk, one_over_f, forgetful(0.5), forgetful(0.999)])
def test_noise_of_any_colour_becomes_white(make):
    """In a recording that was not looked at, at every frequency and for its level and slope."""
    rng = np.random.default_rng(7)
    size, power, slow = 2000, [], []
    shapes = [np.ones(size), np.linspace(-1.0, 1.0, size)]
    shapes += [np.cos(np.pi * k * np.arange(size) / size) for k in (1, 3, 10)]
    for _ in range(12):
        colour = colour_of_recordings([make(rng, size) for _ in range(6)])
        whiten = forgetting(colour, size)
        fresh = whiten(make(rng, size))
        power.append(np.mean(fresh**2))
        for shape in shapes:
            seen = whiten(shape)
            slow.append((seen @ fresh) ** 2 / (seen @ seen))
    assert np.mean(power) == pytest.approx(1.0, abs=0.05)
    assert np.mean(slow) < 2.0
    assert like_noise([whiten(make(rng, size)) for _ in range(6)])


def test_white_noise_has_no_colour():
    rng = np.random.default_rng(5)
    white = [rng.standard_normal(1000) for _ in range(5)]
    assert colour_of_recordings(white) is None
    ramp = np.linspace(0.0, 3.0, 1000)
    assert colour_of_recordings([1.0 + ramp + r for r in white]) is None  # which all share


def test_levels_that_differ_show_slow_noise():
    rng = np.random.default_rng(6)
    levels = 0.4 * np.array([-1.2, -0.8, 0.4, 1.6, -1.0, 0.2, 1.3, -0.5])
    apart = [rng.standard_normal(1000) + level for level in levels]
    colour = colour_of_recordings(apart)
    assert colour is not None
    assert colour.white == pytest.approx(1.0, abs=0.05)
    assert all(variance < 0.05 for variance, corner in colour.parts if corner > 0.01)
    whiten = forgetting(colour, 1000)
    steady = whiten(np.ones(1000))
    told = [(steady @ whiten(r)) ** 2 / (steady @ steady) for r in apart]
    assert np.mean(told) < 1.5  # 90 without


def test_whitening_is_that_of_the_covariance():
    """Sum of squares and determinant are those of generalised least squares."""
    colour, size = Colour(0.3, ((2.0, 0.004), (1.0, 0.2))), 200
    lags = np.arange(size)
    column = sum(v * np.exp(-np.pi * c * lags) for v, c in colour.parts)
    covariance = linalg.toeplitz(column) + 0.3 * np.eye(size)
    noise = np.random.default_rng(8).standard_normal(size)
    whiten = forgetting(colour, size)
    white = whiten(noise)
    assert white @ white == pytest.approx(noise @ np.linalg.solve(covariance, noise))
    assert whiten.logarithm(size) == pytest.approx(np.linalg.slogdet(covariance)[1])


def test_a_motion_is_not_like_noise():
    rng = np.random.default_rng(9)
    time = np.arange(2000) / 1000.0
    left = [
        rng.standard_normal(2000) + 3.0 * np.exp(-3.0 * time) * np.sin(40.0 * time + phase)
        for phase in range(5)
    ]
    colour = colour_of_recordings(left)
    assert colour is not None
    whiten = forgetting(colour, 2000)
    assert not like_noise([whiten(r) for r in left])


def test_an_effect_that_was_read_as_noise_is_asked_in_white_noise(monkeypatch):
    """It may bend a spectrum as slow noise does, which then hides it."""
    seen = iter([Colour(1.0, ((400.0, 3e-4),))])
    monkeypatch.setattr(slow_noise_module, 'colour_of_recordings', lambda *_: next(seen, None))
    monkeypatch.setattr(slow_noise_module, 'like_noise', lambda white: True)

    def coupled(y):
        return signal.lfilter(*signal.butter(1, 0.03 / (0.5 * RATE), 'high'), y)

    rng = np.random.default_rng(31)
    entries, channels = [], {}
    for i in range(3):
        true = 3.0 * rng.standard_normal(SAMPLES).cumsum()
        true -= np.linspace(true[0], true[-1], SAMPLES)
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 2 else 'fit'})
        channels[file] = {
            name: ChannelSamples(
                name, 'm/s^2', RATE, 0.0, values + 0.5 * rng.standard_normal(SAMPLES)
            )
            for name, values in (
                ('acceleration.raw', true),
                ('acceleration.processed', coupled(true)),
            )
        }
    bench = {'kind': 'chain', 'input': 'acceleration.raw', 'output': 'acceleration.processed'}
    data = {'version': 1, 'bench': bench, 'recordings': entries}
    answer = explain_driven(parse_campaign(data).with_samples(channels.__getitem__))
    assert answer.accepted == ('ac_coupling',)
