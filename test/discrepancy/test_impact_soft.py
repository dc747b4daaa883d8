"""Soft sensors and layers of which little is stated: what a stiff bench's start values miss."""

from __future__ import annotations

import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.start_values import cold_starts
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.physics.damper_layer import DamperLayer, MaxwellBranch
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.bench import Sensor

SOFT = Sensor(stiffness=12_000.0, moving_mass=1.0, damping_ratio=0.07)
STATED = {'stiffness': {'value': 12_000.0, 'std': 60.0, 'unit': 'N/m'}, 'moving_mass': None}
TWO = DamperLayer(49_000.0, (MaxwellBranch(57_000.0, 3100.0), MaxwellBranch(40_000.0, 38.0)))
UNKNOWN = {
    'parallel_stiffness': {'value': 49_000.0, 'std': 1900.0, 'unit': 'N/m'},
    'branches': [{'stiffness': 57_000.0, 'damping': None}, {'stiffness': None, 'damping': None}],
}


def test_a_soft_spring_that_softens_is_found(make_campaign):
    """With a cubic part that a stiff spring hardly feels it would run away."""
    softens = Effect('softening_spring', {'cubic': -6e5})
    answer = explain(make_campaign(3, [softens], sensor=SOFT, stated={'sensor': STATED}))
    assert answer.accepted == ('softening_spring',)
    cubic = answer.ranking[0].parameters['cubic']
    assert cubic.value == pytest.approx(-6e5, abs=4.0 * cubic.std)


def test_branches_of_which_nothing_is_stated_are_told_fast_and_slow(make_campaign):
    campaign = make_campaign(4, sensor=SOFT, damper=TWO, rate=5000.0, stated={'damper': UNKNOWN})
    found = fit_baseline(baseline_model(campaign, prepare(campaign)))
    assert found.reduced < 1.1
    values = found.values
    slow = values['damper.branches.0.damping'] / values['damper.branches.0.stiffness']
    fast = values['damper.branches.1.damping'] / values['damper.branches.1.stiffness']
    assert slow == pytest.approx(0.054, rel=0.5)
    assert fast == pytest.approx(9.5e-4, rel=0.2)


def test_the_start_as_stated_comes_first_and_each_order_of_branches_is_tried(make_campaign):
    known = make_campaign(4)
    (only,) = cold_starts(baseline_model(known, prepare(known)))
    campaign = make_campaign(4, damper=TWO, stated={'damper': UNKNOWN})
    model = baseline_model(campaign, prepare(campaign))
    first, *others = cold_starts(model)
    keys = [f'damper.branches.{i}.damping' for i in (0, 1)]
    assert only.size + 4 == first.size
    assert [model.values(first)[k] for k in keys] == pytest.approx([1e3, 1e3])
    told = {tuple(float(f'{model.values(x)[k]:.6g}') for k in keys) for x in others}
    assert len(told) == len(others) == 6
