import numpy as np
import pytest

from impactscope.errors import EstimationError
from impactscope.estimate.effective_mass import mass_from_acceleration, mass_from_momentum
from impactscope.records import Estimate

TIME = np.linspace(0, np.pi, 120)


def test_mass_and_push_are_told_apart_with_calibrated_uncertainty():
    rng = np.random.default_rng(0)
    scores = []
    for _ in range(300):
        slowed = 40 * np.sin(TIME)
        force = 2.5 * slowed + 13 + rng.normal(0, 0.5, TIME.size)
        fit = mass_from_acceleration(
            force, slowed + rng.normal(0, 0.08, TIME.size), deceleration_noise=0.08
        )
        scores.append(
            ((fit.mass.value - 2.5) / fit.mass.std, (fit.push.value - 13) / fit.push.std)
        )
    scores = np.array(scores)
    assert np.abs(scores.mean(axis=0)).max() < 0.25
    assert np.mean(np.abs(scores[:, 0]) < 1.96) > 0.9
    assert np.mean(np.abs(scores[:, 1]) < 1.96) > 0.9
    assert 0.7 < scores[:, 0].std() < 1.25


def test_noise_of_the_accelerometer_does_not_pull_the_mass_down():
    rng = np.random.default_rng(1)
    slowed = 10 * np.sin(TIME)
    found = [
        mass_from_acceleration(
            2 * slowed, slowed + rng.normal(0, 1.5, TIME.size), deceleration_noise=1.5
        ).mass.value
        for _ in range(200)
    ]
    assert np.mean(found) == pytest.approx(2.0, abs=0.04)


def test_gain_and_flexibility_widen():
    slowed = 40 * np.sin(TIME)
    rigid = mass_from_acceleration(2 * slowed, slowed)
    gain = mass_from_acceleration(2 * slowed, slowed, gain_std=0.02)
    shaking = mass_from_acceleration(2 * slowed, slowed + 4 * np.sin(9 * TIME))
    assert gain.mass.std == pytest.approx(0.04, rel=1e-3)
    assert shaking.mass.std > 10 * rigid.mass.std
    assert abs(shaking.mass.value - 2) < 3 * shaking.mass.std


def test_momentum():
    assert mass_from_momentum(Estimate(1.5, 0.03), Estimate(0.5, 0.01)) == (
        pytest.approx(3.0),
        pytest.approx(3 * np.hypot(0.02, 0.02)),
    )
    assert np.isnan(mass_from_momentum(Estimate(1.0, 0.1), Estimate(1.0)).std)


def test_what_cannot_be_told_is_refused():
    rng = np.random.default_rng(2)
    noise = rng.normal(0, 1, 100)
    with pytest.raises(EstimationError, match='4 samples'):
        mass_from_acceleration(np.ones(4), np.ones(4))
    with pytest.raises(EstimationError, match='together'):
        mass_from_acceleration(rng.normal(0, 1, 100), noise)
    with pytest.raises(EstimationError, match='together'):
        mass_from_acceleration(-noise, noise)
    with pytest.raises(EstimationError, match='noise'):
        mass_from_acceleration(noise, noise, deceleration_noise=1.0)
    with pytest.raises(EstimationError, match='above zero'):
        mass_from_momentum(Estimate(-1.0, 0.1), Estimate(1.0, 0.1))
