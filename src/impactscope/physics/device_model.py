"""The whole measuring device: sensor under damper layer.

Source: Samarathunga et al., Machines 2024, 12, 26, section 2.3.3, eq. 15 to 25, for any number of
Maxwell branches. Eq. 25 is printed as k B/(A + B); from eq. 16 it follows as k B/C with
C = A (k1 + c1 s) + B (the printed one adds N/m to N²/m²).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

from impactscope.physics.damper_layer import DamperLayer
from impactscope.physics.sensor_model import SensorModel

__all__ = ['DeviceModel']

Complex = NDArray[np.complex128]
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DeviceModel:
    """Sensor and massless layer in series; the layer's mass counts as the plate's.

    Frequencies in Hz, any shape. Displacement W is that of the contact point.
    """

    sensor: SensorModel
    layer: DamperLayer

    def force_to_force(self, frequency: ArrayLike) -> Complex:
        """F_o/F_i (eq. 24): the layer does not enter."""
        return self.sensor.frequency_response(frequency)

    def displacement_to_force(self, frequency: ArrayLike) -> Complex:
        """F_o/W, N/m (eq. 16; eq. 25 corrected)."""
        return self.sensor.stiffness * self.displacement_to_plate(frequency)

    def displacement_to_contact_force(self, frequency: ArrayLike) -> Complex:
        """F_i/W, N/m (eq. 17): what the impactor feels."""
        plate = self.sensor.mechanical_stiffness(frequency)
        return np.asarray(plate * self.displacement_to_plate(frequency))

    def displacement_to_plate(self, frequency: ArrayLike) -> Complex:
        """X/W (eq. 18)."""
        plate = self.sensor.mechanical_stiffness(frequency)
        layer = self.layer.dynamic_stiffness(frequency)
        return np.asarray(layer / (plate + layer))

    def displacement_to_branch(self, frequency: ArrayLike) -> tuple[Complex, Complex]:
        """Y/W and Z/W of each branch (eq. 19 and 20), each of shape (n_branches, ...)."""
        s = 2j * np.pi * np.asarray(frequency, np.float64)
        layer = 1 - self.displacement_to_plate(frequency)
        dashpots = np.array([layer / (1 + b.relaxation_time * s) for b in self.layer.branches])
        return layer - dashpots, dashpots

    def polynomials(self) -> tuple[Array, Array, Array]:
        """Coefficients of A, B and C, lowest power of s first (eq. 21 to 23).

        For one branch these are the paper's; B/C is X/W. With more branches B is the layer's
        stiffness times the product of all (k_i + c_i s), and C = A times that product plus B.
        """
        a = np.array([self.sensor.stiffness, self.sensor.damping_constant, self.sensor.mass])
        factors = [np.array([b.stiffness, b.viscosity]) for b in self.layer.branches]
        product = np.array([1.0])
        for factor in factors:
            product = polynomial.polymul(product, factor)
        b_sum = self.layer.equilibrium_stiffness * product
        for i, branch in enumerate(self.layer.branches):
            others = np.array([0.0, branch.stiffness * branch.viscosity])
            for j, factor in enumerate(factors):
                if j != i:
                    others = polynomial.polymul(others, factor)
            b_sum = polynomial.polyadd(b_sum, others)
        return a, b_sum, polynomial.polyadd(polynomial.polymul(a, product), b_sum)

    def poles(self) -> Complex:
        """Poles of displacement-to-force, rad/s: the plate held between spring and layer."""
        return np.asarray(polynomial.polyroots(self.polynomials()[2]), np.complex128)

    @property
    def static_stiffness(self) -> float:
        """F/W of a hold that has relaxed, N/m: spring and layer in series."""
        k, k2 = self.sensor.stiffness, self.layer.equilibrium_stiffness
        return k * k2 / (k + k2)

    @property
    def quick_stiffness(self) -> float:
        """F/W of a push slow for the plate, too quick for the layer to relax, N/m."""
        k, layer = self.sensor.stiffness, self.layer.instantaneous_stiffness
        return k * layer / (k + layer)
