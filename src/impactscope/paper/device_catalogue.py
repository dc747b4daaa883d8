"""The catalogue of measuring devices in ``config/devices.yaml`` (the paper's Table 1).

A user's own file of the same form extends it: see :func:`load_devices`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from impactscope.configuration import config_folder, load_yaml
from impactscope.errors import ConfigurationError

__all__ = ['Device', 'load_devices']

_KNOWN = {
    'maker',
    'model',
    'spring_stiffness_range',
    'force_range',
    'least_sampling_rate',
    'bandwidth',
    'identified',
}
_IDENTIFIED = ('stiffness', 'natural_frequency', 'damping_ratio', 'moving_mass')


@dataclass(frozen=True, slots=True)
class Device:
    """One entry; NaN where the maker publishes no value."""

    name: str
    maker: str
    model: str
    spring_stiffness_range: tuple[float, float]  # N/m
    force_range: tuple[float, float]  # N
    least_sampling_rate: float  # Hz
    bandwidth: float  # Hz
    identified: Mapping[str, float]  # measured: N/m, Hz, 1, kg by name

    def offers(self, stiffness: float) -> bool:
        """Whether a spring of ``stiffness`` N/m is in its range; False where not known."""
        low, high = self.spring_stiffness_range
        return low <= stiffness <= high


def load_devices(*files: Path) -> dict[str, Device]:
    """The devices of the package's catalogue and of the user's files; later entries win.

    Raises ConfigurationError that names the entry and the value that is wrong.
    """
    devices: dict[str, Device] = {}
    for path in (config_folder() / 'devices.yaml', *files):
        content = load_yaml(path)
        entries = content.get('devices') if isinstance(content, Mapping) else None
        if not isinstance(entries, Mapping) or content.get('schema_version') != 1:
            raise ConfigurationError(f'{path.name}: needs schema_version 1 and a mapping devices')
        for name, entry in entries.items():
            devices[str(name)] = _device(str(name), entry)
    return devices


def _device(name: str, entry: Any) -> Device:
    if not isinstance(entry, Mapping) or not entry.get('model'):
        raise ConfigurationError(f'device {name}: needs at least a model')
    unknown = sorted(map(str, set(entry) - _KNOWN))
    if unknown:
        raise ConfigurationError(f'device {name}: {unknown[0]!r} is not known')
    identified = entry.get('identified') or {}
    if not isinstance(identified, Mapping) or not set(identified) <= set(_IDENTIFIED):
        raise ConfigurationError(
            f'device {name}: identified is {identified!r}; known are {", ".join(_IDENTIFIED)}'
        )
    return Device(
        name,
        str(entry.get('maker') or 'not stated'),
        str(entry['model']),
        _range(name, 'spring_stiffness_range', entry),
        _range(name, 'force_range', entry),
        _number(name, 'least_sampling_rate', entry.get('least_sampling_rate')),
        _number(name, 'bandwidth', entry.get('bandwidth')),
        {key: _number(name, key, value) for key, value in identified.items()},
    )


def _range(name: str, key: str, entry: Mapping[str, Any]) -> tuple[float, float]:
    value = entry.get(key)
    if value is None:
        return math.nan, math.nan
    if not isinstance(value, list) or len(value) != 2:
        raise ConfigurationError(f'device {name}: {key} is {value!r}; [low, high] is needed')
    low, high = (_number(name, key, item) for item in value)
    if not low <= high:
        raise ConfigurationError(f'device {name}: {key} is {value!r}; low exceeds high')
    return low, high


def _number(name: str, key: str, value: Any) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 1e12:
        raise ConfigurationError(f'device {name}: {key} is {value!r}; a number >= 0 is needed')
    return float(value)
