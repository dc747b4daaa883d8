"""Effective mass of an unknown impactor, such as a robot, from one blow.

Newton's second law at the contact point: where the impactor carries an accelerometer,
contact force against acceleration over the contact; where only its speed is known, the impulse
that stopped it. A push that lasts (a robot's drive, a pendulum's weight) is told from inertia
by the first and not by the second, which then reads too much mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from impactscope.errors import EstimationError
from impactscope.records import Estimate

__all__ = ['ImpactorFit', 'mass_from_acceleration', 'mass_from_momentum']

_FEWEST_SAMPLES = 8


@dataclass(frozen=True, slots=True)
class ImpactorFit:
    """What drives the contact force: inertia, and a push that lasts."""

    mass: Estimate  # kg
    push: Estimate  # N, mean over the contact
    r_squared: float


def mass_from_acceleration(
    contact_force: ArrayLike,
    deceleration: ArrayLike,
    *,
    deceleration_noise: float = 0.0,
    gain_std: float = 0.0,
) -> ImpactorFit:
    """Least squares of F = M d + P over the samples of one contact.

    ``contact_force`` N and ``deceleration`` of the impactor m/s² (positive while it is slowed)
    have shape (n_samples,), on one grid, during contact only. ``deceleration_noise`` m/s² is
    allowed for, as it would pull the mass down; ``gain_std`` is the relative standard
    uncertainty of force over acceleration. Residuals that go together from sample to sample
    (a flexible impactor, friction) widen the uncertainty. Raises EstimationError where the
    contact is too short, force and deceleration do not go together, or the mass is not positive.
    """
    f, d = np.asarray(contact_force, np.float64), np.asarray(deceleration, np.float64)
    if f.shape != d.shape or f.ndim != 1 or f.size < _FEWEST_SAMPLES:
        raise EstimationError(
            f'effective mass: {f.size} samples of contact; at least {_FEWEST_SAMPLES} are needed'
        )
    n = f.size
    df, dd = f - f.mean(), d - d.mean()
    spread = float(dd @ dd) - n * deceleration_noise**2  # less what noise adds to it
    if spread <= 0.5 * float(dd @ dd) or not math.isfinite(spread):
        raise EstimationError('effective mass: the deceleration does not rise above its noise')
    mass = float(df @ dd) / spread
    residual = df - mass * dd
    r_squared = 1 - float(residual @ residual) / float(df @ df)
    if mass <= 0 or r_squared < 0.5:
        raise EstimationError(
            f'effective mass: force and deceleration do not go together (R² {r_squared:.2f}, '
            f'{mass:.3g} kg)'
        )
    power = float(residual @ residual)
    lag = float(np.clip(residual[1:] @ residual[:-1] / power, 0.0, 0.99)) if power > 0 else 0.0
    variance = power / (n - 2) * (1 + lag) / (1 - lag)
    std = math.hypot(math.sqrt(variance / spread), mass * gain_std)
    push_std = math.hypot(math.sqrt(variance / n), float(d.mean()) * std)
    return ImpactorFit(
        Estimate(mass, std), Estimate(float(f.mean() - mass * d.mean()), push_std), r_squared
    )


def mass_from_momentum(impulse: Estimate, speed_change: Estimate) -> Estimate:
    """Mass, kg: impulse of the contact force, N s, over the change of speed it made, m/s.

    Raises EstimationError where either is not known or not positive.
    """
    if not (impulse.value > 0 and speed_change.value > 0):
        raise EstimationError(
            f'effective mass: impulse {impulse.value:.3g} N s and change of speed '
            f'{speed_change.value:.3g} m/s must be above zero'
        )
    mass = impulse.value / speed_change.value
    relative = [e.std / e.value for e in (impulse, speed_change) if math.isfinite(e.std)]
    known = math.isfinite(impulse.std) and math.isfinite(speed_change.std)
    return Estimate(mass, mass * math.hypot(*relative) if known else math.nan)
