"""What an answer says beside a finding."""

from types import SimpleNamespace

import pytest

from impactscope.discrepancy.answer import Finding
from impactscope.discrepancy.impact.findings.ranking import _another_form, _or_another


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
