"""Reading parsed YAML strictly: every key known, every number finite, errors that say where."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from impactscope.errors import ConfigurationError

_REQUIRED: Any = object()


class Table:
    """A mapping that remembers which keys were asked for, so that the rest can be refused.

    Every method raises ConfigurationError with the place and the offending value. A default
    makes a key optional.
    """

    def __init__(self, mapping: object, where: str) -> None:
        if not isinstance(mapping, Mapping):
            raise ConfigurationError(
                f'{where} is {_shown(mapping)}; a mapping of names to values is needed'
            )
        self.where = where
        self._mapping = mapping
        self._asked: set[str] = set()

    def __contains__(self, key: str) -> bool:
        return key in self._mapping

    def renamed(self, where: str) -> Table:
        """The same table, called differently in errors."""
        self.where = where
        return self

    def _get(self, key: str, default: Any) -> Any:
        self._asked.add(key)
        if key in self._mapping:
            return self._mapping[key]
        if default is _REQUIRED:
            raise ConfigurationError(f'{self.where}: {key} is missing')
        return default

    def text(self, key: str, default: Any = _REQUIRED) -> str:
        """A text that is not empty; a plain number is taken as written (versions)."""
        value = self._get(key, default)
        if value is default:
            return str(value)
        if isinstance(value, bool) or not isinstance(value, str | int | float) or value == '':
            raise ConfigurationError(f'{self.where}: {key} is {_shown(value)}; text is needed')
        return str(value).strip()

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts, not empty."""
        value = self._get(key, _REQUIRED)
        if not isinstance(value, list | tuple) or not value:
            raise ConfigurationError(f'{self.where}: {key} is {_shown(value)}; a list is needed')
        return tuple(str(item) for item in value)

    def positive(self, key: str, default: Any = _REQUIRED) -> float:
        """A finite number above zero."""
        value = self._get(key, default)
        if value is default:
            return float(value)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or value <= 0:
            raise ConfigurationError(
                f'{self.where}: {key} is {_shown(value)}; a finite number above zero is needed'
            )
        return float(value)

    def positive_or_none(self, key: str, default: Any = _REQUIRED) -> float | None:
        """A finite number above zero, or null."""
        return None if self._get(key, default) is None else self.positive(key, default)

    def whole(self, key: str) -> int:
        """A whole number above zero."""
        value = self.positive(key)
        if not value.is_integer():
            raise ConfigurationError(f'{self.where}: {key} is {value}; a whole number is needed')
        return int(value)

    def mapping(self, key: str, default: Any = _REQUIRED) -> dict[str, Any]:
        """A mapping with texts as keys."""
        value = Table(self._get(key, default), f'{self.where}: {key}')._mapping
        return {str(name): item for name, item in value.items()}

    def table(self, key: str, default: Any = _REQUIRED) -> Table:
        """A mapping, to be read in turn."""
        return Table(self._get(key, default), f'{self.where}: {key}')

    def child(self, key: str, name: str) -> Table:
        """The table ``name`` inside the mapping ``key``."""
        return Table(self.mapping(key)[name], f'{self.where}, {name!r}')

    def tables(self, key: str, default: Iterable[object] = _REQUIRED) -> tuple[Table, ...]:
        """A list of mappings, each to be read in turn."""
        value = self._get(key, default)
        if not isinstance(value, list | tuple):
            raise ConfigurationError(f'{self.where}: {key} is {_shown(value)}; a list is needed')
        return tuple(
            Table(item, f'{self.where}: {key}, entry {number}')
            for number, item in enumerate(value, 1)
        )

    def refuse_unknown(self) -> None:
        """Refuse what nobody asked for: a misspelt key must not pass for an absent one."""
        unknown = [str(key) for key in self._mapping if key not in self._asked]
        if unknown:
            raise ConfigurationError(
                f'{self.where}: unknown {", ".join(map(repr, unknown))}; '
                f'known are {", ".join(sorted(self._asked))}'
            )


def _shown(value: object, longest: int = 60) -> str:
    text = repr(value)
    return text if len(text) <= longest else text[: longest - 1] + '…'
