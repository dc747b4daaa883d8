"""Recordings as others make them: reversed sensors, offsets, coarse encoders, motion at once."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.data.recordings import Cut, first_state
from impactscope.discrepancy.driven.findings.ranking import _overlapping
from impactscope.discrepancy.driven.systems.linear_baseline import with_the_mass_alone
from impactscope.discrepancy.driven.systems.linear_oscillator import (
    _agreement,
    _mass_alone,
    linear_oscillator,
    reversed_channels,
)

RATE = 200.0
M, C, K = 2.0, 10.0, 4000.0  # 7 Hz
_SYSTEM = (
    np.array([[0.0, 1.0], [-K / M, -C / M]]),
    np.array([[0.0], [1.0 / M]]),
    np.eye(2),
    np.zeros((2, 1)),
)


def shaken(seed, samples=1200):
    """Force held between the samples, position and acceleration at them."""
    rng = np.random.default_rng(seed)
    sections = signal.butter(4, [1.0, 20.0], 'band', fs=RATE, output='sos')
    force = 40.0 * signal.sosfilt(sections, rng.standard_normal(samples))
    a, b, *_ = signal.cont2discrete(_SYSTEM, 1.0 / RATE)
    state = np.zeros((samples, 2))
    for i in range(samples - 1):
        state[i + 1] = a @ state[i] + b[:, 0] * force[i]
    acceleration = (force - C * state[:, 1] - K * state[:, 0]) / M
    return force, state[:, 0], acceleration


def part(output, drive, unit='m', channel='y'):
    return Cut('a', channel, unit, 'force', 'N', False, 0.0, RATE, output, drive, math.nan)


@pytest.mark.parametrize('which', [1, 2])
def test_a_sensor_that_looks_the_other_way_is_known(which):
    made = shaken(1)
    unit = ('N', 'm', 'm/s^2')[which]
    assert reversed_channels([part(-made[which], made[0], unit)], spring=True) == ('y',)
    assert reversed_channels([part(made[which], made[0], unit)], spring=True) == ()


def test_an_impactor_on_a_load_cell_is_a_mass_whichever_way_its_sensor_looks():
    """Its sensor rings, so that no damped mass explains all of its acceleration."""
    time = np.arange(1000) / RATE
    force = 600.0 * np.where((time > 1.0) & (time < 1.2), np.sin((time - 1.0) * np.pi / 0.2), 0.0)
    own = signal.lfilter([1.0], [1.0, -1.2, 0.9], force)
    acceleration = force / 0.29 + 0.4 * (own - np.mean(own))
    made = part(acceleration, force, 'm/s^2')
    turned = part(-acceleration, force, 'm/s^2')
    assert reversed_channels([made], spring=False) == ()
    assert reversed_channels([turned], spring=False) == ('y',)
    _, _, fitted = linear_oscillator([made], spring=False, held=False)
    assert fitted.values['mass'] == pytest.approx(0.25, abs=0.06)
    assert fitted.values['damping'] < 1.0


def test_force_and_acceleration_of_a_damped_mass_agree():
    time = np.arange(2000) / RATE
    rng = np.random.default_rng(6)
    force = signal.sosfilt(signal.butter(2, 20.0, fs=RATE, output='sos'), rng.normal(size=2000))
    a, b, *_ = signal.cont2discrete(([1.0, 0.0], [2.0, 3.0]), 1.0 / RATE, 'foh')
    acceleration = signal.lfilter(a[0], b, force)  # 2 kg held back by 3 N s/m
    made = part(acceleration, force, 'm/s^2')
    assert _agreement([made]) > 0.9
    assert _agreement([part(-acceleration, force, 'm/s^2')]) < -0.9
    ((mass, damping, stiffness),) = _mass_alone([made])
    assert mass == pytest.approx(2.0, rel=0.05)
    assert 0.0 < damping < mass / time[-1]
    assert stiffness == 0.0
    assert _mass_alone([part(-acceleration, force, 'm/s^2')]) == []


def test_noise_has_no_sign():
    rng = np.random.default_rng(5)
    force, _, _ = shaken(2)
    assert reversed_channels([part(rng.standard_normal(force.size), force)], spring=True) == ()


def test_a_reversed_output_is_turned_and_a_note_says_so():
    entries = [{'file': 'a', 'role': 'fit'}, {'file': 'b', 'role': 'hold_out'}]
    bench = {'kind': 'driven', 'input': 'force', 'outputs': ['displacement'], 'hold': True}
    campaign = parse_campaign(
        {'version': 1, 'bench': bench, 'baseline': ['linear_sensor'], 'recordings': entries}
    )

    def load(file):
        force, x, _ = shaken(3 if file == 'a' else 4)
        noise = 1e-3 * np.std(x) * np.random.default_rng(ord(file)).standard_normal(x.size)
        return {
            'force': ChannelSamples('force', 'N', RATE, 0.0, force),
            'displacement': ChannelSamples('displacement', 'm', RATE, 0.0, noise - x),
        }

    answer = explain_driven(campaign.with_samples(load))
    assert any('sign' in note for note in answer.notes)
    assert answer.baseline_parameters['mass'].value == pytest.approx(M, rel=0.01)
    assert 'further_modes' not in answer.accepted


def test_the_mean_of_an_acceleration_is_the_sensors():
    force, _, acceleration = shaken(6)
    cut = part(acceleration, force, 'm/s^2')
    offset = dataclasses.replace(cut, output=acceleration + 3.0)
    _, _, plain = linear_oscillator([cut], spring=True, held=True)
    _, segments, made = linear_oscillator([offset], spring=True, held=True)
    assert abs(np.mean(segments[0].measured)) < 1e-9
    assert made.rms(0) == pytest.approx(plain.rms(0), rel=1e-6)


def test_the_speed_at_the_beginning_follows_a_motion_that_bends():
    t = np.arange(200) / 500.0
    x = 0.3 * np.sin(2 * np.pi * 4.0 * t + 0.4)
    noise = 1e-5 * np.random.default_rng(7).standard_normal(t.size)
    speed = 0.3 * 2 * np.pi * 4.0 * np.cos(0.4)
    assert first_state(x + noise, 1 / 500.0, 120)[1] == pytest.approx(speed, rel=0.02)


def test_the_speed_at_the_beginning_uses_many_samples_where_it_may():
    t = np.arange(400) / 1000.0
    x = 0.1 * t + 1e-4 * np.random.default_rng(8).standard_normal(t.size)
    assert first_state(x, 1e-3, 200)[1] == pytest.approx(0.1, abs=0.02)


def test_modes_closer_than_they_are_wide_are_called_so():
    assert '14.37 and 14.46 Hz' in _overlapping((14.37, 14.46, 217.9), (0.034, 0.013, 0.1))
    assert _overlapping((900.0, 2640.0, 3669.0), (0.002, 0.001, 0.001)) == ''


def test_outputs_that_are_not_the_motion_of_the_mass_are_told_and_left_alone():
    def asked(*outputs):
        bench = {'kind': 'driven', 'input': 'force.hammer', 'outputs': list(outputs)}
        campaign = {'version': 1, 'bench': bench, 'recordings': [{'file': 'a.mcap'}]}
        return parse_campaign(campaign)

    alone = with_the_mass_alone(asked('force', 'acceleration.plate', 'acceleration.base'))
    assert alone.bench['outputs'] == ['acceleration.plate']
    assert alone.notes[-1].startswith('force, acceleration.base: not compared')
    for outputs in (['force'], ['acceleration.plate', 'displacement.plate']):
        assert with_the_mass_alone(asked(*outputs)).bench['outputs'] == outputs
