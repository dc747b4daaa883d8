"""Large pieces of work in processes: what comes back, and what is done here after all."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from impactscope.discrepancy import processes
from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.search.screening import Remembered
from impactscope.discrepancy.parallel import THREADS, in_parallel
from impactscope.discrepancy.processes import in_processes
from impactscope.discrepancy.time_limit import time_left, time_limited
from impactscope.errors import ImpactscopeError
from impactscope.physics.twin.assembly import Effect

LONG = 0.05  # s, of a piece that another process is worth


@pytest.fixture(autouse=True)
def two_processes(monkeypatch):
    monkeypatch.setenv(THREADS, '2')
    monkeypatch.setattr(processes, '_seconds', {})


def longer(seconds: float = LONG) -> int:
    time.sleep(seconds)
    return os.getpid()


def test_pieces_are_done_in_this_process_and_another_one(tmp_path):
    def meets_another(_: int) -> int:
        (tmp_path / str(os.getpid())).touch()
        until = time.monotonic() + 20.0
        while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < until:
            time.sleep(0.005)
        return os.getpid()

    done_by = in_processes(meets_another, range(6))
    assert len(set(done_by)) == 2
    assert os.getpid() in done_by


def test_no_process_is_left():
    in_processes(lambda _: longer(), range(4))
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)


@pytest.mark.parametrize('many', [0, 1, 2, 7, 40])
def test_results_come_in_the_order_of_the_items(many):
    def work(i: int) -> int:
        time.sleep(0.02 if i == 0 else 0.002)
        return i * i

    assert in_processes(work, range(many)) == [i * i for i in range(many)]


def test_one_thread_means_one_process(monkeypatch):
    monkeypatch.setenv(THREADS, '1')
    assert set(in_processes(lambda _: longer(0.001), range(4))) == {os.getpid()}


def test_a_core_may_come_free_again_and_again(monkeypatch):
    """A helper that finds nothing to do ends at once; another may be begun after every piece."""
    known = processes._any
    monkeypatch.setattr(processes, '_any', lambda pipe, *s: known(pipe, *s) if s else True)
    assert in_processes(lambda i: longer(0.01) and i, range(12)) == list(range(12))
    short_last = (0.3, *[0.001] * 8)
    assert in_processes(lambda s: longer(s) and s, short_last) == list(short_last)


@pytest.mark.parametrize(('seconds', 'divided'), [(0.001, False), (0.1, True)])
def test_pieces_are_worth_a_process_by_what_they_took_the_last_time(monkeypatch, seconds, divided):
    def work(_: int) -> int:
        return os.getpid()

    asked = []
    monkeypatch.setattr(
        processes, '_divided', lambda f, items, _: asked.append(list(map(f, items)))
    )
    monkeypatch.setitem(processes._seconds, work.__code__, seconds)
    in_processes(work, range(4))
    assert bool(asked) is divided
    assert processes._seconds[work.__code__] != seconds  # but what it took now


def test_what_both_sides_have_is_the_same_object_here():
    @dataclass(eq=False)
    class Whole:
        array: np.ndarray
        parts: list[object] = field(default_factory=list)

    Whole.__module__ = 'impactscope.test'  # one of this project's
    whole = Whole(np.arange(5.0), [object(), {'deep': np.zeros(2)}])

    def work(i: int) -> tuple[object, ...]:
        longer()
        return whole, whole.array, whole.parts[1]['deep'], np.full(3, float(i))

    results = in_processes(work, range(4))
    for i, (it, array, deep, new) in enumerate(results):
        assert it is whole
        assert array is whole.array
        assert deep is whole.parts[1]['deep']
        np.testing.assert_array_equal(new, np.full(3, float(i)))


def test_objects_that_a_result_has_twice_are_one_object_here():
    def work(i: int) -> list[np.ndarray]:
        longer()
        new = np.full(3, float(i))
        return [new, new]

    assert all(one is other for one, other in in_processes(work, range(4)))


def test_an_error_of_any_piece_is_raised():
    def work(i: int) -> int:
        longer()
        if i == 3:
            raise ImpactscopeError('the fourth')
        return i

    with pytest.raises(ImpactscopeError, match='the fourth'):
        in_processes(work, range(5))
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)


def test_what_cannot_be_sent_is_done_here():
    def work(i: int):
        longer()
        return lambda: (i, os.getpid())

    assert [f() for f in in_processes(work, range(4))] == [(i, os.getpid()) for i in range(4)]


def test_what_a_process_that_was_killed_has_not_sent_is_done_here():
    here = os.getpid()

    def work(i: int) -> int:
        longer()
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return i

    assert in_processes(work, range(6)) == list(range(6))


def test_without_room_for_a_process_all_is_done_here(monkeypatch):
    def none_left() -> int:
        raise BlockingIOError

    monkeypatch.setattr(processes.os, 'fork', none_left)
    assert set(in_processes(lambda _: longer(), range(4))) == {os.getpid()}


def test_threads_have_none_of_their_own():
    def outer(_: int) -> bool:
        longer()
        return set(in_parallel(lambda _: longer(0.001), range(4))) == {os.getpid()}

    assert all(in_processes(outer, range(4)))


@pytest.mark.parametrize('long_one', [0, 1])
def test_a_core_with_nothing_left_to_do_helps_within_a_long_piece(tmp_path, long_one):
    """Whoever has the long piece, this process or the other one."""

    def outer(i: int) -> set[int]:
        (tmp_path / str(i)).touch()
        until = time.monotonic() + 20.0
        while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < until:
            time.sleep(0.005)
        return set(in_processes(lambda _: longer(), range(40))) if i == long_one else set()

    assert len(in_processes(outer, range(2))[long_one]) == 2


def test_no_more_processes_are_at_work_than_cores(tmp_path, monkeypatch):
    monkeypatch.setenv(THREADS, '3')

    def at_work(_: int) -> int:
        mine = tmp_path / f'{os.getpid()}.{time.monotonic_ns()}'
        mine.touch()
        longer(0.03)
        many = len(list(tmp_path.iterdir()))
        mine.unlink()
        return many

    def outer(i: int) -> int:
        return max(in_processes(at_work, range(2 + 6 * (i % 3))))

    for _ in range(2):
        assert 1 < max(in_processes(outer, range(7))) <= 3


def test_helpers_of_helpers_end_with_them(tmp_path):
    """An error here: nobody asks any more for what they are at."""
    here = os.getpid()

    def endless(_: int) -> None:
        (tmp_path / str(os.getpid())).touch()
        time.sleep(60.0)

    def outer(_: int) -> None:
        if os.getpid() == here:
            until = time.monotonic() + 20.0
            while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < until:
                time.sleep(0.005)
            raise ImpactscopeError('this one')
        in_processes(endless, range(3))

    with pytest.raises(ImpactscopeError, match='this one'), processes._idle_cores(2) as idle:
        processes._divided(outer, range(2), idle)
    begun = [int(f.name) for f in tmp_path.iterdir()]
    assert len(begun) == 2
    until = time.monotonic() + 20.0
    while any(running(pid) for pid in begun) and time.monotonic() < until:
        time.sleep(0.005)
    assert not any(running(pid) for pid in begun)


def running(pid: int) -> bool:
    """Whether there is such a process, and no more than its entry."""
    try:
        state = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
    except FileNotFoundError:
        return False
    return state != 'Z'


def test_what_was_learnt_of_a_candidate_is_taken_over():
    place, start = ('friction', (('force', 0.1),)), {'force': 0.2}
    learnt = Remembered({place: start, ('other', ()): {}}, {('friction', 'mass'): (3, 1)})
    known = Remembered({('more', ()): {}})
    known.learn(learnt.about('friction'))
    assert known.weak == {place: start, ('more', ()): {}}
    assert known.ahead == {('friction', 'mass'): (3, 1)}


def test_a_search_sends_all_that_it_finds(make_campaign, monkeypatch, tmp_path):
    """What is not sent is done again: right, and twice as slow."""
    packed = processes._Shared.packed

    def told(shared, result):
        try:
            sent = packed(shared, result)
        except Exception as error:
            (tmp_path / 'not_sent').write_text(repr(error))
            raise
        (tmp_path / 'sent').touch()
        return sent

    monkeypatch.setattr(processes._Shared, 'packed', told)
    campaign = make_campaign(3, [Effect('coulomb_friction', {'force': 0.3})], blows=2)
    assert explain(campaign).accepted
    assert [f.name for f in tmp_path.iterdir()] == ['sent']


@pytest.mark.parametrize('divided', [in_processes, in_parallel])
def test_work_that_is_divided_goes_by_the_time_that_is_left(divided):
    def work(i: int) -> bool:
        longer()
        return time_left(f'step {i}')

    assert all(divided(work, range(4)))  # no limit
    with time_limited(100.0) as limit:
        assert all(divided(work, range(4)))
        assert not limit.left_out
    with time_limited(0.0) as limit:
        assert not any(divided(work, range(4)))
    assert set(limit.left_out) == {f'step {i}' for i in range(4)}
