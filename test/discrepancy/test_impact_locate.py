"""Regions: where a misfit was put, and nowhere else."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from impactscope.discrepancy.locate import Phase, Strip, band_of, locate, phases, state_of


def strip(residual, time, name='force', explained=0.0):
    """``explained``: by what was found, of the residual."""
    zero = np.zeros_like(time)
    spans = (Phase('loading', -np.inf, 0.2), Phase('separated', 0.2, np.inf))
    return Strip('hit.mcap', name, time, residual, residual - explained, zero, zero, spans)


def test_a_burst_is_found_where_it_is():
    rng = np.random.default_rng(1)
    time = np.arange(4000) / 1e4
    residual = rng.standard_normal(4000)
    inside = (time > 0.25) & (time < 0.3)
    residual[inside] += 3 * np.sin(2 * np.pi * 200 * time[inside])
    regions = locate([strip(residual, time), strip(rng.standard_normal(4000), time, 'b')], 0.01)
    assert regions
    assert {r.channel for r in regions} == {'force'}
    assert min(r.start_s for r in regions) == pytest.approx(0.25, abs=0.026)
    assert max(r.end_s for r in regions) == pytest.approx(0.3, abs=0.026)
    assert {r.phase for r in regions} == {'separated'}
    low, high = regions[0].band_hz
    assert low < 200 < high


def test_a_weak_effect_is_where_the_model_says_that_it_acts():
    rng = np.random.default_rng(3)
    time = np.arange(4000) / 1e4
    inside = (time > 0.25) & (time < 0.3)
    effect = np.where(inside, 0.25 * np.sin(2 * np.pi * 40 * time), 0.0)
    noise = rng.standard_normal(4000)
    assert locate([strip(noise + effect, time)], 0.01) == ()  # no piece stands out
    (region,) = locate([strip(noise + effect, time, explained=effect)], 0.01)
    assert region.start_s == pytest.approx(0.25, abs=0.026)
    assert region.end_s == pytest.approx(0.3, abs=0.026)
    assert region.band_hz[1] < 100.0
    assert region.p_value < 1e-3 < 0.01 < stats.chi2.sf(region.ratio**2 * 500, 500)


def test_a_region_does_not_end_where_its_effect_passes_through_zero():
    time = np.arange(4000) / 1e4
    effect = 5.0 * np.sin(2 * np.pi * 10 * time) ** 3
    regions = locate([strip(effect, time, explained=effect)], 0.01)
    assert {(round(r.start_s, 1), round(r.end_s, 1)) for r in regions} == {(0.0, 0.2), (0.2, 0.4)}


def test_phases_follow_contacts():
    found = phases(0.1, 0.11, [(0.12, False), (0.15, True), (0.16, False)], 0.4)
    assert [p.name for p in found] == [
        'before',
        'onset',
        'loading',
        'unloading',
        'separated',
        'recontact',
        'separated',
    ]
    assert all(a.end == b.start for a, b in itertools.pairwise(found))
    assert found[-1].end == 0.4


def test_a_state_is_named_where_the_residual_goes_with_it():
    rng = np.random.default_rng(2)
    time = np.arange(500) / 1e3
    x, v = np.sin(200 * time), np.cos(200 * time)
    assert 'sign' in state_of(np.sign(v) + 0.2 * rng.standard_normal(500), x, v)
    assert state_of(rng.standard_normal(500), x, v) == ''


def test_a_band_holds_its_line():
    time = np.arange(2000) / 1e4
    low, high = band_of(time, np.sin(2 * np.pi * 300 * time))
    assert low < 300 < high
    assert high - low < 150
