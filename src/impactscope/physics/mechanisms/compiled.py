"""How the laws of mechanisms and the twin are compiled."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

__all__ = ['compiled']

_Function = TypeVar('_Function', bound=Callable[..., Any])


@functools.cache
def _stamp() -> tuple[float, int]:
    """Newest change and total size of all sources that are compiled together."""
    physics = Path(__file__).resolve().parent.parent
    stats = [f.stat() for part in ('mechanisms', 'twin') for f in (physics / part).glob('*.py')]
    return max(s.st_mtime for s in stats), sum(s.st_size for s in stats)


def compiled(function: _Function) -> _Function:
    """Compile a function at its first call and keep the machine code on disk.

    numba's cache looks at the function's own file only, so that a changed law in one file would
    leave stale machine code in the callers of another: here the cache is renewed as soon as any
    file of mechanisms or twin changes.
    """
    dispatcher = njit(cache=True, error_model='numpy')(function)
    with contextlib.suppress(AttributeError):  # internals of numba; without them, as numba does
        dispatcher._cache._cache_file._source_stamp = _stamp()
    return cast('_Function', dispatcher)
