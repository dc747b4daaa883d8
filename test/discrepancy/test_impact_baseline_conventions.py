"""What the names of a baseline leave open is no missing physics, whichever way it is meant."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.explain import _same
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline, follow
from impactscope.discrepancy.impact.fits.least_squares import at_point, fit
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.models.bench_parameters import LARGE_ANGLES
from impactscope.discrepancy.impact.search import baseline_conventions
from impactscope.discrepancy.impact.search.baseline_conventions import (
    other_conventions,
    with_conventions_of,
)
from impactscope.discrepancy.impact.search.forward_backward import _likelier
from impactscope.discrepancy.impact.search.outcome import Outcome
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.bench import BareContact

BARE = ('linear_sensor', 'hertz_contact', 'unilateral_contact', 'gravity_load')


def test_a_weight_is_taken_the_other_way_and_back(make_campaign):
    campaign = make_campaign(20)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    (other,) = other_conventions(baseline)
    assert other.constants[LARGE_ANGLES] == 1.0
    (back,) = other_conventions(at_point(other, baseline.layout, baseline.x))
    assert back.constants[LARGE_ANGLES] == 0.0
    assert with_conventions_of(baseline.model, other).constants[LARGE_ANGLES] == 1.0


def test_a_choice_may_show_only_where_a_fit_does_not_follow(make_campaign):
    campaign = make_campaign(5, large_angles=True, duration=1.2)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    early = baseline.model.layout(baseline.layout.blows, 0.02)
    assert len(other_conventions(fit(baseline.model, early, baseline.x))) == 1


def test_nobody_can_tell_where_there_is_no_weight(make_campaign):
    names = ('linear_sensor', 'zener_damper', 'unilateral_contact')
    campaign = make_campaign(20, orientation='horizontal', baseline=names)
    assert other_conventions(fit_baseline(baseline_model(campaign, prepare(campaign)))) == []


def test_a_weight_is_taken_anew_once_something_large_is_found(make_campaign):
    friction = Effect('coulomb_friction', {'force': 4.0})
    campaign = make_campaign(23, [friction], large_angles=True, duration=1.0)
    baseline = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = {c.name: c for c in candidates(baseline, campaign.baseline_names)}
    model = listed['coulomb_friction'].extend(baseline.model)
    x = np.append(baseline.x, 4.0)
    near = fit(model, model.layout(baseline.layout.blows, 0.03), x)
    found = follow(near)
    outcome = Outcome(baseline, found, [listed['coulomb_friction']])
    again = _likelier(found, outcome)
    assert found.model.constants.get(LARGE_ANGLES, 0.0) == 0.0
    assert again.model.constants[LARGE_ANGLES] == 1.0
    assert again.chi_square < found.chi_square - 9.0
    assert outcome.baseline.model.constants[LARGE_ANGLES] == 1.0
    assert _likelier(again, outcome) is again


def test_nothing_is_missing_where_the_weight_goes_with_the_swing(make_campaign):
    answer = explain(make_campaign(21, large_angles=True, duration=0.6))
    assert answer.accepted == ()
    assert not answer.unexplained


def test_friction_beside_a_weight_that_goes_with_the_swing(make_campaign):
    friction = Effect('coulomb_friction', {'force': 0.5})
    answer = explain(make_campaign(22, [friction], large_angles=True, duration=0.7, blows=2))
    assert answer.accepted == ('coulomb_friction',)
    force = answer.ranking[0].parameters['force']
    assert abs(force.value - 0.5) < 4.0 * force.std + 1e-4


@pytest.mark.parametrize('loss_of', ['material', 'blow', 'contact'])
def test_nothing_is_missing_whatever_the_loss_of_a_bare_contact_is_a_constant_of(
    make_campaign, loss_of
):
    contact = BareContact(3e8, restitution=0.6, loss_of=loss_of)
    answer = explain(make_campaign(45, bare=contact, baseline=BARE, rate=5000.0))
    assert answer.accepted == ()
    assert not answer.unexplained
    assert any('restitution' in note for note in answer.notes) is (loss_of != 'material')


def test_friction_beside_a_contact_that_loses_by_its_own_speed(make_campaign):
    friction = Effect('coulomb_friction', {'force': 1.0})
    contact = BareContact(3e8, restitution=0.6, loss_of='contact')
    answer = explain(
        make_campaign(46, [friction], bare=contact, baseline=BARE, duration=0.25, blows=2)
    )
    assert answer.accepted == ('coulomb_friction',)
    force = answer.ranking[0].parameters['force']
    assert abs(force.value - 1.0) < 4.0 * force.std + 1e-4


def test_a_choice_that_bends_numbers_until_a_push_makes_up_for_it(make_campaign):
    """Bounces of one fitted blow are met by either choice; no fit leads from one to the other."""
    answer = explain(make_campaign(22, large_angles=True, duration=0.7, blows=2))
    assert answer.accepted == ()
    assert any('with the swing' in note for note in answer.notes)


def test_a_choice_that_misses_the_first_milliseconds_is_not_followed(monkeypatch):
    short, whole = SimpleNamespace(reduced=3.0, model=None), SimpleNamespace(reduced=1.0)
    monkeypatch.setattr(baseline_conventions, 'fit_baseline', lambda *_: whole)
    assert baseline_conventions._followed(short, 2.9) is short
    assert baseline_conventions._followed(short, 3.1) is whole


@pytest.fixture
def bouncing(monkeypatch):
    """Which choice is taken: reduced chi-squares of both over the first bounces and at the end."""

    def chosen(first, last, samples=1000):
        def grown(choice, window):
            layout = SimpleNamespace(window=window, size=samples)
            reduced = first[choice.model]
            return SimpleNamespace(model=choice.model, layout=layout, reduced=reduced)

        monkeypatch.setattr(baseline_conventions, 'other_conventions', lambda _: ['other'])
        monkeypatch.setattr(baseline_conventions, '_choices', lambda model: model)
        monkeypatch.setattr(
            baseline_conventions, '_begun_or_none', lambda m: SimpleNamespace(model=m)
        )
        monkeypatch.setattr(
            baseline_conventions, 'in_processes', lambda f, many: [f(m) for m in many]
        )
        monkeypatch.setattr(baseline_conventions, 'follow', grown)
        monkeypatch.setattr(baseline_conventions, 'followed', lambda made, _: (made, None))
        return baseline_conventions._by_first_bounces(
            SimpleNamespace(model='mine', reduced=last), {}
        ).model

    return chosen


def test_the_first_bounces_tell_which_weight_is_meant_where_late_ones_amplify(bouncing):
    assert bouncing({'mine': 1.3, 'other': 1.0}, 4.0) == 'other'
    assert bouncing({'mine': 1.0, 'other': 1.3}, 4.0) == 'mine'


def test_first_bounces_that_tell_little_or_that_nothing_meets_change_no_choice(bouncing):
    assert bouncing({'mine': 1.02, 'other': 1.0}, 4.0) == 'mine'
    assert bouncing({'mine': 1.9, 'other': 1.3}, 4.0) == 'mine'


def test_baselines_that_leave_the_same_are_searched_once():
    def baseline(residuals):
        return SimpleNamespace(layout=SimpleNamespace(size=3), residuals=np.array(residuals))

    one = baseline([1.0, -2.0, 0.5])
    assert _same(baseline([1.1, -2.1, 0.4]), one)
    assert not _same(baseline([2.1, -2.0, 0.5]), one)
    longer = SimpleNamespace(layout=SimpleNamespace(size=4), residuals=np.zeros(4))
    assert not _same(longer, one)
