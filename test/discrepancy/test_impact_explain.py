"""The search on small campaigns: it names what was put in, and nothing where nothing was."""

from __future__ import annotations

import dataclasses
import json
from types import SimpleNamespace

import pytest

from impactscope.discrepancy.answer import Answer
from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact import explain as impact_explain
from impactscope.errors import InputError
from impactscope.physics.pendulum import Pendulum
from impactscope.physics.twin.assembly import Effect


def parameter(answer: Answer, name: str) -> tuple[float, float]:
    item = answer.ranking[0].parameters[name]
    assert not isinstance(item.value, str)
    return item.value, item.std


@pytest.mark.parametrize(
    'orientation', ['vertical', pytest.param('horizontal', marks=pytest.mark.slow)]
)
def test_nothing_is_found_where_nothing_is_missing(make_campaign, orientation):
    answer = explain(make_campaign(11, orientation=orientation))
    assert answer.accepted == ()
    assert not answer.mismatch.detected
    assert not answer.unexplained
    assert answer.mismatch.regions == ()
    for name, noise in answer.fit.noise_floor.items():
        assert answer.fit.extended.rmse[name] < 1.1 * noise
        assert answer.fit.extended.held_out_rmse[name] < 1.15 * noise


def test_a_little_dry_friction_is_named_and_measured(make_campaign):
    answer = explain(make_campaign(3, [Effect('coulomb_friction', {'force': 0.3})], blows=2))
    assert answer.accepted == ('coulomb_friction',)
    assert answer.mismatch.subsystems == ('guide',)
    assert answer.mismatch.regions
    value, std = parameter(answer, 'force')
    assert abs(value - 0.3) < 4 * std
    assert std < 0.01
    assert answer.fit.extended.held_out_rmse['force'] < answer.fit.baseline.held_out_rmse['force']


@pytest.mark.slow
def test_a_filter_in_one_channel_is_named_with_its_channel(make_campaign):
    effect = Effect('low_pass_filter', {'cutoff': 300.0, 'order': 2, 'zero_phase': 0}, 'force')
    answer = explain(make_campaign(4, [effect], blows=2))
    assert answer.accepted == ('low_pass_filter',)
    assert answer.ranking[0].channel == 'force'
    assert parameter(answer, 'cutoff')[0] == pytest.approx(300.0, rel=0.03)


@pytest.mark.slow
def test_a_wrong_mass_is_a_parameter_and_no_physics(make_campaign):
    answer = explain(make_campaign(5, pendulum=Pendulum(moving_mass=1.06)))
    assert answer.accepted == ('wrong_parameter',)
    finding = answer.ranking[0]
    assert finding.parameters['name'].value == 'moving_mass'
    assert finding.parameters['place'].value == 'pendulum.moving_mass'
    assert parameter(answer, 'ratio')[0] == pytest.approx(1.06, rel=0.005)


@pytest.mark.slow
def test_a_wrong_label_is_told_with_its_recording(make_campaign):
    answer = explain(make_campaign(6, angle_errors={0: 1.5}))
    assert answer.accepted == ('wrong_parameter',)
    assert answer.ranking[0].recording == 'hit0.mcap'
    assert answer.ranking[0].parameters['name'].value == 'release_angle_deg'


@pytest.mark.slow
def test_the_same_campaign_gives_the_same_answer(make_campaign):
    campaign = make_campaign(7, [Effect('quadratic_damping', {'coefficient': 30.0})], blows=2)
    first, second = (explain(campaign).to_json() for _ in range(2))
    for item in (first, second):
        del item['duration_s']
    assert json.dumps(first) == json.dumps(second)
    assert first['accepted'] == ['quadratic_damping']


@pytest.mark.slow
def test_the_extended_model_as_baseline_leaves_nothing(make_campaign):
    campaign = make_campaign(8, [Effect('coulomb_friction', {'force': 1.0})])
    again = explain(campaign, baseline=[*campaign.baseline_names, 'coulomb_friction'])
    assert again.accepted == ()
    assert not again.unexplained


def test_recordings_without_a_blow_are_refused(make_campaign):
    campaign = make_campaign(9)
    silent = tuple(
        dataclasses.replace(
            r,
            channels={
                n: dataclasses.replace(c, values=c.values[:100]) for n, c in r.channels.items()
            },
        )
        for r in campaign.recordings
    )
    with pytest.raises(InputError, match='no recording to fit'):
        explain(dataclasses.replace(campaign, recordings=silent))


@pytest.mark.slow
def test_progress_rises_to_the_end(make_campaign):
    seen: list[float] = []
    explain(make_campaign(11), progress=lambda share, _: seen.append(share))
    assert seen[0] == 0.0
    assert seen[-1] == 1.0


@pytest.mark.parametrize(('known', 'told'), [(1.05, True), (1.6, False)])
def test_a_prediction_is_said_to_be_amplified_where_the_fit_leaves_it_open(
    monkeypatch, known, told
):
    monkeypatch.setattr(impact_explain, 'prediction_misfit', lambda fit, held: known)
    outcome = SimpleNamespace(
        final=SimpleNamespace(reduced=1.0), held_out_final=SimpleNamespace(reduced=1.69)
    )
    notes = impact_explain._amplified(outcome)
    assert bool(notes) is told
    if told:
        assert 'missed by 1.3 times the noise, and by 1.02 times' in notes[0]
    outcome.held_out_final.reduced = 1.1
    assert impact_explain._amplified(outcome) == ()
