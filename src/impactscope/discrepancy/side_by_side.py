"""Simulations of several recordings at once: compiled code runs beside other threads."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

__all__ = ['side_by_side']

_Item = TypeVar('_Item')
_Result = TypeVar('_Result')

_MOST = 4  # threads: what is not compiled has to wait for its turn


@functools.cache
def _pool() -> ThreadPoolExecutor | None:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()
    if (cores or 1) < 2:
        return None
    return ThreadPoolExecutor(min(cores or 1, _MOST), thread_name_prefix='impactscope')


def side_by_side(work: Callable[[_Item], _Result], items: Sequence[_Item]) -> list[_Result]:
    """``work`` done on each item, in threads where there are cores; results in their order.

    What one item needs, no other may change. An error of any item is raised.
    """
    pool = _pool() if len(items) > 1 else None
    return [work(item) for item in items] if pool is None else list(pool.map(work, items))
