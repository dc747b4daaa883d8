"""Conditions that the examination draws: who strikes, and what is stated of it."""

import numpy as np
import pytest

from impactscope.proof.bench import GRAVITY
from impactscope.proof.campaign_folder import campaign_file
from impactscope.proof.conditions import draw_scenario
from impactscope.proof.detectability import STATED, Freedom
from impactscope.proof.draw import draw
from impactscope.proof.effect import struck, swung
from impactscope.proof.measurement import input_channel
from impactscope.proof.population import WIDE
from impactscope.proof.scenario import STRIKES


def of_kind(kind):
    """The first campaign drawn in which ``kind`` strikes."""
    for seed in range(200):
        scenario = draw_scenario(np.random.default_rng(seed))
        if any(b.kind == kind for b in scenario.blows):
            return scenario
    raise AssertionError(f'no {kind} in 200 campaigns')


def strikes(scenario):
    return [b for b in scenario.blows if b.kind in STRIKES]


@pytest.mark.parametrize('kind', STRIKES)
def test_one_kind_of_impactor_strikes_in_a_campaign(kind):
    scenario = of_kind(kind)
    assert {b.kind for b in strikes(scenario)} == {kind}
    assert struck(scenario)
    assert swung(scenario) == (kind == 'pendulum')
    assert ('pendulum' in campaign_file(scenario)) == (kind == 'pendulum')


@pytest.mark.parametrize('kind', ['robot', 'drop'])
def test_mass_and_speed_are_stated_within_their_uncertainty(kind):
    scenario = of_kind(kind)
    for blow in strikes(scenario):
        assert blow.bench.impactor_mass == pytest.approx(blow.labelled_mass, rel=STATED)
        assert blow.bench.speed == pytest.approx(blow.labelled_speed, rel=STATED)
    knobs = [k for k in Freedom(scenario).knobs if k.name in ('speed', 'impactor_mass')]
    assert len(knobs) == 2 * len(strikes(scenario))
    assert {k.std for k in knobs} == {STATED}


def test_a_falling_body_weighs_what_its_mass_weighs():
    scenario = of_kind('drop')
    assert scenario.orientation == 'vertical'
    for blow in strikes(scenario):
        assert blow.bench.gravity_load == pytest.approx(GRAVITY * blow.bench.impactor_mass)
    entry = next(e for e in campaign_file(scenario)['recordings'] if e['kind'] == 'drop')
    blow = strikes(scenario)[0]
    assert 2 * GRAVITY * entry['drop_height'] == pytest.approx(blow.labelled_speed**2, rel=1e-2)


def test_a_robot_is_not_weighed_on_the_plate():
    scenario = of_kind('robot')
    assert all(b.bench.gravity_load == 0 for b in strikes(scenario))
    assert 'gravity_load' not in scenario.baseline
    entry = next(e for e in campaign_file(scenario)['recordings'] if e['kind'] == 'robot')
    assert {'effective_mass', 'speed'} <= set(entry)


@pytest.mark.parametrize('seed', range(4))
def test_labels_are_wrong_where_a_pendulum_strikes(seed):
    concealed = draw(np.random.default_rng(seed), category='label', classes=False)
    assert swung(concealed.stated)


def test_some_plates_are_shaken_and_the_force_is_recorded():
    drawn = [draw_scenario(np.random.default_rng(seed), 'driven') for seed in range(30)]
    shaken = [s for s in drawn if all(p.cycles for b in s.blows for p in b.pulses)]
    assert 3 <= len(shaken) <= 20
    for blow in shaken[0].blows:
        force = input_channel(blow, 10e3)
        acting = np.flatnonzero(force)
        assert acting[0] >= blow.start * 10e3
        assert acting.size > 0.8 * (blow.duration - blow.start) * 10e3


@pytest.mark.parametrize('kind', ['impact', 'driven', 'prescribed', 'chain'])
def test_a_wide_population_has_other_benches_that_can_be_told_apart_as_well(kind):
    drawn = [draw_scenario(np.random.default_rng(seed), kind, WIDE) for seed in range(12)]
    own = [draw_scenario(np.random.default_rng(seed), kind) for seed in range(12)]
    for many, few in ((rates(drawn), rates(own)), (noises(drawn), noises(own))):
        assert max(many) / min(many) > 1.5 * max(few) / min(few)
    freedom = Freedom(drawn[0])
    assert freedom.detectability(drawn[0]) == pytest.approx(0.0, abs=1e-6)


def rates(scenarios):
    return [max(s.rates.values()) for s in scenarios]


def noises(scenarios):
    """Of the response over its own size."""
    return [s.noise[n] for s in scenarios for n in s.channels[:1]]
