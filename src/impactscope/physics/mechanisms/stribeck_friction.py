"""Dry friction with a higher force at rest (Stribeck)."""

from __future__ import annotations

import math

from impactscope.errors import ConfigurationError
from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values
from impactscope.physics.twin import layout as at

__all__ = ['MECHANISM', 'sliding_friction']


@law
def sliding_friction(
    static_forward: float,
    static_backward: float,
    kinetic_forward: float,
    kinetic_backward: float,
    stribeck_speed: float,
    speed: float,
    direction: int,
) -> float:
    """Friction on a body that slides at ``speed`` m/s in ``direction`` (+1 or -1), N."""
    static, kinetic = static_forward, kinetic_forward
    if direction < 0:
        static, kinetic = static_backward, kinetic_backward
    level = kinetic
    if static > kinetic:
        level += (static - kinetic) * math.exp(-((speed / stribeck_speed) ** 2))
    return -direction * level


def _enter(vector: Array, values: Values) -> None:
    static, kinetic = values['static_force'], values['kinetic_force']
    if static < kinetic:
        raise ConfigurationError(
            f'stribeck_friction: static_force {static!r} N is below kinetic_force {kinetic!r} N'
        )
    vector[at.STATIC_FORWARD] = vector[at.STATIC_BACKWARD] = static
    vector[at.KINETIC_FORWARD] = vector[at.KINETIC_BACKWARD] = kinetic
    vector[at.STRIBECK_SPEED] = values['speed']


MECHANISM = Mechanism(
    name='stribeck_friction',
    subsystem=Subsystem.GUIDE,
    sentence=(
        'Dry friction in the guide is higher at rest than while sliding and falls off with speed.'
    ),
    equation=('F_k + (F_s - F_k) exp(-(v/v_s)^2) against the motion; at rest any force up to F_s'),
    parameters=(
        Parameter('static_force', 'N', 0.0, 200.0, (1.0, 5.0), absent=0.0),
        Parameter('kinetic_force', 'N', 0.0, 100.0, (0.5, 3.0), absent=0.0),
        Parameter('speed', 'm/s', 1e-4, 1.0, (0.01, 0.05)),
    ),
    source=('Olsson et al., Friction models and friction compensation, Eur. J. Control 4 (1998)'),
    test='slow ring-down and a slow push: the plate stops suddenly and starts with a jump',
    enter=_enter,
    kin=('coulomb_friction', 'asymmetric_friction'),
    contains=('coulomb_friction',),
)
