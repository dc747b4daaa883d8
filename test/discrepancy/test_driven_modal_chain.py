"""A filter or a late clock behind a structure of several modes is no further mode."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven

RATE = 5000.0
FINE = 8  # samples of the truth between those of a recording
MODES = ((41.0, 0.015, 0.4), (118.0, 0.01, 0.25))  # Hz, damping ratio, acceleration by force
FURTHER = (207.0, 0.02, 0.2)
INPUT, OUTPUT = 'force.hammer', 'acceleration.structure'


def recorded(rng, modes, chain):
    """Hammer and answer of a structure behind a chain, by exact steps of a fine grid."""
    time = np.arange(round(0.9 * RATE * FINE)) / (RATE * FINE)
    width, begin, peak = rng.uniform(2e-3, 3e-3), rng.uniform(0.05, 0.06), rng.uniform(60.0, 140.0)
    since = (time - begin) / width
    force = np.where((since > 0.0) & (since < 1.0), peak * np.sin(np.pi * since) ** 2, 0.0)
    answer = np.zeros(time.size)
    for frequency, ratio, share in modes:
        omega = 2.0 * np.pi * frequency
        system = ([share, 0.0, 0.0], [1.0, 2.0 * ratio * omega, omega**2])
        above, below, _ = signal.cont2discrete(system, 1.0 / (RATE * FINE), 'foh')
        answer += signal.lfilter(np.ravel(above), below, force)
    answer = chain(answer, time)[::FINE]
    answer = answer + 2e-3 * np.std(answer) * rng.standard_normal(answer.size)
    return {INPUT: ('N', force[::FINE]), OUTPUT: ('m/s^2', answer)}


def campaign(seed, modes, chain):
    rng = np.random.default_rng(seed)
    roles = ('fit', 'fit', 'fit', 'hold_out')
    parsed = parse_campaign(
        {
            'version': 1,
            'bench': {'kind': 'driven', 'input': INPUT, 'outputs': [OUTPUT]},
            'model': {'modes': 2},
            'baseline': ['linear_sensor'],
            'recordings': [{'file': f'r{i}.mcap', 'role': r} for i, r in enumerate(roles)],
        }
    )
    channels = {
        f'r{i}.mcap': {
            name: ChannelSamples(name, unit, RATE, 0.0, values)
            for name, (unit, values) in recorded(rng, modes, chain).items()
        }
        for i in range(len(roles))
    }
    return parsed.with_samples(channels.__getitem__)


def as_it_is(answer, _time):
    return answer


def filtered(answer, _time):
    return signal.sosfilt(signal.butter(2, 300.0, fs=RATE * FINE, output='sos'), answer)


def late(answer, time):
    return np.interp(time - 4e-4, time, answer)


@pytest.mark.parametrize('seed', [1, 2])
def test_nothing_is_found_behind_a_structure_that_is_as_stated(seed):
    assert explain_driven(campaign(seed, MODES, as_it_is)).accepted == ()


def test_a_filter_behind_two_modes_is_told_with_its_corner():
    answer = explain_driven(campaign(3, MODES, filtered))
    assert answer.accepted == ('low_pass_filter',)
    found = answer.ranking[0].parameters
    assert found['order'].value == 2.0
    assert abs(found['cutoff'].value - 300.0) < max(4.0 * found['cutoff'].std, 3.0)


def test_a_late_clock_behind_two_modes_is_told():
    answer = explain_driven(campaign(4, MODES, late))
    assert answer.accepted == ('clock_error',)
    found = answer.ranking[0].parameters['offset']
    assert found.value == pytest.approx(4e-4, abs=max(4.0 * found.std, 4e-6))


def test_a_further_mode_is_no_filter():
    answer = explain_driven(campaign(5, (*MODES, FURTHER), as_it_is))
    assert answer.accepted == ('further_modes',)
