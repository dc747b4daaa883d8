"""The simulation as the campaign states it: constants, what may be re-tuned, what is unknown."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.campaign import BaselineItem, Campaign, Quantity
from impactscope.discrepancy.impact.data.blows import BlowData, CampaignData
from impactscope.discrepancy.impact.models.bench_model import ActiveEffect, Free, ImpactModel
from impactscope.discrepancy.impact.models.bench_parameters import ADDED_WEIGHT, GRAVITY, WEIGHT
from impactscope.physics.mechanisms.registry import mechanism
from impactscope.physics.pendulum import Orientation, Pendulum

Array = NDArray[np.float64]

__all__ = ['STRUCTURE', 'baseline_model', 'implied_shares', 'with_metal_that_lets_go']

STRUCTURE = ('linear_sensor', 'zener_damper', 'hertz_contact')
"""What a baseline is built on, beside mechanisms."""

LETS_GO = 'unilateral_contact'

_PUSHED = 0.25  # of its top, below which the acceleration of a tapped plate is no push any more
_SENSOR = {  # start values and relative scales where a number is to be estimated
    'stiffness': (69_000.0, 0.01, 1e2, 1e8),
    'moving_mass': (1.5, 0.01, 1e-3, 1e3),
    'damping_ratio': (0.06, 0.1, 1e-4, 2.0),
}
MOST_OF_TAP = 0.99e5  # N, what the simulation of a hammer takes
_PENDULUM = ('rod_mass', 'rod_length', 'contact_distance', 'moving_mass')


def with_metal_that_lets_go(campaign: Campaign) -> Campaign:
    """The campaign, a bare contact in its baseline one-sided, and a note where that is not said.

    Hertz's law holds for bodies that press on each other, and what rebounds with a restitution
    lets go: `hertz_contact` without `unilateral_contact` is no simulation that pulls. Beside a
    layer the names stay as they are.
    """
    names = campaign.baseline_names
    if 'hertz_contact' not in names or {LETS_GO, 'zener_damper'} & set(names):
        return campaign
    note = f'hertz_contact is taken to push only, as {LETS_GO} in the baseline would say.'
    return dataclasses.replace(
        campaign,
        baseline=(*campaign.baseline, BaselineItem(LETS_GO)),
        notes=(*campaign.notes, note),
    )


def baseline_model(campaign: Campaign, data: CampaignData) -> ImpactModel:
    """The baseline as a model of the campaign.

    Raises ConfigurationError for names of the baseline that are not known.
    """
    constants: dict[str, float] = {}
    free: list[Free] = []
    horizontal = campaign.orientation is Orientation.HORIZONTAL
    constants['orientation'] = float(horizontal)
    constants[GRAVITY] = campaign.gravity
    for name, (start, scale, low, high) in _SENSOR.items():
        quantity = campaign.sensor.get(name, Quantity())
        _number(f'sensor.{name}', quantity, (start, scale, low, high), constants, free)
    if campaign.damper is not None:
        _damper(campaign.damper, constants, free)
    if any(not b.recording.damper or campaign.damper is None for b in data.blows):
        free.append(Free('contact.stiffness', 5e8, 0.05, 1e5, 1e13, logarithmic=True))
        free.append(Free('contact.restitution', 0.5, 0.05, 0.03, 0.995))
        constants['contact.exponent'] = 1.5
    geometry = all(campaign.pendulum.get(n, Quantity()).known for n in _PENDULUM)
    if geometry:
        for name in _PENDULUM:
            quantity = campaign.pendulum[name]
            limits = (quantity.value, 0.01, 0.0, 1e3)
            _number(f'pendulum.{name}', quantity, limits, constants, free)
    for channel in data.channels:
        std = campaign.gain_std_of(channel)
        if std > 0:
            free.append(Free(f'gain.{channel}', 1.0, 0.01, 0.2, 5.0, prior=(1.0, std)))
    for i, blow in enumerate(data.blows):
        _blow(campaign, blow, i, geometry, constants, free)
    effects = _effects(campaign, data, geometry, constants, free)
    return ImpactModel(data, constants, tuple(free), tuple(effects))


def implied_shares(model: ImpactModel, name: str) -> dict[str, float]:
    """Factor of each blow for an effect that follows the weight; mean is one.

    A robot or a falling body presses with its own weight, as it does in a baseline that states
    one, and nothing pulls it back to where it hangs.
    """
    values = dict(model.constants)
    values.update({f.key: f.start for f in model.free})
    if 'pendulum.contact_distance' not in values:
        return {}
    found, beside = {}, {}
    for i, blow in enumerate(model.data.blows):
        if blow.recording.kind == 'pendulum':
            pendulum = _pendulum(values, i)
            found[i] = (
                pendulum.contact_weight()
                if name == 'gravity_load'
                else pendulum.restoring_stiffness(Orientation.HORIZONTAL)
            )
        elif blow.recording.kind != 'tap':
            mass = values.get(f'impactor_mass@{i}', 0.0) if name == 'gravity_load' else 0.0
            beside[i] = mass * values[GRAVITY]
    if not found:
        return {}
    mean = float(np.mean(list(found.values())))
    found |= beside
    return {f'{name}.share@{i}': found.get(i, mean) / mean for i in range(len(model.data.blows))}


# --- parts ---------------------------------------------------------------------------------------


def _number(
    key: str,
    quantity: Quantity,
    limits: tuple[float, float, float, float],
    constants: dict[str, float],
    free: list[Free],
) -> None:
    start, scale, low, high = limits
    if not quantity.known:
        free.append(Free(key, start, scale, low, high, logarithmic=True))
    elif quantity.std > 0:
        prior = (quantity.value, quantity.std)
        scale = max(quantity.std / quantity.value, 1e-3)
        free.append(
            Free(key, quantity.value, scale, low or 1e-9, high, logarithmic=True, prior=prior)
        )
    else:
        constants[key] = quantity.value


def _damper(damper: Mapping[str, Any], constants: dict[str, float], free: list[Free]) -> None:
    limits = (4e4, 0.02, 1.0, 1e10)
    _number('damper.parallel_stiffness', damper['parallel_stiffness'], limits, constants, free)
    for n, branch in enumerate(damper['branches']):
        for name in ('stiffness', 'damping'):
            start = 2e4 if name == 'stiffness' else 1e3
            _number(
                f'damper.branches.{n}.{name}',
                branch[name],
                (start, 0.02, 1e-3, 1e12),
                constants,
                free,
            )


def _blow(
    campaign: Campaign,
    blow: BlowData,
    i: int,
    geometry: bool,
    constants: dict[str, float],
    free: list[Free],
) -> None:
    recording = blow.recording
    onset = blow.onset
    free.append(Free(f'time@{i}', onset, 1e-4, onset - 0.02, onset + 0.01, blow=i))
    if recording.kind == 'tap':
        peak, duration = _tap_start(blow)
        free.append(Free(f'tap_peak@{i}', peak, 0.02, 1e-3, MOST_OF_TAP, logarithmic=True, blow=i))
        constants[f'tap_duration@{i}'] = duration
        return
    if recording.kind == 'pendulum' and geometry:
        angle, std = recording.release_angle_deg, campaign.release_angle_std_deg
        if not math.isfinite(angle):
            free.append(Free(f'angle@{i}', 10.0, 0.1, 0.05, 89.0, blow=i))
        elif std > 0:
            free.append(Free(f'angle@{i}', angle, 0.1, 0.05, 89.0, prior=(angle, std), blow=i))
        else:
            constants[f'angle@{i}'] = angle
        distance = recording.mass_distance
        if math.isfinite(distance):
            constants[f'mass_distance@{i}'] = distance
        else:
            free.append(Free(f'mass_distance@{i}', 0.15, 0.01, 0.0, 0.5, blow=i))
        return
    mass = recording.effective_mass, recording.uncertainty('effective_mass')
    speed = recording.speed, recording.uncertainty('speed')
    height = recording.drop_height
    if math.isfinite(height) and not math.isfinite(recording.speed):
        fallen = math.sqrt(2 * campaign.gravity * height)
        speed = fallen, 0.5 * fallen * recording.uncertainty('drop_height') / height
    for key, (value, std), start in (('impactor_mass', mass, 1.5), ('speed', speed, 0.4)):
        prior = (value, std) if math.isfinite(value) else None
        begin = value if math.isfinite(value) else start
        free.append(
            Free(f'{key}@{i}', begin, 0.02, 1e-3, 1e3, logarithmic=True, prior=prior, blow=i)
        )


def _tap_start(blow: BlowData) -> tuple[float, float]:
    """Peak, N, to start from and duration, s, of the half sine that stands for a tap.

    Moment and peak are enough to reach any state in which a hammer leaves a bench at rest; the
    duration only has to be such that the half sine is over when samples begin to count.
    """
    duration = 0.5 * (blow.settled - blow.onset)
    plate = blow.channels.get('acceleration.plate')
    if plate is not None:
        near = (plate.centres > blow.onset - 2e-3) & (plate.centres < blow.settled)
        values, times = plate.means[near], plate.centres[near]
        if values.size > 3:
            top = int(np.argmax(np.abs(values)))
            low = np.flatnonzero(values * np.sign(values[top]) < _PUSHED * abs(values[top]))
            ahead, after = low[low < top], low[low > top]  # what rings on is no push
            first = times[ahead[-1]] if ahead.size else times[0]
            last = times[after[0]] if after.size else times[-1]
            duration = float(np.clip(1.5 * (last - first), 5e-4, 1.2 * duration))
            return float(max(abs(values[top]) * 1.6, 1.0)), duration
    force = blow.channels.get('force')
    top_force = float(np.max(np.abs(force.means))) if force is not None else 50.0
    impulse = 1.1 * top_force / (2 * math.pi * 32.0)
    return max(impulse * math.pi / (2 * duration), 1.0), duration


def _effects(
    campaign: Campaign,
    data: CampaignData,
    geometry: bool,
    constants: dict[str, float],
    free: list[Free],
) -> list[ActiveEffect]:
    effects = []
    for item in campaign.baseline:
        if item.name in STRUCTURE:
            continue
        kind = mechanism(item.name)
        active = ActiveEffect(item.name, item.channel)
        effects.append(active)
        weight = item.name in ('gravity_load', 'restoring_force')
        if weight and item.values.keys() <= {WEIGHT, ADDED_WEIGHT}:
            constants.update({f'{active.tag}.{n}': v for n, v in item.values.items()})
            _implied_weight(campaign, data, geometry, item.name, constants, free)
            continue
        for parameter in kind.parameters:
            key = f'{active.tag}.{parameter.name}'
            value = item.values.get(parameter.name, parameter.default)
            if math.isfinite(value):
                constants[key] = value
            else:
                start = parameter.start[len(parameter.start) // 2]
                scale = max(0.1 * abs(start), 1e-12)
                free.append(Free(key, start, scale, parameter.lower, parameter.upper))
    return effects


def _implied_weight(
    campaign: Campaign,
    data: CampaignData,
    geometry: bool,
    name: str,
    constants: dict[str, float],
    free: list[Free],
) -> None:
    """Values of the pendulum's weight for each blow, as its geometry implies them."""
    horizontal = campaign.orientation is Orientation.HORIZONTAL
    key = 'gravity_load.force' if name == 'gravity_load' else 'restoring_force.stiffness'
    constants[key] = 0.0
    for i, blow in enumerate(data.blows):
        recording = blow.recording
        if recording.kind == 'drop' and name == 'gravity_load':
            constants[f'{key}@{i}'] = math.nan  # follows from the mass of the moment
        if recording.kind != 'pendulum':
            continue
        if not geometry:
            if (name == 'gravity_load') != horizontal:
                free.append(Free(f'{key}@{i}', 5.0, 0.5, 0.0, 200.0, blow=i))
            continue
        constants[f'{key}@{i}'] = math.nan  # follows from the geometry of the moment


def _pendulum(values: Mapping[str, float], i: int) -> Pendulum:
    distance = values.get(f'mass_distance@{i}', 0.15)
    numbers = {name: values[f'pendulum.{name}'] for name in _PENDULUM}
    return Pendulum(**numbers, mass_distance=distance, gravity=values[GRAVITY])
