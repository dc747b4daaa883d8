"""Samples that are far off and few are told; none are in noise, and many are no note."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from impactscope.discrepancy.answer import Finding
from impactscope.discrepancy.lone_samples import MOST, Left, lone_samples_told

SIZE = 20_000


def left(seed: int, off: dict[int, float] | None = None, name: str = 'force') -> Left:
    residual = np.random.default_rng(seed).standard_normal(SIZE)
    for place, size in (off or {}).items():
        residual[place] = size
    return Left(f'blow{seed}.mcap', name, 1e-4 * np.arange(SIZE), residual)


def test_noise_has_none():
    for seed in range(20):
        assert lone_samples_told([left(seed), left(100 + seed)]) == ()


def test_two_are_told_by_place_and_size():
    (note,) = lone_samples_told([left(0), left(1, {400: -9.6, 12_345: 7.2}, 'acceleration.plate')])
    assert note.startswith('2 samples are further off')
    first = note.index('acceleration.plate of blow1.mcap at 0.04 s (9.6)')
    assert first < note.index('acceleration.plate of blow1.mcap at 1.2345 s (7.2)')


def test_one_is_one():
    (note,) = lone_samples_told([left(3, {7: 8.0})])
    assert note.startswith('1 sample is ')


def test_of_more_than_five_the_furthest_are_listed():
    (note,) = lone_samples_told([left(4, {100 * i: 7.0 + i for i in range(9)})])
    assert note.startswith('9 samples are ')
    assert 'at 0.08 s (15.0)' in note
    assert 'at 0 s' not in note
    assert 'and 4 more' in note


def test_a_channel_that_is_told_to_be_rounded_has_none():
    rounded = Finding('quantisation', 1.0, 'measurement', channel='force')
    other = dataclasses.replace(rounded, channel='acceleration.plate')
    far = left(8, {50: 9.0})
    assert lone_samples_told([far], [rounded]) == ()
    assert lone_samples_told([far], [other]) != ()


@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_many_or_noisy_or_no_numbers_are_no_note(bad):
    assert lone_samples_told([left(5, dict.fromkeys(range(MOST + 1), 9.0))]) == ()
    loud = left(6)
    assert lone_samples_told([loud._replace(residual=3.0 * loud.residual)]) == ()
    assert lone_samples_told([left(7, {3: bad, 9: 12.0})]) == ()
    assert lone_samples_told([]) == ()
