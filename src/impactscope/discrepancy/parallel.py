"""Independent pieces of work in threads: compiled code runs beside other threads."""

from __future__ import annotations

import contextvars
import functools
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from impactscope.errors import ConfigurationError

__all__ = ['THREADS', 'as_worker', 'in_parallel', 'is_worker', 'workers']

THREADS = 'IMPACTSCOPE_THREADS'  # environment variable: threads of one search

_Item = TypeVar('_Item')
_Result = TypeVar('_Result')

_MOST = 4  # threads: what is not compiled has to wait for its turn
_here = threading.local()


def as_worker(work: Callable[[_Item], _Result], item: _Item) -> _Result:
    """``work`` on an item, within which everything is done in this thread, one after another."""
    before = is_worker()
    _here.is_worker = True
    try:
        return work(item)
    finally:
        _here.is_worker = before


def is_worker() -> bool:
    """Whether this thread does a piece of work that is one of several at the same time."""
    return getattr(_here, 'is_worker', False)


def workers() -> int:
    """How many may work at a time: as the environment tells, or a core each, up to four.

    Raises ConfigurationError where it tells no whole number from 1 on.
    """
    told = os.environ.get(THREADS, '').strip()
    if not told:
        return min(_cores(), _MOST)
    if not told.isdecimal() or int(told) < 1:
        message = f'{THREADS} is {told[:20]!r}; threads are a whole number from 1 on'
        raise ConfigurationError(message)
    return int(told)


@functools.cache
def _cores() -> int:
    many = len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()
    return many or 1


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, 'impactscope')


def in_parallel(work: Callable[[_Item], _Result], items: Sequence[_Item]) -> list[_Result]:
    """``work`` done on each item, in threads where there are cores; results in their order.

    Where other programs have the cores, threads wait for each other: ``THREADS`` says how many.
    What one item needs, no other may change. An error of any item is raised. Within such a piece
    of work everything is done in its own thread: the largest pieces are worth the most.
    """
    if len(items) < 2 or is_worker() or workers() < 2:
        return [work(i) for i in items]
    here = contextvars.copy_context()  # with the time that is left
    return list(_pool(workers()).map(lambda i: here.copy().run(as_worker, work, i), items))
