"""Low-passes that act before samples are taken, also far above half the sampling rate."""

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.channel_effects import channel_terms
from impactscope.discrepancy.driven.measuring import passed_on, power_passed

RATE, SAMPLES, NOISE = 2000.0, 3000, 0.05
CHANNELS = 'acceleration.raw', 'acceleration.processed'


def response(order, cutoff, frequency):
    """Of an analogue Butterworth, from its definition."""
    return 1.0 / np.polyval(signal.butter(order, 1.0, analog=True)[1], 1j * frequency / cutoff)


def campaign(seed, order, cutoff):
    """Bursts of 20 to 300 Hz, filtered before they are sampled; the last is held out."""
    rng = np.random.default_rng(seed)
    entries, channels = [], {}
    for i in range(3):
        long = 4 * SAMPLES
        frequency = np.fft.rfftfreq(long, 1.0 / RATE)
        spectrum = np.zeros(frequency.size, complex)
        band = (frequency > 20.0) & (frequency < 300.0)
        spectrum[band] = rng.standard_normal((2, np.count_nonzero(band))).T @ [1.0, 1.0j]
        shape = np.exp(-0.5 * ((np.arange(long) - 1.5 * SAMPLES) / (0.1 * SAMPLES)) ** 2)
        raw = np.fft.irfft(spectrum, long) * shape
        after = np.fft.irfft(np.fft.rfft(raw) * response(order, cutoff, frequency), long)
        pair = np.stack([raw, after])[:, SAMPLES : 2 * SAMPLES] * 100.0 / np.max(np.abs(raw))
        pair[1] += NOISE * rng.standard_normal(SAMPLES)
        name = f'r{i}.mcap'
        entries.append({'file': name, 'role': 'hold_out' if i == 2 else 'fit'})
        channels[name] = {
            c: ChannelSamples(c, 'm/s^2', RATE, 0.0, values.astype(np.float32).astype(float))
            for c, values in zip(CHANNELS, pair, strict=True)
        }
    described = {
        'version': 1,
        'bench': {'kind': 'chain', 'input': CHANNELS[0], 'output': CHANNELS[1]},
        'baseline': [],
        'recordings': entries,
    }
    return parse_campaign(described, 'filters').with_samples(channels.__getitem__)


@pytest.mark.parametrize(('order', 'cutoff'), [(1, 700.0), (4, 1500.0), (8, 9000.0)])
def test_a_sine_behind_an_analogue_low_pass(order, cutoff):
    term = next(
        t
        for t in channel_terms('c', 'N', RATE, 1.5, 0.1, 1.0)
        if t.label == f'low_pass_filter/analogue-{order}'
    )
    values = {f'{term.label}.cutoff': cutoff}
    time = np.arange(SAMPLES) / RATE
    turn = 2.0 * np.pi * 130.0 * time
    found = passed_on(np.sin(turn), {term.name: term}, values, 1.0 / RATE, 0.0)
    gain = response(order, cutoff, 130.0)
    inside = slice(300, -300)
    expected = np.abs(gain) * np.sin(turn + np.angle(gain))
    assert np.allclose(found[inside], expected[inside], atol=2e-3)
    share = power_passed((term,), values, np.array([130.0]), RATE)
    assert share == pytest.approx([np.abs(gain) ** 2])


def test_a_cutoff_above_half_the_rate_is_found():
    answer = explain_driven(campaign(1, 2, 1400.0))
    assert answer.accepted == ('low_pass_filter',)
    found = answer.findings[0].parameters
    assert found['order'].value == 2.0
    cutoff = found['cutoff']
    assert abs(cutoff.value - 1400.0) < 4.0 * cutoff.std < 40.0


def test_a_filter_of_which_the_delay_is_left_is_in_a_class_with_a_clock():
    answer = explain_driven(campaign(2, 3, 6000.0))
    (first,) = answer.findings
    named = {first.name, *first.confused_with}
    assert named >= {'low_pass_filter', 'clock_error'}
