"""ROS parameters from settings records: declared, described, ranged, and refused in a sentence.

A field of a settings dataclass becomes a parameter of the same name, described by the comment
that stands behind the field in its source. Ranges are the settings' own: what their constructor
refuses is refused here. Settings are read once, when the node starts: a stage does not change
its mind in the middle of a stream.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import threading
from functools import cache
from typing import Any, TypeVar, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

from impactscope.errors import ConfigurationError

__all__ = ['declare', 'declare_settings', 'field_comments', 'refuse_unknown']

T = TypeVar('T')

_PARSING = threading.Lock()  # Python's parser is not safe in several threads

_NOT_OURS = ('use_sim_time', 'qos_overrides.', 'start_type_description_service')


def declare(
    node: Node,
    name: str,
    default: Any,
    doc: str,
    *,
    low: float | None = None,
    high: float | None = None,
) -> Any:
    """Declare one parameter and return its value; raises ConfigurationError where it is refused.

    A tuple of strings is an array; an empty one is written as [''] since ROS cannot tell the
    type of an empty array.
    """
    descriptor = ParameterDescriptor(name=name, description=doc, read_only=True)
    if isinstance(default, float) and low is not None:
        descriptor.floating_point_range = [
            FloatingPointRange(
                from_value=float(low), to_value=float(1e300 if high is None else high)
            )
        ]
    elif isinstance(default, int) and not isinstance(default, bool) and low is not None:
        descriptor.integer_range = [
            IntegerRange(from_value=int(low), to_value=int(2**62 if high is None else high))
        ]
    value = default
    if isinstance(default, tuple):
        value = list(default) or ['']
    try:
        given = node.declare_parameter(name, value, descriptor).value
    except InvalidParameterTypeException as error:
        override = node._parameter_overrides[name].value
        if isinstance(default, float) and isinstance(override, int):
            raise ConfigurationError(
                f'{node.get_name()}: parameter {name} is {override}; '
                f'a number with a decimal point is needed, such as {float(override)}'
            ) from error
        raise ConfigurationError(
            f'{node.get_name()}: parameter {name} is {override!r}; '
            f'a {type(default).__name__} is needed ({doc})'
        ) from error
    except InvalidParameterValueException as error:
        override = node._parameter_overrides[name].value
        raise ConfigurationError(
            f'{node.get_name()}: parameter {name} is {override!r}; it must lie between {low} and '
            f'{"any" if high is None else high} ({doc})'
        ) from error
    if isinstance(default, tuple):
        return tuple(item for item in given if item != '')
    return given


def declare_settings(node: Node, kind: type[T], *, prefix: str = '', **defaults: Any) -> T:
    """Declare a parameter for each field of a settings dataclass and build it from their values.

    ``defaults`` are for fields that have none of their own.
    """
    comments = field_comments(cast('Any', kind))
    values: dict[str, Any] = {}
    for item in dataclasses.fields(kind):  # type: ignore[arg-type]
        default = defaults.get(item.name, item.default)
        factory: Any = item.default_factory
        if default is dataclasses.MISSING and factory is not dataclasses.MISSING:
            default = factory()
        doc = comments.get(item.name, item.name.replace('_', ' '))
        values[item.name] = declare(node, prefix + item.name, default, doc)
    return kind(**values)


@cache
def field_comments(kind: type[Any]) -> dict[str, str]:
    """The comment behind each field in the source of a dataclass; empty where there is none."""
    try:
        with _PARSING:
            source = inspect.getsource(kind)
    except OSError:  # installed without sources
        return {}
    return dict(re.findall(r'^    (\w+): [^#\n]*#\s*(.+)$', source, flags=re.MULTILINE))


def refuse_unknown(node: Node) -> None:
    """Raise ConfigurationError where a parameter was given that the node does not have."""
    given = {name for name in node._parameter_overrides if not name.startswith(_NOT_OURS)}
    unknown = sorted(name for name in given if not node.has_parameter(name))
    if unknown:
        known = sorted(name for name in node._parameters if not name.startswith(_NOT_OURS))
        raise ConfigurationError(
            f'{node.get_name()}: unknown parameter {", ".join(unknown)}; '
            f'known are {", ".join(known) or "none"}'
        )
