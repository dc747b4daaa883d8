"""The impact pendulum: energy, equivalent mass, impact speed and the forces of its weight.

Source: Samarathunga et al., Machines 2024, 12, 26, section 2.2, eq. 1 to 6. Orientation names
the sensor's orientation, as there: on the vertical bench (Fig. 2a) the rod is horizontal at
impact and comes to rest on the plate; on the horizontal bench (Fig. 2b) the rod hangs at impact.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from impactscope.errors import ConfigurationError

__all__ = ['STANDARD_GRAVITY', 'Orientation', 'Pendulum']

STANDARD_GRAVITY = 9.80665
"""m/s², conventional value."""


class Orientation(enum.Enum):
    """Orientation of the sensor's axis."""

    VERTICAL = 'vertical'
    HORIZONTAL = 'horizontal'


@dataclass(frozen=True, slots=True)
class Pendulum:
    """A uniform rod on a hinge with a mass that can be moved along it; SI units.

    Defaults are those of the paper's bench. Raises ConfigurationError on construction where a
    mass is negative, a length is out of range or nothing would have inertia.
    """

    rod_mass: float = 0.698  # m_b
    rod_length: float = 0.29  # L
    contact_distance: float = 0.26  # l, hinge to contact point
    moving_mass: float = 1.0  # M
    mass_distance: float = 0.25  # d, hinge to moving mass
    gravity: float = STANDARD_GRAVITY  # g

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise ConfigurationError(
                    f'pendulum: {name} is {value!r}; it must be finite and not negative'
                )
        if self.contact_distance == 0 or self.inertia == 0:
            raise ConfigurationError(
                f'pendulum: contact_distance {self.contact_distance!r} m and inertia '
                f'{self.inertia!r} kg m² must be above zero'
            )

    @property
    def inertia(self) -> float:
        """Moment of inertia about the hinge, kg m²: J0 + M d² with J0 = m_b L²/3 (eq. 2)."""
        return self.rod_mass * self.rod_length**2 / 3 + self.moving_mass * self.mass_distance**2

    @property
    def mass_moment(self) -> float:
        """First moment of mass about the hinge, kg m: m_b L/2 + M d (eq. 1)."""
        return self.rod_mass * self.rod_length / 2 + self.moving_mass * self.mass_distance

    @property
    def equivalent_mass(self) -> float:
        """Mass at the contact point with the same kinetic energy, kg (eq. 4)."""
        return self.inertia / self.contact_distance**2

    def height_factor(
        self, angle: float, orientation: Orientation = Orientation.VERTICAL
    ) -> float:
        """Potential energy over mass_moment x g, from the impact position; angle in rad.

        sin(alpha), with alpha from the horizontal, on the vertical bench (eq. 1);
        1 - cos(theta), with theta from the hanging position, on the horizontal one (eq. 6).
        """
        if orientation is Orientation.VERTICAL:
            return math.sin(angle)
        return 2 * math.sin(angle / 2) ** 2  # 1 - cos without loss of digits

    def potential_energy(
        self, angle: float, orientation: Orientation = Orientation.VERTICAL
    ) -> float:
        """Potential energy above the impact position, J, at ``angle`` rad (eq. 1)."""
        return self.mass_moment * self.gravity * self.height_factor(angle, orientation)

    def kinetic_energy(self, angular_speed: float) -> float:
        """Kinetic energy, J, at ``angular_speed`` rad/s (eq. 2)."""
        return 0.5 * self.inertia * angular_speed**2

    def impact_speed(
        self, release_angle: float, orientation: Orientation = Orientation.VERTICAL
    ) -> float:
        """Speed of the contact point at impact, m/s, released at rest (eq. 5 and 6).

        Raises ConfigurationError where the release is not above the impact position.
        """
        energy = self.potential_energy(release_angle, orientation)
        if not math.isfinite(release_angle) or energy < 0:
            raise ConfigurationError(
                f'pendulum: release angle {release_angle!r} rad is not above the impact position'
            )
        return self.contact_distance * math.sqrt(2 * energy / self.inertia)

    def release_angle(
        self, impact_speed: float, orientation: Orientation = Orientation.VERTICAL
    ) -> float:
        """Release angle, rad, that gives ``impact_speed`` m/s: eq. 5 and 6 solved for the angle.

        Raises ConfigurationError where no release angle up to the highest point gives it.
        """
        energy = 0.5 * self.equivalent_mass * impact_speed**2
        weight_moment = self.mass_moment * self.gravity
        factor = energy / weight_moment if weight_moment > 0 else math.inf
        highest = 1.0 if orientation is Orientation.VERTICAL else 2.0
        if not 0 <= factor <= highest or impact_speed < 0:
            raise ConfigurationError(
                f'pendulum: no release angle gives an impact speed of {impact_speed!r} m/s'
            )
        if orientation is Orientation.VERTICAL:
            return math.asin(factor)
        return 2 * math.asin(math.sqrt(factor / 2))

    def contact_weight(
        self, displacement: float = 0.0, orientation: Orientation = Orientation.VERTICAL
    ) -> float:
        """Force of the weight at the contact point into the plate, N.

        ``displacement`` in m is that of the contact point from the impact position, positive
        into the plate, at most ``contact_distance``. Vertical: the weight rests on the plate,
        (m_b L/2 + M d) g/l at zero displacement. Horizontal: the weight pulls back (negative).
        """
        ratio = displacement / self.contact_distance
        if not abs(ratio) <= 1:
            raise ConfigurationError(
                f'pendulum: displacement {displacement!r} m is beyond the reach of the rod'
            )
        force = self.mass_moment * self.gravity / self.contact_distance
        if orientation is Orientation.VERTICAL:
            return force * math.sqrt(1 - ratio**2)
        return -force * ratio

    def restoring_stiffness(self, orientation: Orientation = Orientation.VERTICAL) -> float:
        """-d(contact_weight)/d(displacement) at the impact position, N/m.

        Zero on the vertical bench (the weight is at its largest lever), mass_moment g/l² on
        the horizontal one: a soft spring beside the sensor's, which brings the rod back.
        """
        if orientation is Orientation.VERTICAL:
            return 0.0
        return self.mass_moment * self.gravity / self.contact_distance**2

    @property
    def swing_period(self) -> float:
        """Period of a small free swing about the hanging position, s; inf without gravity."""
        moment = self.mass_moment * self.gravity
        return math.inf if moment == 0 else 2 * math.pi * math.sqrt(self.inertia / moment)
