"""What is left after a fit: noise passes, and what is not noise is seen for what it is."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import Campaign
from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.adequacy.residual_tests import (
    _bands,
    _tested_fit,
    adequacy,
    rounding_error,
)
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.models.baseline import baseline_model


def fitted(campaign: Campaign) -> Fit:
    return fit_baseline(baseline_model(campaign, prepare(campaign)))


def changed(campaign: Campaign, channel: str, change) -> Campaign:
    """The campaign with ``change(recording's place, samples)`` in one channel."""
    recordings = []
    for place, recording in enumerate(campaign.recordings):
        channels = dict(recording.channels)
        if channel in channels:
            old = channels[channel]
            channels[channel] = dataclasses.replace(old, values=change(place, old.values))
        recordings.append(dataclasses.replace(recording, channels=channels))
    return dataclasses.replace(campaign, recordings=tuple(recordings))


@pytest.mark.parametrize('seed', [31, 32, 33])
def test_noise_alone_is_adequate(make_campaign, seed):
    tests = adequacy(fitted(make_campaign(seed)))
    assert tests.p_value > 0.01
    assert set(tests.p_values) >= {'recordings', 'channels', 'time', 'chain', 'mechanisms'}


def test_a_gain_that_changes_between_recordings_is_no_noise(make_campaign):
    factors = (1.0, 1.004, 0.996, 1.0)
    campaign = changed(make_campaign(31), 'force', lambda i, values: factors[i] * values)
    fit = fitted(campaign)
    tests = adequacy(fit)
    assert fit.reduced < 1.2  # nothing that its size would tell
    assert tests.p_value < 1e-4
    assert tests.p_values['recordings'] < 1e-4
    assert tests.excess['recordings'] > 30


def test_a_bent_scale_of_a_channel_is_no_noise(make_campaign):
    def bent(_: int, values):
        return values + 4e-3 * values**2 / np.max(np.abs(values))

    fit = fitted(changed(make_campaign(32), 'force', bent))
    tests = adequacy(fit)
    assert fit.reduced < 1.2
    assert tests.p_values['chain'] < 1e-4


def test_what_nobody_has_listed_is_called_unknown(make_campaign):
    factors = (1.0, 1.004, 0.996, 1.0)
    campaign = changed(make_campaign(31), 'force', lambda i, values: factors[i] * values)
    answer = explain(campaign)
    assert answer.accepted == ('unknown',)
    assert answer.unexplained
    assert answer.mismatch.p_value < 1e-3
    assert answer.ranking[0].probability > 0.7


def test_a_coloured_noise_is_known_no_better_than_the_quiet_tells_it(make_campaign):
    rng = np.random.default_rng(4)

    def slower(_: int, values):
        fresh = rng.standard_normal(values.size)
        return values + 0.3 * signal.lfilter([1.0], [1.0, -0.8], fresh)

    campaign = changed(make_campaign(34, duration=0.6), 'acceleration.impactor', slower)
    fit = fitted(campaign)
    residual = fit.residuals[: fit.layout.size]
    bands = _bands(fit, residual)
    _, count, quiet, _ = bands['acceleration.impactor below 400 Hz']
    blows = [b for b in (fit.model.data.blows[i] for i in fit.layout.blows) if len(b.channels) > 3]
    before = sum(b.onset - b.recording.channels['acceleration.impactor'].start for b in blows)
    assert quiet == pytest.approx(2.0 * before * 340.0, rel=0.02)
    assert 100 < quiet < count
    assert bands['acceleration.plate below 400 Hz'][2] == np.inf
    # some more than the quiet tells is nothing; much more is
    band = signal.butter(4, (70.0, 380.0), btype='band', fs=2500.0, output='sos')
    for share, told in ((0.1, False), (1.5, True)):
        louder = fit.residuals.copy()
        for (_, name), span in fit.layout.spans.items():
            if name == 'acceleration.impactor':
                more = signal.sosfilt(band, rng.standard_normal(span.stop - span.start))
                louder[span] += np.sqrt(share) * more
        tests = _tested_fit(dataclasses.replace(fit, residuals=louder), laws=False)
        assert (tests.p_values['acceleration.impactor below 400 Hz'] < 1e-4) is told
    # what is slower than the quiet can show is only presumed of its colour
    for frequency, told in ((12.0, False), (52.0, True)):
        waving = fit.residuals.copy()
        for (i, name), span in fit.layout.spans.items():
            if name == 'acceleration.impactor':
                centres = fit.model.data.blows[i].channels[name].centres
                moments = centres[fit.layout.masks[i, name]]
                waving[span] += 2.0 * np.sin(2.0 * np.pi * frequency * moments)
        tests = _tested_fit(dataclasses.replace(fit, residuals=waving), laws=False)
        assert (tests.p_values['acceleration.impactor below 60 Hz'] < 1e-4) is told


def test_what_rattles_after_a_blow_is_no_noise(make_campaign):
    """A loose part leaves no course that could be followed, and makes a sensor noisier."""
    plain = make_campaign(33)
    sound = fitted(plain)
    assert min(_louder_chances(sound).values()) > 0.001
    rng = np.random.default_rng(5)

    def rattling(place, values):
        blow = sound.model.data.blows[place]
        channel = blow.channels['acceleration.plate']
        time = channel.time[0] + np.arange(values.size) / channel.sample_rate
        loud = (time > blow.onset) & (time < blow.onset + 0.1)
        return values + 0.8 * channel.noise * loud * rng.standard_normal(values.size)

    chances = _louder_chances(fitted(changed(plain, 'acceleration.plate', rattling)))
    assert chances['the noise of acceleration.plate after the blow'] < 1e-4
    assert chances['the noise of force after the blow'] > 0.001


def test_what_rattles_is_seen_in_noise_of_a_colour_as_well(make_campaign):
    rng = np.random.default_rng(6)

    def slow(_: int, values):
        return values + signal.lfilter([0.1], [1.0, -0.9], rng.standard_normal(values.size))

    plain = changed(make_campaign(33, duration=0.6), 'acceleration.plate', slow)
    sound = fitted(plain)
    told = 'acceleration.plate above the bands'
    assert sound.model.data.blows[0].channels['acceleration.plate'].colour is not None
    assert 'the noise of acceleration.plate after the blow' not in _louder_chances(sound)
    assert adequacy(sound).p_values[told] > 0.001

    def rattling(place, values):
        blow = sound.model.data.blows[place]
        channel = blow.channels['acceleration.plate']
        time = channel.time[0] + np.arange(values.size) / channel.sample_rate
        loud = (time > blow.onset) & (time < blow.onset + 0.1)
        return values + 1.2 * channel.noise * loud * rng.standard_normal(values.size)

    tests = adequacy(fitted(changed(plain, 'acceleration.plate', rattling)))
    assert tests.p_values[told] < 1e-4


def _louder_chances(fit: Fit) -> dict[str, float]:
    return {k: p for k, p in adequacy(fit).p_values.items() if k.startswith('the noise of')}


@pytest.mark.parametrize('noise', [0.05, 0.2, 0.3, 0.6])
def test_what_steps_leave_of_a_slow_reading(noise: float) -> None:
    """The mean of many roundings of one value, over all values; steps of one."""
    rng = np.random.default_rng(6)
    values = np.linspace(0.0, 1.0, 400, endpoint=False)
    read = np.round(values[:, None] + noise * rng.standard_normal((400, 4000)))
    chance = float(np.mean(np.var(read, axis=1))) / read.shape[1]  # of a mean
    error = float(np.mean((np.mean(read, axis=1) - values) ** 2)) - chance
    told = rounding_error(1.0, math.sqrt(noise**2 + 1.0 / 12.0))
    assert told == pytest.approx(error, rel=0.35, abs=2e-5)
    assert rounding_error(0.0, noise) == 0.0
