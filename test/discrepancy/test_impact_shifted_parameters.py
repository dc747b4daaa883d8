"""Where a baseline leaves as little as the extended model, its numbers tell what is missing."""

from __future__ import annotations

import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.findings.shifted_parameters import (
    shifted_parameters,
    shifted_parameters_told,
)
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.physics.twin.assembly import Effect


def test_a_baseline_that_explains_everything_has_bent_nothing(make_campaign):
    campaign = make_campaign(3)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    assert shifted_parameters(baseline) == ()
    assert shifted_parameters_told(baseline, baseline) == ()


def test_impactors_that_arrive_slower_are_told_by_their_bent_angles(make_campaign):
    campaign = make_campaign(3, [Effect('impact_speed_loss', {'ratio': 0.8})])
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    bent = shifted_parameters(baseline)
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
