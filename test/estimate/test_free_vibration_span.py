"""Choice of the span: blows made by driving the plate through a known contact force."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from impactscope.errors import EstimationError, InputError
from impactscope.estimate.free_vibration_span import choose_span

FREQUENCY, DAMPING = 32.3, 0.07
RATE = 1000.0


def oscillation(n, rate=RATE, amplitude=60.0, phase=-1.2, offset=2.0, damping=DAMPING):
    time = np.arange(n) / rate
    wn = 2 * math.pi * FREQUENCY
    wd = wn * math.sqrt(1 - damping**2)
    return amplitude * np.exp(-damping * wn * time) * np.cos(wd * time + phase) + offset


def reading(force, rate):
    """Spring force k x of the plate under a contact force (eq. 24), exact for held samples."""
    wn = 2 * math.pi * FREQUENCY
    wd = wn * math.sqrt(1 - DAMPING**2)
    e = math.exp(-DAMPING * wn / rate)
    c, s = math.cos(wd / rate), math.sin(wd / rate) * DAMPING * wn / wd
    b1, b2 = 1 - e * (c + s), e * e + e * (s - c)
    return lfilter([0, b1, b2], [1, -2 * e * c, e * e], force)


def tap(contact_time, peak, rate=10_000.0, every=10, begin=0.1, duration=1.6):
    """Half-sine contact beginning at ``begin``; the reading at rate / every."""
    time = np.arange(int(duration * rate)) / rate
    inside = (time > begin) & (time < begin + contact_time)
    force = np.where(inside, peak * np.sin(math.pi * (time - begin) / contact_time), 0)
    return reading(force, rate)[::every]


def errors(vibration):
    """Of frequency and damping ratio, in standard uncertainties."""
    frequency, damping = vibration.fit.natural_frequency, vibration.fit.damping_ratio
    return (
        (frequency.value - FREQUENCY) / frequency.std,
        (damping.value - DAMPING) / damping.std,
    )


def test_span_begins_where_contact_ended_and_ends_at_the_noise():
    rng = np.random.default_rng(1)
    y = oscillation(3000) + 0.6 * rng.normal(size=3000)
    vibration = choose_span(np.r_[np.linspace(0, 90, 100), y], RATE, earliest=0.1)
    assert vibration.consistent
    assert vibration.start == 100
    # 60 N fall to a tenth of 0.6 N in ln(1000) decay times.
    end = math.log(1000) / (DAMPING * 2 * math.pi * FREQUENCY) * RATE
    assert vibration.stop - vibration.start == pytest.approx(end, rel=0.05)
    assert vibration.fit.n_samples == vibration.stop - vibration.start


def test_nothing_beyond_latest_is_used():
    y = oscillation(1000) + 0.1 * np.random.default_rng(2).normal(size=1000)
    y[400:] += 500
    vibration = choose_span(y, RATE, earliest=0.0, latest=0.4)
    assert vibration.consistent
    assert vibration.stop <= 400


def test_noise_free_record():
    vibration = choose_span(oscillation(1000), RATE, earliest=0.0)
    assert vibration.consistent
    assert vibration.fit.damping_ratio.value == pytest.approx(DAMPING, abs=1e-9)


@pytest.mark.parametrize('decibel', [40, 20, 10])
def test_linear_vibration_is_rarely_doubted_and_well_covered(decibel):
    rng = np.random.default_rng(decibel)
    noise = 60 / 10 ** (decibel / 20)
    z, doubted = [], 0
    for _ in range(250):
        v = choose_span(oscillation(1000) + noise * rng.normal(size=1000), RATE, earliest=0.0)
        doubted += not (v.consistent and v.start == 0)
        z.append(errors(v))
    assert doubted <= 5
    covered = np.mean(np.abs(z) < 1.96, axis=0)
    assert (covered > 0.90).all()


@pytest.mark.parametrize('noise', [0.1, 0.5])
@pytest.mark.parametrize(('contact_time', 'peak'), [(0.005, 400), (0.02, 150), (0.1, 100)])
def test_unknown_contact_end_is_found(contact_time, peak, noise):
    """The paper's case: a hammer tap, and longer pushes whose largest force is contact."""
    rng = np.random.default_rng(3)
    clean = tap(contact_time, peak)
    z = []
    for _ in range(25):
        vibration = choose_span(clean + noise * rng.normal(size=clean.size), RATE)
        assert vibration.consistent
        assert vibration.start / RATE >= 0.1 + contact_time
        z.append(errors(vibration))
    assert np.abs(z).max() < 5
    assert np.sqrt(np.mean(np.square(z))) < 1.6


def test_contact_that_cannot_be_told_from_vibration_is_refused():
    """After so long a push 2 N of noise leave nothing of the vibration."""
    rng = np.random.default_rng(4)
    clean = tap(0.3, 100)
    for _ in range(10):
        with pytest.raises(EstimationError):
            choose_span(clean + 2 * rng.normal(size=clean.size), RATE)


@pytest.mark.parametrize('at', [0.01, 0.05])
def test_span_excludes_an_unnoticed_second_blow(at):
    """A kick starts the vibration anew: only what follows it is free."""
    rng = np.random.default_rng(5)
    time = np.arange(1000) / RATE
    wn = 2 * math.pi * FREQUENCY
    wd = wn * math.sqrt(1 - DAMPING**2)
    kick = np.exp(-DAMPING * wn * (time - at)) * np.sin(wd * (time - at))
    clean = oscillation(1000) + np.where(time > at, 15 * kick, 0)
    z = []
    for _ in range(25):
        vibration = choose_span(clean + 0.1 * rng.normal(size=1000), RATE, earliest=0.0)
        assert vibration.consistent
        assert vibration.start / RATE > at - 0.002
        z.append(errors(vibration))
    assert np.sqrt(np.mean(np.square(z))) < 1.6


def test_drift_at_the_end_does_not_spoil_the_fit():
    rng = np.random.default_rng(6)
    drift = np.r_[np.zeros(700), 20 * np.linspace(0, 1, 1300)]
    y = oscillation(2000) + drift + 0.2 * rng.normal(size=2000)
    vibration = choose_span(y, RATE, earliest=0.0)
    assert vibration.consistent
    assert vibration.stop <= 720
    assert np.abs(errors(vibration)).max() < 4


def test_damping_that_depends_on_amplitude_is_inconsistent():
    """Quadratic damping, made by the slowly varying amplitude of a weakly damped plate."""
    time = np.arange(2000) / RATE
    decay = 4.0
    envelope = 60 / ((1 + 1.5) * np.exp(decay * time) - 1.5)
    wave = envelope * np.cos(2 * math.pi * FREQUENCY * time)
    y = wave + 0.1 * np.random.default_rng(7).normal(size=2000)
    assert not choose_span(y, RATE, earliest=0.0).consistent


def test_coloured_noise_does_not_hide_a_contact():
    """A residual that is oscillation must not pass for coloured noise."""
    clean = tap(0.1, 100)
    rng = np.random.default_rng(8)
    vibration = choose_span(clean + 0.05 * rng.normal(size=clean.size), RATE)
    assert vibration.start / RATE >= 0.2
    assert abs(vibration.fit.natural_frequency.value - FREQUENCY) < 0.1


def test_noise_is_no_vibration():
    rng = np.random.default_rng(9)
    for _ in range(60):
        with pytest.raises(EstimationError):
            choose_span(rng.normal(size=1000), RATE, earliest=0.0)


def test_strong_damping_needs_the_contact_end():
    y = np.r_[np.zeros(50), oscillation(500, damping=0.5)]
    y += 0.1 * np.random.default_rng(10).normal(size=550)
    with pytest.raises(EstimationError, match='contact'):
        choose_span(y, RATE)
    assert choose_span(y, RATE, earliest=0.05).fit.damping_ratio.value == pytest.approx(
        0.5, abs=0.02
    )


@pytest.mark.parametrize('earliest', [-0.1, 1.5, math.nan])
def test_times_outside_the_record_are_refused(earliest):
    with pytest.raises(InputError, match='outside'):
        choose_span(oscillation(1000), RATE, earliest=earliest)


def test_nothing_after_the_contact():
    with pytest.raises(EstimationError, match='samples remain'):
        choose_span(oscillation(1000), RATE, earliest=0.995)
