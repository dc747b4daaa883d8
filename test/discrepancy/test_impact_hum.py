"""A hum must be there before the blow, too, where the channel is compared there."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import special, stats

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.candidates.hum_amplitude import hum_amplitude
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


EVEN = (1.0,) * 8
AS_NOISE = tuple(-np.log(1.0 - (np.arange(8) + 0.5) / 8.0))  # quantiles of what noise gives


def hum_at(frequencies, gain=70.0, shares=AS_NOISE):
    """A hum that gains so much chi-square, its fits by frequency, and the fit without it.

    ``shares``: of the gain, in each of eight recordings.
    """
    times = np.linspace(0.0, 1.0, 10)
    blow = SimpleNamespace(times=times)
    frequency = Free('mains_hum:force.frequency', 50.0, 0.02, 10.0, 1000.0)
    others = tuple(
        Free(f'mains_hum:force.{part}@{i}', 0.0, 1.0, blow=i)
        for i in range(8)
        for part in ('sine', 'cosine')
    )
    keys = [f.key for f in (frequency, *others)]
    model = SimpleNamespace(data=SimpleNamespace(blows=[blow]), index=keys.index, effects=())
    active = ActiveEffect('mains_hum', 'force')
    own = tuple(range(8))
    hum = Candidate(
        'hum',
        'mains_hum',
        'measurement',
        (frequency, *others),
        (active,),
        amplitudes={f.key: 0.0 for f in others},
        channel='force',
        fitted=own,
    )
    sizes = np.sqrt(gain * np.array(shares) / np.sum(shares))
    layout = SimpleNamespace(size=30000)
    before = SimpleNamespace(
        chi_square=30000.0 + gain,
        layout=layout,
        model=model,
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
            x=np.array([where, *np.stack([sizes, np.zeros(8)], axis=1).ravel()]),
            covariance=lambda: np.diag([1e-3, *np.ones(16)]),
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


def test_as_much_is_one_where_all_recordings_have_it_alike():
    """The mains leave one amplitude; noise gives each recording another."""
    found = {}
    for shares in (EVEN, AS_NOISE, (1.0, *(0.0,) * 7)):
        hum, fitted, before = hum_at((60.1,), 55.0, shares)
        found[shares] = weigh(hum, fitted[60.1], before, 40)
    assert [f.counts(0.003) for f in found.values()] == [True, False, False]
    assert found[EVEN].criterion < 0.0 < found[AS_NOISE].criterion


def test_recordings_too_short_for_a_hum_do_not_hide_it():
    """One tells all of it; what noise gives to the phases of the others was its price."""
    told, short = (np.array([5.5, 0.0]), np.eye(2)), (np.array([100.0, 100.0]), 1e4 * np.eye(2))
    alone, beside = hum_amplitude([told]), hum_amplitude([told] + [short] * 9)
    assert beside.gain == pytest.approx(alone.gain, rel=0.01)
    assert beside.value == pytest.approx(alone.value, rel=0.01)
    assert alone.gain == pytest.approx(5.5**2 - np.log(2 * np.pi * 5.5**2), rel=0.02)
    assert beside.taken == pytest.approx(alone.taken + 18.0, rel=0.02)


def test_noise_gains_as_much_by_one_amplitude_as_one_number_does():
    rng = np.random.default_rng(1)
    gains = np.array(
        [
            hum_amplitude([(rng.normal(size=2), np.eye(2)) for _ in range(7)]).gain
            for _ in range(1500)
        ]
    )
    for chance in (0.05, 0.01):  # none is likeliest in half of all cases
        found = np.mean(gains > stats.chi2.isf(2.0 * chance, 1))
        assert abs(found - chance) < 4.0 * np.sqrt(chance / gains.size)


def test_the_amplitude_of_a_hum_is_as_certain_as_it_says():
    rng = np.random.default_rng(2)
    off = []
    for _ in range(400):
        turn = rng.uniform(0.0, 2.0 * np.pi, 7)
        parts = 2.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1) + rng.normal(size=(7, 2))
        told = hum_amplitude([(part, np.eye(2)) for part in parts])
        off.append((told.value - 2.0) / told.std)
    assert 0.93 < np.mean(np.abs(off) < 1.96) < 0.985


def test_no_recording_tells_of_a_hum():
    told = hum_amplitude([(np.array([1.0, 1.0]), np.zeros((2, 2)))])
    assert (told.value, told.gain, told.taken) == (0.0, 0.0, 0.0)
    assert np.isnan(told.std)


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
    turn = rng.uniform(0.0, 2.0 * np.pi, 400)
    parts = 2.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1) + rng.normal(size=(400, 2))
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
        x=parts.ravel(),
        covariance=lambda: np.eye(800),
        model=SimpleNamespace(
            free=tuple(own.values()),
            index=keys.index,
            data=SimpleNamespace(
                fitted=blows, blows=[SimpleNamespace(channels={'force': channel})]
            ),
        ),
    )
    active = ActiveEffect('mains_hum', 'force')
    hum = Candidate(
        'hum', 'mains_hum', 'measurement', effects=(active,), channel='force', fitted=blows
    )
    amplitude = estimates(hum, fitted)['amplitude']
    assert amplitude.unit == 'N'
    assert abs(amplitude.value - 2.0) < 3.0 * amplitude.std
    size = np.linspace(1e-6, 12.0, 24001)  # of sine and cosine, beside an amplitude of 2
    law = stats.rice.pdf(size, 2.0)
    slope = size * special.i1e(2.0 * size) / special.i0e(2.0 * size) - 2.0
    information = float(np.sum(law * slope**2)) * (size[1] - size[0])
    assert 0.5 < information < 1.0  # phases take some of it
    assert amplitude.std == pytest.approx(1.0 / np.sqrt(400 * information), rel=0.05)
