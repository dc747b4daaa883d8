import functools
import math

import numpy as np
import pytest

from impactscope.errors import InputError
from impactscope.estimate.equivalent_mass import contact_spans, estimate_equivalent_mass
from impactscope.physics.pendulum import Pendulum
from impactscope.physics.sensor_model import PAPER_SENSOR as SENSOR
from impactscope.records import Estimate

RATE = 1000.0
KNOWN = {
    'stiffness': Estimate(SENSOR.stiffness, 0.0),
    'sensor_frequency': Estimate(SENSOR.natural_frequency, 0.0),
}
PLASTIC = 1e-9


@functools.cache
def blow(distance, angle=10.0, duration=1.2):
    """Reading and plate acceleration of a pendulum that sticks, leaves and comes back plastically.

    Rigid contact, exact in its two regimes but for the step: together while the force between
    plate and pendulum is positive, apart otherwise.
    """
    pendulum = Pendulum(mass_distance=distance)
    mass, weight = pendulum.equivalent_mass, pendulum.contact_weight()
    m, c, k = SENSOR.mass, SENSOR.damping_constant, SENSOR.stiffness
    x = y = 0.0
    v = u = pendulum.impact_speed(math.radians(angle)) * mass / (mass + m)
    step, every = 2e-5, 50
    together = True
    reading, acceleration = [], []
    for i in range(int(duration / step)):
        pull = -k * x - c * v
        if together:
            a = (weight + pull) / (m + mass)
            together = weight - mass * a > 0
        if not together:
            a = pull / m
        if i % every == 0:
            reading.append(k * x)
            acceleration.append(a)
        v += a * step
        x += v * step
        if together:
            u, y = v, x
        else:
            u += weight / mass * step
            y += u * step
            if y >= x and u > v - PLASTIC:
                together = True
                v = u = (m * v + mass * u) / (m + mass)
                y = x
    quiet = [0.0] * 100
    return np.array(quiet + reading), np.array(quiet + acceleration)


def noisy(distance, seed=0, noise=0.3, **case):
    force = blow(distance, **case)[0]
    return force + np.random.default_rng(seed).normal(0, noise, force.size)


@pytest.mark.parametrize('distance', [0.0, 0.05, 0.1, 0.15, 0.2, 0.25])
def test_all_positions_of_the_papers_figure(distance):
    found = estimate_equivalent_mass(noisy(distance), RATE, **KNOWN)
    pendulum = Pendulum(mass_distance=distance)
    assert found.valid, found.reason
    assert abs(found.mass.value - pendulum.equivalent_mass) < 4 * found.mass.std
    assert found.mass.value == pytest.approx(pendulum.equivalent_mass, rel=0.03)
    assert found.weight.value == pytest.approx(pendulum.contact_weight(), abs=0.15)


@pytest.mark.parametrize('distance', [0.0, 0.05, 0.25])
def test_a_long_record_at_rest_takes_nothing_away(distance):
    """Most of it is noise then; what rings before is told as well."""
    found = estimate_equivalent_mass(noisy(distance, duration=4.0), RATE, **KNOWN)
    assert found.valid, found.reason
    pendulum = Pendulum(mass_distance=distance)
    assert abs(found.mass.value - pendulum.equivalent_mass) < 4 * found.mass.std


def test_fitting_through_loss_of_contact_is_biased():
    for distance in (0.15, 0.2, 0.25):
        found = estimate_equivalent_mass(noisy(distance), RATE, **KNOWN)
        assert found.naive_bias < -0.1
        sure = found.total_mass.std / found.total_mass.value
        assert abs(found.naive_bias) > 20 * sure


def test_the_span_is_all_in_contact():
    force, acceleration = blow(0.25)
    found = estimate_equivalent_mass(noisy(0.25), RATE, **KNOWN)
    spans = contact_spans(force, acceleration, RATE, plate_mass=SENSOR.mass, threshold=0.5)
    assert len(spans) > 1  # it did leave
    assert any(a <= found.span[0] and b >= found.span[1] - 0.01 for a, b in spans)
    m, mass = SENSOR.mass, found.mass.value
    assert found.largest_swing == pytest.approx(found.weight.value * (1 + m / mass), rel=0.01)


def test_uncertainty_is_calibrated():
    truth = Pendulum(mass_distance=0.2).equivalent_mass
    rng = np.random.default_rng(3)
    scores = []
    for seed in range(100):
        k = rng.normal(SENSOR.stiffness, 690.0)
        f0 = rng.normal(SENSOR.natural_frequency, 0.05)
        found = estimate_equivalent_mass(
            noisy(0.2, seed),
            RATE,
            stiffness=Estimate(k, 690.0),
            sensor_frequency=Estimate(f0, 0.05),
        )
        scores.append((found.mass.value - truth) / found.mass.std)
    assert np.mean(np.abs(scores) < 1.96) > 0.9
    assert 0.7 < np.std(scores) < 1.25


def test_contact_spans_are_those_above_the_threshold():
    f = np.array([0.0, 5, 5, 0, 0, 5, 5])
    spans = contact_spans(f, np.zeros(7), 1.0, plate_mass=1.0, threshold=1.0)
    assert spans == [(1.0, 2.0), (5.0, 6.0)]
    with pytest.raises(InputError, match='differ'):
        contact_spans(f, f[:3], 1.0, plate_mass=1.0, threshold=1.0)


def test_what_cannot_be_told_is_unusable():
    rng = np.random.default_rng(0)
    time = np.arange(1000) / RATE
    alone = 60 * np.exp(-14 * time) * np.cos(203 * time)
    cases = [
        (alone + rng.normal(0, 0.3, 1000), 'stays on the plate'),
        (10 + rng.normal(0, 0.3, 1000), ''),
        (alone + 10 + rng.normal(0, 0.3, 1000), ''),  # weight, but swinging like the bare sensor
        (np.ones(5), 'too few'),
    ]
    for force, reason in cases:
        found = estimate_equivalent_mass(force, RATE, **KNOWN)
        assert not found.valid
        assert reason in found.reason
        assert math.isnan(found.mass.value)
    with pytest.raises(InputError, match='finite'):
        estimate_equivalent_mass(np.full(99, np.nan), RATE, **KNOWN)
    with pytest.raises(InputError, match='known'):
        estimate_equivalent_mass(
            alone, RATE, stiffness=Estimate(), sensor_frequency=Estimate(32.0, 0.1)
        )
