"""Laws of a measuring chain that no mechanism has."""

from __future__ import annotations

import numpy as np
import pytest

from impactscope.discrepancy.impact.adequacy.channel_laws import chain_laws
from impactscope.discrepancy.impact.adequacy.residual_tests import adequacy
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import Fit, at_point
from impactscope.discrepancy.impact.models.baseline import baseline_model


@pytest.fixture(scope='module')
def sound(make_campaign):
    campaign = make_campaign(61)
    return fit_baseline(baseline_model(campaign, prepare(campaign)))


def test_every_law_is_one_number_of_one_channel(sound):
    laws = chain_laws(sound)
    assert len({law.label for law in laws}) == len(laws)
    for law in laws:
        assert law.columns.shape == (sound.layout.size, 1)
        assert np.isfinite(law.columns).all()
        channel = law.label.rsplit(' in ', 1)[1]
        elsewhere = np.ones(sound.layout.size, dtype=bool)
        for (_, name), span in sound.layout.spans.items():
            if name == channel:
                elsewhere[span] = False
        assert not np.any(law.columns[elsewhere])


@pytest.mark.parametrize(
    'kind',
    [
        'an echo after 4 ms',
        'a scale that is bent one way',
        'a rate that is limited to 55% of the steepest',
    ],
)
def test_what_is_added_is_seen_and_named(sound, kind):
    law = next(c for c in chain_laws(sound) if c.label == f'{kind} in force')
    column = law.columns[:, 0]
    changed = sound.residuals.copy()
    changed[: column.size] += 40.0 * column / np.linalg.norm(column)
    other = Fit(
        sound.model, sound.layout, sound.x, changed, float(changed @ changed), True, sound.jacobian
    )
    tests = adequacy(other)
    assert tests.p_values['laws'] < 1e-4
    assert adequacy(at_point(sound.model, sound.layout, sound.x)).p_values['laws'] > 0.01
    assert 'in force' in tests.law
