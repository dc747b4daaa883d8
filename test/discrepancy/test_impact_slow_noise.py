"""Noise that is slower than the quiet before the blows shows: seen in what a model leaves."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.explain import explain
from impactscope.discrepancy.impact import explain as impact_explain
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import prepare
from impactscope.discrepancy.impact.explain import _certain, _without_slow
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import fit
from impactscope.discrepancy.impact.fits.slow_noise import (
    _LEVELS,
    _levelled,
    _likelihood,
    _slower,
    _Stretch,
    _with,
    likelier,
    noise_left,
)
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.noise.coloured_noise import Colour
from impactscope.discrepancy.time_limit import time_limited
from impactscope.physics.twin.assembly import Effect

WHITE = {'force': 0.4, 'acceleration.impactor': 0.08}


def slow(count, rate, memory, rng):
    """Noise of unit variance that forgets within ``memory`` s."""
    share = np.exp(-1.0 / (memory * rate))
    fresh = rng.standard_normal(count) * np.sqrt(1.0 - share**2)
    fresh[0] = rng.standard_normal()
    return signal.lfilter([1.0], [1.0, -share], fresh)


def stretch(left, rate, own=0.0):
    """What is left of a channel at rest, a bin for each sample."""
    count = left.size
    return _Stretch(
        np.arange(count) / rate, np.ones(count, dtype=np.int64), left, np.full(count, own)
    )


def with_slow_noise(campaign, name, times_white, memory, seed=3):
    """The campaign with slow noise added to a channel."""
    rng = np.random.default_rng(seed)
    recordings = []
    for recording in campaign.recordings:
        channels = dict(recording.channels)
        if name in channels:
            c = channels[name]
            added = times_white * WHITE[name] * slow(c.values.size, c.sample_rate, memory, rng)
            channels[name] = dataclasses.replace(c, values=c.values + added)
        recordings.append(dataclasses.replace(recording, channels=channels))
    return dataclasses.replace(campaign, recordings=tuple(recordings))


@pytest.fixture(scope='module')
def clean(make_campaign):
    return make_campaign(5, duration=0.9)


def baseline(campaign, slower=None):
    return fit_baseline(baseline_model(campaign, prepare(campaign, slower)))


def test_white_noise_is_not_slower_than_it_seems(clean):
    assert noise_left(baseline(clean)) == {}


def test_slow_noise_of_the_impactor_alone_is_seen_once_the_model_is_off(clean):
    campaign = with_slow_noise(clean, 'acceleration.impactor', 2.0, 0.2)
    left = noise_left(baseline(campaign))
    assert list(left) == ['acceleration.impactor']
    std = left['acceleration.impactor'].std / WHITE['acceleration.impactor']
    assert 1.4 < std < 4.5
    again = baseline(campaign, left)
    assert 0.75 < again.reduced < 1.1
    assert noise_left(again) == {}


def test_channels_are_asked_again_where_one_of_them_shows_slow_noise(clean):
    weak = with_slow_noise(clean, 'force', 0.15, 0.03, seed=7)
    assert noise_left(baseline(weak)) == {}
    both = with_slow_noise(weak, 'acceleration.impactor', 2.0, 0.2)
    assert set(noise_left(baseline(both))) == {'acceleration.impactor', 'force'}


def test_a_stated_noise_stands(clean):
    stated = dataclasses.replace(clean, noise_std=WHITE)
    left = noise_left(baseline(with_slow_noise(clean, 'acceleration.impactor', 2.0, 0.2)))
    data = prepare(stated, left)
    assert all(b.channels['force'].colour is None for b in data.blows)
    assert data.noise['acceleration.impactor'] == WHITE['acceleration.impactor']


def test_an_effect_is_no_noise(make_campaign):
    campaign = make_campaign(5, [Effect('quadratic_damping', {'coefficient': 60.0})], duration=0.9)
    assert noise_left(baseline(campaign)) == {}


def test_a_drift_that_all_recordings_share_is_likelier_than_slow_noise(make_campaign, clean):
    noisy = with_slow_noise(clean, 'acceleration.impactor', 2.0, 0.2)
    slower = noise_left(baseline(noisy))
    assert list(slower) == ['acceleration.impactor']
    drift = Effect('zero_drift', {'rate': 0.3}, 'acceleration.impactor')
    for campaign, true in ((make_campaign(5, [drift], duration=0.9), True), (noisy, False)):
        plain = baseline(campaign)
        able = candidates(plain, ['linear_sensor'])
        added = next(
            c for c in able if c.name == 'zero_drift' and c.channel == 'acceleration.impactor'
        )
        model = added.extend(plain.model)
        x = np.array([f.to_inner(plain.values.get(f.key, f.start)) for f in model.free])
        found = fit(model, plain.layout, x)
        instead = baseline(campaign, slower)
        assert likelier(found, instead, slower) is true
        assert not likelier(found, instead, slower, numbers=1000)  # each has its price


@pytest.mark.parametrize(('offset', 'found_again'), [(0.0, 0), (0.3, 6)])
def test_an_offset_of_all_recordings_is_held_against_slow_noise_in_like_noise(
    monkeypatch, offset, found_again
):
    """Slow noise as faint as is allowed without the offset is allowed beside it."""
    rate, count, blows, memory, level = 1000.0, 1200, 5, 1.0, 0.005
    known = Colour(1.0, np.zeros(0), np.zeros(0), rate)
    coloured = SimpleNamespace(channels={'acceleration.base': SimpleNamespace(colour=known)})
    layout, model = SimpleNamespace(size=blows * count), SimpleNamespace()
    model.data = SimpleNamespace(blows=[coloured])
    monkeypatch.setattr(
        'impactscope.discrepancy.impact.fits.slow_noise._at_rest',
        lambda found, _, instead=None, *, beside: (
            [(stretch(course, rate), None) for course in (instead or found).left],
            known,
            rate,
        ),
    )
    told = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        courses = [
            offset + rng.standard_normal(count) + np.sqrt(level) * slow(count, rate, memory, rng)
            for _ in range(blows)
        ]
        mean = np.mean(courses)
        instead = SimpleNamespace(left=courses)
        found = SimpleNamespace(left=[c - mean for c in courses], layout=layout, model=model)
        stretches = [stretch(c, rate) for c in courses]
        slower = _slower(stretches, known, rate, beside=True) or known
        told += likelier(found, instead, {'force': slower})
    assert told == found_again


@pytest.mark.parametrize(
    ('name', 'blows'),
    [pytest.param('acceleration.impactor', 2, marks=pytest.mark.slow), ('force', 3)],
)
def test_slow_noise_is_no_finding(make_campaign, name, blows):
    made = make_campaign(5, duration=0.9, blows=blows)
    answer = explain(with_slow_noise(made, name, 2.0, 0.2))
    assert answer.accepted == ()


@pytest.mark.slow
def test_a_coupling_is_found_beside_slow_noise(make_campaign):
    coupled = make_campaign(7, [Effect('ac_coupling', {'corner': 1.5}, 'force')], duration=0.9)
    answer = explain(with_slow_noise(coupled, 'force', 0.5, 0.5))
    assert answer.accepted == ('ac_coupling',)
    corner = answer.ranking[0].parameters['corner']
    assert corner.value == pytest.approx(1.5, abs=4 * corner.std)


@pytest.mark.parametrize('memory', [0.004, 0.022, 0.15])
def test_noise_without_a_white_part_is_met_though_the_quiet_told_another(memory):
    rate, sigma = 5000.0, 0.08
    rng = np.random.default_rng(9)
    true = Colour(0.0, np.array([sigma**2]), np.array([memory]), rate)
    lives = 0.5 * 2.0 ** np.arange(2, 14)
    known = Colour(1e-9, np.full(12, 0.02 * sigma**2), lives / rate, rate)  # too small, too wide
    count = 1500
    stretches = [
        stretch(sigma * slow(count, rate, memory, rng), rate, (0.05 * sigma) ** 2)
        for _ in range(3)
    ]
    found = _slower(stretches, known, rate)
    assert found is not None
    assert _likelihood(stretches, found) > _likelihood(stretches, known) + 50.0
    assert _likelihood(stretches, found) > _likelihood(stretches, true) - 20.0


@pytest.mark.parametrize(
    ('name', 'gains', 'sure'),
    [
        ('coulomb_friction', (5000.0,), True),
        ('coulomb_friction', (60.0,), False),
        ('zero_drift', (5000.0,), False),  # slow noise of any strength looks like it
        ('coulomb_friction', (5000.0, 40.0), False),
        ('coulomb_friction', (), False),
    ],
)
def test_what_is_far_too_strong_for_noise_needs_no_other_noise(name, gains, sure):
    accepted = [SimpleNamespace(name=name, label=f'{name} {i}') for i in range(len(gains))]
    found = {c.label: SimpleNamespace(gain=g) for c, g in zip(accepted, gains, strict=True)}
    assert _certain(SimpleNamespace(accepted=accepted, found=found)) is sure


@pytest.mark.parametrize(
    ('coloured', 'kept'),
    [
        ((), None),
        (('acceleration.plate',), ['friction', 'hum']),
        (('force',), ['friction', 'hum']),
    ],
)
def test_where_one_channel_has_slow_noise_a_level_of_any_may_be_it(monkeypatch, coloured, kept):
    findings = [
        SimpleNamespace(name=name, label=name, channel=channel)
        for name, channel in (('friction', ''), ('offset', 'force'), ('hum', 'force'))
    ]
    channels = {
        name: SimpleNamespace(colour='slow' if name in coloured else None)
        for name in ('force', 'acceleration.plate')
    }
    data = SimpleNamespace(blows=(SimpleNamespace(channels=channels),))
    final = SimpleNamespace(layout='layout')
    outcome = SimpleNamespace(accepted=findings, final=final)
    monkeypatch.setattr(
        'impactscope.discrepancy.impact.explain.with_findings',
        lambda _, chosen, layout: ([c.name for c in chosen], layout),
    )
    found = _without_slow(data, outcome)
    assert found is final if kept is None else found == (kept, 'layout')
    assert _without_slow(data, outcome, {'offset'}) is final


@pytest.mark.parametrize('size', [0.15, 1.2, 4.0])
def test_a_level_is_the_one_that_a_scan_of_all_finds(size):
    rate, count, rng = 1000.0, 2000, np.random.default_rng(8)
    stretches = [
        stretch(rng.standard_normal(count) + size * slow(count, rate, 0.1, rng), rate)
        for _ in range(2)
    ]
    known, shape = Colour(1.0, np.zeros(0), np.zeros(0), rate), {0.1 * rate: 1.0}
    reached, _ = _levelled(stretches, known, 1.0, rate, shape)
    scan = [_likelihood(stretches, _with(known, shape, level, rate)) for level in _LEVELS]
    assert reached > _likelihood(stretches, known)
    assert reached >= max(scan)


@pytest.mark.parametrize(
    ('found_again', 'still_slow', 'searched_in', 'believed'),
    [
        (('offset',), ('impactor',), [{'plate', 'impactor'}, {'impactor'}], {'impactor'}),
        (('offset',), (), [{'plate', 'impactor'}], set()),
        (('offset',), ('plate',), [{'plate', 'impactor'}], {'plate', 'impactor'}),
        ((), ('impactor',), [{'plate', 'impactor'}], {'plate', 'impactor'}),
    ],
)
def test_an_offset_that_is_found_in_slow_noise_too_leaves_no_level_to_noise(
    monkeypatch, found_again, still_slow, searched_in, believed
):
    """A stop beside it was lost in noise that was nothing but the offset."""
    offset = SimpleNamespace(name='offset', label='offset:plate', channel='plate', cost=1)
    stop = SimpleNamespace(name='end_stop', label='end_stop', channel='', cost=2)
    blow = SimpleNamespace(channels={'plate': SimpleNamespace(colour=None)})
    data = SimpleNamespace(blows=[blow])
    final = SimpleNamespace(reduced=1.0, layout=None, model=None)
    whole = SimpleNamespace(accepted=[offset, stop], found={}, final=final)
    weak = SimpleNamespace(accepted=[offset] if found_again else [], final=final)
    asked, searched = [], []

    def left(_):
        asked.append(1)
        return dict.fromkeys(('plate', 'impactor') if len(asked) == 1 else still_slow)

    def again(*_):
        return weak if searched[-1] == {'plate', 'impactor'} else whole

    monkeypatch.setattr(impact_explain, 'noise_left', left)
    monkeypatch.setattr(impact_explain, 'prepare', lambda _, s: searched.append(set(s)) or data)
    monkeypatch.setattr(impact_explain, '_searched', again)
    monkeypatch.setattr(impact_explain, '_left', lambda *_: False)
    monkeypatch.setattr(impact_explain, '_likelier', lambda *_: False)
    monkeypatch.setattr(impact_explain, 'with_findings', lambda *_: final)
    _, outcome, noise = impact_explain._in_slower_noise(None, data, whole, None, None)
    assert searched == searched_in
    assert set(noise) == believed
    assert (outcome is whole) is (believed in (set(), {'impactor'}))


@pytest.mark.parametrize(('over', 'searches'), [('before', 0), ('meanwhile', 1), ('never', 1)])
def test_a_search_in_slower_noise_that_ran_out_of_time_hides_nothing(monkeypatch, over, searches):
    """It was cut off before it found what the search before it had found."""
    branch = SimpleNamespace(name='rate_dependent_damper', label='branch', channel='', cost=2)
    data = SimpleNamespace(blows=[])
    final = SimpleNamespace(reduced=1.0, layout=None, model=None)
    whole = SimpleNamespace(accepted=[branch], found={}, final=final)
    less = SimpleNamespace(accepted=[], final=final)
    clock = [0.0]
    searched = []

    def again(*_):
        searched.append(1)
        clock[0] += 200.0 if over == 'meanwhile' else 0.0
        return less

    monkeypatch.setattr(impact_explain, 'noise_left', lambda _: {'force': None})
    monkeypatch.setattr(impact_explain, 'prepare', lambda *_: data)
    monkeypatch.setattr(impact_explain, '_searched', again)
    monkeypatch.setattr(impact_explain, '_left', lambda *_: False)
    monkeypatch.setattr(impact_explain, '_likelier', lambda *_: False)
    with time_limited(240.0, lambda: clock[0]) as limit:
        clock[0] += 200.0 if over == 'before' else 0.0
        _, outcome, _ = impact_explain._in_slower_noise(None, data, whole, None, None)
    assert (outcome is whole) is (over != 'never')
    assert len(searched) == searches
    assert bool(limit.left_out) is (over != 'never')
