"""Which samples of a channel count: those that a coarse converter rounds, not those cut off."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.impact.data.binning import (
    BinnedChannel,
    _clipping,
    binned,
    merged,
)
from impactscope.discrepancy.impact.data.blows import _hangs

RATE, STEP = 10_000.0, 0.33


def force(limit: float) -> ChannelSamples:
    """A blow of 100 N and 30 ms on a coarse converter, maybe cut off."""
    time = np.arange(4000) / RATE
    share = np.clip((time - 0.1) / 0.03, 0.0, 1.0)
    noise = 0.05 * np.random.default_rng(12).standard_normal(time.size)
    values = np.minimum(100.0 * np.sin(np.pi * share) + noise, limit)
    return ChannelSamples('force', 'N', RATE, 0.0, STEP * np.round(values / STEP))


def test_a_round_top_on_a_coarse_converter_is_not_cut_off():
    channel = force(math.inf)
    assert _clipping(channel.values, channel, 8, STEP) == math.inf


@pytest.mark.parametrize('limit', [95.0, 80.0, 40.0])
def test_a_flat_top_is(limit):
    channel = force(limit)
    found = _clipping(channel.values, channel, 8, STEP)
    assert found == pytest.approx(limit, abs=STEP)


ONSET = 0.1


def ringing(rate: float, *, knocked_at: float = math.inf) -> BinnedChannel:
    """A force that rings at 30 Hz from 0.1 s on, maybe with a knock of 0.2 ms beside it."""
    time = np.arange(round(0.6 * rate)) / rate
    since = np.maximum(time - ONSET, 0.0)
    values = 50.0 * np.exp(-5.0 * since) * np.sin(2 * np.pi * 30.0 * since)
    knock = np.clip((time - knocked_at) / 2e-4, 0.0, 1.0) if math.isfinite(knocked_at) else 0.0
    values = values + 80.0 * np.sin(np.pi * knock)
    values += 0.05 * np.random.default_rng(13).standard_normal(time.size)
    channel = ChannelSamples('force', 'N', rate, 0.0, values)
    return binned(channel, (ONSET, 2.0, 4.0), 0.05, None, coarse=True)


def test_a_faster_converter_makes_no_more_bins():
    slow, fast = ringing(10_000.0), ringing(100_000.0)
    assert fast.means.size < 2.1 * slow.means.size  # 50 us where 100 us are one sample
    assert int(np.sum(fast.counts)) == fast.samples.size
    assert float(np.median(fast.std)) < 0.5 * float(np.median(slow.std))
    # up to 30 kHz every sample of a first contact counts on its own
    first = (slow.centres > ONSET) & (slow.centres < ONSET + 0.02)
    assert set(slow.counts[first]) == {1}


def test_what_is_quick_is_followed_sample_by_sample():
    fast = ringing(100_000.0, knocked_at=0.4)
    near = np.abs(fast.centres - 0.4001) < 5e-4
    assert set(fast.counts[near]) == {1}


def test_bins_of_several_channels_are_the_same():
    smooth, knocked = ringing(51_200.0), ringing(51_200.0, knocked_at=0.3003)
    every = np.union1d(smooth.nodes, knocked.nodes)
    alone = np.count_nonzero(knocked.counts == 1)
    assert every.size <= max(smooth.nodes.size, knocked.nodes.size) + 2 * alone
    after = smooth.centres > 0.32
    again = knocked.centres > 0.32
    np.testing.assert_array_equal(smooth.centres[after], knocked.centres[again])


@pytest.mark.parametrize(
    ('begins', 'swings', 'counts'),
    [
        (-3e-4, 0.0, True),  # the plate was seen late: the contact has begun
        (-3e-4, 1.0, True),  # level before it is no zero
        (2e-4, 0.0, False),  # it has not
    ],
)
def test_an_impactor_counts_from_its_contact_on(begins: float, swings: float, counts: bool):
    rate, noise = 5000.0, 0.05
    time = np.arange(1500) / rate
    pressed = np.clip((time - ONSET - begins) / 1.2e-3, 0.0, 1.0)
    values = swings - 500.0 * np.sin(np.pi * pressed)
    values += noise * np.random.default_rng(14).standard_normal(time.size)
    channel = ChannelSamples('acceleration.impactor', 'm/s^2', rate, 0.0, values)
    found = binned(channel, (ONSET, 0.1, 4.0), noise, None, coarse=False)
    early = (found.centres > ONSET - 2.5e-4) & (found.centres < ONSET + 0.9e-4)
    assert bool(np.all(found.used[early])) is counts
    assert bool(np.any(found.used[early])) is counts
    assert not np.any(found.used[found.centres < ONSET - 3.5e-4])
    assert np.all(found.used[found.centres > ONSET + 1.5e-4])


@pytest.mark.parametrize('hangs', [True, False])
def test_an_impactor_that_hangs_still_is_compared_before_the_onset_too(hangs):
    """What its channel has of a hum shows there best; one that falls tells nothing before."""
    values = 0.05 * np.random.default_rng(14).standard_normal(6000)
    channel = ChannelSamples('acceleration.impactor', 'm/s^2', RATE, 0.0, values)
    found = binned(channel, (ONSET, 2.0, 4.0), 0.05, None, coarse=False, hangs=hangs)
    assert bool(found.used[found.centres < ONSET].any()) is hangs
    assert found.used[found.centres > ONSET + 1e-3].all()


@pytest.mark.parametrize(('moves', 'hangs'), [(0.0, True), (0.3, False)])
def test_an_impactor_that_swings_does_not_hang(moves, hangs):
    time = np.arange(6000) / RATE
    values = 0.05 * np.random.default_rng(15).standard_normal(time.size)
    values += moves * np.sin(2.0 * np.pi * time)
    channel = ChannelSamples('acceleration.impactor', 'm/s^2', RATE, 0.0, values)
    assert _hangs(channel, 0.55) is hangs


@given(st.lists(st.lists(st.integers(0, 20).map(float)), min_size=1, max_size=4))
def test_moments_of_all_channels_rise_and_each_finds_its_own(several):
    moments = {str(i): np.array(sorted(one)) for i, one in enumerate(several)}
    found, places = merged(moments)
    every = np.concatenate(list(moments.values()))
    np.testing.assert_array_equal(found, np.unique(every))
    assert list(places) == list(moments)
    for name, own in moments.items():
        np.testing.assert_array_equal(found[places[name]], own)
