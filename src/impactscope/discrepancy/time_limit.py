"""How long an answer may take: what is left out once the time is over, and that it is told.

A search has a part that every answer needs and a part that only looks whether something else
explains the recordings, too. The second asks :func:`time_left` before each of its steps.
"""

from __future__ import annotations

import contextlib
import contextvars
import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

__all__ = [
    'WITHIN_S',
    'TimeLimit',
    'leave_out',
    'left_out',
    'share_of_time',
    'time_left',
    'time_limited',
]

WITHIN_S = 240.0
"""Time in which an answer is wanted where nobody says otherwise, s."""

_SEARCHED = 0.7  # of the time; the rest is for judging what was found, and for writing it down


@dataclass(eq=False)
class TimeLimit:
    """Time that a search may take, and what it left out when that was over.

    Args:
        seconds: in which an answer is wanted.
        clock: in s; only differences count.
    """

    seconds: float = math.inf
    clock: Callable[[], float] = time.monotonic
    left_out: dict[str, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._end = self.clock() + _SEARCHED * self.seconds

    def time_left(self, step: str) -> bool:
        """Whether there is time for a step that an answer can do without; else it is noted."""
        if self.clock() < self._end:
            return True
        self.left_out[step] = None
        return False

    def part(self, share: float) -> TimeLimit:
        """A share, 0 to 1, of the time that is left now; what it leaves out is left out here."""
        now = self.clock()
        part = TimeLimit(self.seconds, self.clock, self.left_out)
        part._end = now + share * max(self._end - now, 0.0)
        return part

    @property
    def told(self) -> tuple[str, ...]:
        """What was left out, in a sentence; none where nothing was."""
        if not self.left_out:
            return ()
        return (
            f'The search was ended so as to answer within about {self.seconds:g} s. Left out: '
            f'{", ".join(self.left_out)}. With more time the answer may be another.',
        )


_current: contextvars.ContextVar[TimeLimit | None] = contextvars.ContextVar(
    'time_limit', default=None
)


@contextlib.contextmanager
def time_limited(
    seconds: float, clock: Callable[[], float] = time.monotonic
) -> Iterator[TimeLimit]:
    """Within this context :func:`time_left` goes by ``seconds`` from its beginning on."""
    limit = TimeLimit(seconds, clock)
    token = _current.set(limit)
    try:
        yield limit
    finally:
        _current.reset(token)


@contextlib.contextmanager
def share_of_time(share: float) -> Iterator[None]:
    """Within this context :func:`time_left` goes by a share of the time that is left now."""
    limit = _current.get()
    token = _current.set(limit and limit.part(share))
    try:
        yield
    finally:
        _current.reset(token)


def time_left(step: str) -> bool:
    """Whether there is time for a step that an answer can do without; always where none is set."""
    limit = _current.get()
    return limit is None or limit.time_left(step)


def left_out() -> tuple[str, ...]:
    """The steps that were left out until now."""
    limit = _current.get()
    return tuple(limit.left_out) if limit is not None else ()


def leave_out(steps: Iterable[str]) -> None:
    """Note steps that another process has left out."""
    limit = _current.get()
    if limit is not None:
        limit.left_out.update(dict.fromkeys(steps))
