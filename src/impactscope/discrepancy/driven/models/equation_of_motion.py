"""Equation of motion of one degree of freedom with every law at once; exact sticking; compiled.

Last, that of a structure of several modes with such laws at places of it (:func:`run_modes`).

Runge and Kutta's method of order 4 on sub-steps of the sampling period. Dry friction is
set-valued: the moment at which sliding ends is located inside the sub-step, the mass then rests
until the force on it exceeds what friction can hold, and that moment is located as well. Nothing
creeps. Source of the friction laws: Olsson et al., Eur. J. Control 4 (1998).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.compiled import compiled, law
from impactscope.discrepancy.driven.models.parameter_layout import (
    BASE_DAMPING,
    BASE_MASS,
    BASE_REACTS,
    BASE_STIFFNESS,
    CUBIC,
    DAMPING,
    GAP,
    HYSTERESIS_CLOSING,
    HYSTERESIS_LEANING,
    HYSTERESIS_STIFFNESS,
    INPUT_OFFSET,
    KINETIC_BACKWARD,
    KINETIC_FORWARD,
    MASS,
    QUADRATIC_DAMPING,
    SINE,
    SINE_ZERO,
    SKEW_DAMPING,
    SQUARE,
    STATIC_EXCESS,
    STIFFNESS,
    STOP_ONE_WAY,
    STOP_STIFFNESS,
    STOP_TRAVEL,
    STRIBECK_SPEED,
    WEIGHT_COSINE,
    WEIGHT_SINE,
)
from impactscope.physics.mechanisms.compiled import borrowed

__all__ = [
    'lost_motion',
    'restoring',
    'run',
    'run_modes',
    'run_on_base',
    'slider_force',
    'smooth_force',
]

Array = NDArray[np.float64]

MOST_TURNS = 6  # turns and stops located in one sub-step
MOST_TRIES = 30  # by which each is located ...
AT_REST = 1e-12  # ... to this share of the speeds about a turn, or of the loads about a start
FAR = 1e9  # a state beyond this has run away
SWEEPS = 3  # in which the elements of a structure and its motion agree on the end of a step
FREE = 2  # in the place of a direction of sliding: no dry friction at all


@law
def lost_motion(x: float, gap: float) -> float:
    """What is left of ``x`` once a whole play of ``gap`` is taken up."""
    half = 0.5 * gap
    if x > half:
        return x - half
    if x < -half:
        return x + half
    return 0.0


@law
def restoring(p: Array, x: float) -> float:
    """Force that depends on the position alone, against it."""
    w = math.sin(x - p[SINE_ZERO]) if p[SINE] > 0.5 else x
    if p[GAP] > 0.0:
        w = lost_motion(w, p[GAP])
    force = w * (p[STIFFNESS] + w * (p[SQUARE] + w * p[CUBIC]))
    if p[STOP_STIFFNESS] > 0.0 and (x > 0.0 or p[STOP_ONE_WAY] < 0.5):
        force += p[STOP_STIFFNESS] * lost_motion(x, 2.0 * p[STOP_TRAVEL])
    if p[WEIGHT_SINE] != 0.0 or p[WEIGHT_COSINE] != 0.0:
        force += p[WEIGHT_SINE] * math.sin(x) + p[WEIGHT_COSINE] * math.cos(x)
    return float(force)


@law
def _load(p: Array, u: float, x: float, v: float, h: float) -> float:
    """Force on the mass without dry friction."""
    force = u + p[INPUT_OFFSET] - p[DAMPING] * v - restoring(p, x)
    force -= abs(v) * (p[SKEW_DAMPING] + p[QUADRATIC_DAMPING] * v)
    return float(force - p[HYSTERESIS_STIFFNESS] * h)


@law
def _friction(p: Array, v: float, way: int) -> float:
    """Force of dry friction on a mass that slides ``way`` (+1, -1)."""
    level = p[KINETIC_FORWARD] if way > 0 else p[KINETIC_BACKWARD]
    if p[STATIC_EXCESS] > 0.0:
        level += p[STATIC_EXCESS] * math.exp(-((v / p[STRIBECK_SPEED]) ** 2))
    return float(-way * level)


@law
def _rate(p: Array, u: float, x: float, v: float, h: float, way: int) -> float:
    force = _load(p, u, x, v, h)
    if way != 0:
        force += _friction(p, v, way)
    return float(force / p[MASS])


@law
def _towards(h: float, way: float, travel: float, rate: float) -> float:
    """Elongation after a travel without change of sign: dh/du = way - rate h, exactly."""
    if abs(rate * travel) < 1e-9:
        return h + (way - rate * h) * travel
    final = way / rate
    return final + (h - final) * math.exp(-max(min(rate * travel, 700.0), -50.0))


@law
def yielded(h: float, moved: float, closing: float, leaning: float) -> float:
    """Elongation of Bouc's element (n = 1) after a displacement ``moved``, exactly.

    It depends on the path alone: dh/du = s - (closing + leaning s sign h) h along the travel u
    in direction s. An explicit step in time would blow up where the element yields within it.
    """
    way = 1.0 if moved > 0.0 else -1.0
    travel = abs(moved)
    if h * way < 0.0:
        rate = closing - leaning
        left = 1.0 + rate * abs(h)
        if left <= 0.0:
            return _towards(h, way, travel, rate)
        to_zero = abs(h) if abs(rate * h) < 1e-9 else math.log(left) / rate
        if travel <= to_zero:
            return _towards(h, way, travel, rate)
        h, travel = 0.0, travel - to_zero
    return _towards(h, way, travel, closing + leaning)


@law
def _elongation(p: Array, h: float, moved: float) -> float:
    """Elongation of the hysteretic element after a displacement: its path alone decides.

    Followed as a rate in time it would be lost where it yields within a small part of a step.
    """
    if p[HYSTERESIS_STIFFNESS] == 0.0:
        return h
    return yielded(h, moved, p[HYSTERESIS_CLOSING], p[HYSTERESIS_LEANING])


@compiled
def _step(
    p: Array, u0: float, um: float, u1: float, x: float, v: float, h: float, way: int, dt: float
) -> tuple[float, float, float]:
    """One step of order 4 while the direction of sliding stays."""
    p = borrowed(p)
    a1 = _rate(p, u0, x, v, h, way)
    x2, v2 = x + 0.5 * dt * v, v + 0.5 * dt * a1
    a2 = _rate(p, um, x2, v2, _elongation(p, h, x2 - x), way)
    x3, v3 = x + 0.5 * dt * v2, v + 0.5 * dt * a2
    a3 = _rate(p, um, x3, v3, _elongation(p, h, x3 - x), way)
    x4, v4 = x + dt * v3, v + dt * a3
    a4 = _rate(p, u1, x4, v4, _elongation(p, h, x4 - x), way)
    moved = dt * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0
    return (
        x + moved,
        v + dt * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0,
        _elongation(p, h, moved),
    )


@law
def _base_rate(p: Array, pull: float, xb: float, vb: float) -> float:
    """Acceleration of a base that the mass's suspension, or its drive, pulls with ``pull``."""
    return float((pull - p[BASE_DAMPING] * vb - p[BASE_STIFFNESS] * xb) / p[BASE_MASS])


@compiled
def _soft_rates(
    p: Array, u: float, x: float, v: float, h: float, xb: float, vb: float, way: int
) -> tuple[float, float]:
    """Rates of the relative speed and the base's speed.

    ``way``: in which the mass slides on its base (+1, -1), 0 where friction holds it there, FREE
    without dry friction.
    """
    force = _load(p, u, x, v, h)
    if way == 1 or way == -1:
        force += _friction(p, v, way)
    pull = -force if p[BASE_REACTS] > 0.5 else u + p[INPUT_OFFSET] - force
    base = _base_rate(p, pull, xb, vb)
    apart = force / p[MASS] - base
    if way == 0:  # what friction must hold so that both move as one
        return 0.0, base + apart / (1.0 + p[BASE_MASS] / p[MASS])
    return apart, base


@law
def _soft_load(p: Array, u: float, state: tuple[float, float, float, float, float]) -> float:
    """Force that dry friction must hold so that a mass rests on its base."""
    x, _, h, xb, vb = state
    apart, _ = _soft_rates(p, u, x, 0.0, h, xb, vb, FREE)
    return float(apart / (1.0 / p[MASS] + 1.0 / p[BASE_MASS]))


@compiled
def _soft_step(
    p: Array,
    u: tuple[float, float, float],
    state: tuple[float, float, float, float, float],
    way: int,
    dt: float,
) -> tuple[float, float, float, float, float]:
    """One step of order 4 on a base that gives way, while the direction of sliding stays."""
    p = borrowed(p)
    x, v, h, xb, vb = state
    a1, b1 = _soft_rates(p, u[0], x, v, h, xb, vb, way)
    s = 0.5 * dt
    x2, v2, w2 = x + s * v, v + s * a1, vb + s * b1
    a2, b2 = _soft_rates(p, u[1], x2, v2, _elongation(p, h, x2 - x), xb + s * vb, w2, way)
    x3, v3, w3 = x + s * v2, v + s * a2, vb + s * b2
    a3, b3 = _soft_rates(p, u[1], x3, v3, _elongation(p, h, x3 - x), xb + s * w2, w3, way)
    x4, v4, w4 = x + dt * v3, v + dt * a3, vb + dt * b3
    a4, b4 = _soft_rates(p, u[2], x4, v4, _elongation(p, h, x4 - x), xb + dt * w3, w4, way)
    moved = dt * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0
    return (
        x + moved,
        v + dt * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0,
        _elongation(p, h, moved),
        xb + dt * (vb + 2.0 * w2 + 2.0 * w3 + w4) / 6.0,
        vb + dt * (b1 + 2.0 * b2 + 2.0 * b3 + b4) / 6.0,
    )


@law
def _between(u0: float, um: float, u1: float, s: float) -> float:
    """Input at share ``s`` of a sub-step: the parabola through its three values."""
    return u0 + s * (4.0 * um - 3.0 * u0 - u1 + s * (2.0 * u0 - 4.0 * um + 2.0 * u1))


@law
def _held(p: Array, load: float) -> int:
    """0 where friction holds a resting mass, else the way in which it sets off."""
    if load > p[KINETIC_FORWARD] + p[STATIC_EXCESS]:
        return 1
    if load < -(p[KINETIC_BACKWARD] + p[STATIC_EXCESS]):
        return -1
    return 0


@law
def _sets_off(
    u: tuple[float, float, float], up: float, down: float, done: float
) -> tuple[float, int]:
    """Share of a sub-step, after ``done``, at which a resting mass sets off, and which way.

    There the parabola of the input rises above ``up`` or falls below ``down``; 1 and 0 where it
    does neither.
    """
    bend = 2.0 * (u[0] - 2.0 * u[1] + u[2])
    slope = 4.0 * u[1] - 3.0 * u[0] - u[2]
    first, which = 1.0, 0
    for way in (1, -1):
        under = u[0] - (up if way > 0 else down)
        square = slope * slope - 4.0 * bend * under
        if square < 0.0:
            continue
        root = way * math.sqrt(square)  # the parabola's slope where it crosses this way
        if slope * way > 0.0:
            share = -2.0 * under / (slope + root)
        elif bend != 0.0:
            share = 0.5 * (root - slope) / bend
        else:
            continue
        if done < share < first:
            first, which = share, way
    return first, which


@law
def _nearer(
    low: float, f_low: float, high: float, f_high: float, side: int, at: float, value: float
) -> tuple[float, float, float, float, int]:
    """A bracket about a zero, its high end below, with a further value (Illinois method).

    ``side``: of the end that moved last, which the result tells anew; 0 at first. As
    ``narrowed`` of :mod:`impactscope.physics.twin.crossings`, which has a cache of its own.
    """
    if value < 0.0:
        return low, 0.5 * f_low if side == -1 else f_low, at, value, -1
    return at, value, high, 0.5 * f_high if side == 1 else f_high, 1


@law
def _tried(low: float, f_low: float, high: float, f_high: float) -> float:
    """Where a bracket about a turn is tried next: where its chord says, else nearer its begin."""
    if f_low > 0.0:
        return high - f_high * (high - low) / (f_high - f_low)
    return 0.5 * (low + high)  # it has just set off: where it comes back is yet to be seen


@compiled
def _rough_step(
    p: Array, u0: float, um: float, u1: float, x: float, v: float, h: float, way: int, dt: float
) -> tuple[float, float, float, int]:
    """One sub-step with dry friction: as many turns, stops and starts as fall into it."""
    p = borrowed(p)
    u = (u0, um, u1)
    forward, backward = (
        p[KINETIC_FORWARD] + p[STATIC_EXCESS],
        p[KINETIC_BACKWARD] + p[STATIC_EXCESS],
    )
    done = 0.0
    rests = False  # whatever friction could hold right now
    for _ in range(MOST_TURNS):
        left = 1.0 - done
        if left <= 1e-12:
            break
        a = _between(u0, um, u1, done)
        if way == 0:
            rest = _load(p, 0.0, x, 0.0, h)
            if not rests:
                way = _held(p, rest + a)
            if way == 0:
                done, way = _sets_off(u, forward - rest, -backward - rest, done)
                if way == 0:
                    return x, 0.0, h, 0
                rests = False
                continue
        m = _between(u0, um, u1, done + 0.5 * left)
        x1, v1, h1 = _step(p, a, m, u1, x, v, h, way, left * dt)
        if v1 * way >= 0.0:
            return x1, v1, h1, way
        near = AT_REST * (abs(v) + abs(v1))
        low, f_low, high, f_high, side = 0.0, max(v * way, 0.0), 1.0, v1 * way, 0
        share, slid = 0.0, v * way > 0.0
        for _ in range(MOST_TRIES):
            share = _tried(low, f_low, high, f_high)
            m = _between(u0, um, u1, done + 0.5 * share * left)
            b = _between(u0, um, u1, done + share * left)
            x1, v1, h1 = _step(p, a, m, b, x, v, h, way, share * left * dt)
            low, f_low, high, f_high, side = _nearer(
                low, f_low, high, f_high, side, share, v1 * way
            )
            slid |= v1 * way > 0.0
            if slid and abs(v1) <= near:
                break
        if slid:
            x, h = x1, h1
            done += share * left
            way = _held(p, _load(p, _between(u0, um, u1, done), x, 0.0, h))
        else:  # it would set off and be held again at once
            way = 0
        rests = way == 0
        v = 0.0
    return x, v, h, way


@compiled
def _rough_soft_step(
    p: Array,
    u: tuple[float, float, float],
    state: tuple[float, float, float, float, float],
    way: int,
    dt: float,
) -> tuple[tuple[float, float, float, float, float], int]:
    """One sub-step of :func:`_rough_step` on a base that gives way, and the way after it."""
    p = borrowed(p)
    u0, um, u1 = u
    done = 0.0
    rests = False  # whatever friction could hold right now
    for _ in range(MOST_TURNS):
        left = 1.0 - done
        if left <= 1e-12:
            break
        a = _between(u0, um, u1, done)
        m = _between(u0, um, u1, done + 0.5 * left)
        if way == 0:
            start = _soft_load(p, a, state)
            if not rests:
                way = _held(p, start)
            rests = False
            if way == 0:
                rested = _soft_step(p, (a, m, u1), state, 0, left * dt)
                end = _soft_load(p, u1, rested)
                way = _held(p, end)
                if way == 0:
                    return rested, 0
                limit = p[STATIC_EXCESS]
                limit += p[KINETIC_FORWARD] if way > 0 else p[KINETIC_BACKWARD]
                near = AT_REST * (abs(start) + abs(end))
                low, f_low, high, f_high, side = (
                    0.0,
                    limit - way * start,
                    1.0,
                    limit - way * end,
                    0,
                )
                share = 1.0
                for _ in range(MOST_TRIES):
                    share = _tried(low, f_low, high, f_high)
                    m = _between(u0, um, u1, done + 0.5 * share * left)
                    b = _between(u0, um, u1, done + share * left)
                    rested = _soft_step(p, (a, m, b), state, 0, share * left * dt)
                    spare = limit - way * _soft_load(p, b, rested)
                    low, f_low, high, f_high, side = _nearer(
                        low, f_low, high, f_high, side, share, spare
                    )
                    if abs(spare) <= near:
                        break
                state = rested
                done += share * left
                continue
        moved = _soft_step(p, (a, m, u1), state, way, left * dt)
        if moved[1] * way >= 0.0:
            return moved, way
        v, v1 = state[1], moved[1]
        near = AT_REST * (abs(v) + abs(v1))
        low, f_low, high, f_high, side = 0.0, max(v * way, 0.0), 1.0, v1 * way, 0
        share, slid = 0.0, v * way > 0.0
        for _ in range(MOST_TRIES):
            share = _tried(low, f_low, high, f_high)
            m = _between(u0, um, u1, done + 0.5 * share * left)
            b = _between(u0, um, u1, done + share * left)
            moved = _soft_step(p, (a, m, b), state, way, share * left * dt)
            low, f_low, high, f_high, side = _nearer(
                low, f_low, high, f_high, side, share, moved[1] * way
            )
            slid |= moved[1] * way > 0.0
            if slid and abs(moved[1]) <= near:
                break
        if slid:
            state = moved
            done += share * left
            way = _held(p, _soft_load(p, _between(u0, um, u1, done), state))
        else:  # it would set off and be held again at once
            way = 0
        rests = way == 0
        state = (state[0], 0.0, state[2], state[3], state[4])
    return state, way


@law
def _linear(p: Array) -> bool:
    """Whether nothing but dry friction of one level a way keeps the mass from being linear."""
    spring = p[SQUARE] != 0.0 or p[CUBIC] != 0.0 or p[GAP] > 0.0 or p[STOP_STIFFNESS] > 0.0
    damper = p[QUADRATIC_DAMPING] != 0.0 or p[SKEW_DAMPING] != 0.0 or p[STATIC_EXCESS] > 0.0
    weight = p[SINE] > 0.5 or p[WEIGHT_SINE] != 0.0 or p[WEIGHT_COSINE] != 0.0
    return not (spring or damper or weight or p[HYSTERESIS_STIFFNESS] != 0.0)


@compiled
def _linear_step(p: Array, dt: float) -> Array:
    """What :func:`_step` makes of a linear mass, shape (2, 5).

    Position and speed after a step by position and speed before it, and by the force at its
    beginning, in its middle and at its end.
    """
    bare = p.copy()
    bare[INPUT_OFFSET] = 0.0
    made = np.zeros((2, 5))
    for k in range(5):
        y = np.zeros(5)
        y[k] = 1.0
        made[0, k], made[1, k], _ = _step(bare, y[2], y[3], y[4], y[0], y[1], 0.0, 0, dt)
    return made


@law
def _straight_step(
    a: Array, x: float, v: float, f0: float, fm: float, f1: float
) -> tuple[float, float]:
    """A step of a linear mass under a force."""
    x1 = a[0, 0] * x + a[0, 1] * v + a[0, 2] * f0 + a[0, 3] * fm + a[0, 4] * f1
    v1 = a[1, 0] * x + a[1, 1] * v + a[1, 2] * f0 + a[1, 3] * fm + a[1, 4] * f1
    return x1, v1


@compiled
def _linear_soft_step(p: Array, way: int, dt: float) -> Array:
    """What :func:`_soft_step` makes of a linear mass on its base, shape (5, 8).

    Position and speed of the mass, position and speed of the base after a step by the same before
    it, by the input at its beginning, in its middle and at its end, and by a constant force
    between the two; last the force that friction must hold before the step so that both rest on
    each other, see :func:`_soft_load`. ``way``: 1 for a mass that slides, 0 for one that rests.
    """
    bare = p.copy()
    bare[INPUT_OFFSET] = 0.0
    bare[KINETIC_FORWARD] = bare[KINETIC_BACKWARD] = 0.0
    made = np.zeros((5, 8))
    for k in range(8):
        y = np.zeros(8)
        y[k] = 1.0
        state = (y[0], y[1], 0.0, y[2], y[3])
        made[4, k] = _soft_load(bare, y[4], state)
        bare[KINETIC_FORWARD] = -y[7]  # a friction that pushes by one
        moved = _soft_step(bare, (y[4], y[5], y[6]), state, way, dt)
        made[0, k], made[1, k], made[2, k], made[3, k] = moved[0], moved[1], moved[3], moved[4]
    return made


@law
def _straight_row(
    a: Array, i: int, y: tuple[float, float, float, float], u: tuple[float, float, float], f: float
) -> float:
    """One row of a step of a linear mass on its base."""
    moved = a[i, 0] * y[0] + a[i, 1] * y[1] + a[i, 2] * y[2] + a[i, 3] * y[3]
    return float(moved + a[i, 4] * u[0] + a[i, 5] * u[1] + a[i, 6] * u[2] + a[i, 7] * f)


@compiled
def run_on_base(p: Array, u: Array, dt: float, x: float, v: float, out: Array) -> bool:
    """As :func:`run`, on a base that gives way; the mass slides and sticks on that.

    ``out``: position and speed relative to the base, acceleration of the mass, elongation.
    """
    p, u, out = borrowed(p), borrowed(u), borrowed(out)
    n = out.shape[0]
    steps = (u.shape[1] - 1) // 2
    rough = p[KINETIC_FORWARD] != 0.0 or p[KINETIC_BACKWARD] != 0.0 or p[STATIC_EXCESS] > 0.0
    way = FREE
    if rough:
        way = 0
        if v != 0.0:
            way = 1 if v > 0.0 else -1
    plain = _linear(p)
    slid = _linear_soft_step(p, 1, dt / steps) if plain else np.zeros((5, 8))
    rested = _linear_soft_step(p, 0, dt / steps) if plain and rough else slid
    sliding, resting = borrowed(slid), borrowed(rested)
    offset = p[INPUT_OFFSET]
    state = (x, v, 0.0, 0.0, 0.0)
    for i in range(n):
        first = u[i, 0] if i < n - 1 else u[n - 2, 2 * steps]
        out[i, 0], out[i, 1], out[i, 3] = state[0], state[1], state[2]
        now = way
        if way == 0:
            now = _held(p, _soft_load(p, first, state))
        apart, base = _soft_rates(p, first, state[0], state[1], state[2], state[3], state[4], now)
        out[i, 2] = apart + base
        if i == n - 1:
            break
        for j in range(steps):
            inside = (u[i, 2 * j], u[i, 2 * j + 1], u[i, 2 * j + 2])
            if plain:
                # as long as it slides one way its friction is a constant force, at rest none
                rub = 0.0
                if way == 1:
                    rub = -p[KINETIC_FORWARD]
                elif way == -1:
                    rub = p[KINETIC_BACKWARD]
                a = sliding if way != 0 else resting
                y = (state[0], state[1], state[3], state[4])
                f = (inside[0] + offset, inside[1] + offset, inside[2] + offset)
                x1, v1 = _straight_row(a, 0, y, f, rub), _straight_row(a, 1, y, f, rub)
                xb, vb = _straight_row(a, 2, y, f, rub), _straight_row(a, 3, y, f, rub)
                stays = way == FREE or (way != 0 and v1 * way >= 0.0)
                if way == 0 and state[1] == 0.0:
                    end = (f[2], 0.0, 0.0)
                    stays = _held(p, _straight_row(a, 4, y, f, 0.0)) == 0
                    stays &= _held(p, _straight_row(a, 4, (x1, 0.0, xb, vb), end, 0.0)) == 0
                if stays:
                    state = (x1, v1, 0.0, xb, vb)
                    continue
            if rough:
                state, way = _rough_soft_step(p, inside, state, way, dt / steps)
            else:
                state = _soft_step(p, inside, state, FREE, dt / steps)
        if not abs(state[0]) + abs(state[1]) + abs(state[4]) < FAR:
            out[i + 1 :] = 0.0
            return False
    return True


@compiled
def run(p: Array, u: Array, dt: float, x: float, v: float, out: Array) -> bool:
    """Simulate from a state; False where it runs away (the rest of ``out`` is then zero).

    Args:
        p: parameters, see :mod:`parameter_layout`.
        u: input inside each sampling period, shape (n - 1, 2 s + 1): at the beginning, middle
            and end of each of s sub-steps.
        dt: sampling period, s.
        x: position at the first sample.
        v: speed at the first sample.
        out: position, speed, acceleration and elongation of the hysteretic element at each
            sample, shape (n, 4); filled.
    """
    p, u, out = borrowed(p), borrowed(u), borrowed(out)
    n = out.shape[0]
    steps = (u.shape[1] - 1) // 2
    part = dt / steps
    rough = p[KINETIC_FORWARD] != 0.0 or p[KINETIC_BACKWARD] != 0.0 or p[STATIC_EXCESS] > 0.0
    plain = _linear(p)
    straight = _linear_step(p, part) if plain else np.zeros((2, 5))
    h = 0.0
    way = 0
    if rough and v != 0.0:
        way = 1 if v > 0.0 else -1
    for i in range(n):
        first = u[i, 0] if i < n - 1 else u[n - 2, 2 * steps]
        out[i, 0] = x
        out[i, 1] = v
        if rough and way == 0 and _held(p, _load(p, first, x, 0.0, h)) == 0:
            out[i, 2] = 0.0
        else:
            out[i, 2] = _rate(p, first, x, v, h, way)
        out[i, 3] = h
        if i == n - 1:
            break
        for j in range(steps):
            u0, um, u1 = u[i, 2 * j], u[i, 2 * j + 1], u[i, 2 * j + 2]
            if plain and (way != 0 or not rough):
                # as long as it slides one way its friction is one more constant force
                more = p[INPUT_OFFSET]
                if way != 0:
                    more -= p[KINETIC_FORWARD] if way > 0 else -p[KINETIC_BACKWARD]
                x1, v1 = _straight_step(straight, x, v, u0 + more, um + more, u1 + more)
                if v1 * way >= 0.0:
                    x, v = x1, v1
                    continue
            if rough:
                x, v, h, way = _rough_step(p, u0, um, u1, x, v, h, way, part)
            else:
                x, v, h = _step(p, u0, um, u1, x, v, h, 0, part)
        if not abs(x) + abs(v) < FAR:
            out[i + 1 :] = 0.0
            return False
    return True


@compiled
def slider_force(
    x: Array,
    stiffness: float,
    forward: float,
    backward: float,
    gap: float,
    slip: float,
    out: Array,
) -> None:
    """Add the force of a slider behind a spring and a play to ``out``, shape (n,).

    ``slip``: position of the slider against the motion's first sample.
    """
    place = x[0] + slip
    for i in range(x.size):
        stretch = lost_motion(x[i] - place, gap)
        force = stiffness * stretch
        if force > forward:
            place += stretch - forward / stiffness
            force = forward
        elif force < -backward:
            place += stretch + backward / stiffness
            force = -backward
        out[i] += force


@compiled
def creeping_friction(
    v: Array, period: float, travel: float, speed: float, h: float, out: Array
) -> None:
    """Share of a dry friction that acts at each sample, shape (n,); fills ``out``.

    dh/dt = (v - |v| h / tanh(|v| / speed)) / travel: after a reversal friction builds up over a
    travel (Dahl, 1968), towards a level that goes with the speed (Canudas de Wit et al., 1995),
    here tanh(|v| / speed). At rest it creeps away. Exact where the speed is constant in a period.

    ``h``: the share that acts at the first sample, from -1 to 1.
    """
    v, out = borrowed(v), borrowed(out)
    out[0] = h
    for i in range(1, v.size):
        moves = 0.5 * (v[i - 1] + v[i])
        level = math.tanh(moves / speed)
        rate = moves / level if abs(level) > 1e-9 else speed
        h = level + (h - level) * math.exp(-min(rate / travel * period, 700.0))
        out[i] = h


@compiled
def smooth_force(p: Array, x: Array, v: Array, a: Array, out: Array) -> None:
    """Force of mass, dampers, springs and the yielding element, shape (n,); fills ``out``."""
    p, x, v, a, out = borrowed(p), borrowed(x), borrowed(v), borrowed(a), borrowed(out)
    h = 0.0
    for i in range(x.size):
        force = p[MASS] * a[i] + p[DAMPING] * v[i] + restoring(p, x[i]) + p[INPUT_OFFSET]
        force += abs(v[i]) * (p[SKEW_DAMPING] + p[QUADRATIC_DAMPING] * v[i])
        if i > 0:
            h = _elongation(p, h, x[i] - x[i - 1])
        out[i] = force + p[HYSTERESIS_STIFFNESS] * h


@law
def _at_place(p: Array, z: float, v: float, h: float) -> float:
    """Force of one element on its place, without dry friction; play takes a spring away."""
    force = -restoring(p, z) - abs(v) * (p[SKEW_DAMPING] + p[QUADRATIC_DAMPING] * v)
    if p[GAP] > 0.0:
        force += p[STIFFNESS] * z
    return float(force - p[HYSTERESIS_STIFFNESS] * h)


@law
def _along(row: Array, s: Array, first: int) -> float:
    total = 0.0
    for k in range(row.size):
        total += row[k] * s[first + k]
    return float(total)


@law
def _rubbed(
    p: Array, before: float, loose: float, given: float, still: bool
) -> tuple[float, bool]:
    """Mean dry friction over a sub-step, and whether its place rests at its end.

    A place that turns within the sub-step rubs one way before and the other after, or rests.

    Args:
        p: parameters of the element.
        before: speed of its place at the beginning.
        loose: the same at the end without friction.
        given: speed that a force of one gives the place in a sub-step.
        still: whether it rests at the beginning.
    """
    held = -loose / given
    if still:
        way = 1 if loose > 0.0 else -1
        limit = p[STATIC_EXCESS] + (p[KINETIC_FORWARD] if way > 0 else p[KINETIC_BACKWARD])
        if abs(held) <= limit:
            return held, True
        return _friction(p, loose, way), False
    way = 1 if before > 0.0 else -1
    sliding = _friction(p, before, way)
    after = loose + given * sliding
    if after * way >= 0.0:
        return sliding, False
    share = before / (before - after)  # of the sub-step, until it turns
    turned = (1.0 - share) * (loose + given * _friction(p, 0.0, -way) - before)
    if turned * way >= 0.0:
        return held, True
    return held + turned / given, False


@compiled
def run_modes(
    a: Array,
    b: Array,
    c: Array,
    places: Array,
    p: Array,
    u: Array,
    parts: int,
    out: Array,
    pull: Array,
) -> bool:
    """Simulate a structure of k modes with elements at l places of it; False where it runs away.

    Modes take exact steps under forces that are straight lines inside a step; what an element
    does at its end is found together with the motion, dry friction as its mean over the step
    (Moreau, in Nonsmooth Mechanics and Applications, 1988).

    Args:
        a: modal positions, then speeds, after a step by those before it, shape (2k, 2k).
        b: the same by the input at the beginning, middle and end of the step, (2k, 3).
        c: the same by the force of each element at its beginning and its end, (l, 2k, 2).
        places: displacement of each element by modal positions, (l, k).
        p: parameters of each element, see :mod:`parameter_layout`, (l, SIZE).
        u: input inside each sampling period, (n - 1, 2 s + 1).
        parts: steps in each of the s parts of a sampling period.
        out: modal positions and speeds at each sample, (n, 2k); filled.
        pull: force of each element on its place at each sample, (n, l); filled.
    """
    a, b, c, places, p = borrowed(a), borrowed(b), borrowed(c), borrowed(places), borrowed(p)
    u, out, pull = borrowed(u), borrowed(out), borrowed(pull)
    n, size = out.shape
    k = size // 2
    elements = p.shape[0]
    steps = (u.shape[1] - 1) // 2
    s, free, after = np.zeros(size), np.zeros(size), np.zeros(size)
    smooth, ends, rub = np.zeros(elements), np.zeros(elements), np.zeros(elements)
    h, bent = np.zeros(elements), np.zeros(elements)
    still, rests = np.ones(elements, np.bool_), np.ones(elements, np.bool_)
    for i in range(n):
        for j in range(size):
            out[i, j] = s[j]
        for e in range(elements):
            pull[i, e] = smooth[e]
            if still[e]:
                pull[i, e] += rub[e]
            else:  # not the mean of a step in which it may have turned
                v = _along(places[e], s, k)
                pull[i, e] += _friction(p[e], v, 1 if v > 0.0 else -1)
        if i == n - 1:
            break
        for step in range(steps * parts):
            at, first = 2 * (step // parts), (step % parts) / parts
            w0, wm, w1 = u[i, at], u[i, at + 1], u[i, at + 2]
            u0 = _between(w0, wm, w1, first)
            um = _between(w0, wm, w1, first + 0.5 / parts)
            u1 = _between(w0, wm, w1, first + 1.0 / parts)
            for j in range(size):
                total = b[j, 0] * u0 + b[j, 1] * um + b[j, 2] * u1
                for m in range(size):
                    total += a[j, m] * s[m]
                for e in range(elements):
                    total += c[e, j, 0] * smooth[e]
                free[j] = total
            ends[:] = smooth
            for _ in range(SWEEPS):
                for e in range(elements):
                    for j in range(size):
                        after[j] = free[j]
                        for other in range(elements):
                            after[j] += c[other, j, 1] * ends[other]
                            after[j] += (c[other, j, 0] + c[other, j, 1]) * rub[other]
                    z, v = _along(places[e], after, 0), _along(places[e], after, k)
                    bent[e] = _elongation(p[e], h[e], z - _along(places[e], s, 0))
                    if p[e, KINETIC_FORWARD] + p[e, KINETIC_BACKWARD] + p[e, STATIC_EXCESS] > 0.0:
                        given = 0.0  # speed of the place after the step by a force of one
                        for m in range(k):
                            given += places[e, m] * (c[e, k + m, 0] + c[e, k + m, 1])
                        rub[e], rests[e] = _rubbed(
                            p[e], _along(places[e], s, k), v - given * rub[e], given, still[e]
                        )
                    ends[e] = _at_place(p[e], z, v, bent[e])
            for j in range(size):
                s[j] = free[j]
                for e in range(elements):
                    s[j] += c[e, j, 1] * ends[e] + (c[e, j, 0] + c[e, j, 1]) * rub[e]
            smooth[:] = ends
            h[:] = bent
            still[:] = rests
        if not np.max(np.abs(s)) < FAR:
            out[i + 1 :] = 0.0
            pull[i + 1 :] = 0.0
            return False
    return True
