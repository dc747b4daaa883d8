"""Everything that may be concealed: mechanisms, faults, wrong numbers, and strangers.

Names and subsystems are those of the vocabulary of answers; a stranger is in no vocabulary, and
the right answer to it is: unknown.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .effect import Aux, Effect, bench_effect, largest, sprung
from .effects_axis import AXIS_EFFECTS, AXIS_LOOK_ALIKES, AXIS_STRANGERS
from .effects_bench import BENCH_EFFECTS
from .effects_chain import CHAIN_EFFECTS
from .effects_wrong import WRONG_LABELS, WRONG_NUMBERS
from .scenario import Scenario

__all__ = ['EFFECTS', 'Effect', 'effect', 'largest']

Drawn = dict[str, float | str]


def _order(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {'order': float(rng.uniform(0.2, 0.6))}


def _swing(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {'frequency': float(rng.uniform(3, 20))}


def _weather(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    return {f'blow{i}': float(rng.normal()) for i in range(len(scenario.blows))}


def _weathered(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
    blows = []
    for i, blow in enumerate(scenario.blows):
        stiffness = blow.bench.stiffness * (1 + strength * float(aux[f'blow{i}']))
        blows.append(replace(blow, bench=blow.bench._replace(stiffness=stiffness)))
    return replace(scenario, blows=tuple(blows))


def _weather_told(strength: float, _aux: Aux) -> Drawn:
    return {'share': strength}


def _moves_freely(scenario: Scenario) -> bool:
    return scenario.kind in ('impact', 'driven')


def _bare(scenario: Scenario) -> bool:
    return scenario.kind == 'chain'


def _bent(scenario: Scenario, strength: float, _aux: Aux) -> Scenario:
    return scenario.with_chain(scenario.channels[0], curvature=strength)


def _bent_told(strength: float, _aux: Aux) -> Drawn:
    return {'curvature': strength}


def _resonance(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {'frequency': float(10 ** rng.uniform(1.7, 2.6))}


def _resonating(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
    return scenario.with_chain(
        scenario.channels[0],
        resonance=strength,
        resonance_frequency=float(aux['frequency']),
    )


def _resonating_told(strength: float, aux: Aux) -> Drawn:
    return {'share': strength, **aux}


OUTSIDE: tuple[Effect, ...] = (
    bench_effect(
        'fractional_damping',
        'unknown',
        {'fractional': 1.0, 'fractional_order': 'order'},
        {'coefficient': 1.0, 'order': 'order'},
        (1e-4, 3e3),
        setup=_order,
        fits=_moves_freely,
        family='outside',
    ),
    bench_effect(
        'asymmetric_quadratic_damping',
        'unknown',
        {'quadratic_forward': 1.0, 'quadratic_backward': 0.0},
        {'coefficient': 1.0},
        (1e-6, 500.0),
        family='outside',
    ),
    bench_effect(
        'time_varying_stiffness',
        'unknown',
        {'modulation': 1.0, 'modulation_frequency': 'frequency'},
        {'share': 1.0, 'frequency': 'frequency'},
        (1e-9, 0.3),
        setup=_swing,
        fits=sprung,
        family='outside',
    ),
    bench_effect(
        'position_dependent_friction',
        'unknown',
        {'friction_slope': 1.0},
        {'slope': 1.0},
        (1e-4, 2e4),
        family='outside',
    ),
    Effect(
        'stiffness_between_recordings',
        'unknown',
        _weathered,
        1e-9,
        0.1,
        _weather_told,
        setup=_weather,
        fits=sprung,
        family='outside',
    ),
    Effect(
        'curved_gain',
        'unknown',
        _bent,
        1e-9,
        0.1,
        _bent_told,
        fits=_bare,
        family='outside',
    ),
    Effect(
        'mounting_resonance',
        'unknown',
        _resonating,
        1e-8,
        0.5,
        _resonating_told,
        setup=_resonance,
        fits=_bare,
        family='outside',
    ),
    *AXIS_STRANGERS,
)

EFFECTS: tuple[Effect, ...] = (
    *BENCH_EFFECTS,
    *AXIS_EFFECTS,
    *AXIS_LOOK_ALIKES,
    *CHAIN_EFFECTS,
    *WRONG_NUMBERS,
    *WRONG_LABELS,
    *OUTSIDE,
)

_BY_KEY = {e.key: e for e in EFFECTS}


def effect(key: str) -> Effect:
    """The effect of a unique name. Raises KeyError for an unknown one."""
    return _BY_KEY[key]
