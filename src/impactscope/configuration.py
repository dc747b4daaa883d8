"""Files of configuration: where they lie, and what they say.

A parameter file in the form of ROS 2 serves the nodes and the offline analysis alike, so that
both work with the same numbers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import yaml

from impactscope.comply import LimitSet
from impactscope.errors import ConfigurationError
from impactscope.yaml_text import parse_yaml

__all__ = [
    'bags_folder',
    'config_folder',
    'load_limits',
    'load_yaml',
    'node_parameters',
    'settings_from',
]

T = TypeVar('T')


@cache
def config_folder() -> Path:
    """The folder ``config`` of a checkout, or of the installed package's share."""
    here = Path(__file__).resolve()
    for folder in (
        here.parents[2] / 'config',
        *(parent / 'share' / 'impactscope' / 'config' for parent in Path(__file__).parents),
        *(parent / 'share' / 'impactscope' / 'config' for parent in here.parents),
    ):
        if (folder / 'limits').is_dir():
            return folder
    raise ConfigurationError(f'no folder with configuration files near {here.parent}')


def bags_folder() -> Path:
    """The folder with the recordings that come with the package."""
    return config_folder().parent / 'bags'


def load_yaml(path: Path | str) -> Any:
    """Parse a YAML file; raises ConfigurationError that says where it cannot be read."""
    try:
        return parse_yaml(Path(path).read_text(encoding='utf-8'))
    except OSError as error:
        raise ConfigurationError(f'{path} cannot be read: {error.strerror}') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            f'{path} is not valid YAML: {" ".join(str(error).split())}'
        ) from error


def _find(kind: str, name: str) -> Path:
    path = Path(name)
    if path.suffix in {'.yaml', '.yml'} or path.exists():
        return path
    folder = config_folder() / kind
    path = folder / f'{name}.yaml'
    if not path.is_file():
        known = ', '.join(sorted(item.stem for item in folder.glob('*.yaml')))
        raise ConfigurationError(f'{kind}: {name!r} is neither a file nor one of {known}')
    return path


def load_limits(name: str) -> LimitSet:
    """A limit set by its name in ``config/limits``, or from a file."""
    path = _find('limits', name)
    mapping = load_yaml(path)
    if not isinstance(mapping, Mapping):
        raise ConfigurationError(f'{path} holds no mapping, so no limit set')
    return LimitSet.from_mapping(mapping)


def node_parameters(path: Path | str, node: str) -> dict[str, Any]:
    """What a ROS 2 parameter file says for a node, flat, with dots between levels.

    Keys ``/**``, ``/**/<node>``, ``/<anything>/<node>`` and ``<node>`` apply, in this order.
    """
    content = load_yaml(path)
    if not isinstance(content, Mapping):
        raise ConfigurationError(f'{path} holds no mapping, so no parameters')
    found: dict[str, Any] = {}
    for key, section in _sections(content):
        if key != '/**' and key.rstrip('/').rsplit('/', 1)[-1] != node:
            continue
        found.update(_flat(section))
    return found


def _sections(content: Mapping[str, Any], prefix: str = '') -> list[tuple[str, Mapping[str, Any]]]:
    sections = []
    for key, value in content.items():
        name = f'{prefix}/{str(key).lstrip("/")}' if prefix else str(key)
        if not isinstance(value, Mapping):
            raise ConfigurationError(f'parameter file: {name} holds no ros__parameters')
        if 'ros__parameters' in value:
            sections.append((name, value['ros__parameters'] or {}))
        else:
            sections.extend(_sections(value, name))
    return sorted(sections, key=lambda item: item[0] != '/**')


def _flat(mapping: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            flat.update(_flat(value, f'{prefix}{key}.'))
        else:
            flat[f'{prefix}{key}'] = value
    return flat


def settings_from(
    kind: type[T], parameters: Mapping[str, Any], prefix: str = '', **given: Any
) -> T:
    """A settings dataclass from a node's parameters; names of other settings are passed over.

    ``given`` are fields that do not come from the parameters.

    Raises ConfigurationError for a value of the wrong type or out of range.
    """
    defaults = kind(**given)
    values: dict[str, Any] = dict(given)
    for item in dataclasses.fields(kind):  # type: ignore[arg-type]
        value = parameters.get(prefix + item.name)
        if value is None or item.name in given:
            continue
        default = getattr(defaults, item.name)
        if isinstance(default, tuple) and isinstance(value, list):
            value = tuple(entry for entry in value if entry != '')
        if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not type(default):
            raise ConfigurationError(
                f'parameter {prefix}{item.name} is {value!r}; a {type(default).__name__} is needed'
            )
        values[item.name] = value
    return kind(**values)
