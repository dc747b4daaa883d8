"""A plate under a shaker whose measured force is noisy, and whose accelerometer has a level."""

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.explain import explain

MASS, STIFFNESS, DAMPING = 1.5, 75_000.0, 54.0
RATE, FINE, SECONDS = 2000.0, 10, 2.0
FORCE_NOISE, NOISE = 0.085, 0.055
FORCE, PLATE = 'force.shaker', 'acceleration.plate'


def recording(seed, size, offset):
    """Force and acceleration of a linear plate, from rest, between two sensors' noise."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(SECONDS * RATE) * FINE) / (RATE * FINE)
    lines = np.arange(6.0, 120.0, 1.3)
    phases = rng.uniform(0.0, 2.0 * np.pi, lines.size)
    force = sum(np.sin(2.0 * np.pi * f * time + p) for f, p in zip(lines, phases, strict=True))
    force *= size / np.std(force) * np.minimum(1.0, time / 0.3) ** 2
    rates = np.array([[0.0, 1.0], [-STIFFNESS / MASS, -DAMPING / MASS]])
    push, shows = np.array([[0.0], [1.0 / MASS]]), rates[1:]
    system = signal.cont2discrete((rates, push, shows, push[1:]), 1.0 / (RATE * FINE), 'foh')
    above, below = signal.ss2tf(*system[:4])
    plate = signal.lfilter(above[0], below, force)
    count = time.size // FINE
    return {
        FORCE: force[::FINE] + FORCE_NOISE * rng.standard_normal(count),
        PLATE: plate[::FINE] + offset + NOISE * rng.standard_normal(count),
    }


@pytest.mark.parametrize('offset', [0.0, pytest.param(1.06, marks=pytest.mark.slow)])
def test_a_level_is_found_and_the_noise_of_the_force_is_no_mode(offset):
    samples, entries = {}, []
    for i, size in enumerate((18.0, 26.0, 35.0, 22.0)):
        file = f'rec{i}.mcap'
        values = recording(i, size, offset)
        samples[file] = {
            name: ChannelSamples(name, unit, RATE, 0.0, values[name])
            for name, unit in ((FORCE, 'N'), (PLATE, 'm/s^2'))
        }
        entries.append({'file': file, 'role': 'hold_out' if i == 3 else 'fit'})
    data = {
        'version': 1,
        'bench': {'kind': 'driven', 'input': FORCE, 'outputs': [PLATE]},
        'model': {'modes': 1},
        'baseline': ['linear_sensor'],
        'recordings': entries,
    }
    answer = explain(parse_campaign(data, 'shaker').with_samples(samples.__getitem__))
    assert answer.accepted == (('offset',) if offset else ())
    assert not answer.unexplained
    if offset:
        assert answer.findings[0].parameters['value'].value == pytest.approx(offset, rel=0.01)
