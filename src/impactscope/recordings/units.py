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
    'kip': ('N', 1e3 * _POUND_FORCE),
    'N m': ('N m', 1.0),
    'm/s^2': ('m/s^2', 1.0),
    'g': ('m/s^2', _STANDARD_GRAVITY),
    'm/s': ('m/s', 1.0),
    'mm/s': ('m/s', 1e-3),
    'inch/s': ('m/s', _INCH),
    'm': ('m', 1.0),
    'mm': ('m', 1e-3),
    'um': ('m', 1e-6),
    'inch': ('m', _INCH),
    'rad': ('rad', 1.0),
    'deg': ('rad', math.pi / 180.0),
    'rad/s': ('rad/s', 1.0),
    'deg/s': ('rad/s', math.pi / 180.0),
    'V': ('V', 1.0),
    'mV': ('V', 1e-3),
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


def to_si(unit: str) -> tuple[str, float]:
    """SI unit and factor of a unit; ConfigurationError where it is not known."""
    unit = unit.strip()
    try:
        return UNITS[_ALIASES.get(unit, unit)]
    except KeyError:
        raise ConfigurationError(
            f'unit {unit!r} is not known; known are {", ".join(UNITS)}'
        ) from None
