"""How far numbers may go, where else they may be, and the interval that several minima leave."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from impactscope.discrepancy.answer import ParameterEstimate
from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.models.bench_model import Free
from impactscope.discrepancy.impact.search.other_minima import (
    other_modes,
    weighed_by_width,
    widened,
)
from impactscope.discrepancy.impact.search.profile_likelihood import profiled

SIZE = 200


class Line:
    """Residuals of a line, the first number felt through ``felt``."""

    def __init__(self, felt, lower=-math.inf):
        rng = np.random.default_rng(3)
        self.columns = rng.normal(size=(SIZE, 2))
        self.noise = rng.normal(size=SIZE)
        basis, _ = np.linalg.qr(self.columns)
        self.noise -= basis @ (basis.T @ self.noise)
        self.felt = felt
        self.free = (Free('a', 0.0, 1.0, lower), Free('b', 0.0, 1.0))

    def residuals(self, x, layout):
        moved = np.array([self.felt(x[0]), x[1]])
        return np.append(self.noise - self.columns @ moved, [0.0, 0.0])

    def bounds(self):
        return np.array([f.lower for f in self.free]), np.array([f.upper for f in self.free])

    def index(self, key):
        return [f.key for f in self.free].index(key)

    def values(self, x):
        return dict(zip('ab', x.tolist(), strict=True))


def fitted(felt, steepness=1.0, **bounds):
    """At the minimum, with the slope that the first number is said to have there."""
    model = Line(felt, **bounds)
    x = np.zeros(2)
    residuals = model.residuals(x, None)
    slopes = np.zeros((SIZE + 2, 2))
    slopes[:SIZE] = -model.columns * [steepness, 1.0]
    layout = SimpleNamespace(size=SIZE)
    power = float(residuals @ residuals)
    return Fit(model, layout, x, residuals, power, True, slopes)  # type: ignore[arg-type]


def finding():
    return SimpleNamespace(free=(Free('a', 0.0, 1.0),))


def test_a_number_that_acts_as_its_slope_says_is_known_as_well_as_that():
    found = fitted(lambda a: a)
    same, factors = profiled(found, [finding()])
    assert same is found
    assert factors == {'a': 1.0}


@pytest.mark.parametrize('steeper', [1.5, 2.0, 4.0])
def test_a_slope_that_is_steep_at_one_point_alone_narrows_no_interval(steeper):
    _, factors = profiled(fitted(lambda a: a, steeper), [finding()])
    assert factors['a'] == pytest.approx(steeper, rel=0.02)


def test_the_wider_side_counts():
    _, factors = profiled(fitted(lambda a: a if a > 0 else 0.5 * a), [finding()])
    assert factors['a'] == pytest.approx(2.0, rel=0.02)


def test_a_bound_says_nothing_of_the_other_side():
    _, factors = profiled(fitted(lambda a: 0.5 * a, lower=-1e-9), [finding()])
    assert factors['a'] == pytest.approx(2.0, rel=0.02)


def test_what_rings_far_up_is_sought_along_the_valley_of_its_stiffness(monkeypatch):
    # a fixture that only shows m f^2: the fit may slide along, but finds no way across
    rng = np.random.default_rng(4)
    shape = rng.normal(size=SIZE)
    slopes = np.zeros((SIZE + 2, 2))
    slopes[:SIZE, 0] = 20.0 * shape
    slopes[:SIZE, 1] = 10.0 * shape + 0.1 * rng.normal(size=SIZE)
    free = tuple(
        Free(f'f.{name}', 1.0, 0.05, 1e-3, 1e3, logarithmic=True) for name in ('frequency', 'mass')
    )
    model = SimpleNamespace(free=free, bounds=lambda: (np.full(2, -7.0), np.full(2, 7.0)))
    model.index = lambda key: [f.key for f in free].index(key)
    model.values = lambda x: {f.key: math.exp(v) for f, v in zip(free, x, strict=True)}
    layout = SimpleNamespace(size=SIZE)
    final = Fit(model, layout, np.zeros(2), np.zeros(SIZE + 2), 100.0, True, slopes)
    tried = []

    def ended(x):
        lower = 50.0 if abs(x[0] + math.log(2.9)) < 0.05 and abs(x[1] + 2 * x[0]) < 0.1 else 100.0
        return Fit(model, layout, x, np.zeros(SIZE + 2), lower, True, slopes)

    def barely_moving(model, layout, starts, **_):
        tried.extend(starts)
        return [ended(x) for x in starts]

    searched = 'impactscope.discrepancy.impact.search.other_minima'
    monkeypatch.setattr(f'{searched}.fits_from', barely_moving)
    finding = Candidate('f', 'f', 'fixture', free=free, amplitudes={'f.mass': math.inf})
    best, _ = other_modes(final, [finding])
    assert best.chi_square == 50.0
    assert any(abs(x[1]) < 1e-12 and x[0] != 0.0 for x in tried)  # and with nothing moved along


def minimum(value, chi_square, std):
    """A fit with one number of an effect, tried between 0 and 100."""
    model = SimpleNamespace(
        free=[Free('t.a', 1.0, 1.0, 0.0, 100.0)],
        bounds=lambda: (np.array([0.0]), np.array([100.0])),
    )
    return SimpleNamespace(
        model=model,
        chi_square=chi_square,
        reduced=1.0,
        values={'t.a': value},
        std=lambda _: std,
        covariance=lambda: np.array([[std**2]]),
    )


def estimate(factor=1.0, worse=(), apart=3.0, width=0.1):
    """Standard uncertainty of a number with further minima, each that much worse."""
    best = minimum(1.0, 100.0, 0.1)
    modes = [minimum(1.0 + apart, 100.0 + w, width) for w in worse]
    stated = {'a': ParameterEstimate(1.0, 0.1, '1')}
    return widened(stated, 't', best, modes, {'t.a': factor})['a'].std


def test_one_minimum_keeps_its_uncertainty_and_its_factor():
    assert estimate() == pytest.approx(0.1, rel=1e-3)
    assert estimate(1.7) == pytest.approx(0.17, rel=1e-3)


@pytest.mark.parametrize('wider', [3.0, 10.0])
def test_a_wide_minimum_weighs_more_than_a_narrow_one_as_deep(wider):
    best, other = minimum(1.0, 100.0, 0.1), minimum(4.0, 100.0, wider * 0.1)
    assert weighed_by_width(best, [other], 't') == pytest.approx([1.0 / wider, 1.0], rel=1e-3)


def test_a_wide_minimum_counts_though_a_narrow_one_is_deeper():
    narrow = estimate(worse=[4.0], width=0.1)
    wide = estimate(worse=[4.0], width=1.0)
    # by depth 0.12 of the likelihood, with ten times the width 0.57
    assert narrow == pytest.approx(0.5 * 3.0, rel=0.15)
    share = 10 * math.exp(-2.0) / (1 + 10 * math.exp(-2.0))
    held = 1 - share + share * stats.norm.cdf(1.96 * wide, 3.0, 1.0)
    assert held == pytest.approx(0.95, abs=0.002)


def test_what_nothing_tells_of_is_as_wide_as_what_is_tried():
    best, unknown = minimum(1.0, 100.0, 0.1), minimum(4.0, 108.0, 0.0)
    narrow, wide = weighed_by_width(best, [unknown], 't')
    tried = 100.0 / math.sqrt(12.0)
    assert wide == 1.0
    assert narrow == pytest.approx(0.1 / tried * math.exp(4.0), rel=1e-3)


def test_a_minimum_far_behind_is_excluded():
    best, other = minimum(1.0, 100.0, 0.1), minimum(4.0, 109.0, 0.1)
    assert weighed_by_width(best, [other], 't') == [1.0, 0.0]


@pytest.mark.parametrize('worse', [0.0, 1.0, 3.0])
def test_the_interval_reaches_a_second_minimum_that_is_likely(worse):
    std = estimate(worse=[worse])
    share = 1.0 / (1.0 + math.exp(0.5 * worse))
    held = (1 - share) * 1.0 + share * stats.norm.cdf(1.96 * std, 3.0, 0.1)
    assert held == pytest.approx(0.95, abs=1e-3)
    assert 1.96 * std > 2.8


def test_a_minimum_that_is_unlikely_is_left_outside():
    assert estimate(worse=[7.9]) < 0.13
