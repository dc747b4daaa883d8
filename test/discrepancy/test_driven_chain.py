"""Chains between two channels that both have noise of their own."""

import dataclasses

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.answer import FitFigures, FitTable
from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.adequacy.channel_laws import _by_sign
from impactscope.discrepancy.driven.findings.decision import leaves_most
from impactscope.discrepancy.driven.models.channel_effects import channel_terms
from impactscope.discrepancy.driven.models.measuring_chain import (
    between_samples,
    delayed,
    passed_on,
    power_passed,
)
from impactscope.discrepancy.driven.noise.noise_bands import BANDS, Bands, band_levels
from impactscope.discrepancy.driven.systems.chain import _own
from impactscope.discrepancy.driven.systems.chain_noise import both_noises, input_at_most
from impactscope.discrepancy.explain import explain

RATE, SAMPLES = 4000.0, 2400
NOISES = 0.3, 0.1  # of input and output, m/s^2


def blows(rng, finer=1, samples=SAMPLES):
    """A quantity that rests, is struck twice and rings, m/s^2; at ``finer`` times the rate."""
    time = np.arange(samples * finer) / (RATE * finer)
    y = np.zeros(time.size)
    for begin in (0.1, 0.35):
        share = np.clip((time - begin) / rng.uniform(4e-3, 9e-3), 0.0, 1.0)
        size = rng.uniform(60.0, 200.0)
        y += size * np.sin(np.pi * share) ** 2
        late = np.clip(time - begin - 4e-3, 0.0, None)
        y += 0.3 * size * np.exp(-20.0 * late) * np.sin(2.0 * np.pi * 60.0 * late)
    return y


def campaign(
    seed,
    part=lambda x: x,
    after=lambda y: y,
    held_out=1,
    finer=1,
    noises=NOISES,
    samples=SAMPLES,
):
    """Four recordings; the noise of the input does not pass the chain.

    ``part`` acts at ``finer`` times the rate.
    """
    rng = np.random.default_rng(seed)
    entries, channels = [], {}
    for i in range(4):
        true = blows(rng, finer, samples)
        raw = true[::finer] + noises[0] * rng.standard_normal(samples)
        out = after(part(true)[::finer] + noises[1] * rng.standard_normal(samples))
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i >= 4 - held_out else 'fit'})
        channels[file] = {
            name: ChannelSamples(name, 'm/s^2', RATE, 0.0, values)
            for name, values in (('acceleration.raw', raw), ('acceleration.processed', out))
        }
    bench = {'kind': 'chain', 'input': 'acceleration.raw', 'output': 'acceleration.processed'}
    data = {'version': 1, 'bench': bench, 'recordings': entries}
    return parse_campaign(data).with_samples(channels.__getitem__)


@pytest.mark.parametrize('seed', [1, 2])
def test_noise_of_the_input_is_no_low_pass(seed):
    """A low-pass of the input would lower the residual ninefold where there is no signal."""
    answer = explain_driven(campaign(seed))
    assert answer.accepted == ()
    assert answer.mismatch.p_value > 3e-3


def test_low_pass_between_noisy_channels():
    sections = signal.butter(2, 400.0, fs=RATE, output='sos')
    answer = explain_driven(campaign(3, lambda x: signal.sosfilt(sections, x)))
    assert answer.accepted == ('low_pass_filter',)
    cutoff = answer.ranking[0].parameters['cutoff']
    assert abs(cutoff.value - 400.0) < 4.0 * cutoff.std + 2.0


def test_low_pass_far_above_what_is_measured():
    """It takes off little more than a gain would; from a low cut-off no way leads there."""
    low = signal.butter(1, 1200.0, fs=RATE, output='sos')
    high = signal.butter(1, 0.05, 'highpass', fs=RATE, output='sos')

    def filtered(x):
        return signal.sosfilt(high, signal.sosfiltfilt(low, x))

    answer = explain_driven(campaign(10, filtered))
    assert set(answer.accepted) == {'low_pass_filter', 'ac_coupling'}
    found = next(f for f in answer.ranking if f.name == 'low_pass_filter').parameters
    assert (found['order'].value, found['zero_phase'].value) == (1.0, 1.0)
    assert abs(found['cutoff'].value - 1200.0) < 4.0 * found['cutoff'].std


@pytest.mark.parametrize(
    ('name', 'part'),
    [
        (
            'low_pass_filter',
            lambda x: signal.sosfilt(signal.butter(2, 250.0, fs=16 * RATE, output='sos'), x),
        ),
        ('clock_error', lambda x: np.concatenate([np.zeros(37), x[:-37]])),
    ],
)
def test_what_acts_between_samples(name, part):
    """The law in the library meets it to a thousandth; the rest is nothing beyond the library."""
    answer = explain_driven(campaign(11, part, finer=16, noises=(0.02, 0.02)))
    assert answer.accepted == (name,)


def test_gain_and_offset():
    answer = explain_driven(campaign(4, lambda x: 1.01 * x + 0.05))
    assert set(answer.accepted) == {'wrong_parameter', 'offset'}
    gain = next(f for f in answer.ranking if f.name == 'wrong_parameter')
    ratio = gain.parameters['ratio']
    assert gain.parameters['name'].value == 'gain'
    assert abs(ratio.value - 1.01) < 4.0 * ratio.std


def test_hum_with_a_harmonic():
    time = np.arange(SAMPLES) / RATE
    hum = 0.05 * np.sin(2 * np.pi * 50.02 * time + 1.0) + 0.04 * np.sin(2 * np.pi * 100.04 * time)
    answer = explain_driven(campaign(5, lambda x: x + hum))
    assert answer.accepted == ('mains_hum',)
    found = answer.ranking[0].parameters
    for name, true in (('amplitude', 0.05), ('amplitude_2', 0.04)):
        assert abs(found[name].value - true) < 4.0 * found[name].std


def test_hum_of_any_phase():
    """Recordings begin at any moment of the mains."""
    time = np.arange(SAMPLES) / RATE
    phases = iter((0.3, 2.0, 4.1, 5.5))
    answer = explain_driven(
        campaign(8, lambda x: x + 0.05 * np.sin(2 * np.pi * 50.01 * time + next(phases)))
    )
    assert answer.accepted == ('mains_hum',)
    found = answer.ranking[0].parameters['amplitude']
    assert abs(found.value - 0.05) < 4.0 * found.std


def test_loud_hum_where_as_much_is_held_out_as_fitted():
    """A hum of its own in each recording fits as well; phases held out speak for neither."""
    time = np.arange(SAMPLES) / RATE
    phases = iter((0.3, 2.0, 4.1, 5.5))
    answer = explain_driven(
        campaign(9, lambda x: x + 2.0 * np.sin(2 * np.pi * 50.0 * time + next(phases)), held_out=2)
    )
    assert answer.accepted == ('mains_hum',)


def test_coupling_that_a_recording_finds_charged():
    """What the filter holds from before a recording is the recording's own."""
    b, a = signal.butter(1, 0.3, btype='high', fs=RATE)
    held = iter((0.5, -0.8, 0.3, -0.4))
    answer = explain_driven(campaign(9, lambda x: signal.lfilter(b, a, x, zi=[next(held)])[0]))
    assert answer.accepted == ('ac_coupling',)
    corner = answer.ranking[0].parameters['corner']
    assert abs(corner.value - 0.3) < 4.0 * corner.std


def test_a_bent_scale_is_unknown():
    answer = explain_driven(campaign(6, lambda x: x + 1e-4 * x * x))
    assert answer.accepted == ('unknown',)


@pytest.mark.parametrize('delay', [3.0, 0.37, -2.6])
def test_delays_of_a_sine(delay):
    time = np.arange(2000)
    burst = np.exp(-(((time - 1000) / 100.0) ** 2))
    wave = burst * np.sin(0.9 * np.pi * time)
    expected = np.exp(-(((time - 1000 - delay) / 100.0) ** 2)) * np.sin(
        0.9 * np.pi * (time - delay)
    )
    assert np.allclose(delayed(wave, delay, 1.0), expected, atol=1e-6)
    inside = slice(10, -10)
    course = between_samples(wave, 1.0)(time - delay)
    assert np.allclose(course[inside], expected[inside], atol=2e-3)


def test_whitening_of_two_levels():
    rng = np.random.default_rng(7)
    noise = rng.standard_normal(20000)
    spectrum = np.fft.rfft(noise)
    spectrum[np.fft.rfftfreq(noise.size, 1e-3) > 200.0] *= 3.0
    white = Bands(1.0, 3.0, 200.0, 1e-3)(np.fft.irfft(spectrum, noise.size))
    assert np.allclose(white, noise, atol=1e-9)
    levels = band_levels([noise])
    assert levels.shape == (BANDS,)
    assert np.mean(levels) == pytest.approx(1.0, abs=0.05)


def test_power_that_filters_let_pass():
    """The analytic share against a sine that runs through the chain."""
    terms = channel_terms('a', 'm/s^2', RATE, 1.0, 0.1, 10.0)
    chosen = {
        t.name: t for t in terms if t.label in ('low_pass_filter/zero-2', 'ac_coupling/output')
    }
    values = {'low_pass_filter/zero-2.cutoff': 300.0, 'ac_coupling/output.corner': 5.0}
    time = np.arange(20000) / RATE
    for frequency in (8.0, 100.0, 300.0, 500.0):
        wave = np.sin(2 * np.pi * frequency * time)
        out = passed_on(wave, chosen, values, 1.0 / RATE, 0.0)
        share = np.mean(out[5000:15000] ** 2) / np.mean(wave[5000:15000] ** 2)
        known = power_passed(list(chosen.values()), values, np.array([frequency]), RATE)[0]
        assert share == pytest.approx(known, rel=0.02)


def with_gain_known_to(made, std):
    return dataclasses.replace(made, gain_std={'acceleration': std})


def test_a_gain_within_its_stated_uncertainty_is_no_finding():
    made = campaign(51, after=lambda y: 1.004 * y)
    assert explain_driven(made).accepted == ('wrong_parameter',)
    answer = explain_driven(with_gain_known_to(made, 0.004))
    assert answer.accepted == ()
    excess = answer.extended_parameters['wrong_parameter/gain.excess']
    assert excess.value == pytest.approx(0.004, abs=4 * excess.std)


def test_a_gain_beyond_its_stated_uncertainty_is_wrong():
    made = with_gain_known_to(campaign(52, after=lambda y: 1.05 * y), 0.004)
    answer = explain_driven(made)
    assert answer.accepted == ('wrong_parameter',)
    found = answer.ranking[0].parameters
    assert found['name'].value == 'gain'
    assert found['ratio'].value == pytest.approx(1.05, abs=0.01)


def test_readings_of_one_sign_have_no_other_gain_below_zero():
    above = np.abs(np.random.default_rng(0).standard_normal(100))
    assert _by_sign([above]) == []
    assert np.array_equal(_by_sign([above, -above])[1], above)


def test_what_acts_for_a_few_milliseconds_is_not_nothing():
    steepest = 0.8 * np.max(np.abs(np.diff(blows(np.random.default_rng(53)))))

    def limited(x):
        y = x.copy()
        for k in range(1, y.size):
            y[k] = y[k - 1] + np.clip(x[k] - y[k - 1], -steepest, steepest)
        return y

    assert 'unknown' in explain_driven(campaign(53, part=limited)).accepted


def test_what_only_a_held_out_recording_shows_is_not_nothing():
    made = campaign(54)
    last = made.recordings[-1]
    channels = dict(last.channels)
    output = channels['acceleration.processed']
    clipped = np.clip(output.values, -20.0, 20.0)
    channels['acceleration.processed'] = dataclasses.replace(output, values=clipped)
    recordings = (*made.recordings[:-1], dataclasses.replace(last, channels=channels))
    answer = explain_driven(dataclasses.replace(made, recordings=recordings))
    assert answer.accepted == ('unknown',)
    assert last.file in answer.unexplained_description


def ringing_sensor(frequency, ratio):
    """A sensor that rings, at eight times the rate."""
    turn = 2.0 * np.pi * frequency
    b, a = signal.bilinear([turn**2], [1.0, 2.0 * ratio * turn, turn**2], 8.0 * RATE)
    return lambda x: signal.lfilter(b, a, x)


@pytest.mark.parametrize(
    ('frequency', 'ratio'), [pytest.param(70.0, 0.5, marks=pytest.mark.slow), (260.0, 0.05)]
)
def test_a_sensor_that_rings_is_not_in_the_library(frequency, ratio):
    """It is told alone: its own frequency and damping leave nothing to a wrong gain."""

    def share(x):
        return x + 0.02 * (ringing_sensor(frequency, ratio)(x) - x)

    answer = explain_driven(campaign(6, share, finer=8, samples=1600))
    assert answer.accepted == ('unknown',)
    told = float(answer.unexplained_description.split('resonance or a notch at ')[1].split()[0])
    assert told == pytest.approx(frequency, rel=0.1)
    assert answer.model['baseline'] == []  # what stands in for it is no part of a simulation


def test_a_low_pass_without_delay_above_the_sampling_rate():
    """It ran at a higher rate, before the samples were thinned out."""
    cutoff = 7000.0
    sections = signal.butter(1, cutoff, fs=16.0 * RATE, output='sos')
    made = swept(lambda x: signal.sosfiltfilt(sections, x), (20.0, 50.0, 30.0, 40.0))
    answer = explain(made)
    assert answer.accepted == ('low_pass_filter',)
    told = answer.findings[0].parameters
    assert (told['order'].value, told['zero_phase'].value) == (1.0, 1.0)
    assert abs(told['cutoff'].value - cutoff) < 4.0 * told['cutoff'].std < cutoff


def swept(part, sizes, finer=16):
    """Sweeps up to a third of the rate; ``part`` acts at ``finer`` times the rate."""
    rng = np.random.default_rng(11)
    entries, channels = [], {}
    time = np.arange(SAMPLES * finer) / (RATE * finer)
    for i, size in enumerate(sizes):
        course = signal.chirp(time, 10.0, time[-1], RATE / 3.0, phi=90.0 * i)
        true = size * signal.windows.tukey(time.size, 0.3) * course
        ends = (true, part(true))
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 3 else 'fit'})
        channels[file] = {
            name: ChannelSamples(
                name, 'm/s^2', RATE, 0.0, y[::finer] + 0.05 * rng.standard_normal(SAMPLES)
            )
            for name, y in zip(('acceleration.raw', 'acceleration.processed'), ends, strict=True)
        }
    bench = {'kind': 'chain', 'input': 'acceleration.raw', 'output': 'acceleration.processed'}
    data = {'version': 1, 'bench': bench, 'recordings': entries}
    return parse_campaign(data).with_samples(channels.__getitem__)


def test_a_low_pass_where_most_of_the_signal_is_faint():
    """Its delay shows in lines that hardly stand above the noise, as that of a clock would."""
    fine, n, cutoff, noise = 4, 5000, 1700.0, 0.05
    rng = np.random.default_rng(77)
    colour = signal.butter(1, 30.0, fs=RATE * fine, output='sos')
    first = signal.butter(1, cutoff, fs=RATE * fine, output='sos')
    below = signal.butter(8, 1600.0, fs=RATE * fine, output='sos')  # half the rate is 2 kHz
    burst = np.pad(np.hanning(3000 * fine), 1000 * fine)  # between quiet stretches
    entries, channels = [], {}
    for i in range(4):
        white = signal.sosfilt(below, rng.standard_normal(n * fine))
        true = 40.0 * burst * signal.sosfilt(colour, white)
        out = signal.sosfilt(first, true)[::fine]
        hum = 0.05 * np.sin(2.0 * np.pi * 50.0 * np.arange(n) / RATE + i)
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 3 else 'fit'})
        ends = {
            'acceleration.raw': true[::fine] + noise * rng.standard_normal(n),
            'acceleration.processed': out + hum + noise * rng.standard_normal(n),
        }
        channels[file] = {
            name: ChannelSamples(name, 'm/s^2', RATE, 0.0, values) for name, values in ends.items()
        }
    bench = {'kind': 'chain', 'input': 'acceleration.raw', 'output': 'acceleration.processed'}
    data = {
        'version': 1,
        'bench': bench,
        'gain_std': {'acceleration': 0.005},
        'recordings': entries,
    }
    answer = explain_driven(parse_campaign(data).with_samples(channels.__getitem__))
    assert set(answer.accepted) == {'low_pass_filter', 'mains_hum'}
    found = next(f for f in answer.findings if f.name == 'low_pass_filter')
    assert found.parameters['cutoff'].value == pytest.approx(cutoff, rel=0.1)


LOW = signal.butter(2, 500.0, fs=RATE, output='sos')


def by_its_past(x):
    """A channel whose gain goes by what it saw 10 ms before."""
    late = np.concatenate([np.zeros(40), x[:-40]])
    return signal.sosfilt(LOW, x) + 0.01 * x * late


def with_play(x):
    """A pointer that is taken along with 15 m/s^2 of play."""
    seen, y, place = signal.sosfilt(LOW, x), np.zeros(x.size), 0.0
    for i, v in enumerate(seen):
        y[i] = place = min(max(place, v - 15.0), v + 15.0)
    return y


def with_its_own_gain(x):
    """A channel that turns itself down while it is loud."""
    level = signal.lfilter([0.01], [1.0, -0.99], np.abs(x))
    return signal.sosfilt(LOW, x) / (1.0 + 0.1 * level)


@pytest.mark.parametrize('part', [by_its_past, with_play, with_its_own_gain])
def test_what_comes_with_the_signal_is_neither_noise_nor_a_filter(part):
    """Noise of some colour would take all that a filter leaves; it is there in the quiet, too."""
    answer = explain_driven(campaign(3, part))
    assert answer.accepted == ('unknown',)
    assert answer.unexplained


@pytest.mark.parametrize(
    ('before', 'after', 'held_out', 'most'),
    [
        (101.0, 90.0, (101.0, 90.0), True),
        (101.0, 40.0, (101.0, 90.0), False),
        (101.0, 90.0, (101.0, 40.0), False),
        (101.0, 90.0, (np.nan, np.nan), True),
        (2.0, 1.8, (2.0, 1.8), False),
    ],
)
def test_findings_leave_most_where_fitted_and_held_out_are_far_from_noise(
    before, after, held_out, most
):
    figures = [
        FitFigures(reduced_chi_square=fitted, held_out_reduced_chi_square=predicted)
        for fitted, predicted in zip((before, after), held_out, strict=True)
    ]
    assert leaves_most(FitTable(*figures)) is most


def test_slow_noise_of_the_output_is_no_noise_of_the_input():
    """The share is told by bands without signal; the residual counts in the same ones.

    By its level elsewhere, where slow noise is, a fifth of it seemed to be the input's, and the
    input as both channels tell it then knew what was left.
    """
    moved = np.where(np.arange(BANDS) < 0.6 * BANDS, 100.0, 0.0)
    slow = np.where(np.arange(BANDS) < 0.6 * BANDS, 1.0, 0.0)
    into, out = 0.1, 0.9 + slow
    assert _own([moved + into], [moved + out], [into + out]) == pytest.approx(0.1)


@pytest.mark.parametrize('seed', [1, 2])
def test_slow_noise_of_the_output_alone_is_no_notch_of_the_input(seed):
    """By their shares above the signal nearly all of the slow noise would be the input's.

    The input as both channels tell it then has what the residual has, and a linear law of it
    explains that.
    """
    rng, keep = np.random.default_rng(100 + seed), np.exp(-2.0 * np.pi * 40.0 / RATE)

    def slow(y):
        steps = rng.standard_normal(y.size + 2000)
        noise = signal.lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], steps)
        return y + 0.2 * noise[2000:]

    answer = explain_driven(campaign(seed, after=slow, noises=(0.1, 0.0), samples=6000))
    assert answer.accepted == ()


def test_noise_of_both_ends_is_told_without_a_bias():
    """The quieter tiles of noise are a tenth quieter than all of them."""
    rng = np.random.default_rng(5)
    told = []
    for _ in range(20):
        inputs = [blows(rng) + 0.3 * rng.standard_normal(SAMPLES) for _ in range(3)]
        outputs = [0.1 * rng.standard_normal(SAMPLES) for _ in range(3)]
        told.append(both_noises(inputs, outputs))
    into, out = np.mean(told, axis=0)
    assert into == pytest.approx(0.09, rel=0.05)
    assert out == pytest.approx(0.01, rel=0.05)


def test_quiet_windows_tell_how_loud_noise_of_an_input_is_at_most():
    rng = np.random.default_rng(6)
    inputs = [blows(rng, samples=6000) + 0.3 * rng.standard_normal(6000) for _ in range(3)]
    noise = np.full(3001, 0.1)
    most = input_at_most(inputs, noise)
    assert np.median(most) == pytest.approx(0.09, rel=0.15)
    assert np.all(most[1500:] < 0.12)  # and above the signal everywhere
    assert np.all(np.isinf(input_at_most([inputs[0][:1000]], noise)))  # of too few windows


def test_a_late_clock_behind_a_multisine():
    """Between its lines a band is quiet: by its median it would be noise that no clock moves."""
    rng = np.random.default_rng(40)
    rate, size, offset, drift = 2000.0, 16000, 1e-5, 8e-6
    time = np.arange(size) / rate
    entries, channels = [], {}
    for i, top in enumerate((120.0, 200.0, 90.0)):
        lines = rng.uniform(0.5, top, 40), rng.uniform(0.0, 2.0 * np.pi, 40)

        def wave(t, lines=lines):
            return sum(4.0 * np.sin(2.0 * np.pi * f * t + p) for f, p in zip(*lines, strict=True))

        late = wave((time - offset) / (1.0 + drift))
        pair = {'force.before': (wave(time), 0.03), 'force.after': (late, 1.0)}
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 2 else 'fit'})
        channels[file] = {
            c: ChannelSamples(c, 'N', rate, 0.0, values + noise * rng.standard_normal(size))
            for c, (values, noise) in pair.items()
        }
    bench = {'kind': 'chain', 'input': 'force.before', 'output': 'force.after'}
    whole = {'version': 1, 'bench': bench, 'baseline': [], 'recordings': entries}
    answer = explain_driven(parse_campaign(whole, 'late').with_samples(channels.__getitem__))
    assert answer.accepted == ('clock_error',)
    assert not answer.unexplained
    found = answer.ranking[0].parameters
    assert abs(found['offset'].value - offset) < 4.0 * found['offset'].std < 5e-6
    assert abs(found['drift'].value - drift) < 4.0 * found['drift'].std < 1e-6


def test_an_amplifier_that_cannot_rise_any_faster_is_unknown():
    """A reading that is slow where it is steep was too smooth a picture of that."""

    def limited(x):
        y = x.copy()
        for i in range(1, y.size):
            y[i] = y[i - 1] + np.clip(x[i] - y[i - 1], -23.0, 23.0)
        return y

    answer = explain_driven(campaign(6, limited, noises=(0.1, 0.3)))
    assert answer.accepted == ('unknown',)
    assert 'any faster' in answer.findings[0].sentence
