"""Fig. 6 to 8 of the paper, drawn anew: hammer tap, spring test, Bode diagram."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from impactscope.paper import published
from impactscope.paper.recordings import RATE, TAP_FORCES, RampTest, spring_test, tap
from impactscope.physics.sensor_model import PAPER_SENSOR
from impactscope.report.chart import Axis, Line, Mark, Panel, Points, draw_chart
from impactscope.report.figure import Band, Figure, Rule, Series, draw_figure
from impactscope.report.numbers import format_estimate

__all__ = ['sensor_figures']


def sensor_figures() -> list[Markup]:
    """Fig. 6 a, b, c, Fig. 7 and Fig. 8."""
    return [*_tap_figures(), _spring_figure(), _bode_figure()]


def _tap_figures() -> list[Markup]:
    recording = tap(TAP_FORCES[-1])
    free, fit = recording.free, recording.free.fit
    shown = (0.0, 0.55)
    start, stop = free.start / RATE, free.stop / RATE
    force = Figure(
        title='Fig. 6a  Hammer tap: force (simulated)',
        description='Reading of the sensor during and after a hammer tap.',
        x_label='time',
        x_unit='s',
        y_label='force',
        y_unit='N',
        x_range=shown,
        series=(Series('reading', recording.time, recording.force),),
        bands=(Band(start, stop, 'ring-down', 'free vibration, fitted'),),
        height=210,
        caption=(
            f'A tap of {TAP_FORCES[-1]:.0f} N over 4 ms on the bare plate, read with 0.4 N of '
            'noise. Shaded: the free vibration that was found and fitted.',
        ),
    )
    acceleration = Figure(
        title="Fig. 6a  Hammer tap: plate's acceleration (simulated)",
        description='Acceleration of the plate during and after the same tap.',
        x_label='time',
        x_unit='s',
        y_label='acceleration',
        y_unit='m/s²',
        x_range=shown,
        series=(Series('plate', recording.time, recording.acceleration, 'other'),),
        height=170,
    )
    inside = recording.span
    time = recording.time[inside]
    model = fit.evaluate(time - time[0])
    residual = recording.force[inside] - model
    frequency, u_frequency = format_estimate(fit.natural_frequency)
    ratio, u_ratio = format_estimate(fit.damping_ratio)
    fitted = Figure(
        title='Fig. 6b  Fit of eq. 26 (simulated)',
        description='Reading, fitted damped cosine and what is left.',
        x_label='time',
        x_unit='s',
        y_label='force',
        y_unit='N',
        x_range=(start, start + 0.4),
        series=(
            Series('reading', time, recording.force[inside], 'pale'),
            Series('eq. 26', time, model, 'fit'),
            Series('residual', time, residual, 'residual'),
        ),
        height=230,
        caption=(
            f'f_n = {frequency} ± {u_frequency} Hz, ζ = {ratio} ± {u_ratio} (k = 2), '
            f'R² {fit.r_squared:.4f}, RMSE {fit.rmse:.2f} N. '
            'Paper: 32.37 Hz, 0.0692, R² 0.953, RMSE 1.14 N.',
        ),
    )
    return [draw_figure(force), draw_figure(acceleration), draw_figure(fitted), _spectrum()]


def _spectrum() -> Markup:
    recording = tap(TAP_FORCES[-1])
    values = recording.force[recording.free.start :]
    padded = 1 << 17
    frequency = np.arange(padded // 2 + 1) * RATE / padded
    amplitude = np.abs(np.fft.rfft(values - values.mean(), padded)).astype(np.float64) / RATE
    shown = frequency <= 100
    found = recording.spectrum
    return draw_figure(
        Figure(
            title='Fig. 6c  Spectrum of the free vibration (simulated)',
            description='Amplitude of the Fourier transform with the peak found and the printed.',
            x_label='frequency',
            x_unit='Hz',
            y_label='spectral density of force',
            y_unit='N s',
            x_range=(0.0, 100.0),
            series=(Series('spectrum', frequency[shown], amplitude[shown]),),
            rules=(
                Rule(found.frequency.value, f'peak here, {found.frequency.value:.2f} Hz', 'fit'),
                Rule(32.85, 'peak in the paper, 32.85 Hz', 'spectral'),
            ),
            height=220,
            caption=(
                f'Resolution of this record {found.resolution:.2f} Hz; half-power damping ratio '
                f'{found.damping_ratio.value:.3f}.',
            ),
        )
    )


def _spring_panel(test: RampTest, title: str) -> Panel:
    travel = np.array([0.0, 1e3 * float(test.displacement.max())])
    return Panel(
        Axis('displacement / mm'),
        Axis('force / N'),
        (
            Line('simulated test', 1e3 * test.displacement, test.force, 'main'),
            Line('69 N/mm, as measured in the paper', travel, 69 * travel, 'second'),
            Line('75 N/mm, nominal', travel, 75 * travel, 'published'),
        ),
        title=title,
    )


def _spring_figure() -> Markup:
    return draw_chart(
        'Fig. 7  Spring constant (simulated)',
        'Force over displacement of a compression and of a cyclic test with lines of 69 and 75 '
        'N/mm.',
        (
            _spring_panel(spring_test(), '(a) compression test'),
            _spring_panel(spring_test(5), '(b) cyclic test'),
        ),
        columns=2,
        height=260,
        caption=(
            'At 1 mm/min, load cell noise 0.2 N (assumed). The paper measured 69 N/mm on a '
            'spring sold as 75 N/mm.',
        ),
    )


def _bode_figure() -> Markup:
    sensor = PAPER_SENSOR
    frequency = np.geomspace(1.0, 300.0, 1200)
    magnitude, phase = sensor.bode(frequency)
    critical = type(sensor).from_modal(
        published.BANDWIDTH_FREQUENCY, 1.0, published.SPRING_STIFFNESS
    )
    magnitude_critical, phase_critical = critical.bode(frequency)
    names = ('sensor, ζ = 0.0692', 'same with ζ = 1')
    x = Axis('frequency / Hz', (1.0, 300.0), logarithmic=True)
    peak = 20 * float(np.log10(sensor.resonance_peak))
    return draw_chart(
        'Fig. 8  Bode diagram of F_o/F_i (closed form)',
        'Magnitude and phase of the measured over the contact force.',
        (
            Panel(
                x,
                Axis('magnitude / dB', (-40.0, 22.0)),
                (
                    Line(names[0], frequency, magnitude),
                    Line(names[1], frequency, magnitude_critical, 'second'),
                ),
                (
                    Points('peak, computed', [sensor.resonance_frequency], [peak]),
                    Points(
                        'bandwidth in the paper: 50.12 and 20.83 Hz',
                        [50.12, 20.83],
                        [-3.01, -3.01],
                        'published',
                        'cross',
                    ),
                ),
                (Mark('x', 32.1, 'peak in the paper, 32.1 Hz'), Mark('y', -3.01, '-3 dB', 'grey')),
                title='magnitude',
            ),
            Panel(
                x,
                Axis('phase / °', (-185.0, 5.0)),
                (
                    Line(names[0], frequency, phase),
                    Line(names[1], frequency, phase_critical, 'second'),
                ),
                title='phase',
            ),
        ),
        columns=2,
        height=290,
    )
