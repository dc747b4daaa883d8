"""Baselines that are hard to reach: bouncing contacts, another structure, held-out blows."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits import growing_windows
from impactscope.discrepancy.impact.fits.growing_windows import (
    _by_other_ways,
    _by_taps,
    begun,
    fit_baseline,
    fit_unless_far_behind,
    held_out_fit,
    with_repeatability,
)
from impactscope.discrepancy.impact.fits.least_squares import at_point, fit
from impactscope.discrepancy.impact.fits.start_values import SHORT, _missed, place
from impactscope.discrepancy.impact.models.baseline import baseline_model, with_metal_that_lets_go
from impactscope.discrepancy.impact.search import prediction_misfit as prediction
from impactscope.discrepancy.impact.search.outcome import settled_without
from impactscope.discrepancy.impact.search.prediction_misfit import (
    further_misfit,
    prediction_misfit,
)
from impactscope.discrepancy.time_limit import time_limited
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.bench import BareContact
from impactscope.physics.twin.simulate import SimulationError

BARE = ('linear_sensor', 'hertz_contact', 'unilateral_contact', 'gravity_load')
GLUED = ('linear_sensor', 'zener_damper', 'gravity_load')


def test_a_baseline_follows_to_the_end_and_predicts(make_campaign, monkeypatch):
    campaign = make_campaign(41)
    model = baseline_model(campaign, prepare(campaign))
    found = fit_baseline(model)
    assert found.reduced < 1.1
    assert found.layout.size == found.model.layout(model.data.fitted).size
    assert found.values['sensor.moving_mass'] == pytest.approx(1.671, rel=0.02)
    held_out = held_out_fit(found, found.model.data.held_out)
    assert held_out is not None
    assert held_out.reduced < 1.2
    same = further_misfit((found, held_out), (found, held_out))
    assert same == pytest.approx(0.0, abs=0.1)
    x = found.x.copy()
    x[found.model.index('sensor.damping_ratio')] += 0.05  # of its logarithm
    wrong = dataclasses.replace(found, x=x)
    predicted = held_out_fit(wrong, found.model.data.held_out)
    assert further_misfit((found, held_out), (wrong, predicted)) > 30.0
    # one sample, as on the verge of a contact, decides neither way; many do
    odd, many = np.zeros((2, held_out.layout.size))
    odd[7], many[:] = 16.0, 0.5
    for missed, least, most in ((odd, 0.0, 0.1), (many, 0.2 * many.size, 0.25 * many.size)):
        given = {id(found): np.zeros_like(missed), id(wrong): missed}
        monkeypatch.setattr(prediction, '_unforeseen', lambda fit, *_, g=given: g[id(fit)])
        rise = further_misfit((found, held_out), (wrong, held_out))
        assert least <= rise <= most
        assert further_misfit((wrong, held_out), (found, held_out)) == pytest.approx(-rise)


def test_a_model_none_of_whose_starts_can_be_simulated_is_no_crash(make_campaign, monkeypatch):
    campaign = make_campaign(41)
    model = baseline_model(campaign, prepare(campaign))
    layout = model.layout(model.data.fitted, SHORT[0])
    found = at_point(model, layout, model.start())
    monkeypatch.setattr(growing_windows, 'placed', lambda *_: None)
    assert fit_unless_far_behind(model, found) is None
    with pytest.raises(SimulationError, match='first milliseconds'):
        fit_baseline(model)


def test_a_contact_that_begins_with_the_last_sample_is_no_missed_prediction(monkeypatch):
    samples = np.zeros(1000)
    predicted = SimpleNamespace(layout=SimpleNamespace(size=samples.size), x=np.zeros(2))
    monkeypatch.setattr(prediction, '_unforeseen', lambda *_: samples)
    samples[-1] = 46.0
    assert prediction_misfit(None, predicted) < 0.02
    samples[-20:] = 46.0  # but one that is missed as long as it lasts is
    assert prediction_misfit(None, predicted) > 30.0


@pytest.mark.parametrize(('stiffness', 'restitution'), [(1.5e7, 0.9), (1e8, 0.85), (3e9, 0.3)])
def test_a_bare_contact_is_met_whatever_its_law(make_campaign, stiffness, restitution):
    contact = BareContact(stiffness, restitution=restitution)
    campaign = make_campaign(43, bare=contact, baseline=BARE, rate=5000.0)
    found = fit_baseline(baseline_model(campaign, prepare(campaign)))
    assert found.reduced < 1.2
    assert found.values['contact.stiffness'] == pytest.approx(stiffness, rel=0.1)
    held_out = held_out_fit(found, found.model.data.held_out)
    assert held_out is not None
    assert prediction_misfit(found, held_out) < 1.2


def test_a_blow_is_placed_up_to_a_sample_after_it_is_seen(make_campaign):
    contact = BareContact(4e7, restitution=0.7)
    campaign = make_campaign(43, bare=contact, baseline=BARE, rate=1000.0)
    data = prepare(campaign)
    found = fit_baseline(baseline_model(campaign, data))
    late = [
        i for i in data.fitted if found.values[f'time@{i}'] - data.blows[i].onset > 3e-4
    ]  # samples are 1 ms apart
    assert late
    x = found.x.copy()
    for i in late:
        x[found.model.index(f'time@{i}')] = data.blows[i].onset
    moved = found.model.values(place(found.model, x, late))
    for i in late:
        assert moved[f'time@{i}'] == pytest.approx(found.values[f'time@{i}'], abs=5e-5)


def test_taps_hold_the_bench_while_a_bare_contact_is_met(make_campaign):
    contact = BareContact(1e8, restitution=0.7)
    campaign = make_campaign(43, bare=contact, baseline=BARE, rate=5000.0)
    model = baseline_model(campaign, prepare(campaign))
    found = _by_taps(model)
    assert found is not None
    assert found.reduced < 1.2
    assert found.values['contact.stiffness'] == pytest.approx(1e8, rel=0.1)


def test_what_is_far_behind_in_the_first_milliseconds_is_followed_no_further(
    make_campaign, monkeypatch
):
    campaign = make_campaign(41)
    model = baseline_model(campaign, prepare(campaign))
    found = fit_baseline(model)
    same = fit_unless_far_behind(model, found)
    assert same is not None
    assert same.chi_square == pytest.approx(found.chi_square, rel=1e-3)
    soft = model.extended(constants={'damper.parallel_stiffness': 2e3})
    soft.free = tuple(f for f in soft.free if f.key != 'damper.parallel_stiffness')
    monkeypatch.setattr(growing_windows, 'fit_baseline', lambda *_: pytest.fail('was followed'))
    assert fit_unless_far_behind(soft, found) is None


def test_a_bare_contact_that_only_taps_lead_to_is_not_far_behind(make_campaign, monkeypatch):
    contact = BareContact(1e8, restitution=0.7)
    campaign = make_campaign(43, bare=contact, baseline=BARE, rate=5000.0)
    model = baseline_model(campaign, prepare(campaign))
    found = fit_baseline(model)
    bent = dataclasses.replace(found, chi_square=100.0 * found.chi_square)
    monkeypatch.setattr(growing_windows, 'begun', lambda _: bent)
    again = fit_unless_far_behind(model, found)
    assert again is not None
    assert again.reduced < 1.2
    monkeypatch.setattr(growing_windows, '_begun_by_taps', lambda _: None)
    assert fit_unless_far_behind(model, found) is None


def test_no_other_starts_are_tried_once_the_time_is_over(make_campaign):
    contact = BareContact(1e8, restitution=0.7)
    campaign = make_campaign(43, bare=contact, baseline=BARE, rate=5000.0)
    short = begun(baseline_model(campaign, prepare(campaign)))
    with time_limited(0.0) as patience:
        assert _by_other_ways(short, short) is short
    assert list(patience.left_out) == ['other starts of the baseline']


def test_taps_that_miss_something_hold_nothing(make_campaign):
    effect = Effect('coulomb_friction', {'force': 2.0})
    campaign = make_campaign(44, (effect,), bare=BareContact(1e8), baseline=BARE, rate=5000.0)
    model = baseline_model(campaign, prepare(campaign))
    assert _by_taps(model) is None


def test_a_finding_smaller_than_its_uncertainty_makes_the_fit_without_it_look_again(
    make_campaign,
):
    campaign = make_campaign(41)
    model = baseline_model(campaign, prepare(campaign))
    found = fit_baseline(model)
    number = next(c for c in candidates(found, ()) if c.label.startswith('wrong mass_distance'))
    extended = number.extend(found.model)
    known = found.values
    start = np.array([f.to_inner(known.get(f.key, f.start)) for f in extended.free])
    joint = fit(extended, found.layout, start, near=found)
    x = found.x.copy()
    x[found.model.index('sensor.damping_ratio')] += 0.05  # of its logarithm
    elsewhere = at_point(found.model, found.layout, x)
    assert elsewhere.chi_square > found.chi_square + 100.0
    again = settled_without(joint, [number], elsewhere)
    assert again.chi_square == pytest.approx(found.chi_square, abs=1.0)
    assert settled_without(joint, [number], found) is found


def test_what_no_bench_repeats_counts_once_however_often_it_is_looked_at(make_campaign):
    campaign = make_campaign(41)
    model = baseline_model(campaign, prepare(campaign))
    once = with_repeatability(model, model.start())
    twice = with_repeatability(once, model.start())
    for first, second in zip(once.data.blows, twice.data.blows, strict=True):
        for name, channel in first.channels.items():
            assert np.array_equal(channel.std, second.channels[name].std)
            assert np.all(channel.std >= channel.own_std)


@pytest.mark.slow
def test_a_contact_that_the_simulation_glues_is_named(make_campaign):
    answer = explain(make_campaign(42, baseline=GLUED))
    assert answer.accepted == ('unilateral_contact',)
    assert answer.fit.extended.reduced_chi_square < 1.2
    assert math.isfinite(answer.fit.baseline.reduced_chi_square)
    assert answer.fit.baseline.reduced_chi_square > 10.0


@pytest.mark.slow
def test_a_ringing_fixture_is_found_whatever_its_frequency(make_campaign):
    values = {'frequency': 190.0, 'mass': 25.0, 'damping_ratio': 0.03}
    answer = explain(make_campaign(43, [Effect('base_compliance', values)]))
    assert answer.accepted == ('base_compliance',)
    for name, value in values.items():
        item = answer.ranking[0].parameters[name]
        assert abs(item.value - value) < 4 * item.std


def test_bare_metal_lets_go_whether_the_baseline_says_so_or_not(make_campaign):
    names = ('linear_sensor', 'hertz_contact', 'gravity_load')
    campaign = make_campaign(43, bare=BareContact(1e8), baseline=names, rate=5000.0)
    taken = with_metal_that_lets_go(campaign)
    assert taken.baseline_names == (*names, 'unilateral_contact')
    assert 'hertz_contact is taken to push only' in taken.notes[-1]
    assert with_metal_that_lets_go(taken) is taken
    glued = make_campaign(42, baseline=GLUED)
    assert with_metal_that_lets_go(glued) is glued


@pytest.mark.parametrize('to_the_end', [True, False])
def test_the_last_contact_that_only_one_fit_meets_decides(monkeypatch, to_the_end):
    found = SimpleNamespace(layout=SimpleNamespace(size=8015), reduced=0.9436)
    other = SimpleNamespace(layout=SimpleNamespace(size=8147), reduced=0.9427)
    monkeypatch.setattr(growing_windows, 'follows_all', lambda f: to_the_end and f is other)
    assert growing_windows.further(found, other) is (other if to_the_end else found)


def test_a_blow_that_is_lost_is_placed_from_its_stated_release(make_campaign):
    contact = BareContact(1e8, restitution=0.85)
    campaign = make_campaign(43, bare=contact, baseline=BARE, rate=5000.0)
    model = baseline_model(campaign, prepare(campaign))
    found = fit_baseline(model)
    model = found.model
    blow = next(i for i in model.data.fitted if model.data.blows[i].recording.kind == 'pendulum')
    layout = model.layout(model.data.fitted, SHORT[-1])
    time, angle = model.index(f'time@{blow}'), model.index(f'angle@{blow}')
    lost = found.x.copy()
    lost[time] += 5e-4
    lost[angle] = model.free[angle].to_inner(0.1 * found.values[f'angle@{blow}'])
    moved = _missed(at_point(model, layout, lost))
    assert moved is not None
    assert moved[time] == pytest.approx(found.x[time], abs=2e-5)
    assert moved[angle] == pytest.approx(found.x[angle], rel=0.02)
