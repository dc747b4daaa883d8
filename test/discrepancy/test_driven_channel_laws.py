"""Laws of a channel that the vocabulary lacks."""

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.adequacy.unmodelled_laws import contrasts

RATE, SAMPLES = 10_000.0, 6000
CHANNELS = 'acceleration.raw', 'acceleration.stored'


def stored(gains, seed=4):
    """A channel that is smoothed without delay; both ends have noise, the input's is small."""
    rng = np.random.default_rng(seed)
    sections = signal.butter(2, 2350.0, fs=RATE, output='sos')
    band = signal.butter(3, 1800.0, fs=RATE, output='sos')
    channels, entries = {}, []
    for i, gain in enumerate(gains):
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == len(gains) - 1 else 'fit'})
        shape = sum(np.exp(-0.5 * ((np.arange(SAMPLES) - c) / 200.0) ** 2) for c in (1500, 4000))
        x = 20.0 * shape * signal.sosfiltfilt(band, rng.standard_normal(SAMPLES))
        ends = x, gain * signal.sosfiltfilt(sections, x)
        channels[file] = {
            name: ChannelSamples(name, 'm/s^2', RATE, 0.0, y + s * rng.standard_normal(SAMPLES))
            for name, y, s in zip(CHANNELS, ends, (0.02, 0.1), strict=True)
        }
    whole = {
        'version': 1,
        'bench': {'kind': 'chain', 'input': CHANNELS[0], 'output': CHANNELS[1]},
        'gain_std': {'acceleration': 0.002},
        'baseline': [],
        'recordings': entries,
    }
    return parse_campaign(whole, 'stored').with_samples(channels.__getitem__)


def test_noise_of_the_input_behind_a_filter_is_no_gain_of_its_own():
    answer = explain_driven(stored([1.0] * 5))
    assert answer.accepted == ('low_pass_filter',)


def test_gains_that_differ_are_not_in_the_library():
    answer = explain_driven(stored([1.0, 1.02, 0.98, 1.01, 0.99]))
    assert 'unknown' in answer.accepted


def test_contrasts_have_nothing_in_common_with_all_rows():
    rows = list(np.random.default_rng(1).standard_normal((4, 50)))
    found = contrasts(rows)
    assert len(found) == len(rows) - 1
    assert np.stack(found) @ np.sum(rows, axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
    assert np.linalg.matrix_rank(np.stack(found)) == len(rows) - 1
