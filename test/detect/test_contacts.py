from __future__ import annotations

import numpy as np
import pytest

from impactscope.detect.contacts import ContactRules, find_contacts
from impactscope.detect.plate_motion import PlateModel, pulse_response

PLATE = PlateModel(203.2, 0.07)
RATE = 10_000.0
NOISE = 0.2
RULES = ContactRules(RATE, 3.0, 4, 200, NOISE, NOISE / 2)


def reading(*pulses, n=8000, seed=0):
    total = np.random.default_rng(seed).normal(0, NOISE, n)
    basis = np.empty((3, n))
    for start, duration, force in pulses:
        pulse_response(
            0.0, 1 / RATE, start, duration, PLATE.natural_frequency, PLATE.damping_ratio, basis
        )
        total += force * basis[0]
    return total


def test_ringing_is_no_contact_with_or_without_a_model():
    force = reading((0.1, 0.009, 100))
    assert len(find_contacts(force, 1030, RULES)) == 1
    (contact,) = find_contacts(force, 1030, RULES, PLATE)
    assert contact.start == pytest.approx(0.1, abs=2e-4)
    assert contact.end == pytest.approx(0.109, abs=3e-4)
    # The reading's peak comes after the contact has ended.
    assert contact.peak_time > 0.1 + 0.0085
    assert contact.peak_force == pytest.approx(force.max(), abs=1e-9)


def test_bounces_are_separated_even_where_the_reading_is_negative():
    pulses = ((0.1, 0.009, 100), (0.1225, 0.008, 60), (0.19, 0.01, 40))
    contacts = find_contacts(reading(*pulses), 1030, RULES, PLATE)
    assert len(contacts) == 3
    for contact, (start, duration, _) in zip(contacts, pulses, strict=True):
        assert contact.start == pytest.approx(start, abs=1e-3)
        assert contact.end == pytest.approx(start + duration, abs=1e-3)


def test_a_wrong_model_still_gives_the_blow():
    force = reading((0.1, 0.009, 100))
    contacts = find_contacts(force, 1030, RULES, PlateModel(900.0, 0.3))
    assert contacts[0].start == pytest.approx(0.1, abs=3e-3)
    assert contacts[0].peak_force > 60


def test_a_long_push_has_its_reading_for_limits():
    t = np.arange(30_000) / RATE
    push = np.interp(t, [0.1, 0.2, 2.0, 2.1], [0, 100, 100, 0])
    noise = np.random.default_rng(0).normal(0, NOISE, t.size)
    for plate in (None, PLATE):
        (contact,) = find_contacts(push + noise, 1100, RULES, plate)
        assert contact.start == pytest.approx(0.1, abs=0.005)
        assert contact.end == pytest.approx(2.1, abs=0.005)
        assert contact.impulse == pytest.approx(190, rel=0.01)


def test_a_reading_that_begins_in_the_ring_down_has_its_contact_inside():
    force = reading((0.1, 0.009, 100))[1085:]
    contacts = find_contacts(force, 0, RULES, PLATE)
    assert contacts[0].start == 0
    assert all(c.start < c.end for c in contacts)


@pytest.mark.parametrize('plate', [None, PLATE])
def test_a_weight_that_comes_to_rest_in_the_ring_down_is_a_contact(plate):
    t = np.arange(20_000) / RATE
    late = np.maximum(t - 0.15, 0)
    settled = 5 * (1 - np.exp(-20 * late) * np.cos(150 * late)) * (t > 0.15)
    force = reading((0.1, 0.009, 100), n=t.size) + settled
    contacts = find_contacts(force, 1030, RULES, plate)
    assert contacts[0].start == pytest.approx(0.1, abs=0.004)
    assert contacts[-1].end > 1.99


def test_a_blow_below_the_contact_threshold_is_its_peak():
    force = reading((0.1, 0.009, 5))
    (contact,) = find_contacts(np.minimum(force, 2.9), 1030, RULES)
    assert contact.end > contact.start


def test_a_missing_sample_is_no_peak_of_a_faint_contact():
    # found by a random stream: a sample that is missing counts as zero in the mean
    reading = np.zeros(400)
    reading[100] = np.nan
    (contact,) = find_contacts(reading, 100, RULES)
    assert contact.peak_force == 0.0
    assert contact.peak_time > 100 / RATE
