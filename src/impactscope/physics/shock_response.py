"""What the sensor reads of short contact forces, in closed form, and which sensor would do.

Source: Samarathunga et al., Machines 2024, 12, 26, section 3.1.1 and Fig. 9, made quantitative.
Pulses have unit height and begin at time 0; every response is F_o over the pulse's height.
The peak ratio (peak reading over peak force) depends on two numbers alone: the damping ratio
and the contact time over the natural period, ``Tc/Tn``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, minimize_scalar

from impactscope.errors import ConfigurationError
from impactscope.physics.sensor_model import SensorModel, free_motion

__all__ = [
    'SensorRequirement',
    'half_sine_response',
    'largest_peak_ratio',
    'peak_ratio',
    'peak_ratio_map',
    'required_sensor',
    'shortest_contact_ratio',
    'staircase_response',
    'unity_contact_ratio',
    'versine_response',
]

Array = NDArray[np.float64]

_POINTS_PER_PERIOD = 64  # of the natural oscillation; the peak itself is polished by Newton steps
_LONGEST_RATIO = 200.0  # Tc/Tn beyond which no requirement is looked for


def _sine_from_rest(t: Array, omega: float, w: float, zeta: float) -> tuple[Array, Array]:
    """Reading and its rate, from rest, of the force sin(omega t) that begins at time 0."""
    on = t > 0
    if math.hypot(omega / w - 1.0, zeta) < 1e-7:  # resonance without damping: the limit itself
        x = 0.5 * (np.sin(w * t) - w * t * np.cos(w * t))
        return np.where(on, x, 0.0), np.where(on, 0.5 * w * w * t * np.sin(w * t), 0.0)
    response = 1 / complex(1 - (omega / w) ** 2, 2 * zeta * omega / w)
    steady = response * np.exp(1j * omega * np.where(on, t, 0.0))
    xf, vf = free_motion(t, w, zeta, -response.imag, -omega * response.real)
    x, v = steady.imag + xf, omega * steady.real + vf
    return np.where(on, x, 0.0), np.where(on, v, 0.0)


def _half_sine(t: Array, tc: float, w: float, zeta: float) -> tuple[Array, Array]:
    # A half-sine is a sine and its own copy half a period later: they cancel ever after.
    omega = math.pi / tc
    x1, v1 = _sine_from_rest(t, omega, w, zeta)
    x2, v2 = _sine_from_rest(t - tc, omega, w, zeta)
    return x1 + x2, v1 + v2


def half_sine_response(time: ArrayLike, contact_time: float, sensor: SensorModel) -> Array:
    """Reading at ``time`` s of the force sin(pi t/Tc), 0 <= t <= Tc (Fig. 9a, c)."""
    _check(contact_time)
    t = np.asarray(time, np.float64)
    return _half_sine(t, contact_time, sensor.natural_angular_frequency, sensor.damping_ratio)[0]


def staircase_response(
    time: ArrayLike, step_times: ArrayLike, steps: ArrayLike, sensor: SensorModel
) -> Array:
    """Reading at ``time`` s of a force that steps by ``steps`` at ``step_times`` s.

    Both arrays have shape (n_steps,). The double step of Fig. 9b is ``[0, 0.05], [1, -1]``.
    """
    t = np.asarray(time, np.float64)
    w, zeta = sensor.natural_angular_frequency, sensor.damping_ratio
    total = np.zeros(t.shape)
    for start, step in zip(np.atleast_1d(step_times), np.atleast_1d(steps), strict=True):
        motion, _ = free_motion(t - start, w, zeta, -1.0, 0.0)
        total += np.where(t > start, step * (1 + motion), 0.0)
    return total


def versine_response(time: ArrayLike, contact_time: float, sensor: SensorModel) -> Array:
    """Reading at ``time`` s of (1 - cos(2 pi t/Tc))/2, 0 <= t <= Tc: a blow with soft ends."""
    _check(contact_time)
    t = np.asarray(time, np.float64)
    w, zeta = sensor.natural_angular_frequency, sensor.damping_ratio
    omega = 2 * math.pi / contact_time
    total = np.zeros(t.shape)
    for start, sign in ((0.0, 1.0), (contact_time, -1.0)):
        # 1 - cos is omega times the integral of sin; integrating the sine's equation of motion
        # gives the integral of its response without a further closed form.
        x, v = _sine_from_rest(t - start, omega, w, zeta)
        force = np.where(t > start, 1 - np.cos(omega * (t - start)), 0.0)
        total += sign * (force - omega * (v / w**2 + 2 * zeta * x / w))
    return total / 2


def _check(contact_time: float) -> None:
    if not (math.isfinite(contact_time) and contact_time > 0):
        raise ConfigurationError(
            f'shock response: contact time is {contact_time!r} s; it must be above zero'
        )


@lru_cache(maxsize=65536)
def _peak_ratio(zeta: float, ratio: float) -> float:
    """Peak reading of a half-sine of ``ratio`` natural periods (Tn = 1)."""
    w = 2 * math.pi
    t = np.linspace(0.0, ratio, max(_POINTS_PER_PERIOD, int(_POINTS_PER_PERIOD * ratio)) + 1)
    x, v = _half_sine(t, ratio, w, zeta)
    i = int(np.argmax(x))
    best = float(x[i])
    if i > 0:  # polish: the peak is where the rate passes zero, in the last step, too
        last = t[min(i + 1, t.size - 1)]
        top = t[i : i + 1]
        for _ in range(3):
            xs, vs = _half_sine(top, ratio, w, zeta)
            best = max(best, float(xs[0]))
            pull = w * w * (math.sin(math.pi * float(top[0]) / ratio) - xs) - 2 * zeta * w * vs
            if not pull[0] < 0:
                break
            top = np.clip(top - vs / pull, t[i - 1], last)
    if v[-1] > 0:  # still rising when the force ends: the peak comes in the free motion
        best = max(best, _free_peak(float(x[-1]), float(v[-1]), w, zeta))
    return best


def _free_peak(x: float, v: float, w: float, zeta: float) -> float:
    """First maximum of the free motion from a rising state."""
    slope = zeta * w * v + w * w * x
    root = w * math.sqrt(abs(1 - zeta * zeta))
    if root < 1e-6 * w:
        time = v / slope
    elif zeta < 1:
        time = math.atan2(v * root, slope) / root
    else:
        time = math.atanh(min(v * root / slope, 1 - 1e-16)) / root
    return float(free_motion(time, w, zeta, x, v)[0])


def peak_ratio(damping_ratio: float, contact_ratio: float) -> float:
    """Peak reading over peak force of a half-sine contact.

    ``contact_ratio`` is Tc/Tn, contact time over undamped natural period. Below 1 the sensor
    under-reads, above 1 it over-reads.
    """
    _check(contact_ratio)
    if not (math.isfinite(damping_ratio) and damping_ratio >= 0):
        raise ConfigurationError(
            f'shock response: damping ratio is {damping_ratio!r}; it must be zero or more'
        )
    return _peak_ratio(float(damping_ratio), float(contact_ratio))


def peak_ratio_map(damping_ratios: ArrayLike, contact_ratios: ArrayLike) -> Array:
    """Peak ratio over both, shape (n_damping, n_contact)."""
    return np.array(
        [
            [peak_ratio(float(z), float(r)) for r in np.atleast_1d(contact_ratios)]
            for z in np.atleast_1d(damping_ratios)
        ]
    )


def largest_peak_ratio(damping_ratio: float) -> tuple[float, float]:
    """Tc/Tn of the greatest over-reading, and the ratio there; (inf, 1) if there is none."""
    grid = np.geomspace(0.2, 20.0, 60)
    values = np.array([peak_ratio(damping_ratio, r) for r in grid])
    i = int(np.argmax(values))
    if values[i] <= 1 or i == grid.size - 1:
        return math.inf, 1.0
    result = minimize_scalar(
        lambda r: -peak_ratio(damping_ratio, r),
        bounds=(grid[max(i - 1, 0)], grid[i + 1]),
        method='bounded',
        options={'xatol': 1e-7},
    )
    return float(result.x), float(-result.fun)


def unity_contact_ratio(damping_ratio: float) -> float:
    """Tc/Tn at which under-reading turns into over-reading; inf where it never does."""
    top, _ = largest_peak_ratio(damping_ratio)
    if top == math.inf:
        return math.inf
    return float(brentq(lambda r: peak_ratio(damping_ratio, r) - 1, 1e-3, top, xtol=1e-9))


def shortest_contact_ratio(damping_ratio: float, tolerance: float) -> float:
    """Smallest Tc/Tn from which on every longer half-sine is read within ``tolerance``.

    ``tolerance`` is the relative error of the peak, in (0, 1). Raises ConfigurationError where
    no contact of up to 200 natural periods would do.
    """
    if not 0 < tolerance < 1:
        raise ConfigurationError(
            f'shock response: tolerated peak error is {tolerance!r}; it must lie in (0, 1)'
        )

    def excess(ratio: float) -> float:
        return abs(peak_ratio(damping_ratio, ratio) - 1) - tolerance

    # The error ripples with the number of natural periods in the contact: search downwards,
    # finely enough for the ripple, for the last contact that is still misread.
    top, step = 4.0, 0.05
    while excess(top) > 0 or excess(1.21 * top) > 0 or excess(1.43 * top) > 0:
        top *= 2
        if top > _LONGEST_RATIO:
            raise ConfigurationError(
                f'shock response: with damping ratio {damping_ratio!r} no contact of up to '
                f'{_LONGEST_RATIO:g} natural periods is read within {tolerance!r}'
            )
    ratio = 1.5 * top
    while ratio > step and excess(ratio - step) <= 0:
        ratio -= step
    return float(brentq(excess, max(ratio - step, 1e-3), ratio, xtol=1e-9))


@dataclass(frozen=True, slots=True)
class SensorRequirement:
    """The sensor that reads every half-sine from ``shortest_contact`` on within ``tolerance``."""

    shortest_contact: float  # s
    tolerance: float  # relative error of the peak
    sensor: SensorModel  # the heaviest plate that will do, at this stiffness and damping

    @property
    def largest_plate_mass(self) -> float:
        """Kg."""
        return self.sensor.mass


def required_sensor(
    shortest_contact: float,
    tolerance: float,
    stiffness: float,
    damping_ratio: float | None = None,
) -> SensorRequirement:
    """Plate mass and damping a sensor needs for its shortest contact and tolerated peak error.

    ``shortest_contact`` s, ``tolerance`` relative, ``stiffness`` N/m as the body region
    demands. Without ``damping_ratio`` the one that allows the heaviest plate is chosen: the
    paper's conclusion, light plate and sufficient damping, in numbers.
    """
    _check(shortest_contact)
    if damping_ratio is None:
        grid = np.linspace(0.2, 1.0, 17)
        needs = np.array([_need(z, tolerance) for z in grid])
        i = int(np.argmin(needs))
        result = minimize_scalar(
            lambda z: _need(z, tolerance),
            bounds=(grid[max(i - 1, 0)], grid[min(i + 1, grid.size - 1)]),
            method='bounded',
            options={'xatol': 1e-3},
        )
        damping_ratio = float(result.x) if result.fun < needs[i] else float(grid[i])
    frequency = shortest_contact_ratio(damping_ratio, tolerance) / shortest_contact
    sensor = SensorModel.from_modal(frequency, damping_ratio, stiffness)
    return SensorRequirement(shortest_contact, tolerance, sensor)


def _need(zeta: float, tolerance: float) -> float:
    try:
        return shortest_contact_ratio(zeta, tolerance)
    except ConfigurationError:
        return _LONGEST_RATIO
