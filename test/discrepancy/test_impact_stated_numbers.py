"""Numbers that are stated wrong: each is tried, and by what it does where it stands."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from impactscope.discrepancy.campaign import Quantity
from impactscope.discrepancy.evidence import Thresholds
from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.candidates.stated_numbers import wrong_numbers
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import fit
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.search.joint_fits import JointFits
from impactscope.physics.pendulum import Orientation, Pendulum

BASELINE = ('linear_sensor', 'zener_damper', 'unilateral_contact', 'gravity_load')


def known_to_a_percent(campaign):
    """The campaign with a layer that may be re-tuned, and sensors on the plate alone."""
    damper = campaign.damper
    layer = {
        'parallel_stiffness': within(damper['parallel_stiffness'], 0.01),
        'branches': [{k: within(q, 0.01) for k, q in b.items()} for b in damper['branches']],
    }
    recordings = tuple(
        dataclasses.replace(
            r, channels={c: r.channels[c] for c in ('force', 'acceleration.plate')}
        )
        for r in campaign.recordings
    )
    return dataclasses.replace(campaign, damper=layer, recordings=recordings)


def within(quantity, share):
    return Quantity(quantity.value, share * quantity.value)


@pytest.fixture(scope='module')
def campaign(make_campaign):
    return known_to_a_percent(
        make_campaign(41, orientation='horizontal', pendulum=Pendulum(contact_distance=0.272))
    )


@pytest.fixture(scope='module')
def baseline(campaign):
    return fit_baseline(baseline_model(campaign, prepare(campaign)))


def test_a_trial_of_a_length_promises_what_a_fit_keeps(campaign, baseline):
    listed = [
        c
        for c in candidates(baseline, campaign.baseline_names)
        if c.parameter.startswith('pendulum.')
    ]
    trials = JointFits(campaign.baseline_names, Thresholds()).order(baseline, listed)
    promised = {t.candidate.parameter: t.gain for t in trials}
    for candidate in listed:
        model = candidate.extend(baseline.model)
        values = baseline.values
        x = np.array([f.to_inner(values.get(f.key, f.start)) for f in model.free])
        fall = baseline.chi_square - fit(model, baseline.layout, x).chi_square
        assert promised[candidate.parameter] == pytest.approx(fall, rel=0.1, abs=1.0)


def test_every_stated_number_is_tried(campaign):
    exact = dataclasses.replace(campaign, release_angle_std_deg=0.0, gain_std={'force': 0.0})
    tried = {c.parameter for c in wrong_numbers(baseline_model(exact, prepare(exact)))}
    assert {'angle@1', 'angle@2', 'mass_distance@1', 'gain.force'} <= tried
    assert {f'pendulum.{n}' for n in ('rod_mass', 'rod_length', 'contact_distance')} <= tried
    assert 'gain.acceleration.plate' in tried


@pytest.mark.slow
def test_a_wrong_length_is_named(campaign):
    answer = explain(campaign)
    assert answer.accepted == ('wrong_parameter',)
    numbers = answer.ranking[0].parameters
    assert numbers['name'].value == 'contact_distance'
    value = numbers['value']
    assert abs(value.value - 0.272) < 3.0 * value.std < 0.005


@pytest.mark.slow
def test_a_wrong_orientation_is_shown_beside_what_was_stated(make_campaign):
    lying = make_campaign(43, orientation='horizontal', baseline=BASELINE)
    answer = explain(dataclasses.replace(lying, orientation=Orientation.VERTICAL))
    assert answer.accepted == ('wrong_parameter',)
    assert answer.findings[0].parameters['name'].value == 'orientation'
    before, after = answer.fit.baseline, answer.fit.extended
    assert before.rmse['force'] > 5.0 * after.rmse['force']
    assert before.held_out_rmse['force'] > 1.5 * after.held_out_rmse['force']
    assert answer.mismatch.regions
