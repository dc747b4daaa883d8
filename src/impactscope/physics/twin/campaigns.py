"""Campaigns that are there from the start: the paper's bench, and blows on a hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from impactscope.errors import ConfigurationError
from impactscope.physics.pendulum import Orientation, Pendulum
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.bench import Bench, Blow, HammerTap, PendulumBlow, RobotBlow
from impactscope.physics.twin.stream import Campaign, ScheduledBlow
from impactscope.records import NANOSECONDS, ContactKind, TestPoint

__all__ = ['CAMPAIGNS', 'campaign']

MASS_DISTANCES = (0.0, 0.05, 0.10, 0.15, 0.20, 0.25)  # m, paper section 3.2
RELEASE_ANGLE = math.radians(10.0)
INTERVAL = 5.0  # s between blows
FIRST = 2.0  # s; the quiet before lets the noise be learnt
SLIDE_FRICTION = 1.0  # N, on the horizontal bench; an assumption, the paper gives no figure
LIFT_TIME = 2.0  # s after contact the pendulum is taken off the plate


def _in_row(blows: Sequence[Blow]) -> tuple[ScheduledBlow, ...]:
    return tuple(ScheduledBlow(FIRST + i * INTERVAL, blow) for i, blow in enumerate(blows))


def _length(count: int) -> float:
    return FIRST + count * INTERVAL


def _pendulum(distance: float, angle: float, orientation: Orientation) -> PendulumBlow:
    pendulum = Pendulum(mass_distance=distance)
    if orientation is Orientation.VERTICAL:
        return PendulumBlow(pendulum, angle, lift_time=LIFT_TIME)
    return PendulumBlow(pendulum, angle, catch_time=0.1)


def _hand_test(identity: str, speed: float, count: int, robot: str, notes: str) -> TestPoint:
    return TestPoint(
        id=identity,
        body_region='hands_fingers',
        contact=ContactKind.CONSTRAINED,
        repetitions_planned=count,
        robot=robot,
        tool='rounded tip',
        pose='bench',
        speed=speed,
        device='simulated biofidelic sensor (paper bench)',
        spring_stiffness=69_000.0,
        spring_stiffness_std=500.0,
        damper='SH10',
        notes=notes,
        start_ns=NANOSECONDS,
        end_ns=round(_length(count) * NANOSECONDS),
    )


def _taps() -> Campaign:
    """Hammer taps of five strengths."""
    taps = [HammerTap(peak, 0.004) for peak in (60.0, 90.0, 130.0, 190.0, 280.0)]
    return Campaign(
        'taps',
        'Hammer taps of five strengths on the plate without damper (paper section 3.1.1).',
        _in_row(taps),
        _length(len(taps)),
        bench=Bench(damper=None),
    )


def _positions(name: str, orientation: Orientation, with_damper: bool) -> Campaign:
    bench = Bench(orientation=orientation)
    if not with_damper:
        bench = Bench(orientation=orientation, damper=None)
    friction: tuple[Effect, ...] = ()
    if orientation is Orientation.HORIZONTAL:  # here the slides carry the plate's weight
        friction = (Effect('coulomb_friction', {'force': SLIDE_FRICTION}),)
    blows = [_pendulum(d, RELEASE_ANGLE, orientation) for d in MASS_DISTANCES]
    return Campaign(
        name,
        f'Pendulum blows from 10 degrees with the mass at 0 to 0.25 m, {orientation.value} bench, '
        f'{"with" if with_damper else "without"} damper (paper section 3.2)'
        f'{f"; friction of {SLIDE_FRICTION:g} N in the slides, assumed" if friction else ""}.',
        _in_row(blows),
        _length(len(blows)),
        bench=bench,
        mechanisms=friction,
    )


def _hand(name: str, angle_deg: float, verdict: str) -> Campaign:
    angle = math.radians(angle_deg)
    pendulum = Pendulum(mass_distance=0.25)
    speed = pendulum.impact_speed(angle)
    blows = [_pendulum(0.25, angle, Orientation.VERTICAL) for _ in range(3)]
    return Campaign(
        name,
        f'Three pendulum blows of {speed:.2f} m/s at a hand: {verdict} of 280 N transient force.',
        _in_row(blows),
        _length(len(blows)),
        test_points=(
            _hand_test(name, speed, len(blows), 'pendulum', f'released at {angle_deg:g} degrees'),
        ),
    )


def _robot() -> Campaign:
    blow = RobotBlow()
    return Campaign(
        'robot',
        'Three blows of a robot of 4 kg at 0.25 m/s that pushes on for 0.7 s and draws back.',
        _in_row([blow] * 3),
        _length(3),
        test_points=(_hand_test('robot', blow.speed, 3, 'simulated robot', 'clamped hand'),),
    )


CAMPAIGNS: Mapping[str, Callable[[], Campaign]] = MappingProxyType(
    {
        'taps': _taps,
        'vertical': lambda: _positions('vertical', Orientation.VERTICAL, True),
        'vertical_bare': lambda: _positions('vertical_bare', Orientation.VERTICAL, False),
        'horizontal': lambda: _positions('horizontal', Orientation.HORIZONTAL, True),
        'horizontal_bare': lambda: _positions('horizontal_bare', Orientation.HORIZONTAL, False),
        'hand_pass': lambda: _hand('hand_pass', 8.0, 'below the limit'),
        'hand_fail': lambda: _hand('hand_fail', 30.0, 'above the limit'),
        'robot': _robot,
    }
)
"""Name to builder."""


def campaign(name: str) -> Campaign:
    """The campaign of that name; raises ConfigurationError naming the known ones."""
    try:
        return CAMPAIGNS[name]()
    except KeyError:
        raise ConfigurationError(
            f'campaign {name!r} is not known; known are {", ".join(CAMPAIGNS)}'
        ) from None
