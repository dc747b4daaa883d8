"""What a measuring chain does to the quantity that it measures: clock, filters, coupling, range.

The order is that of a chain: gain, the clock that decides when a sample is taken, filters,
coupling, additions, and at last the range. Filters are Butterworth's; source: ISO 6487 and
SAE J211-1. The effects to look for stand in :mod:`channel_effects`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.interpolate import BSpline, CubicSpline

from impactscope.discrepancy.driven.models.even_spline import between_even_samples
from impactscope.discrepancy.driven.models.terms import Term
from impactscope.physics.mechanisms.ac_coupling import high_pass
from impactscope.physics.mechanisms.low_pass_filter import (
    forgets_by,
    forwards,
    forwards_and_backwards,
    low_pass,
)

__all__ = [
    'HIGHEST_ORDER',
    'before_sampling',
    'begins_in_motion',
    'between_samples',
    'count_in_motion',
    'delayed',
    'filter_of',
    'in_motion',
    'passed_on',
    'power_passed',
    'power_retimed',
    'retimed',
    'smooths',
    'turned',
]

Array = NDArray[np.float64]

QUIET = 50  # the beginning is so many times shorter than the recording
STILL = 0.05  # of the recording's spread: what varies less is at rest
LOADED = 0.3  # of the recording's spread: a mean that is a load
OUTER = 0.25  # of the first samples, to either side of the others
FORGOTTEN = 40.0  # time constants
NEARLY = 0.98  # of a limit: from here on a sample may be cut off
HIGHEST_ORDER = 4  # of low-passes, where only what moves tells their shape
ABOVE = 20.0  # sampling rates: cut-offs beyond delay nothing
FINE = 8  # between samples, before a spline retimes a broad signal


def filter_of(term: Term) -> tuple[int, bool]:
    """Order and whether it runs forwards and backwards, of a low-pass among the candidates."""
    kind, _, order = term.variant.partition('-')
    return int(order.partition('@')[0]), kind.endswith('zero')


def before_sampling(term: Term) -> bool:
    """Whether a low-pass among the candidates acts before samples are taken."""
    return term.variant.startswith('analogue')


def smooths(term: Term) -> bool:
    """Whether a low-pass among the candidates is exponential smoothing, as firmware does it."""
    return term.variant.startswith('smoothing')


BELL = BSpline.basis_element(np.arange(-2.0, 3.0), False)  # of which a cubic spline is made


def retimed(
    samples: Array, offset: float, drift: float, period: float, beyond: float = 0.0
) -> Array:
    """Samples that a clock with an error delivers: its stamp is t (1 + drift) + offset.

    By a cubic spline: for signals far below half the sampling rate. It goes on ``beyond`` samples
    from either end, and is held from there.
    """
    if offset == 0.0 and drift == 0.0:
        return samples
    place = (np.arange(samples.size) - offset / period) / (1.0 + drift)
    return between_even_samples(samples, np.clip(place, -beyond, samples.size - 1.0 + beyond))


def power_retimed(
    terms: Sequence[Term], values: Mapping[str, float], frequency: Array, period: float
) -> Array:
    """Share of white noise's power that :func:`retimed` leaves at each frequency, shape (n,).

    Between two samples a spline smooths: half a sample late, a quarter of it is gone.
    """
    share = np.ones(frequency.size)
    for term in terms:
        offset = values.get(f'{term.label}.offset', 0.0) if term.name == 'clock_error' else 0.0
        part = (offset / period) % 1.0
        if part == 0.0:
            continue
        taps = np.arange(-2, 3)
        turn = np.exp(-2j * math.pi * np.outer(frequency * period, taps))
        moved, still = (turn @ np.nan_to_num(BELL(taps + shift)) for shift in (part, 0.0))
        share *= np.abs(moved / still) ** 2
    return share


def delayed(samples: Array, delay: float, period: float) -> Array:
    """Samples later by ``delay`` s, band-limited; beyond the ends it goes on."""
    n, pad = samples.size, min(samples.size - 1, 64 + int(2.0 * abs(delay) / period))
    spectrum, length = _spectrum_of_longer(samples, pad)
    turn = np.exp(-2j * math.pi * np.fft.rfftfreq(length, period) * delay)
    return np.asarray(np.fft.irfft(spectrum * turn, length)[pad : pad + n])


def between_samples(samples: Array, period: float) -> CubicSpline:
    """Course of a signal up to half the sampling rate through its samples."""
    pad = min(samples.size - 1, 64)
    spectrum, length = _spectrum_of_longer(samples, pad)
    fine = FINE * np.fft.irfft(spectrum, FINE * length)[: FINE * (samples.size + 2 * pad)]
    return CubicSpline(period * (np.arange(fine.size) / FINE - pad), fine)


def _spectrum_of_longer(samples: Array, pad: int) -> tuple[NDArray[np.complex128], int]:
    """Spectrum of samples that go on at both ends and are then joined by a ramp, and their number.

    Turned about its ends, as by a half turn, a course keeps its slope there: a kink would ring.
    """
    first = 2.0 * samples[0] - samples[pad:0:-1]
    last = 2.0 * samples[-1] - samples[-2 : -pad - 2 : -1]
    longer = np.concatenate([first, samples, last])
    length = 1 << longer.size.bit_length()
    longer = np.concatenate([longer, np.linspace(longer[-1], longer[0], length - longer.size)])
    return np.fft.rfft(longer), length


def begins_in_motion(samples: Array) -> bool:
    """Whether samples, shape (n,), are not quiet at their beginning."""
    return _spread(_first(samples)) >= STILL * _spread(samples)


def in_motion(samples: Array) -> tuple[bool, bool]:
    """Whether samples, shape (n,), are not quiet at their beginning and at their end."""
    moving = STILL * _spread(samples)
    return _spread(_first(samples)) >= moving, _spread(_first(samples[::-1])) >= moving


def _spread(samples: Array) -> float:
    """Standard deviation; NumPy's takes several times as long for a few samples."""
    apart = samples - np.add.reduce(samples) / samples.size
    return math.sqrt(float(apart @ apart) / samples.size)


def count_in_motion(recordings: Sequence[Array]) -> tuple[int, int]:
    """How many recordings, each of shape (n,), begin in motion, and how many end so."""
    begin, end = zip(*map(in_motion, recordings), strict=True)
    return sum(begin), sum(end)


def _first(samples: Array) -> Array:
    return samples[: max(8, samples.size // QUIET)]


def _before(samples: Array) -> float:
    """Level before the first sample: that of a quiet beginning, else a load that stays, else 0.

    The first samples may be off, where they come from a course that is told from one side only:
    those in the middle count.
    """
    if not begins_in_motion(samples):
        return _mean_of_middle(_first(samples))
    level = float(np.mean(samples))
    return level if abs(level) > LOADED * float(np.std(samples)) else 0.0


def _mean_of_middle(samples: Array) -> float:
    """Mean without the smallest and the largest; SciPy's takes a millisecond for it."""
    cut = int(OUTER * samples.size)
    ordered = np.partition(samples, (cut, samples.size - cut - 1))
    return float(np.mean(ordered[cut : samples.size - cut]))


@functools.lru_cache(maxsize=256)
def _low_pass(order: int, cutoff: float, rate: float, *, smooth: bool = False) -> Array:
    """Sections of a Butterworth of samples, or of exponential smoothing, which is of order 1."""
    if smooth:
        keep = math.exp(-2.0 * math.pi * cutoff / rate)
        return np.array([[1.0 - keep, 0.0, 0.0, 1.0, -keep, 0.0]])
    return low_pass(order, cutoff, rate)


@functools.lru_cache(maxsize=16)
def _analogue(order: int, cutoff: float, length: int, rate: float) -> NDArray[np.complex128]:
    """Response of an analogue Butterworth by line of the spectrum of ``length`` samples."""
    below = signal.butter(order, 1.0, analog=True)[1]
    turn = 1j * np.fft.rfftfreq(length, 1.0 / rate) / cutoff
    return np.asarray(1.0 / np.polyval(below, turn), np.complex128)


def _passed_before(order: int, cutoff: float, samples: Array, rate: float, *, both: bool) -> Array:
    """Samples behind an analogue low-pass, band-limited; any cut-off, also above half the rate.

    ``both``: forwards and backwards.
    """
    n, pad = samples.size, min(samples.size - 1, 64 + int(order * rate / cutoff))
    spectrum, length = _spectrum_of_longer(samples, pad)
    response = _analogue(order, cutoff, length, rate)
    if both:
        response = np.abs(response) ** 2
    return np.asarray(np.fft.irfft(spectrum * response, length)[pad : pad + n])


def _filtered(term: Term, cutoff: float, samples: Array, rate: float) -> Array:
    order, both = filter_of(term)
    if not 0.0 < cutoff < _highest(term) * rate:
        return samples
    if before_sampling(term):
        return _passed_before(order, cutoff, samples, rate, both=both)
    sections = _low_pass(order, cutoff, rate, smooth=smooths(term))
    if both:
        return forwards_and_backwards(sections, samples)
    return forwards(sections, samples, _before(samples))


def turned(term: Term, cutoff: float, samples: Array, rate: float) -> Array:
    """Samples as late as a low-pass makes them, line by line, and as loud as they were.

    Where a signal hardly stands above its noise a low-pass would seem right for smoothing that;
    its delay does not smooth.
    """
    order, both = filter_of(term)
    if both or not 0.0 < cutoff < _highest(term) * rate:
        return samples
    n, pad = samples.size, min(samples.size - 1, 64 + int(order * rate / cutoff))
    spectrum, length = _spectrum_of_longer(samples, pad)
    if before_sampling(term):
        response = _analogue(order, cutoff, length, rate)
    else:
        response = _digital(order, cutoff, length, rate, smooth=smooths(term))
    size = np.abs(response)
    turn = np.divide(response, size, out=np.ones_like(response), where=size > 0.0)
    return np.asarray(np.fft.irfft(spectrum * turn, length)[pad : pad + n])


@functools.lru_cache(maxsize=16)
def _digital(
    order: int, cutoff: float, length: int, rate: float, *, smooth: bool
) -> NDArray[np.complex128]:
    """Response of a low-pass of samples by line of the spectrum of ``length`` samples."""
    lines = np.fft.rfftfreq(length, 1.0 / rate)
    found = signal.sosfreqz(_low_pass(order, cutoff, rate, smooth=smooth), lines, fs=rate)[1]
    return np.asarray(found, np.complex128)


def _highest(term: Term) -> float:
    """Cut-off over sampling rate from which a low-pass is as good as none."""
    return ABOVE if before_sampling(term) else 0.5


def _coupled(corner: float, samples: Array, rate: float, before: float | None) -> Array:
    if not 0.0 < corner < 0.5 * rate:
        return samples
    b, a = high_pass(corner, rate)
    begin = -b[0] * (_before(samples) if before is None else before)  # and for long
    return np.asarray(signal.lfilter(b, a, samples, zi=[begin])[0])


def _hum(term: Term, values: Mapping[str, float], time: Array, rest: Array) -> Array:
    """Hum of the phase that goes best with what else is left, shape (n,).

    Recordings begin at any moment and the grid wanders: each has a phase of its own, for which
    the best is taken at once (variable projection; Golub and Pereyra, Inverse Problems 19 (2003)).
    """
    base = _turning(values[f'{term.label}.frequency'], float(time[0]), float(time[-1]), time.size)
    total = np.zeros(time.size)
    for number in term.numbers:
        part, _, order = number.name.partition('_')
        if part == 'frequency':
            continue
        cosine, sine = base if order == '' else _multiple(base, int(order))
        along, across = float(cosine @ rest), float(sine @ rest)
        size = math.hypot(along, across)
        if size == 0.0:
            along = size = 1.0
        amount = values[f'{term.label}.{number.name}'] / size
        total += amount * (along * cosine + across * sine)
    return total


@functools.lru_cache(maxsize=32)
def _turning(frequency: float, first: float, last: float, count: int) -> tuple[Array, Array]:
    """Cosine and sine at even times, shapes (count,)."""
    angle = 2.0 * math.pi * frequency * np.linspace(first, last, count)
    return np.cos(angle), np.sin(angle)


def _multiple(base: tuple[Array, Array], order: int) -> tuple[Array, Array]:
    """Cosine and sine of a multiple of the angle."""
    cosine, sine = base
    for _ in range(order - 1):
        cosine, sine = cosine * base[0] - sine * base[1], sine * base[0] + cosine * base[1]
    return cosine, sine


def _running(corner: float, rate: float, rest: Array) -> Array:
    """What a coupling still holds of the time before a recording, as the rest has it, (n,)."""
    if not 0.0 < corner < 0.5 * rate:
        return np.zeros(rest.size)
    held = _fading(corner, rate, rest.size)
    return np.asarray(float(held @ rest) / float(held @ held) * held)


@functools.lru_cache(maxsize=32)
def _fading(corner: float, rate: float, count: int) -> Array:
    """How a coupling of a corner (Hz) above zero forgets, shape (count,), from one."""
    keep = -high_pass(corner, rate)[1][1]
    most = min(count, 1 + int(-FORGOTTEN / math.log(keep))) if 0.0 < keep < 1.0 else 1
    return np.asarray(np.concatenate([keep ** np.arange(most), np.zeros(count - most)]))


def _ringing(term: Term, cutoff: float, rate: float, rest: Array, at: tuple[bool, bool]) -> Array:
    """What a low-pass holds of the time outside a recording, as the rest has it, shape (n,).

    ``at``: whether the recording begins and ends in motion. A filter that runs backwards, too,
    holds what came after.
    """
    order, both = filter_of(term)
    held = np.zeros(rest.size)
    if before_sampling(term) or not 0.0 < cutoff < _highest(term) * rate:
        return held
    if at[0]:
        free = _free(order, cutoff, rate, rest.size, back=both, smooth=smooths(term))
        held[: free.shape[1]] = (free @ rest[: free.shape[1]]) @ free
    if at[1] and both:
        free = _free(order, cutoff, rate, rest.size)[:, ::-1]
        last = slice(rest.size - free.shape[1], rest.size)
        held[last] += (free @ (rest - held)[last]) @ free
    return held


@functools.lru_cache(maxsize=64)
def _free(
    order: int,
    cutoff: float,
    rate: float,
    count: int,
    *,
    back: bool = False,
    smooth: bool = False,
) -> Array:
    """What a low-pass gives without an input, orthonormal rows until it is forgotten.

    ``back``: after it has run backwards over that, too.
    """
    sections = _low_pass(order, cutoff, rate, smooth=smooth)
    most = min(count, 1 + int(-FORGOTTEN / math.log(forgets_by(sections))))
    used = (sections[:, [1, 2]] != 0.0) | (sections[:, [4, 5]] != 0.0)  # a section may be short
    begins = np.eye(2 * len(sections))[used.ravel()].reshape(-1, len(sections), 2)
    begun = begins.transpose(1, 0, 2)
    rows = signal.sosfilt(sections, np.zeros((len(begins), most)), zi=begun)[0]
    if back:
        rows = signal.sosfilt(sections, rows[:, ::-1])[:, ::-1]
    _, size, free = np.linalg.svd(rows, full_matrices=False)
    return np.ascontiguousarray(free[size > 1e-9 * size[0]])


def passed_on(
    samples: Array,
    parts: Mapping[str, Term],
    values: Mapping[str, float],
    period: float,
    begin: float,
    *,
    beyond: Array | None = None,
    measured: Array | None = None,
    moving: tuple[bool, bool] | None = None,
    before: float | None = None,
) -> Array:
    """What a chain makes of samples, shape (n,), without its clock.

    Args:
        samples: of the quantity.
        parts: effects by name.
        values: numbers by key.
        period: s between samples.
        begin: s after the recording's first sample.
        beyond: what no low-pass touches, added behind it.
        measured: what came out, from which the phase of a hum and what a filter and a coupling
            hold from before the recording are taken; zeros where it is not there.
        moving: whether the recording begins and ends in motion, where that is known; else where
            its samples are not quiet there.
        before: level before the first sample, of which a coupling has forgotten the rest; else
            that of a quiet beginning.
    """
    rate = 1.0 / period
    y = samples
    time: Array = period * np.arange(y.size, dtype=np.float64)
    if 'low_pass_filter' in parts:
        term = parts['low_pass_filter']
        y = _filtered(term, values[f'{term.label}.cutoff'], y, rate)
    if beyond is not None:
        y = y + beyond
    if 'ac_coupling' in parts:
        term = parts['ac_coupling']
        y = _coupled(values[f'{term.label}.corner'], y, rate, before)
    if 'offset' in parts:
        y = y + values[f'{parts["offset"].label}.value']
    if 'zero_drift' in parts:
        y = y + values[f'{parts["zero_drift"].label}.rate'] * time
    if any(t.own for t in parts.values()):
        at = moving or in_motion(samples)
        y = y + _of_its_own(y, parts, values, np.asarray(begin + time), rate, measured, at)
    if 'saturation' in parts:
        limit = values[f'{parts["saturation"].label}.limit']
        y = np.clip(y, -limit, limit)
    return np.asarray(y)


def _of_its_own(
    y: Array,
    parts: Mapping[str, Term],
    values: Mapping[str, float],
    time: Array,
    rate: float,
    measured: Array | None,
    at: tuple[bool, bool],
) -> Array:
    """What a recording has of its own: a filter's and a coupling's memory, and the hum, (n,)."""
    rest = np.zeros(y.size) if measured is None else measured - y
    if 'saturation' in parts and measured is not None:
        limit = values[f'{parts["saturation"].label}.limit']
        rest = np.where(np.abs(measured) < NEARLY * limit, rest, 0.0)
    total = np.zeros(y.size)
    if 'low_pass_filter' in parts and parts['low_pass_filter'].own:
        term = parts['low_pass_filter']
        total += _ringing(term, values[f'{term.label}.cutoff'], rate, rest, at)
    if 'ac_coupling' in parts and parts['ac_coupling'].own:
        term = parts['ac_coupling']
        total += _running(values[f'{term.label}.corner'], rate, rest - total)
    if 'mains_hum' in parts:
        total += _hum(parts['mains_hum'], values, time, rest - total)
    return total


def power_passed(
    terms: Sequence[Term], values: Mapping[str, float], frequency: Array, rate: float
) -> Array:
    """Share of the power that the filters among the effects let pass, by frequency, shape (n,)."""
    share = np.ones(frequency.size)
    for term in terms:
        if term.name == 'low_pass_filter':
            order, both = filter_of(term)
            cutoff = values[f'{term.label}.cutoff']
            if before_sampling(term):
                share *= (1.0 + (frequency / cutoff) ** (2 * order)) ** (-2.0 if both else -1.0)
            elif 0.0 < cutoff < 0.5 * rate:
                sections = _low_pass(order, cutoff, rate, smooth=smooths(term))
                _, h = signal.sosfreqz(sections, frequency, fs=rate)
                share *= np.abs(h) ** (4 if both else 2)
        elif term.name == 'ac_coupling':
            corner = values[f'{term.label}.corner']
            share *= frequency**2 / (frequency**2 + corner**2 + 1e-300)
    return share
