"""The equations of motion of the bench, compiled.

Five bodies on one axis (plate, impactor, its flexible second mass, base) joined by the spring,
the guide, the damper layer or the bare contact. Within a *mode* - contact open or closed, guide
stuck or sliding one way, spring slack or engaged or at its stop - everything is smooth; the
integrator locates the moments at which a mode ends. The laws that belong to one mechanism stand
in that mechanism's own file.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impactscope.physics.mechanisms.clearance import slack
from impactscope.physics.mechanisms.compiled import borrowed, chained, compiled, law
from impactscope.physics.mechanisms.end_stop import stop_energy, stop_force
from impactscope.physics.mechanisms.hardening_spring import cubic_energy, cubic_force
from impactscope.physics.mechanisms.hysteresis import yielding_rate
from impactscope.physics.mechanisms.registry import all_mechanisms, own_places
from impactscope.physics.mechanisms.stiffening_damper import stiffening_factor
from impactscope.physics.mechanisms.stribeck_friction import sliding_friction
from impactscope.physics.twin import layout as at

__all__ = [
    'UNTRACKED',
    'accelerations',
    'contact_force',
    'derivative',
    'energy',
    'forces',
    'free_compression',
    'guard',
    'spring_force',
    'spring_region',
    'stick_force',
    'stick_reserves',
]

Array = NDArray[np.float64]
UNTRACKED = 2  # guide mode where nothing depends on the direction of motion

_guide_terms = chained(
    (own_places()[m.name], m.guide_term) for m in all_mechanisms().values() if m.guide_term
)
_contact_terms = chained(
    (own_places()[m.name], m.contact_term) for m in all_mechanisms().values() if m.contact_term
)


@law
def spring_force(par: Array, compression: float, internal: float) -> float:
    """Force of the spring on the plate's seat, N, positive when compressed."""
    stretch = slack(compression, par[at.GAP])
    share = par[at.HYSTERESIS_SHARE]
    force: float = par[at.STIFFNESS] * ((1.0 - share) * stretch + share * internal)
    force += cubic_force(par[at.CUBIC], stretch)
    return force + stop_force(par[at.STOP_STIFFNESS], par[at.STOP_TRAVEL], compression)


@law
def spring_region(par: Array, compression: float) -> int:
    """Smooth piece of the spring's law: 0 tension side, 1 slack, 2 compressed, 3 at the stop."""
    half = 0.5 * par[at.GAP]
    if par[at.STOP_STIFFNESS] > 0.0 and compression > par[at.STOP_TRAVEL]:
        return 3
    if half > 0.0 and compression < -half:
        return 0
    if half > 0.0 and compression <= half:
        return 1
    return 2


@law
def _distance_to_edge(par: Array, compression: float, region: int) -> float:
    """How far the compression is inside its region, m; negative once outside."""
    half: float = 0.5 * par[at.GAP]
    travel: float = par[at.STOP_TRAVEL] if par[at.STOP_STIFFNESS] > 0.0 else np.inf
    if region == 3:
        return compression - travel
    if region == 0:
        return -half - compression
    if region == 1:
        return min(half - compression, half + compression)
    above = compression - half if half > 0.0 else np.inf
    return min(above, travel - compression)


@law
def _layer_force(par: Array, y: Array, u: float) -> float:
    force: float = par[at.LAYER_STIFFNESS] * u
    for i in range(int(par[at.BRANCHES])):
        force += par[at.BRANCH + 2 * i] * (u - y[at.Z + i])
    return force


@law
def free_compression(par: Array, y: Array) -> float:
    """Compression at which the massless layer carries no force, m: it creeps back unloaded."""
    pull = 0.0
    stiffness = par[at.LAYER_STIFFNESS]
    for i in range(int(par[at.BRANCHES])):
        pull += par[at.BRANCH + 2 * i] * y[at.Z + i]
        stiffness += par[at.BRANCH + 2 * i]
    if stiffness <= 0.0:
        return 0.0
    u: float = pull / stiffness
    return u


@law
def _power(base: float, exponent: float) -> float:
    """``base`` to a power; that of Hertz's law without a general power, which takes far longer."""
    if exponent == 1.5:
        return base * math.sqrt(base)
    power: float = base**exponent
    return power


@law
def contact_force(par: Array, y: Array, contact: int) -> float:
    """Force between impactor and plate, N, positive where they push each other apart."""
    if contact != at.CLOSED:
        return 0.0
    u = y[at.P] - y[at.X]
    approach = y[at.VP] - y[at.V]
    more = _contact_terms(par, u, approach)
    if par[at.HAS_LAYER] > 0.0:
        return _layer_force(par, y, u) * stiffening_factor(par[at.LAYER_STIFFENING], u) + more
    size: float = par[at.CONTACT_STIFFNESS] * _power(abs(u), par[at.CONTACT_EXPONENT])
    force: float = math.copysign(size, u) + size * par[at.CONTACT_LOSS] * approach + more
    if par[at.UNILATERAL] > 0.0:
        return max(force, 0.0)
    return force


@law
def tap_force(par: Array, t: float) -> float:
    """Force on the plate from outside, N: a hammer's half-sine, or a measured one."""
    rate: float = par[at.EXCITATION_RATE]
    if rate > 0.0:
        place = t * rate
        i = int(place)
        if place < 0.0 or at.EXCITATION + i + 1 >= len(par):
            return 0.0
        before: float = par[at.EXCITATION + i]
        after: float = par[at.EXCITATION + i + 1]
        return before + (place - i) * (after - before)
    if t <= 0.0 or t >= par[at.TAP_DURATION]:
        return 0.0
    force: float = par[at.TAP_PEAK] * math.sin(math.pi * t / par[at.TAP_DURATION])
    return force


@law
def drive_force(par: Array, t: float) -> float:
    """Force that pushes the impactor on (or takes it away), N."""
    force = 0.0
    elapsed = t - par[at.PUSH_START]
    if par[at.PUSH_FORCE] != 0.0 and elapsed > 0.0:
        full = par[at.PUSH_RISE]
        left = full + par[at.PUSH_HOLD] + par[at.PUSH_FALL] - elapsed
        force = par[at.PUSH_FORCE]
        if elapsed < full:
            force *= elapsed / full
        elif left <= 0.0:
            force = 0.0
        elif left < par[at.PUSH_FALL]:
            force *= left / par[at.PUSH_FALL]
    lifted = t - par[at.LIFT_START]
    if lifted > 0.0:
        force += par[at.LIFT_FORCE] * min(1.0, lifted / par[at.LIFT_RISE])
    return force


@law
def _weight(par: Array, position: float) -> float:
    """Force of gravity on the impactor along the axis, N."""
    lever: float = par[at.LEVER]
    load: float = par[at.LOAD]
    stiffness: float = par[at.RESTORING]
    if lever <= 0.0:
        return load - stiffness * position
    force = 0.0
    if load != 0.0:
        force = load * math.cos(position / lever)
    if stiffness != 0.0:
        force -= stiffness * lever * math.sin(position / lever)
    return force


@law
def _weight_energy(par: Array, position: float) -> float:
    lever: float = par[at.LEVER]
    load: float = par[at.LOAD]
    stiffness: float = par[at.RESTORING]
    if lever > 0.0:
        angle = position / lever
        swing = 2.0 * math.sin(0.5 * angle) ** 2  # 1 - cos without loss of digits
        return lever * (stiffness * lever * swing - load * math.sin(angle))
    return 0.5 * stiffness * position**2 - load * position


@law
def stick_force(par: Array, y: Array, t: float, contact: int) -> float:
    """Dry friction on the plate with which it would move along with the base, N."""
    speed = y[at.V] - y[at.VB]
    viscous = par[at.DAMPING] * speed + _guide_terms(par, y[at.X] - y[at.B], speed)
    inner = spring_force(par, y[at.X] - y[at.B], y[at.H]) + viscous
    on_plate: float = contact_force(par, y, contact) + tap_force(par, t) - inner
    base: float = par[at.BASE_MASS]
    if base <= 0.0:
        return -on_plate
    mass: float = par[at.PLATE_MASS]
    on_base = inner - par[at.BASE_STIFFNESS] * y[at.B] - par[at.BASE_DAMPING] * y[at.VB]
    needed: float = (mass * on_base - base * on_plate) / (mass + base)
    return needed


@law
def stick_reserves(par: Array, needed: float) -> tuple[float, float]:
    """How much more friction the stuck guide could bear against either way, N; negative: it slips.

    First where the plate would slip along +x, then where it would slip back. A margin far below
    anything measurable keeps rounding from deciding.
    """
    forward: float = par[at.STATIC_FORWARD]
    backward: float = par[at.STATIC_BACKWARD]
    margin = 1e-9 * (forward + backward)
    return forward + needed + margin, backward - needed + margin


@law
def forces(
    par: Array, t: float, y: Array, contact: int, guide: int
) -> tuple[float, float, float, float, float]:
    """Contact force, friction on the plate, viscous force of the guide, drive and flexure, N.

    ``guide`` is 0 where plate and base stick, +1 or -1 where the plate slides that way.
    """
    pushed = contact_force(par, y, contact)
    speed = y[at.V] - y[at.VB]
    viscous: float = par[at.DAMPING] * speed + _guide_terms(par, y[at.X] - y[at.B], speed)
    friction = 0.0
    if guide == 0:
        friction = stick_force(par, y, t, contact)
    elif guide != UNTRACKED:
        friction = sliding_friction(
            par[at.STATIC_FORWARD],
            par[at.STATIC_BACKWARD],
            par[at.KINETIC_FORWARD],
            par[at.KINETIC_BACKWARD],
            par[at.STRIBECK_SPEED],
            speed,
            guide,
        )
    drive = 0.0
    flexure = 0.0
    if contact != at.GONE:
        drive = drive_force(par, t)
        if par[at.SECOND_MASS] > 0.0:
            flexure = par[at.FLEXURE_STIFFNESS] * (y[at.P] - y[at.Q])
            flexure += par[at.FLEXURE_DAMPING] * (y[at.VP] - y[at.VQ])
    return pushed, friction, viscous, drive, flexure


@law
def accelerations(
    par: Array,
    t: float,
    y: Array,
    contact: int,
    acting: tuple[float, float, float, float, float],
) -> tuple[float, float, float, float]:
    """Acceleration of plate, impactor, its second mass and base under :func:`forces`, m/s^2."""
    pushed, friction, viscous, drive, flexure = acting
    inner = spring_force(par, y[at.X] - y[at.B], y[at.H]) + viscous - friction
    plate: float = (pushed + tap_force(par, t) - inner) / par[at.PLATE_MASS]
    base = 0.0
    if par[at.BASE_MASS] > 0.0:
        outer = par[at.BASE_STIFFNESS] * y[at.B] + par[at.BASE_DAMPING] * y[at.VB]
        base = (inner - outer) / par[at.BASE_MASS]
    impactor = second = 0.0
    if contact != at.GONE:
        mass, far = par[at.IMPACTOR_MASS], par[at.SECOND_MASS]
        share = 1.0  # of the weight that the first mass carries
        if far > 0.0:
            share = mass / (mass + far)
            second = (flexure + (1.0 - share) * _weight(par, y[at.Q])) / far
        impactor = (drive + share * _weight(par, y[at.P]) - pushed - flexure) / mass
    return plate, impactor, second, base


@compiled
def derivative(par: Array, t: float, y: Array, contact: int, guide: int, dy: Array) -> None:
    """Fill ``dy``, the rate of change of the state."""
    par, y, dy = borrowed(par), borrowed(y), borrowed(dy)
    acting = forces(par, t, y, contact, guide)
    pushed, friction, viscous, drive, flexure = acting
    plate, impactor, second, base = accelerations(par, t, y, contact, acting)
    speed = y[at.V] - y[at.VB]

    lost = (viscous - friction) * speed + par[at.BASE_DAMPING] * y[at.VB] ** 2
    if flexure != 0.0:
        lost += par[at.FLEXURE_DAMPING] * (y[at.VP] - y[at.VQ]) ** 2
    yielding = 0.0
    if par[at.HYSTERESIS_SHARE] > 0.0:
        # the yielding part sits beside the play, not behind it
        yielding = yielding_rate(speed, y[at.H], par[at.HYSTERESIS_YIELD])
        spring = par[at.HYSTERESIS_SHARE] * par[at.STIFFNESS] * y[at.H]
        lost += spring * (speed - yielding)
    u = y[at.P] - y[at.X]
    if contact == at.CLOSED:
        approach = y[at.VP] - y[at.V]
        if par[at.HAS_LAYER] > 0.0:
            # what stiffening adds is booked here while the layer is pressed, and given back
            kept = _layer_force(par, y, u)
        else:
            size = par[at.CONTACT_STIFFNESS] * _power(abs(u), par[at.CONTACT_EXPONENT])
            kept = math.copysign(size, u)
        lost += (pushed - kept) * approach
    if par[at.HAS_LAYER] > 0.0:
        if contact != at.CLOSED:
            u = free_compression(par, y)
        for i in range(int(par[at.BRANCHES])):
            force = par[at.BRANCH + 2 * i] * (u - y[at.Z + i])
            creep = force / par[at.BRANCH + 2 * i + 1]
            lost += force * creep
            dy[at.Z + i] = creep
    dy[at.X] = y[at.V]
    dy[at.V] = plate
    dy[at.P] = 0.0 if contact == at.GONE else y[at.VP]
    dy[at.VP] = impactor
    dy[at.Q] = 0.0 if contact == at.GONE else y[at.VQ]
    dy[at.VQ] = second
    dy[at.B] = y[at.VB]
    dy[at.VB] = base
    dy[at.H] = yielding
    dy[at.LOST] = lost
    dy[at.WORK] = drive * y[at.VP] + tap_force(par, t) * y[at.V]


@compiled
def guard(
    par: Array, y: Array, t: float, contact: int, guide: int, region: int
) -> tuple[float, float, float]:
    """Three numbers that are positive while contact, guide and spring stay in their modes."""
    par, y = borrowed(par), borrowed(y)
    on_contact = 1.0
    if contact == at.OPEN:
        on_contact = y[at.X] - y[at.P]
        if par[at.HAS_LAYER] > 0.0:
            on_contact += free_compression(par, y)
    elif contact == at.CLOSED and par[at.UNILATERAL] > 0.0:
        on_contact = (
            contact_force(par, y, contact) if par[at.HAS_LAYER] > 0.0 else y[at.P] - y[at.X]
        )
    on_guide = 1.0
    if guide == 0:
        needed = stick_force(par, y, t, contact)
        on_guide = min(stick_reserves(par, needed))
    elif guide != UNTRACKED:
        on_guide = guide * (y[at.V] - y[at.VB])
    return on_contact, on_guide, _distance_to_edge(par, y[at.X] - y[at.B], region)


@compiled
def energy(par: Array, y: Array, contact: int) -> float:
    """Kinetic and stored energy of the bench, J; zero at rest without any load."""
    stretch = slack(y[at.X] - y[at.B], par[at.GAP])
    share = par[at.HYSTERESIS_SHARE]
    total: float = 0.5 * par[at.PLATE_MASS] * y[at.V] ** 2
    total += 0.5 * par[at.STIFFNESS] * ((1.0 - share) * stretch**2 + share * y[at.H] ** 2)
    total += cubic_energy(par[at.CUBIC], stretch)
    total += stop_energy(par[at.STOP_STIFFNESS], par[at.STOP_TRAVEL], y[at.X] - y[at.B])
    total += 0.5 * par[at.BASE_MASS] * y[at.VB] ** 2
    total += 0.5 * par[at.BASE_STIFFNESS] * y[at.B] ** 2
    total += 0.5 * par[at.IMPACTOR_MASS] * y[at.VP] ** 2
    mass, second = par[at.IMPACTOR_MASS], par[at.SECOND_MASS]
    if mass > 0.0:
        total += _weight_energy(par, y[at.P]) * mass / (mass + second)
    if second > 0.0:
        total += _weight_energy(par, y[at.Q]) * second / (mass + second)
        total += 0.5 * second * y[at.VQ] ** 2
        total += 0.5 * par[at.FLEXURE_STIFFNESS] * (y[at.P] - y[at.Q]) ** 2
    if par[at.HAS_LAYER] > 0.0:
        u = y[at.P] - y[at.X] if contact == at.CLOSED else free_compression(par, y)
        total += 0.5 * par[at.LAYER_STIFFNESS] * u**2
        for i in range(int(par[at.BRANCHES])):
            total += 0.5 * par[at.BRANCH + 2 * i] * (u - y[at.Z + i]) ** 2
    elif contact == at.CLOSED:
        n = par[at.CONTACT_EXPONENT]
        u = abs(y[at.P] - y[at.X])
        total += par[at.CONTACT_STIFFNESS] * u ** (n + 1.0) / (n + 1.0)
    return total
