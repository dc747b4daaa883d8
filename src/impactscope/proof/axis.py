"""A machine axis: mass, viscous damping, a drive whose force a controller commands.

The command is calculated once a sample and stays until the next. Between samples the motion is
followed by Runge-Kutta steps of order 4 that end where the speed changes its sign; dry friction
is set-valued: at rest it is whatever keeps the axis at rest, up to the static force.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from impactscope.errors import InputError

from .bench import Bench
from .equations import BACKWARD, FORWARD, FREE, STUCK, slip_friction

__all__ = ['Law', 'Motion', 'between', 'follow', 'run_free']

Array = NDArray[np.float64]

_LONGEST = 1e-3  # s, of a step
_FINEST = 0.2  # rad of the quickest vibration in a step


class Law(NamedTuple):
    """Controller of an axis: force = gain kv (kp (reference - position) - speed)."""

    kp: float = 0.0  # 1/s
    kv: float = 0.0  # V s/m
    gain: float = 0.0  # N/V
    rate: float = 1000.0  # Hz, at which it calculates and everything is recorded


class Motion(NamedTuple):
    """States at the samples, and the commanded force that acts from each to the next."""

    position: Array  # m
    speed: Array  # m/s
    force: Array  # N


def follow(bench: Bench, law: Law, reference: Array, pulses: Array, before: int) -> Motion:
    """The axis in closed loop.

    Args:
        bench: the physics; its spring does not count.
        law: of the controller, which sees position and speed without noise.
        reference: m, one a sample.
        pulses: N, further command, one a sample.
        before: samples at the begin that are left out: until then the axis comes to rest.

    Raises InputError where the loop is not stable.
    """
    table = law.gain * law.kv * law.kp, law.gain * law.kv
    motion = _run(bench, law.rate, reference, pulses, table, 0.0, 0.0, before)
    farthest = 10 * max(float(np.abs(reference).max()), 0.1)
    if not np.abs(motion.position).max() < farthest:  # nor where it is not a number
        raise InputError(f'the axis of {bench!r} runs away from its reference')
    return Motion(*(part[before:] for part in motion))


def run_free(bench: Bench, law: Law, force: Array, position: float, speed: float) -> Motion:
    """The axis under a force that is given: the same model, the loop closed by the record."""
    return _run(bench, law.rate, np.zeros(force.size), force, (0.0, 0.0), position, speed, 0)


def between(motion: Motion, rate: float, t: Array) -> Array:
    """Position at any times (s from the first sample): cubic from state to state."""
    x, v = motion.position, motion.speed
    if t.size == x.size and t[0] == 0 and abs(t[-1] * rate - (x.size - 1)) < 1e-9 * x.size:
        return x  # at the samples themselves
    result = np.empty(t.size)
    _hermite(x, v, rate, np.ascontiguousarray(t), result)
    return result


@njit(cache=True)  # type: ignore[untyped-decorator]
def _hermite(x: Array, v: Array, rate: float, t: Array, out: Array) -> None:
    for i in range(t.size):
        place = t[i] * rate
        at = min(max(int(place), 0), x.size - 2)
        s = place - at
        first, last = v[at] / rate, v[at + 1] / rate
        if s < 0.0:  # beyond the record it goes straight on
            out[i] = x[at] + s * first
        elif s > 1.0:
            out[i] = x[at + 1] + (s - 1.0) * last
        else:
            rise = x[at + 1] - x[at]
            bend = 3.0 * rise - 2.0 * first - last + s * (first + last - 2.0 * rise)
            out[i] = x[at] + s * (first + s * bend)


def _run(
    bench: Bench,
    rate: float,
    reference: Array,
    added: Array,
    law: tuple[float, float],
    position: float,
    speed: float,
    before: int,
) -> Motion:
    quickest = 0.0
    if bench.base_mass > 0:
        quickest = 2 * math.pi * bench.base_frequency * math.sqrt(1 + bench.mass / bench.base_mass)
    if bench.stop_stiffness > 0:
        quickest = max(quickest, 4 * math.sqrt(bench.stop_stiffness / bench.mass))
    longest = min(_LONGEST, _FINEST / quickest) if quickest else _LONGEST
    parts = max(math.ceil(1 / (rate * longest) - 1e-9), 1)
    out = np.empty((3, reference.size))
    _steps(
        Bench(*(float(value) for value in bench)),
        1 / rate,
        parts,
        np.ascontiguousarray(reference),
        np.ascontiguousarray(added),
        *law,
        position,
        speed,
        -before / rate,
        out,
    )
    return Motion(out[0], out[1], out[2])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _level(p: Bench, side: int, t: float, x: float, v: float) -> float:
    """Size of the dry friction, N."""
    level: float = slip_friction(p, side, x, v)
    if p.fading > 0.0:
        level += p.fading * math.exp(-max(t, 0.0) / p.fading_time)
    return level


@njit(cache=True)  # type: ignore[untyped-decorator]
def _smooth(p: Bench, force: float, x: float, v: float) -> float:
    """Force on the axis without dry friction, N."""
    total = p.drive_gain * force + p.gravity_load - p.damping * v - p.restoring * x
    if v > 0:
        total -= p.quadratic_forward * v * v
    else:
        total += p.quadratic_backward * v * v
    total -= p.cubic * x * x * x
    if p.stop_stiffness > 0.0 and x > p.stop_travel:
        total -= p.stop_stiffness * (x - p.stop_travel)
    if p.ripple != 0.0:
        total += p.ripple * math.sin(2 * math.pi * x / p.ripple_pitch)
    return total


@njit(cache=True)  # type: ignore[untyped-decorator]
def _slopes(
    p: Bench, force: float, guide: int, t: float, x: float, v: float, b: float, u: float
) -> tuple[float, float]:
    """Acceleration of the axis on its base, and of the base (b, its speed u), m/s²."""
    held = 0.0
    if p.base_mass > 0.0:
        omega = 2 * math.pi * p.base_frequency
        held = -omega * (omega * b + 2 * p.base_damping * u)  # per mass of the base
    if guide == STUCK:
        if p.base_mass == 0.0:
            return 0.0, 0.0
        return 0.0, held * p.base_mass / (p.base_mass + p.mass)
    total = _smooth(p, force, x, v)
    if guide in (FORWARD, BACKWARD):
        total -= guide * _level(p, guide, t, x, v)
    if p.base_mass == 0.0:
        return total / p.mass, 0.0
    base = held - total / p.base_mass
    return total / p.mass - base, base


@njit(cache=True)  # type: ignore[untyped-decorator]
def _advance(
    p: Bench,
    force: float,
    guide: int,
    t: float,
    h: float,
    x: float,
    v: float,
    b: float,
    u: float,
) -> tuple[float, float, float, float]:
    """One step of order 4."""
    a1, c1 = _slopes(p, force, guide, t, x, v, b, u)
    v2, u2 = v + 0.5 * h * a1, u + 0.5 * h * c1
    a2, c2 = _slopes(p, force, guide, t + 0.5 * h, x + 0.5 * h * v, v2, b + 0.5 * h * u, u2)
    v3, u3 = v + 0.5 * h * a2, u + 0.5 * h * c2
    a3, c3 = _slopes(p, force, guide, t + 0.5 * h, x + 0.5 * h * v2, v3, b + 0.5 * h * u2, u3)
    v4, u4 = v + h * a3, u + h * c3
    a4, c4 = _slopes(p, force, guide, t + h, x + h * v3, v4, b + h * u3, u4)
    return (
        x + h * (v + 2 * v2 + 2 * v3 + v4) / 6,
        v + h * (a1 + 2 * a2 + 2 * a3 + a4) / 6,
        b + h * (u + 2 * u2 + 2 * u3 + u4) / 6,
        u + h * (c1 + 2 * c2 + 2 * c3 + c4) / 6,
    )


@njit(cache=True)  # type: ignore[untyped-decorator]
def _from_rest(p: Bench, force: float, t: float, x: float, b: float, u: float) -> int:
    """Which way an axis without speed goes, or that it stays."""
    pull = _smooth(p, force, x, 0.0)
    if p.base_mass > 0.0:  # the base's own motion drags it along
        omega = 2 * math.pi * p.base_frequency
        held = -omega * (omega * b + 2 * p.base_damping * u)
        pull -= held * p.base_mass * p.mass / (p.base_mass + p.mass)
    side = FORWARD if pull > 0 else BACKWARD
    return side if abs(pull) > _level(p, side, t, x, 0.0) else STUCK


@njit(cache=True)  # type: ignore[untyped-decorator]
def _steps(
    p: Bench,
    dt: float,
    parts: int,
    reference: Array,
    added: Array,
    stiff: float,
    damp: float,
    x: float,
    v: float,
    begin: float,
    out: Array,
) -> None:
    dry = p.friction_forward > 0 or p.friction_backward > 0 or p.friction_slope > 0
    dry = dry or p.fading > 0
    guide = FREE
    b, u = 0.0, 0.0
    if dry:
        guide = STUCK if v == 0.0 else (FORWARD if v > 0 else BACKWARD)
    for k in range(reference.size):
        # as it is recorded: nothing acts that is not in the file
        force = float(np.float32(stiff * (reference[k] - x) - damp * v + added[k]))
        out[0, k], out[1, k], out[2, k] = x, v, force
        for part in range(parts):
            t = begin + (k + part / parts) * dt
            left = dt / parts
            for _ in range(20):  # regimes in one step; more only in numerical dust
                if guide == STUCK:
                    guide = _from_rest(p, force, t, x, b, u)
                y, w, c, d = _advance(p, force, guide, t, left, x, v, b, u)
                if guide not in (FORWARD, BACKWARD) or w * guide >= 0:
                    x, v, b, u = y, w, c, d
                    break
                low, high = 0.0, left
                while high - low > 1e-15:
                    h = 0.5 * (low + high)
                    y, w, c, d = _advance(p, force, guide, t, h, x, v, b, u)
                    if w * guide < 0:
                        high = h
                    else:
                        low = h
                x, v, b, u = _advance(p, force, guide, t, high, x, v, b, u)
                v = 0.0
                t += high
                left -= high
                guide = STUCK
                if left <= 1e-15:
                    break
