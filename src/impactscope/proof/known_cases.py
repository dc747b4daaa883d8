"""Cases with exact solutions, to compare any simulator of the bench with.

A case is described by plain numbers (SI; the names are fields of :class:`Bench`, what is not
named is absent) and by what the plate or the impactor does at time 0. ``agreement`` runs another
simulator on all of them, so that two simulators can be compared without sharing code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.special import ellipj, ellipk

from .bench import Bench, Pulse
from .integrator import COLUMNS, integrate

__all__ = ['KNOWN_CASES', 'Agreement', 'KnownCase', 'Simulator', 'agreement', 'simulate']

Array = NDArray[np.float64]
Channels = dict[str, Array]

NOISE: Mapping[str, float] = {
    'force': 0.1,  # N, the quietest that campaigns are drawn with
    'contact': 0.1,
    'acceleration': 0.05,  # m/s²
    'displacement': 1e-6,  # m
}


@dataclass(frozen=True)
class KnownCase:
    """One motion whose course is known exactly."""

    name: str
    description: Mapping[str, float]  # fields of Bench, SI
    times: Array  # s
    exact: Callable[[Array], Channels]  # samples at these times
    pulses: tuple[Pulse, ...] = ()
    displacement: float = 0.0  # m, of the plate at time 0
    velocity: float = 0.0  # m/s
    features: frozenset[str] = field(default_factory=frozenset)  # what a simulator must know


@dataclass(frozen=True)
class Agreement:
    """How far a simulator is from the exact solution."""

    case: str
    channel: str
    largest: float  # unit of the channel
    in_noise: float  # largest over the quietest noise of a campaign


Simulator = Callable[[KnownCase], Mapping[str, Array]]


def simulate(case: KnownCase) -> Channels:
    """A known case by the integrator of the examination."""
    blank = Bench(mass=1.0, stiffness=0.0, damping=0.0)
    samples = integrate(
        blank._replace(**case.description),
        case.times,
        pulses=case.pulses,
        displacement=case.displacement,
        velocity=case.velocity,
    )
    return {name: samples[:, i] for i, name in enumerate(COLUMNS)}


def agreement(simulator: Simulator, features: frozenset[str] | None = None) -> list[Agreement]:
    """Largest distance of a simulator from the exact solutions, by case and channel.

    Args:
        simulator: from a case to samples by channel; channels it does not know are left out.
        features: which features it knows; cases that need others are left out. None: all.
    """
    table = []
    for case in KNOWN_CASES:
        if features is not None and not case.features <= features:
            continue
        samples = simulator(case)
        for channel, exact in case.exact(case.times).items():
            if channel in samples:
                worst = float(np.max(np.abs(np.asarray(samples[channel]) - exact)))
                noise = NOISE[channel.split('.')[0]]
                table.append(Agreement(case.name, channel, worst, worst / noise))
    return table


# --- exact solutions


def _free_decay(t: Array, m: float, k: float, c: float, x0: float, v0: float = 0.0) -> Channels:
    omega, delta = math.sqrt(k / m), c / (2 * m)
    wd = math.sqrt(omega**2 - delta**2)
    e = np.exp(-delta * t)
    b = (v0 + delta * x0) / wd
    x = e * (x0 * np.cos(wd * t) + b * np.sin(wd * t))
    v = e * ((b * wd - delta * x0) * np.cos(wd * t) - (x0 * wd + delta * b) * np.sin(wd * t))
    return {'force': k * x, 'acceleration.plate': -(k * x + c * v) / m, 'displacement.plate': x}


def _coulomb_decay(t: Array, m: float, k: float, friction: float, x0: float) -> Channels:
    """Half cosines about +-F/k, shrinking by 2 F/k each, until the spring is too weak."""
    omega, dead = math.sqrt(k / m), friction / k
    x, a = np.empty_like(t), np.zeros_like(t)
    half = np.floor(t * omega / math.pi).astype(int)
    for i in range(int(half.max()) + 1):
        inside = half == i
        sign = (-1) ** i
        amplitude = x0 - 2 * dead * i
        if amplitude <= dead:  # at rest where the last half cosine ended
            inside = half >= i
            x[inside] = sign * amplitude
            break
        arc = (amplitude - dead) * np.cos(omega * t[inside] - math.pi * i)
        x[inside] = sign * (arc + dead)
        a[inside] = -sign * omega**2 * arc
    return {'force': k * x, 'acceleration.plate': a, 'displacement.plate': x}


def _half_sine(t: Array, m: float, k: float, c: float, peak: float, length: float) -> Channels:
    """Response to peak sin(pi t / length): exact inside, free decay behind."""
    omega = math.pi / length
    gain = peak / complex(k - m * omega**2, c * omega)

    def forced(s: Array) -> tuple[Array, Array]:
        steady = np.imag(gain * np.exp(1j * omega * s))
        rate = np.imag(1j * omega * gain * np.exp(1j * omega * s))
        free = _free_decay(s, m, k, c, -gain.imag, -omega * gain.real)
        speed = -(m * free['acceleration.plate'] + free['force']) / c
        return steady + free['displacement.plate'], rate + speed

    x = np.empty_like(t)
    early = t < length
    x[early] = forced(t[early])[0]
    xe, ve = forced(np.array([length]))
    x[~early] = _free_decay(t[~early] - length, m, k, c, float(xe[0]), float(ve[0]))[
        'displacement.plate'
    ]
    return {'force': k * x, 'displacement.plate': x}


def _duffing(t: Array, m: float, k: float, cubic: float, x0: float) -> Channels:
    """Undamped: a Jacobian elliptic cosine (Kovacic, Brennan, The Duffing Equation, 2011)."""
    stiff = k + cubic * x0**2
    omega, modulus = math.sqrt(stiff / m), cubic * x0**2 / (2 * stiff)
    if modulus >= 0:
        x = x0 * ellipj(omega * t, modulus)[1]
    else:  # softening: cd with the positive modulus -m/(1-m)
        root = math.sqrt(1 - modulus)
        other = -modulus / (1 - modulus)
        sn = ellipj(root * omega * t + ellipk(other), other)[0]
        x = x0 * sn
    force = k * x + cubic * x**3
    return {'force': force, 'acceleration.plate': -force / m, 'displacement.plate': x}


def _dead_zone(t: Array, m: float, k: float, gap: float, x0: float) -> Channels:
    """Half cosines outside the gap, straight lines through it."""
    omega = math.sqrt(k / m)
    reach = x0 - gap / 2
    arc, through = math.pi / omega, gap / (reach * omega)
    shifted = np.mod(t + arc / 2, 2 * (arc + through))  # from the gap's edge outwards
    second = shifted >= arc + through
    s = np.where(second, shifted - arc - through, shifted)
    inside = s < arc
    swing = np.where(inside, reach * np.sin(omega * s), 0.0)
    x = np.where(inside, gap / 2 + swing, gap / 2 - reach * omega * (s - arc))
    sign = np.where(second, -1.0, 1.0)
    return {
        'force': sign * k * swing,
        'acceleration.plate': -sign * omega**2 * swing,
        'displacement.plate': sign * x,
    }


def _linear(
    t: Array, masses: Array, stiffness: Array, damping: Array, start: Array, load: Array
) -> tuple[Array, Array]:
    """Positions and accelerations of a linear chain by the matrix exponential, each (n, dof)."""
    n = masses.size
    matrix = np.zeros((2 * n + 1, 2 * n + 1))
    matrix[:n, n : 2 * n] = np.eye(n)
    matrix[n : 2 * n, :n] = -stiffness / masses[:, None]
    matrix[n : 2 * n, n : 2 * n] = -damping / masses[:, None]
    matrix[n : 2 * n, 2 * n] = load / masses
    state = np.append(start, 1.0)
    y: Array = np.stack([expm(matrix * s) @ state for s in t])
    slope: Array = y @ matrix.T
    return y[:, :n], slope[:, n : 2 * n]


def _push_together(
    t: Array, m: float, k: float, c: float, layer: float, impactor: float, v: float, load: float
) -> Channels:
    """Plate and impactor joined by an elastic layer: exact until the contact is lost."""
    x, a = _linear(
        t,
        np.array([m, impactor]),
        np.array([[k + layer, -layer], [-layer, layer]]),
        np.array([[c, 0.0], [0.0, 0.0]]),
        np.array([0.0, 0.0, 0.0, v]),
        np.array([0.0, load]),
    )
    return {
        'force': k * x[:, 0],
        'acceleration.plate': a[:, 0],
        'acceleration.impactor': a[:, 1],
    }


def _soft_base(
    t: Array, m: float, k: float, c: float, base: float, frequency: float, x0: float
) -> Channels:
    ground = base * (2 * math.pi * frequency) ** 2
    x, a = _linear(
        t,
        np.array([m, base]),
        np.array([[k, -k], [-k, k + ground]]),
        np.array([[c, -c], [-c, c]]),
        np.array([x0, 0.0, 0.0, 0.0]),
        np.zeros(2),
    )
    return {
        'force': k * (x[:, 0] - x[:, 1]),
        'acceleration.plate': a[:, 0],
        'acceleration.base': a[:, 1],
    }


def _bounce(t: Array, layer: float, impactor: float, v: float, weight: float) -> Channels:
    """On an elastic layer over an immovable plate, falling back between: for ever the same."""
    omega, sag = math.sqrt(layer / impactor), weight / layer
    reach = math.hypot(sag, v / omega)
    contact = 2 * (math.pi - math.atan2(v / omega, sag)) / omega
    flight = 2 * v * impactor / weight
    s = np.mod(t, contact + flight)
    phase = math.atan2(v / omega, sag)
    u = np.where(s < contact, sag - reach * np.cos(omega * s + phase), 0.0)
    force = np.where(s < contact, layer * u, 0.0)
    return {'contact': force, 'acceleration.impactor': (weight - force) / impactor}


def _relaxation(t: Array, k2: float, k1: float, c1: float, speed: float) -> Channels:
    """Layer compressed at constant speed; eq. (29) of the bench's paper from rest."""
    return {'contact': k2 * speed * t + c1 * speed * -np.expm1(-t * k1 / c1)}


def _steady(samples: int, end: float) -> Array:
    return np.arange(samples, dtype=np.float64) * (end / samples)


def _case(
    name: str,
    exact: Callable[..., Channels],
    arguments: Mapping[str, float],
    description: Mapping[str, float],
    times: Array,
    features: str = '',
    **start: float,
) -> KnownCase:
    return KnownCase(
        name,
        description,
        times,
        lambda t: exact(t, **arguments),
        features=frozenset(features.split()),
        **start,  # type: ignore[arg-type]
    )


_PLATE = {'mass': 1.67, 'stiffness': 69e3, 'damping': 16.0}
_IMPACT = {
    'layer_stiffness': 57160.0,
    'impactor_mass': 1.2,
    'speed': 0.9,
    'gravity_load': 13.0,
}

KNOWN_CASES: tuple[KnownCase, ...] = (
    _case(
        'free decay',
        _free_decay,
        {'m': 1.67, 'k': 69e3, 'c': 16.0, 'x0': 4e-3},
        _PLATE,
        _steady(1000, 0.5),
        displacement=4e-3,
    ),
    _case(
        'dry friction, to rest',
        _coulomb_decay,
        {'m': 1.67, 'k': 69e3, 'friction': 12.0, 'x0': 4e-3},
        {'mass': 1.67, 'stiffness': 69e3, 'friction_forward': 12.0, 'friction_backward': 12.0},
        _steady(1000, 0.5) + 1e-9,
        'friction',
        displacement=4e-3,
    ),
    KnownCase(
        'half-sine blow',
        _PLATE,
        _steady(1000, 0.25),
        lambda t: _half_sine(t, 1.67, 69e3, 16.0, 300.0, 0.005),
        pulses=(Pulse(0.0, 0.005, 300.0),),
        features=frozenset({'pulse'}),
    ),
    _case(
        'hardening spring',
        _duffing,
        {'m': 1.67, 'k': 69e3, 'cubic': 2e9, 'x0': 4e-3},
        {'mass': 1.67, 'stiffness': 69e3, 'cubic': 2e9},
        _steady(1000, 0.4),
        'cubic',
        displacement=4e-3,
    ),
    _case(
        'softening spring',
        _duffing,
        {'m': 1.67, 'k': 69e3, 'cubic': -1e9, 'x0': 4e-3},
        {'mass': 1.67, 'stiffness': 69e3, 'cubic': -1e9},
        _steady(1000, 0.4),
        'cubic',
        displacement=4e-3,
    ),
    _case(
        'clearance',
        _dead_zone,
        {'m': 1.67, 'k': 69e3, 'gap': 4e-4, 'x0': 3e-3},
        {'mass': 1.67, 'stiffness': 69e3, 'clearance': 4e-4},
        _steady(1000, 0.4),
        'clearance',
        displacement=3e-3,
    ),
    _case(
        'impact, together',
        _push_together,
        {
            'm': 1.67,
            'k': 69e3,
            'c': 16.0,
            'layer': 57160.0,
            'impactor': 1.2,
            'v': 0.9,
            'load': 13.0,
        },
        {**_PLATE, **_IMPACT},
        _steady(200, 0.012),
        'impact',
    ),
    _case(
        'bouncing on a layer',
        _bounce,
        {'layer': 57160.0, 'impactor': 1.2, 'v': 0.5, 'weight': 13.0},
        {'mass': 1e12, 'stiffness': 0.0, **_IMPACT, 'speed': 0.5},
        _steady(2000, 0.6),
        'impact',
    ),
    _case(
        'layer under constant speed',
        _relaxation,
        {'k2': 38320.0, 'k1': 18840.0, 'c1': 600.0, 'speed': 0.05},
        {
            'mass': 1e12,
            'stiffness': 0.0,
            'layer_stiffness': 38320.0,
            'branch_stiffness': 18840.0,
            'branch_damping': 600.0,
            'impactor_mass': 1e12,
            'speed': 0.05,
        },
        _steady(500, 0.1),
        'impact branch',
    ),
    _case(
        'compliant fixture',
        _soft_base,
        {'m': 1.67, 'k': 69e3, 'c': 16.0, 'base': 12.0, 'frequency': 80.0, 'x0': 4e-3},
        {**_PLATE, 'base_mass': 12.0, 'base_frequency': 80.0, 'base_damping': 0.0},
        _steady(1000, 0.4),
        'base',
        displacement=4e-3,
    ),
)
