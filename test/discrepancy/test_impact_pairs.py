"""Pairs that hide each other, in closed form and on the bench."""

from __future__ import annotations

import numpy as np
import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.candidates.channel_effects import delays_like
from impactscope.discrepancy.impact.search.pairs import _promising
from impactscope.discrepancy.impact.search.screening import Trial
from impactscope.physics.twin.assembly import Effect


def trial(name, signature, one_sided=False):
    candidate = Candidate(name, name, 'guide')
    return Trial(candidate, 0.0, None, np.zeros(0), signature, {}, one_sided)  # type: ignore[arg-type]


def test_two_that_nearly_cancel_gain_together():
    rng = np.random.default_rng(1)
    basis = np.linalg.qr(rng.standard_normal((200, 3)))[0]
    one = basis[:, 0]
    other = -0.99 * basis[:, 0] + np.sqrt(1 - 0.99**2) * basis[:, 1]
    residual = -(30.0 * one + 30.0 * other)  # residual is measured minus model
    trials = [trial('a', one), trial('b', other), trial('c', basis[:, 2])]
    (i, j, (first, second, gain)), *_ = _promising(residual, trials)
    assert {i, j} == {0, 1}
    assert first == pytest.approx(30.0)
    assert second == pytest.approx(30.0)
    assert gain == pytest.approx(float(residual @ residual))
    alone = max(float(t.signature @ residual) ** 2 for t in trials)
    assert alone < 0.02 * gain


def test_a_strength_of_the_wrong_sign_is_no_pair():
    basis = np.eye(4)[:, :2]
    residual = np.array([5.0, -5.0, 0.0, 0.0])
    free = [trial('a', basis[:, 0]), trial('b', basis[:, 1])]
    bound = [trial('a', basis[:, 0], one_sided=True), trial('b', basis[:, 1])]
    assert _promising(residual, free)
    assert not _promising(residual, bound)


def test_filters_of_one_delay_are_offered_for_a_late_clock():
    clock = Candidate('clock_error:force offset', 'clock_error', 'measurement', channel='force')
    offered = list(delays_like(clock, {'clock_error:force.offset': 1e-3}, 10_000.0, ('force',)))
    assert len(offered) == 4  # none without a phase: these are not late
    assert {c.name for c, _ in offered} == {'low_pass_filter'}
    delays = {
        c.constants['low_pass_filter:force.order']: cutoff
        for c, cutoff in offered
        if not c.constants['low_pass_filter:force.zero_phase']
    }
    assert delays[1] == pytest.approx(1 / (2 * np.pi * 1e-3))
    assert sorted(delays.values()) == [delays[order] for order in (1, 2, 3, 4)]
    early = list(delays_like(clock, {'clock_error:force.offset': -1e-3}, 10_000.0, ('force',)))
    assert all(c.constants['low_pass_filter:force.zero_phase'] for c, _ in early)
    short = list(delays_like(clock, {'clock_error:force.offset': 4e-5}, 10_000.0, ('force',)))
    ahead = [f for c, f in short if c.constants.get('low_pass_filter:force.ahead')]
    assert min(ahead) == pytest.approx(1 / (2 * np.pi * 4e-5))  # of first order


def test_a_filter_without_a_phase_may_have_run_before_sampling():
    constants = {'low_pass_filter:force.order': 1, 'low_pass_filter:force.zero_phase': 1}
    found = Candidate('f', 'low_pass_filter', 'measurement', channel='force', constants=constants)
    values = {'low_pass_filter:force.cutoff': 3000.0}
    offered = [c for c, _ in delays_like(found, values, 10_000.0, ('force',))]
    ahead = [c for c in offered if c.constants.get('low_pass_filter:force.ahead')]
    assert {c.constants['low_pass_filter:force.zero_phase'] for c in ahead} == {0, 1}


def test_one_accelerometer_of_several_is_hardly_late():
    found = Candidate(
        'f',
        'low_pass_filter',
        'measurement',
        channel='acceleration.plate',
        constants={
            'low_pass_filter:acceleration.plate.order': 2,
            'low_pass_filter:acceleration.plate.zero_phase': 0,
        },
    )
    values = {'low_pass_filter:acceleration.plate.cutoff': 9e4}
    alone, several = (
        next(iter(delays_like(found, values, 10_000.0, ('force', *channels))))[0]
        for channels in (('acceleration.plate',), ('acceleration.plate', 'acceleration.base'))
    )
    assert alone.name == several.name == 'clock_error'
    assert several.doubt > alone.doubt


def test_a_late_clock_is_offered_for_a_filter():
    constants = {'low_pass_filter:force.order': 2, 'low_pass_filter:force.zero_phase': 0}
    found = Candidate('f', 'low_pass_filter', 'measurement', channel='force', constants=constants)
    values = {'low_pass_filter:force.cutoff': 1000.0}
    clock, delay = next(iter(delays_like(found, values, 10_000.0, ('force',))))
    assert clock.name == 'clock_error'
    assert delay == pytest.approx(2**0.5 / (2 * np.pi * 1000.0), rel=1e-4)


@pytest.mark.slow
def test_a_zero_phase_filter_of_first_order_is_named(make_campaign):
    effect = Effect('low_pass_filter', {'cutoff': 400.0, 'order': 1, 'zero_phase': 1}, 'force')
    answer = explain(make_campaign(53, [effect]))
    assert answer.accepted == ('low_pass_filter',)
    assert answer.ranking[0].parameters['zero_phase'].value == 1


@pytest.mark.slow
def test_two_effects_of_the_contact_are_both_found(make_campaign):
    effects = [
        Effect('velocity_squared_contact', {'coefficient': 8.0}),
        Effect('stiffening_damper', {'coefficient': 15.0}),
    ]
    answer = explain(make_campaign(54, effects, orientation='horizontal'))
    assert sorted(answer.accepted) == ['stiffening_damper', 'velocity_squared_contact']
