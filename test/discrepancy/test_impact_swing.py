"""A pendulum on the horizontal bench: how long its recording can be trusted after the blow."""

from __future__ import annotations

import numpy as np
import pytest

from impactscope.discrepancy.campaign import CampaignRecording, ChannelSamples
from impactscope.discrepancy.impact.data.binning import binned
from impactscope.discrepancy.impact.data.blows import RETURN, _left_to_return, _stays_away

RATE, ONSET, LENGTH = 2000.0, 0.2, 1.6
NOISE = {'acceleration.impactor': 0.1, 'force': 0.2}
TIME = np.arange(round(RATE * LENGTH)) / RATE
SINCE = TIME - ONSET


def channels(**changes):
    rng = np.random.default_rng(3)
    ring = np.where(SINCE > 0.0, np.exp(-6.0 * SINCE) * np.sin(180.0 * SINCE), 0.0)
    made = {
        # a swing that is seen: the weight brings it back slowly
        'acceleration.impactor': np.where(SINCE > 0.0, -0.5 * np.sin(2.0 * SINCE), 0.0),
        'force': 60.0 * ring,
    }
    found = {}
    for name, values in made.items():
        values = values + NOISE[name] * rng.standard_normal(values.size)
        values = values + changes.get(name.replace('.', '_'), 0.0)
        found[name] = ChannelSamples(name, 'x', RATE, 0.0, values, -np.inf, np.inf)
    return found


def pulse(at, height, width=0.004):
    return np.where(np.abs(SINCE - at) < width, height, 0.0)


def test_a_free_swing_is_seen_to_the_end():
    assert _stays_away(channels(), ONSET, NOISE)


@pytest.mark.parametrize(
    'changes',
    [
        {'acceleration_impactor': pulse(0.7, 3.0)},  # a hand
        {'force': pulse(0.9, 8.0)},  # the bench is struck again
        {'acceleration_impactor': np.where(SINCE > 0.5, np.nan, 0.0)},
        {'force': np.where(SINCE > 1.0, np.nan, 0.0)},
    ],
)
def test_what_is_caught_comes_back_or_is_not_known_is_not_followed(changes):
    assert not _stays_away(channels(**changes), ONSET, NOISE)


def test_without_its_own_accelerometer_nobody_knows():
    made = channels()
    del made['acceleration.impactor']
    assert not _stays_away(made, ONSET, NOISE)


def bench_alone(**changes):
    made = channels(**changes)
    del made['acceleration.impactor']
    return made


@pytest.mark.parametrize(
    ('made', 'returned'),
    [
        (bench_alone(), False),
        (bench_alone(force=pulse(0.9, 8.0)), True),
        (bench_alone(force=pulse(0.3, 8.0)), False),  # so early nobody can have caught it
        (bench_alone(force=np.where(SINCE > 1.0, np.nan, 0.0)), False),
        (channels(force=pulse(0.9, 8.0)), False),  # whose own accelerometer tells of a hand
    ],
)
def test_where_one_pendulum_comes_back_none_was_caught(made, returned):
    recordings = [
        (CampaignRecording(f'{i}.mcap', 'pendulum', channels=shown), ONSET)
        for i, shown in enumerate(
            (made if 'acceleration.impactor' in made else bench_alone(), made)
        )
    ]
    assert _left_to_return(recordings, NOISE) is returned
    tap = [(CampaignRecording('tap.mcap', 'tap', channels=made), ONSET)]
    assert not _left_to_return(tap, NOISE)


def test_a_bench_that_only_rings_is_read_in_longer_bins():
    force = channels()['force']
    fine = binned(force, (ONSET, 2.0, 4.0), 0.2, None, coarse=False)
    longer = binned(force, (ONSET, 2.0, 4.0), 0.2, None, coarse=False, ringing=RETURN)
    late = longer.centres > ONSET + RETURN + 2e-3
    # 1 ms, or 4 ms where it is still, and what is left up to a multiple of these
    assert set(longer.counts[late][:-1]) <= {2, 4, 6, 8}
    assert np.count_nonzero(np.isin(longer.counts[late], (4, 6))) <= 2
    assert longer.means.size < fine.means.size
    early = fine.centres < ONSET + RETURN - 2e-3
    np.testing.assert_array_equal(fine.means[early], longer.means[: np.count_nonzero(early)])
    np.testing.assert_allclose(
        np.sum(longer.means * longer.counts), np.sum(fine.means * fine.counts)
    )
