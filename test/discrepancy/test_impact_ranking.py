"""What an answer says beside a finding."""

import dataclasses
import math
from types import SimpleNamespace

import pytest

from impactscope.discrepancy.answer import Finding, ParameterEstimate, numbers_left_open
from impactscope.discrepancy.impact.findings.ranking import (
    _another_form,
    _bends_no_further,
    _or_another,
)


def rival(name, parameter, value, recording=''):
    free = (SimpleNamespace(key=parameter),)
    candidate = SimpleNamespace(name=name, parameter=parameter, free=free, recording=recording)
    return SimpleNamespace(candidate=candidate, fit=SimpleNamespace(values={parameter: value}))


@pytest.fixture
def finding():
    return Finding('wrong_parameter', 0.6, 'parameter', sentence='The stiffness is 5.')


def test_another_number_that_may_be_wrong_as_well_is_told(finding):
    rivals = [
        rival('wrong_parameter', 'damper.branches.0.stiffness', 11769.4),
        rival('wrong_parameter', 'mass_distance@3', 0.1512, 'hit3.mcap'),
        rival('hysteresis', '', 0.1),
    ]
    told = _or_another(finding, rivals).sentence
    assert told.startswith(finding.sentence)
    assert 'damper.branches.0.stiffness, 11769;' in told
    assert 'mass_distance of hit3.mcap, 0.1512:' in told


def test_nothing_is_added_where_no_other_number_is_wrong(finding):
    assert _or_another(finding, [rival('hysteresis', '', 0.1)]) is finding


@pytest.mark.parametrize(
    ('name', 'key', 'over', 'is_one'),
    [
        ('restoring_force', 'restoring_force.stiffness', 'whole', True),
        ('external_push', 'restoring_force.stiffness', 'whole', False),
        ('restoring_force', 'restoring_force.other', 'whole', False),
        ('restoring_force', 'restoring_force.stiffness', 'a part', False),
    ],
)
def test_a_law_meant_otherwise_leaves_another_number(name, key, over, is_one):
    def found(name, key, layout):
        candidate = SimpleNamespace(name=name, effects=(1,), free=(SimpleNamespace(key=key),))
        return SimpleNamespace(candidate=candidate, fit=SimpleNamespace(layout=layout))

    mine = found('restoring_force', 'restoring_force.stiffness', 'whole')
    assert _another_form(found(name, key, over), mine, mine.fit) is is_one


@pytest.mark.parametrize(
    ('name', 'ahead', 'shape', 'is_open'),
    [
        ('stribeck_friction', 2.0, 'speed', True),
        ('stribeck_friction', 20.0, 'speed', False),  # its shape is seen
        ('asymmetric_friction', 2.0, '', False),  # of which every number is an amount
        ('hysteresis', 2.0, 'exponent', False),  # another law
    ],
)
def test_a_shape_of_which_nothing_is_seen_has_any_numbers(name, ahead, shape, is_open):
    def found(name, gain, cost, shape=''):
        keys = ['force', *([shape] if shape else [])]
        candidate = SimpleNamespace(
            name=name,
            channel='',
            cost=cost,
            amplitudes={'force': 0.0},
            free=tuple(SimpleNamespace(key=key) for key in keys),
        )
        return SimpleNamespace(candidate=candidate, gain=gain)

    mine = found('coulomb_friction', 100.0, 1)
    assert _bends_no_further(found(name, 100.0 + ahead, 3, shape), mine) is is_open


def test_numbers_that_are_left_open_have_no_deviation(finding):
    parameters = {'speed': ParameterEstimate(0.01, 0.001, 'm/s')}
    told = numbers_left_open(dataclasses.replace(finding, parameters=parameters))
    assert told.parameters['speed'].value == 0.01
    assert math.isnan(told.parameters['speed'].std)
