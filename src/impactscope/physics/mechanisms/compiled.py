"""How the laws of mechanisms and the twin are compiled."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ['borrowed', 'chained', 'compiled', 'law']

_Function = TypeVar('_Function', bound=Callable[..., Any])


@functools.cache
def _stamp() -> tuple[float, int]:
    """Newest change and total size of all sources that are compiled together."""
    physics = Path(__file__).resolve().parent.parent
    stats = [f.stat() for part in ('mechanisms', 'twin') for f in (physics / part).glob('*.py')]
    return max(s.st_mtime for s in stats), sum(s.st_size for s in stats)


def _compile(function: _Function, *, inlined: bool) -> _Function:
    dispatcher = njit(cache=True, nogil=True, error_model='numpy', forceinline=inlined)(function)
    with contextlib.suppress(AttributeError):  # internals of numba; without them, as numba does
        dispatcher._cache._cache_file._source_stamp = _stamp()
    return cast('_Function', dispatcher)


def compiled(function: _Function) -> _Function:
    """Compile a function at its first call and keep the machine code on disk.

    numba's cache looks at the function's own file only, so that a changed law in one file would
    leave stale machine code in the callers of another: here the cache is renewed as soon as any
    file of mechanisms or twin changes.
    """
    return _compile(function, inlined=False)


def law(function: _Function) -> _Function:
    """As :func:`compiled`, for a small law: its code becomes part of each caller's."""
    return _compile(function, inlined=True)


@intrinsic  # type: ignore[untyped-decorator]
def borrowed(typing_context: Any, array: Any) -> Any:  # noqa: ARG001
    """The same array without a share in its ownership, inside compiled code.

    Compiled code counts the references to an array with atomic instructions at every call that
    passes it on; in laws of a few operations that is most of the time. A caller has to hold the
    array for as long as the borrowed one is in use: a function may borrow what it was given.
    """

    def generated(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ARG001
        view = context.make_array(array)(context, builder, values[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        return view._getvalue()

    return array(array), generated


Term = Callable[[Any, int, float, float], float]


@law
def _nothing(par: Any, displacement: float, speed: float) -> float:  # noqa: ARG001
    return 0.0


def chained(terms: Iterable[tuple[int, Term]]) -> Callable[[Any, float, float], float]:
    """One compiled function that adds up terms, each with the place of its own parameters."""
    total: Callable[[Any, float, float], float] = _nothing
    for own, term in terms:
        total = _with(total, own, term)
    return total


def _with(
    before: Callable[[Any, float, float], float], own: int, term: Term
) -> Callable[[Any, float, float], float]:
    @law
    def both(par: Any, displacement: float, speed: float) -> float:
        return before(par, displacement, speed) + term(par, own, displacement, speed)

    return both
