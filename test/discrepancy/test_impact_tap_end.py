"""A tap whose end is read too early: its last push is nothing that the bench does."""

from __future__ import annotations

import pytest

from impactscope.discrepancy.impact.data import blows as impact_data
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.tap_end import with_later_cuts
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.bench import HammerTap

TAP = HammerTap(150.0, 0.005)


def baseline(campaign):
    return fit_baseline(baseline_model(campaign, prepare(campaign)))


@pytest.fixture
def cut_early(monkeypatch):
    """Taps end where the hammer still pushes a little."""
    read = impact_data._tap_length
    monkeypatch.setattr(impact_data, '_tap_length', lambda c, onset: read(c, onset) - 3.4e-3)


def test_a_tap_that_was_cut_too_early_is_cut_later(make_campaign, cut_early):
    campaign = make_campaign(4, tap=TAP, rate=5000.0)
    missed = baseline(campaign)
    tap = missed.layout.blow_spans[0]
    before = missed.residuals[tap]
    met = with_later_cuts(missed)
    after = met.residuals[met.layout.blow_spans[0]]
    assert met.model.data.blows[0].settled > missed.model.data.blows[0].settled + 1e-3
    assert float(before @ before) / before.size > 1.1
    assert float(after @ after) / after.size < 1.1


def test_a_tap_that_is_cut_rightly_stays_as_it_is(make_campaign):
    found = baseline(make_campaign(4, tap=TAP, rate=5000.0))
    assert with_later_cuts(found) is found


def test_an_effect_is_not_taken_for_a_cut(make_campaign):
    friction = [Effect('coulomb_friction', {'force': 0.5})]
    found = baseline(make_campaign(4, friction, tap=TAP, rate=5000.0))
    assert with_later_cuts(found) is found
