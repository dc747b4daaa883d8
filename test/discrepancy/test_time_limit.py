"""An answer in a given time: what is left out is told, what an answer needs is done."""

from __future__ import annotations

import dataclasses
import math

import pytest

from impactscope.discrepancy import explain as explaining
from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.time_limit import TimeLimit, share_of_time, time_left, time_limited
from impactscope.physics.twin.assembly import Effect


class Clock:
    """A clock that a test sets."""

    now = 1000.0

    def __call__(self) -> float:
        return self.now


def test_steps_are_made_until_the_time_is_over_and_then_noted_once():
    clock = Clock()
    limit = TimeLimit(100.0, clock)
    assert limit.time_left('pairs')
    clock.now += 69.0
    assert limit.time_left('pairs')
    assert limit.told == ()
    clock.now += 2.0
    assert not limit.time_left('pairs')
    assert not limit.time_left('pairs')
    assert not limit.time_left('relatives')
    (told,) = limit.told
    assert 'within about 100 s' in told
    assert 'pairs, relatives.' in told


def test_a_search_of_two_leaves_the_other_its_share_of_the_time():
    clock = Clock()
    limit = TimeLimit(100.0, clock)
    clock.now += 10.0
    part = limit.part(0.5)  # of the 60 s that are left
    clock.now += 29.0
    assert part.time_left('pairs')
    clock.now += 2.0
    assert not part.time_left('pairs')
    assert limit.time_left('the other')
    assert 'Left out: pairs.' in limit.told[0]
    clock.now += 40.0
    assert not limit.part(0.5).time_left('relatives')


def test_a_share_holds_within_its_context_alone():
    with share_of_time(0.5):
        assert time_left('pairs')  # no limit has no shares
    with time_limited(1e6) as limit:
        with share_of_time(0.0):
            assert not time_left('pairs')
        assert time_left('pairs')
    assert list(limit.left_out) == ['pairs']


@pytest.mark.parametrize('seconds', [math.inf, 1e9])
def test_without_a_limit_nothing_is_left_out(seconds):
    clock = Clock()
    limit = TimeLimit(seconds, clock)
    clock.now += 1e6
    assert limit.time_left('pairs')
    assert limit.told == ()


def test_the_limit_holds_within_its_context_alone():
    assert time_left('pairs')
    with time_limited(0.0) as outer:
        assert not time_left('pairs')
        with time_limited(math.inf):
            assert time_left('pairs')
        assert not time_left('noise')
    assert time_left('pairs')
    assert list(outer.left_out) == ['pairs', 'noise']


def test_a_search_without_time_still_names_what_is_plain_and_tells_what_it_left_out(
    make_campaign,
):
    made = make_campaign(3, [Effect('coulomb_friction', {'force': 0.3})], blows=2)
    answer = explain(made, within_s=1e-3)
    assert answer.accepted == ('coulomb_friction',)
    assert any('Left out: ' in note for note in answer.notes)
    assert not any('Left out: ' in note for note in explain(made).notes)


def test_a_search_without_time_finds_nothing_where_nothing_is_missing(make_campaign):
    answer = explain(make_campaign(11), within_s=1e-3)
    assert answer.accepted == ()
    assert not answer.unexplained


@dataclasses.dataclass(frozen=True)
class Left:
    """An answer, as far as its end is concerned."""

    unexplained: bool = True
    unexplained_description: str = 'Something.'
    ranking: tuple[str, ...] = ()
    notes: tuple[str, ...] = ('a note',)
    duration_s: float = 0.0


def test_something_unknown_is_not_claimed_as_if_all_had_been_tried(monkeypatch, make_campaign):
    def cut_short(campaign, tell):
        time_left('pairs')
        return Left()

    monkeypatch.setattr(explaining, 'explain_impact', cut_short)
    made = make_campaign(11)
    said = explain(made, within_s=0.0)
    assert said.unexplained_description.startswith('Something. Not all')
    assert said.notes[0] == 'a note'
    assert explain(made).unexplained_description == 'Something.'
