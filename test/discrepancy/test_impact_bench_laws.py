"""Laws without a mechanism: forces along a motion, and what the bench makes of them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from impactscope.discrepancy.impact.adequacy import bench_laws
from impactscope.discrepancy.impact.adequacy.bench_laws import law_forces, law_responses
from impactscope.discrepancy.impact.adequacy.residual_tests import adequacy, law_instead
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import at_point, fit
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.models.bench_model import ActiveEffect
from impactscope.physics.twin.assembly import Effect


@pytest.fixture(scope='module')
def sound(make_campaign):
    campaign = make_campaign(51)
    return fit_baseline(baseline_model(campaign, prepare(campaign)))


def test_forces_vanish_at_rest_and_follow_the_motion():
    time = np.arange(4000) * 5e-4
    rest = np.zeros(4000)
    x = 1e-3 * np.sin(2 * np.pi * 32 * time)
    v = 2 * np.pi * 32 * 1e-3 * np.cos(2 * np.pi * 32 * time)
    for label, _, _, force in law_forces(rest, rest, time):
        assert np.all(force == 0.0), label
    forces = {label: force for label, number, _, force in law_forces(x, v, time) if not number}
    assert len(forces) > 20
    for label, force in forces.items():
        assert np.isfinite(force).all(), label
        if label.startswith(('damping with speed', 'fractional damping')):
            assert np.mean(force * v) > 0.0, label  # they take energy
    both = [
        forces[f'damping with speed to the power 2, {way} only'] for way in ('inwards', 'outwards')
    ]
    assert not np.any(both[0] * both[1])
    np.testing.assert_allclose(
        both[0] - both[1], forces['a push with speed to the power 2, either way']
    )
    half = forces['fractional damping of order 0.5'][2000:3800]
    omega = 2 * np.pi * 32
    wanted = 0.01 * omega**0.5 * np.sin(omega * time[2000:3800] + np.pi / 4)
    assert np.corrcoef(half, wanted)[0, 1] > 0.99


def test_no_law_stands_in_the_place_of_another():
    time = np.arange(400) * 5e-4
    x = 1e-3 * np.sin(2 * np.pi * 32 * time)
    contact = np.where(time < 0.02, 1.0, 0.0)
    listed = [(label, n) for label, n, _, _ in law_forces(x, np.gradient(x, 5e-4), time, contact)]
    assert len(listed) == len(set(listed))


def test_a_response_is_that_of_the_mechanism_with_the_same_law(sound, monkeypatch):
    """The cubic spring is both: an effect of the twin, and a force along the motion."""
    monkeypatch.setattr(
        bench_laws, 'law_forces', lambda x, v, *_: iter([('cubic', '', True, x**3)])
    )
    layout = sound.model.layout(sound.layout.blows, 0.1)
    here = at_point(sound.model, layout, sound.x)
    small = 1e6
    model = sound.model.extended(
        effects=[ActiveEffect('hardening_spring')], constants={'hardening_spring.cubic': small}
    )
    change = (model.residuals(sound.x, layout) - here.residuals)[: layout.size]
    (law,) = law_responses(here)
    np.testing.assert_allclose(
        small * law.columns[:, 0], change, atol=0.03 * float(np.max(np.abs(change)))
    )


def test_a_contact_that_sticks_pulls_on_as_steeply_as_it_fell():
    step = 5e-4
    time = np.arange(400) * step
    steepness, unit = 200.0, 50.0  # N/s, N
    contact = np.maximum(0.0, 4.0 - steepness * np.abs(time - 0.04)) / unit
    rest = np.zeros(400)
    known = {n: f for n, _, _, f in law_forces(rest, rest, time, contact, unit)}
    for most in (1.0, 3.0, 10.0):
        pull = known[f'a contact that pulls by {most:g} N before it lets go']
        assert -most <= np.min(pull) < -0.8 * most
        end = 0.04 + 4.0 / steepness
        assert step * -np.sum(pull) == pytest.approx(0.5 * most**2 / steepness)
        beside = (time < end - step) | (time > end + most / steepness + step)
        assert not np.any(pull[beside])


def test_noise_is_like_no_law(sound):
    tests = adequacy(sound)
    assert tests.p_values['laws'] > 0.01
    assert 'laws' not in adequacy(sound, laws=False).p_values


def test_a_finding_is_not_replaced_by_a_law_that_resembles_it(make_campaign):
    campaign = make_campaign(52, [Effect('hardening_spring', {'cubic': 3e8})])
    before = fit_baseline(baseline_model(campaign, prepare(campaign)))
    candidate = next(
        c for c in candidates(before, campaign.baseline_names) if c.name == 'hardening_spring'
    )
    model = candidate.extend(before.model)
    known = {**before.values, 'hardening_spring.cubic': 2e8}
    after = fit(model, before.layout, np.array([f.to_inner(known[f.key]) for f in model.free]))
    assert before.chi_square - after.chi_square > 50.0
    assert law_instead(before, after, 1)[0] > 1.0
    # but what explains little is
    odds, law = law_instead(before, dataclasses.replace(before), 1)
    assert odds < 1e-6
    # where findings explain what lies beyond the laws' window these say nothing
    lost_later = dataclasses.replace(before, chi_square=before.chi_square + 1e5)
    assert law_instead(lost_later, before, 1)[0] == np.inf
    # several findings have been chosen several times
    gained = before.chi_square - after.chi_square
    assert law_instead(before, after, gained)[0] < law_instead(before, after, 1)[0]
    assert law.startswith(('a spring', 'an odd force of the displacement'))
    # a finding that has to be as no such thing is has nothing ahead for being listed
    listed, strained = (law_instead(before, after, 1, strained=s)[0] for s in (False, True))
    assert 0.0 < strained <= 1.0 < listed
