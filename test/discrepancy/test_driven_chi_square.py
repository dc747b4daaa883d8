"""Chi-square as the judge: what is believed, and what is not whatever it gains."""

from types import SimpleNamespace

import pytest

from impactscope.discrepancy.driven.model_selection import chi_square as module
from impactscope.discrepancy.driven.model_selection.chi_square import NoiseJudge, degenerate
from impactscope.discrepancy.driven.model_selection.model_comparison import Gain
from impactscope.discrepancy.driven.models.channel_effects import channel_terms
from impactscope.discrepancy.driven.models.terms import key


def test_a_coupling_that_does_not_fade_within_a_recording_is_a_level_of_each():
    terms = channel_terms('acceleration', 'm/s^2', 1000.0, 2.0, 0.1, 50.0, recordings=4)
    (running,) = (t for t in terms if t.name == 'ac_coupling' and t.own)
    (corner,) = running.numbers

    def made(value):
        return SimpleNamespace(terms=(running,), values={key(running, corner): value})

    assert degenerate(made(corner.lower))
    assert not degenerate(made(2.0 * corner.lower))


def test_numbers_that_all_recordings_share_may_be_as_small_as_they_like():
    terms = channel_terms('acceleration', 'm/s^2', 1000.0, 2.0, 0.1, 50.0, recordings=4)
    for term in terms:
        if not term.own:
            values = {key(term, n): n.lower for n in term.numbers}
            assert not degenerate(SimpleNamespace(terms=(term,), values=values))


@pytest.mark.parametrize(
    ('gain', 'numbers', 'believed', 'in_its_place'),
    [
        (8.0, 2, False, False),
        (15.0, 2, False, True),  # chance gives 11.6 in 3 of 1000 cases, the best of sixty 19.8
        (30.0, 2, True, True),
        (10.0, 1, False, True),  # 8.8 and 17
    ],
)
def test_a_law_that_contains_another_one_has_that_one_to_beat(
    monkeypatch, gain, numbers, believed, in_its_place
):
    """No others were looked at in its place; of sixty effects the best gains more by chance."""
    judge = NoiseJudge([])
    plain = SimpleNamespace(terms=(), values={})
    law = SimpleNamespace(terms=(), values={})
    more = Gain(gain, 0.0, False, numbers, 1e4)
    monkeypatch.setattr(judge, 'gain', lambda *_: more)
    monkeypatch.setattr(judge, 'worth', lambda *_: more)
    monkeypatch.setattr(module, 'reduced', lambda *_: 1.0)
    assert judge.better(plain, law) is believed
    assert judge.fuller(plain, law) is in_its_place
