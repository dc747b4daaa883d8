"""The bench that a fit simulates."""

from __future__ import annotations

import math

import numpy as np
import pytest

from impactscope.discrepancy.impact.data import blows
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.models.bench_model import ActiveEffect
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.simulate import solve


@pytest.mark.parametrize(('relaxes', 'simulated'), [(1e-6, 5e-5), (2e-3, 2e-3), (4.0, 4.0)])
def test_a_branch_quicker_than_samples_is_damping(make_campaign, relaxes, simulated):
    campaign = make_campaign(41)
    model = baseline_model(campaign, prepare(campaign))
    values = {**model.values(model.start()), 'damper.branches.0.damping': 20.0}
    values['damper.branches.0.stiffness'] = 20.0 / relaxes
    blow = next(i for i in model.data.fitted if model.data.blows[i].recording.kind != 'tap')
    par = model.parameters(values, blow)
    assert par[at.BRANCH + 1] == 20.0
    assert par[at.BRANCH + 1] / par[at.BRANCH] == pytest.approx(simulated, rel=1e-4)
    times = model.data.blows[blow].times
    steps = solve(par, times[times < times[0] + 0.5] - times[0], lean=True)[3]
    assert steps < 20_000  # 0.5 s


def test_a_large_campaign_has_longer_bins_late(make_campaign, monkeypatch):
    campaign = make_campaign(41)
    fine = prepare(campaign)
    monkeypatch.setattr(blows, '_MANY_BINS', 1000)
    monkeypatch.setattr(blows, '_COARSER', 0.1)
    coarse = prepare(campaign)
    assert coarse.notes == fine.notes
    for one, other in zip(fine.blows, coarse.blows, strict=True):
        for name, channel in one.channels.items():
            later = other.channels[name]
            early = channel.centres < one.onset + 0.09
            assert math.isclose(later.centres[early.sum() - 1], channel.centres[early][-1])
            assert later.centres.size <= channel.centres.size
    assert sum(c.centres.size for b in coarse.blows for c in b.channels.values()) < sum(
        c.centres.size for b in fine.blows for c in b.channels.values()
    )


@pytest.mark.parametrize('filtered', [False, True])
def test_a_shorter_window_has_the_same_residuals(make_campaign, filtered):
    campaign = make_campaign(41)
    model = baseline_model(campaign, prepare(campaign))
    if filtered:  # which is given samples beyond what is simulated
        numbers = {'low_pass_filter:force.order': 2.0, 'low_pass_filter:force.cutoff': 400.0}
        effect = ActiveEffect('low_pass_filter', 'force')
        model = model.extended(effects=(effect,), constants=numbers)
    values = model.values(model.start())
    blow = next(i for i in model.data.fitted if model.data.blows[i].recording.kind != 'tap')
    whole, part = model.layout([blow]), model.layout([blow], 0.03)
    simulated = model.predict(values, blow, part.ends[blow])
    assert len(simulated.rows) < len(model.predict(values, blow).rows)
    all_of_it = model.blow_residuals(values, blow, whole)
    first = model.blow_residuals(values, blow, part)
    for name in model.data.blows[blow].channels:
        span, early = whole.spans[blow, name], part.spans[blow, name]
        count = early.stop - early.start
        assert count > 20
        np.testing.assert_allclose(
            first[early], all_of_it[span.start : span.start + count], atol=1e-4
        )
