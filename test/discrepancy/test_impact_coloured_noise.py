"""Noise that is not white: what is seen of it in quiet, and residuals whitened with it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.campaign import Campaign, ChannelSamples
from impactscope.discrepancy.impact.data.blows import (
    _about_release,
    _first_sight,
    _onset,
    _steady,
    prepare,
)
from impactscope.discrepancy.impact.findings.figures import rmse
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.models.baseline import baseline_model
from impactscope.discrepancy.impact.noise import coloured_noise as noise_module
from impactscope.discrepancy.impact.noise.coloured_noise import Colour, colour_of
from impactscope.discrepancy.impact.noise.whitening import whitener
from impactscope.physics.twin.measurement import coloured_noise

Array = NDArray[np.float64]
RATE = 5000.0


def remembering(share: float, count: int, rng: np.random.Generator) -> Array:
    """Noise of which each sample keeps a share of the one before; of unit variance."""
    fresh = rng.standard_normal(count + 500) * np.sqrt(1 - share**2)
    return np.asarray(signal.lfilter([1.0], [1.0, -share], fresh)[500:])


def test_white_noise_is_white() -> None:
    rng = np.random.default_rng(4)
    seen = [colour_of([rng.standard_normal(900) for _ in range(3)], RATE) for _ in range(60)]
    assert sum(colour is not None for colour in seen) <= 1


def test_weak_colour_is_believed_beside_another_channel_that_has_some() -> None:
    rng = np.random.default_rng(41)
    faint = [
        [rng.standard_normal(400) + 0.5 * remembering(0.7, 400, rng) for _ in range(3)]
        for _ in range(30)
    ]
    alone = sum(colour_of(quiet, RATE) is not None for quiet in faint)
    beside = sum(colour_of(quiet, RATE, beside=True) is not None for quiet in faint)
    assert alone + 4 <= beside


def test_a_hum_is_no_noise() -> None:
    rng = np.random.default_rng(5)
    time = np.arange(1500) / RATE
    quiet = [
        rng.standard_normal(time.size) + 0.3 * np.sin(2 * np.pi * 50.0 * time + phase)
        for phase in rng.uniform(0.0, 6.0, 5)
    ]
    found = colour_of(quiet, RATE)
    assert found is None or found.white > 0.9 * found.std**2


@pytest.mark.parametrize('share', [0.3, 0.9])
def test_remembering_noise_is_seen_and_whitened(share: float) -> None:
    rng = np.random.default_rng(6)
    found = colour_of([remembering(share, 1200, rng) for _ in range(6)], RATE)
    assert found is not None
    assert found.std == pytest.approx(1.0, rel=0.25)
    counts = np.concatenate([np.full(40, 20), np.full(3000, 1), np.full(30, 20)]).astype(np.int64)
    edges = np.concatenate([[0], np.cumsum(counts)[:-1]])
    centres = (edges + 0.5 * (counts - 1)) / RATE
    std = np.sqrt(found.variance_of_means(counts))
    white = whitener(found, centres, counts, std)
    left = []
    for _ in range(8):
        samples = remembering(share, int(np.sum(counts)), rng)
        left.append(white(np.add.reduceat(samples, edges) / counts / std))
    rows = np.stack(left)
    assert float(np.mean(rows**2)) == pytest.approx(1.0, abs=0.12)
    assert abs(float(np.mean(rows[:, 1:] * rows[:, :-1]))) < 0.05


@pytest.mark.parametrize('size', [30, 60])
def test_short_stretches_tell_the_colour_together(size: int) -> None:
    rng = np.random.default_rng(62)
    for share in (0.8, 0.92):
        found = colour_of([remembering(share, size, rng) for _ in range(7)], RATE)
        assert found is not None
        assert found.fresh == pytest.approx(np.sqrt(1.0 - share**2), rel=0.3)
        assert found.std > 0.5  # slower noise is not ruled out


def test_lines_that_tell_the_same_are_taken_together(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(61)
    quiet = [rng.standard_normal(6000) + 0.7 * remembering(0.96, 6000, rng) for _ in range(5)]
    found = colour_of(quiet, RATE)
    monkeypatch.setattr(noise_module, '_LINES', 10**6)  # each line on its own
    whole = colour_of(quiet, RATE)
    assert found is not None
    assert whole is not None
    assert found.white == pytest.approx(whole.white, rel=1e-3)
    np.testing.assert_allclose(found.times, whole.times)
    np.testing.assert_allclose(found.variances, whole.variances, atol=2e-3)


def test_slow_noise_does_not_pass_for_a_drift() -> None:
    rng = np.random.default_rng(7)
    found = colour_of([coloured_noise(5000, 1.0, rng)[:1000] for _ in range(6)], RATE)
    assert found is not None
    counts = np.ones(5000, dtype=np.int64)
    centres = np.arange(5000) / RATE
    std = np.sqrt(found.variance_of_means(counts))
    white = whitener(found, centres, counts, std)
    drift = white(centres / std)
    power = [
        float(drift @ white(coloured_noise(5000, 1.0, rng) / std)) ** 2 / float(drift @ drift)
        for _ in range(30)
    ]
    assert float(np.mean(power)) < 2.5


def test_whitening_is_that_of_the_covariance_whatever_the_bins() -> None:
    colour = Colour(0.2, np.array([0.5, 0.3, 0.4]), np.array([0.7, 6.0, 400.0]) / RATE, RATE)
    counts = np.array([4] * 5 + [1] * 20 + [3] * 6 + [1] * 5 + [10] * 4)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    first[30:] += 37  # samples that are not used
    lags = np.abs(np.subtract.outer(*[np.arange(first[-1] + counts[-1])] * 2))
    forgotten = np.exp(-lags[None] / (colour.times * RATE)[:, None, None])
    samples = np.tensordot(colour.variances, forgotten, 1) + 0.2 * np.eye(lags.shape[0])
    means = np.zeros((counts.size, lags.shape[0]))
    for row, begin, count in zip(means, first, counts, strict=True):
        row[begin : begin + count] = 1.0 / count
    covariance = means @ samples @ means.T
    std = np.sqrt(np.diag(covariance))
    white = whitener(colour, (first + 0.5 * (counts - 1)) / RATE, counts, std)
    rows = white(np.eye(counts.size))
    left = rows @ (covariance / np.outer(std, std)) @ rows.T
    assert np.allclose(left, np.eye(counts.size), atol=1e-9)


def test_levels_that_differ_tell_slow_noise_that_no_stretch_shows() -> None:
    rng = np.random.default_rng(9)
    plain = [rng.standard_normal(400) for _ in range(7)]
    apart = [x + 0.4 * rng.standard_normal() for x in plain]
    assert colour_of(plain, RATE) is None
    found = colour_of(apart, RATE)
    assert found is not None
    level = math.sqrt(float(found.variance_of_means(np.array([400]))[0]))
    assert 0.2 < level < 0.8


@pytest.mark.parametrize('bent', [True, False])
def test_what_short_stretches_hide_of_one_over_f_noise_is_not_taken_for_none(bent: bool) -> None:
    """Of few spectra the slowest part that is seen may be none by chance: what hides is not."""
    count = 400
    truth = Colour(0.64, np.full(13, 0.17**2), 0.5 * 2.0 ** np.arange(13), 1.0)
    expected = truth.variance_of_means(np.array([count]))[0]
    keep = np.exp(-1.0 / truth.times)
    shares = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        quiet = []
        for n in (294, 183, 227, 407, 274, 143, 124, 445, 173, 384, 79, 484):
            made = 0.8 * rng.standard_normal(n)
            for k in keep:
                fresh = rng.standard_normal(n) * math.sqrt(1.0 - k**2)
                fresh[0] /= math.sqrt(1.0 - k**2)
                made += 0.17 * signal.lfilter([1.0], [1.0, -k], fresh)
            since = np.linspace(-1.0, 1.0, n)
            quiet.append(made - bent * np.polyval(np.polyfit(since, made, 3), since))
        found = colour_of(quiet, 1.0, bent=bent)
        assert found is not None
        shares.append(found.variance_of_means(np.array([count]))[0] / expected)
    assert min(shares) > 0.3
    assert 0.7 < float(np.median(shares)) < 4.0


def test_a_level_that_all_share_is_no_noise() -> None:
    rng = np.random.default_rng(10)
    assert colour_of([5.0 + rng.standard_normal(400) for _ in range(7)], RATE) is None


def test_levels_rule_out_slow_noise_that_stretches_are_too_short_to_show() -> None:
    long = np.array([6000])  # as far as an offset of a recording can be told from noise
    told, tared, true = [], [], 3.0 / 6000
    for seed in range(12):
        rng = np.random.default_rng(500 + seed)
        quiet = [remembering(0.5, 1200, rng) for _ in range(7)]
        for into, stretches in ((told, quiet), (tared, [s - np.mean(s) for s in quiet])):
            colour = colour_of(stretches, RATE)
            assert colour is not None
            into.append(float(colour.variance_of_means(long)[0]))
    assert np.median(told) < 10 * true
    assert np.median(told) < 0.3 * np.median(tared)  # that levels were set to zero tells nothing


def test_levels_of_slow_noise_do_not_rule_it_out() -> None:
    long = np.array([6000])
    times = np.geomspace(1.0, 20_000.0, 10) / RATE  # one over f, from sample to recording
    noise = Colour(0.2, np.full(10, 0.1), times, RATE)
    ratio = []
    for seed in range(12):
        rng = np.random.default_rng(900 + seed)
        quiet = [
            math.sqrt(0.2) * rng.standard_normal(1200)
            + math.sqrt(0.1)
            * sum(remembering(math.exp(-1 / life), 1200, rng) for life in times * RATE)
            for _ in range(7)
        ]
        colour = colour_of(quiet, RATE)
        assert colour is not None
        ratio.append(float(colour.variance_of_means(long)[0] / noise.variance_of_means(long)[0]))
    assert np.median(ratio) > 0.6
    assert np.quantile(ratio, 0.1) > 0.25


def test_a_robot_that_comes_steadily_has_no_swing() -> None:
    rng = np.random.default_rng(11)
    steady = remembering(0.5, 1200, rng)
    speeding_up = steady + 8.0 * np.hanning(1200)
    for before, expected in ((steady, True), (speeding_up, False)):
        assert _steady(before, _about_release(before)) is expected


def test_variance_of_means_of_one_part_in_closed_form() -> None:
    colour = Colour(0.0, np.array([2.0]), np.array([3.0 / RATE]), RATE)
    rho = np.exp(-1.0 / 3.0)
    found = colour.variance_of_means(np.array([1, 2, 3]))
    expected = [2.0, 2.0 * (1 + rho) / 2, 2.0 * (3 + 4 * rho + 2 * rho**2) / 9]
    assert found == pytest.approx(expected)


def test_columns_are_whitened_as_rows_are() -> None:
    colour = Colour(0.5, np.array([0.5]), np.array([5.0 / RATE]), RATE)
    counts = np.ones(200, dtype=np.int64)
    white = whitener(colour, np.arange(200) / RATE, counts, np.ones(200))
    rows = np.random.default_rng(8).standard_normal((200, 3))
    assert np.allclose(white(rows)[:, 1], white(rows[:, 1]))


def test_slow_noise_is_not_the_onset_of_a_blow() -> None:
    rng = np.random.default_rng(11)
    rate = 2000.0
    noise = signal.lfilter([1.0], [1.0, -0.95], rng.standard_normal(3000))
    quiet = ChannelSamples('acceleration.base', 'm/s^2', rate, 0.0, noise)
    assert _onset([quiet]) is None
    struck = noise.copy()
    struck[1200:1240] += 400.0 * np.sin(np.linspace(0.0, np.pi, 40))
    blow = ChannelSamples('force', 'N', rate, 0.0, struck)
    assert _onset([quiet, blow]) == pytest.approx(0.6, abs=3e-3)


def test_a_base_has_no_say_in_when_a_blow_begins_that_others_see() -> None:
    rng = np.random.default_rng(5)
    wanders = rng.normal(size=4000) * 0.01
    wanders[500:] += 1.0
    struck = rng.normal(size=4000) * 0.01
    struck[2000:2050] += 100.0
    force = ChannelSamples('force', 'N', RATE, 0.0, struck)
    base = ChannelSamples('acceleration.base', 'm/s^2', RATE, 0.0, wanders)
    assert _onset([base]) == pytest.approx(500 / RATE, abs=1e-3)  # what it would be taken for
    found = _first_sight({'force': force, 'acceleration.base': base})
    assert found == pytest.approx(2000 / RATE, abs=1e-3)
    struck_base = ChannelSamples('acceleration.base', 'm/s^2', RATE, 0.0, struck)
    assert _first_sight({'acceleration.base': struck_base}) == pytest.approx(found, abs=1e-3)


@pytest.mark.parametrize('share', [0.0, 0.9])
def test_errors_are_those_of_samples_and_the_floor_what_the_quiet_shows(
    make_campaign: Callable[..., Campaign], share: float
) -> None:
    """Whether the noise is white or not a perfect model's RMSE is the noise of a sample."""
    rng = np.random.default_rng(8)
    campaign = make_campaign(41)

    def added(count: int) -> Array:
        drawn = remembering(share, count, rng)
        return np.asarray(drawn / np.sqrt(np.mean(drawn**2)))

    size = {'force': 1.0, 'acceleration.plate': 0.3, 'acceleration.impactor': 0.4}
    recordings = tuple(
        dataclasses.replace(
            r,
            channels={
                n: dataclasses.replace(
                    c, values=c.values + size.get(n, 0.2) * added(c.values.size)
                )
                for n, c in r.channels.items()
            },
        )
        for r in campaign.recordings
    )
    noisy = dataclasses.replace(campaign, recordings=recordings)
    data = prepare(noisy)
    errors = rmse(fit_baseline(baseline_model(noisy, data)))
    assert len(errors) == 4
    for name, error in errors.items():
        true = math.hypot(0.4 if name == 'force' else 0.08, size.get(name, 0.2))
        # of samples that remember, 19 tell as much as one: of 2,600, and of 900 before the blows
        assert error == pytest.approx(true, rel=0.2 if share else 0.05)
        assert data.noise_floor[name] == pytest.approx(true, rel=0.25 if share else 0.08)
