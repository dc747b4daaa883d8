"""Where a candidate's search begins: as strong as it is, with times of its own."""

from __future__ import annotations

import math

import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.candidate import Candidate, stronger
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.search.screening import Screening
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism
from impactscope.physics.twin.assembly import Effect


def test_a_weaker_effect_keeps_its_times():
    branch = Candidate('branch', 'branch', 'damper', amplitudes={'k': 0.0}, along=('c',))
    assert stronger(branch, {'k': 5e3, 'c': 30.0, 'other': 2.0}, 0.01) == {
        'k': pytest.approx(50.0),
        'c': pytest.approx(0.3),
        'other': 2.0,
    }


def test_what_is_more_than_usual_is_less_likely():
    filtered = Candidate('f', 'low_pass_filter', 'measurement', doubt=2.0, usual={'cutoff': 2e3})
    assert filtered.doubt_at({'cutoff': 500.0}) == 2.0
    assert filtered.doubt_at({'cutoff': 2e4}) == pytest.approx(2.0 + math.log(10.0))


def test_a_weak_further_branch_of_the_layer(make_campaign):
    """It relaxes within milliseconds; a search from a strong one finds seconds."""
    branch = Effect('rate_dependent_damper', {'stiffness': 60.0, 'damping': 0.3})
    answer = explain(make_campaign(31, [branch], rate=5000.0, blows=2))
    assert answer.accepted == ('rate_dependent_damper',)
    found = answer.ranking[0].parameters
    for name, true in (('stiffness', 60.0), ('damping', 0.3)):
        assert abs(found[name].value - true) < 4.0 * found[name].std


def test_a_filter_before_sampling_is_tried_as_weak_as_it_may_be(make_campaign):
    """At half the rate it changes signals by hundreds of times their noise: that tells nothing."""
    campaign = make_campaign(21)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    label = 'low_pass_filter:acceleration.impactor of order 2, zero phase, before sampling'
    (far,) = [c for c in candidates(baseline, ()) if c.label == label]
    best, _ = Screening(baseline).best(far)
    assert best.weak[far.free[0].key] > 2.0 * max(s[far.free[0].key] for s in far.starts)
    assert -5.0 < best.gain < 5.0


def test_a_weight_that_goes_with_the_geometry_has_to_explain_more(make_campaign):
    campaign = make_campaign(5, duration=0.3)
    found = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = {c.label: c for c in candidates(found, ())}
    plain, by_geometry = (listed[f'restoring_force{form}'] for form in ('', ' (by geometry)'))
    assert by_geometry.doubt > plain.doubt
    assert by_geometry.cost == plain.cost


def test_no_number_of_a_mechanism_is_sought_beyond_what_is_credible_for_it(make_campaign):
    campaign = make_campaign(5, duration=0.3)
    found = fit_baseline(baseline_model(campaign, prepare(campaign)))
    limits = [
        (f, p)
        for c in candidates(found, ())
        if c.name in all_mechanisms()
        for p in mechanism(c.name).parameters
        for f in c.free
        if f.key == f'{c.label}.{p.name}'
    ]
    assert len(limits) > 40
    for free, parameter in limits:
        assert parameter.lower <= free.lower <= free.upper <= parameter.upper, free.key
