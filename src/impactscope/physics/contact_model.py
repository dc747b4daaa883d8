"""The two-body contact model of ISO/TS 15066: force, pressure, energy and permitted speed.

Source: ISO/TS 15066:2016 Annex A as given in Samarathunga et al., Machines 2024, 12, 26,
eq. A1 to A3. Masses kg, stiffness N/m, speeds m/s, forces N, pressures Pa, areas m². All
functions raise ConfigurationError for values that are not above zero.
"""

from __future__ import annotations

import math

from impactscope.errors import ConfigurationError

__all__ = [
    'contact_time',
    'deformation_energy',
    'energy_loss_share',
    'free_force',
    'peak_force',
    'peak_pressure',
    'permitted_speed',
    'permitted_speed_by_pressure',
    'reduced_mass',
    'robot_effective_mass',
    'scaled_speed',
]


def _above_zero(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise ConfigurationError(f'contact model: {name} is {value!r}; it must be above zero')


def robot_effective_mass(moving_mass: float, payload: float = 0.0) -> float:
    """m_R = M/2 + m_L, kg: half of the robot's moving parts, and the payload."""
    _above_zero(moving_mass=moving_mass)
    if not (math.isfinite(payload) and payload >= 0):
        raise ConfigurationError(f'contact model: payload is {payload!r}; it must be zero or more')
    return moving_mass / 2 + payload


def reduced_mass(robot_mass: float, body_mass: float = math.inf) -> float:
    """Mass mu that gives the same contact against a wall, kg (eq. A1).

    A clamped body part (constrained contact) cannot move away: its mass counts as infinite,
    the default, and mu is the robot's own. To use its free mass there errs on the unsafe side.
    """
    _above_zero(robot_mass=robot_mass)
    if body_mass == math.inf:
        return robot_mass
    _above_zero(body_mass=body_mass)
    return robot_mass * body_mass / (robot_mass + body_mass)


def peak_force(speed: float, mass: float, stiffness: float) -> float:
    """F_max = v sqrt(mu k), N (eq. A3)."""
    _above_zero(speed=speed, mass=mass, stiffness=stiffness)
    return speed * math.sqrt(mass * stiffness)


def permitted_speed(force_limit: float, mass: float, stiffness: float) -> float:
    """Speed at which the peak force reaches the limit, m/s: F/sqrt(mu k) (eq. A3)."""
    _above_zero(force_limit=force_limit, mass=mass, stiffness=stiffness)
    return force_limit / math.sqrt(mass * stiffness)


def peak_pressure(speed: float, mass: float, stiffness: float, area: float) -> float:
    """Peak pressure, Pa, of the force spread evenly over the contact area (eq. A2)."""
    _above_zero(area=area)
    return peak_force(speed, mass, stiffness) / area


def permitted_speed_by_pressure(
    pressure_limit: float, area: float, mass: float, stiffness: float
) -> float:
    """Speed at which the pressure reaches its limit, m/s: p A/sqrt(mu k)."""
    _above_zero(pressure_limit=pressure_limit, area=area)
    return permitted_speed(pressure_limit * area, mass, stiffness)


def deformation_energy(force: float, stiffness: float) -> float:
    """Energy stored at a force, J: F²/(2 k) (eq. A2)."""
    _above_zero(force=force, stiffness=stiffness)
    return force**2 / (2 * stiffness)


def contact_time(mass: float, stiffness: float) -> float:
    """Duration of the half-sine contact of a mass on a spring, s: pi sqrt(mu/k)."""
    _above_zero(mass=mass, stiffness=stiffness)
    return math.pi * math.sqrt(mass / stiffness)


def free_force(fixed_force: float, robot_mass: float, body_mass: float) -> float:
    """Peak force of a free contact from the one measured on a fixed device, N.

    F_free = F_fixed sqrt(m_H/(m_H + m_R)): both masses on the same spring at the same speed.
    """
    _above_zero(fixed_force=fixed_force)
    return fixed_force * math.sqrt(reduced_mass(robot_mass, body_mass) / robot_mass)


def scaled_speed(speed: float, measured_force: float, force_limit: float) -> float:
    """Speed that would just keep a limit, m/s, from one measured blow: v F_limit/F.

    The model's force grows in proportion to speed; a robot that reacts does not quite follow
    it, so confirm the result by a measurement at that speed.
    """
    _above_zero(speed=speed, measured_force=measured_force, force_limit=force_limit)
    return speed * force_limit / measured_force


def energy_loss_share(plate_mass: float, impactor_mass: float, restitution: float = 0.0) -> float:
    """Share of the impactor's kinetic energy that a blow on a resting plate loses at once.

    (1 - e²) m/(m + M): momentum is kept, a plastic blow (e = 0) loses most. Raises
    ConfigurationError for a restitution outside [0, 1].
    """
    _above_zero(plate_mass=plate_mass, impactor_mass=impactor_mass)
    if not 0 <= restitution <= 1:
        raise ConfigurationError(
            f'contact model: restitution is {restitution!r}; it must lie in [0, 1]'
        )
    return (1 - restitution**2) * plate_mass / (plate_mass + impactor_mass)
