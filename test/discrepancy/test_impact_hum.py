"""A hum must be there before the blow, too, where the channel is compared there."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.findings.estimates import estimates
from impactscope.discrepancy.impact.models.bench_model import ActiveEffect, Free
from impactscope.discrepancy.impact.search.forward_backward import _without_strayed_line
from impactscope.discrepancy.impact.search.joint_fits import _everywhere
from impactscope.discrepancy.impact.search.outcome import Outcome, weigh

TIMES = np.linspace(-0.2, 0.8, 1000)
HUM = 3 * np.sin(2 * np.pi * 50 * TIMES)
NOISE = np.random.default_rng(4).normal(size=TIMES.size)


def fits(old, new, mask):
    channel = SimpleNamespace(centres=TIMES)
    blow = SimpleNamespace(channels={'force': channel}, onset=0.0)
    layout = SimpleNamespace(
        size=int(mask.sum()),
        masks={(0, 'force'): mask},
        spans={(0, 'force'): slice(0, mask.sum())},
    )
    model = SimpleNamespace(data=SimpleNamespace(blows=[blow]))
    return (
        SimpleNamespace(model=model, layout=layout, residuals=new[mask]),
        SimpleNamespace(model=model, layout=layout, residuals=old[mask]),
    )


@pytest.mark.parametrize(
    ('old', 'first', 'stands'),
    [
        (NOISE + HUM, -0.2, True),
        (NOISE + HUM * (TIMES > 0), -0.2, False),  # it only stands for something after the blow
        (NOISE + HUM, 0.0, True),  # not compared before: nothing speaks against it
    ],
)
def test_a_hum_is_there_before_the_blow(old, first, stands):
    joint, current = fits(old, old - HUM, first <= TIMES)
    assert _everywhere(joint, current) is stands


def hum_at(frequencies, gain=70.0):
    """A hum that gains so much chi-square, its fits by frequency, and the fit without it."""
    times = np.linspace(0.0, 1.0, 10)
    blow = SimpleNamespace(times=times)
    model = SimpleNamespace(data=SimpleNamespace(blows=[blow]))
    frequency = Free('mains_hum:force.frequency', 50.0, 0.02, 10.0, 1000.0)
    others = tuple(Free(f'part{i}', 0.0, 1.0, blow=i // 2) for i in range(16))
    own = tuple(range(8))
    hum = Candidate('hum', 'mains_hum', 'measurement', (frequency, *others), fitted=own)
    layout = SimpleNamespace(size=30000)
    before = SimpleNamespace(
        chi_square=30000.0 + gain,
        layout=layout,
        residuals=np.full(30000, np.sqrt((30000 + gain) / 30000)),
    )
    fitted = {
        where: SimpleNamespace(
            reduced=1.0,
            chi_square=30000.0,
            values={frequency.key: where},
            layout=layout,
            residuals=np.ones(30000),
            model=model,
        )
        for where in frequencies
    }
    return hum, fitted, before


def test_a_line_away_from_the_mains_pays_for_every_frequency():
    hum, fitted, before = hum_at((60.1, 87.2))
    found = {where: weigh(hum, after, before, 40) for where, after in fitted.items()}
    assert found[60.1].counts(1e-3)
    assert not found[60.1].refused
    assert found[87.2].refused
    assert not found[87.2].counts(1.0)
    assert found[87.2].p_value > found[60.1].p_value  # the chance itself stays one
    assert found[87.2].criterion > found[60.1].criterion


def test_a_weak_hum_in_every_recording_pays_for_their_phases():
    hum, fitted, before = hum_at((60.1,))
    found = weigh(hum, fitted[60.1], before, 40)
    assert hum.cost == 17
    assert found.criterion < 0.0 < 17 * np.log(30000) - found.gain


def test_a_hum_that_nothing_is_likelier_than_is_no_finding():
    """Of many numbers chance is sooner excluded: two clean campaigns of 300 had such a hum."""
    hum, fitted, before = hum_at((60.1,), 55.0)
    found = weigh(hum, fitted[60.1], before, 40)
    assert found.p_value < 0.003
    assert found.criterion > 0.0
    assert not found.counts(0.003)


def test_recordings_that_are_not_fitted_cost_nothing():
    hum, _, _ = hum_at(())
    assert dataclasses.replace(hum, fitted=(0, 1, 2)).cost == 7


@pytest.mark.parametrize(('where', 'stands'), [(60.1, True), (59.49, False)])
def test_a_line_that_has_left_the_mains_is_no_hum(where, stands):
    """It was taken for one beside the mains, and the last digits of the fit moved it away."""
    hum, fitted, before = hum_at((where,))
    outcome = Outcome(before, fitted[where], [hum], looks=40, p_value=1e-6)
    _without_strayed_line(outcome)
    assert outcome.accepted == ([hum] if stands else [])
    assert (outcome.final is before) is not stands


def test_noise_makes_the_amplitude_of_a_weak_hum_no_larger():
    rng = np.random.default_rng(3)
    blows = tuple(range(400))
    parts = rng.normal((2.0, 0.0), 1.0, (400, 2))
    keys = [f'mains_hum:force.{part}@{i}' for i in blows for part in ('sine', 'cosine')]
    own = {key: Free(key, 0.0, 1.0) for key in keys}
    channel = SimpleNamespace(unit='N')
    fitted = SimpleNamespace(
        values={
            'mains_hum:force.frequency': 50.0,
            'mains_hum:force.amplitude': 0.0,
            **dict(zip(keys, parts.ravel().tolist(), strict=True)),
        },
        std=lambda key: 1.0 if key in own else 0.0,
        model=SimpleNamespace(
            free=tuple(own.values()),
            data=SimpleNamespace(
                fitted=blows, blows=[SimpleNamespace(channels={'force': channel})]
            ),
        ),
    )
    active = ActiveEffect('mains_hum', 'force')
    hum = Candidate('hum', 'mains_hum', 'measurement', effects=(active,), channel='force')
    amplitude = estimates(hum, fitted)['amplitude']
    assert amplitude.unit == 'N'
    assert abs(amplitude.value - 2.0) < 3.0 * amplitude.std
    assert amplitude.std == pytest.approx(1.0 / np.sqrt(400))
