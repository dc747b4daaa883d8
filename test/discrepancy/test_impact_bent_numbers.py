"""Where a baseline leaves as little as the extended model, its numbers tell what is missing."""

from __future__ import annotations

import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.baseline import baseline_model
from impactscope.discrepancy.impact.bent_numbers import bent_numbers, bent_numbers_told
from impactscope.discrepancy.impact.data import prepare
from impactscope.discrepancy.impact.follow import fit_baseline
from impactscope.physics.twin.assembly import Effect


def test_a_baseline_that_explains_everything_has_bent_nothing(make_campaign):
    campaign = make_campaign(3)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    assert bent_numbers(baseline) == ()
    assert bent_numbers_told(baseline, baseline) == ()


def test_impactors_that_arrive_slower_are_told_by_their_bent_angles(make_campaign):
    campaign = make_campaign(3, [Effect('impact_speed_loss', {'ratio': 0.8})])
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    bent = bent_numbers(baseline)
    assert {b.label for b in bent} == {'angle of hit0.mcap', 'angle of hit1.mcap'}
    for number, stated in zip(sorted(bent, key=lambda b: b.label), (12.0, 9.0), strict=True):
        assert number.stated == pytest.approx(stated)
        assert number.std == pytest.approx(0.1)
        # of a fall onto a sensor that lies: the square of the speed is as the angle
        assert number.value == pytest.approx(0.8**2 * stated, rel=0.03)
        assert number.pull < -4.0
        assert number.unit == 'deg'
    answer = explain(campaign)
    assert answer.accepted == ('impact_speed_loss',)
    told = [n for n in answer.notes if 'contradict what is stated' in n]
    assert len(told) == 1
    assert 'angle of hit0.mcap' in told[0]
    assert 'for 12 ± 0.1 deg' in told[0]
