"""The figures of an answer: overlays with residuals, spectra, and residuals against the state."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.answer import Region, Trace
from impactscope.report.figure import Band, Figure, LimitLine, Series, draw_figure

__all__ = ['overlay_figures', 'residual_spectra', 'state_maps']

Array = NDArray[np.float64]

_GRID = 160  # frequencies of a spectrum
_CELLS = 24  # of a state axis
_WORTH = 1.05  # rms over noise from which the residual's own figure is worth the space


def overlay_figures(trace: Trace, regions: Sequence[Region]) -> list[Markup]:
    """Measured, baseline and extended model; below, what both leave, with the regions shaded."""
    if trace.time.size < 2:
        return []
    bands = tuple(
        Band(r.start_s, r.end_s, 'chosen', r.phase)
        for r in regions
        if r.recording == trace.recording and r.channel == trace.channel
    )
    left = trace.measured - trace.baseline
    ratio = float(np.sqrt(np.mean(left**2))) / trace.noise_std
    if not bands and ratio < _WORTH and trace.channel == 'acceleration.base':
        return []
    x_range = _window(trace)
    overlay = Figure(
        title=f'{trace.channel}: recorded and simulated',
        description='The recording with the baseline and the extended model over it.',
        x_label='Time in the recording',
        x_unit='s',
        y_label=trace.channel,
        y_unit=trace.unit,
        x_range=x_range,
        series=(
            Series('measured', trace.time, trace.measured, 'pale'),
            Series('baseline', trace.time, trace.baseline, 'other'),
            Series('extended', trace.time, trace.extended, 'fit'),
        ),
        bands=bands,
        height=210,
    )
    residual = Figure(
        title=f'{trace.channel}: residuals',
        description='Measured minus simulated, for the baseline and for the extended model.',
        x_label='Time in the recording',
        x_unit='s',
        y_label='Residual',
        y_unit=trace.unit,
        x_range=x_range,
        series=(
            Series('baseline leaves', trace.time, left, 'other'),
            Series('extended leaves', trace.time, trace.measured - trace.extended, 'residual'),
        ),
        bands=bands,
        limits=(
            LimitLine(2 * trace.noise_std, x_range[0], x_range[1], '+2 noise', 'transient-limit'),
            LimitLine(-2 * trace.noise_std, x_range[0], x_range[1], '-2 noise', 'transient-limit'),
        ),
        height=120,
    )
    return [draw_figure(overlay), draw_figure(residual)]


def _window(trace: Trace) -> tuple[float, float]:
    """The stretch worth seeing: from shortly before the blow to the end."""
    large = np.abs(trace.measured) > 0.02 * float(np.max(np.abs(trace.measured)))
    first = float(trace.time[int(np.argmax(large))]) if large.any() else float(trace.time[0])
    return max(float(trace.time[0]), first - 0.01), float(trace.time[-1])


def residual_spectra(traces: Sequence[Trace]) -> list[Markup]:
    """Amplitude spectrum of what both models leave, by channel, over the fitted recordings."""
    figures = []
    for channel in dict.fromkeys(t.channel for t in traces):
        own = [t for t in traces if t.channel == channel and not t.held_out and t.time.size > 32]
        if not own:
            continue
        steps = [float(np.median(np.diff(t.time))) for t in own]
        highest = 0.45 / max(steps)
        length = min(float(t.time[-1] - t.time[0]) for t in own)
        if not highest > 4 / length:
            continue
        grid = np.geomspace(2 / length, highest, _GRID)
        before = np.mean([_power(t.time, t.measured - t.baseline, grid) for t in own], axis=0)
        after = np.mean([_power(t.time, t.measured - t.extended, grid) for t in own], axis=0)
        figures.append(
            draw_figure(
                Figure(
                    title=f'{channel}: spectrum of the residuals',
                    description='Amplitude of the residuals against frequency.',
                    x_label='Frequency',
                    x_unit='Hz',
                    y_label='Amplitude',
                    y_unit=own[0].unit,
                    x_range=(0.0, float(grid[-1])),
                    series=(
                        Series('baseline leaves', grid, np.sqrt(before), 'other'),
                        Series('extended leaves', grid, np.sqrt(after), 'residual'),
                    ),
                    height=150,
                    logarithmic=True,
                )
            )
        )
    return figures


def _power(time: Array, residual: Array, grid: Array) -> Array:
    power = signal.lombscargle(time, residual - np.mean(residual), 2 * math.pi * grid)
    return np.asarray(4.0 * power / time.size)


def state_maps(traces: Sequence[Trace]) -> list[Markup]:
    """Mean residual against the plate's velocity and displacement: a law shows as a curve."""
    figures = []
    for channel in ('force', 'acceleration.plate'):
        own = [t for t in traces if t.channel == channel and t.velocity.size == t.time.size]
        own = [t for t in own if t.time.size > 32]
        if not own:
            continue
        for name, unit, of in (
            ('velocity', 'm/s', [t.velocity for t in own]),
            ('displacement', 'm', [t.displacement for t in own]),
        ):
            state = np.concatenate(of)
            moving = np.abs(state) > 1e-6
            if np.count_nonzero(moving) < 5 * _CELLS:
                continue
            before = np.concatenate([t.measured - t.baseline for t in own])
            after = np.concatenate([t.measured - t.extended for t in own])
            edges = np.quantile(state[moving], np.linspace(0.0, 1.0, _CELLS + 1))
            centres, low = _cells(state[moving], before[moving], edges)
            _, high = _cells(state[moving], after[moving], edges)
            figures.append(
                draw_figure(
                    Figure(
                        title=f'{channel}: residual against the {name} of the plate',
                        description=f'Mean residual in cells of equal count of the {name}.',
                        x_label=name.capitalize(),
                        x_unit=unit,
                        y_label='Mean residual',
                        y_unit=own[0].unit,
                        x_range=(float(centres[0]), float(centres[-1])),
                        series=(
                            Series('baseline leaves', centres, low, 'other'),
                            Series('extended leaves', centres, high, 'residual'),
                        ),
                        height=150,
                    )
                )
            )
    return figures


def _cells(state: Array, residual: Array, edges: Array) -> tuple[Array, Array]:
    place = np.clip(np.searchsorted(edges, state) - 1, 0, edges.size - 2)
    count = np.maximum(np.bincount(place, minlength=edges.size - 1), 1)
    mean = np.bincount(place, residual, edges.size - 1) / count
    centre = np.bincount(place, state, edges.size - 1) / count
    keep = np.concatenate([[True], np.diff(centre) > 0])
    return centre[keep], mean[keep]
