"""Laws of one family: where recordings cannot tell them, the answer holds them all."""

from __future__ import annotations

import pytest

from impactscope.discrepancy.explain import explain
from impactscope.physics.twin.assembly import Effect


def test_friction_names_its_family_and_the_simplest_stands_first(make_campaign):
    answer = explain(make_campaign(51, [Effect('coulomb_friction', {'force': 0.3})]))
    assert answer.accepted == ('coulomb_friction',)
    first = answer.ranking[0]
    assert first.name == 'coulomb_friction'
    assert {'asymmetric_friction', 'stribeck_friction'} <= set(first.confused_with)
    others = {f.name: f for f in answer.ranking[1:]}
    assert 'coulomb_friction' in others['asymmetric_friction'].confused_with
    assert sum(f.probability for f in answer.ranking) <= 1.0 + 1e-9


@pytest.mark.slow
def test_friction_of_two_sizes_is_not_taken_for_one(make_campaign):
    effect = Effect('asymmetric_friction', {'force_forward': 2.0, 'force_backward': 0.5})
    answer = explain(make_campaign(52, [effect]))
    assert answer.accepted == ('asymmetric_friction',)
    assert 'coulomb_friction' not in answer.ranking[0].confused_with
