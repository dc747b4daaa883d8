"""Candidates that are fitted jointly: those of a shorter window, and those that ring."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.evidence import Thresholds
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import at_point, fit, settled
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.search import joint_fits
from impactscope.discrepancy.impact.search.joint_fits import JointFits, _by_slope
from impactscope.discrepancy.impact.search.outcome import Found, weigh
from impactscope.discrepancy.impact.search.screening import Trial
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.bench import BareContact


@pytest.fixture(scope='module')
def windows(make_campaign):
    """A baseline over whole recordings, and friction as the first 0.1 s tell it."""
    campaign = make_campaign(71, [Effect('coulomb_friction', {'force': 0.05})])
    whole = fit_baseline(baseline_model(campaign, prepare(campaign)))
    friction = next(c for c in candidates(whole, ()) if c.label == 'coulomb_friction')
    layout = whole.model.layout(whole.layout.blows, 0.1)
    short = fit(whole.model, layout, whole.x)
    joint = fit(friction.extend(whole.model), layout, np.append(short.x, 0.03))
    return whole, weigh(friction, joint, short, 40)


def test_it_is_weighed_by_what_the_longer_window_tells(windows):
    whole, before = windows
    doubtful = dataclasses.replace(before, p_value=0.01)
    (found,) = JointFits._with_suspected(whole, [], [doubtful], 40)
    assert found.candidate is before.candidate
    assert found.fit.layout.size == whole.layout.size
    assert found.gain > before.gain
    force = found.fit.values['coulomb_friction.force']
    assert abs(force - 0.05) < 4.0 * found.fit.std('coulomb_friction.force')


def test_neither_what_chance_gives_nor_what_was_fitted_is_fitted_again(windows):
    whole, before = windows
    by_chance = dataclasses.replace(before, p_value=0.5)
    assert JointFits._with_suspected(whole, [], [by_chance], 40) == []
    doubtful = dataclasses.replace(before, p_value=0.01)
    assert JointFits._with_suspected(whole, [before], [doubtful], 40) == [before]


def test_what_the_baseline_had_not_reached_is_gained_by_nobody(windows):
    whole, _ = windows
    short = fit(whole.model, whole.model.layout(whole.layout.blows, 0.02), whole.x)
    bottom = settled(short)
    aside = at_point(bottom.model, bottom.layout, bottom.x + 2.0 * bottom.covariance_root()[:, -1])
    assert aside.chi_square > bottom.chi_square + 3.0
    found, _, without = JointFits((), Thresholds(), window=0.02).step(aside, most=1)
    assert without.chi_square == pytest.approx(bottom.chi_square, abs=0.1)
    assert all(f.gain < bottom.chi_square - f.fit.chi_square + 0.2 for f in found)


@pytest.fixture
def judged(monkeypatch):
    """Names of what is fitted jointly of trials: name, numbers, gain, and the stated number."""

    def fitted_to(_model, _layout, gain, **_):
        return SimpleNamespace(chi_square=1000.0 - gain, reduced=1.0)

    monkeypatch.setattr(joint_fits, 'fit', fitted_to)
    monkeypatch.setattr(
        joint_fits,
        'weigh',
        lambda c, joint, *_: Found(c, joint, 1000.0 - joint.chi_square, 1.0, -joint.chi_square),
    )
    monkeypatch.setattr(JointFits, '_rung_elsewhere', staticmethod(lambda _c, found, *_: found))

    def of(rows, most=0):
        current = SimpleNamespace(reduced=1.0, chi_square=1000.0, layout=None)
        trials = [
            SimpleNamespace(
                candidate=SimpleNamespace(
                    name=name, label=name, channel='', cost=cost, parameter=parameter
                ),
                gain=gain,
                model=None,
                x=gain,
                plain=None,
                by_slope=None,
            )
            for name, cost, gain, parameter in rows
        ]
        found = JointFits((), Thresholds()).judge(current, trials, 88, most)
        return [f.candidate.parameter or f.candidate.name for f in found]

    return of


@pytest.mark.parametrize(('numbers', 'fitted'), [(15, 2), (1, 1)])
def test_what_many_numbers_gain_by_chance_holds_no_other_back(judged, numbers, fitted):
    """A hum that is fitted to noise gains more than a weak effect, and is not believed."""
    assert len(judged([('line', numbers, 42.0, ''), ('number', 1, 21.0, '')])) == fitted


@pytest.mark.parametrize(
    ('apart', 'most', 'fitted'),
    [(0.5, 0, 9), (4.0, 0, 6), (0.5, 3, 3)],  # all, as many as usual, and where the way is sought
)
def test_what_promises_as_much_as_the_best_is_fitted(judged, apart, most, fitted):
    rows = [(f'effect {n}', 1, 250.0 - n * apart, '') for n in range(9)]
    assert len(judged(rows, most)) == fitted


def test_lengths_of_a_pendulum_do_not_keep_a_number_of_the_layer_back(judged):
    keys = [f'pendulum.{k}' for k in ('rod_mass', 'rod_length', 'contact_distance', 'moving_mass')]
    rows = [
        ('wrong_parameter', 1, 250.0 - n, key)
        for n, key in enumerate((*keys, 'damper.parallel_stiffness'))
    ]
    assert set(judged(rows)) == {*keys[:3], 'damper.parallel_stiffness'}


@pytest.fixture(scope='module')
def soft_fixture(make_campaign):
    """A baseline of the first 0.25 s, and a soft fixture fitted at a wrong frequency."""
    values = {'frequency': 146.0, 'mass': 6.0, 'damping_ratio': 0.02}
    campaign = make_campaign(43, [Effect('base_compliance', values)])
    recordings = tuple(
        dataclasses.replace(
            r, channels={n: c for n, c in r.channels.items() if n != 'acceleration.base'}
        )
        for r in campaign.recordings
    )
    campaign = dataclasses.replace(campaign, recordings=recordings)
    whole = fit_baseline(baseline_model(campaign, prepare(campaign)))
    current = fit(whole.model, whole.model.layout(whole.layout.blows, 0.25), whole.x)
    fixture = next(c for c in candidates(current, ()) if c.label == 'base_compliance')
    model = fixture.extend(current.model)
    far = {**current.values, 'base_compliance.frequency': 360.0, 'base_compliance.mass': 20.0}
    x = np.array([f.to_inner(far.get(f.key, f.start)) for f in model.free])
    return current, weigh(fixture, fit(model, current.layout, x), current, 40)


def test_a_soft_fixture_is_sought_at_frequencies_all_over(soft_fixture):
    current, before = soft_fixture
    assert abs(before.fit.values['base_compliance.frequency'] - 146.0) > 20.0
    assert JointFits._rung_elsewhere(current, [before], {}, 40) == [before]  # is too little
    (found,) = JointFits._rung_elsewhere(current, [before], {'base_compliance': 80.0}, 40)
    assert found.gain > before.gain + 50.0
    assert found.fit.values['base_compliance.frequency'] == pytest.approx(146.0, abs=3.0)


def test_what_explains_far_less_than_another_is_not(soft_fixture):
    current, before = soft_fixture
    other = dataclasses.replace(
        before, candidate=dataclasses.replace(before.candidate, channel='force'), gain=1e6
    )
    assert JointFits._rung_elsewhere(current, [other, before], {'base_compliance': 80.0}, 40) == [
        other,
        before,
    ]


@pytest.mark.parametrize('seed', [3, 5])
def test_what_contacts_amplify_is_sought_from_little(make_campaign, seed):
    true = {'frequency': 82.0, 'mass_share': 0.026, 'damping_ratio': 0.02}
    baseline = ('linear_sensor', 'hertz_contact', 'unilateral_contact', 'restoring_force')
    campaign = make_campaign(
        seed,
        [Effect('impactor_flexibility', true)],
        orientation='horizontal',
        bare=BareContact(),
        baseline=baseline,
        rate=5000.0,
    )
    whole = fit_baseline(baseline_model(campaign, prepare(campaign)))
    current = fit(whole.model, whole.model.layout(whole.layout.blows, 0.023), whole.x)
    listed = candidates(current, ())
    flexible = next(c for c in listed if c.label == 'impactor_flexibility')
    start = {**current.values, 'impactor_flexibility.frequency': 900.0}
    model = flexible.extend(current.model)
    before = weigh(flexible, fit(model, current.layout, model.vector(start)), current, 40)
    promised = {'impactor_flexibility': 1e4}
    (found,) = JointFits._rung_elsewhere(current, [before], promised, 40)
    told = found.fit.values['impactor_flexibility.frequency']
    assert told == pytest.approx(
        true['frequency'], abs=4.0 * found.fit.std(found.candidate.free[0].key)
    )
    assert found.fit.reduced < 1.05


def test_a_narrow_line_between_the_frequencies_that_are_tried_first_is_found(make_campaign):
    arm = {'frequency': 700.0, 'mass_share': 0.0009, 'damping_ratio': 0.004}
    campaign = make_campaign(5, [Effect('impactor_flexibility', arm)])
    current = fit_baseline(baseline_model(campaign, prepare(campaign)))
    thresholds = Thresholds()
    found, _, _ = JointFits(campaign.baseline_names, thresholds).step(current)
    assert found[0].candidate.label == 'impactor_flexibility'
    assert found[0].counts(thresholds.false_finding)
    told = found[0].fit.values['impactor_flexibility.frequency']
    assert told == pytest.approx(700.0, abs=5.0)


def test_a_fit_that_keeps_little_of_what_slopes_promise_sets_out_from_there(windows):
    whole, before = windows
    model, key = before.candidate.extend(whole.model), 'coulomb_friction.force'
    faint, promised = (model.vector({**whole.values, key: force}) for force in (1e-5, 0.04))
    stuck = at_point(model, whole.layout, faint)
    trial = Trial(before.candidate, before.gain, model, faint, by_slope=promised)
    found = _by_slope(trial, whole, stuck)
    assert abs(found.values[key] - 0.05) < 4.0 * found.std(key)
    assert _by_slope(dataclasses.replace(trial, by_slope=None), whole, stuck) is stuck
    assert _by_slope(trial, whole, found) is found  # nothing better is there


@pytest.mark.parametrize(('reached', 'again'), [(500.0, True), (990.0, False)])
def test_candidates_are_tried_again_beside_a_far_better_fit_that_one_led_to(
    monkeypatch, reached, again
):
    current = SimpleNamespace(chi_square=1000.0, reduced=1.0)
    lower = SimpleNamespace(chi_square=reached, reduced=1.0)
    there, here = (
        Found(SimpleNamespace(label=label), lower, gain, 1.0, -gain)
        for label, gain in (('friction', -480.0), ('friction', 21.0))
    )
    beside = []

    def tried(_self, fit, _sound, _most, suspected):
        beside.append((fit, list(suspected)))
        return ([there] if fit is current else [here]), 40, lower

    monkeypatch.setattr(JointFits, '_tried', tried)
    found, looks, without = JointFits((), Thresholds()).step(current)
    assert without is lower
    assert looks == 40
    assert found == ([here] if again else [there])
    assert beside == [(current, []), (lower, [there])][: 1 + again]
