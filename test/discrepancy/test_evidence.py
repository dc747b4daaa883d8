"""The rules of evidence against their own claims."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from impactscope.discrepancy.evidence import (
    at_a_bound,
    borne_by_many,
    family_p_value,
    first_discoveries,
    flat_top,
    information,
    is_white,
    least_gain,
    noise_std,
    price,
    probabilities,
    quantisation_step,
    shape_price,
    spread_over_minima,
    spread_p_value,
)


@given(st.integers(1, 6), st.integers(1, 200), st.floats(1e-4, 0.2))
def test_the_least_gain_is_that_of_the_stated_chance(parameters, looks, chance):
    gain = least_gain(parameters, looks, chance)
    assert family_p_value(gain, parameters, looks) == pytest.approx(chance, rel=1e-6)


def test_the_best_of_many_superfluous_candidates_is_found_as_rarely_as_stated():
    rng = np.random.default_rng(1)
    best = rng.chisquare(2, size=(4000, 50)).max(axis=1)
    found = np.mean(best > least_gain(2, 50, 0.05))
    low, high = stats.binom.interval(0.999, 4000, 0.05)
    assert low / 4000 <= found <= high / 4000


def test_false_discoveries_stay_at_their_rate():
    rng = np.random.default_rng(2)
    shares = []
    for _ in range(300):
        p = np.concatenate([rng.uniform(size=180), rng.uniform(0, 1e-6, size=20)])
        found = first_discoveries(p, 0.1)
        assert found[180:].all()
        shares.append(found[:180].sum() / found.sum())
    assert np.mean(shares) < 0.11


def test_no_hypotheses_no_discoveries():
    assert first_discoveries([], 0.05).size == 0
    assert not first_discoveries([0.5, 0.9], 0.05).any()


def test_probabilities_follow_the_criteria():
    p = probabilities([10.0, 10.0 + 2 * np.log(3.0), 5000.0])
    assert p == pytest.approx([0.75, 0.25, 0.0], abs=1e-9)
    assert probabilities([]) == []


def test_a_number_costs_the_logarithm_of_the_samples():
    assert information(0.0, 3, 1000) == pytest.approx(3 * np.log(1000))


@pytest.mark.parametrize('drift', [0.0, 50.0])
def test_noise_is_measured_beside_drift_and_spikes(drift):
    rng = np.random.default_rng(3)
    samples = 0.3 * rng.standard_normal(4000) + drift * np.linspace(0, 1, 4000)
    samples[1000:1010] += 100.0
    assert noise_std(samples) == pytest.approx(0.3, rel=0.05)


def test_steps_of_a_converter_are_seen_and_count_as_noise():
    rng = np.random.default_rng(4)
    samples = 0.5 * np.round(0.1 * rng.standard_normal(2000) / 0.5 + np.linspace(0, 4, 2000))
    assert quantisation_step(samples) == pytest.approx(0.5)
    assert quantisation_step(rng.standard_normal(2000)) == 0.0
    assert noise_std(samples) >= 0.5 / np.sqrt(12)


def test_white_and_coloured_residuals_are_told_apart():
    rng = np.random.default_rng(5)
    white = rng.standard_normal(2000)
    assert is_white(white)
    assert not is_white(np.convolve(white, np.ones(4) / 2, 'same'))
    assert spread_p_value(white) > 1e-3
    assert spread_p_value(1.2 * white) < 1e-6


def test_what_many_samples_bear_counts_and_what_few_bear_does_not():
    many = np.full(1000, 0.2)
    assert borne_by_many(many, 3, 9.0) == pytest.approx(200.0)
    few = np.zeros(1000)
    few[[10, 500, 501]] = 400.0
    assert borne_by_many(few, 3, 9.0) == pytest.approx(27.0)
    few[700] = 400.0  # a fourth one is no longer lone
    assert borne_by_many(few, 3, 9.0) == pytest.approx(427.0)
    worse = np.full(1000, -0.2)
    assert borne_by_many(worse, 3, 9.0) == pytest.approx(-200.0)
    assert borne_by_many(few[:3], 3, 9.0) == 0.0


@given(st.floats(0.0, 1e5), st.integers(0, 5), st.integers(1, 60), st.integers(10, 10**6))
def test_numbers_of_one_kind_cost_no_more_than_as_many_of_their_own(gain, shared, own, samples):
    plain = information(0.0, shared + own, samples)
    assert price(gain, shared, 0, samples) == pytest.approx(information(0.0, shared, samples))
    cost = price(gain, shared, own, samples)
    assert information(0.0, shared, samples) <= cost <= plain + 1e-9
    assert cost <= price(2.0 * gain, shared, own, samples)


@given(st.floats(1e-3, 1e3), st.floats(1e-3, 1e2), st.floats(-0.99, 0.99))
def test_a_shape_costs_what_is_told_of_it(variance, spread, correlation):
    one = np.array([[variance]])
    cost = shape_price(one, np.array([spread]))
    assert cost == pytest.approx(math.log1p(spread**2 / variance))
    both = np.diag([variance, variance])
    assert shape_price(both, np.array([spread, spread])) == pytest.approx(2.0 * cost)
    tied = both + correlation * variance * np.array([[0.0, 1.0], [1.0, 0.0]])
    assert shape_price(tied, np.array([spread, spread])) >= 2.0 * cost - 1e-6


def test_a_shape_of_which_nothing_is_told_costs_nothing():
    spread = np.array([0.2, 3.0])
    assert shape_price(np.diag([1e12, 1e12]), spread) == pytest.approx(0.0, abs=1e-9)
    assert shape_price(np.zeros((0, 0)), np.zeros(0)) == 0.0


def test_the_evidence_of_a_shape_is_the_likelihood_over_what_was_credible():
    """Against the integral over a normal prior: y = x + noise, x of spread 2, noise of 0.3."""
    std, spread, seen = 0.3, 2.0, 1.1
    x = np.linspace(-20.0, 20.0, 400_001)
    prior = np.exp(-0.5 * (x / spread) ** 2) / (spread * math.sqrt(2.0 * math.pi))
    likelihood = np.exp(-0.5 * ((seen - x) / std) ** 2)  # 1 where it fits best
    exact = -2.0 * math.log(float(np.sum(likelihood * prior)) * (x[1] - x[0]))
    pulled = seen**2 / (std**2 + spread**2)  # from the prior's middle
    cost = shape_price(np.array([[std**2]]), np.array([spread]))
    assert exact == pytest.approx(cost + pulled, abs=1e-3)


def test_numbers_of_one_kind_that_chance_gives_never_pay():
    rng = np.random.default_rng(5)
    for gain in rng.chisquare(14, 500):
        assert price(float(gain), 0, 14, 40_000) > gain - 5.0


@given(st.floats(0.01, 10.0), st.floats(0.0, 100.0), st.floats(1e-6, 1.0))
def test_an_interval_over_two_minima_is_no_narrower_than_over_one(std, away, likely):
    both = spread_over_minima([std] * 2, [0.0, away], [1.0, likely])
    assert std * (1.0 - 1e-6) <= both <= std + away
    assert spread_over_minima([std], [0.0], [1.0]) == pytest.approx(std, rel=1e-6)


def test_only_an_end_that_is_somewhere_is_a_bound():
    assert at_a_bound(0.29999, 0.0, 0.3)
    assert at_a_bound(1.0005, 1.0, math.inf)
    assert not at_a_bound(0.0, 0.0, math.inf)
    assert not at_a_bound(0.29, 0.0, 0.3)


def test_an_interval_reaches_to_a_minimum_as_good():
    assert spread_over_minima([1.0] * 2, [0.0, 100.0], [1.0, 1.0]) * 1.96 == pytest.approx(
        101.3, abs=0.2
    )
    assert spread_over_minima([1.0] * 2, [0.0, 100.0], [1.0, 1e-3]) < 1.1


@pytest.mark.parametrize('limit', [13.757, 13.4, 20.0])
def test_a_limit_that_is_read_in_steps_is_the_largest_reading(limit):
    """A fit of the mean would be off by a third of the noise, which is cut off with the signal."""
    rng, noise, step = np.random.default_rng(4), 1.4, 0.62
    clean = 18.0 * np.sin(np.linspace(0.0, 20.0, 4000))
    cut = np.clip(clean + noise * rng.standard_normal(clean.size), -limit, limit)
    told = flat_top([step * np.round(cut / step)], step, limit - 0.4 * noise, noise)
    assert told is not None
    assert abs(told[0] - limit) <= 0.5 * step + 1e-9
    assert told[1] == pytest.approx(step / math.sqrt(12.0))


def test_no_flat_top_is_told_without_steps_or_far_from_what_was_fitted():
    readings = [np.array([0.0, 1.0, 2.0, 2.0, 2.0])]
    assert flat_top(readings, 0.0, 2.0, 0.1) is None
    assert flat_top(readings, 1.0, 5.0, 0.1) is None
    assert flat_top([readings[0][:-1]], 1.0, 2.0, 0.1) is None


@pytest.mark.parametrize('step', [0.2, 0.3, 0.4, 0.6, 0.7])
def test_noise_of_readings_in_steps(step):
    """Their quartiles are multiples of the step; what it has rounded has others."""
    rng = np.random.default_rng(5)
    told = [noise_std(step * np.round(rng.normal(size=2000) / step)) for _ in range(40)]
    assert np.mean(told) == pytest.approx(math.hypot(1.0, step / math.sqrt(12.0)), rel=0.015)
    assert np.std(told) < 0.04
