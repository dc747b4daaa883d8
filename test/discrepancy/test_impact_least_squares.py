"""Slopes of a fit whose residuals jump: a contact that a step brings to the other side."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.discrepancy.impact.fits.least_squares import (
    Fit,
    _within,
    at_point,
    exact_slopes,
    fit,
    jacobian,
    settled,
)
from impactscope.discrepancy.impact.models.bench_model import Free, Layout

SIZE = 400


@dataclasses.dataclass(eq=False)
class Bounce:
    """Two numbers that residuals hardly part, and samples that jump once the first has grown."""

    jump: float
    edge: float
    seed: int = 3
    steps: dict[str, float] = dataclasses.field(default_factory=dict)

    def __post_init__(self):
        rng = np.random.default_rng(self.seed)
        self.noise = rng.standard_normal(SIZE)
        self.a = rng.standard_normal(SIZE) * 4.0
        self.b = self.a + 0.3 * rng.standard_normal(SIZE)
        self.free = (Free('one', 0.0, 10.0), Free('two', 0.0, 10.0))

    def start(self):
        return np.zeros(2)

    def bounds(self):
        return np.full(2, -math.inf), np.full(2, math.inf)

    def scales(self):
        return np.full(2, 10.0)

    def values(self, x):
        return {f.key: float(v) for f, v in zip(self.free, x, strict=True)}

    def prior_residuals(self, values, layout):
        return np.zeros(2)

    def blow_residuals(self, values, i, layout):
        left = self.noise - self.a * values['one'] - self.b * values['two']
        left[:5] += self.jump * (values['one'] > self.edge)
        return left

    def residuals(self, x, layout):
        values = self.values(x)
        return np.append(self.blow_residuals(values, 0, layout), self.prior_residuals(values, 0))


LAYOUT = Layout((0,), {}, {}, {0: slice(0, SIZE)}, {0: 1.0}, SIZE)


@pytest.fixture
def bounce():
    return Bounce(jump=1.5, edge=0.012)


def test_slopes_leave_out_what_jumps_on_the_way(bounce):
    found = at_point(bounce, LAYOUT, np.zeros(2))
    true = -np.stack([bounce.a, bounce.b], axis=1)
    rough = jacobian(bounce, found.x, LAYOUT, found.residuals)[:SIZE]
    assert np.max(np.abs(rough - true)) > 5.0
    assert np.allclose(exact_slopes(found)[:SIZE], true, atol=1e-6)


def test_stated_uncertainty_is_that_of_the_scatter():
    estimates, stated = [], []
    for seed in range(60):
        bounce = Bounce(jump=1.5, edge=0.012, seed=seed)
        found = settled(fit(bounce, LAYOUT))
        estimates.append(found.x[0])
        stated.append(found.std('one'))
    scatter = float(np.sqrt(np.mean(np.square(estimates))))
    assert float(np.mean(stated)) == pytest.approx(scatter, rel=0.3)


def test_a_settled_fit_is_at_the_bottom_of_its_minimum():
    bounce = Bounce(jump=0.0, edge=1.0)
    start = at_point(bounce, LAYOUT, np.array([0.05, -0.02]))
    best = settled(start)
    design = np.stack([bounce.a, bounce.b], axis=1)
    assert best.x == pytest.approx(np.linalg.lstsq(design, bounce.noise, rcond=None)[0])
    assert best.chi_square < start.chi_square


@given(seed=st.integers(0, 2**31), unit=st.floats(-9.0, 9.0))
def test_the_root_of_the_covariance_knows_numbers_in_any_unit(seed, unit):
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal((40, 3)) * [1.0, 10.0**unit, 10.0**-unit]
    left = rng.standard_normal(40)
    left *= 3.0 / np.linalg.norm(left)  # no more than noise
    found = Fit(Bounce(0.0, 1.0), LAYOUT, np.zeros(3), left, 9.0, converged=True, slopes=slopes)
    root = found.covariance_root()
    assert np.allclose((slopes @ root).T @ (slopes @ root), np.eye(3), atol=1e-6)
    some = found.covariance_root([2, 0])
    wanted = found.covariance()[np.ix_([2, 0], [2, 0])]
    size = np.sqrt(np.diag(wanted))
    assert np.allclose(some @ some.T / np.outer(size, size), wanted / np.outer(size, size))


def test_what_one_fit_learns_of_a_model_changes_no_other(bounce):
    start = np.array([0.02, -0.01])
    slopes = jacobian(bounce, start, LAYOUT, bounce.residuals(start, LAYOUT))
    found = fit(bounce, LAYOUT, start)
    assert found.model.steps
    assert not bounce.steps
    again = jacobian(bounce, start, LAYOUT, bounce.residuals(start, LAYOUT))
    assert np.array_equal(slopes, again)
    assert np.array_equal(fit(bounce, LAYOUT, start).x, found.x)


@given(seed=st.integers(0, 2**31), size=st.integers(1, 12), reach=st.floats(0.01, 3.0))
def test_a_step_stays_within_bounds_and_never_leads_uphill(seed, size, reach):
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal((size + 3, size)) @ np.diag(10.0 ** rng.uniform(-2, 2, size))
    system, gradient = slopes.T @ slopes, slopes.T @ rng.standard_normal(size + 3)
    x = rng.standard_normal(size)
    lower, upper = x - reach * rng.random(size), x + reach * rng.random(size)
    trial = _within(x, system, gradient, np.ones(size, dtype=np.bool_), (lower, upper))
    assert np.all((trial >= lower) & (trial <= upper))
    step = trial - x
    change = float(2.0 * gradient @ step + step @ system @ step)
    assert change <= 1e-9 * float(np.abs(gradient) @ np.abs(step))


def test_what_is_cut_off_at_a_bound_does_not_end_a_fit():
    # one number shall go far beyond its bound, and drags the other to the wrong side
    x, lower, upper = np.zeros(2), np.array([-1.0, -1.0]), np.array([0.1, 1.0])
    slopes = np.array([[1.0, 1.0], [0.0, 0.3]])
    wanted = np.array([0.2, -0.6])
    trial = _within(
        x, slopes.T @ slopes, -slopes.T @ wanted, np.ones(2, dtype=np.bool_), (lower, upper)
    )
    assert trial[0] == 0.1
    # the second is the best there is beside the first at its bound
    slope = 2.0 * slopes[:, 1] @ (slopes @ trial - wanted)
    assert slope == pytest.approx(0.0, abs=1e-12)


@dataclasses.dataclass(eq=False)
class Winding(Bounce):
    """A narrow valley that winds, above a floor that nothing explains; it notes where it was."""

    asked: list[dict[str, float]] = dataclasses.field(default_factory=list)

    def blow_residuals(self, values, i, layout):
        self.asked.append(values)
        left = np.zeros(SIZE)
        left[:2] = 1000.0 * (values['two'] - values['one'] ** 2), 100.0 * (1.0 - values['one'])
        left[2:12] = 10.0
        return left


def test_a_fit_ends_that_does_not_come_to_where_its_numbers_are_of_use():
    def ended(most):
        model = Winding(0.0, 0.0)
        found = fit(model, LAYOUT, np.array([-1.5, 1.5]), iterations=60, most=most)
        return found, len(model.asked)

    whole, asked = ended(math.inf)
    assert whole.chi_square == pytest.approx(1000.0, abs=1.0)
    hopeless, fewer = ended(1e-30)
    assert not hopeless.converged
    assert fewer < 0.6 * asked
    reached, as_many = ended(1100.0)
    assert as_many == asked
    assert np.array_equal(reached.x, whole.x)
