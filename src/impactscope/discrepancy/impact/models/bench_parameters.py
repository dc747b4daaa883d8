"""Parameters of the bench by their keys, and the simulation that they describe."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping

from impactscope.discrepancy.impact.data.blows import BlowData
from impactscope.physics.pendulum import STANDARD_GRAVITY, Orientation, Pendulum
from impactscope.physics.twin.bench import (
    LOSSES,
    BareContact,
    Bench,
    Blow,
    DamperLayer,
    HammerTap,
    MaxwellBranch,
    PendulumBlow,
    RobotBlow,
    Sensor,
)

__all__ = [
    'ADDED_WEIGHT',
    'GRAVITY',
    'LARGE_ANGLES',
    'LOSS_OF',
    'WEIGHT',
    'after_loss',
    'describe',
    'follow_weight',
    'weight_as_stated',
]

WEIGHT, ADDED_WEIGHT = 'weight', 'added_weight'
"""Of a weight that follows from geometry or mass: a factor on it, and what it has beside, N."""

LARGE_ANGLES = 'pendulum.large_angles'
"""Above 0: the pendulum's weight acts with cosine and sine of the swing."""

GRAVITY = 'gravity'
"""Of the site, m/s²; standard gravity where it is not among the values."""
LOSS_OF = 'contact.loss_of'
"""What the loss of a bare contact is a constant of: place among `LOSSES`."""

_KEPT = 256  # of each part of a bench
_BARE = BareContact()


def after_loss(key: str, stated: float, ratio: float, values: Mapping[str, float]) -> float:
    """What a release as stated amounts to after a loss of speed, as an angle or a speed.

    The fitted release is the one that gives the speed at impact. So a loss of speed does not
    enter the equations of motion, only what the stated release leads to expect: the two could
    otherwise hardly be told apart by a fit whose sensitivity to speed is very large.
    """
    if key.startswith('speed@'):
        return ratio * stated
    if not key.startswith('angle@'):
        return stated
    if values.get('orientation', 0.0) > 0.5:
        return math.degrees(2 * math.asin(min(ratio * math.sin(math.radians(stated) / 2), 1.0)))
    return math.degrees(math.asin(min(ratio**2 * math.sin(math.radians(stated)), 1.0)))


def weight_as_stated(values: Mapping[str, float], tag: str) -> tuple[float, float]:
    """Factor on a weight that follows from geometry or mass, and what it has beside, N."""
    share = values.get(f'{tag}.{WEIGHT}', 1.0)
    return share, values.get(f'{tag}.{ADDED_WEIGHT}', 0.0)


def follow_weight(
    numbers: dict[str, float],
    blow: Blow,
    bench: Bench,
    as_stated: tuple[float, float],
    gravity: float,
) -> bool:
    """Fill in a weight that is to follow from geometry or mass; False: none acts.

    ``gravity``: of the site, m/s².
    """
    share, more = as_stated
    if isinstance(blow, RobotBlow) and math.isnan(numbers.get('force', 0.0)):
        numbers['force'] = share * blow.effective_mass * gravity + more
    if not isinstance(blow, PendulumBlow):
        return True
    pendulum, horizontal = blow.pendulum, bench.orientation is Orientation.HORIZONTAL
    if 'force' in numbers and math.isnan(numbers['force']):
        numbers['force'] = share * pendulum.contact_weight() + more
        return not horizontal
    if 'stiffness' in numbers and math.isnan(numbers['stiffness']):
        numbers['stiffness'] = share * pendulum.restoring_stiffness(Orientation.HORIZONTAL)
        return horizontal
    return True


# most numbers of a blow are those of the one simulated before
_sensor = functools.lru_cache(_KEPT)(Sensor)
_contact = functools.lru_cache(_KEPT)(BareContact)
_pendulum = functools.lru_cache(_KEPT)(Pendulum)


@functools.lru_cache(_KEPT)
def _layer(parallel: float, branches: tuple[tuple[float, float], ...]) -> DamperLayer:
    return DamperLayer(parallel, tuple(MaxwellBranch(*numbers) for numbers in branches))


def describe(values: Mapping[str, float], data: BlowData, i: int) -> tuple[Bench, Blow]:
    """Bench and blow of the twin for blow ``i`` with these numbers."""
    recording = data.recording

    def of(key: str, default: float = math.nan) -> float:
        return values.get(f'{key}@{i}', values.get(key, default))

    sensor = _sensor(of('sensor.stiffness'), of('sensor.moving_mass'), of('sensor.damping_ratio'))
    horizontal = of('orientation', 0.0) > 0.5
    orientation = Orientation.HORIZONTAL if horizontal else Orientation.VERTICAL
    if recording.kind == 'tap':
        return Bench(sensor, damper=None, orientation=orientation), HammerTap(
            of('tap_peak'), of('tap_duration')
        )
    damper = None
    contact = _BARE
    if recording.damper and 'damper.parallel_stiffness' in values:
        branches: list[tuple[float, float]] = []
        while f'damper.branches.{len(branches)}.stiffness' in values:
            key = f'damper.branches.{len(branches)}'
            branches.append((of(f'{key}.stiffness'), of(f'{key}.damping')))
        damper = _layer(of('damper.parallel_stiffness'), tuple(branches))
    else:
        contact = _contact(
            stiffness=of('contact.stiffness'),
            exponent=of('contact.exponent', 1.5),
            restitution=of('contact.restitution'),
            loss_of=LOSSES[round(of(LOSS_OF, 0.0))],
        )
    bench = Bench(sensor, damper=damper, contact=contact, orientation=orientation)
    if recording.kind == 'pendulum' and 'pendulum.contact_distance' in values:
        pendulum = _pendulum(
            of('pendulum.rod_mass'),
            of('pendulum.rod_length'),
            of('pendulum.contact_distance'),
            of('pendulum.moving_mass'),
            of('mass_distance'),
            of(GRAVITY, STANDARD_GRAVITY),
        )
        large = of(LARGE_ANGLES, 0.0) > 0.0
        return bench, PendulumBlow(
            pendulum, math.radians(of('angle')), catch_time=data.caught, large_angles=large
        )
    return bench, RobotBlow(of('impactor_mass'), of('speed'), push_force=0.0)
