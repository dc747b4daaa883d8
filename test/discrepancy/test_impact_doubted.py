"""What may make noise of what is left, where the evidence for it alone does not count."""

import math
from types import SimpleNamespace

import pytest

from impactscope.discrepancy.impact.search import forward_backward as impact_search
from impactscope.discrepancy.impact.search.forward_backward import Search
from impactscope.discrepancy.impact.search.outcome import Found, Outcome


@pytest.fixture
def doubted(monkeypatch):
    """Names that are accepted: a candidate of that cost and gain, and what its fit leaves."""

    def accepted(cost, gain, *, laws_before=1.0, laws_after=1.0):
        left, met = SimpleNamespace(), SimpleNamespace()

        def adequacy(fit, *, laws=True):
            tests = {'time': 1e-6 if fit is left else 0.5}
            if laws:
                tests['laws'] = laws_before if fit is left else laws_after
            return SimpleNamespace(p_value=min(tests.values()), p_values=tests)

        monkeypatch.setattr(impact_search, 'adequacy', adequacy)
        monkeypatch.setattr(Search, '_another_pair', lambda self, current, outcome: current)
        candidate = SimpleNamespace(name='mains_hum', label='hum', cost=cost, free=(1,))
        outcome = Outcome(left, left, [])
        outcome.last = [Found(candidate, met, gain, 1e-3, -gain)]
        Search(())._doubted(left, outcome)
        return [c.name for c in outcome.accepted]

    return accepted


def test_a_candidate_that_is_worth_its_numbers_is_taken(doubted):
    assert doubted(1, 9.5) == ['mains_hum']
    assert doubted(9, 40.0) == ['mains_hum']


def test_a_hum_with_a_phase_in_each_recording_pays_for_all_of_them(doubted):
    assert doubted(1, 8.5) == []
    assert doubted(9, 15.0) == []


def test_a_law_that_was_seen_has_to_be_gone(doubted):
    assert doubted(1, 40.0, laws_before=1e-5, laws_after=1e-4) == []
    assert doubted(1, 40.0, laws_before=1e-5, laws_after=0.4) == ['mains_hum']


@pytest.mark.parametrize(
    ('fitted', 'rise', 'taken'),
    [
        (-4.0, 0.0, True),
        (-4.0, 95.0, False),  # held-out recordings are missed by far more
        (4.0, -95.0, True),
        (4.0, 0.0, False),
        (-4.0, None, True),  # nothing is held out
        (-4.0, math.inf, True),  # neither meets what is
    ],
)
def test_what_names_leave_open_is_taken_as_held_out_recordings_have_it(
    monkeypatch, fitted, rise, taken
):
    model = SimpleNamespace(data=SimpleNamespace(held_out=(1,)))
    usual, swung = (
        Outcome(None, SimpleNamespace(chi_square=level, model=model), [])
        for level in (1000.0, 1000.0 + fitted)
    )
    reduced = 3.0 if rise == math.inf else 1.0
    predicted = None if rise is None else SimpleNamespace(reduced=reduced)
    monkeypatch.setattr(impact_search, 'held_out_fit', lambda *_: predicted)
    monkeypatch.setattr(impact_search, 'further_misfit', lambda *_: rise)
    assert (impact_search._likelier_way(usual, swung) is swung) is taken
