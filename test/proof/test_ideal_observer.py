"""Chances of an observer who knows everything but what is hidden, against drawn noise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.proof.ideal_observer import chance_of_name, chance_of_part, chance_of_set

DRAWS = 20_000


def _told(courses, truth, false=0.01):
    """Which of known courses is the likeliest in each of many noises; -1: none stands out."""
    rng = np.random.default_rng(1)
    looks = courses / np.linalg.norm(courses, axis=1)[:, None]
    clean = np.max(rng.standard_normal((DRAWS, courses.shape[1])) @ looks.T, axis=1)
    least = np.quantile(clean, 1 - false)
    seen = truth + rng.standard_normal((DRAWS, truth.size))
    likely = seen @ courses.T - 0.5 * np.sum(courses**2, axis=1)
    found = np.max(seen @ looks.T, axis=1) > least
    return np.where(found, np.argmax(likely, axis=1), -1)


@pytest.mark.parametrize(('size', 'rest'), [(4.0, 4.0), (12.0, 2.0), (12.0, 3.5), (30.0, 20.0)])
def test_nobody_does_better_and_who_knows_all_comes_near(size, rest):
    """Two courses of one size that differ by ``rest``, and 20 at right angles to them."""
    courses = size * np.eye(22)
    angle = 2 * np.arcsin(rest / 2 / size)
    courses[1, :2] = size * np.cos(angle), size * np.sin(angle)
    others = np.linalg.norm(courses[1:] - courses[0], axis=1)
    bound = chance_of_part(size, {str(i): float(d) for i, d in enumerate(others)})
    right = np.mean(_told(courses, courses[0]) == 0)
    assert right < bound + 0.01
    assert right > bound - 0.06


@given(st.floats(0.1, 50), st.floats(0.1, 50), st.floats(0.1, 5))
def test_what_is_stronger_or_further_off_is_told_more_often(size, rest, more):
    least = chance_of_part(size, {'clearance': rest})
    assert 0.0 <= least <= chance_of_part(size + more, {'clearance': rest}) <= 1.0
    assert least <= chance_of_part(size, {'clearance': rest + more})


def _part(name, size, **differences):
    return {'name': name, 'detectability': size, 'differences': differences}


def test_what_the_data_cannot_tell_may_be_named_and_other_numbers_are_no_other_name():
    part = _part('wrong_parameter', 20.0, clearance=1.0, wrong_parameter=0.5, end_stop=15.0)
    assert chance_of_set([part], {'clearance'}) > 0.999
    assert chance_of_set([part], set()) == pytest.approx(0.6915, abs=1e-4)  # Phi(1/2)


def test_of_a_pair_one_is_enough_for_the_name_and_both_are_the_set():
    pair = [_part('end_stop', 3.0, offset=9.0), _part('clearance', 30.0, offset=2.0)]
    weak, near = (chance_of_set([p], set()) for p in pair)
    assert chance_of_set(pair, set()) == min(weak, near)
    assert chance_of_name(pair, set()) == pytest.approx(1 - (1 - weak) * (1 - near))


def test_what_was_not_looked_at_is_not_known():
    pair = [_part('end_stop', 30.0, offset=9.0), _part('clearance', 30.0)]
    assert chance_of_set(pair, set()) is None
    assert chance_of_name([{'name': 'offset', 'detectability': 9.0}], set()) is None
    assert chance_of_name([], set()) is None
