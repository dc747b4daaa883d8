"""Steps of Dormand and Prince's pair of order 5(4), and its dense output of order 4; compiled.

Sources: Dormand and Prince, J. Comput. Appl. Math. 6 (1980); Shampine, Math. Comp. 46 (1986) for
the dense output; Hairer, Norsett and Wanner, Solving ODEs I, II.4 to II.6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impactscope.physics.mechanisms.compiled import borrowed, compiled, law
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.equations import derivative

__all__ = ['dense_state', 'felt', 'local_error', 'prepare_dense', 'step']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

# nodes of the stages, and Shampine's dense output by powers of the share; the second stage, and
# the last as the first of the next step, have no weight there
_DENSE = np.array([
    [1.0, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432],
    [0.0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799],
    [0.0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072],
    [0.0, 127303824393 / 49829197408, -318862633887 / 49829197408, 701980252875 / 199316789632],
    [0.0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844],
    [0.0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423],
])  # fmt: skip


@compiled
def step(
    par: Array,
    t: float,
    h: float,
    y: Array,
    contact: int,
    guide: int,
    moving: IntArray,
    k: Array,
    y_new: Array,
) -> None:
    """One step from ``y`` (its rate in ``k[0]``) to ``y_new``; fills the stages ``k``.

    What is not among ``moving`` stays as it is in ``y_new``.
    """
    par, y, moving, k, y_new = (
        borrowed(par),
        borrowed(y),
        borrowed(moving),
        borrowed(k),
        borrowed(y_new),
    )
    for i in moving:
        y_new[i] = y[i] + h * 0.2 * k[0, i]
    derivative(par, t + 0.2 * h, y_new, contact, guide, k[1])
    for i in moving:
        y_new[i] = y[i] + h * (3 / 40 * k[0, i] + 9 / 40 * k[1, i])
    derivative(par, t + 0.3 * h, y_new, contact, guide, k[2])
    for i in moving:
        y_new[i] = y[i] + h * (44 / 45 * k[0, i] - 56 / 15 * k[1, i] + 32 / 9 * k[2, i])
    derivative(par, t + 0.8 * h, y_new, contact, guide, k[3])
    for i in moving:
        slope = 19372 / 6561 * k[0, i] - 25360 / 2187 * k[1, i]
        y_new[i] = y[i] + h * (slope + 64448 / 6561 * k[2, i] - 212 / 729 * k[3, i])
    derivative(par, t + 8 / 9 * h, y_new, contact, guide, k[4])
    for i in moving:
        slope = 9017 / 3168 * k[0, i] - 355 / 33 * k[1, i] + 46732 / 5247 * k[2, i]
        y_new[i] = y[i] + h * (slope + 49 / 176 * k[3, i] - 5103 / 18656 * k[4, i])
    derivative(par, t + h, y_new, contact, guide, k[5])
    for i in moving:
        slope = 35 / 384 * k[0, i] + 500 / 1113 * k[2, i] + 125 / 192 * k[3, i]
        y_new[i] = y[i] + h * (slope - 2187 / 6784 * k[4, i] + 11 / 84 * k[5, i])
    derivative(par, t + h, y_new, contact, guide, k[6])


@law
def felt(place: int) -> float:
    """Size from which a number of the state matters, m/s or m."""
    return 0.05 if place in (at.V, at.VP, at.VQ, at.VB) else 2e-4


@compiled
def local_error(
    h: float, y: Array, y_new: Array, moving: IntArray, k: Array, tolerance: float
) -> float:
    """Largest local error over what is tolerated, of energies a hundred times as much.

    A contact whose loss ends it with a corner of its force is booked as exactly as it moves.
    """
    y, y_new, moving, k = borrowed(y), borrowed(y_new), borrowed(moving), borrowed(k)
    worst = 0.0
    for i in moving:
        total = 71 / 57600 * k[0, i] - 71 / 16695 * k[2, i] + 71 / 1920 * k[3, i]
        total += 22 / 525 * k[5, i] - 17253 / 339200 * k[4, i] - 1 / 40 * k[6, i]
        scale = tolerance * (felt(i) + max(abs(y[i]), abs(y_new[i])))
        if i in (at.LOST, at.WORK):
            scale *= 1e2
        worst = max(worst, abs(h * total) / scale)
    return worst


@compiled
def prepare_dense(moving: IntArray, k: Array, dense: Array) -> None:
    """Coefficients of the dense output by powers of the share, from the stages of a step."""
    moving, k, dense = borrowed(moving), borrowed(k), borrowed(dense)
    for i in moving:
        for power in range(4):
            total = _DENSE[0, power] * k[0, i]
            for j in range(1, 6):
                total += k[j + 1, i] * _DENSE[j, power]
            dense[i, power] = total


@compiled
def dense_state(
    y: Array, h: float, moving: IntArray, dense: Array, share: float, out: Array
) -> None:
    """State at ``share`` of the step, on the dense output; what does not move is left alone."""
    y, moving, dense, out = borrowed(y), borrowed(moving), borrowed(dense), borrowed(out)
    for i in moving:
        slope = dense[i, 2] + share * dense[i, 3]
        slope = dense[i, 0] + share * (dense[i, 1] + share * slope)
        out[i] = y[i] + h * share * slope
