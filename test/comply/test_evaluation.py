import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.comply.evaluation import evaluate, read_force
from impactscope.errors import InputError
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import Channel

PROFILE = MeasurementProfile()


def forces(event, profile=PROFILE):
    return evaluate(event, read_force(event), profile)


def test_a_half_sine_has_a_transient_force_alone(make_event):
    found = forces(make_event(120.0, zero=4.0))
    assert found.transient.value == pytest.approx(120, abs=1e-4)
    assert found.transient_time == pytest.approx(0.018, abs=1e-3)
    assert math.isnan(found.quasi_static.value)
    assert found.contact_duration == pytest.approx(0.036)


def test_a_clamp_has_both_and_the_later_larger_force_is_quasi_static(make_event):
    found = forces(make_event(90.0, plateau=60.0, hold=1.2))
    assert found.transient.value == pytest.approx(90, abs=1e-4)
    assert found.quasi_static.value == pytest.approx(60, abs=1e-4)
    assert found.quasi_static_time > 0.5

    def press(values, t):
        values[0, np.argmin(np.abs(t - 0.9))] += 40

    found = forces(make_event(90.0, plateau=60.0, hold=1.2, edit=press))
    assert found.quasi_static.value == pytest.approx(100, abs=1e-3)
    assert found.transient.value == pytest.approx(90, abs=1e-4)


@pytest.mark.parametrize(('at', 'phase'), [(0.5999, 'transient'), (0.6011, 'quasi_static')])
def test_the_window_divides_at_half_a_second_from_first_contact(make_event, at, phase):
    def spike(values, t):
        values[0, np.argmin(np.abs(t - at))] = 200

    found = forces(make_event(90.0, plateau=20.0, hold=1.2, edit=spike, zero=0.0))
    assert getattr(found, phase).value == pytest.approx(200)


def test_nothing_counts_after_contact_has_ended(make_event):
    def later(values, t):
        values[0, t > 1.4] = 500

    found = forces(make_event(90.0, plateau=20.0, hold=1.2, length=2.0, edit=later, zero=0.0))
    assert found.quasi_static.value == pytest.approx(20)


def test_the_reference_is_judged_by_its_own_samples(make_event):
    def overshoot(values, t):
        values[0, 1::4] += 1000  # between the reference's own samples

    event = make_event(120.0, oversampling=4, edit=overshoot)
    reading = read_force(event)
    assert reading.sample_rate == 2000
    assert evaluate(event, reading, PROFILE).transient.value == pytest.approx(120, abs=1e-4)


def test_uncertainty_by_its_parts(make_event):
    found = forces(make_event(200.0, noise=0.5))
    zero_std = 0.5 / math.sqrt(201)  # 0.1 s at 2 kHz before the blow, both ends counted
    assert found.zero_std == pytest.approx(zero_std, rel=1e-2)
    assert found.transient.std == pytest.approx(math.hypot(0.015 * 200, 0.5, zero_std), rel=1e-3)
    assert found.guard_band(280) == pytest.approx(
        2 * math.hypot(0.015 * 280, 0.5, zero_std), rel=1e-3
    )


def test_the_stated_uncertainty_covers_the_truth(make_event):
    """A flat reading at one sample: the scatter about the truth is the one stated."""
    rng = np.random.default_rng(7)
    noise, gain_std, truth, trials = 2.0, 0.015, 150.0, 2000
    deviations = []
    for _ in range(trials):
        zero = rng.normal(0, noise / math.sqrt(201))
        reading = truth * (1 + rng.normal(0, gain_std)) + rng.normal(0, noise) - zero
        deviations.append(reading - truth)
    stated = forces(make_event(truth, noise=noise)).transient.std
    assert np.std(deviations) == pytest.approx(stated, rel=4 / math.sqrt(2 * trials))


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'values': np.zeros((2, 100), np.float32)}, 'shape'),
        ({'values': np.zeros((1, 0), np.float32)}, 'shape'),
        ({'values': np.zeros(100, np.float32)}, 'shape'),
        ({'sample_rate': math.nan}, 'nan'),
        ({'sample_rate': 0.0}, 'sample rate'),
        ({'oversampling': 0}, 'oversampling 0'),
        ({'contact_start': math.nan}, 'nan'),
        ({'contact_start': -1.0}, '-1'),
        ({'contact_end': 99.0}, '99'),
        ({'contact_end': 0.05}, '0.05'),
        ({'channels': (Channel('acceleration.plate', 'm/s^2'),)}, "no channel 'force'"),
    ],
)
def test_an_event_that_contradicts_itself_is_refused(make_event, changes, message):
    import dataclasses

    with pytest.raises(InputError, match=message):
        read_force(dataclasses.replace(make_event(), **changes))


def test_values_that_are_not_finite_are_left_out_and_all_of_them_is_nothing(make_event):
    def pierce(values, t):
        values[0, 10::7] = np.nan
        values[0, 11::7] = np.inf

    found = forces(make_event(120.0, edit=pierce))
    assert 100 < found.transient.value <= 120.001

    def erase(values, t):
        values[:] = np.nan

    assert math.isnan(forces(make_event(edit=erase)).transient.value)


@given(peak=st.floats(5, 2000), zero=st.floats(-50, 50), rate=st.sampled_from([1e3, 2e3, 1e4]))
def test_the_zero_level_does_not_matter(make_event, peak, zero, rate):
    found = forces(make_event(peak, zero=zero, rate=rate))
    assert found.transient.value == pytest.approx(peak, abs=1e-3)
