"""Independent pieces of work in threads: compiled code runs beside other threads."""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

__all__ = ['in_parallel']

_Item = TypeVar('_Item')
_Result = TypeVar('_Result')

_MOST = 4  # threads: what is not compiled has to wait for its turn
_here = threading.local()


def _begin() -> None:
    _here.is_worker = True


@functools.cache
def _pool() -> ThreadPoolExecutor | None:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()
    if (cores or 1) < 2:
        return None
    return ThreadPoolExecutor(min(cores or 1, _MOST), 'impactscope', _begin)


def in_parallel(work: Callable[[_Item], _Result], items: Sequence[_Item]) -> list[_Result]:
    """``work`` done on each item, in threads where there are cores; results in their order.

    What one item needs, no other may change. An error of any item is raised. Within such a piece
    of work everything is done in its own thread: the largest pieces are worth the most.
    """
    alone = len(items) < 2 or getattr(_here, 'is_worker', False)
    pool = None if alone else _pool()
    return [work(item) for item in items] if pool is None else list(pool.map(work, items))
