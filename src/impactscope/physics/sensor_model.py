"""The force sensor as plate, spring and damper: frequency response, resonance, bandwidth.

Source: Samarathunga et al., Machines 2024, 12, 26, eq. 7 to 10, 26 to 28 and Fig. 8. The damping
ratio is c/(2 sqrt(k m)), as in eq. 27; the text of eq. 10 has sqrt(2 k m) by mistake.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import ConfigurationError

__all__ = ['PAPER_SENSOR', 'SensorModel', 'bandwidth_ratio', 'free_motion']

_SERIES_BELOW = 1e-8  # where (sqrt(zeta² - 1) w t)² is this small, its sine is its argument


def bandwidth_ratio(damping_ratio: float) -> float:
    """The -3 dB bandwidth over the undamped natural frequency (eq. 28)."""
    a = 1 - 2 * damping_ratio**2
    return math.sqrt(a + math.sqrt(a * a + 1))


def free_motion(
    time: ArrayLike,
    natural_frequency: ArrayLike,
    damping_ratio: ArrayLike,
    displacement: ArrayLike,
    velocity: ArrayLike,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Displacement and velocity of the unloaded oscillator, at any damping ratio >= 0.

    All arguments broadcast: time s (negative gives the start values), undamped natural
    frequency rad/s, initial displacement m and velocity m/s. Closed form of eq. 7 with f_i = 0.
    """
    t = np.maximum(np.asarray(time, np.float64), 0.0)
    w = np.asarray(natural_frequency, np.float64)
    z = np.asarray(damping_ratio, np.float64)
    x0, v0 = np.asarray(displacement, np.float64), np.asarray(velocity, np.float64)
    square = 1 - z * z
    root = w * np.sqrt(np.abs(square))
    angle = root * t
    # x = e^(-z w t) (x0 C + (v0 + z w x0) S), C and S being cosine and sine over frequency,
    # or their hyperbolic kin when overdamped; these as sums of decays, which cannot overflow.
    decay = np.exp(-z * w * t)
    under = square > 0
    spread = np.where(under, 0.0, angle)
    slow, fast = np.exp(-z * w * t + spread), np.exp(-z * w * t - spread)
    small = angle * angle < _SERIES_BELOW
    safe_root = np.where(root > 0, root, 1.0)
    cosine = np.where(under, decay * np.cos(angle), 0.5 * (slow + fast))
    sine = np.where(under, decay * np.sin(angle), 0.5 * (slow - fast)) / safe_root
    sine = np.where(small, decay * t, sine)
    x = x0 * cosine + (v0 + z * w * x0) * sine
    v = v0 * cosine - (z * w * v0 + w * w * x0) * sine
    return x, v


@dataclass(frozen=True, slots=True)
class SensorModel:
    """Moving plate on spring and viscous guide (Fig. 3b); SI units.

    Raises ConfigurationError on construction unless mass and stiffness are above zero and the
    damping constant is not negative.
    """

    mass: float  # m, kg: plate and the guide's moving parts
    stiffness: float  # k, N/m
    damping_constant: float  # c, N s/m

    def __post_init__(self) -> None:
        for name, value in (('mass', self.mass), ('stiffness', self.stiffness)):
            if not (math.isfinite(value) and value > 0):
                raise ConfigurationError(f'sensor: {name} is {value!r}; it must be above zero')
        if not (math.isfinite(self.damping_constant) and self.damping_constant >= 0):
            raise ConfigurationError(
                f'sensor: damping_constant is {self.damping_constant!r}; it must be zero or more'
            )

    @classmethod
    def from_modal(
        cls, natural_frequency: float, damping_ratio: float, stiffness: float
    ) -> SensorModel:
        """Build from undamped natural frequency in Hz, damping ratio and stiffness in N/m."""
        w = 2 * math.pi * natural_frequency
        if not (math.isfinite(w) and w > 0):
            raise ConfigurationError(
                f'sensor: natural frequency is {natural_frequency!r} Hz; it must be above zero'
            )
        return cls(stiffness / w**2, stiffness, 2 * damping_ratio * stiffness / w)

    @property
    def natural_angular_frequency(self) -> float:
        """Undamped, rad/s: sqrt(k/m)."""
        return math.sqrt(self.stiffness / self.mass)

    @property
    def natural_frequency(self) -> float:
        """Undamped, Hz."""
        return self.natural_angular_frequency / (2 * math.pi)

    @property
    def damping_ratio(self) -> float:
        """c/(2 sqrt(k m)) (eq. 27)."""
        return self.damping_constant / (2 * math.sqrt(self.stiffness * self.mass))

    @property
    def damped_frequency(self) -> float:
        """Of the free oscillation, Hz; 0 where there is none (damping ratio 1 or more)."""
        return self.natural_frequency * math.sqrt(max(0.0, 1 - self.damping_ratio**2))

    @property
    def bandwidth(self) -> float:
        """Frequency at which the response is 3 dB below its static value, Hz (eq. 28)."""
        return self.natural_frequency * bandwidth_ratio(self.damping_ratio)

    @property
    def resonance_frequency(self) -> float:
        """Frequency of the largest response, Hz; 0 where the response only falls."""
        return self.natural_frequency * math.sqrt(max(0.0, 1 - 2 * self.damping_ratio**2))

    @property
    def resonance_peak(self) -> float:
        """Largest ratio of measured to contact force over all frequencies; inf undamped."""
        zeta = self.damping_ratio
        if zeta >= math.sqrt(0.5):
            return 1.0
        return math.inf if zeta == 0 else 1 / (2 * zeta * math.sqrt(1 - zeta**2))

    @property
    def time_constant(self) -> float:
        """2/omega_n, s: what the paper's section 3.1.1 calls the time constant."""
        return 2 / self.natural_angular_frequency

    @property
    def decay_time(self) -> float:
        """1/(zeta omega_n) = 2 m/c, s: in it a free oscillation falls to 1/e; inf undamped."""
        return 2 * self.mass / self.damping_constant if self.damping_constant > 0 else math.inf

    def mechanical_stiffness(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """A = F_i/X = m s² + c s + k at s = j 2 pi f, N/m (eq. 21); f in Hz, any shape."""
        s = 2j * np.pi * np.asarray(frequency, np.float64)
        return np.asarray((self.mass * s + self.damping_constant) * s + self.stiffness)

    def compliance(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """X/F_i, m/N (eq. 8); frequency in Hz, any shape."""
        return np.asarray(1 / self.mechanical_stiffness(frequency))

    def frequency_response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """F_o/F_i (eq. 10 and 24); frequency in Hz, any shape."""
        return np.asarray(self.stiffness / self.mechanical_stiffness(frequency))

    def bode(self, frequency: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Magnitude, dB, and phase, degrees (0 to -180), of F_o/F_i; frequency in Hz (Fig. 8)."""
        response = self.frequency_response(frequency)
        return 20 * np.log10(np.abs(response)), -np.degrees(np.angle(1 / response))

    def free_response(
        self, time: ArrayLike, displacement: float, velocity: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Plate's displacement m and velocity m/s at ``time`` s after being let go."""
        w = self.natural_angular_frequency
        return free_motion(time, w, self.damping_ratio, displacement, velocity)


PAPER_SENSOR = SensorModel(
    mass=69e3 / 203.2**2, stiffness=69e3, damping_constant=2 * 0.0692 * 69e3 / 203.2
)
"""The sensor of the paper as identified there (section 3.1.1): 1.67 kg, 69 N/mm, 47 N s/m."""
