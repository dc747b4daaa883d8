"""Strong effects: nothing of a bent baseline may lead to a wrong law, or to none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.candidate import kin_of
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import fit
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.search.strong_effects import (
    from_first_contact,
    in_place_of,
    race,
    related,
)
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.bench import BareContact

WINDOW = 0.04  # s
BARE = BareContact(5e8, restitution=0.5)


@pytest.mark.parametrize('force', [0.05, 2.0, 8.0])
def test_friction_does_not_pass_for_a_hammer_that_stays(make_campaign, force):
    made = make_campaign(61, [Effect('coulomb_friction', {'force': force})])
    taps = [b for b in prepare(made).blows if b.recording.kind == 'tap']
    assert taps
    for blow in taps:
        assert 0.003 < blow.settled - blow.onset < 0.012


@pytest.fixture
def without_friction(make_campaign):
    """A baseline fitted to blows with much friction, up to ``WINDOW``."""
    made = make_campaign(62, [Effect('coulomb_friction', {'force': 4.0})])
    baseline = fit_baseline(baseline_model(made, prepare(made)))
    layout = baseline.model.layout(baseline.layout.blows, WINDOW)
    return made, fit(baseline.model, layout, baseline.x)


def test_a_race_from_the_first_milliseconds_finds_the_strength(without_friction):
    made, current = without_friction
    assert current.reduced > 5.0
    runners = race(current, made.baseline_names, WINDOW)
    fits = {candidate.name: joint for candidate, joint in runners}
    found = fits['coulomb_friction']
    assert found.reduced < 1.2
    assert found.values['coulomb_friction.force'] == pytest.approx(4.0, rel=0.01)
    chi_squares = [joint.chi_square for _, joint in runners]
    assert chi_squares == sorted(chi_squares)


def test_a_law_sets_out_from_what_a_relative_has_found(without_friction):
    made, current = without_friction
    listed = {c.name: c for c in candidates(current, made.baseline_names)}
    richer, simple = listed['stribeck_friction'], listed['coulomb_friction']
    model = richer.extend(current.model)
    numbers = {
        'stribeck_friction.static_force': 4.0,
        'stribeck_friction.kinetic_force': 4.0,
        'stribeck_friction.speed': 1e-4,
    }
    start = np.array(
        [f.to_inner(numbers.get(f.key, current.values.get(f.key, f.start))) for f in model.free]
    )
    leader = fit(model, current.layout, start, iterations=40)
    instead = in_place_of(leader, current.model, simple)
    assert instead is not None
    assert instead.chi_square < 1.02 * leader.chi_square
    assert instead.values['coulomb_friction.force'] == pytest.approx(4.0, rel=0.01)
    family = related(simple, list(listed.values()))
    assert {c.name for c in family} == set(kin_of(simple))


@pytest.mark.slow
@pytest.mark.parametrize('force', [1.5, 8.0])
def test_much_friction_is_friction_and_nothing_richer(make_campaign, force):
    answer = explain(make_campaign(63, [Effect('coulomb_friction', {'force': force})], blows=2))
    assert answer.accepted == ('coulomb_friction',)
    found = answer.ranking[0].parameters['force']
    assert abs(found.value - force) < 4.0 * found.std + 1e-3 * force


def test_what_rings_beside_the_plate_leaves_the_pulse_of_a_tap_open(without_friction):
    made, current = without_friction
    listed = {c.name: c for c in candidates(current, made.baseline_names)}
    fixture = listed['base_compliance']
    pulses = [f for f in fixture.free if f.key.startswith('tap_duration@')]
    assert pulses
    assert fixture.cost == 3  # of a pulse something is known
    wider = fit(
        fixture.extend(current.model), current.layout, start_of(fixture, current), iterations=1
    )
    again = candidates(wider, made.baseline_names)
    assert not any(c.parameter.startswith('tap_') for c in again)


def start_of(candidate, current):
    free = candidate.extend(current.model).free
    return np.array([f.to_inner(current.values.get(f.key, f.start)) for f in free])


@pytest.mark.slow
def test_a_fixture_that_gives_way_is_no_stranger(make_campaign):
    numbers = {'frequency': 150.0, 'mass': 5.0, 'damping_ratio': 0.03}
    answer = explain(make_campaign(64, [Effect('base_compliance', numbers)]))
    assert answer.accepted == ('base_compliance',)
    for name, value in numbers.items():
        found = answer.ranking[0].parameters[name]
        assert abs(found.value - value) < 4.0 * found.std


@pytest.mark.slow
def test_friction_on_the_bare_plate_is_found_by_its_taps(make_campaign):
    friction = Effect('coulomb_friction', {'force': 8.0})
    made = make_campaign(65, [friction], bare=BARE, duration=0.25, blows=2)
    assert explain(made).accepted == ('coulomb_friction',)


@pytest.mark.slow
def test_a_weight_that_is_stated_at_nought_may_sit_elsewhere(make_campaign):
    made = make_campaign(66)
    recordings = tuple(
        dataclasses.replace(r, mass_distance=0.0) if r.file == 'hit0.mcap' else r
        for r in made.recordings
    )
    answer = explain(dataclasses.replace(made, recordings=recordings))
    assert answer.accepted == ('wrong_parameter',)
    found = answer.ranking[0]
    assert found.recording == 'hit0.mcap'
    assert 'ratio' not in found.parameters
    assert found.parameters['value'].value == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize('step', [10.0, 20.0])
def test_a_converter_too_coarse_for_the_quiet_is_neither_mute_nor_saturated(make_campaign, step):
    made = make_campaign(70, [Effect('quantisation', {'step': step}, 'force')])
    data = prepare(made)
    assert data.noise['force'] == pytest.approx(step / np.sqrt(12.0), rel=1e-6)
    for blow in data.blows:
        force = blow.channels['force']
        assert np.isinf(force.clipped_at)
        assert force.step == pytest.approx(step, rel=1e-6)


@pytest.mark.slow
def test_a_coarse_converter_is_all_that_is_found(make_campaign):
    made = make_campaign(71, [Effect('quantisation', {'step': 10.0}, 'force')])
    assert explain(made).accepted == ('quantisation',)


@pytest.mark.slow
def test_what_bends_the_first_contact_itself_is_found_from_a_cold_start(make_campaign):
    slam = Effect('velocity_squared_contact', {'coefficient': 300.0})
    answer = explain(make_campaign(2, [slam]))
    assert answer.accepted == ('velocity_squared_contact',)
    item = answer.ranking[0].parameters['coefficient']
    assert item.value == pytest.approx(300.0, abs=4 * item.std)
    assert answer.fit.extended.reduced_chi_square < 1.1


def test_first_contacts_are_met_by_what_acts_in_them(make_campaign):
    slam = Effect('velocity_squared_contact', {'coefficient': 300.0})
    campaign = make_campaign(2, [slam])
    found = fit_baseline(baseline_model(campaign, prepare(campaign)))
    met = from_first_contact(found, campaign.baseline_names)
    assert met[0][0].name == 'velocity_squared_contact'
    assert met[0][1].reduced < 1.2
