"""Numbers and labels of the campaign file that may be wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .effect import Aux, Effect, axial, struck, swung, with_layer
from .scenario import Blow, Scenario, impactor

__all__ = ['WRONG_LABELS', 'WRONG_NUMBERS']

Drawn = dict[str, float | str]
Apply = Callable[[Scenario, float, Aux], Scenario]
Setup = Callable[[np.random.Generator, Scenario], Drawn]


def _sign(rng: np.random.Generator, _scenario: Scenario) -> Drawn:
    return {'sign': int(rng.choice([-1, 1]))}


def _factor(strength: float, aux: Aux) -> float:
    return math.exp(float(aux['sign']) * strength)


def _spring(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    """The true spring differs from the stated one already, within what is stated of it."""
    true = scenario.blows[0].bench.stiffness
    return _sign(rng, scenario) | {'already': true / scenario.sensor.stiffness}


def _stated_axis(scenario: Scenario) -> bool:
    return axial(scenario) and scenario.stated_axis is not None


def _of_axis(field: str, stated: str) -> Setup:
    """The true number differs from the stated one already, within what is stated of it."""

    def setup(rng: np.random.Generator, scenario: Scenario) -> Drawn:
        true = float(getattr(scenario.blows[0].bench, field))
        return _sign(rng, scenario) | {'already': true / (scenario.stated_axis or {})[stated]}

    return setup


def _drive(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    return _sign(rng, scenario) | {'already': scenario.blows[0].bench.drive_gain}


def _wrong(
    number: str, apply: Apply, fits: Callable[[Scenario], bool], setup: Setup = _sign
) -> Effect:
    def told(strength: float, aux: Aux) -> Drawn:
        ratio = _factor(strength, aux) * float(aux.get('already', 1.0))
        return {'name': number, 'ratio': ratio}

    return Effect(
        'wrong_parameter',
        'parameter',
        apply,
        1e-8,
        0.5,
        told,
        setup=setup,
        fits=fits,
        variant=number,
        family='parameter',
    )


def _scaled(name: str) -> Apply:
    def apply(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
        factor = _factor(strength, aux)
        return scenario.with_bench(lambda blow: {name: getattr(blow.bench, name) * factor})

    return apply


def _pendulum(name: str) -> Apply:
    def apply(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
        value = float(getattr(scenario.pendulum, name)) * _factor(strength, aux)
        return scenario.with_pendulum(scenario.pendulum._replace(**{name: value}))

    return apply


def _gain(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
    return scenario.with_chain(scenario.channels[0], gain=_factor(strength, aux))


def _bare(scenario: Scenario) -> bool:
    return scenario.kind == 'chain'


def _which(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    blows = [i for i, b in enumerate(scenario.blows) if b.kind == 'pendulum' and b.role == 'fit']
    return {'blow': int(rng.choice(blows)), 'sign': int(rng.choice([-1, 1]))}


def _along_rod(rng: np.random.Generator, scenario: Scenario) -> Drawn:
    aux = _which(rng, scenario)
    near = scenario.blows[int(aux['blow'])].distance < 0.1
    return aux | {'sign': 1 if near else -1}  # the mass stays on the rod


def _relabel(scenario: Scenario, aux: Aux, change: Callable[[Blow], Blow]) -> Scenario:
    """The truth of one blow differs from what its label says."""
    blows = list(scenario.blows)
    index = int(aux['blow'])
    blow = change(blows[index])
    fields = impactor(scenario.pendulum, blow, scenario.orientation, blow.bench)
    blows[index] = replace(blow, bench=blow.bench._replace(**fields))
    return replace(scenario, blows=tuple(blows))


def _angle(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
    by = strength * float(aux['sign'])
    return _relabel(scenario, aux, lambda b: replace(b, angle_error_deg=b.angle_error_deg + by))


def _distance(scenario: Scenario, strength: float, aux: Aux) -> Scenario:
    by = strength * float(aux['sign'])
    return _relabel(scenario, aux, lambda b: replace(b, distance_error=b.distance_error + by))


def _lying(scenario: Scenario, _strength: float, _aux: Aux) -> Scenario:
    """The file says vertical, the sensor lies: other speeds, no weight on it."""
    turned = replace(scenario, orientation='horizontal')
    turned = turned.with_bench(lambda _: {'gravity_load': 0.0})
    return turned.with_bench(
        lambda blow: impactor(turned.pendulum, blow, 'horizontal', blow.bench)
    )


def _vertical(scenario: Scenario) -> bool:
    return swung(scenario) and scenario.orientation == 'vertical'


def _label(
    name: str,
    apply: Apply,
    span: tuple[float, float],
    setup: Callable[[np.random.Generator, Scenario], Drawn] = _which,
    fits: Callable[[Scenario], bool] = swung,
    *,
    tunable: bool = True,
) -> Effect:
    def told(_strength: float, aux: Aux) -> Drawn:
        return {'name': name} | ({'recording': aux['blow']} if tunable else {})

    return Effect(
        'wrong_parameter',
        'parameter',
        apply,
        *span,
        told,
        setup=setup,
        fits=fits,
        variant=name,
        family='label',
        tunable=tunable,
    )


WRONG_NUMBERS: tuple[Effect, ...] = (
    _wrong('sensor.stiffness', _scaled('stiffness'), struck, _spring),
    _wrong('damper.parallel_stiffness', _scaled('layer_stiffness'), with_layer),
    _wrong('damper.branches.0.stiffness', _scaled('branch_stiffness'), with_layer),
    _wrong('damper.branches.0.damping', _scaled('branch_damping'), with_layer),
    _wrong('pendulum.moving_mass', _pendulum('moving_mass'), swung),
    _wrong('pendulum.rod_mass', _pendulum('rod_mass'), swung),
    _wrong('pendulum.contact_distance', _pendulum('contact_distance'), swung),
    _wrong('gain', _gain, _bare),
    _wrong('sensor.moving_mass', _scaled('mass'), _stated_axis, _of_axis('mass', 'moving_mass')),
    _wrong('sensor.damping', _scaled('damping'), _stated_axis, _of_axis('damping', 'damping')),
    _wrong('controller.gain', _scaled('drive_gain'), _stated_axis, _drive),
)

WRONG_LABELS: tuple[Effect, ...] = (
    _label('release_angle_deg', _angle, (1e-5, 4.0)),
    _label('mass_distance', _distance, (1e-7, 0.1), setup=_along_rod),
    _label('orientation', _lying, (1.0, 1.0), setup=_sign, fits=_vertical, tunable=False),
)
