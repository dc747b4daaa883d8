"""Message definitions: the package's own, the standard ones, and those a recording brings.

A recording carries the definition of each of its types as text (``ros2msg``: the ``.msg`` file
and, after separator lines, those it depends on). That text decides how bytes are read, so a
recording made by an older or a newer version still opens.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from impactscope.errors import RecordingError

__all__ = [
    'BLOCK_TYPE',
    'DECODING_ERRORS',
    'PACKAGE',
    'TEST_POINT_TYPE',
    'has_current_layout',
    'reference_store',
    'schema_text',
    'type_known',
    'typestore_for',
]

PACKAGE = 'impactscope'
BLOCK_TYPE = f'{PACKAGE}/msg/SampleBlock'
TEST_POINT_TYPE = f'{PACKAGE}/msg/TestPoint'
_SEPARATOR = '=' * 80

# Whatever generated (de)serialisers and parsers raise on hostile bytes.
DECODING_ERRORS = (
    SerdeError,
    TypesysError,
    struct.error,
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    MemoryError,
    RecursionError,
    SyntaxError,
    TypeError,
    ValueError,
)


def _interface_folders() -> Iterator[Path]:
    here = Path(__file__)
    for start in (here, here.resolve()):
        for parent in start.parents:
            yield parent / 'msg'
            yield parent / 'share' / PACKAGE / 'msg'
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        yield Path(prefix) / 'share' / PACKAGE / 'msg'


@lru_cache(maxsize=1)
def _own_texts() -> dict[str, str]:
    """Text of each of the package's message files, by type name."""
    for folder in _interface_folders():
        if (folder / 'SampleBlock.msg').is_file():
            files = sorted(folder.glob('*.msg'))
            return {f'{PACKAGE}/msg/{f.stem}': f.read_text(encoding='utf-8') for f in files}
    raise RecordingError(
        f'the message definitions of {PACKAGE} are neither beside its source '
        f'nor in share/{PACKAGE}/msg of an installed prefix'
    )


@lru_cache(maxsize=1)
def reference_store() -> Any:
    """A rosbags type store of ROS 2 Jazzy's standard types and the package's own."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in _own_texts().items():
        store.register(get_types_from_msg(text, name))
    return store


def type_known(type_name: str) -> bool:
    """Whether the type is a standard one or one of the package's."""
    return type_name in reference_store().fielddefs


def _dependencies(fields: Any) -> Iterator[str]:
    for _, description in fields:
        while isinstance(description, tuple) and not isinstance(description[1], str):
            if isinstance(description[1][0], str):  # a base type: (name, length)
                break
            description = description[1][0]
        if isinstance(description, tuple) and isinstance(description[1], str):
            yield description[1]


@lru_cache(maxsize=256)
def _closure(type_name: str) -> tuple[str, ...]:
    """The type and all it depends on, each once, in order of first use."""
    definitions = reference_store().fielddefs
    names: list[str] = []
    queue = [type_name]
    while queue:
        name = queue.pop(0)
        if name not in names:
            names.append(name)
            queue.extend(_dependencies(definitions[name][1]))
    return tuple(names)


@lru_cache(maxsize=256)
def schema_text(type_name: str) -> str:
    """The definition as recordings carry it; RecordingError where the type is not known."""
    if not type_known(type_name):
        raise RecordingError(f'no definition of the message type {type_name!r} is known')
    own = _own_texts()
    sections: list[str] = []
    for name in _closure(type_name):
        text = own.get(name)
        if text is None:
            text = reference_store().generate_msgdef(name, ros_version=2)[0]
            text = text.split(_SEPARATOR, 1)[0]
        package, _, short = name.split('/')
        head = f'{_SEPARATOR}\nMSG: {package}/{short}\n' if sections else ''
        sections.append(head + text.rstrip('\n') + '\n')
    return ''.join(sections)


@lru_cache(maxsize=256)
def has_current_layout(text: str, type_name: str) -> bool:
    """Whether a definition's fields equal those known here, so that compiled readers apply.

    Args:
        text: the recording's own definition; empty where it carries none (then it is assumed).
        type_name: for example ``impactscope/msg/SampleBlock``.
    """
    if not type_known(type_name):
        return False
    if not text.strip():
        return True
    try:
        found = get_types_from_msg(text, type_name)
    except DECODING_ERRORS:
        return False
    reference = reference_store().fielddefs
    return all(
        name in found and list(found[name][1]) == list(reference[name][1])
        for name in _closure(type_name)
    )


@lru_cache(maxsize=256)
def typestore_for(text: str, type_name: str) -> Any:
    """A rosbags type store that reads this type as the recording defines it.

    Raises RecordingError where the definition is missing and unknown, or cannot be parsed.
    """
    if not text.strip():
        if type_known(type_name):
            return reference_store()
        raise RecordingError(f'the recording carries no definition of its type {type_name!r}')
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(text, type_name))
    except DECODING_ERRORS as error:
        raise RecordingError(
            f'the recorded definition of {type_name!r} cannot be parsed ({type(error).__name__})'
        ) from error
    if type_name not in store.fielddefs:
        raise RecordingError(f'the recorded definition of {type_name!r} defines another type')
    return store
