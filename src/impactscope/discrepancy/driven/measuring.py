"""What a measuring chain does to the quantity that it measures, and the effects to look for.

The order is that of a chain: the clock that decides when a sample is taken, filters, coupling,
additions, and at last the range. Filters are Butterworth's; source: ISO 6487 and SAE J211-1.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.interpolate import CubicSpline

from impactscope.discrepancy.driven.terms import Number, Term

__all__ = ['MAINS', 'ORDERS', 'filter_of', 'output_terms', 'passed_on', 'retimed', 'step_of']

Array = NDArray[np.float64]

ORDERS = (1, 2, 3, 4, 6, 8)
MAINS = (50.0, 60.0)  # Hz
COARSE = 40.0  # rounding errors of single precision that a step must exceed to be seen
CLOCKS = 1e-3  # largest drift of a clock that is looked for


def filter_of(term: Term) -> tuple[int, bool]:
    """Order and whether it runs forwards and backwards, of a low-pass among the candidates."""
    kind, _, order = term.variant.partition('-')
    return int(order), kind == 'zero'


def step_of(samples: Array) -> float:
    """Step of the lattice on which samples, shape (n,), lie in single precision; 0 without one."""
    levels = np.unique(samples)
    if levels.size < 3:
        return 0.0
    gaps = np.diff(levels)
    rounding = float(np.finfo(np.float32).eps) * float(np.max(np.abs(levels)))
    step = float(np.min(gaps))
    if step <= COARSE * rounding:
        return 0.0
    for most in (1.5, 4.5, 20.5, math.inf):  # ever wider gaps tell the step ever better
        near = gaps[gaps < most * step]
        step = float(np.sum(near) / np.sum(np.round(near / step)))
    off = np.abs(gaps - step * np.round(gaps / step))
    return step if float(np.max(off)) < 0.02 * step + 2.0 * rounding else 0.0


def retimed(samples: Array, offset: float, drift: float, period: float) -> Array:
    """Samples that a clock with an error delivers: its stamp is t (1 + drift) + offset.

    By a cubic spline: for signals far below half the sampling rate. Ends are held.
    """
    if offset == 0.0 and drift == 0.0:
        return samples
    time = period * np.arange(samples.size)
    spline = CubicSpline(time, samples)
    return np.asarray(spline(np.clip((time - offset) / (1.0 + drift), 0.0, time[-1])))


@functools.lru_cache(maxsize=256)
def _low_pass(order: int, cutoff: float, rate: float) -> Array:
    return np.asarray(signal.butter(order, cutoff, fs=rate, output='sos'))


def _hum(term: Term, values: Mapping[str, float], time: Array) -> Array:
    angle = 2.0 * math.pi * values[f'{term.label}.frequency'] * time
    sine, cosine = values[f'{term.label}.sine'], values[f'{term.label}.cosine']
    return np.asarray(sine * np.sin(angle) + cosine * np.cos(angle))


def passed_on(
    samples: Array,
    parts: Mapping[str, Term],
    values: Mapping[str, float],
    period: float,
    begin: float,
) -> Array:
    """What a chain makes of samples, shape (n,), without its clock.

    Args:
        samples: of the quantity.
        parts: effects by name.
        values: numbers by key.
        period: s between samples.
        begin: s after the recording's first sample.
    """
    rate = 1.0 / period
    y = samples
    time: Array = period * np.arange(y.size, dtype=np.float64)
    if 'low_pass_filter' in parts:
        term = parts['low_pass_filter']
        order, both = filter_of(term)
        cutoff = values[f'{term.label}.cutoff']
        if 0.0 < cutoff < 0.5 * rate:
            sections = _low_pass(order, cutoff, rate)
            if both:
                y = signal.sosfiltfilt(sections, y)
            else:
                y = signal.sosfilt(sections, y, zi=signal.sosfilt_zi(sections) * y[0])[0]
    if 'ac_coupling' in parts:
        corner = values[f'{parts["ac_coupling"].label}.corner']
        if 0.0 < corner < 0.5 * rate:
            b, a = signal.butter(1, corner, btype='high', fs=rate)
            y = signal.lfilter(b, a, y, zi=[-b[0] * y[0]])[0]  # at rest before the first sample
    if 'offset' in parts:
        y = y + values[f'{parts["offset"].label}.value']
    if 'zero_drift' in parts:
        y = y + values[f'{parts["zero_drift"].label}.rate'] * time
    if 'mains_hum' in parts:
        y = y + _hum(parts['mains_hum'], values, np.asarray(begin + time))
    if 'saturation' in parts:
        limit = values[f'{parts["saturation"].label}.limit']
        y = np.clip(y, -limit, limit)
    return np.asarray(y)


def output_terms(
    channel: str, unit: str, rate: float, longest: float, noise: float, peak: float
) -> list[Term]:
    """Effects of the chain behind an output channel, with ladders of values to start from.

    Args:
        channel: its name.
        unit: of its samples.
        rate: samples a second.
        longest: recording, s.
        noise: standard deviation of a sample.
        peak: largest sample.
    """

    def term(
        name: str,
        sentence: str,
        equation: str,
        test: str,
        *numbers: Number,
        variant: str = 'output',
        amounts: tuple[str, ...] = (),
        source: str = 'the measuring chain',
    ) -> Term:
        return Term(
            name,
            'measurement',
            sentence,
            equation,
            source,
            test,
            numbers,
            variant,
            channel=channel,
            output=True,
            amounts=amounts,
        )

    slow = tuple(float(v) for v in np.geomspace(0.01 / longest, 0.004 * rate, 9))
    cuts = tuple(float(v) for v in np.geomspace(60.0, 0.45 * rate, 9))
    found = [
        term(
            'low_pass_filter',
            f'A low-pass of order {order} that runs '
            f'{"forwards and backwards" if kind == "zero" else "forwards"} stands in the channel.',
            f'Butterworth of order {order}',
            'a hard tap, beside an unfiltered channel',
            Number('cutoff', 'Hz', cuts, 100.0, 5.0, 0.499 * rate),
            variant=f'{kind}-{order}',
            source='ISO 6487; SAE J211-1',
        )
        for order in ORDERS
        for kind in ('causal', 'zero')
    ]
    found.append(
        term(
            'ac_coupling',
            'The channel is AC coupled: slow signals fade.',
            'first-order high-pass at the corner frequency',
            'a load that stays',
            Number('corner', 'Hz', slow, slow[0], 0.0, 0.25 * rate),
            amounts=('corner',),
        )
    )
    late = 0.2 / rate
    stamp = Number('offset', 's', (late,), late, -0.02, 0.02)
    found.append(
        term(
            'clock_error',
            "The channel's clock is off: it comes late or early.",
            'stamp = t + offset',
            'a hard tap in both channels',
            stamp,
            amounts=('offset',),
        )
    )
    found.append(
        term(
            'clock_error',
            "The channel's clock is off and runs at another rate.",
            'stamp = t (1 + drift) + offset',
            'a hard tap in both channels at the beginning and at the end',
            stamp,
            Number('drift', '1', (1e-5, -1e-5), 1e-5, -CLOCKS, CLOCKS),
            variant='output-drift',
            amounts=('offset', 'drift'),
        )
    )
    found.append(
        term(
            'clock_error',
            "The channel's clock runs at another rate.",
            'stamp = t (1 + drift)',
            'a hard tap in both channels at the beginning and at the end',
            Number('drift', '1', (1e-5,), 1e-5, -CLOCKS, CLOCKS),
            variant='output-rate',
            amounts=('drift',),
        )
    )
    found.append(
        term(
            'offset',
            'The channel has a constant offset.',
            'y + value',
            'the quiet before a blow',
            Number('value', unit, (0.1 * noise,), 0.1 * noise),
            amounts=('value',),
        )
    )
    found.append(
        term(
            'zero_drift',
            'The zero of the channel drifts.',
            'y + r t',
            'quiet before against quiet after a blow',
            Number('rate', f'{unit}/s', (0.1 * noise / longest,), 0.1 * noise / longest),
            amounts=('rate',),
        )
    )
    for mains in MAINS:
        near = tuple(mains + 0.25 * k / longest for k in range(-4, 5))
        found.append(
            term(
                'mains_hum',
                'Mains hum is added.',
                'A sin(2 pi f t + phase)',
                'the quiet before a blow: a line in the spectrum',
                Number('sine', unit, (0.1 * noise,), 0.1 * noise),
                Number('cosine', unit, (0.1 * noise,), 0.1 * noise),
                Number('frequency', 'Hz', near, 0.1 / longest, 0.97 * mains, 1.03 * mains),
                variant=f'output-{mains:g}Hz',
                amounts=('sine', 'cosine'),
            )
        )
    found.append(
        term(
            'saturation',
            'The channel saturates: larger values are cut off.',
            'clip to +-limit',
            'the hardest blow: a flat top',
            Number(
                'limit',
                unit,
                tuple(peak * s for s in (0.999, 0.99, 0.97, 0.93, 0.85, 0.7)),
                0.01 * peak,
                0.0,
                1.001 * peak,
            ),
        )
    )
    return found
