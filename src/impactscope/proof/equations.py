"""Equations of motion of the bench in each regime of contact and friction, compiled.

State: 0 plate x, 1 its speed, 2 base, 3 its speed, 4 impactor's contact point w, 5 its speed,
6 impactor's flexible mass, 7 its speed, 8 and 9 dashpots of the layer's branches, 10 hysteretic
displacement, 11... dashpots of the ladder that makes the fractional force.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .bench import Bench

__all__ = [
    'APART',
    'BACKWARD',
    'BASE_STATES',
    'FORWARD',
    'FREE',
    'STUCK',
    'TOUCHING',
    'derivatives',
    'ladder',
    'overlap',
    'slip_friction',
]

Array = NDArray[np.float64]

BASE_STATES = 11
APART, TOUCHING = 0, 1  # contact
STUCK, FORWARD, BACKWARD, FREE = 0, 1, -1, 2  # guide; FREE: no dry friction
STICK_FORCE = 0  # rows of what derivatives() tells beside the derivatives
SPRING_FORCE = 1
CONTACT_FORCE = 2


def ladder(bench: Bench, fastest: float = 4e3) -> tuple[Array, Array, float]:
    """Springs N/m and dashpots N s/m, in series each, whose sum acts as C d^a/dt^a.

    From s^(a-1) = sin(pi a)/pi * integral of x^(a-1)/(s + x) dx over relaxation rates x,
    by the midpoint rule in log x. Rungs faster than ``fastest`` (1/s) act as one dashpot, the
    third value (N s/m), in the band of the bench.
    """
    if bench.fractional == 0:
        return np.empty(0), np.empty(0), 0.0
    order = bench.fractional_order
    edges = np.geomspace(1e-2, 1e6, 41)
    rates = np.sqrt(edges[1:] * edges[:-1])
    width = np.log(edges[1] / edges[0])
    springs = bench.fractional * math.sin(math.pi * order) / math.pi * rates**order * width
    slow = rates < fastest
    rest = float(np.sum(springs[~slow] / rates[~slow]))
    return springs[slow], springs[slow] / rates[slow], rest


@njit(cache=True)  # type: ignore[untyped-decorator]
def slip_friction(p: Bench, direction: int, displacement: float, speed: float) -> float:
    """Size of the dry friction, N, at a slip speed; speed 0 gives the static one."""
    level = p.friction_forward if direction == FORWARD else p.friction_backward
    level += p.friction_slope * abs(displacement)
    if p.static_ratio != 1.0:
        level *= 1.0 + (p.static_ratio - 1.0) * math.exp(-((speed / p.stribeck_speed) ** 2))
    return level


@njit(cache=True)  # type: ignore[untyped-decorator]
def spring_force(p: Bench, t: float, s: float, hysteretic: float) -> float:
    """Elastic force of the spring, N, at compression s."""
    e = s
    half = 0.5 * p.clearance
    if half > 0:
        e = s - half if s > half else (s + half if s < -half else 0.0)
    k = p.stiffness
    if p.modulation != 0.0:
        k *= 1.0 + p.modulation * math.sin(2 * math.pi * p.modulation_frequency * t)
    force = k * ((1.0 - p.hysteretic_share) * e + p.hysteretic_share * hysteretic)
    force += p.cubic * e * e * e
    if p.stop_stiffness > 0 and s > p.stop_travel:
        force += p.stop_stiffness * (s - p.stop_travel)
    return force


@njit(cache=True)  # type: ignore[untyped-decorator]
def overlap(p: Bench, y: Array) -> float:
    """How far the impactor reaches into the (relaxed) surface, m; below 0: apart."""
    total = p.layer_stiffness + p.branch_stiffness + p.second_stiffness
    relaxed = 0.0
    if total > 0:
        relaxed = (p.branch_stiffness * y[8] + p.second_stiffness * y[9]) / total
    reach: float = y[4] - y[0] - relaxed
    return reach


@njit(cache=True)  # type: ignore[untyped-decorator]
def contact_force(p: Bench, y: Array) -> float:
    """Force of the impactor on the plate while they touch, N."""
    u = y[4] - y[0]
    approach = y[5] - y[1]
    if p.hertz_stiffness > 0:
        force = 0.0
        if u > 0:
            damped = 1.0 + p.hertz_damping * approach
            force = p.hertz_stiffness * u * math.sqrt(u) * max(damped, 0.0)
    else:
        force = p.layer_stiffness * u
        force += p.branch_stiffness * (u - y[8]) + p.second_stiffness * (u - y[9])
        force *= 1.0 + p.stiffening * max(u, 0.0)
    if p.velocity_squared > 0 and approach > 0:
        force += p.velocity_squared * approach * approach
    return force


@njit(cache=True)  # type: ignore[untyped-decorator]
def derivatives(
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
) -> None:
    """Fill ``dy`` with the derivatives and ``forces`` with (stick, spring, contact) forces, N.

    Args:
        t: s after first contact or after the begin of a tap.
        y: state, shape (11 + rungs,).
        dy: its derivatives, filled.
        p: the bench.
        contact: APART or TOUCHING.
        guide: STUCK, FORWARD, BACKWARD or FREE.
        pulses: shape (n, 5): start s, duration s, peak N, power, cycles.
        springs: of the fractional ladder, N/m.
        dashpots: of the ladder, N s/m.
        forces: shape (3,).
    """
    s = y[0] - y[2]
    vr = y[1] - y[3]
    elastic = spring_force(p, t, s, y[10])
    viscous = p.damping * vr
    if vr > 0:
        viscous += p.quadratic_forward * vr * vr
    else:
        viscous -= p.quadratic_backward * vr * vr
    for i in range(springs.size):
        rung = springs[i] * (s - y[11 + i])
        viscous += rung
        dy[11 + i] = rung / dashpots[i]
    applied = 0.0
    for i in range(pulses.shape[0]):
        share = (t - pulses[i, 0]) / pulses[i, 1]
        if 0.0 < share < 1.0:
            if pulses[i, 4] > 0.0:
                applied += pulses[i, 2] * math.sin(2 * math.pi * pulses[i, 4] * share)
            else:
                applied += pulses[i, 2] * math.sin(math.pi * share) ** pulses[i, 3]

    fc = 0.0
    u = 0.0
    if p.impactor_mass > 0:
        if contact == TOUCHING:
            u = y[4] - y[0]
            fc = contact_force(p, y)
        else:
            u = y[4] - y[0] - overlap(p, y)  # the surface keeps to its relaxed place
    dy[8] = p.branch_stiffness * (u - y[8]) / p.branch_damping
    dy[9] = p.second_stiffness * (u - y[9]) / p.second_damping

    mass = p.mass + (p.added_mass if p.impactor_mass > 0 else 0.0)
    on_plate = applied + fc - elastic - viscous
    on_base = 0.0
    if p.base_mass > 0:
        omega = 2 * math.pi * p.base_frequency
        on_base = elastic + viscous
        on_base -= p.base_mass * omega * (omega * y[2] + 2 * p.base_damping * y[3])
    friction = 0.0
    if guide == STUCK:
        friction = on_plate
        if p.base_mass > 0:
            weight = 1.0 / mass + 1.0 / p.base_mass
            friction = (on_plate / mass - on_base / p.base_mass) / weight
    elif guide == FORWARD:
        friction = slip_friction(p, FORWARD, s, vr)
    elif guide == BACKWARD:
        friction = -slip_friction(p, BACKWARD, s, vr)
    dy[0] = y[1]
    dy[1] = (on_plate - friction) / mass
    dy[2] = y[3]
    dy[3] = (on_base + friction) / p.base_mass if p.base_mass > 0 else 0.0
    if guide == STUCK and p.base_mass == 0:
        dy[1] = 0.0

    dy[4] = 0.0
    dy[5] = 0.0
    dy[6] = 0.0
    dy[7] = 0.0
    if p.impactor_mass > 0:
        front = p.impactor_mass * (1.0 - p.flexible_share)
        tail = p.impactor_mass * p.flexible_share
        load = p.gravity_load * (1.0 - p.flexible_share) - fc - p.restoring * y[4]
        if p.push != 0.0 and t > p.push_start:
            load += p.push * min((t - p.push_start) / p.push_rise, 1.0)
        if tail > 0:
            omega = 2 * math.pi * p.flexible_frequency
            link = tail * omega * (omega * (y[6] - y[4]))
            link += tail * omega * 2 * p.flexible_damping * (y[7] - y[5])
            load += link
            dy[6] = y[7]
            dy[7] = (p.gravity_load * p.flexible_share - link) / tail
        dy[4] = y[5]
        dy[5] = load / front

    dy[10] = 0.0
    if p.hysteretic_share > 0:
        filled = y[10] / p.yield_displacement
        dy[10] = vr * (1.0 - abs(filled)) if vr * y[10] > 0 else vr
    forces[0] = friction
    forces[1] = elastic
    forces[2] = fc
