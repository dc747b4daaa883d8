"""What the baseline can do as well over the final window is no finding."""

from types import SimpleNamespace

import pytest

from impactscope.discrepancy.evidence import Thresholds
from impactscope.discrepancy.impact.search import forward_backward as module
from impactscope.discrepancy.impact.search.outcome import Found


def found_over(layout):
    friction = SimpleNamespace(cost=1, label='friction')
    return Found(friction, SimpleNamespace(layout=layout), 30.0, 1e-9, -20.0)


def outcome_with(doubted, *, free=True):
    final = SimpleNamespace(layout=SimpleNamespace(size=100))
    return SimpleNamespace(
        final=final,
        accepted=[
            SimpleNamespace(
                cost=1,
                free=(SimpleNamespace(key='coulomb_friction.force'),) if free else (),
                label='friction',
                name='coulomb_friction',
                effects=(),
                hum_amplitude=lambda joint: None,
            )
        ],
        found={'friction': found_over(final.layout)},
        rivals={'friction': [found_over(final.layout), found_over(SimpleNamespace(size=90))]},
        last=[],
        doubted=doubted,
        looks=60,
        tests='of the finding',
        p_value=0.0,
        baseline=None,
    )


def bare(monkeypatch, outcome, gain, adequate, misses_more=False):
    """As after a last fit: the finding gains so much on a baseline that is noise or is not."""
    monkeypatch.setattr(module, 'with_findings', lambda *_: 'baseline')
    monkeypatch.setattr(module, '_misses_more', lambda *_: misses_more)
    monkeypatch.setattr(module, 'evidence_for', lambda *_: gain)
    monkeypatch.setattr(module, 'weigh', lambda _, fit, *__: fit)
    monkeypatch.setattr(module, 'adequacy', lambda _: SimpleNamespace(p_value=adequate))
    searched = object.__new__(module.Search)
    searched.thresholds = Thresholds()
    searched._bare(outcome)
    return outcome


def test_a_doubted_finding_goes_with_the_samples_that_needed_it(monkeypatch):
    outcome = bare(monkeypatch, outcome_with({'friction'}), gain=0.5, adequate=0.4)
    assert outcome.accepted == []
    assert (outcome.final, outcome.p_value) == ('baseline', 1.0)


@pytest.mark.parametrize(
    ('gain', 'adequate', 'free'),
    [(0.5, 1e-9, True), (1e4, 0.4, True), (0.5, 0.4, False)],
    ids=['the baseline is not noise', 'it gains', 'it has no number'],
)
def test_a_doubted_finding_stays(monkeypatch, gain, adequate, free):
    outcome = outcome_with({'friction'}, free=free)
    final = outcome.final
    assert len(bare(monkeypatch, outcome, gain, adequate).accepted) == 1
    assert outcome.final is final


def test_a_finding_that_chance_explains_goes(monkeypatch):
    assert bare(monkeypatch, outcome_with(set()), gain=0.5, adequate=0.4).accepted == []
    assert len(bare(monkeypatch, outcome_with(set()), gain=1e4, adequate=0.4).accepted) == 1


def test_held_out_recordings_are_asked_about_what_chance_may_explain(monkeypatch):
    outcome = outcome_with(set())
    final, (rival, _) = outcome.final, outcome.rivals['friction']
    assert bare(monkeypatch, outcome, gain=0.5, adequate=0.4).last == [final, rival.fit]
    outcome = outcome_with(set())
    assert bare(monkeypatch, outcome, gain=1e4, adequate=0.4).last == []


def test_a_finding_stays_without_which_more_is_missed_than_the_last_fit_counts(monkeypatch):
    outcome = bare(monkeypatch, outcome_with(set()), gain=0.5, adequate=0.4, misses_more=True)
    assert len(outcome.accepted) == 1
    assert outcome.baseline == 'baseline'
