"""Masses under any force, or left alone, whose residual is noise: weak effects, and none."""

import re

import numpy as np
import pytest

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven

RATE, SAMPLES, FINE = 400.0, 2400, 16
MASS, DAMPING, STIFFNESS = 2.0, 8.0, 2.0 * (2.0 * np.pi * 12.0) ** 2
FORCE_NOISE, NOISE, SPEED_NOISE = 0.02, 2e-5, 1e-3  # N, m, m/s


def campaign(recordings, bench=None, baseline='linear_sensor', **rest):
    """``recordings``: of channels (unit, samples); the last one is held out."""
    files = [f'r{i}.mcap' for i in range(len(recordings))]
    entries = [{'file': f, 'role': 'fit'} for f in files]
    if len(entries) > 1:
        entries[-1]['role'] = 'hold_out'
    bench = bench or {
        'kind': 'driven',
        'input': 'force.shaker',
        'outputs': ['displacement.plate'],
    }
    data = {'version': 1, 'bench': bench, 'baseline': [baseline], 'recordings': entries, **rest}
    channels = {
        f: {n: ChannelSamples(n, u, RATE, 0.0, np.asarray(v)) for n, (u, v) in made.items()}
        for f, made in zip(files, recordings, strict=True)
    }
    return parse_campaign(data).with_samples(channels.__getitem__)


def moved(*args, **kwargs):
    """Positions, see :func:`course`."""
    return course(*args, **kwargs)[:, 0]


def course(
    force,
    cubic=0.0,
    start=0.0,
    mass=MASS,
    damping=DAMPING,
    stiffness=STIFFNESS,
    *,
    held=False,
    swing=None,
):
    """Position and speed by the rule of Verlet with a small step, at every sixteenth of them.

    ``swing``: share of the stiffness that swings in time, and its frequency.
    """
    step = 1.0 / (RATE * FINE)
    x, v, found = start, 0.0, []
    springs = np.full(len(force), stiffness)
    if swing:
        springs *= 1.0 + swing[0] * np.sin(2.0 * np.pi * swing[1] * step * np.arange(len(force)))
    after = force if held else np.append(force[1:], force[-1])
    for k, (f, later, spring) in enumerate(zip(force, after, springs, strict=True)):
        if k % FINE == 0:
            found.append((x, v))
        pull = f - damping * v - spring * x - cubic * x**3
        half = v + 0.5 * step * pull / mass
        x += step * half
        pull = later - damping * half - spring * x - cubic * x**3
        v = half + 0.5 * step * pull / mass
    return np.array(found)


def shaken(seed, cubic=0.0, add=lambda y, rng: y, cut=0, gain=None, swing=None):
    """A plate on a shaker; with ``cut`` the recordings begin in motion.

    ``gain``: of a second output, the speed.
    """
    rng = np.random.default_rng(seed)
    recordings = []
    for size in (20.0, 35.0, 28.0):
        spectrum = np.zeros(SAMPLES * FINE // 2 + 1, complex)
        band = slice(int(3.0 * SAMPLES / RATE), int(40.0 * SAMPLES / RATE))
        lines = spectrum[band].size
        spectrum[band] = np.exp(2j * np.pi * rng.random(lines))
        fine = np.fft.irfft(spectrum, SAMPLES * FINE)
        fine *= size / np.std(fine) * np.clip(np.arange(fine.size) / (0.05 * fine.size), 0, 1)
        position, speed = course(fine, cubic, swing=swing).T
        y = add(position + NOISE * rng.standard_normal(SAMPLES), rng)
        u = fine[::FINE] + FORCE_NOISE * rng.standard_normal(SAMPLES)
        recordings.append({'force.shaker': ('N', u[cut:]), 'displacement.plate': ('m', y[cut:])})
        if gain is not None:
            v = gain * speed + SPEED_NOISE * rng.standard_normal(SAMPLES)
            recordings[-1]['velocity.plate'] = 'm/s', v
    if gain is None:
        return campaign(recordings)
    outputs = ['displacement.plate', 'velocity.plate']
    return campaign(recordings, {'kind': 'driven', 'input': 'force.shaker', 'outputs': outputs})


@pytest.mark.parametrize('cut', [0, 700])
def test_nothing_is_missing_on_a_shaker(cut):
    answer = explain_driven(shaken(1, cut=cut))
    assert answer.accepted == ()
    held = answer.fit.extended.held_out_rmse['displacement.plate']
    assert held < 1.15 * answer.fit.noise_floor['displacement.plate']


def test_sensors_of_one_mass_may_differ_in_their_gains_as_far_as_they_are_calibrated():
    answer = explain_driven(shaken(3, gain=0.993))
    assert answer.accepted == ()
    told = answer.baseline_parameters['gain.velocity.plate']
    assert told.value == pytest.approx(0.993, abs=4.0 * told.std)


def test_a_gain_that_no_calibration_leaves_open_is_a_wrong_number():
    answer = explain_driven(shaken(4, gain=1.1))
    assert answer.accepted == ('wrong_parameter',)
    found = answer.ranking[0].parameters
    assert found['name'].value == 'gain.velocity.plate'
    assert found['ratio'].value == pytest.approx(1.1, abs=4.0 * found['ratio'].std)
    assert answer.ranking[0].evidence > 16.0
    assert answer.mismatch.p_value < 1e-4
    assert answer.model['sensor'] == {}


def test_a_weak_cube_that_no_share_of_the_residual_shows():
    cubic = 0.004 * STIFFNESS / 0.003**2
    answer = explain_driven(shaken(2, cubic))
    assert answer.accepted == ('hardening_spring',)
    found = answer.ranking[0].parameters['cubic']
    assert abs(found.value - cubic) < 4.0 * found.std


@pytest.mark.parametrize('frequency', [7.0, 21.13])
def test_a_weak_stiffness_that_swings_is_unknown_at_any_frequency(frequency):
    answer = explain_driven(shaken(4, swing=(3e-4, frequency)))
    assert answer.accepted == ('unknown',)
    told = re.search(r'swings at ([0-9.]+) Hz', answer.unexplained_description)
    assert float(told[1]) == pytest.approx(frequency, abs=0.1)


def test_a_yielding_spring_that_yields_early_is_told_in_the_words_of_the_vocabulary():
    share, slip = 0.02, 4e-4
    rng, recordings = np.random.default_rng(5), []
    band = slice(int(6.0 * SAMPLES / RATE), int(30.0 * SAMPLES / RATE))
    for size in (20.0, 60.0, 110.0, 80.0):
        spectrum = np.zeros(SAMPLES * FINE // 2 + 1, complex)
        spectrum[band] = np.exp(2j * np.pi * rng.random(spectrum[band].size))
        force = np.fft.irfft(spectrum, SAMPLES * FINE)
        force *= size / np.std(force) * np.clip(np.arange(force.size) / (0.05 * force.size), 0, 1)
        x = v = h = 0.0
        found, step = [], 1.0 / (RATE * FINE)
        for k, f in enumerate(force):
            if k % FINE == 0:
                found.append(x)
            pull = f - DAMPING * v - STIFFNESS * ((1.0 - share) * x + share * h)
            v += step * pull / MASS
            x += step * v
            if v * h < 0.0:
                h += step * v
            else:  # exactly along the way
                h = np.sign(v) * (slip - (slip - abs(h)) * np.exp(-abs(step * v) / slip))
        recordings.append(
            {
                'force.shaker': ('N', force[::FINE]),
                'displacement.plate': ('m', found + NOISE * rng.standard_normal(SAMPLES)),
            }
        )
    answer = explain_driven(campaign(recordings))
    assert answer.accepted == ('hysteresis',)
    told = answer.ranking[0].parameters
    assert told['share'].value == pytest.approx(share, abs=4.0 * told['share'].std)
    assert told['yield_displacement'].value == pytest.approx(
        slip, abs=4.0 * told['yield_displacement'].std
    )


def test_samples_that_stand_out():
    def spiked(y, rng):
        y[rng.integers(100, y.size - 100, 3)] += 200.0 * NOISE
        return y

    assert explain_driven(shaken(3, add=spiked)).accepted == ()


def test_hum_of_the_output():
    time = np.arange(SAMPLES) / RATE

    def hum(y, rng):
        return y + 0.4 * NOISE * np.sin(2 * np.pi * (50.02 * time + rng.random()))

    answer = explain_driven(shaken(4, add=hum))
    assert answer.accepted == ('mains_hum',)
    found = answer.ranking[0].parameters['amplitude']
    assert abs(found.value - 0.4 * NOISE) < 4.0 * found.std


def test_a_plate_let_go():
    rng = np.random.default_rng(5)
    bench = {'kind': 'driven', 'input': 'none', 'outputs': ['displacement.plate']}
    for cubic, found in ((0.0, ()), (0.02 * STIFFNESS / 0.003**2, ('hardening_spring',))):
        parts = []
        for start in (0.003, 0.002):
            y = moved(np.zeros(SAMPLES * FINE), cubic, start)
            parts.append(
                {'displacement.plate': ('m', y[30:1500] + NOISE * rng.standard_normal(1470))}
            )
        assert explain_driven(campaign(parts, bench)).accepted == found


def test_a_swing_that_dies_away_in_a_random_walk():
    """Its line is not the strongest of the whole recording."""
    rng = np.random.default_rng(9)
    bench = {'kind': 'driven', 'input': 'none', 'outputs': ['displacement.plate']}
    parts = []
    for start in (0.003, 0.002, 0.0025):
        y = moved(np.zeros(SAMPLES * FINE), start=start, damping=6.0 * DAMPING)
        walk = np.cumsum(rng.standard_normal(SAMPLES)) + rng.standard_normal(SAMPLES)
        parts.append({'displacement.plate': ('m', y + 0.2 * NOISE * walk)})
    answer = explain_driven(campaign(parts, bench))
    assert answer.accepted == ()
    found = answer.baseline_parameters
    assert abs(found['stiffness'].value - STIFFNESS / MASS) < 0.01 * STIFFNESS / MASS
