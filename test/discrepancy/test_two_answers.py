"""Which of two answers, or of two baselines, stands: what leaves far less."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from impactscope.discrepancy.driven.explain import (
    _explains_less,
    _leaves_far_less,
    _leaves_more,
    _may_err,
)
from impactscope.discrepancy.driven.noise_limited import SLOW_NOISE
from impactscope.discrepancy.impact.explain import _far_behind


def answer(fitted, held_out, accepted=('coulomb_friction',)):
    extended = SimpleNamespace(rmse=fitted, held_out_rmse=held_out)
    return SimpleNamespace(accepted=accepted, fit=SimpleNamespace(extended=extended))


OTHER = answer({'position': 1.0}, {'position': 1.0}, ('unknown',))


@pytest.mark.parametrize(
    ('one', 'less'),
    [
        (answer({'position': 0.7}, {'position': 0.7}), True),
        (answer({'position': 0.72}, {'position': 0.5}), False),  # half the power, throughout
        (answer({'position': 0.5}, {'position': 0.72}), False),
        (answer({'position': 0.1}, {'position': 0.1}, ('unknown',)), False),  # nothing named
        (answer({'position': 0.1}, {}), False),  # not the same recordings
    ],
)
def test_an_answer_leaves_far_less_where_it_names_something_and_leaves_half_the_power(one, less):
    assert _leaves_far_less(one, OTHER) is less


@pytest.mark.parametrize(
    ('one', 'more'),
    [
        (answer({'position': 1.1}, {'position': 1.2}), True),
        (answer({'position': 1.1}, {'position': 0.9}), False),  # it predicts better
        (answer({'position': 0.9}, {'position': 1.1}), False),
        (answer({'position': 2.0}, {'position': 2.0}, ('unknown',)), False),  # nothing named
        (answer({'position': 2.0}, {}), False),  # not the same recordings
    ],
)
def test_an_answer_that_names_something_and_leaves_more_throughout_gives_way(one, more):
    assert _leaves_more(one, OTHER) is more


@pytest.mark.parametrize(
    ('names', 'left', 'others', 'less'),
    [
        (('friction', 'unknown'), (1.5, 1.02), ('friction',), True),
        (('friction', 'unknown'), (1.05, 1.05), ('friction',), False),  # not clearly
        (('friction', 'unknown'), (1.5, 0.98), ('friction',), False),  # it predicts better
        (('friction',), (1.5, 1.5), ('friction', 'offset'), False),  # by what the other has more
        (('friction', 'unknown'), (1.5, 1.5), ('unknown',), False),  # the other names nothing
    ],
)
def test_an_answer_beside_slow_noise_gives_way_to_one_that_says_no_more_and_leaves_less(
    names, left, others, less
):
    one = answer({'force': left[0]}, {'force': left[1]}, names)
    assert _explains_less(one, answer({'force': 1.0}, {'force': 1.0}, others)) is less


@pytest.mark.parametrize(
    ('names', 'notes', 'may'),
    [
        (('friction', 'unknown'), (), True),
        (('friction',), (SLOW_NOISE,), True),
        (('friction',), (), False),
        (('unknown',), (SLOW_NOISE,), False),  # nothing is claimed
        ((), (SLOW_NOISE,), False),
    ],
)
def test_what_is_left_to_noise_may_be_an_error_of_the_model(names, notes, may):
    assert _may_err(SimpleNamespace(accepted=names, notes=notes)) is may


def baseline(chi_square, size=1000, reduced=1.2, whole=1000):
    return SimpleNamespace(
        chi_square=chi_square,
        reduced=reduced,
        layout=SimpleNamespace(size=size, blows=(0,)),
        model=SimpleNamespace(layout=lambda _: SimpleNamespace(size=whole)),
    )


@pytest.mark.parametrize(
    ('other', 'here', 'behind'),
    [
        (baseline(1350.0), baseline(1200.0), True),
        (baseline(1250.0), baseline(1200.0), False),
        (baseline(1100.0, size=950), baseline(1200.0), True),  # it does not follow to the end
        (baseline(9000.0), baseline(5000.0, reduced=5.0), False),  # much is missing: open
        (baseline(9000.0), baseline(1200.0, size=900), False),  # nor does this one
    ],
)
def test_a_choice_is_far_behind_only_a_baseline_that_lacks_little(other, here, behind):
    assert _far_behind(other, here) is behind
