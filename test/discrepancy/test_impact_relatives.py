"""Laws of one family: where recordings cannot tell them, the answer holds them all."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.candidate import contains
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline, follow
from impactscope.discrepancy.impact.fits.least_squares import fit
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.search import pruning
from impactscope.discrepancy.impact.search.fuller_forms import (
    law_in_place_of_two,
    law_that_contains,
)
from impactscope.discrepancy.impact.search.outcome import Found, Outcome
from impactscope.discrepancy.impact.search.strong_effects import with_its_numbers
from impactscope.physics.twin.assembly import Effect


def test_friction_names_its_family_and_the_simplest_stands_first(make_campaign):
    answer = explain(make_campaign(51, [Effect('coulomb_friction', {'force': 0.3})], blows=2))
    assert answer.accepted == ('coulomb_friction',)
    first = answer.ranking[0]
    assert first.name == 'coulomb_friction'
    assert {'asymmetric_friction', 'stribeck_friction'} <= set(first.confused_with)
    others = {f.name: f for f in answer.ranking[1:]}
    assert 'coulomb_friction' in others['asymmetric_friction'].confused_with
    assert sum(f.probability for f in answer.ranking) <= 1.0 + 1e-9


@pytest.mark.slow
def test_a_law_that_contains_another_is_held_against_chance_not_against_all_samples(make_campaign):
    higher = {'static_force': 1.0, 'kinetic_force': 0.976, 'speed': 0.02}
    answer = explain(make_campaign(201, [Effect('stribeck_friction', higher)]))
    assert answer.accepted == ('stribeck_friction',)
    first = answer.ranking[0]
    assert first.probability > 0.5
    excess = first.evidence - next(
        f.evidence for f in answer.ranking if f.name == 'coulomb_friction'
    )
    assert 11.0 < excess < 23.0  # what two numbers would have to gain by the criterion


def test_which_friction_contains_which(make_campaign):
    campaign = make_campaign(61, [])
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = {c.label: c for c in candidates(baseline, ())}
    plain = listed['coulomb_friction']
    for name in ('asymmetric_friction', 'stribeck_friction'):
        assert contains(listed[name], plain)
        assert not contains(plain, listed[name])
    assert not contains(listed['asymmetric_friction'], listed['stribeck_friction'])


@pytest.mark.slow
def test_friction_of_two_sizes_is_not_taken_for_one(make_campaign):
    effect = Effect('asymmetric_friction', {'force_forward': 2.0, 'force_backward': 0.5})
    answer = explain(make_campaign(52, [effect], blows=2))
    assert answer.accepted == ('asymmetric_friction',)
    assert 'coulomb_friction' not in answer.ranking[0].confused_with


def test_a_law_within_another_is_fitted_from_the_other_ones_numbers(make_campaign):
    campaign = make_campaign(61, [Effect('coulomb_friction', {'force': 2.0})])
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = {c.label: c for c in candidates(baseline, ())}
    richer, plain = listed['asymmetric_friction'], listed['coulomb_friction']
    # without friction nothing but the first contact is met, and from there its size is not found
    model = richer.extend(baseline.model)
    model.free = tuple(
        dataclasses.replace(f, start=2.0) if f in richer.free else f for f in model.free
    )
    leader = fit_baseline(model)
    assert leader.reduced < 1.1
    found = with_its_numbers(leader, baseline.model, plain)
    assert found is not None
    assert found.chi_square < leader.chi_square + 8.0
    assert with_its_numbers(leader, baseline.model, listed['clearance']) is None


@pytest.fixture
def plainly_found(make_campaign):
    """What a search holds that has found plain friction where another effect acts."""

    def found(effect):
        campaign = make_campaign(202, [effect])
        baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
        plain = next(c for c in candidates(baseline, ()) if c.label == 'coulomb_friction')
        model = plain.extend(baseline.model)
        made = fit(model, baseline.layout, np.append(baseline.x, 1.5), iterations=30)
        outcome = Outcome(baseline, made, [plain])
        outcome.found[plain.label] = Found(plain, made, 1e3, 0.0, -1e3)
        outcome.rivals[plain.label] = []
        return outcome

    return found


def test_friction_that_is_far_higher_at_rest_is_sought_from_plain_friction(plainly_found):
    true = {'static_force': 2.4, 'kinetic_force': 1.0, 'speed': 0.02}
    outcome = plainly_found(Effect('stribeck_friction', true))
    made = law_that_contains(outcome.final, outcome, (), 1e-3)
    assert made is not None
    assert [c.name for c in outcome.accepted] == ['stribeck_friction']
    assert made.chi_square < outcome.rivals['stribeck_friction'][0].fit.chi_square - 100.0
    for name, value in true.items():
        key = f'stribeck_friction.{name}'
        assert abs(made.values[key] - value) < 0.1 * value


def test_plain_friction_stays_where_no_fuller_law_explains_more(plainly_found):
    outcome = plainly_found(Effect('coulomb_friction', {'force': 1.0}))
    assert law_that_contains(outcome.final, outcome, (), 1e-3) is None
    assert [c.name for c in outcome.accepted] == ['coulomb_friction']


def test_a_law_that_contains_a_finding_is_asked_for_whatever_a_trial_promises(
    plainly_found, monkeypatch
):
    outcome = plainly_found(Effect('coulomb_friction', {'force': 1.0}))
    promised = pruning.Screening.best_refined

    def less(screening, trials):
        return dataclasses.replace(promised(screening, trials), gain=0.0)

    monkeypatch.setattr(pruning.Screening, 'best_refined', less)
    mine = outcome.found['coulomb_friction']
    found = pruning._relatives(outcome, mine, [], [mine], {'stribeck_friction'})
    (other,) = [f for f in found if f.candidate.name == 'asymmetric_friction']
    assert other.fit.chi_square < outcome.final.chi_square + 10.0
    assert all(contains(f.candidate, mine.candidate) for f in found)


HIGHER_AT_REST = {'static_force': 1.05, 'kinetic_force': 1.0, 'speed': 0.02}
BOTH = ['coulomb_friction', 'quadratic_damping']


@pytest.mark.parametrize(
    ('truth', 'accepted'),
    [
        ([Effect('stribeck_friction', HIGHER_AT_REST)], ['stribeck_friction']),
        (
            [
                Effect('coulomb_friction', {'force': 1.0}),
                Effect('quadratic_damping', {'coefficient': 2.0}),
            ],
            BOTH,
        ),
    ],
)
def test_one_law_stands_in_the_place_of_two_that_explain_no_more(make_campaign, truth, accepted):
    """What is left of a friction that is higher at rest looks like damping."""
    campaign = make_campaign(203, truth)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = {c.label: c for c in candidates(baseline, ())}
    both = [listed[name] for name in BOTH]
    plain = both[0].extend(baseline.model)
    x = plain.vector({**baseline.values, 'coulomb_friction.force': 1.0})
    alone = follow(fit(plain, plain.layout(baseline.layout.blows, 0.03), x))
    model = both[1].extend(alone.model)
    x = model.vector({**alone.values, 'quadratic_damping.coefficient': 0.05})
    made = fit(model, alone.layout, x, iterations=30)
    gain = alone.chi_square - made.chi_square
    assert gain > 20.0
    outcome = Outcome(baseline, made, list(both))
    for candidate, evidence in zip(both, (1e3, gain), strict=True):
        outcome.found[candidate.label] = Found(candidate, made, evidence, 0.0, -evidence)
        outcome.rivals[candidate.label] = []
    one = law_in_place_of_two(made, outcome, ())
    assert [c.name for c in outcome.accepted] == accepted
    assert (one is not None) is (len(accepted) == 1)
    assert one is None or one.chi_square < made.chi_square
