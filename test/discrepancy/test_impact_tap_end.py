"""A tap whose end is read too early: its last push is nothing that the bench does."""

from __future__ import annotations

import dataclasses

import pytest

from impactscope.discrepancy.impact.data import blows as impact_data
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits import tap_end
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


@pytest.mark.parametrize(
    ('outside', 'cut'), [(0.0, False), (4.0, True), (-4.0, False)], ids=['within', 'push', 'pull']
)
def test_what_acts_within_the_bench_is_no_push(make_campaign, outside, cut):
    """The force shows 3 N more at first, and the plate is slowed as much but for ``outside``."""
    found = baseline(make_campaign(4, tap=TAP, rate=5000.0))
    blow, mass = found.model.data.blows[0], found.values['sensor.moving_mass']
    residuals = found.residuals.copy()
    for name, more in (('force', 3.0), ('acceleration.plate', (outside - 3.0) / mass)):
        channel, mask = blow.channels[name], found.layout.masks[0, name]
        since = channel.centres[mask] - blow.settled
        early = (since > 0.0) & (since < 2e-3)
        missed = residuals[found.layout.spans[0, name]]
        missed[early] += more / channel.std[mask][early]
    missed = dataclasses.replace(found, residuals=residuals)
    assert tap_end._missed_at_first(missed, 0)
    assert tap_end._may_push(missed, 0) is cut
