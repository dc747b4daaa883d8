"""The noise floor of a stream: level, drift and noise, learned from its quiet stretches."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impactscope.detect import kernels

__all__ = [
    'NoiseFloor',
    'alike',
    'hop_variances',
    'plain_powers',
    'quantum',
    'quiet_powers',
    'window_lengths',
    'without_slow_motion',
]

SMOOTH_SAMPLES = 50  # from which a stretch carries a curve of fourth degree
SLOW_SHARE = 0.01  # of a stretch's variance that a slow motion leaves at most


def window_lengths(shortest: int, hop: int) -> NDArray[np.int64]:
    """Lengths of the averaging windows in samples: shortest, times 4, and so on up to a hop."""
    lengths = []
    n = min(shortest, hop)
    while n < hop / 2:
        lengths.append(n)
        n *= 4
    return np.array([*lengths, hop], dtype=np.int64)


class NoiseFloor:
    """Level and noise of every channel over the latest quiet hops.

    The trigger channel's level is a line through the hops' means (slow drift is followed, in
    value and slope); its noise is known for each averaging window by itself, so coloured noise
    and hum raise the threshold where they matter. The other channels have mean and variance.

    Args:
        n_channels: rows of the stream.
        hop: samples of the trigger channel in a hop.
        scales: lengths of the averaging windows, the last one ``hop``. Shape (n_scales,).
        capacity: hops remembered.
    """

    def __init__(
        self, n_channels: int, hop: int, scales: NDArray[np.int64], capacity: int
    ) -> None:
        self.hop = hop
        self.scales = scales
        self.counters = np.zeros(4, dtype=np.int64)
        self.numbers = np.zeros(capacity)
        self.means = np.zeros((capacity, n_channels))
        self.variances = np.zeros((capacity, n_channels))
        self.powers = np.zeros((capacity, scales.size + 1))
        self.peaks = np.zeros((capacity, scales.size))
        self.peak = np.zeros(scales.size)
        self.bounds = np.zeros(scales.size)  # that the windows' means of a blow exceed
        self.sigma = np.zeros(scales.size + 1)  # of a sample, then of each window's mean
        self.line = np.zeros(3)
        self.rebound = np.zeros(scales.size)
        self.work = np.zeros(2 * hop)
        self.cumulative = np.zeros(2 * hop + 1)
        self.power = np.zeros(scales.size + 1)
        self.least = math.ulp(1.0)

    def level(self, number: float) -> float:
        """Level of the trigger channel predicted for a hop."""
        return float(self.line[0] + self.line[1] * (number - self.line[2]))

    def channel_levels(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean and standard deviation of every channel, trigger first; NaN where not known."""
        count = int(self.counters[kernels.COUNT])
        used = max(count - kernels.GUARD, min(count, 1))
        head = int(self.counters[kernels.HEAD])
        rows = (head - count + np.arange(used)) % self.numbers.size
        means, variances = self.means[rows], self.variances[rows]
        finite = np.isfinite(means) & np.isfinite(variances)
        known = np.maximum(finite.sum(axis=0), 1)
        mean = np.where(finite, means, 0.0).sum(axis=0) / known
        variance = np.where(finite, variances, 0.0).sum(axis=0) / known
        unknown = ~finite.any(axis=0)
        mean[unknown] = math.nan
        variance[unknown] = math.nan
        return mean, np.sqrt(variance)

    def forget(self, column: int) -> None:
        """The stretch settled on says nothing of a channel; columns as in ``means``."""
        self.means[:, column] = math.nan
        self.variances[:, column] = math.nan

    def settle(
        self,
        values: NDArray[np.float32],
        trigger_row: int,
        stride: int,
        last_number: float,
        powers: NDArray[np.float64] | None,
        threshold: float,
    ) -> None:
        """Start from a quiet stretch of whole hops, shape (n_channels, hops * hop * stride).

        Args:
            values: the stretch.
            trigger_row: row of the trigger channel.
            stride: columns from one sample of the trigger channel to the next.
            last_number: number of the stretch's last hop.
            powers: mean squares of the windows' means, shape (n_scales + 1,); None keeps the
                noise known so far.
            threshold: in sigma.
        """
        width = self.hop * stride
        hops = values.shape[1] // width
        order = [trigger_row, *(c for c in range(values.shape[0]) if c != trigger_row)]
        blocks = values[order].astype(np.float64).reshape(len(order), hops, width)
        kept = self.sigma**2 if powers is None else powers
        rows = np.arange(hops) % self.numbers.size
        self.numbers[rows] = last_number - hops + 1 + np.arange(hops)
        with np.errstate(invalid='ignore'):  # an infinite sample gives NaN
            self.means[rows] = blocks.mean(axis=2).T
            self.variances[rows] = blocks.var(axis=2).T
            self.means[rows, 0] = blocks[0, :, ::stride].mean(axis=1)
            self.variances[rows, 0] = blocks[0, :, ::stride].var(axis=1)
        self.powers[rows] = kept
        if powers is not None:  # Gaussian until more is known
            self.peaks[:] = 3 * np.sqrt(powers[1:])
        self.counters[:] = 0
        self.counters[kernels.COUNT] = min(hops, self.numbers.size)
        self.counters[kernels.HEAD] = hops
        self.rebound[:] = 0.0
        self.work[:] = 0.0
        kernels.update_floor(
            self.counters,
            self.numbers,
            self.means,
            self.powers,
            self.peaks,
            self.sigma,
            self.bounds,
            self.line,
            threshold,
            self.least,
        )


def quiet_powers(
    samples: NDArray[np.float64], scales: NDArray[np.int64], hop: int, threshold: float
) -> NDArray[np.float64] | None:
    """Mean squares of the windows' means of a stretch, or None where it is not stationary.

    The two halves must agree in level and, for the shortest and the longest window, in power:
    a ring-down, a creeping load or a blow is not quiet. Shape of ``samples`` (2 n,).

    Returns:
        shape (n_scales + 1,), the single sample's first.
    """
    if not np.isfinite(samples).all():
        return None
    half = samples.size // 2
    middle = np.median(samples)
    spread = 1.4826 * float(np.median(np.abs(samples - middle)))
    if spread == 0:
        spread = float(samples.std())
    sigma = np.full(scales.size + 1, max(spread, math.ulp(1.0)))
    rows = samples[np.newaxis].astype(np.float32)
    first, second = np.zeros_like(sigma), np.zeros_like(sigma)
    before, _ = kernels.rest_statistics(rows[0], 0, 1, half, scales, sigma, threshold, first)
    after, _ = kernels.rest_statistics(rows[0], half, 1, half, scales, sigma, threshold, second)
    powers = (first + second) / 2
    if spread == 0:
        return powers
    if not alike(first[0], second[0], 2.0) or not alike(first[-1], second[-1], 5.0):
        return None
    step = 5 * math.sqrt(2 * max(powers[-1], powers[0] / hop) * hop / half)
    return powers if abs(before - after) <= step else None


def hop_variances(values: NDArray[np.float32], width: int) -> NDArray[np.float64]:
    """Mean variance inside hops of ``width`` columns, per channel; NaN where a sample is.

    Slow motion, such as gravity's component on a swinging impactor, does not count.
    """
    blocks = values.astype(np.float64).reshape(values.shape[0], -1, width)
    with np.errstate(invalid='ignore'):  # an infinite sample gives NaN
        variances: NDArray[np.float64] = blocks.var(axis=2).mean(axis=1)
    return variances


def plain_powers(
    samples: NDArray[np.float64], scales: NDArray[np.int64], threshold: float
) -> NDArray[np.float64]:
    """Mean squares of the windows' means of whatever signal there is; as in quiet_powers."""
    powers = np.zeros(scales.size + 1)
    spread = 1.4826 * float(np.median(np.abs(samples - np.median(samples))))
    sigma = np.full(scales.size + 1, max(spread or float(samples.std()), math.ulp(1.0)))
    row = samples.astype(np.float32)
    kernels.rest_statistics(row, 0, 1, row.size, scales, sigma, threshold, powers)
    return powers


def without_slow_motion(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """What a slow swing leaves of a stretch: the noise of a plant that is never seen at rest.

    The samples themselves where a polynomial does not explain nearly all of them: vibration,
    hum and wild samples are noise.
    """
    degree = 4 if samples.size >= SMOOTH_SAMPLES else 2
    time = np.linspace(-1.0, 1.0, samples.size)
    motion = np.polynomial.Polynomial.fit(time, samples, degree)(time)
    rest = samples - motion
    slow = float(np.var(rest)) < SLOW_SHARE * float(np.var(samples))
    return rest if slow else samples


def alike(a: float, b: float, ratio: float) -> bool:
    """Whether two powers differ by no more than a factor."""
    return bool(a <= ratio * b and b <= ratio * a)


def quantum(samples: NDArray[np.float64]) -> float:
    """Step of a coarsely quantised signal, or 0 where the noise covers the steps."""
    values = np.unique(samples)
    if values.size < 2 or values.size > samples.size // 8:
        return 0.0
    return float(np.diff(values).min())
