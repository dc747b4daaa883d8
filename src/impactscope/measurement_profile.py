"""The rules of a measurement: what counts as contact, transient, held, at rest.

The values of published test procedures are not openly available; they belong in a named,
versioned profile that the user supplies. The default says what it is.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from impactscope.errors import ConfigurationError


@dataclass(frozen=True, slots=True)
class MeasurementProfile:
    """Evaluation rules; times in s, forces in N.

    Raises ConfigurationError on construction where a value is out of its range.
    """

    name: str = 'impactscope_default'
    version: str = '1'
    description: str = (
        'Default of Impactscope, after openly available descriptions of ISO/TS 15066 and '
        'ISO 10218-2:2025; not the text of a test procedure.'
    )
    transient_window: float = 0.5  # from first contact; after it contact is quasi-static
    contact_end_force: float = 3.0  # below this, and below noise, contact has ended (unloaded)
    contact_end_hold: float = 0.02  # force must stay below for this long for contact to end
    rest_hold: float = 0.1  # signal must stay at its noise for this long to be at rest
    longest_hold: float = 5.0  # contact is followed no longer than this
    pre_trigger: float = 0.1  # kept before first contact
    longest_ring_down: float = 2.0  # kept after the last contact at most
    repetitions: int = 3  # demanded at each test point
    relative_uncertainty: float = 0.03  # expanded (95 %), of the force channel's calibration
    guard_band: bool = True  # widen limits' edges by the expanded uncertainty (ILAC-G8)

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, bool | str):
                continue
            if not math.isfinite(value) or value < 0:
                raise ConfigurationError(
                    f'measurement profile {self.name!r}: {item.name} is {value!r}; '
                    'it must be a finite number, zero or more'
                )
        if self.transient_window <= 0 or self.longest_hold < self.transient_window:
            raise ConfigurationError(
                f'measurement profile {self.name!r}: longest_hold ({self.longest_hold} s) must '
                f'not be shorter than transient_window ({self.transient_window} s, above zero)'
            )
        if self.repetitions < 1:
            raise ConfigurationError(
                f'measurement profile {self.name!r}: repetitions is {self.repetitions}; '
                'at least 1 is needed'
            )

    @property
    def label(self) -> str:
        """Name and version, as it stands in verdicts."""
        return f'{self.name} {self.version}'

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> MeasurementProfile:
        """Build from parsed YAML; unknown names and wrong types raise ConfigurationError."""
        known = {item.name: item for item in dataclasses.fields(cls)}
        unknown = sorted(set(mapping) - set(known))
        if unknown:
            raise ConfigurationError(
                f'measurement profile: unknown {", ".join(map(repr, unknown))}; '
                f'known are {", ".join(known)}'
            )
        defaults = cls()
        values: dict[str, Any] = {}
        for name, value in mapping.items():
            kind = type(getattr(defaults, name))
            if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
                values[name] = float(value)
            elif kind is str and isinstance(value, str | int | float):
                values[name] = str(value)
            elif type(value) is kind:
                values[name] = value
            else:
                raise ConfigurationError(
                    f'measurement profile: {name} is {value!r}; a {kind.__name__} is needed'
                )
        return cls(**values)
