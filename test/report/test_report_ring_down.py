import dataclasses
import math

import numpy as np
import pytest

from impactscope.records import Channel, Estimate, ImpactEvent, SensorParameters
from impactscope.report.ring_down import amplitude_spectrum, redraw_ring_down

RATE, FREQUENCY, DAMPING = 2000.0, 32.34, 0.0692


def oscillation(rows=1, oversampling=1, zeta=DAMPING, offset=1.5):
    t = np.arange(2000) / RATE
    decay, damped = math.tau * FREQUENCY * zeta, math.tau * FREQUENCY * math.sqrt(1 - zeta**2)
    curve = 9.0 * np.exp(-decay * t) * np.cos(damped * t + 0.7) + offset
    event = ImpactEvent(
        event_id=1, stamp_ns=0, window_start_ns=0, sample_rate=RATE,
        channels=tuple(Channel(f'c{i}', 'N') for i in range(rows)),
        values=np.tile(curve, (rows, 1)).astype(np.float32), contacts=(), contact_start=0.0,
        contact_end=0.05, event_end=0.9, zero_level=(0.5,) * rows, noise_std=(0.1,) * rows,
        oversampling=oversampling,
    )  # fmt: skip
    sensor = SensorParameters(
        1, 0, valid=True, channel='c0', span_start=0.1, span_end=0.6,
        natural_frequency=Estimate(FREQUENCY), damping_ratio=Estimate(zeta),
        damped_frequency=Estimate(FREQUENCY * math.sqrt(1 - zeta**2)),
    )  # fmt: skip
    return event, sensor


@pytest.mark.parametrize('oversampling', [1, 4])
def test_the_true_parameters_redraw_the_curve(oversampling):
    event, sensor = oscillation(oversampling=oversampling)
    drawn = redraw_ring_down(event, sensor)
    assert drawn.time[0] == pytest.approx(0.1, abs=oversampling / RATE)
    assert drawn.time[-1] == pytest.approx(0.6, abs=oversampling / RATE)
    np.testing.assert_allclose(drawn.fitted, drawn.measured, atol=2e-6)  # float32 samples
    assert drawn.measured.mean() == pytest.approx(1.0, abs=0.3)  # zero level removed


def test_a_wrong_frequency_is_not_hidden():
    event, sensor = oscillation()
    wrong = dataclasses.replace(sensor, damped_frequency=Estimate(FREQUENCY * 1.05))
    drawn = redraw_ring_down(event, wrong)
    assert np.abs(drawn.fitted - drawn.measured).max() > 0.3


def test_without_a_valid_fit_only_the_samples_are_drawn():
    event, _ = oscillation()
    drawn = redraw_ring_down(event, SensorParameters(1, 0, valid=False))
    assert drawn.fitted is None
    assert drawn.time[0] == pytest.approx(0.05, abs=1 / RATE)


def test_the_spectrum_of_a_steady_sine_peaks_at_its_amplitude():
    event, sensor = oscillation(zeta=0.0, offset=0.5)
    spectrum = amplitude_spectrum(redraw_ring_down(event, sensor))
    peak = spectrum.amplitude.argmax()
    assert spectrum.amplitude[peak] == pytest.approx(9.0, rel=0.01)
    assert spectrum.frequency[peak] == pytest.approx(FREQUENCY, abs=0.3)


def test_missing_samples_forbid_a_spectrum_but_not_the_drawing():
    event, sensor = oscillation()
    values = event.values.copy()
    values[0, 500:520] = np.nan
    drawn = redraw_ring_down(dataclasses.replace(event, values=values), sensor)
    assert np.isfinite(drawn.fitted).all()
    assert amplitude_spectrum(drawn) is None


@pytest.mark.parametrize(
    'change',
    [
        {'span_start': math.nan, 'span_end': math.nan, 'channel': 'absent'},
        {'span_start': 5.0, 'span_end': 6.0},
        {'span_start': 0.6, 'span_end': 0.1},
    ],
)
def test_nothing_to_draw(change):
    event, sensor = oscillation()
    assert redraw_ring_down(event, dataclasses.replace(sensor, **change)) is None


@pytest.mark.parametrize('name', ['natural_frequency', 'damping_ratio', 'damped_frequency'])
@pytest.mark.parametrize('value', [math.nan, math.inf, 1e9])
def test_impossible_parameters_draw_no_curve(name, value):
    event, sensor = oscillation()
    drawn = redraw_ring_down(event, dataclasses.replace(sensor, **{name: Estimate(value)}))
    assert drawn.fitted is None or np.isfinite(drawn.fitted).all()
    if not math.isfinite(value):
        assert drawn.fitted is None
