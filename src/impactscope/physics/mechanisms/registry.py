"""Finds the mechanisms: every module of this folder that holds ``MECHANISM``."""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Mapping
from types import MappingProxyType

from impactscope.errors import ConfigurationError
from impactscope.physics import mechanisms
from impactscope.physics.mechanisms.mechanism import Mechanism

__all__ = ['all_mechanisms', 'mechanism']


@functools.cache
def all_mechanisms() -> Mapping[str, Mechanism]:
    """Name to mechanism, in alphabetical order."""
    found: dict[str, Mechanism] = {}
    for info in sorted(pkgutil.iter_modules(mechanisms.__path__), key=lambda item: item.name):
        module = importlib.import_module(f'{mechanisms.__name__}.{info.name}')
        entry = getattr(module, 'MECHANISM', None)
        if isinstance(entry, Mechanism):
            if entry.name != info.name:
                raise ConfigurationError(
                    f'mechanism {entry.name!r} stands in {info.name}.py; names must agree'
                )
            found[entry.name] = entry
    return MappingProxyType(found)


def mechanism(name: str) -> Mechanism:
    """The mechanism of that name; raises ConfigurationError naming the known ones."""
    try:
        return all_mechanisms()[name]
    except KeyError:
        raise ConfigurationError(
            f'mechanism {name!r} is not known; known are {", ".join(all_mechanisms())}'
        ) from None
