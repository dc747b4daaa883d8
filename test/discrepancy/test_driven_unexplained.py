"""What is said of what findings leave."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import fft

from impactscope.discrepancy.driven.findings.ranking import unlikely
from impactscope.discrepancy.driven.findings.residual_size import _louder_than_its_noise
from impactscope.discrepancy.driven.systems.prescribed_motion_noise import (
    PrescribedMotionNoise,
    power_of_noise,
)


def effect(name, *excludes):
    def stands_with(other):
        return name != other.name and name not in other.excludes and other.name not in excludes

    return SimpleNamespace(name=name, label=name, excludes=excludes, stands_with=stands_with)


def subject(*fits):
    """The first fit is the chosen one; each with what a criterion says of it."""
    made = [SimpleNamespace(terms=terms, added=len(terms)) for terms, _ in fits]
    of = {id(m): criterion for m, (_, criterion) in zip(made, fits, strict=True)}
    judge = SimpleNamespace(weights=lambda _: (), criterion=lambda f, _: of[id(f)])
    outcome = SimpleNamespace(baseline=made[-1], best=made[0], rivals=made[1:])
    return SimpleNamespace(outcome=outcome, judge=judge, case=None, model=None)


def test_an_effect_that_is_likelier_not_there_is_no_finding_beside_something_unknown():
    spring, drag = effect('hardening_spring'), effect('quadratic_damping')
    plain, uneven = (
        effect('coulomb_friction', 'asymmetric_friction'),
        effect('asymmetric_friction'),
    )
    both = subject(((spring, drag), 0.0), ((uneven,), -6.0), ((spring,), 2.0), ((), 9.0))
    assert unlikely(both, (spring, drag)) == {'hardening_spring', 'quadratic_damping'}
    likely = subject(((spring,), 0.0), ((uneven,), 4.0), ((), 9.0))
    assert not unlikely(likely, (spring,))
    # that there is friction is sure, if not by which law
    assert not unlikely(subject(((plain,), 0.0), ((uneven,), -4.0), ((), 30.0)), (plain,))


@pytest.mark.parametrize(('size', 'louder'), [(1.2, False), (2.3, True)])
def test_what_is_left_has_the_power_of_its_noise(size, louder):
    left = size * np.random.default_rng(4).standard_normal(2000)
    whole = SimpleNamespace(noise=1.0, held_out=False, whitener=None)
    case, made = SimpleNamespace(segments=[whole]), SimpleNamespace(residuals=[left])
    assert bool(_louder_than_its_noise(case, made)) is louder


@pytest.mark.parametrize(('size', 'louder'), [(1.2, False), (2.3, True)])
def test_the_noise_of_a_force_has_what_its_motion_adds(size, louder):
    """A course that is followed up to 100 Hz lets much of its own noise through."""
    n = 8000
    noise = PrescribedMotionNoise(
        1.0, 1e-3, 100.0, (1000.0, 10.0, 0.1), 1e-3, np.zeros((3, n)), turns=np.zeros(n, bool)
    )
    lines = np.arange(n) / (2.0 * n * 1e-3)
    white = np.random.default_rng(5).standard_normal(n)
    left = fft.idct(fft.dct(white) / np.sqrt(1.0 - noise.share(lines)))
    moved = SimpleNamespace(
        noise=1.0, held_out=False, whitener=noise, measured=np.zeros(n), period=1e-3
    )
    assert power_of_noise(moved) > 4.0
    assert np.mean(left**2) == pytest.approx(power_of_noise(moved), rel=0.1)
    case, made = SimpleNamespace(segments=[moved]), SimpleNamespace(residuals=[size * left])
    assert bool(_louder_than_its_noise(case, made)) is louder
