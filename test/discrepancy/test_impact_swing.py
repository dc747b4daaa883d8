"""A pendulum on the horizontal bench: how long its recording can be trusted after the blow."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from impactscope.discrepancy.campaign import CampaignRecording, ChannelSamples
from impactscope.discrepancy.impact.data.binning import binned
from impactscope.discrepancy.impact.data.blows import (
    CAUGHT,
    RETURN,
    _blow,
    _left_to_return,
)
from impactscope.discrepancy.impact.models.bench_parameters import describe
from impactscope.physics.twin.simulate import simulate

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


def bench_alone(**changes):
    made = channels(**changes)
    del made['acceleration.impactor']
    return made


STRUCK = pulse(0.9, 8.0)
JOLTED = pulse(0.7, 3.0)
LOST = np.where(SINCE > 0.5, np.nan, 0.0)


@pytest.mark.parametrize(
    ('made', 'bench_until', 'impactor_until', 'caught'),
    [
        (channels(), np.inf, np.inf, np.inf),  # a free swing is seen to the end
        (channels(acceleration_impactor=JOLTED), np.inf, CAUGHT, RETURN),  # by a hand
        (channels(acceleration_impactor=LOST), np.inf, CAUGHT, RETURN),
        (channels(force=STRUCK), RETURN, CAUGHT, np.inf),
        (channels(force=LOST), RETURN, CAUGHT, np.inf),
        # a bench that rings alone tells as much whether its pendulum was caught or not
        (bench_alone(), np.inf, None, RETURN),
        (bench_alone(force=STRUCK), RETURN, None, np.inf),
    ],
)
def test_a_bench_is_followed_as_long_as_nothing_comes_back(
    made, bench_until, impactor_until, caught
):
    recording = CampaignRecording('r.mcap', 'pendulum', channels=made)
    blow = _blow(recording, ONSET, NOISE, {}, True, [], np.inf)
    ends = {
        name: TIME[-1] if until == np.inf else ONSET + until
        for name, until in (('force', bench_until), ('acceleration.impactor', impactor_until))
        if until is not None
    }
    assert {n: c.time[-1] for n, c in blow.channels.items()} == pytest.approx(ends, abs=2 / RATE)
    assert blow.caught == caught


def test_a_pendulum_that_may_have_been_caught_does_not_come_back_in_a_simulation():
    recording = CampaignRecording('r.mcap', 'pendulum', channels=bench_alone())
    blow = _blow(recording, ONSET, NOISE, {}, True, [], np.inf)
    numbers = {
        'orientation': 1.0,
        'sensor.stiffness': 69e3,
        'sensor.moving_mass': 1.4,
        'sensor.damping_ratio': 0.04,
        'contact.stiffness': 1e6,
        'contact.restitution': 0.5,
        'pendulum.rod_mass': 0.7,
        'pendulum.rod_length': 0.3,
        'pendulum.contact_distance': 0.26,
        'pendulum.moving_mass': 1.0,
        'mass_distance': 0.1,
        'angle': 20.0,
    }
    bench, struck = describe(numbers, blow, 0)
    assert struck.catch_time == RETURN
    held, left = (
        simulate(bench, blow, duration=2.0)
        for blow in (struck, dataclasses.replace(struck, catch_time=np.inf))
    )
    assert all(c.end < RETURN for c in held.contacts)
    assert any(c.end > RETURN for c in left.contacts)


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
