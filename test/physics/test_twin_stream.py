"""The measuring chain and whole campaigns."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import ConfigurationError
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.bench import Bench, HammerTap, PendulumBlow
from impactscope.physics.twin.campaigns import CAMPAIGNS, campaign
from impactscope.physics.twin.measurement import (
    DEFAULT_CHAIN,
    ChannelChain,
    coloured_noise,
    device_times,
    read,
)
from impactscope.physics.twin.simulate import CHANNELS, simulate_at
from impactscope.physics.twin.stream import Campaign, ScheduledBlow, record, stream
from impactscope.records import Quality

QUIET = {name: ChannelChain(name, 2000.0) for name in CHANNELS}


def test_without_noise_a_record_is_the_simulation():
    bench, blow = Bench(), PendulumBlow()
    result = record(bench, blow, chain=QUIET, duration=0.5, contact_time=0.1)
    time = np.arange(1000) / 2000.0
    truth = simulate_at(bench, blow, time, contact_time=0.1)
    for name in CHANNELS:
        np.testing.assert_array_equal(result.channels[name].values, truth[name].astype(np.float32))


def test_channels_of_different_rates_and_clocks_sample_the_same_blow():
    late = Effect('clock_error', {'offset': 2.5e-3, 'drift': 0.0})
    chain = {
        'force': ChannelChain('force', 1000.0),
        'acceleration.plate': ChannelChain('acceleration.plate', 4000.0, effects=(late,)),
    }
    result = record(Bench(), PendulumBlow(), chain=chain, duration=0.4)
    truth = simulate_at(Bench(), PendulumBlow(), np.arange(1600) / 4000.0, contact_time=0.1)
    force = result.channels['force'].values
    plate = result.channels['acceleration.plate'].values
    np.testing.assert_allclose(force, truth['force'][::4], atol=1e-4)
    np.testing.assert_allclose(plate[10:], truth['acceleration.plate'][:-10], atol=1e-3)


def test_the_seed_decides_everything():
    one, again, other = (
        record(Bench(), PendulumBlow(), duration=0.3, seed=s).channels['force'].values
        for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


def test_noise_has_the_stated_strength_and_is_independent_between_channels():
    result = record(Bench(damper=None), HammerTap(), duration=3.0, contact_time=2.5)
    quiet = slice(0, 20_000)
    force = result.channels['force'].values[quiet].astype(float)
    plate = result.channels['acceleration.plate'].values[quiet].astype(float)
    assert force.std() == pytest.approx(0.4, rel=0.03)
    assert plate.std() == pytest.approx(0.08, rel=0.03)
    assert abs(np.corrcoef(force, plate)[0, 1]) < 0.03


@pytest.mark.parametrize('count', [4096, 4097])
def test_coloured_noise_has_unit_strength_and_its_slope(count):
    rng = np.random.default_rng(5)
    runs = np.array([coloured_noise(count, 1.0, rng) for _ in range(200)])
    assert np.sqrt(np.mean(runs**2)) == pytest.approx(1.0, rel=0.02)
    power = np.mean(np.abs(np.fft.rfft(runs)) ** 2, axis=0)[1:-1]
    slope = np.polyfit(np.log(np.arange(1, power.size + 1)), np.log(power), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.05)


def test_range_and_resolution():
    chain = ChannelChain('force', 1000.0, limit=10.0, resolution=0.5)
    values = read(np.linspace(-20, 20, 1001), chain, np.random.default_rng(0))
    assert values.min() == -10.0
    assert values.max() == 10.0
    np.testing.assert_array_equal(values * 2, np.round(values * 2))


def test_effects_reach_only_their_channel():
    bent = Effect('offset', {'value': 7.0}, channel='force')
    plain = record(Bench(), PendulumBlow(), chain=QUIET, duration=0.2)
    effects = [*plain.simulations[0].effects, bent]
    moved = record(Bench(), PendulumBlow(), chain=QUIET, duration=0.2, mechanisms=effects)
    for name in CHANNELS:
        difference = moved.channels[name].values - plain.channels[name].values
        np.testing.assert_allclose(difference, 7.0 if name == 'force' else 0.0, atol=1e-4)


@settings(max_examples=25, deadline=None)
@given(st.floats(1e-3, 0.2))
def test_blocks_are_the_stream_in_order_of_arrival(block_duration):
    chain = {
        'force': ChannelChain('force', 1000.0, limit=100.0),
        'acceleration.base': ChannelChain('acceleration.base', 3200.0),
    }
    result = record(Bench(), PendulumBlow(), chain=chain, duration=0.5)
    blocks = list(result.blocks(block_duration))
    received = [b.received_ns for b in blocks if not b.is_end]
    assert received == sorted(received)
    for name, channel in result.channels.items():
        own = [b for b in blocks if b.channel == name]
        assert own[-1].is_end
        assert [b.first_index for b in own] == list(
            np.cumsum([0] + [b.values.size for b in own[:-1]])
        )
        np.testing.assert_array_equal(np.concatenate([b.values for b in own]), channel.values)
        assert all(b.stamp_ns == round(b.first_index / b.sample_rate * 1e9) for b in own)
    clipped = [b for b in blocks if b.quality & Quality.CLIPPED]
    assert clipped
    assert all(b.channel == 'force' and np.abs(b.values).max() >= 100.0 for b in clipped)


def test_campaign_mechanisms_join_the_implied_ones():
    plain = campaign('hand_pass')
    rubbing = dataclasses.replace(plain, mechanisms=(Effect('coulomb_friction', {'force': 3.0}),))
    names = {e.name for e in stream(rubbing).simulations[0].effects}
    assert names == {'coulomb_friction', 'gravity_load', 'unilateral_contact'}


@pytest.mark.parametrize('name', sorted(CAMPAIGNS))
def test_every_campaign_runs_and_comes_to_rest_between_blows(name):
    chosen = campaign(name)
    slow = {
        channel: dataclasses.replace(chain, sample_rate=1000.0, noise=0.0)
        for channel, chain in chosen.chain.items()
    }
    result = stream(dataclasses.replace(chosen, chain=slow), start_ns=10**18)
    force = result.channels['force'].values
    assert len(result.simulations) == len(chosen.blows)
    for blow in chosen.blows:
        first = round(blow.time * 1000)
        assert np.abs(force[first - 100 : first]).max() < 0.05
        assert force[first : first + 50].max() > 5.0
    for point in result.test_points:
        assert all(point.holds(10**18 + round(b.time * 1e9)) for b in chosen.blows)


def test_hand_campaigns_lie_on_either_side_of_the_limit():
    peaks = {}
    for name in ('hand_pass', 'hand_fail', 'robot'):
        simulations = stream(campaign(name)).simulations
        assert len(simulations) == 3
        peaks[name] = simulations[0]['force'].max()
        late = simulations[0].time - simulations[0].contact_time > 0.5
        assert simulations[0]['force'][late].max() < 0.9 * 140.0
    assert peaks['hand_pass'] < 0.9 * 280.0
    assert peaks['robot'] < 0.9 * 280.0
    assert peaks['hand_fail'] > 1.1 * 280.0


def test_pendulum_is_released_at_rest_before_the_blow():
    result = record(Bench(), PendulumBlow(), chain=QUIET, duration=0.5, contact_time=0.3)
    rows = result.simulations[0].rows
    speed = rows[0, at.IMPACTOR_VELOCITY]
    assert speed == pytest.approx(0.0, abs=1e-12)
    assert np.diff(rows[:600, at.IMPACTOR_POSITION]).min() >= 0.0


@pytest.mark.parametrize(
    'make',
    [
        lambda: ChannelChain('temperature'),
        lambda: ChannelChain('force', 0.0),
        lambda: ChannelChain('force', noise=math.nan),
        lambda: campaign('moon'),
        lambda: Campaign('x', '', (ScheduledBlow(2.0, HammerTap()),), 1.0),
        lambda: Campaign('x', '', (ScheduledBlow(0.5, HammerTap()),) * 2, 1.0),
    ],
)
def test_impossible_descriptions_are_refused(make):
    with pytest.raises(ConfigurationError):
        make()


def test_device_times_follow_the_clock():
    drifting = ChannelChain(
        'force', 1000.0, effects=(Effect('clock_error', {'offset': 0.0, 'drift': 1e-3}),)
    )
    times = device_times(drifting, 1001)
    assert times[-1] == pytest.approx(1.0 / 1.001)
    assert set(DEFAULT_CHAIN) == set(CHANNELS)
