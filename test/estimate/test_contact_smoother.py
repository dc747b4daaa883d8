import numpy as np
import pytest

from impactscope.estimate.contact_smoother import filter_reading, smooth_reading, transition

W, ZETA, STEP = 203.2, 0.07, 1e-3


def system():
    return transition(W, ZETA, STEP)


def test_transition_propagates_a_ramp_of_force_exactly():
    step, _ = system()
    # A ramp that has lasted long: reading lags by 2 zeta/w.
    rate = 5.0
    lag = 2 * ZETA / W
    state = np.array([rate * (1.0 - lag), rate / W, rate * 1.0, rate])
    moved = step @ state
    expected = np.array([rate * (1.0 + STEP - lag), rate / W, rate * (1.0 + STEP), rate])
    np.testing.assert_allclose(moved, expected, rtol=1e-12)


def test_noise_is_that_of_many_small_steps():
    step, noise = system()
    small, small_noise = transition(W, ZETA, STEP / 50)
    total, power = np.zeros((4, 4)), np.eye(4)
    for _ in range(50):
        total = small @ total @ small.T + small_noise
        power = small @ power
    np.testing.assert_allclose(power, step, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(total, noise, rtol=1e-8, atol=1e-20)


@pytest.mark.parametrize('span', [slice(0, 60), slice(15, 40)])
def test_smoother_is_the_posterior_of_all_samples(span):
    # Dense Gaussian conditioning, as a reference that shares nothing with the recursions.
    n, variance, wander, onset = 60, 0.04, 3e5, 1e4
    step, unit = system()
    noise = wander * unit
    touching = np.zeros(n, np.bool_)
    touching[span] = True
    out = step.copy()
    out[2:] = 0.0
    joint = np.zeros((4 * n, 4 * n))
    p = np.diag([variance, variance, 0.0, onset if touching[0] else 0.0])
    joint[:4, :4] = p
    for k in range(1, n):
        free = not touching[k] or not touching[k - 1]
        move = out if free else step
        added = noise.copy() if touching[k] else np.zeros((4, 4))
        if free:
            added[2:], added[:, 2:] = 0.0, 0.0
        if touching[k] and free:
            added[3, 3] = onset
        row = slice(4 * k, 4 * k + 4)
        before = slice(4 * k - 4, 4 * k)
        joint[row, : 4 * k] = move @ joint[before, : 4 * k]
        joint[: 4 * k, row] = joint[row, : 4 * k].T
        joint[row, row] = move @ joint[before, before] @ move.T + added
    y = np.random.default_rng(0).normal(0, 5, n)
    seen = joint[:, ::4]
    gain = seen @ np.linalg.inv(joint[::4, ::4] + variance * np.eye(n))
    mean = (gain @ y).reshape(n, 4)
    spread = np.diag(joint - gain @ seen.T).reshape(n, 4)
    states, variances = smooth_reading(y, touching, step, noise, variance, onset)
    np.testing.assert_allclose(states, mean, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(variances, spread[:, 2], rtol=1e-4, atol=1e-6)
    cost = filter_reading(y, touching, step, noise, variance, onset)[0]
    whole = joint[::4, ::4] + variance * np.eye(n)
    dense = 0.5 * (y @ np.linalg.solve(whole, y) + np.linalg.slogdet(whole)[1])
    assert cost == pytest.approx(dense, rel=1e-8)
