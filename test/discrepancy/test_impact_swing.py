"""A weight that acts as the pendulum swings is what a baseline with a weight means, too."""

from __future__ import annotations

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.baseline import baseline_model
from impactscope.discrepancy.impact.data import prepare
from impactscope.discrepancy.impact.follow import fit_baseline
from impactscope.discrepancy.impact.model import LARGE_ANGLES
from impactscope.discrepancy.impact.swing import weight_matters, with_other_weight
from impactscope.physics.twin.assembly import Effect


def test_a_weight_is_taken_the_other_way_and_back(make_campaign):
    campaign = make_campaign(20)
    model = baseline_model(campaign, prepare(campaign))
    other = with_other_weight(model)
    assert other.constants[LARGE_ANGLES] == 1.0
    assert with_other_weight(other).constants[LARGE_ANGLES] == 0.0


def test_nobody_can_tell_where_there_is_no_weight(make_campaign):
    names = ('linear_sensor', 'zener_damper', 'unilateral_contact')
    campaign = make_campaign(20, orientation='horizontal', baseline=names)
    assert not weight_matters(fit_baseline(baseline_model(campaign, prepare(campaign))))


def test_nothing_is_missing_where_the_weight_goes_with_the_swing(make_campaign):
    answer = explain(make_campaign(21, large_angles=True, duration=1.0))
    assert answer.accepted == ()
    assert not answer.unexplained


def test_friction_beside_a_weight_that_goes_with_the_swing(make_campaign):
    friction = Effect('coulomb_friction', {'force': 0.5})
    answer = explain(make_campaign(22, [friction], large_angles=True, duration=1.0))
    assert answer.accepted == ('coulomb_friction',)
    force = answer.ranking[0].parameters['force']
    assert abs(force.value - 0.5) < 4.0 * force.std + 1e-4
