"""Conditions of an axis in closed loop drawn at random; nothing hidden yet."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .axis import Law
from .bench import BENCH, Pulse
from .detectability import AXIS_DAMPING, AXIS_MASS, DRIVE_GAIN
from .given_course import Wave
from .measurement import INPUTS
from .noise import Colour
from .scenario import Blow, Chain, Scenario
from .trajectories import Move

__all__ = ['OUTPUT', 'axis_scenario']

OUTPUT = 'displacement.axis'
_SAMPLES = 25_000  # of a recording, at most


def axis_scenario(rng: np.random.Generator) -> Scenario:
    """An axis that follows trajectories: moves of trapezoidal speed, quintic moves, sines."""
    rate = float(rng.choice([500, 1000, 2000]))
    mass = float(10 ** rng.uniform(0.7, 2.2))
    damping = mass / float(10 ** rng.uniform(-1.0, 0.0))
    stated = None
    if rng.random() < 0.5:
        stated = {
            'moving_mass': _rounded(mass * (1 + AXIS_MASS * float(rng.normal()))),
            'damping': _rounded(damping * (1 + AXIS_DAMPING * float(rng.normal()))),
        }
    gain = _rounded(float(10 ** rng.uniform(0.7, 1.7)))
    loop = 2 * math.pi * float(rng.uniform(8, 30))  # rad/s, of the speed
    law = Law(
        kp=_rounded(loop / float(rng.uniform(4, 8))),
        kv=_rounded(mass * loop / gain),
        gain=gain,
        rate=rate,
    )
    bench = BENCH._replace(
        mass=mass,
        stiffness=0.0,
        damping=damping,
        drive_gain=1 + DRIVE_GAIN * float(rng.normal()) if stated else 1.0,
    )
    reach = float(10 ** rng.uniform(-1.5, -0.4))  # m
    count = int(rng.integers(3, 7))
    held = 1 if count < 5 else int(rng.integers(1, 3))
    length = float(rng.uniform(3.0, 25.0))  # s
    blows = []
    for i in range(count):
        duration = min(max(length * float(rng.uniform(0.6, 1.2)), 3.0), 25.0, _SAMPLES / rate)
        start = float(rng.uniform(0.1, 0.5))
        shape = str(rng.choice(['trapezoid', 'quintic', 'sines', 'pulses']))
        blow = Blow(
            'closed_loop',
            bench,
            start,
            duration,
            'hold_out' if i >= count - held else 'fit',
            hum_phase=float(rng.uniform(0, 2 * np.pi)),
            law=law,
        )
        blows.append(_with_reference(rng, blow, shape, reach))
    noise = {OUTPUT: reach * float(10 ** rng.uniform(-3.8, -2.6))}
    return Scenario(
        'closed_loop',
        'horizontal',
        tuple(blows),
        {OUTPUT: rate},
        noise,
        {OUTPUT: Chain()},
        ('linear_mass_damper',),
        stated_axis=stated,
        gain_std={INPUTS['closed_loop']: DRIVE_GAIN} if stated else {},
        # an encoder has steps, whatever else colours its noise
        colours={OUTPUT: Colour(step=float(10 ** rng.uniform(math.log10(0.2), math.log10(2.0))))},
    )


def _with_reference(rng: np.random.Generator, blow: Blow, shape: str, reach: float) -> Blow:
    """The recording with what the axis is to follow; ``reach``: m, the farthest."""
    moving = blow.duration - blow.start - 0.3
    if shape == 'sines':
        waves = []
        for _ in range(int(rng.integers(2, 5))):
            frequency = float(10 ** rng.uniform(-0.7, 0.4))
            size = reach * float(rng.uniform(0.1, 0.4)) / max(frequency, 0.5)
            waves.append(Wave(size, frequency, blow.start, rise=float(rng.uniform(0.3, 0.8))))
        return replace(blow, waves=tuple(waves))
    moves: list[Move] = []
    at, place = blow.start, 0.0
    quintic = shape == 'quintic' or (shape == 'pulses' and rng.random() < 0.5)
    while at < blow.start + moving - 0.5:
        duration = min(float(rng.uniform(0.4, 2.5)), blow.start + moving - at)
        aim = reach * float(rng.uniform(-0.3, 1.0))
        ramp = 0.0 if quintic else float(rng.uniform(0.15, 0.5))
        moves.append(Move(at, duration, aim - place, ramp))
        place = aim
        at += duration + float(rng.uniform(0.0, 0.8))
    pulses: list[Pulse] = []
    if shape == 'pulses':
        strong = blow.bench.mass * float(rng.uniform(1.0, 8.0))  # N
        pulses = [
            Pulse(
                float(rng.uniform(0.0, moving - 0.2)),
                float(rng.uniform(0.02, 0.15)),
                strong * float(rng.choice([-1, 1])),
                2.0,
            )
            for _ in range(int(rng.integers(2, 7)))
        ]
    return replace(blow, moves=tuple(moves), pulses=tuple(pulses))


def _rounded(value: float) -> float:
    """A number as somebody writes it down: four digits."""
    return float(f'{value:.4g}')
