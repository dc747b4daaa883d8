"""Whitening by a spectrum, and what is known of a force and of both ends of a chain."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.driven.data.measured_force import known_force
from impactscope.discrepancy.driven.findings.effect_and_law import CHANCE, LEVEL
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.noise.coloured_noise import Colour
from impactscope.discrepancy.driven.noise.spectral_whitening import (
    fitted_colour,
    levels,
    unlike_noise,
    weight_by_runs,
    whitening,
)
from impactscope.discrepancy.driven.systems.chain_noise import ChainNoise, both_noises
from impactscope.discrepancy.driven.systems.driven_mass_noise import _noise

SAMPLES = 20_000


def test_white_noise_is_only_scaled():
    made = whitening(np.full(1025, 4.0))
    assert made(np.array([2.0, -6.0])) == pytest.approx([1.0, -3.0])


def test_noise_of_a_first_order_filter_becomes_white():
    """Its spectrum is known in closed form: sigma^2 / |1 - a exp(-i w)|^2."""
    a = 0.9
    rng = np.random.default_rng(1)
    noise = signal.lfilter([1.0], [1.0, -a], rng.standard_normal(SAMPLES + 500))[500:]
    turn = np.linspace(0.0, np.pi, 4097)
    white = whitening(1.0 / np.abs(1.0 - a * np.exp(-1j * turn)) ** 2)(noise)
    assert np.mean(white**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / SAMPLES))
    lagged = [white[k:] @ white[:-k] / SAMPLES for k in range(1, 6)]
    assert np.max(np.abs(lagged)) < 5.0 / np.sqrt(SAMPLES)
    assert np.mean(white[:20] ** 2) < 4.0  # what lies before the first sample does not count


def test_samples_without_weight_do_not_count():
    weight = np.ones(100)
    weight[40] = 0.0
    made = whitening(np.ones(129), weight)
    spiked = np.zeros(100)
    spiked[40] = 1e6
    assert not np.any(made(spiked))


def test_a_colour_is_seen_and_white_noise_has_none():
    rng = np.random.default_rng(2)
    white = rng.standard_normal(SAMPLES)
    slow = white + signal.lfilter([0.3], [1.0, -0.97], rng.standard_normal(SAMPLES))
    still = np.zeros(SAMPLES)
    for noise, coloured in ((white, False), (slow, True)):
        place, left = levels([noise])
        _, loud = levels([still])
        found = fitted_colour(place, left, loud, 0.5 * SAMPLES)
        assert (found is not None) is coloured


@pytest.mark.parametrize('seed', [4, 5, 6])
@pytest.mark.parametrize(
    ('slowest', 'error'), [('corner', False), ('walk', False), ('mass', True)]
)
def test_what_a_force_does_to_a_mass_is_no_sensors_noise(slowest, error, seed):
    """A corner and even a walk are noise; the position of a pushed mass falls more steeply."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((2, SAMPLES))
    noise = 0.01 * white[0]
    if slowest == 'corner':
        noise = noise + signal.lfilter([0.1], [1.0, -0.99], white[1])
    elif slowest == 'walk':
        noise = noise + 0.1 * np.cumsum(white[1])
    else:
        force = signal.lfilter([1.0], [1.0, -0.97], white[1])
        speed = signal.lfilter([1.0], [1.0, -0.998], force)
        noise = noise + np.cumsum(speed)
    place, left = levels([noise], slow=True)
    found = fitted_colour(place, left, np.zeros(place.size), 0.5 * SAMPLES)
    assert found is not None
    assert unlike_noise(found, place, left, 0.5 * SAMPLES) is error


def test_a_force_that_stands_still_is_known_by_its_mean():
    rng = np.random.default_rng(3)
    steps = np.repeat([0.0, 5.0, -2.0, 1.0], 1000)
    known = known_force(steps + 0.05 * rng.standard_normal(steps.size))
    assert known.noise == pytest.approx(0.05**2, rel=0.3)
    assert known.moves < 0.3
    inside = np.abs(np.arange(steps.size) % 1000 - 500) < 300
    assert np.max(np.abs(known.force - steps)[inside]) < 0.02
    assert known.error is not None
    edge = known.error.variance[998:1003]
    assert np.max(edge) > 100.0 * np.median(known.error.variance)  # between which samples?


def test_the_noise_of_a_force_that_turns_sharply_is_seen_where_it_stands_still():
    """What its corners have at the highest frequencies is no noise."""
    rng = np.random.default_rng(7)
    time = np.arange(4000) / 4096.0
    swings = 50.0 * np.sin(2.0 * np.pi * 37.0 * time)
    force = np.where((time > 0.15) & (time < 0.9), swings, 0.0)
    known = known_force(force + 1.5e-4 * rng.standard_normal(force.size))
    assert known.noise == pytest.approx(1.5e-4**2, rel=0.2)
    assert known.moves == pytest.approx(0.77, abs=0.03)


def test_the_noise_of_a_broad_force_is_not_known():
    known = known_force(np.random.default_rng(4).standard_normal(4000))
    assert np.isnan(known.noise)
    assert known.error is None


def test_noises_of_both_ends():
    rng = np.random.default_rng(5)
    sections = signal.butter(4, 0.1, output='sos')
    x = 100.0 * signal.sosfilt(sections, rng.standard_normal(SAMPLES))
    u, y = x + 0.3 * rng.standard_normal(SAMPLES), x + 0.1 * rng.standard_normal(SAMPLES)
    into, out = both_noises([u], [y])
    assert into == pytest.approx(0.09, rel=0.15)
    assert out == pytest.approx(0.01, rel=0.15)
    assert both_noises([u], [u + 0.01 * rng.standard_normal(SAMPLES)]) is None  # it passes
    assert both_noises([x], [y]) is None  # none


def test_a_coarse_reading_that_rests_counts_once():
    rng = np.random.default_rng(10)
    time = np.arange(4000) / 1000.0
    swing = 40.0 * np.exp(-3.0 * time) * np.sin(200.0 * time)
    read = np.round(swing + 0.1 * rng.standard_normal(time.size))
    weight = weight_by_runs(read, 0.31)
    assert weight is not None
    assert np.mean(weight[:500] ** 2) > 0.8  # it swings over many steps
    assert np.sum(weight[3000:] ** 2) < 20.0  # it reads nothing but zero
    fine = 0.2 * np.round((swing + 0.1 * rng.standard_normal(time.size)) / 0.2)
    assert weight_by_runs(fine, 0.115) is None


def test_white_noise_of_an_input_is_no_faint_signal_where_the_outputs_noise_is_slow():
    """A candidate that turns it, line by line, would fit the output's noise by chance."""
    rng = np.random.default_rng(6)
    sections = signal.butter(4, 0.05, output='sos')
    x = 100.0 * signal.sosfilt(sections, rng.standard_normal(SAMPLES))
    x[: SAMPLES // 2] *= np.hanning(SAMPLES // 2)
    x[SAMPLES // 2 :] = 0.0
    keep = 0.9
    slow = signal.lfilter([math.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(SAMPLES))
    into, out = 0.05, 1.0
    u, y = x + into * rng.standard_normal(SAMPLES), x + out * slow
    drive = np.stack([u, np.zeros(SAMPLES)])
    chain = Segment('r', 'c', 'N', False, 0.0, 1e-4, y, drive)
    flat = (np.full(SAMPLES // 2 + 1, v**2) for v in (into, out))
    noise, drive = ChainNoise.of(chain, *flat, 1.0)
    whole = dataclasses.replace(chain, whitener=noise, drive=drive)
    colour = Colour(0.0, ((1.0, -math.log(keep) / math.pi),))
    made = noise.evened_out().coloured(whole, colour, 1.0, [u])
    faint = np.abs(np.fft.rfft(made.drive[1] - made.drive[3])) ** 2 / SAMPLES
    assert np.mean(faint[SAMPLES // 4 :]) < 0.1 * into**2
    assert np.mean(np.abs(np.fft.rfft(made.drive[0])[10:300]) ** 2) > 1e3  # the signal is there


@pytest.mark.parametrize('samples', [1500, 6000])
def test_how_well_the_level_of_white_noise_is_told(samples):
    """In standard deviations that chi-square has of two recordings by chance."""
    rng = np.random.default_rng(8)
    chance = math.sqrt(2.0 / (2 * samples))
    off = []
    for _ in range(150):
        left = rng.standard_normal((2, samples))
        place, level = levels(list(left))
        nothing = np.zeros(place.size)
        white, _, _ = _noise(place, level, nothing, nothing, 0.0, samples, 0.01, beside=False)
        off.append((float(np.mean(left**2)) / white - 1.0) / chance)
    assert np.std(off) == pytest.approx(math.hypot(1.0, LEVEL), rel=0.25)
    assert np.mean(np.array(off) > CHANCE) < 0.02
