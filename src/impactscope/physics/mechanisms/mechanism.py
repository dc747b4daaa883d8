"""What a mechanism is: one physical effect, described once, for people and for the solver.

A file in this folder that holds ``MECHANISM`` adds an effect to everything: the twin, its
command line, the search for missing physics. It brings

* its name, subsystem, sentence, equation, source and most telling test;
* its parameters with SI unit, bounds, start values and the value at which it is absent;
* how it enters: ``enter`` writes into the parameter vector of the compiled bench
  (:mod:`impactscope.physics.twin.layout`), ``distort`` acts on one channel's samples,
  ``retime`` on the moments at which they are taken.

A law that the bench does not have yet comes along as ``guide_term`` or ``contact_term``: a small
compiled function ``f(par, own, displacement, speed)`` in N, where ``par[own]``, ``par[own + 1]``,
... are the mechanism's own parameters in their order. Guide terms resist the plate (displacement
and speed of plate against base), contact terms push impactor and plate apart (indentation and
approach speed). Their power is booked as loss.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError

__all__ = ['Mechanism', 'Parameter', 'Subsystem', 'Values']

Values = Mapping[str, float]
Array = NDArray[np.float64]
Term = Callable[[Array, int, float, float], float]


class Subsystem(enum.Enum):
    """The part of bench or chain in which an effect lives."""

    GUIDE = 'guide'
    SPRING = 'spring'
    DAMPER = 'damper'
    CONTACT = 'contact'
    IMPACTOR = 'impactor'
    FIXTURE = 'fixture'
    MEASUREMENT = 'measurement'


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of a mechanism, in SI units.

    ``absent`` is the value at which the mechanism is not there; None for a number that only
    matters while the mechanism is there. ``start``: values from which a search sets out.
    ``default``: taken where the value is not given; NaN where it must be. ``with_strength``: what
    it is over the effect's strength, a time say, is what matters.
    """

    name: str
    unit: str
    lower: float
    upper: float
    start: tuple[float, ...]
    absent: float | None = None
    default: float = math.nan
    whole: bool = False  # takes whole numbers only
    logarithmic: bool = True  # search on a logarithmic scale
    with_strength: bool = False

    def check(self, value: float, mechanism: str) -> float:
        """Return ``value``; raise ConfigurationError where it is out of bounds."""
        inside = self.lower <= value <= self.upper or value == self.absent
        if not inside or (self.whole and value != round(value)):
            kind = 'a whole number' if self.whole else 'a number'
            raise ConfigurationError(
                f'{mechanism}: {self.name} is {value!r} {self.unit}; '
                f'it must be {kind} from {self.lower:g} to {self.upper:g}'
            )
        return float(value)


@dataclass(frozen=True, slots=True)
class Mechanism:
    """One physical effect; see the module's description."""

    name: str
    subsystem: Subsystem
    sentence: str
    equation: str
    parameters: tuple[Parameter, ...]
    source: str
    test: str  # the test that reveals it best
    enter: Callable[[Array, Values], None] | None = None
    guide_term: Term | None = None
    contact_term: Term | None = None
    distort: Callable[[Array, float, Values], Array] | None = None
    retime: Callable[[Array, Values], Array] | None = None
    needs: frozenset[str] = field(default_factory=frozenset)  # of 'impactor', 'damper', 'bare'
    kin: tuple[str, ...] = ()  # mechanisms of the same family
    alone_in: tuple[str, ...] = ()  # kinds of blows, of which it may act in one alone
    contains: tuple[str, ...] = ()  # of them, those that are this one with fewer numbers

    @property
    def on_channel(self) -> bool:
        """Whether it acts on one channel of the measuring chain."""
        return self.subsystem is Subsystem.MEASUREMENT

    def values(self, given: Values | None = None) -> dict[str, float]:
        """All parameters, with defaults filled in and bounds checked.

        Raises ConfigurationError for an unknown, missing or out-of-range parameter.
        """
        given = given or {}
        known = [parameter.name for parameter in self.parameters]
        if unknown := sorted(given.keys() - set(known)):
            raise ConfigurationError(
                f'{self.name}: unknown parameter {unknown[0]!r}; known are '
                f'{", ".join(known) or "none"}'
            )
        result = {}
        for parameter in self.parameters:
            value = given.get(parameter.name, parameter.default)
            if isinstance(value, float) and math.isnan(value):
                raise ConfigurationError(f'{self.name}: {parameter.name} is not given')
            result[parameter.name] = parameter.check(value, self.name)
        return result

    def absent_values(self) -> dict[str, float]:
        """Values at which the mechanism is not there."""
        return {p.name: p.start[0] if p.absent is None else p.absent for p in self.parameters}
