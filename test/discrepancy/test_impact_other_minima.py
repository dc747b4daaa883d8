"""What rings has minima all over the spectrum: its frequency is scanned."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import at_point, fit
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.search import forward_backward as searching
from impactscope.discrepancy.impact.search import other_minima as minima
from impactscope.discrepancy.impact.search.other_minima import lowest, other_modes, rung
from impactscope.discrepancy.impact.search.outcome import Outcome
from impactscope.discrepancy.impact.search.profile_likelihood import profiled
from impactscope.discrepancy.time_limit import time_limited
from impactscope.errors import ImpactscopeError
from impactscope.physics.twin.assembly import Effect


@pytest.fixture(scope='module')
def ringing(make_campaign):
    """A fixture that rings at 110 Hz: the fit without it, and the candidate."""
    numbers = {'frequency': 110.0, 'mass': 25.0, 'damping_ratio': 0.03}
    campaign = make_campaign(64, [Effect('base_compliance', numbers)])
    without = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = candidates(without, campaign.baseline_names)
    return without, next(c for c in listed if c.name == 'base_compliance')


def test_a_scan_shows_where_a_part_rings(ringing):
    without, fixture = ringing
    found = rung(without, fixture)
    dampings = 2
    assert 1 <= len(found) <= 3 * dampings
    assert found[0]['base_compliance.frequency'] == pytest.approx(110.0, rel=0.05)
    assert set(found[0]) >= {f.key for f in without.model.free}


def test_a_fit_at_a_wrong_frequency_finds_the_right_one(ringing):
    without, fixture = ringing
    model = fixture.extend(without.model)
    wrong = {
        **without.values,
        'base_compliance.frequency': 300.0,
        'base_compliance.mass': 5.0,
        'base_compliance.damping_ratio': 0.03,
    }
    x = np.array([f.to_inner(wrong.get(f.key, f.start)) for f in model.free])
    astray = fit(model, without.layout, x)
    assert abs(astray.values['base_compliance.frequency'] / 110.0 - 1.0) > 0.2
    best, _ = other_modes(astray, [fixture], rung(without, fixture))
    assert best.chi_square < astray.chi_square - 9.0
    assert best.values['base_compliance.frequency'] == pytest.approx(110.0, rel=0.03)


def test_a_push_may_begin_at_another_moment(make_campaign):
    """Slopes lead to no other one, and tell the one far too well."""
    numbers = {'force': 0.05, 'start': 0.0, 'rise': 0.02}
    effects = [Effect('external_push', numbers)]
    campaign = make_campaign(65, effects, orientation='horizontal', duration=0.7)
    without = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = candidates(without, campaign.baseline_names)
    push = next(c for c in listed if c.name == 'external_push')
    model = push.extend(without.model)
    late = {'external_push.force': 0.05, 'external_push.start': 0.045, 'external_push.rise': 1e-4}
    there = fit(model, without.layout, model.vector({**without.values, **late}))
    assert there.values['external_push.start'] > 0.04
    best, _ = other_modes(there, [push])
    assert best.chi_square < there.chi_square - 100.0
    assert best.values['external_push.start'] < 0.01


def test_a_fit_finds_lower_ground_by_way_of_the_first_contacts(ringing, monkeypatch):
    without, _ = ringing
    j = without.model.index('sensor.stiffness')
    x = without.x.copy()
    x[j] += 0.02
    astray = at_point(without.model, without.layout, x)
    monkeypatch.setattr(minima, 'other_modes', lambda f, _: (f, []))
    assert lowest(astray, []).chi_square == pytest.approx(without.chi_square, rel=1e-3)
    assert lowest(without, []).chi_square <= without.chi_square


def test_a_fit_finds_lower_ground_by_steps_along_the_valley_of_a_number(ringing, monkeypatch):
    without, fixture = ringing
    model = fixture.extend(without.model)
    start = {**without.values, **rung(without, fixture)[0]}
    best = fit(model, without.layout, model.vector(start))
    tried = []

    def fits(model, layout, starts, **_):
        tried.extend(starts)
        return [at_point(model, layout, best.x)]

    def nowhere(*_, **__):
        raise ImpactscopeError('cannot be simulated')

    monkeypatch.setattr(minima, 'other_modes', lambda f, _: (f, []))
    monkeypatch.setattr(minima, 'fit', nowhere)
    monkeypatch.setattr(minima, 'fits_from', fits)
    x = best.x.copy()
    x[model.index('base_compliance.mass')] += 0.1
    astray = at_point(model, without.layout, x)
    assert lowest(astray, [fixture]).chi_square == pytest.approx(best.chi_square)
    numbers = [number.key for number in fixture.free if number.blow is None]
    assert len(tried) == 2 * len(numbers)
    first = 2 * numbers.index('base_compliance.mass')
    j = model.index('base_compliance.mass')
    std = np.sqrt(astray.covariance()[j, j])
    moved = [(start[j] - astray.x[j]) / std for start in tried[first : first + 2]]
    assert moved == pytest.approx([4.0, -4.0], rel=0.01)


def test_other_values_are_left_out_once_the_time_is_over(ringing):
    without, fixture = ringing
    model = fixture.extend(without.model)
    known = {**without.values, **fixture.starts[0]}
    x = np.array([f.to_inner(known.get(f.key, f.start)) for f in model.free])
    here = at_point(model, without.layout, x)
    with time_limited(0.0) as limit:
        assert other_modes(here, [fixture], [known]) == (here, [])
        best, factors = profiled(here, [fixture])
    assert best is here
    assert set(factors.values()) == {1.0}
    left_out = ['other values of what was found', 'how far its numbers may go']
    assert list(limit.left_out) == left_out


def test_what_has_no_frequency_is_not_scanned(ringing):
    without, fixture = ringing
    still = dataclasses.replace(fixture, free=fixture.free[1:])
    assert rung(without, still) == []


@pytest.mark.parametrize(('fallen', 'times'), [(500.0, 2), (1.0, 1)])
def test_findings_are_pruned_again_beside_numbers_that_turned_out_otherwise(
    monkeypatch, fallen, times
):
    finding = SimpleNamespace(name='friction', free=(), channel='')
    first = SimpleNamespace(model=None, layout=None, x=None, chi_square=2000.0)
    better = SimpleNamespace(model=None, layout=None, x=None, chi_square=2000.0 - fallen)
    outcome = Outcome(first, first, [finding, finding])
    pruned = []
    monkeypatch.setattr(searching, 'prune', lambda *_: pruned.append(1))
    monkeypatch.setattr(searching, 'one_for_two', lambda _: False)
    monkeypatch.setattr(searching, 'fit', lambda *_, **__: first)
    monkeypatch.setattr(searching, 'settled', lambda f: f)
    monkeypatch.setattr(searching, 'other_modes', lambda *_: (better, []))
    monkeypatch.setattr(searching, 'profiled', lambda f, _: (f, {}))
    search = searching.Search(())
    monkeypatch.setattr(search, '_bare', lambda _: None)
    search._finished(outcome)
    assert len(pruned) == times
    assert outcome.final is better


@pytest.mark.parametrize(('fallen', 'anew'), [(20.0, True), (0.3, False)])
def test_what_held_out_recordings_bring_is_taken_to_its_lowest_minimum(monkeypatch, fallen, anew):
    finding = SimpleNamespace(name='base', free=(), channel='', label='base')
    data = SimpleNamespace(held_out=(3,))
    model = SimpleNamespace(data=data)
    levels = 2000.0, 1990.0, 1990.0 - fallen
    without, brought, lowest_one = (
        SimpleNamespace(model=model, layout=None, x=None, chi_square=c) for c in levels
    )
    outcome = Outcome(without, without, [])

    def bring(judged, *_):
        judged.accepted.extend([finding, finding])
        judged.final, judged.held_out_final = brought, 'as it was brought'

    monkeypatch.setattr(searching, 'check_held_out', bring)
    monkeypatch.setattr(searching, 'fit', lambda *_, **__: brought)
    monkeypatch.setattr(searching, 'settled', lambda f: f)
    monkeypatch.setattr(searching, 'other_modes', lambda *_: (lowest_one, [brought]))
    monkeypatch.setattr(searching, 'profiled', lambda f, _: (f, {}))
    monkeypatch.setattr(searching, 'held_out_fit', lambda f, *_: f)
    searching.Search(()).check(outcome)
    assert outcome.final is lowest_one
    assert outcome.modes == [brought]
    assert outcome.held_out_final == (lowest_one if anew else 'as it was brought')
