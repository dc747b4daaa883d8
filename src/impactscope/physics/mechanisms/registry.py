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
from impactscope.physics.twin import layout as at

__all__ = ['all_mechanisms', 'mechanism', 'own_places']


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


@functools.cache
def own_places() -> Mapping[str, int]:
    """Place of the first own parameter of each mechanism that brings a term."""
    names = [n for n, m in all_mechanisms().items() if m.guide_term or m.contact_term]
    wide = [n for n in names if len(all_mechanisms()[n].parameters) > at.OWN_WIDTH]
    if wide or len(names) > at.MAX_OWN:
        raise ConfigurationError(
            f'mechanisms with terms of their own: {len(names)} of at most {at.MAX_OWN}, '
            f'each with at most {at.OWN_WIDTH} parameters; too wide: {wide!r}'
        )
    return MappingProxyType({n: at.OWN + at.OWN_WIDTH * i for i, n in enumerate(names)})


def mechanism(name: str) -> Mechanism:
    """The mechanism of that name; raises ConfigurationError naming the known ones."""
    try:
        return all_mechanisms()[name]
    except KeyError:
        raise ConfigurationError(
            f'mechanism {name!r} is not known; known are {", ".join(all_mechanisms())}'
        ) from None
