"""A weight that is another than geometry implies is a wrong number, with its size."""

from __future__ import annotations

import dataclasses
import math

import pytest

from impactscope.discrepancy.campaign import BaselineItem
from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.stated_numbers import wrong_numbers
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.models.bench_parameters import describe
from impactscope.physics.twin import layout as at


def stated(campaign, **values):
    """The campaign with these numbers for its weight."""
    items = tuple(
        BaselineItem(b.name, values) if b.name == 'gravity_load' else b for b in campaign.baseline
    )
    return dataclasses.replace(campaign, baseline=items)


@pytest.fixture(scope='module')
def campaign(make_campaign):
    return make_campaign(8)


def load_of(model, blow=1):
    return model.parameters(model.values(model.start()), blow)[at.LOAD]


def test_a_weight_follows_from_geometry_by_a_factor_and_a_load(campaign):
    data = prepare(campaign)
    plain = load_of(baseline_model(campaign, data))
    more = load_of(baseline_model(stated(campaign, weight=1.2, added_weight=0.5), data))
    assert plain > 1.0
    assert more == pytest.approx(1.2 * plain + 0.5)


def test_both_are_looked_for_where_a_weight_is_implied(campaign):
    data = prepare(campaign)
    found = {c.parameter: c for c in wrong_numbers(baseline_model(campaign, data))}
    assert {'gravity_load.weight', 'gravity_load.added_weight'} <= found.keys()
    fixed = {c.parameter for c in wrong_numbers(baseline_model(stated(campaign, force=3.0), data))}
    assert 'gravity_load.weight' not in fixed


def test_a_load_that_nobody_has_stated_counts_as_the_push_that_it_is(campaign):
    data = prepare(campaign)

    def load(of):
        offered = {c.parameter: c for c in wrong_numbers(baseline_model(of, data))}
        return offered['gravity_load.added_weight']

    plain, told = load(campaign), load(stated(campaign, added_weight=0.5))
    assert plain.cost == 3
    assert plain.doubt > 0.0
    assert told.cost == 1
    assert told.doubt == 0.0


def test_another_weight_than_the_simulation_has_is_a_wrong_number(campaign):
    answer = explain(stated(campaign, added_weight=1.5))
    assert answer.accepted == ('wrong_parameter',)
    numbers = answer.ranking[0].parameters
    assert numbers['name'].value == 'added_weight'
    assert numbers['value'].unit == 'N'
    assert float(numbers['value'].value) == pytest.approx(0.0, abs=4 * numbers['value'].std)
    assert math.isfinite(numbers['value'].std)
    weight = next(b for b in answer.model['baseline'] if isinstance(b, dict))
    assert weight['name'] == 'gravity_load'
    assert weight['values']['added_weight'] == numbers['value'].value
    assert explain(stated(campaign, **weight['values'])).accepted == ()


def test_a_pendulum_swings_in_the_gravity_of_the_site(campaign):
    data = prepare(campaign)
    there = dataclasses.replace(campaign, gravity=1.003 * campaign.gravity)
    plain, more = (baseline_model(c, data) for c in (campaign, there))
    assert load_of(more) == pytest.approx(1.003 * load_of(plain))
    _, blow = describe(more.values(more.start()), data.blows[1], 1)
    assert blow.pendulum.gravity == there.gravity
