"""Populations from which the conditions of campaigns are drawn: benches, machines, rates, noise.

``PAPER`` stays about the bench of the paper. ``WIDE`` has other sensors, layers, pendulums,
structures and instruments: tenths of kilograms to several, springs and layers of soft to stiff
parts of the body, instruments from coarse to excellent. Strength is drawn by d' in both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from .bench import Pendulum

__all__ = ['LAYER', 'PAPER', 'POPULATIONS', 'WIDE', 'Population']

Generator = np.random.Generator
Draw = Callable[[Generator], float]

LAYER = {'layer_stiffness': 38320.0, 'branch_stiffness': 18840.0, 'branch_damping': 77900.0}


def _constant(value: float) -> Draw:
    return lambda _: value


def _uniform(low: float, high: float) -> Draw:
    return lambda rng: float(rng.uniform(low, high))


def _power_of_ten(low: float, high: float) -> Draw:
    """10 to an exponent that is drawn evenly."""
    return lambda rng: float(10 ** rng.uniform(low, high))


def _one_of(*values: float, shares: tuple[float, ...] | None = None) -> Draw:
    return lambda rng: float(rng.choice(values, p=shares))


def _written(draw: Draw) -> Draw:
    """As somebody writes it down: four digits."""
    return lambda rng: float(f'{draw(rng):.4g}')


class Impacts(NamedTuple):
    """Blows and taps on a sensor; SI units."""

    layered: float  # share of the benches with a damper layer
    rate: Draw
    other_device: float  # share of the benches whose accelerometers have a device of their own
    other_rate: Draw
    force_noise: Draw
    acceleration_noise: Draw
    stiffness: Draw  # as stated
    mass: Draw  # of the plate
    damping_ratio: Draw
    layer: Callable[[Generator], Mapping[str, float]]
    pendulum: Callable[[Generator], Pendulum]
    strikers: tuple[float, float, float]  # shares of pendulum, robot and falling body
    quiet: Draw  # before a blow, s


class Plates(NamedTuple):
    """Structures of one mode under a measured force."""

    rate: Draw
    mass: Draw
    frequency: Draw  # natural, Hz; at most a twelfth of the rate
    damping_ratio: Draw
    noise: Draw  # of the acceleration, m/s²
    force_noise: Draw  # over mass times that
    pulse: Draw  # duration of a blow, s
    peak: Draw  # of a blow, N


class Devices(NamedTuple):
    """Springs and dampers under a prescribed motion."""

    rate: Draw
    stiffness: Draw
    reach: Draw  # m
    noise: Draw  # over the force of the reach


class Chains(NamedTuple):
    """Two channels of a measuring chain that see blows."""

    rate: Draw
    noise: Draw  # m/s²


class Population(NamedTuple):
    """Conditions of every kind of campaign; axes have one population only."""

    impacts: Impacts
    plates: Plates
    devices: Devices
    chains: Chains


PAPER = Population(
    Impacts(
        layered=0.8,
        rate=_one_of(1000, 2000, 2560, 5000, 10000, shares=(0.2, 0.3, 0.15, 0.25, 0.1)),
        other_device=0.2,
        other_rate=_constant(5000.0),
        force_noise=_power_of_ten(-1, -0.3),
        acceleration_noise=_power_of_ten(-1.3, -0.5),
        stiffness=_one_of(69e3, 69e3, 40e3, 110e3),
        mass=lambda rng: 1.67 * float(rng.uniform(0.85, 1.15)),
        damping_ratio=_uniform(0.03, 0.10),
        layer=lambda _: LAYER,
        pendulum=lambda _: Pendulum(),
        strikers=(0.8, 0.12, 0.08),
        quiet=_uniform(0.3, 0.6),
    ),
    Plates(
        rate=_one_of(5000, 10000),
        mass=_uniform(0.8, 3.0),
        frequency=_uniform(15, 60),
        damping_ratio=_uniform(0.01, 0.08),
        noise=_power_of_ten(-1.3, -0.5),
        force_noise=_constant(0.02),
        pulse=_uniform(0.004, 0.010),
        peak=_uniform(60, 400),
    ),
    Devices(
        rate=_one_of(1000, 2000, 5000),
        stiffness=_power_of_ten(3.0, 5.0),
        reach=_power_of_ten(-2.7, -1.7),
        noise=_power_of_ten(-3.3, -2.5),
    ),
    Chains(rate=_one_of(2000, 5000, 10000), noise=_power_of_ten(-1.3, -0.3)),
)


def _any_layer(rng: Generator) -> Mapping[str, float]:
    stiffness = float(10 ** rng.uniform(4.0, 5.3))
    return {
        'layer_stiffness': float(f'{stiffness:.4g}'),
        'branch_stiffness': float(f'{stiffness * 10 ** rng.uniform(-0.7, 0.5):.4g}'),
        'branch_damping': float(f'{stiffness * 10 ** rng.uniform(-3.0, 0.3):.4g}'),
    }


def _any_pendulum(rng: Generator) -> Pendulum:
    return Pendulum(
        rod_mass=round(float(rng.uniform(0.3, 2.0)), 3),
        rod_length=0.4,
        contact_distance=round(float(rng.uniform(0.3, 0.39)), 3),
        moving_mass=round(float(rng.uniform(0.5, 4.0)), 2),
    )


WIDE = Population(
    Impacts(
        layered=0.7,
        rate=_one_of(
            1000, 2000, 4096, 8000, 20000, 25600, shares=(0.2, 0.25, 0.15, 0.2, 0.1, 0.1)
        ),
        other_device=0.3,
        other_rate=_one_of(3200, 12800),
        force_noise=_power_of_ten(-2.0, 0.3),
        acceleration_noise=_power_of_ten(-2.0, 0.5),
        stiffness=_written(_power_of_ten(4.0, 5.2)),
        mass=_power_of_ten(-0.4, 0.8),
        damping_ratio=_power_of_ten(-2.0, -0.7),
        layer=_any_layer,
        pendulum=_any_pendulum,
        strikers=(0.6, 0.25, 0.15),
        quiet=_power_of_ten(-1.5, -0.2),
    ),
    Plates(
        rate=_one_of(1000, 2000, 4096, 10000, 20000),
        mass=_power_of_ten(-1.0, 1.2),
        frequency=_power_of_ten(0.7, 2.2),
        damping_ratio=_power_of_ten(-2.5, -0.8),
        noise=_power_of_ten(-2.0, 0.5),
        force_noise=_power_of_ten(-3.0, -1.0),
        pulse=_uniform(0.002, 0.010),
        peak=_power_of_ten(1.3, 3.0),
    ),
    Devices(
        rate=_one_of(500, 1000, 4000, 10000),
        stiffness=_power_of_ten(2.5, 6.0),
        reach=_power_of_ten(-3.5, -1.3),
        noise=_power_of_ten(-4.0, -2.0),
    ),
    Chains(rate=_one_of(1000, 4096, 12800, 25600), noise=_power_of_ten(-2.0, 0.3)),
)

POPULATIONS: Mapping[str, Population] = {'paper': PAPER, 'wide': WIDE}
