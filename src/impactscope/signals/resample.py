"""Band-limited interpolation of uniformly sampled sequences at fractional positions.

A 32-tap sinc under a Kaiser window (J. O. Smith, "Digital Audio Resampling"; Kaiser and Schafer
1980), tabulated at 256 phases and interpolated linearly between them. Error for a sine at
0.2 of the sampling rate: below 5e-5 of its amplitude.

It serves grids at least as fast as the sequence; a slower grid would alias, since nothing here
removes what lies above the grid's own Nyquist frequency.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from impactscope.errors import InputError

__all__ = ['HALF_TAPS', 'SINC_TABLE', 'TAPS', 'interpolate', 'resample_line']

TAPS = 32
HALF_TAPS = TAPS // 2
PHASES = 256
KAISER_BETA = 9.0  # side lobes near -90 dB; flat to 0.38 of the sampling rate


def _sinc_table() -> NDArray[np.float64]:
    """Weights of shape (PHASES + 1, TAPS): row p is for a position p/PHASES after a sample."""
    phase = np.arange(PHASES + 1)[:, None] / PHASES
    distance = phase - (np.arange(TAPS)[None, :] - (HALF_TAPS - 1))
    inside = np.clip(1.0 - (distance / HALF_TAPS) ** 2, 0.0, None)
    table = np.sinc(distance) * np.i0(KAISER_BETA * np.sqrt(inside)) / np.i0(KAISER_BETA)
    table /= table.sum(axis=1, keepdims=True)  # a constant stays the same constant
    return np.ascontiguousarray(table)


SINC_TABLE = _sinc_table()


# Reassociation and unsigned indices let the compiler use vector registers: 4 ns a row where a
# plain loop takes 50. NaN keeps its meaning, since that flag is not among the set. Positions are
# computed elsewhere, without it: there every bit counts.
@njit(cache=True, fastmath={'reassoc', 'contract', 'nsz'})  # type: ignore[untyped-decorator]
def _weigh(
    samples: NDArray[np.float32],
    nodes: NDArray[np.int64],
    fractions: NDArray[np.float64],
    table: NDArray[np.float64],
    out: NDArray[np.float32],
) -> None:
    """Fill ``out`` with the values ``fractions`` after samples ``nodes``; all taps must exist."""
    weights = table.ravel()
    next_row = np.uint64(TAPS)
    for k in range(out.size):
        scaled = fractions[k] * PHASES
        row = min(int(scaled), PHASES - 1)
        upper = scaled - row
        start = np.uint64(row * TAPS)
        first = np.uint64(nodes[k] - (HALF_TAPS - 1))
        total = 0.0
        for tap in range(np.uint64(TAPS)):
            weight = weights[start + tap]
            weight += upper * (weights[start + tap + next_row] - weight)
            total += weight * samples[first + tap]
        out[k] = total


@njit(cache=True)  # type: ignore[untyped-decorator]
def _weigh_edge(
    samples: NDArray[np.float32],
    node: int,
    fraction: float,
    low: int,
    high: int,
    table: NDArray[np.float64],
) -> float:
    """Value where taps lie outside [low, high): those there are, scaled to sum to one.

    NaN where ``node`` itself, or the sample after it, is outside.
    """
    if node < low or node + 1 >= high:
        return math.nan
    scaled = fraction * PHASES
    row = min(int(scaled), PHASES - 1)
    first = node - (HALF_TAPS - 1)
    total = 0.0
    norm = 0.0
    for tap in range(max(0, low - first), min(TAPS, high - first)):
        weight = table[row, tap] + (scaled - row) * (table[row + 1, tap] - table[row, tap])
        total += weight * samples[first + tap]
        norm += weight
    return total / norm


@njit(cache=True)  # type: ignore[untyped-decorator]
def _fill(
    samples: NDArray[np.float32],
    nodes: NDArray[np.int64],
    fractions: NDArray[np.float64],
    low: int,
    high: int,
    table: NDArray[np.float64],
    out: NDArray[np.float32],
) -> None:
    """Values ``fractions`` after the rising ``nodes``; a fraction of 0 is the sample itself."""
    begin = np.searchsorted(nodes, low + HALF_TAPS - 1)
    end = max(begin, np.searchsorted(nodes, high - HALF_TAPS))
    _weigh(samples, nodes[begin:end], fractions[begin:end], table, out[begin:end])
    for k in range(out.size):
        if fractions[k] == 0.0:
            node = nodes[k]
            out[k] = samples[node] if low <= node < high else np.float32(math.nan)
        elif k < begin or k >= end:
            out[k] = _weigh_edge(samples, nodes[k], fractions[k], low, high, table)


@njit(cache=True)  # type: ignore[untyped-decorator]
def resample_line(
    samples: NDArray[np.float32],
    low: int,
    high: int,
    base: int,
    origin: float,
    step: float,
    first: int,
    snap: float,
    table: NDArray[np.float64],
    out: NDArray[np.float32],
) -> None:
    """Values at the positions ``base + origin + (first + k) * step``, k = 0 .. out.size - 1.

    Only ``samples[low:high]`` are used; outside them the result is NaN. Positions within
    ``snap`` samples of a sample return that sample, bit for bit. Each value depends on its own
    ``first + k`` alone, so any cutting of ``out`` gives the same bits.
    """
    if step == 1.0:  # the same phase throughout, free of the rounding of a running position
        whole = math.floor(origin + 0.5)
        if abs(origin - whole) <= snap:
            node = base + whole + first
            begin = min(max(low - node, 0), out.size)
            end = max(min(high - node, out.size), begin)
            out[:begin] = math.nan
            out[end:] = math.nan
            out[begin:end] = samples[node + begin : node + end]
            return
        whole = math.floor(origin)
        nodes = np.arange(out.size) + (base + whole + first)
        _fill(samples, nodes, np.full(out.size, origin - whole), low, high, table, out)
        return
    nodes = np.empty(out.size, np.int64)
    fractions = np.empty(out.size)
    for k in range(out.size):
        position = origin + (first + k) * step
        nearest = math.floor(position + 0.5)
        if abs(position - nearest) <= snap:
            nodes[k] = base + int(nearest)
            fractions[k] = 0.0
        else:
            below = math.floor(position)
            nodes[k] = base + int(below)
            fractions[k] = position - below
    _fill(samples, nodes, fractions, low, high, table, out)


def interpolate(
    samples: NDArray[np.floating], positions: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Values of a band-limited sequence between its samples.

    Args:
        samples: shape (n_samples,), taken as float32, uniformly spaced.
        positions: shape (n_positions,), in samples after ``samples[0]``, in any order.

    Returns:
        Shape (n_positions,), float32, summed in float64. A whole position gives the sample
        itself. NaN outside [0, n_samples - 1] and wherever one of the 32 taps is NaN. Near the
        ends the taps that exist are used, scaled to sum to one.

    Raises:
        InputError: the arrays are not one-dimensional, or a position is not finite.
    """
    samples = np.ascontiguousarray(samples, dtype=np.float32)
    positions = np.ascontiguousarray(positions, dtype=np.float64)
    if samples.ndim != 1 or positions.ndim != 1:
        raise InputError(
            f'samples and positions must be one-dimensional, not of shape {samples.shape} '
            f'and {positions.shape}'
        )
    if not np.isfinite(positions).all():
        worst = positions[~np.isfinite(positions)][0]
        raise InputError(f'a position is {worst}; positions must be finite')
    order = np.argsort(positions, kind='stable')
    rising = np.clip(positions[order], -1.0, samples.size)
    nodes = np.floor(rising).astype(np.int64)
    sorted_values = np.empty(positions.size, dtype=np.float32)
    _fill(samples, nodes, rising - nodes, 0, samples.size, SINC_TABLE, sorted_values)
    out = np.empty_like(sorted_values)
    out[order] = sorted_values
    return out
