"""Keep the linear algebra library to one thread.

The matrices of a fit are tall and narrow: threads that wait for each other cost several times
what they save, above all where other processes share the machine.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

__all__ = ['single_threaded']

_PREFIXES = ('scipy_openblas', 'openblas')
_SUFFIXES = ('64_', '')


def _libraries() -> list[Any]:
    """OpenBLAS as this process has loaded it, perhaps more than once; none elsewhere."""
    found = []
    with contextlib.suppress(OSError):
        maps = Path('/proc/self/maps').read_text(encoding='utf-8').splitlines()
        paths = {line.split(None, 5)[-1] for line in maps if 'openblas' in line}
        found = [ctypes.CDLL(path) for path in sorted(paths)]
    return found


def _function(library: Any, name: str) -> Callable[..., int] | None:
    for prefix in _PREFIXES:
        for suffix in _SUFFIXES:
            function = getattr(library, f'{prefix}_{name}{suffix}', None)
            if function is not None:
                return function  # type: ignore[no-any-return]
    return None


@contextlib.contextmanager
def single_threaded() -> Iterator[None]:
    """Within this context OpenBLAS works in one thread; other libraries are left alone."""
    restore = []
    for library in _libraries():
        count, limit = _function(library, 'get_num_threads'), _function(library, 'set_num_threads')
        if count is not None and limit is not None:
            restore.append((limit, count()))
            limit(1)
    try:
        yield
    finally:
        for limit, threads in restore:
            limit(threads)
