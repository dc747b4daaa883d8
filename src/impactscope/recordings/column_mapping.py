"""Which column of a file is which channel, in which unit, at which times."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError
from impactscope.records import TestPoint
from impactscope.yaml_text import parse_yaml

from .units import to_si

__all__ = ['ColumnMapping', 'ColumnSpec', 'time_and_unit']


@dataclass(frozen=True, slots=True)
class ColumnSpec:
    """One channel. Raises ConfigurationError where the unit is unknown or a number is not one."""

    channel: str
    column: str | int
    unit: str = '1'  # in the file; values are converted to SI
    scale: float = 1.0  # multiplies the file's values first, e.g. -1 for a reversed sign
    zero: float = 0.0  # what the file says where the quantity is none; taken off before the scale
    range_min: float = math.nan  # SI; samples at or beyond it are clipped
    range_max: float = math.nan
    frame_id: str = ''

    def __post_init__(self) -> None:
        to_si(self.unit)
        if not self.channel.strip():
            raise ConfigurationError(f'column {self.column!r} is mapped to a channel without name')
        if not math.isfinite(self.scale) or self.scale == 0:
            raise ConfigurationError(f'channel {self.channel!r}: scale is {self.scale!r}')
        if not math.isfinite(self.zero):
            raise ConfigurationError(f'channel {self.channel!r}: zero is {self.zero!r}')

    def in_si(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values of the file as the quantity in its SI unit, shape as given."""
        return np.asarray((values - self.zero) * (self.scale * to_si(self.unit)[1]))

    @classmethod
    def parse(cls, text: str) -> ColumnSpec:
        """From ``channel=column:unit``, as in ``force=1:N`` or ``force.hammer=Fz:kN``."""
        channel, equals, rest = text.partition('=')
        column, colon, unit = rest.rpartition(':')
        if not equals or not colon or not column.strip():
            raise ConfigurationError(f'{text!r} is not of the form channel=column:unit')
        return cls(channel.strip(), _key(column.strip()), unit.strip())


def _key(text: str) -> str | int:
    return int(text) if text.isdecimal() else text


def time_and_unit(text: str) -> tuple[str | int | None, str]:
    """From ``column:unit`` or ``column``, which is in s; None where it is empty."""
    column, _, unit = text.rpartition(':') if ':' in text else (text, '', '')
    return (_key(column.strip()) if column.strip() else None), unit.strip() or 's'


@dataclass(frozen=True, slots=True)
class ColumnMapping:
    """Channels, time base and layout of a file of columns.

    Raises ConfigurationError where there are no channels, names repeat, or neither a time
    column nor a sample rate is given.
    """

    channels: tuple[ColumnSpec, ...]
    time: str | int | None = None  # column of sample times
    time_unit: str = 's'
    sample_rate: float | None = None  # Hz; where there is a time column it must agree
    resample: bool = False  # times are uneven: to an even grid, at sample_rate where that is given
    skip_rows: int | None = None  # header lines of a text file; None: found
    delimiter: str | None = None
    transpose: bool = False  # rows of the file's table are the channels
    start_ns: int = 0  # time of the first sample, ns since 1970
    provenance: Mapping[str, str] = dataclasses.field(default_factory=dict)
    test_point: TestPoint | None = None

    def __post_init__(self) -> None:
        if not self.channels:
            raise ConfigurationError('a mapping without channels')
        names = [spec.channel for spec in self.channels]
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise ConfigurationError(f'channel {repeated[0]!r} is mapped more than once')
        if to_si(self.time_unit)[0] != 's':
            raise ConfigurationError(f'time_unit {self.time_unit!r} is no unit of time')
        if self.time is None and self.sample_rate is None:
            raise ConfigurationError('neither a time column nor a sample rate is given')
        if self.resample and self.time is None:
            raise ConfigurationError('resample needs a time column')
        rate = self.sample_rate
        if rate is not None and not (math.isfinite(rate) and rate > 0):
            raise ConfigurationError(f'sample_rate is {rate!r} Hz; it must be above zero')
        if not 0 <= self.start_ns < 1 << 62:
            raise ConfigurationError(f'start_ns is {self.start_ns}; it must be ns since 1970')

    @classmethod
    def from_strings(cls, channels: Sequence[str], **options: Any) -> ColumnMapping:
        """From strings like ``force=1:N``; options are the fields of the class."""
        return cls(tuple(ColumnSpec.parse(text) for text in channels), **options)

    @classmethod
    def from_mapping(cls, content: Mapping[str, Any]) -> ColumnMapping:
        """From parsed YAML; unknown names raise ConfigurationError.

        ``channels`` maps names to ``{column, unit, ...}``; the rest are the class's fields, or
        named as on the command line: ``time_column`` is ``time``, and a hyphen an underscore.
        """
        values = {str(key).replace('-', '_'): value for key, value in content.items()}
        if 'time_column' in values:
            if 'time' in values:
                raise ConfigurationError('a mapping names `time` and `time_column`: one is enough')
            values['time'] = values.pop('time_column')
            if isinstance(values['time'], str) and 'time_unit' not in values:
                values['time'], values['time_unit'] = time_and_unit(values['time'])
        channels = values.pop('channels', None)
        if not isinstance(channels, Mapping):
            raise ConfigurationError('a mapping needs `channels`: names with column and unit')
        specs = []
        for name, entry in channels.items():
            if not isinstance(entry, Mapping) or 'column' not in entry:
                raise ConfigurationError(f'channel {name!r} of the mapping names no column')
            specs.append(_build(ColumnSpec, {'channel': str(name), **entry}))
        point = values.get('test_point')
        if isinstance(point, Mapping):
            values['test_point'] = _build(TestPoint, dict(point))
        if isinstance(values.get('provenance'), Mapping):
            values['provenance'] = {str(k): str(v) for k, v in values['provenance'].items()}
        mapping: ColumnMapping = _build(cls, {'channels': tuple(specs), **values})
        return mapping

    @classmethod
    def from_yaml(cls, path: str | Path) -> ColumnMapping:
        """From a YAML file; ConfigurationError where it cannot be read or does not fit."""
        path = Path(path)
        try:
            content = parse_yaml(path.read_text(encoding='utf-8'))
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise ConfigurationError(
                f'the mapping {path.name!r} cannot be read ({type(error).__name__})'
            ) from error
        if not isinstance(content, Mapping):
            raise ConfigurationError(f'the mapping {path.name!r} holds no names and values')
        return cls.from_mapping(content)


def _build(kind: Any, values: dict[str, Any]) -> Any:
    known = [item.name for item in dataclasses.fields(kind)]
    unknown = sorted(set(values) - set(known))
    if unknown:
        raise ConfigurationError(
            f'{kind.__name__}: unknown {unknown[0]!r}; known are {", ".join(known)}'
        )
    try:
        return kind(**values)
    except (TypeError, AttributeError) as error:
        raise ConfigurationError(f'{kind.__name__}: a value is of the wrong kind') from error
