"""Noise that is not the same in all recordings of a campaign."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.noise.by_recording import shared_and_own
from impactscope.discrepancy.impact.noise.coloured_noise import Colour


@given(st.floats(1e-3, 1e3), st.lists(st.integers(64, 5000), min_size=1, max_size=9))
def test_recordings_of_one_noise_share_it(std: float, sizes: list[int]) -> None:
    rng = np.random.default_rng(sum(sizes))
    told = std * np.exp(1.4 / np.sqrt(sizes) * rng.normal(size=len(sizes)))
    shared, own = shared_and_own(told, np.array(sizes))
    assert shared == pytest.approx(std, rel=6.0 / np.sqrt(sum(sizes)))
    assert np.all(own == shared)


@given(st.floats(2.0, 10.0), st.booleans(), st.integers(1, 3))
def test_what_is_louder_or_quieter_for_certain_has_its_own(
    factor: float, louder: bool, others: int
) -> None:
    times = factor if louder else 1.0 / factor
    stds = np.array([1.0, 1.02, 0.97, 1.01, 0.99, 1.0, *[times] * others])
    shared, own = shared_and_own(stds, np.full(stds.size, 500))
    assert shared == pytest.approx(1.0, abs=0.02)
    assert np.all(own[:6] == shared)
    assert np.allclose(own[6:], times)


def test_few_samples_of_quiet_tell_no_other_noise() -> None:
    stds = np.array([1.0, 1.0, 1.0, 1.6])
    assert np.all(
        shared_and_own(stds, np.array([900, 900, 900, 64]))[1] == pytest.approx(1.0, abs=0.05)
    )
    assert shared_and_own(stds, np.full(4, 900))[1][3] == 1.6


def test_a_colour_keeps_its_shape_where_it_is_louder() -> None:
    colour = Colour(1.0, np.array([0.5, 0.1]), np.array([0.01, 0.1]), 1e4)
    louder = colour.scaled(3.0)
    assert louder.std == pytest.approx(3.0 * colour.std)
    assert louder.fresh == pytest.approx(3.0 * colour.fresh)
    assert np.all(louder.times == colour.times)
    assert colour.scaled(1.0) is colour


def noisier(campaign, file: str, name: str, added: float):
    """The same campaign with more noise in a channel of one recording."""
    rng = np.random.default_rng(7)
    recordings = []
    for recording in campaign.recordings:
        if recording.file == file:
            channel = recording.channels[name]
            values = channel.values + rng.normal(0.0, added, channel.values.size)
            channels = {**recording.channels, name: dataclasses.replace(channel, values=values)}
            recording = dataclasses.replace(recording, channels=channels)
        recordings.append(recording)
    return dataclasses.replace(campaign, recordings=tuple(recordings))


def test_a_recording_is_judged_by_its_own_noise(make_campaign) -> None:
    campaign = make_campaign(81)
    plain = prepare(campaign)
    name = 'acceleration.plate'
    held = next(b for b in plain.blows if b.recording.role.value == 'hold_out')
    more = 2.5 * plain.noise[name]
    louder = noisier(campaign, held.name, name, more)
    data = prepare(louder)
    true = float(np.hypot(plain.noise[name], more))
    for blow in data.blows:
        expected = true if blow.name == held.name else plain.noise[name]
        assert blow.channels[name].noise == pytest.approx(expected, rel=0.15)
    assert plain.noise[name] < data.noise_floor[name] < true
    assert sum('not the same in all recordings' in note for note in data.notes) == 1
    assert not any('not the same in all recordings' in note for note in plain.notes)
    answer = explain(louder)
    assert answer.accepted == ()
    assert not answer.unexplained
