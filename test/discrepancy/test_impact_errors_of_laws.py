"""What is too slight beside a finding is the error of its law, and one filter does for two."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.candidates.channel_effects import cutoff_of, delay_of
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import fit
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.search.errors_of_laws import (
    errors_told,
    is_error_of_a_law,
    rest_of_a_law,
    without_errors_of_laws,
)
from impactscope.discrepancy.impact.search.fuller_forms import filter_in_place_of_two
from impactscope.discrepancy.impact.search.outcome import Found, Outcome
from impactscope.physics.twin.assembly import Effect


def found_so_far(*named):
    """An outcome with effects of these names, subsystems and falls of chi-square."""
    accepted = [Candidate(name, name, subsystem) for name, subsystem, _ in named]
    evidence = {
        c.label: SimpleNamespace(gain=gain)
        for c, (_, _, gain) in zip(accepted, named, strict=True)
    }
    return Outcome(None, None, accepted, found=evidence)


@pytest.mark.parametrize(
    ('first', 'other', 'gain', 'slight'),
    [
        ('coulomb_friction', ('hysteresis', 'spring'), 50.0, True),
        ('coulomb_friction', ('hysteresis', 'spring'), 60.0, False),
        ('hardening_spring', ('hysteresis', 'spring'), 60.0, False),
        ('hardening_spring', ('hysteresis', 'spring'), 5.0, True),
        ('coulomb_friction', ('low_pass_filter', 'measurement'), 50.0, True),
        ('coulomb_friction', ('mains_hum', 'measurement'), 60.0, False),
    ],
)
def test_the_error_of_a_law_is_no_further_finding(first, other, gain, slight):
    outcome = found_so_far((first, 'guide', 6e4), (*other, gain))
    assert is_error_of_a_law(Candidate(*other[:1], *other), gain, outcome) is slight
    _, errors = without_errors_of_laws(outcome)
    assert [c.name for c in errors] == ([other[0]] if slight else [])
    told = errors_told(errors, outcome)
    assert bool(told) is slight
    assert not told or other[0] in told[0]


@pytest.mark.parametrize(
    ('first', 'excess', 'slight'),
    [
        ('coulomb_friction', 50.0, True),
        ('coulomb_friction', 60.0, False),
        ('hardening_spring', 60.0, False),
    ],
)
def test_what_friction_leaves_is_its_own_error_where_it_is_slight(first, excess, slight):
    tests = SimpleNamespace(p_values={'laws': 1e-9, 'bands': 0.5}, excess={'laws': excess})
    assert rest_of_a_law(found_so_far((first, 'guide', 6e4)), tests) is slight


def test_what_explains_less_than_nothing_is_told_without_a_share():
    outcome = found_so_far(('coulomb_friction', 'guide', 0.0), ('hysteresis', 'spring', -3.0))
    _, errors = without_errors_of_laws(outcome)
    assert '0.0%' in errors_told(errors, outcome)[0]


def test_beside_nothing_nothing_is_slight():
    assert not is_error_of_a_law(Candidate('x', 'x', 'spring'), 1.0, found_so_far())


@pytest.mark.slow
def test_a_filter_of_a_wrong_order_and_a_clock_are_one_filter(make_campaign):
    """It was found beside what was not known yet; a clock mends its delay, and not its shape."""
    chain = Effect('low_pass_filter', {'cutoff': 180.0, 'order': 2, 'zero_phase': 0}, 'force')
    campaign = make_campaign(205, [chain], blows=2)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = {c.label: c for c in candidates(baseline, ())}
    both = [
        listed['low_pass_filter:force of order 4'],
        listed['clock_error:force offset'],
    ]
    model = both[1].extend(both[0].extend(baseline.model))
    cutoff = cutoff_of(4, delay_of(2, 180.0))
    x = model.vector({**baseline.values, 'low_pass_filter:force.cutoff': cutoff})
    made = fit(model, baseline.layout, x, iterations=30)
    outcome = Outcome(baseline, made, list(both))
    for candidate in both:
        outcome.found[candidate.label] = Found(candidate, made, 500.0, 0.0, -500.0)
    one = filter_in_place_of_two(made, outcome)
    assert one is not None
    assert one.chi_square < made.chi_square
    assert [c.label for c in outcome.accepted] == ['low_pass_filter:force of order 2']
    told = one.values['low_pass_filter:force.cutoff']
    assert told == pytest.approx(180.0, abs=4.0 * one.std('low_pass_filter:force.cutoff'))
