"""A base under a bench that rings far above the plate."""

from impactscope.discrepancy.explain import explain
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.bench import BareContact


def test_a_base_that_rings_far_above_the_plate_is_named(make_campaign):
    base = Effect('base_compliance', {'frequency': 2600.0, 'mass': 4.0, 'damping_ratio': 0.03})
    campaign = make_campaign(12, [base], bare=BareContact(), rate=12000.0, duration=0.15)
    answer = explain(campaign)
    assert answer.accepted == ('base_compliance',)
    found = answer.ranking[0].parameters
    assert abs(found['frequency'].value - 2600.0) < 4.0 * found['frequency'].std
