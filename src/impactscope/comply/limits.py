"""Limits of force and pressure for the regions of the body, as named, versioned, sourced data.

There are several sets (ISO/TS 15066, its predecessor, national ones), they disagree, and they
change. So a set is a file that says of every value where it was found; this module checks it
when it is loaded and answers questions about it. It reads no files: it takes a parsed mapping.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from impactscope.comply._mapping import Table
from impactscope.errors import ConfigurationError

__all__ = ['AreaLimits', 'LimitSet', 'RegionLimits']

# Factors to SI. A set states the units it is written in, so that it can be compared line by
# line with the printed tables.
UNITS: dict[str, dict[str, float]] = {
    'force': {'N': 1.0},
    'pressure': {'Pa': 1.0, 'MPa': 1e6, 'N/cm2': 1e4, 'N/mm2': 1e6},
    'stiffness': {'N/m': 1.0, 'N/mm': 1e3},
    'mass': {'kg': 1.0},
    'energy': {'J': 1.0},
}


@dataclass(frozen=True, slots=True)
class RegionLimits:
    """What applies to one region of the body; SI units.

    ``transient_force`` is None where contact is not permitted at all.
    """

    name: str
    title: str  # as it stands in sentences: 'hands and fingers'
    quasi_static_force: float  # N
    transient_force: float | None  # N
    stiffness: float  # N/m, effective, of the body region
    mass: float  # kg, effective, of the body region
    energy: float = math.nan  # J, permitted transfer; NaN where the set has none
    pressure_multiplier: float | None = None  # transient over quasi-static pressure
    sources: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # value -> letters

    @property
    def contact_permitted(self) -> bool:
        """Whether the set permits any contact with this region."""
        return self.transient_force is not None

    @property
    def multiplier(self) -> float | None:
        """Transient over quasi-static force; None where contact is not permitted."""
        if self.transient_force is None:
            return None
        return self.transient_force / self.quasi_static_force


@dataclass(frozen=True, slots=True)
class AreaLimits:
    """Pressure limits of one specific area of the body; SI units."""

    id: int
    name: str
    region: str
    quasi_static_pressure: float  # Pa
    transient_pressure: float | None  # Pa; None where contact is not permitted
    sources: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class LimitSet:
    """A named, versioned set of limits; see :meth:`from_mapping` for its written form."""

    name: str
    version: str
    title: str
    description: str
    regions: Mapping[str, RegionLimits]
    areas: tuple[AreaLimits, ...] = ()
    sources: Mapping[str, str] = field(default_factory=dict)  # letter -> where it was found
    disagreements: tuple[str, ...] = ()  # between sources, each as one sentence

    @property
    def label(self) -> str:
        """Name and version, as it stands in verdicts."""
        return f'{self.name} {self.version}'

    def limits_for(self, region: str) -> RegionLimits:
        """The limits of a region; ConfigurationError naming the known ones if it is unknown."""
        try:
            return self.regions[region]
        except KeyError:
            raise ConfigurationError(
                f'limit set {self.label!r} has no body region {region!r}; '
                f'it has {", ".join(self.regions)}'
            ) from None

    def areas_of(self, region: str) -> tuple[AreaLimits, ...]:
        """The specific areas of a region, in the set's order; an unknown region is an error."""
        self.limits_for(region)
        return tuple(area for area in self.areas if area.region == region)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> LimitSet:
        """Build from parsed YAML, every value checked; see ``config/limits/`` for the form.

        ``units`` states the unit of each kind of value. A region has ``quasi_static_force`` and
        either ``transient_multiplier`` or ``transient_force`` (both only where they agree); null
        says that contact is not permitted, and must be written, never left out.

        Raises:
            ConfigurationError: a key is missing or unknown, a number is not finite or out of
                range, a unit, source or region is unknown, or two values contradict each other.
        """
        table = Table(mapping, 'limit set')
        name = table.text('name')
        table = table.renamed(f'limit set {name!r}')
        version = table.text('version')
        title = table.text('title')
        description = table.text('description', '')
        sources = {
            letter: str(text) for letter, text in table.mapping('sources', default={}).items()
        }
        factors = _factors(table.table('units'))
        regions = {
            key: _region(key, table.child('regions', key), factors, sources)
            for key in table.mapping('regions')
        }
        if not regions:
            raise ConfigurationError(f'limit set {name!r}: regions is empty; one is needed')
        areas = tuple(
            _area(item, regions, factors, sources) for item in table.tables('areas', default=())
        )
        ids = [area.id for area in areas]
        doubled = sorted({i for i in ids if ids.count(i) > 1})
        if doubled:
            raise ConfigurationError(f'limit set {name!r}: area id {doubled[0]} occurs twice')
        disagreements = tuple(
            f'{item.text("of")}: {item.text("values")}; used: {item.text("used")}'
            for item in table.tables('disagreements', default=())
        )
        table.refuse_unknown()
        return cls(
            name=name,
            version=version,
            title=title,
            description=description,
            regions=regions,
            areas=areas,
            sources=sources,
            disagreements=disagreements,
        )


def _factors(units: Table) -> dict[str, float]:
    factors = {}
    for kind, known in UNITS.items():
        unit = units.text(kind)
        if unit not in known:
            raise ConfigurationError(
                f'{units.where}: {kind} is in {unit!r}; known are {", ".join(known)}'
            )
        factors[kind] = known[unit]
    units.refuse_unknown()
    return factors


def _region(
    key: str, table: Table, factors: Mapping[str, float], known_sources: Mapping[str, str]
) -> RegionLimits:
    quasi_static = table.positive('quasi_static_force') * factors['force']
    transient = _transient(table, 'force', quasi_static, factors['force'])
    if transient is not None and transient < quasi_static:
        raise ConfigurationError(
            f'{table.where}: the transient limit {transient:g} N is below the quasi-static '
            f'limit {quasi_static:g} N'
        )
    pressure_multiplier = table.positive_or_none('pressure_multiplier', default=None)
    if pressure_multiplier is not None and pressure_multiplier < 1:
        raise ConfigurationError(
            f'{table.where}: pressure_multiplier is {pressure_multiplier:g}; 1 or more is needed'
        )
    if transient is None and pressure_multiplier is not None:
        raise ConfigurationError(
            f'{table.where}: pressure_multiplier is {pressure_multiplier:g} '
            'although contact is not permitted'
        )
    limits = RegionLimits(
        name=key,
        title=table.text('title', key.replace('_', ' ')),
        quasi_static_force=quasi_static,
        transient_force=transient,
        stiffness=table.positive('stiffness') * factors['stiffness'],
        mass=table.positive('mass') * factors['mass'],
        energy=table.positive('energy', math.nan) * factors['energy'],
        pressure_multiplier=pressure_multiplier,
        sources=_value_sources(table, known_sources),
    )
    table.refuse_unknown()
    return limits


def _transient(table: Table, kind: str, quasi_static: float, factor: float) -> float | None:
    multiplier_key, value_key = 'transient_multiplier', f'transient_{kind}'
    if multiplier_key not in table and value_key not in table:
        raise ConfigurationError(
            f'{table.where}: neither {multiplier_key} nor {value_key} is given; '
            'write null where contact is not permitted'
        )
    multiplier = table.positive_or_none(multiplier_key, default=None)
    value = table.positive_or_none(value_key, default=None)
    by_rule = None if multiplier is None else multiplier * quasi_static
    given = None if value is None else value * factor
    if multiplier_key in table and value_key in table:
        agree = (
            given is None
            if by_rule is None
            else given is not None and math.isclose(given, by_rule, rel_tol=1e-9)
        )
        if not agree:
            raise ConfigurationError(
                f'{table.where}: {value_key} is {value} but {multiplier_key} {multiplier} '
                f'of {quasi_static:g} gives {by_rule}'
            )
    return given if by_rule is None else by_rule


def _value_sources(table: Table, known_sources: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    sources: dict[str, tuple[str, ...]] = {}
    named = table.table('sources', default={})
    for value in ('force', 'stiffness', 'mass', 'energy'):
        sources[value] = _letters(named, value, known_sources)
    named.refuse_unknown()
    return sources


def _letters(table: Table, key: str, known: Mapping[str, str]) -> tuple[str, ...]:
    letters = table.texts(key)
    unknown = [letter for letter in letters if letter not in known]
    if unknown:
        raise ConfigurationError(
            f'{table.where}: {key} names the source {unknown[0]!r}; '
            f'known are {", ".join(known) or "none"}'
        )
    return letters


def _area(
    table: Table,
    regions: Mapping[str, RegionLimits],
    factors: Mapping[str, float],
    known_sources: Mapping[str, str],
) -> AreaLimits:
    region = table.text('region')
    if region not in regions:
        raise ConfigurationError(
            f'{table.where}: the body region {region!r} is not in the set; '
            f'it has {", ".join(regions)}'
        )
    pressure = table.positive('quasi_static_pressure') * factors['pressure']
    multiplier = regions[region].pressure_multiplier
    area = AreaLimits(
        id=table.whole('id'),
        name=table.text('name'),
        region=region,
        quasi_static_pressure=pressure,
        transient_pressure=None if multiplier is None else multiplier * pressure,
        sources=_letters(table, 'sources', known_sources),
    )
    table.refuse_unknown()
    return area
