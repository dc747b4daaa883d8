"""Campaigns of the bench made by the twin, with or without an effect that nobody tells."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from impactscope.discrepancy.campaign import Campaign, ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.physics.damper_layer import DamperLayer
from impactscope.physics.pendulum import Orientation, Pendulum
from impactscope.physics.twin.assembly import Effect, implied_effects
from impactscope.physics.twin.bench import (
    PAPER_LAYER,
    BareContact,
    Bench,
    Blow,
    HammerTap,
    MeasuredForce,
    PendulumBlow,
    RobotBlow,
    Sensor,
)
from impactscope.physics.twin.measurement import ChannelChain, device_times, read
from impactscope.physics.twin.simulate import simulate_at

NOISE = {
    'force': 0.4,
    'acceleration.plate': 0.08,
    'acceleration.impactor': 0.08,
    'acceleration.base': 0.08,
}
GAIN_STD = {'force': 0.003, 'acceleration': 0.005}
FITTED = ((0.10, 12.0), (0.20, 9.0))  # where the mass sits, m, and the angle of release, degrees
HELD_OUT = (0.15, 10.0)
BASELINE = ('linear_sensor', 'zener_damper', 'unilateral_contact', 'gravity_load')


def description(recordings: Sequence[Mapping[str, Any]], **changes: Any) -> dict[str, Any]:
    """What ``campaign.yaml`` holds for the bench of these tests."""
    data = {
        'version': 1,
        'bench': {'kind': 'impact', 'orientation': 'vertical'},
        'sensor': {'stiffness': {'value': 69000, 'std': 500, 'unit': 'N/m'}, 'moving_mass': None},
        'damper': {
            'parallel_stiffness': PAPER_LAYER.equilibrium_stiffness,
            'branches': [
                {'stiffness': b.stiffness, 'damping': b.viscosity} for b in PAPER_LAYER.branches
            ],
        },
        'pendulum': {
            'rod_mass': 0.698,
            'rod_length': 0.29,
            'contact_distance': 0.26,
            'moving_mass': 1.0,
            'release_angle_std_deg': 0.1,
        },
        'gain_std': GAIN_STD,
        'baseline': list(BASELINE),
        'recordings': list(recordings),
    }
    data.update(changes)
    return data


def _measured(
    bench: Bench,
    blow: Blow,
    effects: Sequence[Effect],
    gains: Mapping[str, float],
    rng: np.random.Generator,
    rates: float | Mapping[str, float],
    duration: float,
) -> dict[str, ChannelSamples]:
    tapped = isinstance(blow, HammerTap | MeasuredForce)
    there = set() if tapped else {'impactor'}
    there |= {'damper'} if bench.damper is not None else {'bare'}
    acting = {e.name: e for e in implied_effects(bench, blow)}
    acting |= {e.name + e.channel: e for e in effects if e.mechanism.needs <= there}
    contact_time = float(rng.uniform(0.08, 0.1))
    channels = {}
    for name, noise in NOISE.items():
        if name == 'acceleration.impactor' and tapped:
            continue
        rate = rates if isinstance(rates, float) else rates[name]
        own = tuple(e for e in acting.values() if e.channel == name)
        chain = ChannelChain(name, rate, noise, gain=gains[name], effects=own)
        times = device_times(chain, round(duration * rate))
        simulation = simulate_at(
            bench,
            blow,
            times,
            mechanisms=tuple(e for e in acting.values() if not e.channel),
            contact_time=contact_time,
        )
        values = read(simulation[name], chain, rng).astype(np.float32).astype(np.float64)
        channels[name] = ChannelSamples(name, chain.unit, rate, 0.0, values)
    return channels


@pytest.fixture(scope='session')
def make_campaign() -> Callable[..., Campaign]:
    """A campaign of one tap and two or three blows, the last of them held out.

    ``robots``: mass and speed of further blows; ``of_robots``: what acts in these alone.
    ``stated``: what ``campaign.yaml`` holds in place of its usual numbers.
    """

    def make(
        seed: int = 0,
        effects: Sequence[Effect] = (),
        *,
        orientation: str = 'vertical',
        pendulum: Pendulum | None = None,
        baseline: Sequence[str] | None = None,
        angle_errors: Mapping[int, float] | None = None,
        rate: float | Mapping[str, float] = 2500.0,
        duration: float = 0.35,
        tap: HammerTap | MeasuredForce | None = None,
        bare: BareContact | None = None,
        large_angles: bool = False,
        blows: int = 3,
        robots: Sequence[tuple[float, float]] = (),
        of_robots: Sequence[Effect] = (),
        sensor: Sensor | None = None,
        damper: DamperLayer = PAPER_LAYER,
        stated: Mapping[str, Any] | None = None,
    ) -> Campaign:
        rng = np.random.default_rng(seed)
        gains = {c: 1 + float(rng.standard_normal()) * GAIN_STD[c.split('.')[0]] for c in NOISE}
        where = Orientation(orientation)
        weight = 'gravity_load' if where is Orientation.VERTICAL else 'restoring_force'
        recordings: list[dict[str, Any]] = [{'file': 'tap0.mcap', 'kind': 'tap'}]
        struck: list[Blow] = [tap or HammerTap(150.0, 0.0045)]
        plan = (*FITTED[: blows - 1], HELD_OUT)
        for n, (distance, angle) in enumerate(plan):
            error = 0.1 * float(rng.standard_normal()) + (angle_errors or {}).get(n, 0.0)
            swing = dataclasses.replace(pendulum or Pendulum(), mass_distance=distance)
            turned = math.radians(angle + error)
            struck.append(PendulumBlow(swing, turned, large_angles=large_angles))
            recordings.append(
                {
                    'file': f'hit{n}.mcap',
                    'kind': 'pendulum',
                    'mass_distance': distance,
                    'release_angle_deg': angle,
                    'role': 'hold_out' if n == len(plan) - 1 else 'fit',
                    'damper': bare is None,
                }
            )
        for n, (mass, speed) in enumerate(robots):
            struck.append(RobotBlow(mass, speed))
            recordings.append(
                {
                    'file': f'robot{n}.mcap',
                    'kind': 'robot',
                    'effective_mass': {'value': mass, 'std': 0.01 * mass, 'unit': 'kg'},
                    'speed': {'value': speed, 'std': 0.01 * speed, 'unit': 'm/s'},
                    'damper': bare is None,
                }
            )
        samples = {}
        for recording, blow in zip(recordings, struck, strict=True):
            own = of_robots if isinstance(blow, RobotBlow) else ()
            layer = None if bare or isinstance(blow, HammerTap | MeasuredForce) else damper
            bench = Bench(
                sensor or Sensor(), damper=layer, contact=bare or BareContact(), orientation=where
            )
            samples[recording['file']] = _measured(
                bench, blow, (*effects, *own), gains, rng, rate, duration
            )
        data = description(
            recordings,
            bench={'kind': 'impact', 'orientation': orientation},
            baseline=list(baseline or (*BASELINE[:3], weight)),
            **(stated or {}),
        )
        return parse_campaign(data, 'bench').with_samples(samples.__getitem__)

    return make
