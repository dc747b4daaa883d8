"""Faults of the measuring chain that may be concealed."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from .effect import Aux, Effect, always, axial, cooked, largest
from .measurement import INPUTS
from .scenario import Scenario

__all__ = ['CHAIN_EFFECTS']

Drawn = dict[str, float | str]

_ORDERS = 4  # of filters, from one on


def _channel(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    names = [n for n in scenario.channels if n != 'acceleration.base']
    name = str(rng.choice(names))
    return {'channel': name, 'peak': largest(scenario, name), 'sign': int(rng.choice([-1, 1]))}


def _filter(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    kind = {'order': int(rng.integers(1, _ORDERS + 1)), 'zero_phase': int(rng.random() < 0.3)}
    return _channel(rng, scenario) | kind


def _filters(_scenario: Scenario) -> list[Drawn]:
    """Filters of every order, without a delay and with one."""
    return [{'order': n, 'zero_phase': z} for z in (1, 0) for n in range(1, _ORDERS + 1)]


def _hum(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    return _channel(rng, scenario) | {'frequency': float(rng.choice([50.0, 60.0]))}


def _filtered(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
    return scenario.with_chain(
        str(aux['channel']),
        cutoff=1 / strength,
        order=int(aux['order']),
        zero_phase=bool(aux['zero_phase']),
    )


def _filter_told(strength: float, aux: Aux) -> Drawn:
    return {'cutoff': 1 / strength, 'order': aux['order'], 'zero_phase': aux['zero_phase']}


def _cut(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
    return scenario.with_chain(str(aux['channel']), limit=float(aux['peak']) * (1 - strength))


def _cut_told(strength: float, aux: Aux) -> Drawn:
    return {'limit': float(aux['peak']) * (1 - strength)}


def _clock(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    drift = rng.uniform(0.05, 0.5) if rng.random() < 0.3 else 0.0
    return {'sign': int(rng.choice([-1, 1])), 'drift': float(drift)}


def _clocks(strength: float, aux: Aux) -> tuple[float, float]:
    offset = strength * float(aux['sign'])
    return offset, offset * float(aux['drift'])


def _late(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
    """All channels but the force are on the device whose clock is wrong."""
    offset, drift = _clocks(strength, aux)
    for name in scenario.channels:
        if name != 'force':
            scenario = scenario.with_chain(name, clock_offset=offset, clock_drift=drift)
    return scenario


def _late_told(strength: float, aux: Aux) -> Drawn:
    return dict(zip(('offset', 'drift'), _clocks(strength, aux), strict=True))


def _two_devices(scenario: Scenario) -> bool:
    names = set(scenario.channels)
    return scenario.kind in INPUTS or {'force', 'acceleration.plate'} <= names


def _even(scenario: Scenario) -> bool:
    """Whether no converter has steps already."""
    return not any(c.step for c in scenario.colours.values())


def _zeroed(scenario: Scenario) -> bool:
    """Whether a constant means something: an axis may begin anywhere."""
    return not axial(scenario)


def _simple(
    name: str,
    fields: Mapping[str, float | str],
    parameters: Mapping[str, float | str],
    span: tuple[float, float],
    *,
    hum: bool = False,
    fits: Callable[[Scenario], bool] = always,
) -> Effect:
    """An effect in the chain of one channel, by recipes."""

    def apply(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
        return scenario.with_chain(str(aux['channel']), **cooked(fields, strength, aux))

    def told(strength: float, aux: Aux) -> Drawn:
        return {**cooked(parameters, strength, aux)}

    setup = _hum if hum else _channel
    return Effect(name, 'measurement', apply, *span, told, setup=setup, fits=fits)


CHAIN_EFFECTS: tuple[Effect, ...] = (
    Effect(
        'low_pass_filter',
        'measurement',
        _filtered,
        1 / 15e3,
        1 / 15.0,
        _filter_told,
        setup=_filter,
        shapes=_filters,
    ),
    _simple('ac_coupling', {'corner': 1.0}, {'corner': 1.0}, (1e-6, 10.0)),
    Effect('saturation', 'measurement', _cut, 1e-5, 0.7, _cut_told, setup=_channel),
    _simple('quantisation', {'step': 1.0}, {'step': 1.0}, (1e-4, 100.0), fits=_even),
    _simple(
        'mains_hum',
        {'hum': 1.0, 'hum_frequency': 'frequency'},
        {'amplitude': 1.0, 'frequency': 'frequency'},
        (1e-9, 50.0),
        hum=True,
    ),
    _simple('zero_drift', {'drift': 'strength * sign'}, {'rate': 'strength * sign'}, (1e-9, 1e2)),
    _simple(
        'offset',
        {'offset': 'strength * sign'},
        {'value': 'strength * sign'},
        (1e-6, 50.0),
        fits=_zeroed,
    ),
    Effect(
        'clock_error',
        'measurement',
        _late,
        1e-9,
        5e-3,
        _late_told,
        setup=_clock,
        fits=_two_devices,
    ),
)
