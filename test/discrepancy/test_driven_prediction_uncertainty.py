"""Predictions with uncertain numbers, against the marginal distribution of linear models."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from impactscope.discrepancy.driven.fits.prediction_uncertainty import excused

seeds = st.integers(0, 2**32 - 1)


def linear_recordings(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Slopes of fitted and held-out samples by three shared numbers, and both residuals."""
    rng = np.random.default_rng(seed)
    fitted, held = rng.normal(size=(40, 3)) * [30, 0.3, 3], rng.normal(size=(25, 3))
    true = rng.normal(size=3)
    noise = rng.normal(size=40)
    prior = np.eye(3)
    found = np.linalg.solve(fitted.T @ fitted + prior, fitted.T @ (fitted @ true + noise))
    left = held @ (true - found) + rng.normal(size=25)
    left /= max(1.0, math.sqrt(float(np.mean(left**2))))  # no more than noise
    return fitted, held, fitted @ (true - found), left


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_deviance_is_that_of_the_predictive_distribution(seed: int) -> None:
    fitted, held, _, left = linear_recordings(seed)
    covariance = np.eye(25) + held @ np.linalg.inv(fitted.T @ fitted + np.eye(3)) @ held.T
    normal = stats.multivariate_normal(np.zeros(25), covariance)
    deviance = -2.0 * normal.logpdf(left) - 25 * math.log(2.0 * math.pi)
    assert left @ left - excused(fitted, 3, [(left, held, np.empty((25, 0)))]) == pytest.approx(
        deviance, rel=1e-9
    )


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_recordings_one_by_one_or_as_one_say_the_same(seed: int) -> None:
    fitted, held, _, left = linear_recordings(seed)
    none = np.empty((25, 0))
    left = 0.3 * left  # of no part more than noise
    parts = [(left[:9], held[:9], none[:9]), (left[9:], held[9:], none[9:])]
    assert excused(fitted, 3, parts) == pytest.approx(excused(fitted, 3, [(left, held, none)]))


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_what_a_recording_has_of_its_own_tells_nothing_of_shared_numbers(seed: int) -> None:
    fitted, held, _, left = linear_recordings(seed)
    own = np.random.default_rng(seed).normal(size=(25, 2)) * [1.0, 1e-6]
    basis = np.linalg.qr(own)[0]

    def free(columns: np.ndarray) -> np.ndarray:
        return columns - basis @ (basis.T @ columns)

    direct = excused(fitted, 3, [(free(left), free(held), np.empty((25, 0)))])
    assert excused(fitted, 3, [(left, held, own)]) == pytest.approx(direct, rel=1e-6, abs=1e-6)
    # where the fitted recordings' own numbers do all that a shared one does, it stays unknown
    tied = np.column_stack([fitted, fitted[:, 1]])
    parts = [(left, held, np.empty((25, 0)))]
    alone = np.column_stack([fitted, np.zeros(40)])
    assert excused(alone, 3, parts) == pytest.approx(excused(fitted, 3, parts))
    free_of = fitted - np.outer(fitted[:, 1], fitted[:, 1] @ fitted) / (fitted[:, 1] ** 2).sum()
    assert excused(tied, 3, parts) == pytest.approx(excused(free_of, 3, parts), rel=1e-6)


def test_well_known_numbers_excuse_nothing() -> None:
    _, held, _, left = linear_recordings(7)
    sharp = 1e6 * np.random.default_rng(1).normal(size=(40, 3))
    assert excused(sharp, 3, [(left, held, np.empty((25, 0)))]) == pytest.approx(0.0, abs=1e-6)


def test_what_is_missing_in_a_recording_does_not_tune_the_numbers() -> None:
    _, held, _, left = linear_recordings(11)
    loose = np.random.default_rng(2).normal(size=(40, 3))
    astray = left + 1000.0 * held[:, 0]
    assert abs(excused(loose, 3, [(astray, held, np.empty((25, 0)))])) < 30.0
