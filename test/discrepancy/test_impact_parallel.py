"""Work in threads, results that are kept, and residuals by compiled code."""

from __future__ import annotations

import dataclasses
import json
import threading

import numpy as np
import pytest

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.models.result_cache import ResultCache
from impactscope.discrepancy.parallel import THREADS, in_parallel
from impactscope.errors import ConfigurationError
from impactscope.physics.twin.assembly import Effect


@pytest.fixture(autouse=True)
def four_threads(monkeypatch):
    monkeypatch.setenv(THREADS, '4')


def test_the_environment_says_how_many_threads(monkeypatch):
    barrier = threading.Barrier(3)

    def name(_: int) -> str:
        barrier.wait(timeout=20.0)  # three at the same time
        return threading.current_thread().name

    monkeypatch.setenv(THREADS, ' 3 ')
    assert len(set(in_parallel(name, range(3)))) == 3
    monkeypatch.setenv(THREADS, '1')
    here = threading.current_thread().name
    assert set(in_parallel(lambda _: threading.current_thread().name, range(3))) == {here}


@pytest.mark.parametrize('told', ['0', '-2', 'many', '1.5'])
def test_threads_that_are_no_number_are_told(monkeypatch, told):
    monkeypatch.setenv(THREADS, told)
    with pytest.raises(ConfigurationError, match=f'{THREADS} is .{told}'):
        in_parallel(lambda i: i, range(2))


def test_an_answer_is_the_same_with_any_number_of_threads(make_campaign, monkeypatch):
    campaign = make_campaign(3, [Effect('coulomb_friction', {'force': 0.3})], blows=2)
    told = []
    for threads in ('1', '4'):
        monkeypatch.setenv(THREADS, threads)
        answer = explain(campaign)
        assert answer.accepted == ('coulomb_friction',)
        told.append(json.dumps(dataclasses.replace(answer, duration_s=0.0).to_json()))
    assert told[0] == told[1]


def test_results_come_in_the_order_of_the_items():
    assert in_parallel(lambda i: i * i, range(20)) == [i * i for i in range(20)]


def test_work_within_work_stays_in_its_thread():
    def outer(_: int) -> bool:
        inner = in_parallel(lambda _: threading.get_ident(), range(4))
        return set(inner) == {threading.get_ident()}

    assert all(in_parallel(outer, range(8)))


def test_an_error_of_any_piece_of_work_is_raised():
    with pytest.raises(ZeroDivisionError):
        in_parallel(lambda i: 1 / i, [1, 2, 0])


def test_what_was_not_used_for_the_longest_is_not_kept():
    kept: ResultCache[int] = ResultCache(2)
    kept.keep('a', 1)
    kept.keep('b', 2)
    assert kept.get('a') == 1
    kept.keep('c', 3)
    assert kept.get('b') is None
    assert (kept.get('a'), kept.get('c')) == (1, 3)


def test_threads_may_share_what_is_kept():
    kept: ResultCache[int] = ResultCache(3)

    def use(i: int) -> bool:
        for k in range(500):
            kept.keep(k % 7, k % 7)
            if kept.get((k + i) % 7) not in (None, (k + i) % 7):
                return False
        return True

    assert all(in_parallel(use, range(4)))


def test_compiled_residuals_are_those_of_the_means(make_campaign):
    campaign = make_campaign(5)
    model = baseline_model(campaign, prepare(campaign))
    layout = model.layout(model.data.fitted, 0.2)
    values = model.values(model.start())
    for i in layout.blows:
        prediction = model.predict(values, i)
        parts = []
        for name, channel in model.data.blows[i].channels.items():
            mask = layout.masks[i, name]
            residual = (channel.means - prediction.means[name])[mask] / channel.std[mask]
            parts.append(model.whitened(residual, i, name, layout))
        wanted = np.concatenate(parts)
        np.testing.assert_allclose(model.blow_residuals(values, i, layout), wanted, atol=1e-8)
