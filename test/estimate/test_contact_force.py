import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import EstimationError, InputError
from impactscope.estimate.contact_force import (
    contact_force_by_inversion,
    contact_force_from_acceleration,
    find_peak,
    plate_velocity,
)
from impactscope.physics.sensor_model import PAPER_SENSOR as SENSOR
from impactscope.physics.shock_response import half_sine_response, peak_ratio
from impactscope.records import Estimate

PEAK = 150.0
FORCE_NOISE, ACCELERATION_NOISE = 0.4, 0.08
W, ZETA = SENSOR.natural_angular_frequency, SENSOR.damping_ratio
EXACT = {
    'mass': Estimate(SENSOR.mass, 0.0),
    'damping_constant': Estimate(SENSOR.damping_constant, 0.0),
    'stiffness': SENSOR.stiffness,
}
MODAL = {
    'natural_frequency': Estimate(SENSOR.natural_frequency, 0.0),
    'damping_ratio': Estimate(ZETA, 0.0),
}


def half_sine(contact, rate, seed=0, after=0.4):
    """Time, contact force, reading, plate acceleration; noise-free, contact at 0.1 s and a bit."""
    start = 0.1 + np.random.default_rng(seed).uniform(0, 1 / rate)
    time = np.arange(0, start + contact + after, 1 / rate)
    t = time - start
    force = np.where((t > 0) & (t < contact), PEAK * np.sin(np.pi * t / contact), 0.0)
    reading = PEAK * half_sine_response(t, contact, SENSOR)
    step = 1e-6
    rate_of = (
        half_sine_response(t + step, contact, SENSOR)
        - half_sine_response(t - step, contact, SENSOR)
    ) / (2 * step)
    damping = SENSOR.damping_constant * PEAK * rate_of / SENSOR.stiffness
    return time, force, reading, (force - reading - damping) / SENSOR.mass


@pytest.mark.parametrize('contact', [3e-3, 8.6e-3, 25e-3, 0.1, 0.5])
def test_accelerometer_gives_the_peak_within_two_per_cent(contact):
    rng = np.random.default_rng(3)
    for seed in range(8):
        _, force, reading, plate = half_sine(contact, 10e3, seed)
        found = contact_force_from_acceleration(
            reading + rng.normal(0, FORCE_NOISE, reading.size),
            plate + rng.normal(0, ACCELERATION_NOISE, plate.size),
            10e3,
            force_noise=FORCE_NOISE,
            acceleration_noise=ACCELERATION_NOISE,
            **EXACT,
        )
        assert found.peak.value.value == pytest.approx(PEAK, rel=0.02)
        assert abs(found.peak.value.value - PEAK) < 4 * found.peak.value.std + 3e-4 * PEAK
        assert np.mean(np.abs(found.force - force) < 1.96 * found.std) > 0.93
        expected = peak_ratio(ZETA, contact * SENSOR.natural_frequency) - 1
        assert found.reading_error.value == pytest.approx(expected, abs=0.015)


def test_the_band_of_a_wrong_mass_covers_it():
    _, force, reading, plate = half_sine(8e-3, 10e3)
    found = contact_force_from_acceleration(
        reading,
        plate,
        10e3,
        mass=Estimate(1.03 * SENSOR.mass, 0.03 * SENSOR.mass),
        damping_constant=EXACT['damping_constant'],
        stiffness=SENSOR.stiffness,
        force_noise=0.01,
        acceleration_noise=0.01,
    )
    away = np.abs(found.force - force)
    assert away.max() > 1.0
    assert (away < 1.1 * found.std + 0.05).all()


@pytest.mark.parametrize(
    ('contact', 'tolerance'), [(5e-3, 0.15), (10e-3, 0.08), (25e-3, 0.03), (0.1, 0.01)]
)
def test_inversion_is_honest_without_accelerometer(contact, tolerance):
    rng = np.random.default_rng(4)
    scores, covered = [], []
    for seed in range(20):
        time, force, reading, _ = half_sine(contact, 5e3, seed, after=0.06)
        found = contact_force_by_inversion(
            reading + rng.normal(0, FORCE_NOISE, reading.size),
            5e3,
            force_noise=FORCE_NOISE,
            spans=((0.098, 0.102 + contact),),
            **MODAL,
        )
        inside = (time > 0.1) & (time < 0.1 + contact)
        scores.append((found.peak.value.value - PEAK) / found.peak.value.std)
        covered.append(np.mean(np.abs(found.force - force)[inside] < 1.96 * found.std[inside]))
        assert found.peak.value.value == pytest.approx(PEAK, rel=tolerance)
    assert np.mean(covered) > 0.88
    assert np.mean(np.abs(scores) < 1.96) > 0.85


def test_inversion_beats_the_reading_where_the_sensor_lies_most():
    rng = np.random.default_rng(6)
    _, _, reading, _ = half_sine(25e-3, 5e3, after=0.06)
    noisy = reading + rng.normal(0, FORCE_NOISE, reading.size)
    found = contact_force_by_inversion(
        noisy, 5e3, force_noise=FORCE_NOISE, spans=((0.098, 0.127),), **MODAL
    )
    assert abs(noisy.max() / PEAK - 1) > 0.55
    assert abs(found.peak.value.value / PEAK - 1) < 0.03
    assert found.reading_error.value == pytest.approx(0.60, abs=0.04)


@pytest.mark.parametrize('ratio', [0.85, 0.9, 1.1])
def test_inversion_with_the_wrong_sensor_widens_its_band_or_refuses(ratio):
    _, _, reading, _ = half_sine(25e-3, 5e3, after=0.2)
    noisy = reading + np.random.default_rng(0).normal(0, FORCE_NOISE, reading.size)
    arguments = {'force_noise': FORCE_NOISE, 'spans': ((0.098, 0.127),)}
    right = contact_force_by_inversion(noisy, 5e3, **arguments, **MODAL)
    off = Estimate(ratio * SENSOR.natural_frequency, 0.0)
    try:
        wrong = contact_force_by_inversion(
            noisy, 5e3, natural_frequency=off, damping_ratio=MODAL['damping_ratio'], **arguments
        )
    except EstimationError:
        return
    assert wrong.peak.value.std > 5 * right.peak.value.std
    assert abs(wrong.peak.value.value - PEAK) < 3 * wrong.peak.value.std


@pytest.mark.parametrize('contact', [3e-4, 6e-4, 1e-3])
def test_a_blow_too_short_to_resolve_gets_no_number(contact):
    rng = np.random.default_rng(0)
    for seed in range(5):
        _, _, reading, _ = half_sine(contact, 10e3, seed, after=0.05)
        noisy = 12 * reading + rng.normal(0, FORCE_NOISE, reading.size)
        with pytest.raises(EstimationError, match='too short'):
            contact_force_by_inversion(
                noisy, 10e3, force_noise=FORCE_NOISE, spans=((0.097, 0.115),), **MODAL
            )


def test_two_contacts_are_two_forces():
    time, force, reading, _ = half_sine(20e-3, 5e3, after=0.15)
    shift = 400
    force = force + 0.5 * np.concatenate((np.zeros(shift), force[:-shift]))
    reading = reading + 0.5 * np.concatenate((np.zeros(shift), reading[:-shift]))
    reading += np.random.default_rng(1).normal(0, 0.1, reading.size)
    spans = ((0.099, 0.121), (0.179, 0.201))
    found = contact_force_by_inversion(reading, 5e3, force_noise=0.1, spans=spans, **MODAL)
    assert np.abs(found.force - force).max() < 6
    assert (found.force[(time > 0.13) & (time < 0.17)] == 0).all()


def test_velocity_joins_both_signals():
    rate = 5e3
    time = np.arange(0, 2, 1 / rate)
    w = 2 * np.pi * 2.0
    x = 1e-3 * (1 - np.cos(w * time))  # slow, at rest at both ends
    x += 1e-5 * (1 - np.cos(40 * w * time))
    v = 1e-3 * w * np.sin(w * time) + 4e-4 * w * np.sin(40 * w * time)
    a = 1e-3 * w * w * np.cos(w * time) + 1.6e-2 * w * w * np.cos(40 * w * time)
    rng = np.random.default_rng(2)
    sx, sa = 6e-6, 0.1
    found, std = plate_velocity(
        x + rng.normal(0, sx, x.size),
        a + rng.normal(0, sa, a.size),
        rate,
        sx / np.sqrt(rate / 2),
        sa / np.sqrt(rate / 2),
    )
    error = (found - v)[500:-500]
    assert np.std(error) == pytest.approx(std, rel=0.3)
    derivative = np.gradient(x + rng.normal(0, sx, x.size), 1 / rate) - v
    assert std < np.std(derivative) / 10


@settings(max_examples=50, deadline=None)
@given(st.floats(1, 1e3), st.floats(-0.4, 0.4), st.integers(60, 600))
def test_peak_of_a_parabola_is_exact(height, shift, n):
    t = np.linspace(-1, 1, n)
    rate = (n - 1) / 2
    peak = find_peak(height * (1 - (t - shift) ** 2), rate, 0.0)
    assert peak.value.value == pytest.approx(height, rel=1e-9)
    assert peak.time.value == pytest.approx(1 + shift, abs=1e-6)


def test_peak_is_not_lifted_by_noise():
    rng = np.random.default_rng(0)
    t = np.arange(5000) / 10e3
    peaks = [
        find_peak(100 * np.sin(np.pi * t / 0.5) + rng.normal(0, 1, t.size), 10e3, 1.0)
        for _ in range(60)
    ]
    z = [(p.value.value - 100) for p in peaks]
    assert abs(np.mean(z)) < 0.06
    assert np.std(z) == pytest.approx(peaks[0].value.std, rel=0.35)


def test_short_peaks_are_their_largest_sample():
    peak = find_peak([0.0, 1.0, 5.0, 1.0, 0.0], 1e3, 0.1)
    assert peak.value == (5.0, 0.1)
    assert peak.time.value == pytest.approx(2e-3)


def test_bad_input_is_refused():
    y = np.ones(100)
    with pytest.raises(InputError, match='differ'):
        contact_force_from_acceleration(
            y, y[:50], 1e3, force_noise=1, acceleration_noise=1, **EXACT
        )
    with pytest.raises(InputError, match='mass is nan'):
        contact_force_from_acceleration(
            y, y, 1e3, force_noise=1, acceleration_noise=1, **{**EXACT, 'mass': Estimate()}
        )
    with pytest.raises(InputError, match='finite'):
        contact_force_by_inversion(np.full(100, np.nan), 1e3, force_noise=1.0, **MODAL)
    with pytest.raises(InputError, match='sample rate'):
        contact_force_by_inversion(y, 0.0, force_noise=1.0, **MODAL)
    with pytest.raises(InputError, match='known'):
        contact_force_by_inversion(
            y, 1e3, force_noise=1, natural_frequency=Estimate(), damping_ratio=Estimate()
        )
    with pytest.raises(InputError, match='spans'):
        contact_force_by_inversion(9 * y, 1e3, force_noise=1, spans=((5.0, 6.0),), **MODAL)
    with pytest.raises(EstimationError, match='noise'):
        contact_force_by_inversion(y, 1e3, force_noise=1.0, **MODAL)
    with pytest.raises(InputError, match='peak'):
        find_peak([], 1.0, 1.0)
