"""Chi-square as the judge: what is believed, and what is not whatever it gains."""

from types import SimpleNamespace

from impactscope.discrepancy.driven.model_selection.chi_square import degenerate
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
