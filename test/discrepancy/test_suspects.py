"""Explanations of which none is accepted: each names the others that might be meant as well."""

from __future__ import annotations

from impactscope.discrepancy.answer import Finding, suspects
from impactscope.discrepancy.explain import explain
from impactscope.physics.twin.assembly import Effect


def test_each_suspect_names_those_that_are_no_less_likely_by_far():
    tried = [
        Finding('restoring_force', 0.4),
        Finding('ac_coupling', 0.39, confused_with=('zero_drift',)),
        Finding('restoring_force', 0.2),
        Finding('end_stop', 0.001),
    ]
    told = [f.confused_with for f in suspects(tried, 0.02)]
    assert told == [
        ('ac_coupling',),
        ('zero_drift', 'restoring_force'),
        ('ac_coupling',),
        ('restoring_force', 'ac_coupling'),
    ]


def test_a_friction_too_weak_to_be_accepted_is_named_with_its_kin(make_campaign):
    answer = explain(make_campaign(4, [Effect('coulomb_friction', {'force': 0.005})], blows=2))
    assert answer.accepted == ()
    first = answer.ranking[0]
    assert first.name == 'coulomb_friction'
    assert 'stribeck_friction' in first.confused_with
