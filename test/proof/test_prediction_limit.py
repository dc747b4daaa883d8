"""How near held-out recordings can be predicted: closed forms, and what makes it worse."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from impactscope.proof.conditions import draw_scenario
from impactscope.proof.prediction_limit import prediction_limit
from impactscope.proof.scenario import Scenario


@pytest.fixture(scope='module')
def shaken() -> Scenario:
    """A driven bench of one fitted recording and the same one held out: three numbers."""
    drawn = draw_scenario(np.random.default_rng(3), 'driven')
    first = replace(drawn.blows[0], role='fit')
    twice = (first, replace(first, role='hold_out'))
    return replace(drawn, blows=twice, gain_std={}, colours={})


def test_a_repeated_recording_is_predicted_as_its_numbers_are_known(shaken: Scenario) -> None:
    """Misfit of n samples by three numbers that as many samples told: chi-square of three."""
    (channel,) = shaken.channels
    n = math.ceil(shaken.blows[0].duration * shaken.rates[channel])
    expected = math.sqrt(1.0 + stats.chi2.ppf(0.95, 3) / n)
    assert prediction_limit(shaken) - 1.0 == pytest.approx(expected - 1.0, rel=0.2)


def test_more_recordings_tell_more(shaken: Scenario) -> None:
    fitted, held_out = shaken.blows
    more = replace(shaken, blows=(*(fitted,) * 4, held_out))
    ratio = (prediction_limit(shaken) ** 2 - 1.0) / (prediction_limit(more) ** 2 - 1.0)
    assert ratio == pytest.approx(4.0, rel=0.05)


def test_nothing_held_out_is_no_limit(shaken: Scenario) -> None:
    assert prediction_limit(replace(shaken, blows=shaken.blows[:1])) == 1.0


@pytest.mark.parametrize('kind', ['impact', 'closed_loop', 'prescribed', 'chain'])
def test_every_kind_has_a_limit(kind: str) -> None:
    drawn = [draw_scenario(np.random.default_rng(seed), kind) for seed in range(3)]
    limits = [prediction_limit(scenario) for scenario in drawn]
    assert all(1.0 <= limit < 100.0 for limit in limits)
