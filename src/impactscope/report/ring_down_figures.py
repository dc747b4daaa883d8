"""The figures of a free oscillation: fit, residual, spectrum."""

from __future__ import annotations

import math

import numpy as np

from impactscope.records import ImpactEvent, SensorParameters
from impactscope.report.event_time import event_clock, first_finite
from impactscope.report.figure import Dot, Figure, Rule, Series
from impactscope.report.numbers import format_number
from impactscope.report.ring_down import (
    RingDown,
    amplitude_spectrum,
    has_fit,
    redraw_ring_down,
)

__all__ = ['ring_down_figures']

CURVE_POINTS = 1600
SPECTRUM_POINTS = 900
UNFITTED_HIGHEST = 500.0  # Hz: where no frequency is known, devices of this kind lie well below


def _fit_figures(
    event: ImpactEvent, sensor: SensorParameters, ring_down: RingDown
) -> list[Figure]:
    """The span with the fit over it, and what the fit leaves."""
    time = ring_down.time
    clock = event_clock(event, float(time[0]), float(time[-1]))
    label = 'Force' if ring_down.unit == 'N' else sensor.channel or 'Value'
    t = clock.axis(time)
    # The fit stands out from noise only before a paler curve.
    measured = Series('measured', t, ring_down.measured, 'pale', CURVE_POINTS)
    figures = []
    curve = (
        f'sum of {len(sensor.modes)} fitted modes' if sensor.modes else 'fitted decaying cosine'
    )
    if ring_down.fitted is not None:
        residual = ring_down.measured - ring_down.fitted
        finite = residual[np.isfinite(residual)]
        rms = math.sqrt(float(np.mean(finite**2))) if finite.size else math.nan
        figures.append(
            Figure(
                title='Free oscillation and fit',
                description=f'Measured free oscillation with the {curve} over it; root '
                f'mean square residual {format_number(rms, 3)} {ring_down.unit}.',
                x_label='Time after first contact',
                x_unit=clock.unit,
                y_label=label,
                y_unit=ring_down.unit,
                x_range=clock.x_range,
                series=(
                    measured,
                    Series(curve, t, ring_down.fitted, 'fit', CURVE_POINTS),
                ),
                height=210,
                caption=(
                    'Drawn from the fitted frequencies and damping ratios; amplitudes, phases and '
                    'offset by linear least squares over the span.',
                ),
            )
        )
        figures.append(
            Figure(
                title='Residual: measured minus fit',
                description='What the fit leaves; a pattern here is physics that the decaying '
                'cosine does not hold.',
                x_label='Time after first contact',
                x_unit=clock.unit,
                y_label='Residual',
                y_unit=ring_down.unit,
                x_range=clock.x_range,
                series=(Series('residual', t, residual, 'residual', CURVE_POINTS),),
                height=100,
                caption=(
                    f'Root mean square {format_number(rms, 3)} {ring_down.unit}. A pattern '
                    'that repeats is physics outside the model, whatever the R².',
                ),
            )
        )
    return figures


def _spectrum_figure(sensor: SensorParameters, ring_down: RingDown) -> Figure | None:
    """The span's spectrum with the fitted frequency marked."""
    spectrum = amplitude_spectrum(ring_down)
    if spectrum is None or not spectrum.amplitude.max() > 0:
        return None
    fitted = sensor.damped_frequency.value if has_fit(sensor) else math.nan
    peak = sensor.spectral_frequency.value
    nyquist = float(spectrum.frequency[-1])
    upper = min(nyquist, 6.0 * first_finite(fitted, peak, UNFITTED_HIGHEST / 6.0))
    if sensor.modes:
        upper = min(nyquist, 1.2 * max(mode.natural_frequency.value for mode in sensor.modes))
    if upper <= 0:
        return None
    rules: tuple[Rule, ...] = ()
    if math.isfinite(fitted):
        name = f'fitted damped frequency, {format_number(fitted)} Hz'
        rules = (Rule(fitted, name, 'fit'),)
    if sensor.modes:
        rules = tuple(
            Rule(mode.natural_frequency.value, f'mode {number}', 'fit')
            for number, mode in enumerate(sensor.modes, start=1)
        )
    dots: tuple[Dot, ...] = ()
    dot_name = ''
    if math.isfinite(peak) and 0 < peak <= upper:
        dot_name = f'peak of the spectrum, {format_number(peak)} Hz'
        height = float(np.interp(peak, spectrum.frequency, spectrum.amplitude))
        dots = (Dot(peak, height, dot_name),)
    shown = spectrum.frequency <= upper
    return Figure(
        title='Amplitude spectrum of the free oscillation'
        if has_fit(sensor)
        else 'Amplitude spectrum after the last contact',
        description='Amplitude over frequency with the fitted frequency marked: '
        + ('; '.join([*(r.name for r in rules), *(d.name for d in dots)]) or 'no peak was fitted')
        + '.',
        x_label='Frequency',
        x_unit='Hz',
        y_label='Amplitude',
        y_unit=ring_down.unit,
        x_range=(0.0, upper),
        series=(
            Series(
                'amplitude', spectrum.frequency[shown], spectrum.amplitude[shown],
                'measured', SPECTRUM_POINTS,
            ),
        ),
        rules=rules,
        dots=dots,
        dot_name=dot_name,
        height=210,
        logarithmic=True,
        caption=(
            f'Hann window, mean removed; resolution {format_number(spectrum.resolution, 2)} Hz.',
        ),
    )  # fmt: skip


def ring_down_figures(event: ImpactEvent, sensor: SensorParameters) -> list[Figure]:
    """Fit and residual where there is a fit, the spectrum where no sample is missing."""
    ring_down = redraw_ring_down(event, sensor)
    if ring_down is None:
        return []
    figures = _fit_figures(event, sensor, ring_down)
    spectrum = _spectrum_figure(sensor, ring_down)
    return figures if spectrum is None else [*figures, spectrum]
