"""How the laws of these packages are compiled; all that call each other stand in one file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

__all__ = ['compiled', 'law']

_Function = TypeVar('_Function', bound=Callable[..., Any])


def compiled(function: _Function) -> _Function:
    """Compile at the first call and keep the machine code on disk; other threads run beside it.

    numba renews it when the function's own file changes, so a law and its callers must share one.
    """
    return cast('_Function', njit(cache=True, nogil=True, error_model='numpy')(function))


def law(function: _Function) -> _Function:
    """As :func:`compiled`, for a small law: its code becomes part of each caller's."""
    return cast('_Function', njit(cache=True, error_model='numpy', forceinline=True)(function))
