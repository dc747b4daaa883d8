"""YAML as people and programs write it."""

from __future__ import annotations

import re
from typing import Any

import yaml

__all__ = ['parse_yaml']


class _Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc]
    """The safe loader; that in C is ten times as fast, where it is there."""


# YAML 1.1 takes 1e+03 for text: no point. YAML 1.2 does not, and programs print numbers so
_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$'),
    list('-+.0123456789'),
)


def parse_yaml(text: str) -> Any:
    """What a YAML text says, plain data alone; numbers as YAML 1.2 has them, also ``1e3``.

    Raises yaml.YAMLError where it is none.
    """
    return yaml.load(text, _Loader)  # noqa: S506 - a safe one
