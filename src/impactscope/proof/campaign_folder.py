"""A drawn campaign on disk: one recording a blow, and a file that says what is known of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from impactscope.recordings import RecordingWriter
from impactscope.records import NANOSECONDS, SampleBlock

from .bench import GRAVITY
from .detectability import AXIS_DAMPING, AXIS_MASS
from .effect import swung
from .measurement import INPUTS, REFERENCE, measure
from .scenario import STRIKES, Blow, Scenario

__all__ = ['campaign_file', 'write_campaign']

Array = NDArray[np.float64]

BLOCK_SECONDS = 0.05
_UNITS = {'force': 'N', 'acceleration': 'm/s^2', 'displacement': 'm'}


def write_campaign(
    folder: Path, truth: Scenario, stated: Scenario, rng: np.random.Generator
) -> None:
    """Measure every blow of the truth and write the campaign as it is stated.

    Args:
        folder: made anew; its name is the campaign's.
        truth: what is measured.
        stated: what the campaign file says.
        rng: for noise and for the time of day.

    Raises FileExistsError where the folder is there already.
    """
    folder.mkdir(parents=True)
    moment = 1_750_000_000 * NANOSECONDS + int(rng.integers(3 * 10**16))
    for index, blow in enumerate(truth.blows):
        moment += int(rng.integers(20, 120)) * NANOSECONDS + int(rng.integers(NANOSECONDS))
        _write_recording(folder / _file_name(index), blow, truth, moment, rng)
    text = yaml.safe_dump(campaign_file(stated), sort_keys=False, default_flow_style=None)
    (folder / 'campaign.yaml').write_text(text)


def campaign_file(stated: Scenario) -> dict[str, object]:
    """The content of ``campaign.yaml``; not a word of what is concealed."""
    if stated.kind in INPUTS:
        return {
            'version': 1,
            'bench': _given_bench(stated),
            **_model(stated),
            'baseline': list(stated.baseline),
            'recordings': [
                {'file': _file_name(i), 'role': blow.role} for i, blow in enumerate(stated.blows)
            ],
        }
    layer = stated.layer
    damper = None
    if layer is not None:
        branch = {'stiffness': layer['branch_stiffness'], 'damping': layer['branch_damping']}
        damper = {'branches': [branch], 'parallel_stiffness': layer['layer_stiffness']}
    gains = {name.split('.')[0]: value for name, value in stated.gain_std.items()}
    return {
        'version': 1,
        'bench': {'kind': 'impact', 'orientation': stated.orientation},
        'sensor': {
            'stiffness': {
                'value': stated.sensor.stiffness,
                'std': stated.sensor.stiffness_std,
                'unit': 'N/m',
            },
            'moving_mass': None,
            'damping_ratio': None,
        },
        'damper': damper,
        **(_pendulum(stated) if swung(stated) else {}),
        'gain_std': gains,
        'baseline': list(stated.baseline),
        'recordings': [_recording(i, blow, stated) for i, blow in enumerate(stated.blows)],
    }


def _model(stated: Scenario) -> dict[str, object]:
    if stated.kind == 'driven':
        return {'model': {'modes': 1}}
    if stated.kind != 'closed_loop':
        return {}
    model: dict[str, object] = {'model': {'restoring': 'none'}}
    numbers = stated.stated_axis
    if numbers is None:
        return model
    sensor = {
        name: {'value': numbers[name], 'std': float(f'{share * numbers[name]:.2g}'), 'unit': unit}
        for name, share, unit in (
            ('moving_mass', AXIS_MASS, 'kg'),
            ('damping', AXIS_DAMPING, 'N s/m'),
        )
    }
    gain_std = {name.split('.')[0]: value for name, value in stated.gain_std.items()}
    return model | {'sensor': sensor, 'gain_std': gain_std}


def _pendulum(stated: Scenario) -> dict[str, object]:
    angle = {'release_angle_std_deg': stated.angle_std_deg}
    return {'pendulum': stated.pendulum._asdict() | angle}


def _given_bench(stated: Scenario) -> dict[str, object]:
    given, outputs = INPUTS[stated.kind], list(stated.channels)
    if stated.kind == 'driven':
        return {'kind': 'driven', 'input': given, 'outputs': outputs}
    if stated.kind == 'closed_loop':
        law = stated.blows[0].law
        return {
            'kind': 'driven',
            'input': given,
            'outputs': outputs,
            'reference': REFERENCE,
            'controller': {'kp': law.kp, 'kv': law.kv, 'gain': law.gain},
        }
    if stated.kind == 'prescribed':
        return {'kind': 'prescribed_motion', 'motion': given, 'output': outputs[0]}
    return {'kind': 'chain', 'input': given, 'output': outputs[0]}


def _file_name(index: int) -> str:
    return f'recording_{index:02d}.mcap'


def _recording(index: int, blow: Blow, stated: Scenario) -> dict[str, object]:
    entry: dict[str, object] = {'file': _file_name(index), 'kind': blow.kind}
    if blow.kind == 'pendulum':
        entry |= {
            'mass_distance': blow.distance,
            'release_angle_deg': blow.angle_deg,
            'damper': stated.layer is not None,
        }
    elif blow.kind in STRIKES:
        entry |= {'effective_mass': blow.labelled_mass, 'damper': stated.layer is not None}
        if blow.kind == 'robot':
            entry['speed'] = blow.labelled_speed
        else:
            entry['drop_height'] = round(blow.labelled_speed**2 / (2 * GRAVITY), 5)
    return entry | {'role': blow.role}


def _write_recording(
    path: Path, blow: Blow, truth: Scenario, moment: int, rng: np.random.Generator
) -> None:
    rates = {**truth.rates}
    if truth.kind in INPUTS:
        rates[INPUTS[truth.kind]] = rates[REFERENCE] = max(truth.rates.values())
    blocks = []
    for name, values in measure(blow, truth, rng).items():
        size = math.ceil(BLOCK_SECONDS * rates[name])
        for first in range(0, values.size, size):
            part = values[first : first + size].astype(np.float32)
            stamp = moment + round(first / rates[name] * NANOSECONDS)
            end = moment + round((first + part.size) / rates[name] * NANOSECONDS)
            unit = _UNITS[name.split('.')[0]]
            blocks.append(
                SampleBlock(name, unit, rates[name], stamp, first, part, received_ns=end)
            )
    blocks.sort(key=lambda block: block.received_ns)
    with RecordingWriter(path, flush_interval=0) as writer:
        for block in blocks:
            writer.write_block(block)
