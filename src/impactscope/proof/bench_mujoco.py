"""The bench in MuJoCo, for the physics that engine can express exactly enough.

Masses on slides, springs and dashpots and the base are the engine's own. The elastic layer and
a clearance are springs with a dead band (fixed tendons): the engine's contacts are soft
constraints whose stiffness depends on the masses, so they are not used. Its dry friction is a
soft constraint too, and misses the exact decay by about 0.2 N, twice the noise: not used either.
Maxwell branches, a cubic spring, Bouc-Wen, Stribeck, Hertz and the measuring chain cannot be
expressed; there the independent integrator stands alone, against exact solutions.
"""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError

from .bench import GRAVITY, Bench, Pendulum
from .known_cases import KnownCase

__all__ = ['FEATURES', 'pendulum_speed', 'simulate_mujoco']

Array = NDArray[np.float64]

FEATURES = frozenset({'clearance', 'impact', 'base', 'pulse'})
_FAR = 1e3  # m, a dead band's other end


def simulate_mujoco(case: KnownCase, step: float = 1e-5) -> dict[str, Array]:
    """A known case by MuJoCo: its own time stepping (Runge-Kutta of order 4), sampled.

    Args:
        case: with features among ``FEATURES`` only.
        step: s, of the engine.

    Raises ConfigurationError where MuJoCo is not installed or the case needs more.
    """
    mujoco = _mujoco()
    if not case.features <= FEATURES:
        missing = ', '.join(sorted(case.features - FEATURES))
        raise ConfigurationError(f'MuJoCo cannot express {missing} of case {case.name!r}')
    bench = Bench(mass=1.0, stiffness=0.0, damping=0.0)._replace(**case.description)
    model = mujoco.MjModel.from_xml_string(_slides(bench, step))
    data = mujoco.MjData(model)
    plate, impactor, base = (model.joint(n).qposadr[0] for n in ('plate', 'impactor', 'base'))
    data.qpos[plate], data.qvel[plate] = case.displacement, case.velocity
    data.qvel[impactor] = bench.speed
    names = (
        'force',
        'acceleration.plate',
        'acceleration.impactor',
        'acceleration.base',
        'displacement.plate',
        'contact',
    )
    rows: list[tuple[float, ...]] = []
    at = 0
    last: tuple[float, ...] = ()
    before = 0.0
    while at < case.times.size:
        data.qfrc_applied[plate] = _applied(case, data.time + 0.5 * step)
        data.qfrc_applied[impactor] = bench.gravity_load
        mujoco.mj_forward(model, data)
        s = data.qpos[plate] - data.qpos[base]
        half = bench.clearance / 2
        u = data.qpos[impactor] - data.qpos[plate]
        now = (
            bench.stiffness * math.copysign(max(abs(s) - half, 0.0), s),
            data.qacc[plate],
            data.qacc[impactor],
            data.qacc[base],
            data.qpos[plate],
            bench.layer_stiffness * max(u, 0.0),
        )
        while at < case.times.size and case.times[at] <= data.time + 1e-12:
            share = 1.0 if not last else (case.times[at] - before) / (data.time - before)
            old = last or now
            rows.append(tuple(a + share * (b - a) for a, b in zip(old, now, strict=True)))
            at += 1
        last, before = now, data.time
        mujoco.mj_step(model, data)
    return {name: np.array([row[i] for row in rows]) for i, name in enumerate(names)}


def pendulum_speed(
    pendulum: Pendulum, distance: float, angle_deg: float, orientation: str
) -> float:
    """Speed of the contact point as the released pendulum passes the impact place, m/s."""
    mujoco = _mujoco()
    down = orientation == 'horizontal'
    # the rod lies along x (vertical sensor) or hangs along -z (horizontal sensor)
    end = f'0 0 {-pendulum.rod_length}' if down else f'{pendulum.rod_length} 0 0'
    middle = -pendulum.rod_length / 2 if down else pendulum.rod_length / 2
    place = f'0 0 {-distance}' if down else f'{distance} 0 0'
    inertia = pendulum.rod_mass * pendulum.rod_length**2 / 12
    centre = f'0 0 {middle}' if down else f'{middle} 0 0'
    model = mujoco.MjModel.from_xml_string(f"""
      <mujoco><option gravity="0 0 {-GRAVITY}" timestep="1e-5" integrator="RK4">
      <flag contact="disable"/></option><worldbody><body>
      <joint name="hinge" type="hinge" axis="0 1 0"/>
      <inertial pos="{centre}" mass="{pendulum.rod_mass}"
        diaginertia="{inertia} {inertia} {inertia}"/>
      <geom type="capsule" fromto="0 0 0 {end}" size="0.005" mass="0"/>
      <body pos="{place}"><inertial pos="0 0 0" mass="{pendulum.moving_mass}"
        diaginertia="1e-9 1e-9 1e-9"/></body></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[0] = -math.radians(angle_deg)  # turning about +y lowers a rod along +x
    before, rate = data.qpos[0], 0.0
    while data.qpos[0] < 0:
        before, rate = data.qpos[0], data.qvel[0]
        mujoco.mj_step(model, data)
    share = before / (before - data.qpos[0])
    return float((rate + share * (data.qvel[0] - rate)) * pendulum.contact_distance)


def _slides(p: Bench, step: float) -> str:
    """The bench as bodies on parallel slides; what is absent is held or left alone."""
    base = p.base_mass or 1e12  # so heavy that it stays
    omega = 2 * math.pi * p.base_frequency
    hold = p.base_mass * omega**2
    drag = 2 * p.base_damping * p.base_mass * omega
    half = p.clearance / 2
    inert = 'diaginertia="1 1 1" pos="0 0 0"'
    return f"""
      <mujoco><option gravity="0 0 0" timestep="{step}" integrator="RK4" tolerance="0"
        iterations="100"><flag contact="disable"/></option><worldbody>
      <body><joint name="base" type="slide" axis="1 0 0" stiffness="{hold}" damping="{drag}"/>
        <inertial mass="{base}" {inert}/></body>
      <body><joint name="plate" type="slide" axis="1 0 0"/>
        <inertial mass="{p.mass}" {inert}/></body>
      <body><joint name="impactor" type="slide" axis="1 0 0"/>
        <inertial mass="{p.impactor_mass or 1.0}" {inert}/></body></worldbody>
      <tendon>
      <fixed name="spring" stiffness="{p.stiffness}" damping="{p.damping}"
        springlength="{-half} {half}"><joint joint="plate" coef="1"/>
        <joint joint="base" coef="-1"/></fixed>
      <fixed name="layer" stiffness="{p.layer_stiffness}" springlength="{-_FAR} 0">
        <joint joint="impactor" coef="1"/><joint joint="plate" coef="-1"/></fixed>
      </tendon></mujoco>"""


def _applied(case: KnownCase, t: float) -> float:
    return sum(float(pulse.force(np.array(t))) for pulse in case.pulses)


def _mujoco() -> Any:
    try:
        return import_module('mujoco')
    except ImportError as error:
        raise ConfigurationError(
            'MuJoCo is not installed; pip install mujoco mujoco-core brings it'
        ) from error
