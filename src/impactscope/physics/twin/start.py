"""How a run begins: the approach, the state at first contact, and corners of drives; compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impactscope.physics.mechanisms.compiled import borrowed, compiled
from impactscope.physics.twin import layout as at

__all__ = ['approach', 'corners', 'start']

Array = NDArray[np.float64]


@compiled
def approach(par: Array, times: Array, rows: Array) -> None:
    """Fill the impactor's columns of ``rows``, shape (n_times, n_columns), before first contact.

    ``times``: below zero, s from first contact, shape (n_times,). Released at rest where a weight
    draws it on: a swing is held at its highest point until then, a fall where it began.
    """
    par, times, rows = borrowed(par), borrowed(times), borrowed(rows)
    mass = par[at.IMPACTOR_MASS] + par[at.SECOND_MASS]
    speed = par[at.IMPACT_SPEED]
    swings = par[at.RESTORING] > 0.0 and par[at.LOAD] == 0.0
    omega = math.sqrt(par[at.RESTORING] / mass) if swings else 0.0
    pull = par[at.LOAD] / mass if par[at.LOAD] > 0.0 else 0.0
    for i in range(times.size):
        t = times[i]
        position, velocity, acceleration = speed * t, speed, 0.0
        if swings:
            phase = max(omega * t, -0.5 * math.pi)
            position, velocity = speed / omega * math.sin(phase), speed * math.cos(phase)
            if omega * t > phase - 1e-12:
                acceleration = -omega * speed * math.sin(phase)
        elif pull > 0.0:
            since = max(t, -speed / pull)
            position, velocity = speed * since + 0.5 * pull * since**2, speed + pull * since
            acceleration = pull if t >= since else 0.0
        rows[i, at.IMPACTOR_POSITION] = position
        rows[i, at.IMPACTOR_VELOCITY] = velocity
        rows[i, at.IMPACTOR_ACCELERATION] = acceleration


@compiled
def corners(par: Array) -> Array:
    """Rising times at which a drive has a corner, s."""
    samples = par.size - at.EXCITATION - 1 if par[at.EXCITATION_RATE] > 0.0 else 0
    times = np.empty(8 + max(samples, 0))
    times[0] = par[at.TAP_DURATION]
    times[1] = par[at.CATCH_TIME]
    times[2] = par[at.LIFT_START]
    times[3] = par[at.LIFT_START] + par[at.LIFT_RISE]
    count = 4
    if par[at.PUSH_FORCE] != 0.0:
        edge = par[at.PUSH_START]
        for width in (0.0, par[at.PUSH_RISE], par[at.PUSH_HOLD], par[at.PUSH_FALL]):
            edge += width
            times[count] = edge
            count += 1
    for i in range(samples):
        times[count] = (i + 1) / par[at.EXCITATION_RATE]
        count += 1
    times = times[:count]
    return np.unique(times[(times > 0.0) & (times < math.inf)])


@compiled
def start(par: Array) -> tuple[Array, int]:
    """State at first contact, shape (N_STATES + branches,), and the contact mode."""
    state = np.zeros(at.N_STATES + int(par[at.BRANCHES]))
    if par[at.IMPACTOR_MASS] == 0.0:
        return state, at.GONE
    state[at.VP] = par[at.IMPACT_SPEED]
    if par[at.SECOND_MASS] > 0.0:
        state[at.VQ] = par[at.IMPACT_SPEED]
    return state, at.CLOSED
