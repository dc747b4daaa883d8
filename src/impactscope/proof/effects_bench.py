"""Mechanics that may be concealed: guide, spring, damper, contact, impactor, fixture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .effect import Aux, Effect, bench_effect, largest, sprung, struck, swung, with_layer
from .measurement import input_channel
from .scenario import Scenario

__all__ = ['BENCH_EFFECTS']

Drawn = dict[str, float | str]

_SLOWNESS = 0.1, 20.0  # relaxation times of a branch, times the motion's angular frequency
_BRANCHES = 10  # relaxation times tried where a branch may look like something else


def _vertical(scenario: Scenario) -> bool:
    return swung(scenario) and scenario.orientation == 'vertical'


def _taps_and_blows(scenario: Scenario) -> bool:
    return struck(scenario) and any(b.kind == 'tap' for b in scenario.blows)


def _has_force(scenario: Scenario) -> bool:
    return 'force' in scenario.channels


def _known_travel(scenario: Scenario) -> bool:
    return _has_force(scenario) or scenario.kind == 'prescribed'


def _deepest(scenario: Scenario) -> float:
    """Largest compression of the spring, m (of a guess where the force is not recorded)."""
    if scenario.kind == 'prescribed':
        return max(float(input_channel(b, 1000.0).max()) for b in scenario.blows)
    peak = largest(scenario, 'force') if _has_force(scenario) else 250.0
    return peak / scenario.blows[0].bench.stiffness


def _ratio(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {'ratio': float(math.exp(rng.choice([-1, 1]) * rng.uniform(0.25, 1.1)))}


def _stribeck(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {'static_ratio': rng.uniform(1.2, 2.0), 'speed': 10 ** rng.uniform(-2.3, -1.0)}


def _travel(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    return {'travel': float(rng.uniform(0.6, 0.95)) * _deepest(scenario)}


def _yield(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    return {'yield': float(10 ** rng.uniform(-1.3, -0.3)) * _deepest(scenario)}


def _branch(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {'time': float(10 ** rng.uniform(-3.0, -1.5))}


def _given_motion(scenario: Scenario) -> bool:
    return scenario.kind == 'prescribed'


def _beside(scenario: Scenario, slowness: float) -> Drawn:
    """A branch as stiff as the device, N/m and N s/m.

    Its relaxation time is ``slowness`` over the largest angular frequency of the recordings that
    are fitted: far below 1 it is a dashpot, far above a spring, and the baseline has both.
    """
    fitted = [b for b in scenario.blows if b.role == 'fit']
    fastest = max(w.fastest(b.duration) for b in fitted for w in b.waves)
    stiffness = scenario.blows[0].bench.stiffness
    return {'stiffness': stiffness, 'damping': stiffness * slowness / fastest}


def _branch_beside(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    return _beside(scenario, float(np.exp(rng.uniform(*np.log(_SLOWNESS)))))


def _branches_beside(scenario: Scenario) -> list[Drawn]:
    return [_beside(scenario, float(s)) for s in np.geomspace(*_SLOWNESS, 2 * _BRANCHES + 1)[1::2]]


def _push(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {'start': float(rng.uniform(0, 0.02)), 'rise': float(rng.uniform(0.005, 0.05))}


def _flexible(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {'frequency': float(10 ** rng.uniform(1.9, 2.7))}


def _base(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {'mass': float(10 ** rng.uniform(0.7, 1.6)), 'ratio': float(rng.uniform(0.01, 0.08))}


def _base_numbers(strength: float, aux: Aux) -> tuple[float, float, float]:
    """Frequency, mass, damping ratio: the strength is the compliance, 1 at 100 Hz."""
    return 100 / math.sqrt(strength), float(aux['mass']), float(aux['ratio'])


def _on_base(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
    names = ('base_frequency', 'base_mass', 'base_damping')
    change = dict(zip(names, _base_numbers(strength, aux), strict=True))
    return scenario.with_bench(lambda _: change)


def _base_told(strength: float, aux: Aux) -> Drawn:
    names = ('frequency', 'mass', 'damping_ratio')
    return dict(zip(names, _base_numbers(strength, aux), strict=True))


def _slowed(scenario: Scenario, strength: float, _aux: Aux) -> Scenario:
    return scenario.with_bench(lambda blow: {'speed': blow.bench.speed * (1 - strength)})


def _slowed_told(strength: float, _aux: Aux) -> Drawn:
    return {'ratio': 1 - strength}


def _without_unilateral(scenario: Scenario) -> Scenario:
    baseline = tuple(n for n in scenario.baseline if n != 'unilateral_contact')
    return replace(scenario.with_bench(lambda _: {'unilateral': 0.0}), baseline=baseline)


def _unilateral(scenario: Scenario, _strength: float, _aux: Aux) -> Scenario:
    return scenario.with_bench(lambda _: {'unilateral': 1.0})


def _untold(_strength: float, _aux: Aux) -> Drawn:
    return {}


def _without_gravity(scenario: Scenario) -> Scenario:
    baseline = tuple(n for n in scenario.baseline if n != 'gravity_load')
    return replace(scenario.with_bench(lambda _: {'gravity_load': 0.0}), baseline=baseline)


def _weighed(scenario: Scenario, strength: float, _aux: Aux) -> Scenario:
    return scenario.with_bench(
        lambda blow: {'gravity_load': strength} if blow.kind == 'pendulum' else {}
    )


def _force_told(strength: float, _aux: Aux) -> Drawn:
    return {'force': strength}


BENCH_EFFECTS: tuple[Effect, ...] = (
    bench_effect(
        'coulomb_friction',
        'guide',
        {'friction_forward': 1.0, 'friction_backward': 1.0},
        {'force': 1.0},
        (1e-7, 30.0),
    ),
    bench_effect(
        'asymmetric_friction',
        'guide',
        {'friction_forward': 1.0, 'friction_backward': 'strength * ratio'},
        {'force_forward': 1.0, 'force_backward': 'strength * ratio'},
        (1e-7, 30.0),
        setup=_ratio,
    ),
    bench_effect(
        'stribeck_friction',
        'guide',
        {
            'friction_forward': 1.0,
            'friction_backward': 1.0,
            'static_ratio': 'static_ratio',
            'stribeck_speed': 'speed',
        },
        {'static_force': 'strength * static_ratio', 'kinetic_force': 1.0, 'speed': 'speed'},
        (1e-7, 30.0),
        setup=_stribeck,
    ),
    bench_effect(
        'quadratic_damping',
        'guide',
        {'quadratic_forward': 1.0, 'quadratic_backward': 1.0},
        {'coefficient': 1.0},
        (1e-6, 500.0),
    ),
    bench_effect(
        'clearance', 'guide', {'clearance': 1.0}, {'gap': 1.0}, (1e-12, 1e-3), fits=sprung
    ),
    bench_effect(
        'hardening_spring', 'spring', {'cubic': 1.0}, {'cubic': 1.0}, (1.0, 1e10), fits=sprung
    ),
    bench_effect(
        'softening_spring', 'spring', {'cubic': -1.0}, {'cubic': -1.0}, (1.0, 2e9), fits=sprung
    ),
    bench_effect(
        'end_stop',
        'spring',
        {'stop_stiffness': 1.0, 'stop_travel': 'travel'},
        {'stiffness': 1.0, 'travel': 'travel'},
        (1.0, 1e7),
        setup=_travel,
        fits=_known_travel,
    ),
    bench_effect(
        'hysteresis',
        'spring',
        {'hysteretic_share': 1.0, 'yield_displacement': 'yield'},
        {'share': 1.0, 'yield_displacement': 'yield'},
        (1e-8, 0.6),
        setup=_yield,
        fits=sprung,
    ),
    bench_effect(
        'rate_dependent_damper',
        'damper',
        {'second_stiffness': 1.0, 'second_damping': 'strength * time'},
        {'stiffness': 1.0, 'damping': 'strength * time'},
        (1e-4, 1e6),
        setup=_branch,
        fits=with_layer,
    ),
    bench_effect(
        'rate_dependent_damper',
        'damper',
        {'second_stiffness': 'strength * stiffness', 'second_damping': 'strength * damping'},
        {'stiffness': 'strength * stiffness', 'damping': 'strength * damping'},
        (1e-7, 2.0),
        setup=_branch_beside,
        shapes=_branches_beside,
        fits=_given_motion,
        variant='prescribed',
    ),
    bench_effect(
        'stiffening_damper',
        'damper',
        {'stiffening': 1.0},
        {'coefficient': 1.0},
        (1e-6, 500.0),
        fits=with_layer,
    ),
    Effect(
        'unilateral_contact',
        'contact',
        _unilateral,
        1.0,
        1.0,
        _untold,
        fits=with_layer,
        prepare=_without_unilateral,
        tunable=False,
    ),
    bench_effect(
        'added_mass',
        'contact',
        {'added_mass': 1.0},
        {'mass': 1.0},
        (1e-8, 1.0),
        fits=_taps_and_blows,
    ),
    bench_effect(
        'velocity_squared_contact',
        'contact',
        {'velocity_squared': 1.0},
        {'coefficient': 1.0},
        (1e-6, 300.0),
        fits=with_layer,
    ),
    Effect(
        'gravity_load',
        'impactor',
        _weighed,
        1e-6,
        40.0,
        _force_told,
        fits=_vertical,
        prepare=_without_gravity,
    ),
    bench_effect(
        'restoring_force',
        'impactor',
        {'restoring': 1.0},
        {'stiffness': 1.0},
        (1e-6, 2e4),
        fits=struck,
    ),
    bench_effect(
        'external_push',
        'impactor',
        {'push': 1.0, 'push_start': 'start', 'push_rise': 'rise'},
        {'force': 1.0, 'start': 'start', 'rise': 'rise'},
        (1e-7, 100.0),
        setup=_push,
        fits=struck,
    ),
    Effect('impact_speed_loss', 'impactor', _slowed, 1e-8, 0.5, _slowed_told, fits=struck),
    bench_effect(
        'impactor_flexibility',
        'impactor',
        {'flexible_share': 1.0, 'flexible_frequency': 'frequency'},
        {'mass_share': 1.0, 'frequency': 'frequency'},
        (1e-8, 0.5),
        setup=_flexible,
        fits=struck,
    ),
    Effect(
        'base_compliance',
        'fixture',
        _on_base,
        1e-4,
        12.0,
        _base_told,
        setup=_base,
        fits=_has_force,
    ),
)
