"""Whitening of residuals over bins, by Kalman's filter of the coloured noise in them; compiled.

Each part of the noise has a state that means over bins follow and tell of (J. Basic Eng. 82,
1960): exact, however slow a part is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from impactscope.discrepancy.impact.noise.coloured_noise import Colour

__all__ = ['Whitener', 'whitener']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Whitener:
    """The residual of each bin less what those before it tell of it, over what is left of it."""

    felt: Array  # of each part of the noise in a bin, by its state, shape (n_bins, n_parts)
    keep: Array  # of a part from one bin to the next, likewise
    gain: Array  # of what a bin tells of the parts, likewise
    scale: Array  # shape (n_bins,)

    def __call__(self, residuals: Array) -> Array:
        """Whitened residuals, shape (n_bins,) or (n_bins, n_columns)."""
        columns = residuals[:, None] if residuals.ndim == 1 else residuals
        out = _whitened(np.ascontiguousarray(columns), self.felt, self.keep, self.gain, self.scale)
        return np.asarray(out[:, 0] if residuals.ndim == 1 else out)


def whitener(colour: Colour, centres: Array, counts: IntArray, std: Array) -> Whitener:
    """For residuals of bins in the order of time, each over its ``std``; shape (n_bins,) each.

    What ``std`` holds beyond the noise is taken as each bin's own.
    """
    rates = 1.0 / (colour.times * colour.sample_rate)  # of forgetting, per sample
    first = np.round(centres * colour.sample_rate - 0.5 * (counts - 1)).astype(np.int64)
    gaps = np.zeros(centres.size, dtype=np.int64)  # samples between a bin and the next
    gaps[:-1] = np.maximum(first[1:] - first[:-1] - counts[:-1], 0)
    own = np.maximum(std**2 - colour.variance_of_means(counts), 0.0)
    means = colour.white / counts + own
    return Whitener(*_filter(colour.variances, rates, counts, gaps, means, std))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _filter(
    variances: Array, rates: Array, counts: IntArray, gaps: IntArray, white: Array, std: Array
) -> tuple[Array, Array, Array, Array]:
    """Kalman's gains for means over bins: what the parts are when a bin begins is its state."""
    n, k = counts.size, variances.size
    felt, keep = np.zeros((n, k)), np.zeros((n, k))
    gain, scale = np.zeros((n, k)), np.ones(n)
    covariance = np.diag(variances)
    known, passed = np.zeros(k), np.zeros(k)
    mixed, rest = np.zeros(k), np.zeros(k)
    last = -1
    for i in range(n):
        size = counts[i]
        if size != last:
            last = size
            for j in range(k):
                each = math.exp(-rates[j])
                passed[j] = each**size
                fall = -math.expm1(-rates[j])
                known[j] = (1.0 - passed[j]) / (size * fall)  # mean from the beginning
                mean = size + 2.0 * each * (size * fall - 1.0 + passed[j]) / fall**2
                rest[j] = variances[j] * max(mean / size**2 - known[j] ** 2, 0.0)
                mixed[j] = variances[j] * known[j] * (each - passed[j])
        onward = np.zeros(k)  # covariance of the state with the mean
        power = white[i]
        for j in range(k):
            for m in range(k):
                onward[j] += covariance[j, m] * known[m]
            power += rest[j] + known[j] * onward[j]
        power = max(power, 1e-9 * std[i] ** 2)
        for j in range(k):
            gain[i, j] = (passed[j] * onward[j] + mixed[j]) / power
        for j in range(k):
            for m in range(k):
                covariance[j, m] *= passed[j] * passed[m]
                covariance[j, m] -= gain[i, j] * gain[i, m] * power
            covariance[j, j] += variances[j] * (1.0 - passed[j] ** 2)
        for j in range(k):
            fade = math.exp(-rates[j] * gaps[i])
            felt[i, j], keep[i, j] = known[j], passed[j] * fade
            gain[i, j] *= fade
            for m in range(k):
                covariance[j, m] *= fade
                covariance[m, j] *= fade
            covariance[j, j] += variances[j] * (1.0 - fade**2)
        scale[i] = std[i] / math.sqrt(power)
        for j in range(k):  # residuals come over their std
            felt[i, j] /= std[i]
            gain[i, j] *= std[i]
    return felt, keep, gain, scale


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _whitened(columns: Array, felt: Array, keep: Array, gain: Array, scale: Array) -> Array:
    n, k = felt.shape
    wide = columns.shape[1]
    out = np.empty_like(columns)
    state = np.zeros((k, wide))
    for i in range(n):
        for c in range(wide):
            left = columns[i, c]
            for j in range(k):
                left -= felt[i, j] * state[j, c]
            out[i, c] = left * scale[i]
            for j in range(k):
                state[j, c] = keep[i, j] * state[j, c] + gain[i, j] * left
    return out
