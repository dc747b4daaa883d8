"""What counts as evidence for a finding of the bench search."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import at_point, fit
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.models.bench_model import ActiveEffect
from impactscope.discrepancy.impact.search.outcome import (
    chance_of,
    evidence_for,
    settled_without,
)

SIZE = 5000


def left(residuals, *, readings=None, limit=None):
    """A fit that leaves these residuals, with two priors behind them.

    ``readings``: of its one channel, whose noise is 1; ``limit``: to which the model cuts them.
    """
    blow = SimpleNamespace(
        channels={'force': SimpleNamespace(means=readings, own_std=np.ones(SIZE))}
    )
    cuts = () if limit is None else (ActiveEffect('saturation', 'force'),)
    whole = {(0, 'force'): slice(0, SIZE)}
    return SimpleNamespace(
        residuals=np.append(residuals, [0.0, 0.0]),
        chi_square=float(residuals @ residuals),
        reduced=float(residuals @ residuals) / SIZE,
        layout=SimpleNamespace(size=SIZE, spans=whole, masks={(0, 'force'): slice(None)}),
        model=SimpleNamespace(effects=cuts, data=SimpleNamespace(blows=(blow,))),
        values={f'{e.tag}.limit': limit for e in cuts},
    )


@pytest.fixture
def noise():
    return np.random.default_rng(8).normal(size=SIZE) * 0.9


def test_evidence_that_many_samples_bear_counts_whole(noise):
    shape = np.sin(np.linspace(0, 60, SIZE)) * 0.3
    gain = evidence_for(left(noise), left(noise + shape))
    assert gain == pytest.approx(left(noise + shape).chi_square - left(noise).chi_square)


@pytest.mark.parametrize('lone', [1, 3])
def test_a_few_samples_on_the_verge_of_a_contact_decide_nothing(noise, lone):
    missed = noise.copy()
    missed[700 : 700 + lone] = 9.2
    assert left(missed).chi_square - left(noise).chi_square > 75 * lone
    assert evidence_for(left(noise), left(missed)) <= 9.0 * lone


@pytest.mark.parametrize(('reading', 'told'), [(99.0, 17.0), (-101.0, 17.0), (80.0, 9.0)])
def test_one_sample_at_a_limit_tells_as_much_as_where_it_is(noise, reading, told):
    """The highest reading is one of 5000: chance hits it with 1/5000, twice whose log is 17."""
    missed = noise.copy()
    missed[700] = 9.2
    readings = np.zeros(SIZE)
    readings[700] = reading
    cut = left(noise, readings=readings, limit=100.0)
    assert evidence_for(cut, left(missed)) == pytest.approx(told, abs=0.1)
    # where both have the limit it is no news
    both = left(missed, readings=readings, limit=100.0)
    assert evidence_for(cut, both) == pytest.approx(9.0, abs=0.1)


def test_a_contact_that_is_missed_in_every_blow_is_evidence(noise):
    missed = noise.copy()
    missed[::100] += 9.2
    assert evidence_for(left(noise), left(missed)) > 1000


def test_a_fixture_that_vanishes_at_infinity_is_taken_out_from_where_it_leads(make_campaign):
    campaign = make_campaign(6)
    plain = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = candidates(plain, campaign.baseline_names)
    fixture = next(c for c in listed if c.name == 'base_compliance')
    model = fixture.extend(plain.model)
    heavy = {**plain.values, 'base_compliance.mass': 5e3, 'base_compliance.frequency': 100.0}
    start = np.array([f.to_inner(heavy.get(f.key, f.start)) for f in model.free])
    joint = fit(model, plain.layout, start)
    # a fit without it that stands in another minimum
    astray = plain.x.copy()
    astray[plain.model.index('sensor.moving_mass')] += 2e-3
    astray = at_point(plain.model, plain.layout, astray)
    assert astray.chi_square > joint.chi_square + 100.0
    found = settled_without(joint, [fixture], astray)
    assert found.chi_square == pytest.approx(plain.chi_square, abs=0.5)


def test_a_fixture_that_only_told_how_long_a_tap_was_tells_it_to_the_fit_without(make_campaign):
    campaign = make_campaign(6)
    plain = fit_baseline(baseline_model(campaign, prepare(campaign)))
    wrong = dataclasses.replace(
        plain.model,
        constants={**plain.model.constants, 'tap_duration@0': 0.016},  # others: 4.5 ms
    )
    astray = fit(wrong, plain.layout, plain.x)
    assert astray.chi_square > plain.chi_square + 100.0
    listed = candidates(astray, campaign.baseline_names)
    fixture = next(c for c in listed if c.name == 'base_compliance')
    model = fixture.extend(wrong)
    told = {
        **plain.values,
        'base_compliance.mass': 5e3,
        'base_compliance.frequency': 100.0,
        'tap_duration@0': plain.model.constants['tap_duration@0'],
    }
    joint = fit(
        model, plain.layout, np.array([f.to_inner(told.get(f.key, f.start)) for f in model.free])
    )
    found = settled_without(joint, [fixture], astray)
    assert found.chi_square < plain.chi_square + 5.0
    assert found.model.constants['tap_duration@0'] == pytest.approx(joint.values['tap_duration@0'])


def test_what_rings_for_long_could_have_been_found_at_many_frequencies(make_campaign):
    campaign = make_campaign(6)
    plain = fit_baseline(baseline_model(campaign, prepare(campaign)))
    listed = candidates(plain, campaign.baseline_names)
    arm = next(c for c in listed if c.name == 'impactor_flexibility')
    chances = []
    for ratio in (0.3, 0.02, 0.002):
        values = {**plain.values, f'{arm.name}.frequency': 130.0}
        values[f'{arm.name}.damping_ratio'] = ratio
        joint = SimpleNamespace(values=values, model=plain.model)
        chances.append(chance_of(arm, joint, 30.0, 100))
    assert chances == sorted(chances)
    assert chances[0] < 3e-3 < chances[2]
