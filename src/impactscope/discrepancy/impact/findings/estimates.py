"""Fitted numbers as an answer states them, and as a new baseline keeps them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from impactscope.discrepancy.answer import ParameterEstimate
from impactscope.discrepancy.campaign import Campaign
from impactscope.discrepancy.evidence import flat_top
from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.models.bench_model import Free
from impactscope.discrepancy.impact.models.bench_parameters import ADDED_WEIGHT, WEIGHT
from impactscope.discrepancy.impact.search.outcome import Outcome
from impactscope.physics.mechanisms.registry import mechanism
from impactscope.physics.pendulum import Orientation

__all__ = ['estimates', 'fitted_numbers', 'label_of', 'saved_model', 'stated_value', 'unit_of']

_UNITS = {
    'stiffness': 'N/m',
    'moving_mass': 'kg',
    'damping_ratio': '1',
    'damping': 'N s/m',
    'parallel_stiffness': 'N/m',
    'restitution': '1',
    'exponent': '1',
    'rod_mass': 'kg',
    'rod_length': 'm',
    'contact_distance': 'm',
    'mass_distance': 'm',
    'angle': 'deg',
    'time': 's',
    'tap_peak': 'N',
    'tap_duration': 's',
    'impactor_mass': 'kg',
    'speed': 'm/s',
    WEIGHT: '1',
    ADDED_WEIGHT: 'N',
}


def estimates(candidate: Candidate, fitted: Fit) -> dict[str, ParameterEstimate]:
    """The numbers of a finding as the vocabulary names them, SI units."""
    if candidate.name == 'wrong_parameter':
        key = candidate.parameter.split('@')[0]
        name = key.rsplit('.', 1)[-1] if not key.startswith('gain') else key
        name = {'angle': 'release_angle_deg'}.get(name, name)
        result = {'name': ParameterEstimate(name, math.nan, 'text')}
        if name != key and '.' in key:  # a layer has several of a name
            result['place'] = ParameterEstimate(key, math.nan, 'text')
        if candidate.free:
            stated = stated_value(candidate)
            value = fitted.values[candidate.free[0].key]
            std = fitted.std(candidate.free[0].key)
            if stated:
                result['ratio'] = ParameterEstimate(value / stated, std / abs(stated), '1')
            result['value'] = ParameterEstimate(value, std, unit_of(candidate.parameter))
        return result
    values = fitted.values
    result = {}
    for parameter in mechanism(candidate.name).parameters:
        key = f'{candidate.effects[0].tag}.{parameter.name}'
        if key not in values:
            continue
        unit = _channel_unit(parameter.unit, candidate.channel, fitted)
        std = fitted.std(key)
        if _at_bound(fitted, key) or (std == 0.0 and _is_free(fitted, key)):
            std = math.nan  # known from one side only, or without any influence
        result[parameter.name] = ParameterEstimate(values[key], std, unit)
    if candidate.name == 'saturation' and candidate.channel:
        result['limit'] = _as_read(result['limit'], candidate.channel, fitted)
    if candidate.name == 'stribeck_friction':
        static, kinetic = result['static_force'], result['kinetic_force']
        if float(static.value) < float(kinetic.value):  # simulated as no peak at rest
            result['static_force'] = ParameterEstimate(kinetic.value, math.nan, static.unit)
    hum = candidate.hum_amplitude(fitted)
    if hum is not None:
        unit = result['amplitude'].unit
        result['amplitude'] = ParameterEstimate(hum.value, hum.std, unit)
        result.pop('phase', None)
    return result


def _is_free(fitted: Fit, key: str) -> bool:
    return any(f.key == key for f in fitted.model.free)


def _at_bound(fitted: Fit, key: str) -> bool:
    """Whether a number stands at the end of what is tried: it is known from one side only."""
    number = next((f for f in fitted.model.free if f.key == key), None)
    if number is None or not number.logarithmic:
        return False
    value = fitted.values[key]
    # below, a filter before sampling goes on as one of samples
    ahead = fitted.values.get(f'{key.rpartition(".")[0]}.ahead', 0.0) > 0.0
    return not (ahead or 1.02 * number.lower < value) or value > 0.98 * number.upper


def stated_value(candidate: Candidate) -> float:
    """Value of the baseline for a number that is wrong."""
    number = candidate.free[0]
    if candidate.amplitudes:
        return float(candidate.amplitudes[number.key])
    return number.start


def fitted_numbers(fitted: Fit) -> dict[str, ParameterEstimate]:
    """Every number that a fit has tuned; those of one blow with its recording's name."""
    values = fitted.values
    names = [b.name for b in fitted.model.data.blows]
    covariance = np.sqrt(np.maximum(np.diag(fitted.covariance()), 0.0))
    result = {}
    for j, number in enumerate(fitted.model.free):
        if number.blow is not None and number.blow not in fitted.layout.blow_spans:
            continue
        value = values[number.key]
        std = float(covariance[j]) * (value if number.logarithmic else 1.0)
        result[label_of(number, names)] = ParameterEstimate(value, std, unit_of(number.key))
    return result


def label_of(number: Free, recordings: Sequence[str]) -> str:
    """A number's key; of one blow with the name of its recording."""
    if number.blow is None:
        return number.key
    return f'{number.key.split("@")[0]} of {recordings[number.blow]}'


def saved_model(
    campaign: Campaign, outcome: Outcome, accepted: Sequence[Candidate]
) -> dict[str, object]:
    """The extended model as a new baseline of ``campaign.yaml``."""
    values = outcome.final.values
    weights: dict[str, dict[str, float]] = {}
    for wrong in accepted:
        name, _, number = wrong.parameter.rpartition('.')
        if number in (WEIGHT, ADDED_WEIGHT):
            weights.setdefault(name, {})[number] = values[wrong.free[0].key]
    baseline: list[object] = [
        {'name': b.name, 'values': known} if known else b.name
        for b in campaign.baseline
        if (known := {**b.values, **weights.get(b.name, {})}) is not None
    ]
    for candidate in accepted:
        if candidate.name == 'wrong_parameter':
            continue
        numbers = {
            name: item.value
            for name, item in estimates(candidate, outcome.final).items()
            if not isinstance(item.value, str)
        }
        entry: dict[str, object] = {'name': candidate.name, 'values': numbers}
        if candidate.channel:
            entry['channel'] = candidate.channel
        baseline.append(entry)
    sensor = {
        key.split('.', 1)[1]: {'value': values[key], 'std': outcome.final.std(key)}
        for key in values
        if key.startswith('sensor.')
    }
    files = [recording.file for recording in campaign.recordings]
    blows = {
        i: files.index(b.recording.file) for i, b in enumerate(outcome.final.model.data.blows)
    }
    corrected: dict[str, object] = {}
    for wrong in (c for c in accepted if c.name == 'wrong_parameter'):
        if wrong.free and not wrong.parameter.endswith((f'.{WEIGHT}', f'.{ADDED_WEIGHT}')):
            corrected[_place(wrong.parameter, blows)] = values[wrong.free[0].key]
        elif wrong.parameter == 'orientation':
            lying = wrong.constants['orientation'] > 0.5
            found = Orientation.HORIZONTAL if lying else Orientation.VERTICAL
            corrected['bench.orientation'] = found.value
    return {'baseline': baseline, 'sensor': sensor, 'corrected': corrected}


def _place(key: str, recordings: Mapping[int, int]) -> str:
    """Where a number stands in ``campaign.yaml``; ``recordings`` by the number of the blow."""
    name, _, blow = key.partition('@')
    if not blow:
        return name
    stated = {'angle': 'release_angle_deg', 'impactor_mass': 'effective_mass'}.get(name, name)
    return f'recordings.{recordings[int(blow)]}.{stated}'


def _as_read(limit: ParameterEstimate, channel: str, fitted: Fit) -> ParameterEstimate:
    seen = [b.channels[channel] for b in fitted.model.data.blows if channel in b.channels]
    step, noise = max(c.step for c in seen), max(c.noise for c in seen)
    told = flat_top([c.samples for c in seen], step, float(limit.value), noise)
    return limit if told is None else ParameterEstimate(*told, limit.unit)


def _channel_unit(unit: str, channel: str, fitted: Fit) -> str:
    if 'channel' not in unit:
        return unit
    for blow in fitted.model.data.blows:
        if channel in blow.channels:
            return unit.replace(
                'of the channel per s', blow.channels[channel].unit + '/s'
            ).replace('of the channel', blow.channels[channel].unit)
    return unit


def unit_of(key: str) -> str:
    """SI unit of a number by its key; empty where it has none of its own."""
    name = key.split('@')[0]
    if name.startswith('gain'):
        return '1'
    return _UNITS.get(name.rsplit('.', 1)[-1], '')
