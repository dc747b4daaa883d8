"""Colour of the noise: its samples, and the whitening by its covariance."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_triangular, toeplitz
from scipy.signal import butter, sosfiltfilt, welch

from impactscope.proof.conditions import draw_scenario
from impactscope.proof.detectability import Freedom
from impactscope.proof.draw import KINDS, solve_strength
from impactscope.proof.effects import effect
from impactscope.proof.marking import mark
from impactscope.proof.measurement import _filtered, measure, noise_free
from impactscope.proof.noise import (
    COLOURS,
    WHITE,
    Colour,
    Whitening,
    draw_colour,
    noise,
    seen_better,
    spectrum,
)
from impactscope.proof.scenario import Chain


def covariance(colour: Colour, size: int):
    lag = np.arange(size)
    row = sum(
        (s * p**lag for p, s in zip(colour.poles, colour.shares, strict=True)), np.zeros(size)
    )
    row[0] += colour.white + colour.step**2 / 12
    return toeplitz(row)


@pytest.mark.parametrize('kind', COLOURS)
@pytest.mark.parametrize('seed', range(3))
def test_variance_is_one_and_the_spectrum_holds_it(kind, seed):
    colour = draw_colour(np.random.default_rng(seed), kind)
    assert colour.white + sum(colour.shares) == pytest.approx(1)
    edges = np.concatenate([[0.0], np.geomspace(1e-9, 0.5, 20001)])
    middle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    assert 2 * np.sum(spectrum(colour, middle) * width) == pytest.approx(colour.variance, rel=2e-3)


@pytest.mark.parametrize('kind', COLOURS)
def test_samples_have_their_spectrum(kind):
    colour = draw_colour(np.random.default_rng(1), kind)
    values = noise(np.random.default_rng(2), colour, 3.0, 200_000)
    f, density = welch(values, nperseg=1024)
    expected = 2 * 9.0 * (spectrum(colour, f) - colour.step**2 / 12)
    inside = slice(10, -10)
    assert density[inside] == pytest.approx(expected[inside], rel=0.35)
    assert np.mean(density[inside] / expected[inside]) == pytest.approx(1, abs=0.03)


def test_flicker_noise_falls_with_frequency():
    colour = draw_colour(np.random.default_rng(4), 'flicker')
    f = np.geomspace(1e-4, 0.05, 40)
    flicker = (spectrum(colour, f) - colour.white) * f
    assert flicker.max() / flicker.min() < 2.0


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(COLOURS), st.integers(0, 2**32 - 1))
def test_whitening_is_the_inverse_root_of_the_covariance(kind, seed):
    """Innovations have the norm that the full covariance gives, missing samples left out."""
    rng = np.random.default_rng(seed)
    colour = draw_colour(rng, kind)._replace(step=float(rng.uniform(0, 1)))
    size = 60
    seen, extra = rng.random(size) < 0.8, rng.exponential(0.5, size) * (rng.random(size) < 0.3)
    whitening = Whitening(colour, seen, extra)
    whole = (covariance(colour, size) + np.diag(extra))[np.ix_(seen, seen)]
    a, b = rng.normal(size=size), rng.normal(size=size)
    root = np.linalg.cholesky(whole)
    for values in (a, b, a + 2 * b):
        mine = whitening(values)
        assert np.all(mine[~seen] == 0)
        expected = solve_triangular(root, values[seen], lower=True)
        assert mine[seen] == pytest.approx(expected, rel=1e-7, abs=1e-9)


@pytest.mark.parametrize('kind', COLOURS)
def test_whitened_noise_is_white_and_of_unit_variance(kind):
    rng = np.random.default_rng(8)
    colour = draw_colour(rng, kind)
    values = noise(rng, colour, 1.0, 60_000)
    if colour.step:
        values = colour.step * np.round(values / colour.step)
    left = Whitening(colour, np.ones(values.size, dtype=bool))(values)
    assert np.std(left) == pytest.approx(1, abs=0.02)
    for lag in (1, 2, 5, 50):
        assert abs(np.mean(left[lag:] * left[:-lag])) < 4 / math.sqrt(values.size)


def test_white_noise_is_weighed_as_ever():
    values = np.arange(5.0)
    seen = np.array([True, True, False, True, True])
    extra = np.array([0.0, 3.0, 0.0, 0.0, 8.0])
    assert Whitening(WHITE, seen, extra)(values) == pytest.approx([0, 0.5, 0, 3, 4 / 3])
    assert seen_better(WHITE) == pytest.approx(1)


def test_a_third_of_the_campaigns_of_every_kind_is_not_white():
    for kind in ('prescribed', 'chain', 'driven', 'closed_loop'):
        drawn = [draw_scenario(np.random.default_rng([s, 9]), kind) for s in range(150)]
        if kind == 'closed_loop':  # an encoder has steps in any case
            assert all(s.colours for s in drawn)
            share = np.mean([bool(c.poles) for s in drawn for c in s.colours.values()]) * 1.5
        else:
            share = np.mean([bool(s.colours) for s in drawn])
        assert 0.2 < share < 0.47


def test_slow_noise_hides_what_is_slow_and_shows_what_is_quick():
    """An offset drowns in slow noise of the same size, a hum stands out of it."""
    scenario = replace(draw_scenario(np.random.default_rng(3), 'chain'), colours={})
    slow = Colour(0.0, (math.exp(-2 * math.pi * 0.01),), (1.0,))
    name = scenario.channels[0]
    coloured = replace(scenario, colours={name: slow})
    for key, change, quieter in (('offset', {'offset': 0.5}, False), ('hum', {}, True)):
        if key == 'hum':
            change = {'hum': 0.05, 'hum_frequency': 0.2 * scenario.rates[name]}
        sizes = [
            Freedom(s).detectability(s.with_chain(name, **change)) for s in (scenario, coloured)
        ]
        assert (sizes[1] > 3 * sizes[0]) if quieter else (sizes[1] < 0.5 * sizes[0])


def test_steps_that_are_concealed_are_as_visible_as_wanted_in_any_noise():
    """d'^2 is half the sum of (rise of the density over the density)^2."""
    scenario = replace(draw_scenario(np.random.default_rng(3), 'chain'), colours={})
    name = scenario.channels[0]
    colour = draw_colour(np.random.default_rng(0), 'flicker')
    coloured = replace(scenario, colours={name: colour})
    chosen = effect('quantisation')
    step, size = solve_strength(Freedom(coloured), chosen, {'channel': name}, 5.0)
    assert size == 5.0
    count = sum(math.ceil(b.duration * scenario.rates[name]) for b in scenario.blows)
    f = (np.arange(count // 2) + 0.5) / count
    rise = step**2 / 12 / scenario.noise[name] ** 2 / spectrum(colour, f)
    assert math.sqrt(np.sum(rise**2)) == pytest.approx(5.0, rel=0.02)


@pytest.mark.parametrize('kind', list(KINDS))
def test_measured_noise_has_its_colour(kind):
    scenario = draw_scenario(np.random.default_rng(12), kind)
    blow, name = scenario.blows[0], scenario.channels[0]
    colour = Colour(0.0, (0.9,), (1.0,), 0.5)
    scenario = replace(scenario, colours={name: colour})
    samples = measure(blow, scenario, np.random.default_rng(1))[name]
    left = samples - noise_free(blow, scenario)[name]
    assert np.std(left) / scenario.noise[name] == pytest.approx(math.sqrt(1 + 0.25 / 12), rel=0.3)
    assert np.corrcoef(left[1:], left[:-1])[0, 1] > 0.7


def test_to_name_the_steps_of_a_converter_is_no_finding():
    sealed = {
        'category': 'clean',
        'detectability': 0.0,
        'parts': [],
        'tolerated': ['quantisation'],
    }
    reply = {
        'mismatch': {'detected': True},
        'accepted': ['quantisation'],
        'ranking': [{'name': 'quantisation', 'probability': 0.9}],
    }
    assert not mark('c', sealed, reply, 1.0).finding
    assert mark('c', sealed | {'tolerated': []}, reply, 1.0).finding
    assert mark('c', sealed, reply | {'accepted': ['quantisation', 'offset']}, 1.0).finding
    assert mark('c', sealed, reply | {'unexplained': True}, 1.0).finding


@pytest.mark.parametrize('zero_phase', [False, True])
@pytest.mark.parametrize('order', [1, 2, 3])
@pytest.mark.parametrize('cutoff', [300.0, 5e3, 15e3, 200e3])
def test_a_filter_is_that_of_its_stated_corner_however_high_it_is(cutoff, order, zero_phase):
    """Analogue Butterworth: 1 / sqrt(1 + (f / f_c)^(2 n)), its phase once or not at all."""
    rate, frequency = 320e3, 1000.0
    t = np.arange(6400) / rate
    signal = np.sin(2.0 * np.pi * frequency * t)
    chain = Chain(cutoff=cutoff, order=order, zero_phase=zero_phase)
    late = slice(2560, 3840)  # whole periods, far from both ends
    turn = np.exp(-2j * np.pi * frequency * t[late])
    got = (_filtered(signal, chain, rate)[late] @ turn) / (signal[late] @ turn)
    above, below = butter(order, 1.0, analog=True)
    once = np.polyval(above, 1j * frequency / cutoff) / np.polyval(below, 1j * frequency / cutoff)
    assert got == pytest.approx(abs(once) ** 2 if zero_phase else once, abs=2e-4)


@pytest.mark.parametrize('order', [1, 2, 3, 4])
def test_a_recording_that_ends_in_motion_has_no_more_at_its_end_than_programs_leave(order):
    """At a finer rate, too, the end is continued for as long as the filter remembers."""
    rate, finer, cutoff = 25.6e3, 13, 2e3
    t = np.arange(int(0.05 * rate) * finer) / (rate * finer)
    signal = 8.0 * np.sin(2.0 * np.pi * 30.0 * t)
    chain = Chain(cutoff=cutoff, order=order, zero_phase=True)
    fine = _filtered(signal, chain, rate * finer, finer)[::finer]
    usual = sosfiltfilt(butter(order, cutoff, fs=rate, output='sos'), signal[::finer])
    last = slice(-20, None)
    apart = np.abs(fine - signal[::finer])[last].max()
    assert apart < 2.0 * np.abs(usual - signal[::finer])[last].max() + 1e-3
