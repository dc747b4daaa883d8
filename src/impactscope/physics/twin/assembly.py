"""From bench, blow and mechanisms to the flat arrays of the compiled twin."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError
from impactscope.physics.mechanisms.mechanism import Mechanism
from impactscope.physics.mechanisms.registry import mechanism, own_places
from impactscope.physics.pendulum import Orientation
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.bench import Bench, Blow, HammerTap, MeasuredForce, PendulumBlow

__all__ = ['Effect', 'Effects', 'assemble', 'implied_effects', 'normalise']

Array = NDArray[np.float64]

LIFT_TIME = 0.4  # s over which a resting pendulum is taken off the plate


@dataclass(frozen=True, slots=True)
class Effect:
    """A mechanism with its values; ``channel`` names the channel of a measuring-chain effect.

    Where bench and blow imply the values of a mechanism (a pendulum's weight), they may be
    left out.
    """

    name: str
    values: Mapping[str, float] = field(default_factory=dict)
    channel: str = ''

    @property
    def mechanism(self) -> Mechanism:
        """What the effect is an instance of."""
        return mechanism(self.name)


Effects = Iterable[Effect] | Mapping[str, Mapping[str, float]]


def implied_values(bench: Bench, blow: Blow) -> dict[str, dict[str, float]]:
    """Mechanisms that bench and blow imply, with the values that follow from them."""
    implied: dict[str, dict[str, float]] = {}
    if isinstance(blow, HammerTap | MeasuredForce):
        return implied
    implied['unilateral_contact'] = {}
    if isinstance(blow, PendulumBlow):
        if bench.orientation is Orientation.VERTICAL:
            implied['gravity_load'] = {'force': blow.pendulum.contact_weight()}
        else:
            stiffness = blow.pendulum.restoring_stiffness(Orientation.HORIZONTAL)
            implied['restoring_force'] = {'stiffness': stiffness}
    elif blow.push_force > 0:
        implied['external_push'] = {
            'force': blow.push_force,
            'start': 0.0,
            'rise': blow.push_rise,
            'hold': blow.push_hold,
            'fall': blow.push_fall,
        }
    return implied


def implied_effects(bench: Bench, blow: Blow) -> tuple[Effect, ...]:
    """The mechanisms that bench and blow imply: what the twin has unless told otherwise."""
    return tuple(Effect(name, values) for name, values in implied_values(bench, blow).items())


def normalise(effects: Effects | None, bench: Bench, blow: Blow) -> tuple[Effect, ...]:
    """Effects with all values filled in and checked; None gives the implied ones.

    Raises ConfigurationError for unknown mechanisms or parameters and values out of bounds.
    """
    if effects is None:
        return implied_effects(bench, blow)
    if isinstance(effects, Mapping):
        effects = (Effect(name, values) for name, values in effects.items())
    implied = implied_values(bench, blow)
    result = []
    for effect in effects:
        kind = effect.mechanism
        if effect.channel and not kind.on_channel:
            raise ConfigurationError(
                f'{effect.name} does not act on a channel: {effect.channel!r}'
            )
        values = {**implied.get(effect.name, {}), **effect.values}
        result.append(Effect(effect.name, kind.values(values), effect.channel))
    return tuple(result)


def assemble(bench: Bench, blow: Blow, effects: Iterable[Effect]) -> Array:
    """Parameter vector of the compiled bench, shape (N_PARAMETERS,); see :mod:`.layout`.

    A measured force lengthens it by its samples.

    Effects of the measuring chain are left to it. Raises ConfigurationError where an effect
    needs a damper or an impactor that is not there.
    """
    par = at.blank()
    sensor = bench.sensor
    par[at.PLATE_MASS] = sensor.moving_mass
    par[at.STIFFNESS] = sensor.stiffness
    par[at.DAMPING] = sensor.damping
    par[at.READS_DISPLACEMENT] = float(sensor.reads == 'displacement')
    par[at.BASE_MASS] = bench.body_mass
    if bench.damper is None:
        par[at.CONTACT_STIFFNESS] = bench.contact.stiffness
        par[at.CONTACT_EXPONENT] = bench.contact.exponent
        par[at.CONTACT_LOSS] = bench.contact.loss
    elif not isinstance(blow, HammerTap | MeasuredForce):
        par[at.HAS_LAYER] = 1.0
        par[at.LAYER_STIFFNESS] = bench.damper.equilibrium_stiffness
        par[at.BRANCHES] = len(bench.damper.branches)
        for i, branch in enumerate(bench.damper.branches):
            par[at.BRANCH + 2 * i] = branch.stiffness
            par[at.BRANCH + 2 * i + 1] = branch.viscosity
    if isinstance(blow, HammerTap):
        par[at.TAP_PEAK] = blow.peak_force
        par[at.TAP_DURATION] = blow.duration
    elif isinstance(blow, MeasuredForce):
        par[at.EXCITATION_RATE] = blow.sample_rate
        par = np.concatenate((par, np.asarray(blow.values, dtype=np.float64), [0.0]))
    elif isinstance(blow, PendulumBlow):
        par[at.IMPACTOR_MASS] = blow.pendulum.equivalent_mass
        par[at.LEVER] = blow.pendulum.contact_distance if blow.large_angles else 0.0
        par[at.IMPACT_SPEED] = blow.pendulum.impact_speed(blow.release_angle, bench.orientation)
        par[at.CATCH_TIME] = blow.catch_time
        if math.isfinite(blow.lift_time):
            _lift(par, 1.5 * blow.pendulum.contact_weight(), blow.lift_time, LIFT_TIME)
    else:
        par[at.IMPACTOR_MASS] = blow.effective_mass
        par[at.IMPACT_SPEED] = blow.speed
        if blow.push_force > 0 and math.isfinite(blow.push_hold):
            release = blow.push_rise + blow.push_hold
            _lift(par, blow.retract_force, release, blow.push_fall)
    if bench.damper is None and par[at.IMPACT_SPEED] > 0.0 and bench.contact.loss_of != 'material':
        by_speed = bench.contact.loss_by_speed
        par[at.CONTACT_LOSS] = by_speed / par[at.IMPACT_SPEED]
        par[at.LOSS_BY_SPEED] = by_speed if bench.contact.loss_of == 'contact' else 0.0
    places = own_places()
    for effect in effects:
        kind = effect.mechanism
        if 'damper' in kind.needs and bench.damper is None:
            raise ConfigurationError(f'{effect.name} needs a damper; the bench has none')
        if 'impactor' in kind.needs and isinstance(blow, HammerTap | MeasuredForce):
            raise ConfigurationError(f'{effect.name} needs an impactor; there is none')
        if kind.enter is not None:
            kind.enter(par, effect.values)
        if kind.name in places:
            place = places[kind.name]
            own = [effect.values[parameter.name] for parameter in kind.parameters]
            par[place : place + len(own)] = own
    return par


def _lift(par: Array, force: float, time: float, rise: float) -> None:
    par[at.LIFT_FORCE] = -force
    par[at.LIFT_START] = time
    par[at.LIFT_RISE] = rise
    par[at.CATCH_TIME] = min(par[at.CATCH_TIME], time)
