"""Units that measurement files use, and their factors to SI."""

from __future__ import annotations

import math

from impactscope.errors import ConfigurationError

__all__ = ['UNITS', 'to_si']

_POUND_FORCE = 4.4482216152605  # N, exact: 0.45359237 kg at standard gravity
_STANDARD_GRAVITY = 9.80665  # m/s^2, exact (CGPM 1901)
_INCH = 0.0254  # m, exact

UNITS: dict[str, tuple[str, float]] = {
    'N': ('N', 1.0),
    'mN': ('N', 1e-3),
    'kN': ('N', 1e3),
    'lbf': ('N', _POUND_FORCE),
    'kgf': ('N', _STANDARD_GRAVITY),
    'kip': ('N', 1e3 * _POUND_FORCE),
    'N m': ('N m', 1.0),
    'mN m': ('N m', 1e-3),
    'lbf inch': ('N m', _POUND_FORCE * _INCH),
    'm/s^2': ('m/s^2', 1.0),
    'mm/s^2': ('m/s^2', 1e-3),
    'g': ('m/s^2', _STANDARD_GRAVITY),
    'm/s': ('m/s', 1.0),
    'mm/s': ('m/s', 1e-3),
    'cm/s': ('m/s', 1e-2),
    'inch/s': ('m/s', _INCH),
    'm': ('m', 1.0),
    'mm': ('m', 1e-3),
    'cm': ('m', 1e-2),
    'um': ('m', 1e-6),
    'inch': ('m', _INCH),
    'rad': ('rad', 1.0),
    'deg': ('rad', math.pi / 180.0),
    'rev': ('rad', 2.0 * math.pi),
    'rad/s': ('rad/s', 1.0),
    'deg/s': ('rad/s', math.pi / 180.0),
    'rev/s': ('rad/s', 2.0 * math.pi),
    'rpm': ('rad/s', math.pi / 30.0),
    'rad/s^2': ('rad/s^2', 1.0),
    'deg/s^2': ('rad/s^2', math.pi / 180.0),
    'V': ('V', 1.0),
    'mV': ('V', 1e-3),
    'A': ('A', 1.0),
    'mA': ('A', 1e-3),
    'Pa': ('Pa', 1.0),
    'kPa': ('Pa', 1e3),
    'MPa': ('Pa', 1e6),
    's': ('s', 1.0),
    'ms': ('s', 1e-3),
    'us': ('s', 1e-6),
    'ns': ('s', 1e-9),
    '1': ('1', 1.0),
}
"""Name of a unit to (SI unit, factor): a value in SI is the value times the factor."""

_ALIASES = {'m/s2': 'm/s^2', 'm/s²': 'm/s^2', 'in': 'inch', 'Nm': 'N m', 'µm': 'um', '°': 'deg'}
_ALIASES |= {'N*m': 'N m', 'N·m': 'N m', 'Nmm': 'mN m', 'N mm': 'mN m', '°/s': 'deg/s'}
_ALIASES |= {'rad/s2': 'rad/s^2', 'rad/s²': 'rad/s^2', 'mm/s2': 'mm/s^2', 'mm/s²': 'mm/s^2'}
_ALIASES |= dict.fromkeys(('turn', 'turns', 'rot', 'rotation', 'rotations'), 'rev')
_ALIASES |= dict.fromkeys(('count', 'counts', 'tick', 'ticks', 'LSB'), '1')
_ALIASES |= {'μm': 'um', 'µs': 'us', 'μs': 'us', 'lbs': 'lbf', 'lb': 'lbf', 'G': 'g'}


def to_si(unit: str) -> tuple[str, float]:
    """SI unit and factor of a unit; ConfigurationError where it is not known."""
    unit = unit.strip()
    try:
        return UNITS[_ALIASES.get(unit, unit)]
    except KeyError:
        raise ConfigurationError(
            f'unit {unit!r} is not known; known are {", ".join(UNITS)}'
        ) from None
