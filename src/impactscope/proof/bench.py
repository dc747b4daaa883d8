"""What one blow on the bench is made of: every number of the simulated physics, in SI units."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ['BENCH', 'GRAVITY', 'Bench', 'Pendulum', 'Pulse']

GRAVITY = 9.80665  # m/s²

Array = NDArray[np.float64]


class Bench(NamedTuple):
    """Plate, spring, guide, layer, impactor and fixture of one blow; an effect of 0 is absent.

    The plate (displacement x, positive into the sensor) is carried by the spring and the guide
    from the base; the impactor's contact point (displacement w, same sign) presses on it through
    the layer, or directly. Force channel: the elastic force of the spring, as in eq. (9).
    """

    # plate, spring and guide
    mass: float = 1.67  # kg
    stiffness: float = 69e3  # N/m
    damping: float = 47.5  # N s/m
    friction_forward: float = 0.0  # N, kinetic, while the plate moves into the sensor
    friction_backward: float = 0.0  # N, kinetic, while it moves out
    friction_slope: float = 0.0  # N/m, further friction per distance from the rest position
    static_ratio: float = 1.0  # static over kinetic friction
    stribeck_speed: float = 1.0  # m/s, exp(-(v/speed)²) between static and kinetic
    quadratic_forward: float = 0.0  # N s²/m²
    quadratic_backward: float = 0.0  # N s²/m²
    clearance: float = 0.0  # m, whole width of the gap without restoring force, about rest
    cubic: float = 0.0  # N/m³
    stop_travel: float = 0.0  # m, compression at which the end stop is met
    stop_stiffness: float = 0.0  # N/m
    hysteretic_share: float = 0.0  # share of the stiffness that is hysteretic (Bouc-Wen, n = 1)
    yield_displacement: float = 1e-3  # m
    modulation: float = 0.0  # relative amplitude of a stiffness that swings with time
    modulation_frequency: float = 1.0  # Hz
    # layer and contact
    layer_stiffness: float = 0.0  # N/m, parallel spring; 0 and no branch: no layer
    branch_stiffness: float = 0.0  # N/m, first Maxwell branch
    branch_damping: float = 1.0  # N s/m
    second_stiffness: float = 0.0  # N/m, second Maxwell branch
    second_damping: float = 1.0  # N s/m
    stiffening: float = 0.0  # 1/m, layer force times 1 + stiffening * compression
    hertz_stiffness: float = 0.0  # N/m^1.5, contact without a layer
    hertz_damping: float = 0.0  # s/m, Hunt and Crossley: K d^1.5 (1 + damping * approach speed)
    unilateral: float = 1.0  # 1: pushes only; 0: stays together after first contact
    added_mass: float = 0.0  # kg, joins the plate in blows of the impactor
    velocity_squared: float = 0.0  # N s²/m², contact force while approaching
    # impactor
    impactor_mass: float = 0.0  # kg, effective at the contact point; 0: no impactor
    speed: float = 0.0  # m/s at first contact
    gravity_load: float = 0.0  # N
    restoring: float = 0.0  # N/m
    push: float = 0.0  # N
    push_start: float = 0.0  # s after first contact
    push_rise: float = 1e-3  # s, linear rise
    flexible_share: float = 0.0  # share of the mass behind the flexibility
    flexible_frequency: float = 300.0  # Hz, of that share against a fixed contact point
    flexible_damping: float = 0.02  # ratio
    # fixture
    base_mass: float = 0.0  # kg; 0: rigid
    base_frequency: float = 100.0  # Hz, of the base alone
    base_damping: float = 0.02  # ratio
    # outside the library: a damping force ~ d^order/dt^order
    fractional: float = 0.0  # N s^order/m
    fractional_order: float = 0.5
    # a driven axis
    drive_gain: float = 1.0  # true over commanded force
    ripple: float = 0.0  # N, outside the library: sin(2 pi x / pitch)
    ripple_pitch: float = 0.01  # m
    fading: float = 0.0  # N, outside the library: friction fading exp(-t / time)
    fading_time: float = 1.0  # s


BENCH = Bench()


class Pulse(NamedTuple):
    """A force on the plate: peak sin(pi s)^power with s the elapsed share of the duration.

    With ``cycles`` it is a train of so many sine waves instead, as of a shaker.
    """

    start: float  # s after the begin of the simulation
    duration: float  # s
    peak: float  # N
    power: float = 1.0
    cycles: float = 0.0

    def force(self, t: Array) -> Array:
        """Force, N, at times t, s."""
        share = (t - self.start) / self.duration
        acting = (share > 0) & (share < 1)
        if self.cycles > 0:
            return np.where(acting, self.peak * np.sin(2 * np.pi * self.cycles * share), 0.0)
        hump = np.sin(np.pi * np.clip(share, 0.0, 1.0)) ** self.power
        return np.where(acting, self.peak * hump, 0.0)


class Pendulum(NamedTuple):
    """Rod with a movable mass; section 2.2 of the bench's paper (Machines 2024, 12, 26)."""

    rod_mass: float = 0.698  # kg
    rod_length: float = 0.29  # m
    contact_distance: float = 0.26  # m
    moving_mass: float = 1.0  # kg

    def effective_mass(self, distance: float) -> float:
        """Mass at the contact point, kg; eq. (4)."""
        inertia = self.rod_mass * self.rod_length**2 / 3 + self.moving_mass * distance**2
        return inertia / self.contact_distance**2

    def weight_at_contact(self, distance: float) -> float:
        """Static force of the lying rod at the contact point, N (vertical sensor)."""
        moment = self.rod_mass * self.rod_length / 2 + self.moving_mass * distance
        return moment * GRAVITY / self.contact_distance

    def restoring_stiffness(self, distance: float) -> float:
        """Weight against small displacements of the hanging rod, N/m (horizontal sensor)."""
        return self.weight_at_contact(distance) / self.contact_distance

    def speed(self, distance: float, angle_deg: float, orientation: str) -> float:
        """Speed of the contact point at impact, m/s; eqs. (5) vertical and (6) horizontal."""
        angle = math.radians(angle_deg)
        height = math.sin(angle) if orientation == 'vertical' else 1 - math.cos(angle)
        moment = self.weight_at_contact(distance) * self.contact_distance
        energy = moment * height
        return math.sqrt(2 * energy / self.effective_mass(distance))
