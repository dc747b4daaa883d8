"""What may be concealed of an axis in closed loop beside what any bench may have."""

from __future__ import annotations

import math

import numpy as np

from .effect import Aux, Effect, axial, bench_effect, largest
from .measurement import noise_free
from .scenario import Scenario

__all__ = ['AXIS_EFFECTS', 'AXIS_LOOK_ALIKES', 'AXIS_STRANGERS']

Drawn = dict[str, float | str]


def _reach(scenario: Scenario) -> float:
    """The farthest place of the recordings that are fitted, m; as far as the others if none."""
    name = scenario.channels[0]
    fitted = [b for b in scenario.blows if b.role == 'fit']
    farthest = max(float(noise_free(b, scenario)[name].max()) for b in fitted)
    return farthest if farthest > 0 else largest(scenario, name)


def _bumper(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    return {'travel': float(rng.uniform(0.6, 0.95)) * _reach(scenario)}


def _pitch(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    return {'pitch': _reach(scenario) / float(10 ** rng.uniform(0.5, 1.7))}


def _warming(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    longest = max(b.duration for b in scenario.blows)
    return {'time': float(rng.uniform(0.1, 0.6)) * longest}


def _frame(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    times = float(10 ** rng.uniform(0.3, 1.3))
    mass = times * scenario.blows[0].bench.mass
    return {'mass': mass, 'ratio': float(rng.uniform(0.01, 0.08))}


def _on_frame(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
    """The strength is the compliance, 1 at 100 Hz."""
    change = {
        'base_frequency': 100 / math.sqrt(strength),
        'base_mass': float(aux['mass']),
        'base_damping': float(aux['ratio']),
    }
    return scenario.with_bench(lambda _: change)


def _frame_told(strength: float, aux: Aux) -> Drawn:
    told: Drawn = {'frequency': 100 / math.sqrt(strength)}
    return told | {'mass': aux['mass'], 'damping_ratio': aux['ratio']}


AXIS_EFFECTS: tuple[Effect, ...] = (
    bench_effect(
        'gravity_load',
        'impactor',
        {'gravity_load': 1.0},
        {'force': 1.0},
        (1e-8, 50.0),
        fits=axial,
        variant='axis',
    ),
    bench_effect(
        'restoring_force',
        'impactor',
        {'restoring': 1.0},
        {'stiffness': 1.0},
        (1e-8, 1e3),
        fits=axial,
        variant='axis',
    ),
    bench_effect(
        'hardening_spring',
        'spring',
        {'cubic': 1.0},
        {'cubic': 1.0},
        (1e-7, 1e6),
        fits=axial,
        variant='axis',
    ),
    bench_effect(
        'end_stop',
        'spring',
        {'stop_stiffness': 1.0, 'stop_travel': 'travel'},
        {'stiffness': 1.0, 'travel': 'travel'},
        (1e-5, 1e5),
        setup=_bumper,
        fits=axial,
        variant='axis',
    ),
    Effect(
        'base_compliance',
        'fixture',
        _on_frame,
        0.03,
        40.0,
        _frame_told,
        setup=_frame,
        fits=axial,
        variant='axis',
    ),
)

AXIS_LOOK_ALIKES: tuple[Effect, ...] = (
    # a zero of the recorded drive is a constant force to the axis that is led by that record
    bench_effect(
        'offset',
        'measurement',
        {'gravity_load': 1.0},
        {'value': 1.0},
        (1e-8, 50.0),
        fits=axial,
        variant='drive',
        family='look-alike',
    ),
)

AXIS_STRANGERS: tuple[Effect, ...] = (
    bench_effect(
        'torque_ripple',
        'unknown',
        {'ripple': 1.0, 'ripple_pitch': 'pitch'},
        {'force': 1.0, 'pitch': 'pitch'},
        (1e-7, 50.0),
        setup=_pitch,
        fits=axial,
        family='outside',
    ),
    bench_effect(
        'fading_friction',
        'unknown',
        {'fading': 1.0, 'fading_time': 'time'},
        {'force': 1.0, 'time': 'time'},
        (1e-7, 50.0),
        setup=_warming,
        fits=axial,
        family='outside',
    ),
)
