"""The free oscillation, drawn: the fitted curve, what it leaves, and the spectrum."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.records import ImpactEvent, SensorParameters

__all__ = ['RingDown', 'Spectrum', 'amplitude_spectrum', 'has_fit', 'redraw_ring_down']

FEWEST_SAMPLES = 16
ZERO_PADDING = 4  # finer steps of frequency for the eye; adds no information


@dataclass(frozen=True, slots=True, eq=False)
class RingDown:
    """Samples of the span, the fitted curve there, both shape (n,), in the channel's unit."""

    time: NDArray[np.float64]  # s after the window's start
    measured: NDArray[np.float64]
    fitted: NDArray[np.float64] | None  # None where nothing was fitted
    unit: str
    sample_rate: float  # Hz


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Amplitudes of shape (n,) in the channel's unit over frequencies in Hz."""

    frequency: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    resolution: float  # Hz, half-height width of the window's main lobe


def has_fit(sensor: SensorParameters) -> bool:
    """Whether there is a fit worth drawing: valid, or beside the reason why it is no sensor's."""
    return sensor.valid or bool(sensor.modes) or math.isfinite(sensor.linearity_p_value)


def redraw_ring_down(event: ImpactEvent, sensor: SensorParameters) -> RingDown | None:
    """The span of the fit, or from the last contact to rest where nothing was fitted.

    The fitted curve is drawn from the natural frequency, damping ratio and damped frequency
    of the record (Samarathunga et al. 2024, eq. 26 and 27), or those of each mode; amplitudes,
    phases and offset follow by linear least squares over the span, as the nonlinear fit's own do
    at its optimum.
    None where the event has fewer than 16 finite samples there.
    """
    row = event.index_of(sensor.channel) if sensor.channel else 0
    start, end = sensor.span_start, sensor.span_end
    if not (math.isfinite(start) and math.isfinite(end)):
        start, end = event.contact_end, event.event_end
    known = math.isfinite(start) and math.isfinite(end) and event.sample_rate > 0
    if row is None or row >= event.values.shape[0] or not known:
        return None
    stride = max(event.oversampling, 1) if row == 0 else 1
    values = event.values[row, ::stride].astype(np.float64)
    rate = event.sample_rate / stride
    time = np.arange(values.size) / rate
    inside = (time >= start - 0.25 / rate) & (time <= end + 0.25 / rate)
    time, values = time[inside], values[inside]
    finite = np.isfinite(values)
    if np.count_nonzero(finite) < FEWEST_SAMPLES:
        return None
    zero = event.zero_level[row] if row < len(event.zero_level) else math.nan
    values = values - (zero if math.isfinite(zero) else 0.0)
    fitted = _fitted(time, values, finite, sensor) if has_fit(sensor) else None
    return RingDown(time, values, fitted, event.channels[row].unit, rate)


def _fitted(
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    finite: NDArray[np.bool_],
    sensor: SensorParameters,
) -> NDArray[np.float64] | None:
    t = time - time[0]
    columns = [np.ones_like(t)]
    for decay, damped in _poles(sensor):
        if not (math.isfinite(decay) and math.isfinite(damped)) or -decay * t[-1] > 100.0:
            return None
        wave = np.exp(-decay * t + 1j * damped * t)
        columns += [wave.real, wave.imag]
    design = np.stack(columns, axis=1)
    solution = np.linalg.lstsq(design[finite], values[finite], rcond=None)[0]
    curve: NDArray[np.float64] = design @ solution
    return curve


def _poles(sensor: SensorParameters) -> list[tuple[float, float]]:
    """Decay in 1/s and damped angular frequency in rad/s of what was fitted."""
    wn = math.tau * sensor.natural_frequency.value
    damped = math.tau * sensor.damped_frequency.value
    poles = [(wn * sensor.damping_ratio.value, damped)]
    if sensor.modes:
        poles = []
        for mode in sensor.modes:
            wn, ratio = math.tau * mode.natural_frequency.value, mode.damping_ratio.value
            poles.append((wn * ratio, wn * math.sqrt(1.0 - ratio**2)))
    return poles


def amplitude_spectrum(ring_down: RingDown) -> Spectrum | None:
    """One-sided amplitude spectrum of the span, mean removed, Hann window.

    A steady sine of amplitude a gives a peak of a; a decaying one a lower peak. None where
    samples are missing inside the span: a spectrum across a gap would be invented.
    """
    values = ring_down.measured
    if not np.isfinite(values).all():
        return None
    window = np.hanning(values.size)
    total = float(window.sum())
    size = 1 << (ZERO_PADDING * values.size - 1).bit_length()
    spectrum = np.fft.rfft((values - values.mean()) * window, size)
    frequency = np.fft.rfftfreq(size, 1.0 / ring_down.sample_rate).astype(np.float64)
    # The Hann window's main lobe is 2 bins of the unpadded transform wide at half height.
    resolution = 2.0 * ring_down.sample_rate / values.size
    amplitude = np.asarray(2.0 * np.abs(spectrum) / total, dtype=np.float64)
    return Spectrum(frequency, amplitude, resolution)
