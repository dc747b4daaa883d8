"""Clocks that are off by many milliseconds."""

from __future__ import annotations

import statistics

import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.search.time_offsets import lags
from impactscope.physics.twin.assembly import Effect


def late(channel, offset):
    return Effect('clock_error', {'offset': offset, 'drift': 0.0}, channel)


@pytest.mark.parametrize(
    ('channel', 'offset'),
    [
        ('acceleration.plate', 0.010),
        ('force', -0.008),
        ('acceleration.impactor', 0.004),
        ('force', 0.0),
    ],
)
def test_a_channel_that_is_out_of_step_is_seen(make_campaign, channel, offset):
    made = make_campaign(67, [late(channel, offset)] if offset else [])
    found = lags(baseline_model(made, prepare(made)))
    assert found
    for seen in found.values():
        against = seen[channel] - statistics.median(seen.values())
        assert against == pytest.approx(offset, abs=1e-3)


def test_what_is_missing_elsewhere_does_not_pass_for_a_late_channel(make_campaign):
    made = make_campaign(68, [Effect('coulomb_friction', {'force': 8.0})])
    for seen in lags(baseline_model(made, prepare(made))).values():
        assert max(seen.values()) - min(seen.values()) < 1.5e-3


@pytest.mark.slow
@pytest.mark.parametrize(('channel', 'offset'), [('acceleration.plate', 0.010), ('force', -0.008)])
def test_the_clock_of_a_late_channel_is_named(make_campaign, channel, offset):
    campaign = make_campaign(69, [late(channel, offset)])
    answer = explain(campaign)
    assert answer.accepted == ('clock_error',)
    found = answer.ranking[0]
    assert found.channel == channel
    said, rate = found.parameters['offset'], found.parameters['drift']
    assert abs(said.value - offset) < 3.0 * said.std
    onset = prepare(campaign).blows[0].onset  # where the blows tell how late it is
    assert said.value + rate.value * onset == pytest.approx(offset, abs=1e-5)
    # no blow of half a second tells a clock's rate: that of two crystals stays open
    assert abs(rate.value) < 2e-4
    assert 1e-7 < said.std < 1e-4
    assert 1e-7 < rate.std < 5e-5
