"""Low-passes that act before samples are taken, also far above half the sampling rate."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import signal, stats

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.models.channel_effects import channel_terms
from impactscope.discrepancy.driven.models.measuring_chain import (
    OUTER,
    _mean_of_middle,
    passed_on,
    power_passed,
    power_retimed,
    retimed,
)
from impactscope.discrepancy.driven.noise.noise_bands import band_levels
from impactscope.discrepancy.driven.systems.chain import _floor, _noise_passed

RATE, SAMPLES, NOISE = 2000.0, 3000, 0.05
CHANNELS = 'acceleration.raw', 'acceleration.processed'


def response(order, cutoff, frequency):
    """Of an analogue Butterworth, from its definition."""
    return 1.0 / np.polyval(signal.butter(order, 1.0, analog=True)[1], 1j * frequency / cutoff)


def described(pairs, name):
    """A chain of recordings, (raw, processed) each; the last is held out."""
    entries, channels = [], {}
    for i, pair in enumerate(pairs):
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == len(pairs) - 1 else 'fit'})
        channels[file] = {
            c: ChannelSamples(c, 'm/s^2', RATE, 0.0, values.astype(np.float32).astype(float))
            for c, values in zip(CHANNELS, pair, strict=True)
        }
    bench = {'kind': 'chain', 'input': CHANNELS[0], 'output': CHANNELS[1]}
    whole = {'version': 1, 'bench': bench, 'baseline': [], 'recordings': entries}
    return parse_campaign(whole, name).with_samples(channels.__getitem__)


def campaign(seed, order, cutoff):
    """Bursts of 20 to 300 Hz, filtered before they are sampled; the last is held out."""
    rng = np.random.default_rng(seed)
    pairs = []
    for _ in range(3):
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
        pairs.append(pair)
    return described(pairs, 'filters')


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


def test_a_course_that_ends_in_motion_does_not_ring_behind_an_analogue_low_pass():
    cutoff = 0.6 * RATE
    (term,) = [
        t
        for t in channel_terms('c', 'N', RATE, 1.5, 0.1, 1.0)
        if t.label == 'low_pass_filter/analogue-1'
    ]
    time = np.arange(SAMPLES) / RATE
    turn = 2.0 * np.pi * 5.0 * time + 0.3
    values = {f'{term.label}.cutoff': cutoff}
    found = passed_on(np.sin(turn), {term.name: term}, values, 1.0 / RATE, 0.0)
    gain = response(1, cutoff, 5.0)
    expected = np.abs(gain) * np.sin(turn + np.angle(gain))
    step = 2.0 * np.pi * 5.0 / RATE  # what a course that stops at its end would be off by
    assert np.allclose(found, expected, atol=0.01 * step)


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


@pytest.mark.parametrize('before', [0, 500])  # a filter that begins with nothing, or ran before
@pytest.mark.parametrize('order', [1, 4])
def test_a_recording_that_begins_in_motion_holds_what_was_before(before, order):
    term = next(
        t
        for t in channel_terms('c', 'N', RATE, 1.5, 0.1, 1.0, ends=(2, 0))
        if t.label == f'low_pass_filter/causal-{order}'
    )
    assert term.own == 2 * order
    wave = np.sin(2.0 * np.pi * 7.3 * np.arange(SAMPLES + before) / RATE + 1.0)
    sections = signal.butter(order, 20.0, fs=RATE, output='sos')
    out = signal.sosfilt(sections, wave)[before:]
    values = {f'{term.label}.cutoff': 20.0}
    parts = {term.name: term}
    found = passed_on(wave[before:], parts, values, 1.0 / RATE, 0.0, measured=out)
    assert np.allclose(found, out, atol=1e-9)
    unknown = passed_on(wave[before:], parts, values, 1.0 / RATE, 0.0)
    assert (np.max(np.abs(unknown - out)) < 1e-9) == (before == 0)


@pytest.mark.parametrize('speed', [0.1, 1.0])
def test_a_coupling_that_fades_within_no_recording_leaves_a_position_as_it_is(speed):
    """Of an axis that sets out to a place far from where it stood, at rest or in motion."""
    term = next(t for t in channel_terms('c', 'm', RATE, 1.5, 0.1, 1.0) if t.name == 'ac_coupling')
    values = {f'{term.label}.corner': 1e-9}
    time = np.arange(SAMPLES) / RATE
    way = 0.01 * np.tanh(speed * 100.0 * time)
    found = passed_on(way, {term.name: term}, values, 1.0 / RATE, 0.0, before=0.0)
    assert np.allclose(found, way, atol=1e-8)


def test_a_course_that_is_off_at_its_end_makes_no_level_before_it():
    """A coupling takes the level before a recording off all of it, also one that is none."""
    term = next(
        t for t in channel_terms('c', 'N', RATE, 1.5, 0.1, 1.0) if t.label == 'ac_coupling/output'
    )
    wave = np.zeros(SAMPLES)
    wave[SAMPLES // 10 :] = np.sin(2.0 * np.pi * 7.3 * np.arange(SAMPLES - SAMPLES // 10) / RATE)
    values = {f'{term.label}.corner': 1e-6}
    off = wave.copy()
    off[:6] += (0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
    for samples in (wave, off):
        found = passed_on(samples, {term.name: term}, values, 1.0 / RATE, 0.0)
        assert np.max(np.abs(found[6:] - wave[6:])) < 1e-4


@given(arrays(np.float64, st.integers(8, 60), elements=st.floats(-1e3, 1e3)))
def test_the_mean_of_the_middle_is_that_of_scipy(samples):
    assert _mean_of_middle(samples) == stats.trim_mean(samples, OUTER)


@pytest.mark.parametrize('both', [False, True])  # forwards, and backwards, too
def test_a_slow_filter_of_recordings_cut_from_a_longer_one(both):
    answer = explain_driven(cut_out(3, 25.0, both=both))
    assert answer.accepted == ('low_pass_filter',)
    found = answer.findings[0].parameters
    assert (found['order'].value, found['zero_phase'].value) == (2.0, float(both))
    cutoff = found['cutoff']
    assert abs(cutoff.value - 25.0) < 4.0 * cutoff.std < 2.0


def cut_out(seed, cutoff, *, both=False):
    """Motion of 1 to 15 Hz that goes on, behind a filter; three pieces, the last held out."""
    rng = np.random.default_rng(seed)
    frequency = np.fft.rfftfreq(8 * SAMPLES, 1.0 / RATE)
    spectrum = np.zeros(frequency.size, complex)
    band = (frequency > 1.0) & (frequency < 15.0)
    spectrum[band] = rng.standard_normal((2, np.count_nonzero(band))).T @ [1.0, 1.0j]
    raw = np.fft.irfft(spectrum)
    raw *= 100.0 / np.max(np.abs(raw))
    run = signal.sosfiltfilt if both else signal.sosfilt
    after = run(signal.butter(2, cutoff, fs=RATE, output='sos'), raw)
    pieces = [slice((2 * i + 2) * SAMPLES, (2 * i + 3) * SAMPLES) for i in range(3)]
    pairs = [(raw[p], after[p] + NOISE * rng.standard_normal(SAMPLES)) for p in pieces]
    return described(pairs, 'cut out')


@pytest.mark.parametrize('shift', [0.5, 0.25, -0.49, 1.3])
def test_how_much_noise_a_late_clock_takes_away_is_known(shift):
    """Between two samples a spline smooths: half a sample late, a quarter of noise is gone."""
    late = next(
        t for t in channel_terms('c', 'N', RATE, 1.5, 0.1, 1.0) if t.label == 'clock_error/output'
    )
    values = {f'{late.label}.offset': shift / RATE}
    frequency = np.linspace(0.0, 0.5 * RATE, 1000)[1:-1]
    white = np.random.default_rng(3).standard_normal(40_000)
    left = np.var(retimed(white, shift / RATE, 0.0, 1.0 / RATE)[100:-100])
    told = power_retimed((late,), values, frequency, 1.0 / RATE)
    assert np.mean(told) == pytest.approx(left, abs=0.02)
    assert told[0] == pytest.approx(1.0, abs=1e-6)
    assert np.all(power_retimed((), {}, frequency, 1.0 / RATE) == 1.0)


def smoothed(keep, samples):
    """Exponential smoothing as firmware does it, from the first sample on."""
    return signal.lfilter([1.0 - keep], [1.0, -keep], samples, zi=[keep * samples[0]])[0]


@pytest.mark.parametrize('noisy', [0.0, 1.0])
def test_exponential_smoothing_is_a_low_pass_and_no_early_clock(noisy):
    """Of what was recorded, noise and all: it lets a seventh of that through at half the rate.

    Next to half the rate it is no Butterworth, and half a sample earlier than one.
    """
    keep, rng = 0.75, np.random.default_rng(3)
    time = np.arange(SAMPLES) / RATE
    pairs = []
    for i in range(3):
        raw = 20.0 * np.sin(2.0 * np.pi * (7.0 + i) * time) + 8.0 * np.sin(90.0 * time + i)
        raw = raw + noisy * rng.standard_normal(SAMPLES)
        pairs.append((raw, smoothed(keep, raw) + 1e-3 * rng.standard_normal(SAMPLES)))
    answer = explain_driven(described(pairs, 'smoothed'))
    assert answer.accepted == ('low_pass_filter',)
    found = answer.ranking[0].parameters
    assert (found['order'].value, found['zero_phase'].value) == (1.0, 0.0)
    assert found['cutoff'].value == pytest.approx(-np.log(keep) * RATE / (2.0 * np.pi), rel=0.005)


@pytest.mark.parametrize(
    ('keep', 'size', 'least', 'most'),
    [
        (0.75, SAMPLES, 0.99, 1.01),
        (None, SAMPLES, -0.3, 0.3),
        (None, 300, 0.0, 0.0),  # too few lines to tell
    ],
)
def test_noise_that_has_passed_goes_with_the_inputs_whatever_is_left_of_it(
    keep, size, least, most
):
    """``keep``: of smoothing; none: the output has noise of its own."""
    rng = np.random.default_rng(4)
    signals = 50.0 * np.sin(2.0 * np.pi * 20.0 * np.arange(SAMPLES) / RATE)
    raw = [(signals + rng.standard_normal(SAMPLES))[:size] for _ in range(3)]
    out = [
        smoothed(keep, u) if keep else signals[:size] + 0.1 * rng.standard_normal(size)
        for u in raw
    ]
    levels = [band_levels([u]) for u in raw]
    tops, floor = _floor(levels)
    _, shared = _noise_passed(raw, out, levels, floor, tops)
    assert least <= shared <= most
