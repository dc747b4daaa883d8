"""Kalman filter and smoother of a reading, whose cause is a contact force that comes and goes.

The state is (reading, its rate over w, contact force, rate of the force), shape (4,): eq. 7 of
Samarathunga et al., Machines 2024, 12, 26, in units of force, driven by a force whose rate is a
random walk in contact and which is exactly zero out of contact. Arrays only; see
:mod:`impactscope.estimate.contact_force` for what they mean.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import expm

__all__ = ['filter_reading', 'smooth_reading', 'transition']

Array = NDArray[np.float64]


def transition(w: float, zeta: float, h: float) -> tuple[Array, Array]:
    """One sample's step of (reading, its rate over w, contact force, rate of force).

    Returns the transition matrix and the covariance of unit process noise, both (4, 4), after
    Van Loan 1978: the rate of force is a random walk.
    """
    a = np.zeros((4, 4))
    a[0, 1] = w
    a[1] = [-w, -2 * zeta * w, w, 0.0]
    a[2, 3] = 1.0
    block = np.zeros((8, 8))
    block[:4, :4], block[4:, 4:] = -a, a.T
    block[3, 7] = 1.0
    exponential = expm(block * h)
    step = exponential[4:, 4:].T
    return np.ascontiguousarray(step), np.ascontiguousarray(step @ exponential[:4, 4:])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _predict(
    x: Array,
    p: Array,
    step: Array,
    noise: Array,
    touching: bool,
    begins: bool,
    onset: float,
    work: Array,
) -> None:
    """Advance mean (4,) and covariance (4, 4) by a sample, in place; ``work`` is (5, 4)."""
    for i in range(4):
        work[4, i] = 0.0
        for j in range(4):
            work[4, i] += step[i, j] * x[j]
            total = 0.0
            for m in range(4):
                total += step[i, m] * p[m, j]
            work[i, j] = total
    for i in range(4):
        x[i] = work[4, i]
        for j in range(4):
            total = noise[i, j] if touching else 0.0
            for m in range(4):
                total += work[i, m] * step[j, m]
            p[i, j] = total
    if not touching or begins:  # nothing pushes: force and its rate are zero, and known to be
        for i in range(2, 4):
            x[i] = 0.0
            for j in range(4):
                p[i, j] = 0.0
                p[j, i] = 0.0
    if begins:
        p[3, 3] = onset


@njit(cache=True)  # type: ignore[untyped-decorator]
def filter_reading(
    y: Array, touching: NDArray[np.bool_], step: Array, noise: Array, variance: float, onset: float
) -> tuple[float, Array, Array, Array, Array]:
    """Kalman filter: minus log likelihood; predictions (n, 4), (n, 4, 4); innovations (n,) x2."""
    n = y.size
    means, covariances = np.empty((n, 4)), np.empty((n, 4, 4))
    innovations, spreads = np.empty(n), np.empty(n)
    x, p = np.zeros(4), np.zeros((4, 4))
    p[0, 0] = p[1, 1] = variance
    if touching[0]:
        p[3, 3] = onset
    cost = 0.0
    gain, row, work = np.empty(4), np.empty(4), np.empty((5, 4))
    for k in range(n):
        if k > 0:
            begins = touching[k] and not touching[k - 1]
            _predict(x, p, step, noise, touching[k], begins, onset, work)
        for i in range(4):
            means[k, i] = x[i]
            for j in range(4):
                covariances[k, i, j] = p[i, j]
        spread = p[0, 0] + variance
        innovation = y[k] - x[0]
        cost += 0.5 * (innovation * innovation / spread + math.log(spread))
        innovations[k], spreads[k] = innovation, spread
        for i in range(4):
            gain[i], row[i] = p[i, 0] / spread, p[0, i]
        for i in range(4):
            x[i] += gain[i] * innovation
            for j in range(4):
                p[i, j] -= gain[i] * row[j]
    return cost, means, covariances, innovations, spreads


@njit(cache=True)  # type: ignore[untyped-decorator]
def smooth_reading(
    y: Array, touching: NDArray[np.bool_], step: Array, noise: Array, variance: float, onset: float
) -> tuple[Array, Array]:
    """Fixed-interval smoother (modified Bryson-Frazier): states (n, 4), variance of force (n,)."""
    n = y.size
    _, means, covariances, innovations, spreads = filter_reading(
        y, touching, step, noise, variance, onset
    )
    states, variances = np.empty((n, 4)), np.empty(n)
    adjoint, curvature = np.zeros(4), np.zeros((4, 4))
    update, transition = np.empty((4, 4)), np.empty((4, 4))
    for k in range(n - 1, -1, -1):
        p = covariances[k]
        for i in range(4):
            for j in range(4):
                update[i, j] = 1.0 if i == j else 0.0
            update[i, 0] -= p[i, 0] / spreads[k]
        adjoint = update.T @ adjoint
        curvature = update.T @ curvature @ update
        adjoint[0] -= innovations[k] / spreads[k]
        curvature[0, 0] += 1 / spreads[k]
        states[k] = means[k] - p @ adjoint
        row = p[2]
        variances[k] = p[2, 2] - row @ (curvature @ np.ascontiguousarray(row))
        if k > 0:
            transition[:] = step
            if not touching[k] or not touching[k - 1]:
                transition[2:] = 0.0
            adjoint = transition.T @ adjoint
            curvature = transition.T @ curvature @ transition
    return states, variances
