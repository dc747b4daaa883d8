"""Campaign descriptions: what is read, what is refused, what is only noted."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest

from impactscope.discrepancy.campaign import CampaignKind, ChannelSamples, Role
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.errors import ConfigurationError
from impactscope.physics.pendulum import Orientation

IMPACT = {
    'version': 1,
    'bench': {'kind': 'impact', 'orientation': 'horizontal'},
    'sensor': {'stiffness': {'value': 69000, 'std': 500, 'unit': 'N/m'}, 'moving_mass': None},
    'damper': {'parallel_stiffness': 38320, 'branches': [{'stiffness': 18840, 'damping': 77900}]},
    'pendulum': {'rod_mass': 0.698, 'release_angle_std_deg': 0.2},
    'gain_std': {'force': 0.01},
    'baseline': ['linear_sensor', {'name': 'coulomb_friction', 'values': {'force': 1.5}}],
    'recordings': [
        {'file': 'tap.mcap', 'kind': 'tap'},
        {'file': 'hit.mcap', 'kind': 'pendulum', 'mass_distance': 0.2, 'release_angle_deg': 16},
        {'file': 'last.mcap', 'kind': 'pendulum', 'damper': False, 'role': 'hold_out'},
    ],
}
OTHERS = {
    CampaignKind.DRIVEN: {'input': 'force.hammer', 'outputs': ['acceleration.plate']},
    CampaignKind.PRESCRIBED_MOTION: {'motion': 'displacement.piston', 'output': 'force.damper'},
    CampaignKind.CHAIN: {'input': 'acceleration.raw', 'output': 'acceleration.processed'},
}


def changed(path, value):
    data = copy.deepcopy(IMPACT)
    place = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return data


def test_gravity_is_that_of_the_site_where_it_is_stated():
    assert parse_campaign(IMPACT, 'bench').gravity == 9.80665
    there = {**IMPACT, 'bench': {**IMPACT['bench'], 'gravity': 9.832}}
    assert parse_campaign(there, 'bench').gravity == 9.832


def test_a_whole_description_is_read():
    campaign = parse_campaign(IMPACT, 'bench')
    assert campaign.kind is CampaignKind.IMPACT
    assert campaign.orientation is Orientation.HORIZONTAL
    assert campaign.sensor['stiffness'].value == 69000
    assert campaign.sensor['stiffness'].std == 500
    assert not campaign.sensor['moving_mass'].known
    assert campaign.damper['branches'][0]['damping'].value == 77900
    assert campaign.release_angle_std_deg == 0.2
    assert campaign.baseline_names == ('linear_sensor', 'coulomb_friction')
    assert campaign.baseline[1].values == {'force': 1.5}
    assert [r.role for r in campaign.recordings] == [Role.FIT, Role.FIT, Role.HOLD_OUT]
    assert [r.damper for r in campaign.recordings] == [True, True, False]
    assert math.isnan(campaign.recordings[0].release_angle_deg)
    assert campaign.gain_std_of('force') == 0.01
    assert campaign.gain_std_of('acceleration.plate') == 0.005


@pytest.mark.parametrize('kind', list(OTHERS))
def test_other_kinds_keep_what_only_they_have(kind):
    data = {
        'version': 1,
        'bench': {'kind': kind.value, **OTHERS[kind]},
        'model': {'modes': 2},
        'baseline': [],
        'recordings': [{'file': 'a.mcap'}],
    }
    campaign = parse_campaign(data)
    assert campaign.kind is kind
    assert campaign.model == {'modes': 2}
    for key, value in OTHERS[kind].items():
        assert campaign.bench[key] == value
        without = {k: v for k, v in data['bench'].items() if k != key}
        with pytest.raises(ConfigurationError, match=key):
            parse_campaign({**data, 'bench': without})


@pytest.mark.parametrize(
    ('path', 'value', 'words'),
    [
        (['version'], 2, 'version is 2'),
        (['bench', 'kind'], 'shaken', "'shaken'"),
        (['bench', 'orientation'], 'diagonal', "'diagonal'"),
        (['bench', 'gravity'], 981.0, 'gravity is 981; it must be in m/s'),
        (['bench', 'gravity'], 'g', "gravity is 'g'"),
        (['sensor', 'stiffness'], 'stiff', "'stiff'"),
        (['sensor', 'stiffness'], {'value': 1.0, 'std': -1.0}, 'negative'),
        (['sensor', 'stiffness'], {'value': 69.0, 'unit': 'kg'}, "'kg'.*N/mm"),
        (['sensor', 'stiffness'], {'value': 69.0, 'unit': 'lbf/in'}, "'lbf/in'"),
        (['recordings', 1, 'mass_distance'], {'value': 0.2, 'unit': 'N'}, "'N'"),
        (['recordings'], [], 'at least one'),
        (['recordings', 0, 'kind'], 'kick', "'kick'"),
        (['recordings', 1, 'role'], 'maybe', "'maybe'"),
        (['recordings', 1, 'release_angle_deg'], math.nan, 'finite'),
        (['recordings', 1, 'file'], 'tap.mcap', 'more than once'),
        (['recordings', 1, 'colour'], 'red', "'colour'"),
        (['colour'], 'red', "'colour'"),
        (['baseline'], 'linear_sensor', 'list of names'),
        (['damper', 'branches'], 3, 'list'),
    ],
)
def test_what_is_wrong_is_named(path, value, words):
    with pytest.raises(ConfigurationError, match=words):
        parse_campaign(changed(path, value), 'bench')


def test_nothing_left_to_fit_is_refused():
    data = copy.deepcopy(IMPACT)
    for recording in data['recordings']:
        recording['role'] = 'hold_out'
    with pytest.raises(ConfigurationError, match='none is left'):
        parse_campaign(data)


def test_what_is_absent_is_noted_where_something_can_still_be_told():
    data = copy.deepcopy(IMPACT)
    del data['pendulum'], data['bench']['orientation'], data['damper']
    data['recordings'] = data['recordings'][1:2]
    notes = ' '.join(parse_campaign(data).notes)
    assert 'on a damper' not in notes  # nobody said so
    data['recordings'][0]['damper'] = True
    notes = ' '.join(parse_campaign(data).notes)
    for words in ('orientation', 'geometry', 'on a damper', 'One recording', 'held out'):
        assert words in notes


def test_layer_of_which_nothing_is_stated_is_estimated():
    data = changed(('baseline',), ['linear_sensor', 'zener_damper'])
    del data['damper']
    campaign = parse_campaign(data, 'bench')
    assert not campaign.damper['parallel_stiffness'].known
    assert not campaign.damper['branches'][0]['damping'].known
    assert any('No damper layer is described' in note for note in campaign.notes)
    bare = copy.deepcopy(IMPACT)
    bare['damper'] = None
    assert parse_campaign(bare, 'bench').damper is None


def test_samples_are_put_in_by_file():
    def load(file):
        values = np.zeros(10)
        return {'force': ChannelSamples('force', 'N', 100.0, 0.5, values)}

    seen = []
    campaign = parse_campaign(IMPACT).with_samples(load, seen.append)
    assert seen[-1] == 1.0
    channel = campaign.recordings[0].channels['force']
    assert channel.time[-1] == pytest.approx(0.59)
    assert campaign.recordings[0].duration == pytest.approx(0.6)


@pytest.mark.parametrize(
    ('path', 'unit', 'factor'),
    [
        (['sensor', 'stiffness'], 'N/mm', 1e3),
        (['damper', 'parallel_stiffness'], 'kN/m', 1e3),
        (['pendulum', 'rod_mass'], 'g', 1e-3),
    ],
)
def test_numbers_may_state_another_unit_of_their_kind(path, unit, factor):
    campaign = parse_campaign(changed(path, {'value': 70.0, 'std': 2.0, 'unit': unit}))
    found = getattr(campaign, path[0])[path[1]]
    assert found.value == pytest.approx(70.0 * factor)
    assert found.std == pytest.approx(2.0 * factor)


def test_what_is_stated_of_a_robot_has_its_uncertainty():
    data = copy.deepcopy(IMPACT)
    data['recordings'] += [
        {'file': 'a.mcap', 'kind': 'robot', 'effective_mass': 4.0, 'speed': 0.25},
        {'file': 'b.mcap', 'kind': 'robot', 'speed': {'value': 250, 'std': 1, 'unit': 'mm/s'}},
        {'file': 'c.mcap', 'kind': 'drop', 'effective_mass': 2.0, 'drop_height': 0.1},
    ]
    *_, presumed, stated, fallen = parse_campaign(data).recordings
    assert presumed.uncertainty('speed') == pytest.approx(0.005)
    assert presumed.uncertainty('effective_mass') == pytest.approx(0.08)
    assert (stated.speed, stated.uncertainty('speed')) == pytest.approx((0.25, 0.001))
    assert fallen.uncertainty('drop_height') == pytest.approx(0.004)


def test_descriptions_are_passed_over():
    data = copy.deepcopy(IMPACT)
    data['title'] = data['recordings'][0]['description'] = 'words <b>of somebody</b>'
    data['sensor']['name'] = data['pendulum']['notes'] = 'No. 3'
    assert parse_campaign(data).sensor.keys() == parse_campaign(IMPACT).sensor.keys()
