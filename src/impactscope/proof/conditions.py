"""Conditions of a campaign drawn at random: bench, blows, channels, noise; nothing hidden yet."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from .bench import BENCH, GRAVITY, Bench, Pulse
from .conditions_axis import axis_scenario
from .detectability import STATED
from .given_course import Wave
from .integrator import COLUMNS, integrate
from .measurement import INPUTS, REPEATABLE
from .noise import COLOURS, Colour, draw_colour
from .population import PAPER, Chains, Devices, Impacts, Plates, Population
from .scenario import STRIKES, Blow, Chain, Scenario, Sensor, impactor

__all__ = ['draw_scenario']

COLOURED = 1 / 3  # share of the campaigns whose noise is not white
SAMPLED = 12.0  # samples of a blow, whose force between them nobody has recorded
_DISTANCES = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25)


def draw_scenario(
    rng: np.random.Generator, kind: str = 'impact', population: Population = PAPER
) -> Scenario:
    """A clean campaign under random conditions; ``kind`` as of :class:`Scenario`.

    In a third of all campaigns the noise of the responses is not white.
    """
    scenario = _KINDS[kind](rng, population)
    if rng.random() >= COLOURED:
        return scenario
    colour = str(rng.choice(COLOURS))
    return replace(
        scenario,
        colours={
            n: _with_steps(draw_colour(rng, colour), scenario.colour(n)) for n in scenario.rates
        },
    )


def _with_steps(colour: Colour, before: Colour) -> Colour:
    """A colour that keeps the steps a converter had before."""
    return colour._replace(step=colour.step or before.step)


def _impact(rng: np.random.Generator, among: Impacts) -> Scenario:
    orientation = str(rng.choice(['vertical', 'horizontal']))
    layered = rng.random() < among.layered
    count = int(rng.integers(5, 11))
    taps = int(rng.integers(1, max(2, count // 2)))
    held = 1 if count < 7 else 2
    rate = among.rate(rng)
    other = rate
    if rng.random() < among.other_device:  # the accelerometers' own
        other = among.other_rate(rng)
    rates = {'force': rate}
    for name, share in (('plate', 0.95), ('impactor', 0.85), ('base', 0.8)):
        if rng.random() < share:
            rates[f'acceleration.{name}'] = other
    noise = {
        n: among.force_noise(rng) if n == 'force' else among.acceleration_noise(rng) for n in rates
    }
    deviation = {n: 0.003 if n == 'force' else 0.005 for n in rates}
    chains = {n: Chain(gain=1 + rng.normal(0, deviation[n])) for n in rates}
    stiffness = among.stiffness(rng)
    mass = among.mass(rng)
    zeta = among.damping_ratio(rng)
    true = stiffness + float(rng.normal(0, 500))
    layer = among.layer(rng)
    bench = BENCH._replace(
        mass=mass,
        stiffness=true,
        damping=2 * zeta * math.sqrt(true * mass),
        **(
            layer
            if layered
            else {
                'hertz_stiffness': float(10 ** rng.uniform(7.0, 8.3)),
                'hertz_damping': float(rng.uniform(0.5, 1.5)),
            }
        ),
    )
    pendulum = among.pendulum(rng)
    striker = str(rng.choice(['pendulum', 'robot', 'drop'], p=among.strikers))
    if striker == 'drop':
        orientation = 'vertical'
    weight = orientation == 'vertical' and striker != 'robot'
    bench = bench._replace(gravity_load=1.0 if weight else 0.0)
    blows: list[Blow] = []
    for i in range(count):
        start = among.quiet(rng)
        duration = start + float(rng.uniform(0.6, 1.0))
        phase = float(rng.uniform(0, 2 * np.pi))
        role = 'hold_out' if i >= count - held else 'fit'
        if i < taps:
            tapped = bench._replace(gravity_load=0.0)
            blows.append(Blow('tap', tapped, start, duration, role, (_tap(rng),), hum_phase=phase))
            continue
        if striker != 'pendulum':
            blows.append(_straight(rng, striker, bench, start, duration, role, phase))
            continue
        angle = float(rng.uniform(5, 16) if orientation == 'vertical' else rng.uniform(15, 40))
        blow = Blow(
            'pendulum',
            bench,
            start,
            duration,
            role,
            distance=float(rng.choice(_DISTANCES)),
            angle_deg=round(angle, 1),
            angle_error_deg=float(rng.normal(0, 0.1)),
            hum_phase=phase,
        )
        fields = impactor(pendulum, blow, orientation, bench)
        blows.append(replace(blow, bench=bench._replace(**fields)))
    blows = [_as_long_as_legible(blow, noise) for blow in blows]
    baseline = ['linear_sensor', 'zener_damper' if layered else 'hertz_contact']
    baseline += ['unilateral_contact', *(['gravity_load'] if weight else [])]
    return Scenario(
        'impact',
        orientation,
        tuple(blows),
        rates,
        noise,
        chains,
        tuple(baseline),
        layer=layer if layered else None,
        sensor=Sensor(stiffness),
        pendulum=pendulum,
        gain_std=deviation,
    )


def _straight(
    rng: np.random.Generator,
    striker: str,
    bench: Bench,
    start: float,
    duration: float,
    role: str,
    phase: float,
) -> Blow:
    """A blow of a robot or of a falling body; mass and speed are stated a little wrong."""
    mass = round(float(rng.uniform(0.5, 3.0) if striker == 'drop' else rng.uniform(1.5, 6.0)), 2)
    speed = round(float(rng.uniform(0.15, 0.5)), 3)
    true = mass * (1 + STATED / 4 * float(rng.normal()))
    struck = bench._replace(
        impactor_mass=true,
        speed=speed * (1 + STATED / 4 * float(rng.normal())),
        gravity_load=true * GRAVITY * bench.gravity_load,
    )
    return Blow(
        striker,
        struck,
        start,
        duration,
        role,
        labelled_mass=mass,
        labelled_speed=speed,
        hum_phase=phase,
    )


def _as_long_as_legible(blow: Blow, noise: Mapping[str, float]) -> Blow:
    if blow.kind not in STRIKES:
        return blow
    pull = blow.bench.gravity_load / blow.bench.impactor_mass
    return replace(
        blow,
        duration=blow.start + _legible(blow, noise),
        fall=blow.bench.speed / pull if pull > 0 else 0.2,
    )


def _legible(blow: Blow, noise: Mapping[str, float]) -> float:
    """How long a blow can be followed, s: a light impactor bounces as on a shaking table.

    The recording ends where what no bench repeats of a speed would move a sample by twice its
    noise: behind that no two simulations agree, nor do a simulation and a bench. In the onset of a
    contact a few samples more would hold most of what there is to be seen.
    """
    t = np.arange(0, blow.duration - blow.start, 2e-4)
    faster = blow.bench._replace(speed=blow.bench.speed * (1 + 0.5 * REPEATABLE))
    change = np.abs(integrate(faster, t) - integrate(blow.bench, t))
    columns = {name: COLUMNS.index(name) for name in noise if name in COLUMNS}
    moved = np.max([change[:, c] / noise[n] for n, c in columns.items()], axis=0)
    beyond = np.flatnonzero(moved > 1)
    return max(float(t[beyond[0]]), 0.05) if beyond.size else blow.duration - blow.start


def _tap(rng: np.random.Generator) -> Pulse:
    return Pulse(
        0.0,
        float(rng.uniform(0.002, 0.006)),
        float(rng.uniform(100, 500)),
        float(rng.uniform(1.0, 2.0)),
    )


def _driven(rng: np.random.Generator, among: Plates) -> Scenario:
    count = int(rng.integers(5, 9))
    rate = among.rate(rng)
    mass = among.mass(rng)
    omega = 2 * math.pi * min(among.frequency(rng), rate / 12)
    zeta = among.damping_ratio(rng)
    bench = BENCH._replace(mass=mass, stiffness=mass * omega**2, damping=2 * zeta * mass * omega)
    noise = {'acceleration.plate': among.noise(rng)}
    noise[INPUTS['driven']] = among.force_noise(rng) * mass * noise['acceleration.plate']
    shaken = rng.random() < 0.35
    blows = []
    for i in range(count):
        start = float(rng.uniform(0.1, 0.3))
        duration = start + float(rng.uniform(0.8, 1.2))
        pulses = [
            Pulse(at, max(among.pulse(rng), SAMPLED / rate), among.peak(rng), 2.0)
            for at in (0.0, float(rng.uniform(0.1, 0.4)))[: int(rng.integers(1, 3))]
        ]
        blows.append(
            Blow(
                'driven',
                bench,
                start,
                duration,
                'hold_out' if i >= count - 2 else 'fit',
                _shaking(rng, omega, duration - start) if shaken else tuple(pulses),
                hum_phase=float(rng.uniform(0, 2 * np.pi)),
            )
        )
    return Scenario(
        'driven',
        'vertical',
        tuple(blows),
        {'acceleration.plate': rate},
        noise,
        {'acceleration.plate': Chain()},
        ('linear_sensor',),
    )


def _shaking(rng: np.random.Generator, omega: float, length: float) -> tuple[Pulse, ...]:
    """A shaker's sum of sines about the natural frequency (omega, rad/s) over ``length`` s."""
    size = float(rng.uniform(3, 30))
    tones = []
    for _ in range(int(rng.integers(3, 9))):
        frequency = omega / (2 * math.pi) * float(10 ** rng.uniform(-0.5, 0.5))
        cycles = float(max(round(frequency * 0.9 * length), 1))
        begin = float(rng.uniform(0, 0.05))
        tones.append(Pulse(begin, 0.9 * length, size * float(rng.uniform(0.3, 1)), cycles=cycles))
    return tuple(tones)


def _prescribed(rng: np.random.Generator, among: Devices) -> Scenario:
    """A damper or a spring in a testing machine: sines, two sines, sweeps."""
    count = int(rng.integers(4, 9))
    rate = among.rate(rng)
    stiffness = among.stiffness(rng)
    typical = 2 * math.pi * 3.0  # rad/s
    damping = float(10 ** rng.uniform(-1.0, 0.3)) * stiffness / typical
    bench = BENCH._replace(stiffness=stiffness, damping=damping)
    reach = among.reach(rng)
    noise = {'force.damper': among.noise(rng) * stiffness * reach}
    noise[INPUTS['prescribed']] = 0.05 * noise['force.damper'] / stiffness
    blows = []
    for i in range(count):
        start = float(rng.uniform(0.1, 0.2))
        duration = start + float(rng.uniform(1.0, 3.0))
        size = reach * float(rng.uniform(0.3, 1.0))
        first = Wave(size, float(rng.uniform(0.7, 8.0)), start, rise=0.1)
        kind = rng.integers(3)
        waves: tuple[Wave, ...] = (first,)
        if kind == 1:
            other = Wave(0.4 * size, float(rng.uniform(4.0, 12.0)), start, rise=0.1)
            waves = (first._replace(amplitude=0.6 * size), other)
        elif kind == 2:
            waves = (first._replace(frequency=0.5, glide=float(rng.uniform(2.0, 5.0))),)
        blows.append(_given('prescribed', bench, start, duration, i >= count - 2, waves, rng))
    return Scenario(
        'prescribed',
        'horizontal',
        tuple(blows),
        {'force.damper': rate},
        noise,
        {'force.damper': Chain()},
        ('linear_spring_damper',),
    )


def _chain(rng: np.random.Generator, among: Chains) -> Scenario:
    """Blows seen by two channels of a measuring chain."""
    count = int(rng.integers(4, 9))
    rate = among.rate(rng)
    noise = {'acceleration.processed': among.noise(rng)}
    noise[INPUTS['chain']] = 0.05 * noise['acceleration.processed']
    blows = []
    for i in range(count):
        start = float(rng.uniform(0.1, 0.3))
        duration = start + float(rng.uniform(0.6, 1.5))
        waves = tuple(
            Wave(
                float(10 ** rng.uniform(0.5, 2.0)),
                float(10 ** rng.uniform(1.3, 2.7)),
                start + float(rng.uniform(0.0, 0.3)),
                decay=float(10 ** rng.uniform(0.7, 1.8)),
                rise=0.002,
            )
            for _ in range(int(rng.integers(2, 6)))
        )
        blows.append(_given('chain', BENCH, start, duration, i >= count - 2, waves, rng))
    return Scenario(
        'chain',
        'horizontal',
        tuple(blows),
        {'acceleration.processed': rate},
        noise,
        {'acceleration.processed': Chain()},
        (),
    )


def _given(
    kind: str,
    bench: Bench,
    start: float,
    duration: float,
    held: bool,
    waves: tuple[Wave, ...],
    rng: np.random.Generator,
) -> Blow:
    role = 'hold_out' if held else 'fit'
    phase = float(rng.uniform(0, 2 * np.pi))
    return Blow(kind, bench, start, duration, role, waves=waves, hum_phase=phase)


_KINDS: Mapping[str, Callable[[np.random.Generator, Population], Scenario]] = {
    'impact': lambda rng, p: _impact(rng, p.impacts),
    'driven': lambda rng, p: _driven(rng, p.plates),
    'closed_loop': lambda rng, _: axis_scenario(rng),
    'prescribed': lambda rng, p: _prescribed(rng, p.devices),
    'chain': lambda rng, p: _chain(rng, p.chains),
}
