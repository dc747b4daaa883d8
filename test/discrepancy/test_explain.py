"""What holds for the answer to every kind of campaign."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.answer import Finding, ParameterEstimate
from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.explain import _as_far_as_known, _filter_or_delay, explain

RATE = 2000.0


def filtered(cutoff):
    """A chain with a low-pass of first order, seen by slow vibrations."""
    rng = np.random.default_rng(3)
    names = [f'{i}.mcap' for i in range(4)]
    data = {
        'version': 1,
        'bench': {'kind': 'chain', 'input': 'acceleration.raw', 'output': 'acceleration.out'},
        'baseline': [],
        'recordings': [
            {'file': n, 'role': 'hold_out' if n == names[-1] else 'fit'} for n in names
        ],
    }
    samples = {}
    fine = 10
    for i, name in enumerate(names):
        t = np.arange(int(1.5 * RATE) * fine) / (fine * RATE)
        raw = 30 * np.exp(-((t - 0.7) ** 2) / 0.02) * np.sin(2 * np.pi * (20 + 8 * i) * t)
        out = signal.sosfilt(signal.butter(1, cutoff, fs=fine * RATE, output='sos'), raw)
        samples[name] = {
            channel: ChannelSamples(
                channel, 'm/s^2', RATE, 0.0, v[::fine] + rng.normal(0, noise, t.size // fine)
            )
            for channel, v, noise in (
                ('acceleration.raw', raw, 1e-3),
                ('acceleration.out', out, 0.02),
            )
        }
    return parse_campaign(data).with_samples(samples.__getitem__)


@pytest.fixture(scope='module')
def explained():
    return explain(filtered(100.0))


def test_an_analogue_filter_is_found_within_what_its_form_leaves_open(explained):
    (found,) = [f for f in explained.ranking if f.name in explained.accepted]
    assert found.name == 'low_pass_filter'
    cutoff = found.parameters['cutoff']
    assert abs(cutoff.value - 100.0) < 2 * cutoff.std < 3.0


def test_a_cutoff_has_no_interval_where_the_filter_may_be_a_delay(explained):
    (found,) = [f for f in explained.ranking if f.name in explained.accepted]
    seen = _as_far_as_known(dataclasses.replace(found, confused_with=()), filtered(100.0))
    unseen = _as_far_as_known(
        dataclasses.replace(found, confused_with=('clock_error',)), filtered(100.0)
    )
    assert seen.parameters['cutoff'].std > 0
    assert math.isnan(unseen.parameters['cutoff'].std)
    assert unseen.parameters['cutoff'].value == found.parameters['cutoff'].value


@pytest.mark.parametrize(
    ('offset', 'drift', 'alike'),
    [(2e-4, 0.0, True), (-2e-4, 1e-9, True), (2e-3, 0.0, False), (2e-4, 1e-4, False)],
)
def test_a_delay_within_a_sample_or_so_may_be_a_filter(offset, drift, alike):
    numbers = {
        'offset': ParameterEstimate(offset, 1e-6, 's'),
        'drift': ParameterEstimate(drift, 1e-8, '1'),
    }
    clock = Finding('clock_error', 0.9, parameters=numbers)
    marked = _filter_or_delay(clock, filtered(100.0))
    assert marked.confused_with == (('low_pass_filter',) if alike else ())
