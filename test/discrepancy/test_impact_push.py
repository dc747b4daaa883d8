"""A push that goes on after the impact, with an end within the recordings and without one."""

import math

import pytest

from impactscope.discrepancy.explain import explain
from impactscope.physics.twin.assembly import Effect

PUSH = {'force': 5.0, 'start': 0.01, 'rise': 0.03}


@pytest.mark.slow
def test_a_push_that_ends_is_told_with_its_end(make_campaign):
    push = Effect('external_push', {**PUSH, 'hold': 0.08, 'fall': 0.04})
    answer = explain(make_campaign(71, [push], blows=2))
    assert answer.accepted == ('external_push',)
    found = answer.findings[0].parameters
    for name, true in (*PUSH.items(), ('hold', 0.08), ('fall', 0.04)):
        assert abs(found[name].value - true) < 4.0 * found[name].std < true


@pytest.mark.slow
def test_the_end_of_a_strong_push_that_comes_late(make_campaign):
    push = {'force': 14.0, 'start': 0.02, 'rise': 0.06, 'hold': 0.15, 'fall': 0.09}
    answer = explain(make_campaign(73, [Effect('external_push', push)], blows=2))
    assert answer.accepted == ('external_push',)
    found = answer.findings[0].parameters
    for name, true in push.items():
        assert abs(found[name].value - true) < 4.0 * found[name].std < true


@pytest.mark.slow
def test_of_a_push_that_stays_no_end_is_told(make_campaign):
    answer = explain(make_campaign(72, [Effect('external_push', PUSH)], blows=2))
    assert answer.accepted == ('external_push',)
    found = answer.findings[0].parameters
    assert abs(found['force'].value - 5.0) < 4.0 * found['force'].std < 1.0
    assert found['hold'].value > 1e3 or math.isnan(found['hold'].std)


@pytest.mark.slow
@pytest.mark.parametrize('seed', [3, 5])
def test_a_faint_push_from_the_contact_on_is_no_wrong_weight(make_campaign, seed):
    """Nearly all of it is re-tuned: a trial by simulation shows the bends of what does so."""
    push = Effect('external_push', {'force': 0.035, 'start': 0.002, 'rise': 0.01})
    answer = explain(make_campaign(seed, [push]))
    assert answer.accepted == ('external_push',)
    found = answer.ranking[0]
    assert abs(found.parameters['force'].value - 0.035) < 3.0 * found.parameters['force'].std
    assert set(found.confused_with) <= {'wrong_parameter'}


@pytest.mark.slow
def test_a_push_of_the_robot_does_not_act_where_a_pendulum_strikes(make_campaign):
    """A motor pushes on, and no pendulum has one; what is told says in which blows it acts."""
    push = Effect('external_push', PUSH)
    campaign = make_campaign(
        74, orientation='horizontal', robots=[(4.0, 0.25), (2.5, 0.3)], of_robots=[push], blows=2
    )
    answer = explain(campaign)
    assert answer.accepted == ('external_push',)
    found = answer.findings[0]
    assert abs(found.parameters['force'].value - 5.0) < 4.0 * found.parameters['force'].std < 1.0
    assert 'robot alone' in found.sentence


@pytest.mark.slow
def test_a_faint_push_that_rises_for_longer_than_the_contact_is_followed_to_its_minimum(
    make_campaign,
):
    """Adjusted to slopes alone, its start and rise lead to a minimum 16 of chi-square above it."""
    push = Effect('external_push', {'force': 0.014, 'start': 0.015, 'rise': 0.035})
    answer = explain(make_campaign(95, [push], blows=4))
    assert answer.accepted == ('external_push',)
    assert answer.ranking[0].evidence > 68.0
