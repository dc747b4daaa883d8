"""Nobody knows the shape of a hammer's pulse: none may pass for missing physics, or hide it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.fits import start_values
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.start_values import _rung_masses, cold_starts
from impactscope.discrepancy.impact.models.baseline import (
    MOST_OF_TAP,
    _tap_start,
    baseline_model,
)
from impactscope.discrepancy.impact.models.bench_model import Free
from impactscope.physics.twin.assembly import Effect
from impactscope.physics.twin.bench import HammerTap, MeasuredForce, Sensor

RATE = 100_000.0  # Hz, of the pulse
RATE_OF_SLOW = 2500.0
SLOW = [1.0, -np.exp(-2.0 * np.pi * 4.0 / RATE_OF_SLOW)]  # a corner at 4 Hz
MIXED = {
    'force': 2000.0,
    'acceleration.plate': 5000.0,
    'acceleration.impactor': 5000.0,
    'acceleration.base': 5000.0,
}


def _power(phase, exponent):
    return np.sin(np.pi * phase) ** exponent


def _skewed(phase, early):
    return np.sin(np.pi * phase**early)


def _humps(phase, second):
    first = np.exp(-(((phase - 0.28) / 0.13) ** 2))
    return (first + second * np.exp(-(((phase - 0.72) / 0.15) ** 2))) * np.sin(np.pi * phase)


PULSES = {
    'half sine': (lambda p: _power(p, 1.0), 0.0045),
    'sin^1.3': (lambda p: _power(p, 1.3), 0.005),
    'sin^1.8': (lambda p: _power(p, 1.8), 0.006),
    'sin^2.5': (lambda p: _power(p, 2.5), 0.007),
    'long sin^2.5': (lambda p: _power(p, 2.5), 0.011),
    'steep rise': (lambda p: _skewed(p, 0.6), 0.005),
    'slow rise': (lambda p: _skewed(p, 1.7), 0.005),
    'short': (lambda p: _power(p, 1.5), 0.0015),
    'two humps': (lambda p: _humps(p, 0.7), 0.008),
}


def pulse(name: str, peak: float = 150.0) -> MeasuredForce:
    shape, duration = PULSES[name]
    phase = np.arange(round(duration * RATE) + 1) / (duration * RATE)
    values = shape(np.minimum(phase, 1.0))
    return MeasuredForce(peak * values / values.max(), RATE)


@pytest.mark.parametrize('name', PULSES)
def test_samples_count_when_the_hammer_has_gone(make_campaign, name):
    data = prepare(make_campaign(1, tap=pulse(name), rate=MIXED))
    blow = data.blows[0]
    started = blow.onset - 2e-3  # at the earliest
    duration = PULSES[name][1]
    for channel in blow.channels.values():
        counted = channel.centres[channel.used]
        after = counted[counted > blow.onset]
        assert after[0] > started + duration
        assert after[0] < blow.onset + 1.5 * duration + 5e-3
        assert np.count_nonzero(counted < blow.onset - 5e-3) > 5


@pytest.mark.parametrize(
    'name',
    ['two humps', *(pytest.param(n, marks=pytest.mark.slow) for n in PULSES if n != 'two humps')],
)
def test_the_shape_of_a_pulse_is_no_finding(make_campaign, name):
    answer = explain(make_campaign(21, tap=pulse(name), rate=MIXED, blows=2))
    assert answer.accepted == ()
    assert not answer.unexplained
    assert answer.fit.extended.reduced_chi_square < 1.1


@pytest.mark.parametrize(
    'name',
    ['sin^2.5', *(pytest.param(n, marks=pytest.mark.slow) for n in ('steep rise', 'two humps'))],
)
def test_friction_is_found_whatever_the_pulse(make_campaign, name):
    friction = Effect('coulomb_friction', {'force': 0.3})
    answer = explain(make_campaign(22, [friction], tap=pulse(name), rate=MIXED, blows=2))
    assert answer.accepted == ('coulomb_friction',)
    item = answer.ranking[0].parameters['force']
    assert item.value == pytest.approx(0.3, abs=4 * item.std)
    assert item.std < 0.01


def test_a_tap_may_be_as_hard_as_a_fit_makes_it():
    number = Free('tap_peak@0', 100.0, 0.02, 1e-3, MOST_OF_TAP, logarithmic=True, blow=0)
    HammerTap(number.to_outer(number.bounds[1]), 0.005)  # else a trial ends the search


def test_a_plate_that_rings_on_makes_no_longer_pulse(make_campaign):
    made = make_campaign(6, tap=HammerTap(150.0, 0.0045))
    tap = next(b for b in prepare(made).blows if b.recording.kind == 'tap')
    _, duration = _tap_start(dataclasses.replace(tap, settled=tap.onset + 0.0275))
    assert 0.0035 < duration < 0.008


def test_slow_noise_of_the_plate_is_not_taken_for_its_ring_down(make_campaign):
    made = make_campaign(3, [])
    rng = np.random.default_rng(1)

    def wavy(channel):
        steps = rng.standard_normal(channel.values.size)
        slow = 300.0 * np.sqrt(np.pi * 4.0 / RATE_OF_SLOW) * signal.lfilter([1.0], SLOW, steps)
        return dataclasses.replace(channel, values=channel.values + slow)

    recordings = tuple(
        dataclasses.replace(
            r,
            channels={
                n: wavy(c) if n == 'acceleration.plate' else c for n, c in r.channels.items()
            },
        )
        for r in made.recordings
    )
    noisy = dataclasses.replace(made, recordings=recordings)
    model = baseline_model(noisy, prepare(noisy))
    taps = [i for i in model.data.fitted if model.data.blows[i].recording.kind == 'tap']
    masses = sorted(_rung_masses(model, taps))
    assert masses[-1] > 3.0 * masses[0]  # the slower one is none of the plate's
    assert fit_baseline(model).reduced < 2.0  # else some thousands


@pytest.mark.parametrize('told', [(), (90.0,), (0.03,)])
def test_a_mass_that_taps_do_not_bear_out_is_looked_for(make_campaign, monkeypatch, told):
    made = make_campaign(3, [])
    model = baseline_model(made, prepare(made))
    monkeypatch.setattr(start_values, '_rung_masses', lambda *_: told)
    (start,) = cold_starts(model)
    mass = model.values(start)['sensor.moving_mass']
    assert mass == pytest.approx(Sensor().moving_mass, rel=0.02)
