"""What stands on the bench and what strikes it: immutable descriptions, SI units."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from impactscope.errors import ConfigurationError
from impactscope.physics.damper_layer import PAPER_LAYER_SH10, DamperLayer, MaxwellBranch
from impactscope.physics.pendulum import Orientation, Pendulum

__all__ = [
    'IMPACT_RATE_LAYER',
    'LOSSES',
    'PAPER_LAYER',
    'BareContact',
    'Bench',
    'Blow',
    'DamperLayer',
    'HammerTap',
    'LossOf',
    'MaxwellBranch',
    'MeasuredForce',
    'PendulumBlow',
    'RobotBlow',
    'Sensor',
]

LossOf = Literal['material', 'blow', 'contact']
"""What the loss of a bare contact is a constant of; see :class:`BareContact`."""
LOSSES: tuple[LossOf, ...] = get_args(LossOf)


def _check(owner: str, **limits: tuple[float, float, float]) -> None:
    """Raise ConfigurationError for the first value outside its (low, high) bounds."""
    for name, (value, low, high) in limits.items():
        if not low <= value <= high:
            raise ConfigurationError(
                f'{owner}: {name} is {value!r}; it must be from {low:g} to {high:g}'
            )


@dataclass(frozen=True, slots=True)
class Sensor:
    """Plate on spring and guide (eq. 7); defaults are the paper's sensor."""

    stiffness: float = 69_000.0  # N/m
    moving_mass: float = 1.671  # kg
    damping_ratio: float = 0.0692
    reads: str = 'spring_force'  # or 'displacement', k x
    damping_constant: float | None = None  # N s/m; given, it takes the damping ratio's place

    def __post_init__(self) -> None:
        _check(
            'sensor',
            stiffness=(self.stiffness, 0.0, 1e9),
            moving_mass=(self.moving_mass, 1e-6, 1e6),
            damping_ratio=(self.damping_ratio, 0.0, 100.0),
        )
        if self.damping_constant is not None:
            _check('sensor', damping_constant=(self.damping_constant, 0.0, 1e9))
        if self.reads not in ('spring_force', 'displacement'):
            raise ConfigurationError(
                f"sensor: reads is {self.reads!r}; it must be 'spring_force' or 'displacement'"
            )

    @property
    def damping(self) -> float:
        """Damping constant c, N s/m: as given, or 2 zeta sqrt(k m)."""
        if self.damping_constant is not None:
            return self.damping_constant
        return 2 * self.damping_ratio * math.sqrt(self.stiffness * self.moving_mass)

    @property
    def natural_frequency(self) -> float:
        """Undamped, Hz."""
        return math.sqrt(self.stiffness / self.moving_mass) / (2 * math.pi)


MOST_BRANCHES = 6  # that the compiled equations hold

PAPER_LAYER = dataclasses.replace(
    PAPER_LAYER_SH10,
    name='SH10 at 10 mm/min',
    origin=(
        "Samarathunga et al. 2024, section 3.3, from ramps of 10 mm/min: the branch's time is "
        '4.1 s, so during an impact this layer is a nearly lossless spring of 57 N/mm.'
    ),
)

IMPACT_RATE_LAYER = dataclasses.replace(
    PAPER_LAYER_SH10,
    branches=(
        *PAPER_LAYER_SH10.branches,
        MaxwellBranch(42_000.0, 840.0),
        MaxwellBranch(32_000.0, 130.0),
        MaxwellBranch(111_000.0, 100.0),
    ),
    name='SH10 with assumed branches at impact rate',
    origin=(
        "The paper's constants of 10 mm/min with three further branches that are an assumption, "
        'not a measurement: their times (20, 4 and 0.9 ms) are spread over the band of an impact '
        'and their stiffnesses give a loss factor of 0.4 from 8 to 150 Hz, as strongly damping '
        'elastomers have it. A test at impact rate must replace them.'
    ),
)


@dataclass(frozen=True, slots=True)
class BareContact:
    """Impactor on plate without damper: Hunt and Crossley, F = K d^n (1 + a d').

    ``restitution`` is that of a free blow; the loss ``a`` follows. Hunt and Crossley's ``a`` is
    one of the ``'material'``: then the restitution is that at ``restitution_speed`` m/s, and falls
    with the speed. Others take ``a`` from the speed of the ``'blow'`` (as Lankarani and Nikravesh
    do), so that its first contact has that restitution at any speed, or from that of each
    ``'contact'``. The default stiffness is that of a rounded aluminium tip on a steel plate.
    Sources: Hunt and Crossley, J. Appl. Mech. 42 (1975); Lankarani and Nikravesh, J. Mech. Des.
    112 (1990).
    """

    stiffness: float = 1e9  # N/m^exponent
    exponent: float = 1.5
    restitution: float = 0.5
    restitution_speed: float = 0.5  # m/s
    loss_of: LossOf = 'material'

    def __post_init__(self) -> None:
        if self.loss_of not in LOSSES:
            raise ConfigurationError(
                f'bare contact: loss_of {self.loss_of!r} is none of {", ".join(LOSSES)}'
            )
        _check(
            'bare contact',
            stiffness=(self.stiffness, 1.0, 1e14),
            exponent=(self.exponent, 1.0, 5.0),
            restitution=(self.restitution, 0.02, 1.0),
            restitution_speed=(self.restitution_speed, 1e-4, 100.0),
        )

    @property
    def loss(self) -> float:
        """The constant a, s/m.

        Integrating the free blow gives ln((1 + d)/(1 - e d)) = d (1 + e) with d = a v; the
        exponent drops out.
        """
        return _loss(self.restitution, self.restitution_speed)

    @property
    def loss_by_speed(self) -> float:
        """The product of ``a`` and the speed at which a contact has the restitution."""
        return _loss(self.restitution, 1.0)


@functools.lru_cache(maxsize=64)
def _loss(restitution: float, speed: float) -> float:
    e = restitution
    if e > 1 - 1e-9:
        return 0.0

    def excess(d: float) -> float:
        return math.log1p(d) - math.log1p(-e * d) - d * (1 + e)

    highest = (1 - 1e-14) / e
    if excess(highest) <= 0:  # nearly plastic: e = 1/d to the last digit
        return highest / speed
    # d is about 1.5 (1 - e) for small losses; at a tenth of that the excess is negative
    return float(brentq(excess, 0.15 * (1 - e), highest)) / speed


@dataclass(frozen=True, slots=True)
class Bench:
    """The measuring side. ``body_mass`` in kg: the sensor rides on a free body part; 0: clamped.

    ``damper`` None: the impactor strikes the bare plate by ``contact``.
    """

    sensor: Sensor = field(default_factory=Sensor)
    damper: DamperLayer | None = IMPACT_RATE_LAYER
    contact: BareContact = field(default_factory=BareContact)
    orientation: Orientation = Orientation.VERTICAL
    body_mass: float = 0.0

    def __post_init__(self) -> None:
        _check('bench', body_mass=(self.body_mass, 0.0, 1e4))
        if self.damper is not None and len(self.damper.branches) > MOST_BRANCHES:
            raise ConfigurationError(
                f'bench: a damper of {len(self.damper.branches)} branches; '
                f'{MOST_BRANCHES} at most can be simulated'
            )

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of a simulation must know of its assumptions, in sentences."""
        if self.damper is not None:
            return (self.damper.origin,) if self.damper.origin else ()
        return (
            f'Bare contact after Hunt and Crossley with a restitution of '
            f'{self.contact.restitution:g} at {self.contact.restitution_speed:g} m/s, assumed.',
        )


@dataclass(frozen=True, slots=True)
class HammerTap:
    """A half-sine force on the plate; there is no impactor.

    For a hammer with a mass, that may bounce: a RobotBlow without a push on a bare bench.
    """

    peak_force: float = 150.0  # N
    duration: float = 0.004  # s

    def __post_init__(self) -> None:
        _check(
            'hammer tap',
            peak_force=(self.peak_force, -1e5, 1e5),
            duration=(self.duration, 1e-6, 10.0),
        )


@dataclass(frozen=True, slots=True)
class PendulumBlow:
    """A pendulum released at rest. Times count from first contact.

    ``lift_time``: from here on the pendulum is taken off the plate; ``catch_time``: from here
    on it is held as soon as it is off the plate. Infinite: neither happens. ``large_angles``: the
    weight acts with cosine and sine of the swing, not as a constant load and a linear spring.
    """

    pendulum: Pendulum = field(default_factory=Pendulum)
    release_angle: float = math.radians(10.0)  # rad
    lift_time: float = math.inf  # s
    catch_time: float = math.inf  # s
    large_angles: bool = False

    def __post_init__(self) -> None:
        _check('pendulum blow', release_angle=(self.release_angle, 0.0, math.pi))


@dataclass(frozen=True, slots=True)
class RobotBlow:
    """A robot that strikes with its effective mass and pushes until it has stopped.

    Its drive pushes with ``push_force`` N from first contact on, rising over ``push_rise`` s,
    held for ``push_hold`` s and let go over ``push_fall`` s; then it is drawn back. Without a push
    it is a mass that flies freely.
    """

    effective_mass: float = 4.0  # kg
    speed: float = 0.25  # m/s
    push_force: float = 40.0  # N
    push_rise: float = 0.02  # s
    push_hold: float = 0.7  # s
    push_fall: float = 0.1  # s
    retract_force: float = 30.0  # N

    def __post_init__(self) -> None:
        _check(
            'robot blow',
            effective_mass=(self.effective_mass, 1e-3, 1e4),
            speed=(self.speed, 0.0, 20.0),
            push_force=(self.push_force, 0.0, 1e4),
            push_rise=(self.push_rise, 1e-5, 10.0),
            push_hold=(self.push_hold, 0.0, 1e6),
            push_fall=(self.push_fall, 1e-5, 10.0),
            retract_force=(self.retract_force, 0.0, 1e4),
        )


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredForce:
    """A force on the plate that was measured: instrumented hammer, shaker, drive.

    ``values`` in N, shape (n,), from time 0 on, straight lines in between; within one more
    sample it falls to zero.
    """

    values: NDArray[np.float64]
    sample_rate: float  # Hz

    def __post_init__(self) -> None:
        _check('measured force', sample_rate=(self.sample_rate, 1e-6, 1e8))
        values = np.asarray(self.values)
        if values.ndim != 1 or values.size < 2 or not np.isfinite(values).all():
            raise ConfigurationError(
                f'measured force: values of shape {values.shape} must be a row of at least two '
                'finite numbers'
            )


Blow = HammerTap | PendulumBlow | RobotBlow | MeasuredForce
"""What sets the bench in motion."""
