"""Adaptive integration with located events: contact made and lost, sticking and breaking away.

The explicit pair of Dormand and Prince (1980), order 5(4), with its continuous extension
(Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.6). Dry friction is
set-valued: at rest it is whatever keeps the plate at rest, up to the static force. Events are
located to 1e-15 s and the step is taken again up to them, so that no regime is overrun.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from impactscope.errors import InputError

from .bench import Bench, Pulse
from .equations import (
    APART,
    BACKWARD,
    BASE_STATES,
    FORWARD,
    FREE,
    STUCK,
    TOUCHING,
    derivatives,
    ladder,
    overlap,
    slip_friction,
)

__all__ = ['COLUMNS', 'integrate']

Array = NDArray[np.float64]

COLUMNS = (
    'force',  # N, elastic force of the spring
    'acceleration.plate',  # m/s²
    'acceleration.impactor',
    'acceleration.base',
    'displacement.plate',  # m
    'velocity.plate',  # m/s
    'contact',  # N, force of the impactor on the plate
)

_A = np.zeros((7, 7))
_A[1, :1] = 1 / 5
_A[2, :2] = 3 / 40, 9 / 40
_A[3, :3] = 44 / 45, -56 / 15, 32 / 9
_A[4, :4] = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
_A[5, :5] = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
_A[6, :6] = 35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
_C = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
_E = np.array(
    [71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40]
)  # fifth minus fourth order
_D = np.array(
    [
        -12715105075 / 11282082432,
        0,
        87487479700 / 32700410799,
        -10690763975 / 1880347072,
        701980252875 / 199316789632,
        -1453857185 / 822651844,
        69997945 / 29380423,
    ]
)  # the term of the continuous extension that makes it of order 4

_REACH = 1e-13  # m; a contact within this neither opens nor closes


@njit(cache=True)  # type: ignore[untyped-decorator]
def _step(
    t: float,
    h: float,
    y: Array,
    k: Array,
    p: Bench,
    contact: int,
    guide: int,
    pulses: Array,
    springs: Array,
    dashpots: Array,
    forces: Array,
    new: Array,
) -> float:
    """One step from ``y`` (whose derivative stands in k[0]) to ``new``; its scaled error."""
    n = y.size
    for stage in range(1, 7):
        for i in range(n):
            total = 0.0
            for j in range(stage):
                total += _A[stage, j] * k[j, i]
            new[i] = y[i] + h * total
        derivatives(
            t + _C[stage] * h, new, p, contact, guide, pulses, springs, dashpots, k[stage], forces
        )
    worst = 0.0
    for i in range(n):
        error = 0.0
        for j in range(7):
            error += _E[j] * k[j, i]
        speed = i in (1, 3, 5, 7)
        scale = (1e-9 if speed else 1e-12) + 1e-9 * max(abs(y[i]), abs(new[i]))
        worst = max(worst, abs(h * error) / scale)
    return worst


@njit(cache=True)  # type: ignore[untyped-decorator]
def _between(share: float, h: float, y: Array, new: Array, k: Array, out: Array) -> None:
    """State at a share of the step, by the continuous extension of order 4."""
    rest = 1.0 - share
    for i in range(y.size):
        rise = new[i] - y[i]
        bend = h * k[0, i] - rise
        tail = 0.0
        for j in range(7):
            tail += _D[j] * k[j, i]
        tail *= h
        turn = rise - h * k[6, i] - bend
        out[i] = y[i] + share * (rise + rest * (bend + share * (turn + rest * tail)))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _beyond(
    t: float,
    y: Array,
    p: Bench,
    contact: int,
    guide: int,
    pulses: Array,
    springs: Array,
    dashpots: Array,
    dy: Array,
    forces: Array,
) -> int:
    """Which regime this state has left: 0 none, 1 contact, 2 guide."""
    if p.impactor_mass > 0:
        reach = overlap(p, y)
        if contact == APART and reach > _REACH:
            return 1
        if contact == TOUCHING and p.unilateral > 0 and reach < -_REACH:
            return 1
    if guide in (FORWARD, BACKWARD):
        if (y[1] - y[3]) * guide < 0:
            return 2
    elif guide == STUCK:
        derivatives(t, y, p, contact, guide, pulses, springs, dashpots, dy, forces)
        way = FORWARD if forces[0] > 0 else BACKWARD
        if abs(forces[0]) > slip_friction(p, way, y[0] - y[2], 0.0):
            return 2
    return 0


@njit(cache=True)  # type: ignore[untyped-decorator]
def _run(
    p: Bench,
    y: Array,
    pulses: Array,
    springs: Array,
    dashpots: Array,
    breaks: Array,
    times: Array,
    longest: float,
    out: Array,
) -> int:
    """Integrate from t = 0 and fill ``out`` (n_times, 7); the number of steps, -1 if stuck."""
    n = y.size
    k = np.zeros((7, n))
    new = np.zeros(n)
    middle = np.zeros(n)
    dy = np.zeros(n)
    forces = np.zeros(3)
    dry = p.friction_forward > 0 or p.friction_backward > 0 or p.friction_slope > 0
    guide = STUCK if dry else FREE
    contact = TOUCHING if p.impactor_mass > 0 else APART
    t = 0.0
    h = 1e-6
    at = 0
    following = 0
    steps = 0
    if guide == STUCK and _beyond(
        t, y, p, contact, guide, pulses, springs, dashpots, dy, forces
    ):  # a plate let go from a deflection
        guide = FORWARD if forces[0] > 0 else BACKWARD
    elif guide == STUCK and y[1] != y[3]:
        guide = FORWARD if y[1] > y[3] else BACKWARD
    while at < times.size:
        steps += 1
        if steps > 2_000_000:
            return -1
        while following < breaks.size and breaks[following] <= t + 1e-14:
            following += 1
        ceiling = longest
        if following < breaks.size:
            ceiling = min(ceiling, breaks[following] - t)
        h = min(h, ceiling)
        derivatives(t, y, p, contact, guide, pulses, springs, dashpots, k[0], forces)
        error = _step(t, h, y, k, p, contact, guide, pulses, springs, dashpots, forces, new)
        if error > 1.0 and h > 1e-12:
            h *= max(0.2, 0.9 * error**-0.2)
            continue
        event = 0
        low = 0.0
        high = 1.0
        for part in range(1, 5):
            share = 0.25 * part
            _between(share, h, y, new, k, middle)
            event = _beyond(
                t + share * h, middle, p, contact, guide, pulses, springs, dashpots, dy, forces
            )
            if event:
                high = share
                break
            low = share
        taken = h
        if event:
            while (high - low) * h > 1e-15 and high - low > 1e-14:
                share = 0.5 * (low + high)
                _between(share, h, y, new, k, middle)
                found = _beyond(
                    t + share * h, middle, p, contact, guide, pulses, springs, dashpots, dy, forces
                )
                if found:
                    high = share
                    event = found
                else:
                    low = share
            taken = high * h
            _step(t, taken, y, k, p, contact, guide, pulses, springs, dashpots, forces, new)
        while at < times.size and times[at] <= t + taken:
            _between((times[at] - t) / taken, taken, y, new, k, middle)
            derivatives(
                times[at], middle, p, contact, guide, pulses, springs, dashpots, dy, forces
            )
            out[at, 0] = forces[1]
            out[at, 1] = dy[1]
            out[at, 2] = dy[5]
            out[at, 3] = dy[3]
            out[at, 4] = middle[0]
            out[at, 5] = middle[1]
            out[at, 6] = forces[2]
            at += 1
        t += taken
        y[:] = new
        if event == 1:
            contact = APART if contact == TOUCHING else TOUCHING
        elif event == 2:
            if guide == STUCK:
                derivatives(t, y, p, contact, guide, pulses, springs, dashpots, dy, forces)
                guide = FORWARD if forces[0] > 0 else BACKWARD
            else:
                y[1] = y[3]  # together to the last bit
                guide = STUCK
                if _beyond(t, y, p, contact, guide, pulses, springs, dashpots, dy, forces):
                    guide = FORWARD if forces[0] > 0 else BACKWARD
        if event:
            h = min(h, 1e-6)
        else:
            h *= min(5.0, 0.9 * max(error, 1e-10) ** -0.2)
    return steps


def integrate(
    bench: Bench,
    times: Array,
    *,
    pulses: Sequence[Pulse] = (),
    displacement: float = 0.0,
    velocity: float = 0.0,
    longest_step: float = 1e-3,
) -> Array:
    """Motion of the bench, sampled.

    Args:
        bench: the physics. With an impactor, time 0 is its first touch, at ``bench.speed``.
        times: s, ascending, not below 0; shape (n,).
        pulses: forces on the plate.
        displacement: of the plate at time 0, m.
        velocity: of the plate at time 0, m/s.
        longest_step: s.

    Returns:
        Shape (n, 7), columns as in ``COLUMNS``.

    Raises InputError where times are not ascending from 0 or the integration does not proceed.
    """
    times = np.ascontiguousarray(times, dtype=np.float64)
    if times.size and (times[0] < 0 or np.any(np.diff(times) < 0)):
        raise InputError(f'sample times begin at {times[0]!r} s or are not ascending')
    springs, dashpots, quick = ladder(bench)
    bench = bench._replace(damping=bench.damping + quick)
    state = np.zeros(BASE_STATES + springs.size)
    state[0], state[1] = displacement, velocity
    state[4] = displacement
    state[5] = state[7] = bench.speed if bench.impactor_mass > 0 else 0.0
    table = np.array([tuple(pulse) for pulse in pulses], dtype=np.float64).reshape(-1, 5)
    breaks = [*table[:, 0], *(table[:, 0] + table[:, 1])]
    if bench.push != 0:
        breaks += [bench.push_start, bench.push_start + bench.push_rise]
    out = np.empty((times.size, len(COLUMNS)))
    steps = _run(
        Bench(*(float(value) for value in bench)),
        state,
        table,
        springs,
        dashpots,
        np.array(sorted(breaks), dtype=np.float64),
        times,
        longest_step,
        out,
    )
    if steps < 0:
        raise InputError(f'the motion of {bench!r} could not be followed to {times[-1]} s')
    return out
