"""What a measuring chain does to simulated channels: filters before and after sampling."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.binning import binned
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.models.bench_model import RECORDING_END
from impactscope.discrepancy.impact.models.measuring_chain import (
    _ahead,
    coupled_since,
    distort,
    fineness,
)

RATE = 80_000.0  # Hz, of the moments
EXACT = 8e6  # Hz, at which bilinear and analogue filters are one


def contact(time):
    """A contact of 1 ms, as steep as bare metal is."""
    inside = (time > 0.01) & (time < 0.011)
    return np.where(inside, np.clip(np.sin(np.pi * (time - 0.01) / 1e-3), 0.0, None) ** 1.5, 0.0)


@pytest.mark.parametrize('order', [1, 2, 3, 4])
@pytest.mark.parametrize('cutoff', [1500.0, 5000.0, 15_000.0, 100_000.0])
def test_an_analogue_filter_is_right_whatever_its_cutoff(order, cutoff):
    fine = contact(np.arange(0.0, 0.02, 1.0 / EXACT))
    sections = signal.butter(order, cutoff, fs=EXACT, output='sos')
    expected = signal.sosfilt(sections, fine)[:: round(EXACT / RATE)]
    course = contact(np.arange(expected.size) / RATE)
    found = _ahead(course, RATE, {'order': order, 'cutoff': cutoff, 'zero_phase': 0})
    assert np.max(np.abs(found - expected)) < 1.5e-3
    assert np.sqrt(np.mean((found - expected)[800:900] ** 2)) < 2.5e-4


@pytest.mark.parametrize('order', [1, 2, 4])
@pytest.mark.parametrize('cutoff', [350.0, 1500.0, 15_000.0])
def test_a_filter_without_a_phase_runs_before_samples_are_thinned_out(order, cutoff):
    fine = contact(np.arange(0.0, 0.02, 1.0 / EXACT))
    sections = signal.butter(order, cutoff, fs=EXACT, output='sos')
    expected = signal.sosfiltfilt(sections, fine)[:: round(EXACT / RATE)]
    course = contact(np.arange(expected.size) / RATE)
    found = _ahead(course, RATE, {'order': order, 'cutoff': cutoff, 'zero_phase': 1})
    assert np.max(np.abs(found - expected)) < 1.5e-3


@pytest.mark.parametrize('cutoff', [2000.0, 8000.0, 20_000.0, 39_000.0, 80_000.0])
def test_a_filter_without_a_phase_has_moments_for_its_second_pass(cutoff):
    """On too few of them a filter that does next to nothing left errors of several noises."""
    channel = SimpleNamespace(sample_rate=2000.0)
    numbers = {'order': 2, 'cutoff': cutoff, 'zero_phase': 1, 'ahead': 1.0}
    rate = channel.sample_rate * fineness([('low_pass_filter', numbers)], channel)
    fine = contact(np.arange(0.0, 0.02, 1.0 / EXACT))
    sections = signal.butter(2, cutoff, fs=EXACT, output='sos')
    expected = signal.sosfiltfilt(sections, fine)[:: round(EXACT / rate)]
    found = _ahead(contact(np.arange(expected.size) / rate), rate, numbers)
    assert np.max(np.abs(found - expected)) < 1.5e-4


@pytest.mark.parametrize('rate', [1000.0, 5000.0, 20_000.0])
def test_a_coupling_sums_up_what_lies_between_samples(rate):
    """Samples alone lose a share of a short contact, which stays for as long as it fades."""
    channel = SimpleNamespace(sample_rate=rate)
    numbers = {'corner': 2.0}

    def coupled(moments_of_each):
        time = np.arange(round(0.05 * rate * moments_of_each)) / (rate * moments_of_each)
        pulses = contact(time) - 0.6 * contact(time - 0.0123)
        found = distort('ac_coupling', pulses, time, channel, numbers, moments_of_each)
        return found[::moments_of_each]

    fine = fineness([('ac_coupling', numbers)], channel)
    assert fineness([('ac_coupling', {'corner': 0.0})], channel) == 1
    exact = coupled(400)
    after = slice(round(0.03 * rate), None)
    lost = np.max(np.abs(coupled(fine) - exact)[after])
    assert lost < 0.02 * np.max(np.abs(exact[after]))
    if rate == 1000.0:
        assert np.max(np.abs(coupled(1) - exact)[after]) > 10.0 * lost


def test_a_load_that_stays_passes_an_analogue_filter():
    found = _ahead(np.full(50, 3.0), RATE, {'order': 4, 'cutoff': 20_000.0, 'zero_phase': 0})
    assert found == pytest.approx(np.full(50, 3.0), abs=1e-9)


def test_what_lies_beyond_the_filter_does_nothing():
    course = contact(np.arange(0.0, 0.02, 1.0 / RATE))
    found = _ahead(course, RATE, {'order': 2, 'cutoff': 50.0 * RATE, 'zero_phase': 0})
    assert np.max(np.abs(found - course)) < 0.01


def resampled(campaign, channel, rate, cutoff, noise=None):
    """A campaign with one channel filtered at its own rate, then all taken at a lower one.

    ``noise``: of that channel behind the filter, which then runs forwards and backwards.
    """
    rng = np.random.default_rng(5)
    recordings = []
    for recording in campaign.recordings:
        channels = {}
        for name, held in recording.channels.items():
            values = np.asarray(held.values, dtype=np.float64)
            if name == channel:
                sections = signal.butter(2, cutoff, fs=held.sample_rate, output='sos')
                start = signal.sosfilt_zi(sections) * values[0]
                if noise is None:
                    values = signal.sosfilt(sections, values, zi=start)[0]
                else:
                    values = signal.sosfiltfilt(sections, values)
                    values = values + noise * rng.standard_normal(values.size)
            every = round(held.sample_rate / rate)
            channels[name] = dataclasses.replace(
                held, values=values[::every], sample_rate=held.sample_rate / every
            )
        recordings.append(dataclasses.replace(recording, channels=channels))
    return dataclasses.replace(campaign, recordings=tuple(recordings))


@pytest.mark.slow
def test_a_filter_above_half_the_sampling_rate_is_listed(make_campaign):
    campaign = resampled(make_campaign(47, rate=20_000.0), 'force', 2500.0, 1500.0)
    answer = explain(campaign)
    assert answer.accepted
    named = {answer.ranking[0].name, *answer.ranking[0].confused_with}
    assert named >= {'low_pass_filter'}
    filters = [r for r in answer.ranking if r.name == 'low_pass_filter']
    assert filters
    assert float(filters[0].parameters['cutoff'].value) == pytest.approx(1500.0, rel=0.3)


@pytest.mark.slow
def test_a_filter_without_a_phase_above_half_the_sampling_rate_is_found(make_campaign):
    made = make_campaign(5, rate=20_000.0)
    answer = explain(resampled(made, 'acceleration.plate', 5000.0, 2700.0, noise=0.08))
    assert answer.accepted == ('low_pass_filter',)
    found = answer.ranking[0].parameters
    assert found['zero_phase'].value == 1.0
    assert abs(found['cutoff'].value - 2700.0) < 3.0 * found['cutoff'].std


@pytest.mark.parametrize('corner', [0.01, 0.5, 5.0])
@pytest.mark.parametrize('offset', [0.0, 0.2])
@pytest.mark.parametrize('fine', [1, 4])
def test_a_coupling_remembers_the_fall_that_no_model_tells(corner, offset, fine):
    rate, contact_at = 5000.0, 0.4
    t = np.arange(round(rate * fine)) / (rate * fine)
    fallen = np.where((t > 0.12) & (t < contact_at), 3.0 * np.cos(4.0 * t), 0.0)
    blow = np.where(t >= contact_at, -80.0 * np.exp(-(((t - 0.404) / 2e-3) ** 2)) + 0.3, 0.0)
    b, a = signal.butter(1, corner, btype='high', fs=rate * fine)
    expected = signal.lfilter(b, a, fallen + blow)
    read = ChannelSamples('acceleration.impactor', 'm/s^2', rate, 0.0, expected[::fine] + offset)
    channel = binned(read, (contact_at, 0.4, 0.6), 0.1, None, coarse=True)
    moments = channel.time[0] + np.arange((channel.time.size - 1) * fine + 1) / (rate * fine)
    effects = [('ac_coupling', {'corner': corner}), ('offset', {'value': offset})]
    found = coupled_since(contact_at, blow[: moments.size], moments, channel, effects, fine)
    after = moments >= contact_at
    size = np.max(np.abs(found - expected[: moments.size])[after])
    # between samples, the coarser filter's integral is not that of the finer one
    assert size < (1e-9 if fine == 1 else 1e-3 + 5e-3 * corner)


def test_a_coupling_may_have_settled_on_a_fall_without_a_beginning():
    rate, contact_at = 5000.0, 0.1
    t = np.arange(round(0.3 * rate)) / rate
    course = np.where(t < contact_at, 0.5, 0.5 - 80.0 * np.exp(-(((t - 0.104) / 2e-3) ** 2)))
    b, a = signal.butter(1, 2.0, btype='high', fs=rate)
    expected = signal.lfilter(b, a, course, zi=-b[:1] * course[0])[0]
    read = ChannelSamples('acceleration.impactor', 'm/s^2', rate, 0.0, expected)
    channel = binned(read, (contact_at, 0.1, 0.2), 0.1, None, coarse=True)
    effects = [('ac_coupling', {'corner': 2.0})]
    size = channel.time.size
    found = coupled_since(contact_at, course[:size], channel.time, channel, effects)
    assert found == pytest.approx(expected[:size], abs=1e-9)


@pytest.mark.parametrize('both', [0, 1])
def test_what_a_filter_without_a_phase_gives_at_the_end_counts_for_nothing(make_campaign, both):
    campaign = make_campaign(48)
    plain = fit_baseline(baseline_model(campaign, prepare(campaign)))
    wanted = f'low_pass_filter:force of order 2{", zero phase" if both else ""}'
    listed = candidates(plain, campaign.baseline_names)
    model = next(c for c in listed if c.label == wanted).extend(plain.model)
    layout = model.layout(model.data.fitted)
    for i in model.data.fitted:
        for name, channel in model.data.blows[i].channels.items():
            lost = plain.layout.masks[i, name] & ~layout.masks[i, name]
            last = channel.centres[lost] > channel.time[-1] - RECORDING_END - 1e-3
            assert np.all(last)
            assert bool(np.any(lost)) == (both == 1 and name == 'force')
