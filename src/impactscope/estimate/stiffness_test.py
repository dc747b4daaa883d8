"""Spring stiffness from a compression test, and the moving mass that follows from it.

Source: Samarathunga et al., Machines 2024, 12, 26, section 3.1.1 and Fig. 7: a single
compression or cycles of it, force against crosshead displacement; m = k/omega_n².
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import InputError
from impactscope.records import Estimate

__all__ = ['CompressionTest', 'analyse_compression', 'moving_mass', 'split_strokes']

Array = NDArray[np.float64]

_UNKNOWN = Estimate()
_BINS = 80
_FEWEST_SAMPLES = 20
_SHORTEST_RANGE = 0.3  # of the stroke: less than this is no straight line but a lucky piece
_PLAUSIBLE = (1e2, 1e8)  # N/m; outside, displacement or force is in another unit


@dataclass(frozen=True, slots=True)
class CompressionTest:
    """What a compression test tells of a spring. NaN where it could not be told."""

    valid: bool
    reason: str  # why not, in words; empty where valid
    stiffness: Estimate = _UNKNOWN  # N/m
    linear_range: tuple[float, float] = (math.nan, math.nan)  # m
    force_range: tuple[float, float] = (math.nan, math.nan)  # N, at the linear range's ends
    linearity_error: float = math.nan  # largest deviation from the line, over the force range
    hysteresis: float = math.nan  # largest loading less unloading force, over the force range
    energy_loss: float = math.nan  # share of the work of loading that unloading does not return
    rmse: float = math.nan  # N, about lines of one slope, an offset for each stroke
    r_squared: float = math.nan
    strokes: int = 0  # loading and unloading, counted apart


def split_strokes(displacement: ArrayLike, noise: float | None = None) -> list[tuple[int, int]]:
    """Spans (first, last + 1) of the monotone strokes of a displacement, shape (n_samples,).

    A reversal counts when it exceeds five times the noise (m; found from second differences
    where not given) and 2 % of the whole travel.
    """
    u = np.asarray(displacement, np.float64)
    if noise is None:
        noise = float(np.median(np.abs(np.diff(u, 2)))) / 0.6745 / math.sqrt(6)
    least = max(5 * noise, 0.02 * float(np.ptp(u)))
    turns, low, high, rising = [0], 0, 0, 0
    for i in range(1, u.size):
        if u[i] > u[high]:
            high = i
        if u[i] < u[low]:
            low = i
        if rising >= 0 and u[high] - u[i] > least:
            if rising > 0 or high > 0:
                turns.append(high)
            rising, low = -1, i
            high = i
        elif rising <= 0 and u[i] - u[low] > least:
            if rising < 0:
                turns.append(low)
            rising, high = 1, i
            low = i
    turns.append(u.size - 1)
    return [(a, b + 1) for a, b in itertools.pairwise(turns) if b > a]


def analyse_compression(
    displacement: ArrayLike,
    force: ArrayLike,
    *,
    tolerance: float = 0.01,
    force_uncertainty: float = 0.005,
    displacement_uncertainty: float = 0.005,
) -> CompressionTest:
    """Stiffness over the longest straight stretch of a compression test.

    ``displacement`` m and ``force`` N have shape (n_samples,), both growing with compression,
    over any number of strokes. The linear range is the longest in which the loading curve
    leaves a straight line by no more than ``tolerance`` of its force range: seating at the
    beginning and the end stop drop out. The two uncertainties are relative standard ones of
    the machine's channels; its frame's compliance is not known here and reads as softness.
    Slopes of all strokes are averaged, their spread counts. Raises InputError where the
    arrays do not fit together.
    """
    u, f = np.asarray(displacement, np.float64), np.asarray(force, np.float64)
    if u.shape != f.shape or u.ndim != 1:
        raise InputError(f'compression test: displacement {u.shape} and force {f.shape} differ')
    finite = np.isfinite(u) & np.isfinite(f)
    u, f = u[finite], f[finite]
    if u.size < _FEWEST_SAMPLES:
        return CompressionTest(False, f'{u.size} samples; at least {_FEWEST_SAMPLES} are needed')
    strokes = [(a, b) for a, b in split_strokes(u) if b - a >= _FEWEST_SAMPLES // 2]
    loading = [(a, b) for a, b in strokes if u[b - 1] > u[a]]
    unloading = [(a, b) for a, b in strokes if u[b - 1] < u[a]]
    if not loading:
        return CompressionTest(False, 'the displacement never rises steadily: no loading stroke')
    biggest = max(loading, key=lambda s: u[s[1] - 1] - u[s[0]])
    span = _linear_range(u[slice(*biggest)], f[slice(*biggest)], tolerance)
    if span is None:
        return CompressionTest(
            False,
            f'no stretch of {100 * _SHORTEST_RANGE:.0f} % of the stroke is straight within '
            f'{100 * tolerance:g} % of its force range',
        )
    low, high = span
    fits = [fit for s in strokes if (fit := _slope(u[slice(*s)], f[slice(*s)], low, high))]
    slopes = np.array([fit.slope for fit in fits])
    k = float(slopes.mean())
    if not _PLAUSIBLE[0] < k < _PLAUSIBLE[1]:
        return CompressionTest(
            False,
            f'the slope, {k:.4g} N/m, is that of no sensor spring: check sign and units (N, m)',
        )
    within = math.sqrt(sum(fit.variance for fit in fits)) / len(fits)
    spread = float(slopes.std(ddof=1)) / math.sqrt(len(fits)) if len(fits) > 1 else 0.0
    std = math.hypot(within, spread, k * force_uncertainty, k * displacement_uncertainty)
    residual = np.concatenate([fit.residual for fit in fits])
    inside = (u >= low) & (u <= high)
    total = f[inside] - f[inside].mean()
    full = k * (high - low)
    main = max((fit for fit in fits if fit.loads), key=lambda fit: fit.residual.size)
    gap, loss = _hysteresis(u, f, loading, unloading, low, high)
    return CompressionTest(
        True,
        '',
        Estimate(k, std),
        (low, high),
        (main.offset + main.slope * low, main.offset + main.slope * high),
        float(np.abs(_binned(main.at, main.residual)[1]).max()) / full,
        gap / full,
        loss,
        float(np.sqrt(np.mean(residual**2))),
        1 - float(residual @ residual) / float(total @ total),
        len(fits),
    )


def moving_mass(stiffness: Estimate, natural_frequency: Estimate) -> Estimate:
    """Mass k/omega_n², kg, from stiffness N/m and undamped frequency Hz, uncertainty carried."""
    if not (stiffness.value > 0 and natural_frequency.value > 0):
        raise InputError(
            f'moving mass: stiffness {stiffness.value!r} N/m and natural frequency '
            f'{natural_frequency.value!r} Hz must be above zero'
        )
    mass = stiffness.value / (2 * math.pi * natural_frequency.value) ** 2
    relative = math.hypot(
        stiffness.std / stiffness.value, 2 * natural_frequency.std / natural_frequency.value
    )
    return Estimate(mass, mass * relative)


def _binned(u: Array, f: Array) -> tuple[Array, Array]:
    """Means of both over equal steps of u, which must not be constant; empty steps left out."""
    edges = np.linspace(u.min(), u.max(), min(_BINS, max(4, u.size // 3)) + 1)
    place = np.clip(np.searchsorted(edges, u, 'right') - 1, 0, edges.size - 2)
    count = np.bincount(place, minlength=edges.size - 1)
    kept = count > 0
    mean_u = np.bincount(place, u, edges.size - 1)[kept] / count[kept]
    mean_f = np.bincount(place, f, edges.size - 1)[kept] / count[kept]
    return mean_u, mean_f


def _linear_range(u: Array, f: Array, tolerance: float) -> tuple[float, float] | None:
    """The longest stretch of a loading stroke that is a rising straight line, m."""
    x, y = _binned(u, f)
    noise = float(np.median(np.abs(np.diff(y, 2)))) / 0.6745 / math.sqrt(6) if y.size > 4 else 0.0
    travel = x[-1] - x[0]
    for length in range(x.size, 4, -1):
        best: tuple[float, float, float] | None = None
        for start in range(x.size - length + 1):
            xs, ys = x[start : start + length], y[start : start + length]
            if xs[-1] - xs[0] < _SHORTEST_RANGE * travel:
                continue
            centred = xs - xs.mean()
            slope = float(centred @ ys) / float(centred @ centred)
            worst = float(np.abs(ys - ys.mean() - slope * centred).max())
            allowed = tolerance * slope * (xs[-1] - xs[0]) + 3 * noise
            if slope > 0 and worst <= allowed and (best is None or worst < best[0]):
                best = (worst, float(xs[0]), float(xs[-1]))
        if best:
            return best[1], best[2]
    return None


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    slope: float
    offset: float
    variance: float  # of the slope
    residual: Array
    at: Array
    loads: bool


def _slope(u: Array, f: Array, low: float, high: float) -> _Line | None:
    """Line through one stroke inside the linear range; None where it covers little of it."""
    inside = (u >= low) & (u <= high)
    x, y = u[inside], f[inside]
    if x.size < _FEWEST_SAMPLES // 2 or np.ptp(x) < 0.5 * (high - low):
        return None
    centred = x - x.mean()
    power = float(centred @ centred)
    slope = float(centred @ y) / power
    residual = y - y.mean() - slope * centred
    energy = float(residual @ residual)
    # Deviations of a spring go together along the stroke: count fewer independent samples.
    lag = float(np.clip(residual[1:] @ residual[:-1] / energy, 0, 0.99)) if energy > 0 else 0.0
    variance = energy / (x.size - 2) / power * (1 + lag) / (1 - lag)
    return _Line(slope, float(y.mean() - slope * x.mean()), variance, residual, x, u[-1] > u[0])


def _hysteresis(
    u: Array,
    f: Array,
    loading: list[tuple[int, int]],
    unloading: list[tuple[int, int]],
    low: float,
    high: float,
) -> tuple[float, float]:
    """Largest force gap N between strokes, and share of work lost; NaN without unloading."""
    grid = np.linspace(low, high, _BINS)
    gaps, losses = [], []
    for up in loading:
        down = next((s for s in unloading if s[0] >= up[1] - 1), None)
        if down is None:
            continue
        curves = []
        for a, b in (up, down):
            x, y = _binned(u[a:b], f[a:b])
            if x[0] > low + 0.1 * (high - low) or x[-1] < high - 0.1 * (high - low):
                break
            curves.append(np.interp(grid, x, y))
        if len(curves) == 2:
            gaps.append(float(np.abs(curves[0] - curves[1]).max()))
            losses.append(float(1 - curves[1].mean() / curves[0].mean()))
    return (max(gaps), float(np.mean(losses))) if gaps else (math.nan, math.nan)
