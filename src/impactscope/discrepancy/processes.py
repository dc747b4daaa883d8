"""Independent large pieces of work in processes: what is not compiled has to wait in threads.

A search holds the interpreter's lock about half of the time: one that takes 114 s took 100 s with
two threads and takes 75 s with two processes. These are forked for each call, so they have
everything as it is here, and are gone when it returns. Only results are sent back. What both sides
have is sent as its number, so that a result refers to the objects that are here and not to copies.
All processes of a search share the cores that are idle: whoever has work that can be divided takes
what there is, also within a piece of other work.
"""

from __future__ import annotations

import contextlib
import contextvars
import ctypes
import functools
import gc
import io
import os
import pickle
import select
import signal
import struct
import sys
import time
import types
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

from impactscope.discrepancy.parallel import as_worker, in_parallel, is_worker, workers
from impactscope.discrepancy.time_limit import leave_out, left_out

__all__ = ['in_processes']

_Item = TypeVar('_Item')
_Result = TypeVar('_Result')

_WORTH = 0.15  # s of one process, below which another costs more than it saves
_MOST = 8192  # items whose numbers a pipe can hold
_LOST = 0.5  # s, after which a core that is not given back was a helper's that was killed
_NUMBER = struct.Struct('=i')
_OURS = 'impactscope.'  # modules whose objects are looked into
_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)
_ABLE = sys.platform == 'linux'  # elsewhere libraries may not survive a fork
_ATOMS = frozenset((type(None), bool, int, float, complex, str, bytes))
_seconds: dict[object, float] = {}  # of a piece, the last time, by the code of its work


def in_processes(work: Callable[[_Item], _Result], items: Sequence[_Item]) -> list[_Result]:
    """``work`` done on each item, in processes where there are cores; results in their order.

    What ``work`` changes of what it was given may be lost: it returns all that is of use. An
    error of any item is raised. Where pieces of this work are small or no process can be forked,
    all is done as in :func:`.parallel.in_parallel`; and what a process could not send back, here.
    Within a piece of work it is the same again, on cores that nothing else has: one piece that
    takes far longer than the others does not leave them idle.
    """
    idle = _idle.get()
    able = idle is not None or (workers() > 1 and not is_worker())
    if len(items) < 2 or not able or len(items) > _MOST or not _ABLE:
        return in_parallel(work, items)
    code, spent = _code(work), []

    def timed(item: _Item) -> _Result:
        begun = time.monotonic()
        result = work(item)
        spent.append(time.monotonic() - begun)
        return result

    if _seconds.get(code, _WORTH) * len(items) < _WORTH:
        done = in_parallel(timed, items)
    elif idle is not None:
        done = _divided(timed, items, idle)
    else:
        with _idle_cores(workers() - 1) as others:
            done = _divided(timed, items, others)
    if spent:  # of the pieces that were done here
        _seconds[code] = sum(spent) / len(spent)
    return done


def _code(work: Callable[..., Any]) -> object:
    """What tells work apart that is written in different places."""
    while isinstance(work, functools.partial):
        work = work.func
    work = getattr(work, '__func__', work)
    return getattr(work, '__code__', type(work))


class _Idle:
    """Cores that nothing works on, seen by all processes of a search: a byte each in a pipe."""

    def __init__(self, cores: int) -> None:
        self.waiting, self.free = os.pipe()
        os.set_blocking(self.waiting, False)
        self.owed = 0  # cores on which this process went on without
        os.write(self.free, bytes(cores))

    def take(self, within: float = 0.0) -> bool:
        """Whether there is one within so many s; it is this process's now."""
        until = time.monotonic() + within
        while _any(self.waiting, max(0.0, until - time.monotonic())):
            with contextlib.suppress(BlockingIOError):  # another process was quicker
                return bool(os.read(self.waiting, 1))
        return False

    def give(self) -> None:
        """One is free again."""
        if self.owed:
            self.owed -= 1
        else:
            os.write(self.free, bytes(1))

    @contextlib.contextmanager
    def meanwhile(self) -> Iterator[None]:
        """Another process may have this one's core while it waits."""
        self.give()
        try:
            yield
        finally:
            self.owed += not self.take(_LOST)

    def close(self) -> None:
        """Nobody needs it any more."""
        os.close(self.waiting)
        os.close(self.free)


_idle: contextvars.ContextVar[_Idle | None] = contextvars.ContextVar('idle_cores', default=None)


@contextlib.contextmanager
def _idle_cores(many: int) -> Iterator[_Idle]:
    """Within this context work may be divided among so many cores beside this process's."""
    cores = _Idle(many)
    token = _idle.set(cores)
    try:
        yield cores
    finally:
        _idle.reset(token)
        cores.close()


def _divided(
    work: Callable[[_Item], _Result], items: Sequence[_Item], idle: _Idle
) -> list[_Result]:
    """``work`` on items that this process and its helpers take one by one."""
    numbers, feed = os.pipe()
    os.write(feed, b''.join(map(_NUMBER.pack, range(len(items)))))
    os.close(feed)
    os.set_blocking(numbers, False)  # who finds it empty does not wait for more
    done: dict[int, _Result] = {}
    with contextlib.ExitStack() as ends:
        ends.callback(os.close, numbers)
        shared = functools.cache(lambda: _Shared((work, items)))
        begun: list[int] = []

        def ask(left: int) -> None:
            """Begin a helper on each idle core, where so many items are left for it and for us."""
            while left > 1 and _any(numbers) and idle.take():
                try:
                    pid, results = _helper(work, items, numbers, shared(), idle)
                except OSError:  # no room for a further process
                    idle.give()
                    return
                ends.callback(_end, pid, results)
                begun.append(results)
                left -= 1

        ask(len(items))
        for i, result in _worked(work, items, numbers):
            done[i] = result
            ask(len(items) - 1 - i)
        with idle.meanwhile() if begun else contextlib.nullcontext():
            for results in begun:
                sent, steps = _received(results)
                done.update((i, shared().unpacked(one)) for i, one in sent.items())
                leave_out(steps)
    left = [i for i in range(len(items)) if i not in done]
    done.update((i, as_worker(work, items[i])) for i in left)
    return [done[i] for i in range(len(items))]


def _worked(
    work: Callable[[_Item], _Result], items: Sequence[_Item], numbers: int
) -> Iterator[tuple[int, _Result]]:
    while number := _taken(numbers):
        (i,) = _NUMBER.unpack(number)
        yield i, as_worker(work, items[i])


def _taken(numbers: int) -> bytes:
    """The number of an item that nobody else takes; nothing where none is left."""
    with contextlib.suppress(BlockingIOError):
        return os.read(numbers, _NUMBER.size)
    return b''


def _any(pipe: int, within: float = 0.0) -> bool:
    """Whether anything is in a pipe, or comes within so many s."""
    poll = select.poll()
    poll.register(pipe, select.POLLIN)
    return any(event & select.POLLIN for _, event in poll.poll(1e3 * within))


def _helper(
    work: Callable[[Any], Any], items: Sequence[Any], numbers: int, shared: _Shared, idle: _Idle
) -> tuple[int, int]:
    """A process that takes items until none is left; its number, and where its results come."""
    results, sending = os.pipe()
    asking = os.getpid()
    try:
        with warnings.catch_warnings():
            # other threads may hold locks for ever in there: it computes, and needs none of theirs
            warnings.simplefilter('ignore', DeprecationWarning)
            pid = os.fork()
    except OSError:
        os.close(results)
        os.close(sending)
        raise
    if pid == 0:
        try:
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # the asking process tells
            _end_with(asking)
            gc.freeze()  # a look at what is here would copy all of it
            idle.owed = 0
            _send(work, items, numbers, shared, idle, sending)
        finally:
            os._exit(0)
    os.close(sending)
    return pid, results


def _end_with(asking: int) -> None:
    """This process ends when the one that asked for it does, which may itself be a helper."""
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != asking:  # it has ended before
        os._exit(0)


def _send(
    work: Callable[[Any], Any],
    items: Sequence[Any],
    numbers: int,
    shared: _Shared,
    idle: _Idle,
    sending: int,
) -> None:
    """Do and send what can be done and sent; the asking process does the rest, and its errors."""
    sent: dict[int, bytes] = {}

    def attempted(item: Any) -> bytes | None:
        with contextlib.suppress(Exception):
            return shared.packed(work(item))
        return None

    sent.update((i, p) for i, p in _worked(attempted, items, numbers) if p is not None)
    idle.give()  # the asking process may be at work for long before it takes what is sent
    with os.fdopen(sending, 'wb') as file:
        pickle.dump((sent, left_out()), file, pickle.HIGHEST_PROTOCOL)


def _received(results: int) -> tuple[dict[int, bytes], tuple[str, ...]]:
    """What a helper has sent, and steps that it had no time for; nothing where it ended before."""
    with os.fdopen(results, 'rb', closefd=False) as file:
        try:
            sent, steps = pickle.load(file)  # noqa: S301 - of a process forked from this one
        except (EOFError, pickle.UnpicklingError):
            return {}, ()
    return sent, steps


def _end(pid: int, results: int) -> None:
    """A helper is not needed any more."""
    os.close(results)
    with contextlib.suppress(ChildProcessError):  # waited for by somebody else
        if os.waitpid(pid, os.WNOHANG) == (0, 0):
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)


class _Shared:
    """Objects that both sides have, by their numbers."""

    def __init__(self, root: object) -> None:
        self.objects = list(_reached(root))
        self.numbers = {id(o): n for n, o in enumerate(self.objects)}

    def packed(self, result: object) -> bytes:
        """A result as it is sent; what both sides have as its number."""
        file = io.BytesIO()
        _Packer(file, self.numbers).dump(result)
        return file.getvalue()

    def unpacked(self, sent: bytes) -> Any:
        """A result as it was sent, of the objects that are here."""
        return _Unpacker(io.BytesIO(sent), self.objects).load()


class _Packer(pickle.Pickler):
    def __init__(self, file: io.BytesIO, numbers: Mapping[int, int]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.numbers = numbers

    def persistent_id(self, obj: object) -> int | None:
        return self.numbers.get(id(obj))


class _Unpacker(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, objects: Sequence[object]) -> None:
        super().__init__(file)
        self.objects = objects

    def persistent_load(self, pid: int) -> object:
        return self.objects[pid]


def _reached(root: object) -> Iterator[object]:
    """Objects that are reached from one, each once; not what is sent by its value anyway."""
    seen, waiting = {id(root)}, [root]
    while waiting:
        one = waiting.pop()
        yield one
        for part in _parts(one):
            if type(part) not in _ATOMS and id(part) not in seen:
                seen.add(id(part))
                waiting.append(part)


def _parts(one: object) -> Iterable[object]:
    """What an object refers to, where it is a container or one of this project's."""
    if isinstance(one, dict | types.MappingProxyType):
        return [*one.keys(), *one.values()]
    if isinstance(one, list | tuple | set | frozenset):
        return one
    if isinstance(one, types.FunctionType):
        return _enclosed(one)
    if isinstance(one, types.MethodType):
        return one.__self__, one.__func__
    if isinstance(one, functools.partial):
        return one.func, one.args, one.keywords
    if type(one).__module__.startswith(_OURS):
        return _attributes(one)
    return ()


def _enclosed(function: types.FunctionType) -> list[object]:
    parts = []
    for cell in function.__closure__ or ():
        with contextlib.suppress(ValueError):  # not filled yet
            parts.append(cell.cell_contents)
    return parts


def _attributes(one: object) -> list[object]:
    parts = list(getattr(one, '__dict__', {}).values())
    slots = (name for kind in type(one).__mro__ for name in getattr(kind, '__slots__', ()))
    absent = object()
    values = (getattr(one, name, absent) for name in slots)
    return [*parts, *(v for v in values if v is not absent)]
