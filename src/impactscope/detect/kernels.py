"""Compiled inner loops of the impact detector.

A *hop* is the step of the analysis: a fixed number of samples of the trigger channel, counted
from the first sample of the epoch, so that nothing depends on how the stream was cut.

The detection statistic is the mean over a short window of the deviation from the predicted
zero level, each sample limited to a few standard deviations beforehand (a limiter before a
matched filter, the classical detector for a signal of unknown shape in noise with outliers): a
single wild sample cannot raise it, a blow that lasts can. Windows of several lengths share the
work, since blows last from 0.3 ms (hammer) to seconds (clamping).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    'ADMITTED',
    'GUARD',
    'LIMIT',
    'QUIET',
    'TRIGGERED',
    'UNSETTLED',
    'hop_extremes',
    'limit',
    'limited_means',
    'rest_statistics',
    'scan_hops',
    'update_floor',
]

LIMIT = 4.0  # standard deviations to which a sample's deviation counts, at least
REACH = 1.5  # times the threshold that a blow of limited samples can raise the statistic to
TAIL = 10.0  # standard deviations of the hops' maxima beyond their mean that a blow must reach
LEAST_FOR_SLOPE = 50
GUARD = 2  # newest hops left out of the floor: they may hold the creeping start of a blow
REBOUND = 1.1  # a positive half-wave up to this times the negative one before it is ring-down
REBOUND_DECAY = 0.9  # by which the memory of a negative half-wave fades, a hop

QUIET, TRIGGERED, UNSETTLED = 0, 1, 2
COUNT, HEAD, ADMITTED, REJECTED_RUN = 0, 1, 2, 3  # places in the counter array


@njit(cache=True)  # type: ignore[untyped-decorator]
def limit(sigma: NDArray[np.float64], threshold: float) -> float:
    """Deviation to which a sample counts.

    In white noise about 5 sigma; more in coloured noise, where averaging lowers the noise
    less and a tighter limit would keep every blow below the threshold.
    """
    return float(max(LIMIT * sigma[0], REACH * threshold * sigma[1]))


@njit(cache=True)  # type: ignore[untyped-decorator]
def update_floor(
    counters: NDArray[np.int64],
    numbers: NDArray[np.float64],
    means: NDArray[np.float64],
    powers: NDArray[np.float64],
    peaks: NDArray[np.float64],
    sigma: NDArray[np.float64],
    bounds: NDArray[np.float64],
    line: NDArray[np.float64],
    threshold: float,
    least: float,
) -> None:
    """Level line (level, slope a hop, reference hop), sigma and bounds from the hops in memory.

    ``bounds`` are what the windows' means must exceed: the threshold in sigma or, in noise with
    heavier tails than Gaussian, where the hops' maxima extrapolate to (their tail is about
    exponential: 10 standard deviations are some 10^5.5 hops, about an hour).

    The line is the least-squares one through the hops' means; below 50 hops it is level, since
    a slope from fewer would be extrapolated noise.
    """
    capacity = numbers.shape[0]
    count = min(counters[COUNT], capacity)
    used = max(count - GUARD, min(count, 1))
    # Unless the memory is full it holds rows 0 to count; the newest are left out.
    oldest = (counters[HEAD] - count) % capacity
    sigma[:] = 0.0
    mean_number = 0.0
    mean_level = 0.0
    for j in range(used):
        row = oldest + j if oldest + j < capacity else oldest + j - capacity
        mean_number += numbers[row]
        mean_level += means[row, 0]
        for s in range(sigma.shape[0]):
            sigma[s] += powers[row, s]
    mean_number /= used
    mean_level /= used
    slope = 0.0
    if used >= LEAST_FOR_SLOPE:
        spread = 0.0
        for j in range(used):
            row = oldest + j if oldest + j < capacity else oldest + j - capacity
            distance = numbers[row] - mean_number
            spread += distance * distance
            slope += distance * (means[row, 0] - mean_level)
        slope /= spread
    line[0], line[1], line[2] = mean_level, slope, mean_number
    for s in range(sigma.shape[0]):
        sigma[s] = max(np.sqrt(sigma[s] / used), least)
    for s in range(bounds.shape[0]):
        total = 0.0
        square = 0.0
        for j in range(used):
            row = oldest + j if oldest + j < capacity else oldest + j - capacity
            total += peaks[row, s]
            square += peaks[row, s] * peaks[row, s]
        total /= used
        tail = total + TAIL * np.sqrt(max(square / used - total * total, 0.0))
        bounds[s] = threshold * sigma[s + 1]
        if s < bounds.shape[0] - 1:  # the longest window averages wild samples away
            bounds[s] = max(bounds[s], tail)


@njit(cache=True)  # type: ignore[untyped-decorator]
def limited_means(
    row: NDArray[np.float32],
    start: int,
    stride: int,
    length: int,
    level: float,
    bound: float,
    work: NDArray[np.float64],
    cumulative: NDArray[np.float64],
) -> bool:
    """Limited deviations of one hop behind those of the one before, and their running sum.

    ``work`` and ``cumulative`` have shapes (2 hop,) and (2 hop + 1,); the first half of work
    is the hop before. Non-finite samples count as zero deviation. Returns whether all were finite.
    """
    hop = work.shape[0] // 2
    finite = True
    for i in range(length):
        deviation = row[start + i * stride] - level
        if not np.isfinite(deviation):
            deviation = 0.0
            finite = False
        work[hop + i] = min(max(deviation, -bound), bound)
    cumulative[0] = 0.0
    for i in range(hop + length):
        cumulative[i + 1] = cumulative[i] + work[i]
    return finite


@njit(cache=True)  # type: ignore[untyped-decorator]
def scan_hops(
    values: NDArray[np.float32],
    trigger_row: int,
    start: int,
    hops: int,
    length: int,
    stride: int,
    first_number: float,
    scales: NDArray[np.int64],
    polarity: int,
    threshold: float,
    release: float,
    patience: int,
    least: float,
    counters: NDArray[np.int64],
    numbers: NDArray[np.float64],
    means: NDArray[np.float64],
    variances: NDArray[np.float64],
    powers: NDArray[np.float64],
    peaks: NDArray[np.float64],
    sigma: NDArray[np.float64],
    bounds: NDArray[np.float64],
    line: NDArray[np.float64],
    rebound: NDArray[np.float64],
    work: NDArray[np.float64],
    cumulative: NDArray[np.float64],
    power: NDArray[np.float64],
    peak: NDArray[np.float64],
) -> tuple[int, int, int]:
    """Look for a blow in ``hops`` hops of ``length`` samples from column ``start`` on.

    ``values`` has shape (n_channels, n_columns); quiet hops are taken into the floor on the way
    (column 0 of ``means`` is the trigger channel; the other rows follow in their order).
    Returns hops done, what stopped the scan (QUIET: nothing) and, for TRIGGERED, the first
    sample of the window that triggered, counted from the start of its hop.
    """
    hop = work.shape[0] // 2
    row = values[trigger_row]
    for h in range(hops):
        column = start + h * hop * stride
        number = first_number + h
        level = line[0] + line[1] * (number - line[2])
        finite = limited_means(
            row, column, stride, length, level, limit(sigma, threshold), work, cumulative
        )
        quiet = finite
        found = -1
        square = 0.0
        for i in range(hop, hop + length):
            square += work[i] * work[i]
        power[0] = square / length
        for s in range(scales.shape[0]):
            n = scales[s]
            bound = bounds[s] * n
            calm = bound - (threshold - release) * sigma[s + 1] * n
            largest = 0.0
            fall = rebound[s] * n
            square = 0.0
            for i in range(hop, hop + length):
                total = cumulative[i + 1] - cumulative[i + 1 - n]
                square += total * total
                if polarity != 0:
                    total *= polarity
                    fall = max(fall, -total)
                    if total > bound and total > REBOUND * fall and (found < 0 or i - n < found):
                        found = i - n
                        break
                elif abs(total) > bound and (found < 0 or i - n < found):
                    found = i - n
                    break
                largest = max(largest, abs(total))
            if largest > calm:
                quiet = False
            peak[s] = largest / n
            power[s + 1] = square / (length * n * n)
            rebound[s] = fall / n * REBOUND_DECAY
        if found >= 0:
            return h, TRIGGERED, found + 1 - hop
        work[:hop] = work[hop:]
        if quiet and length == hop:
            counters[REJECTED_RUN] = 0
            counters[ADMITTED] += 1
            place = counters[HEAD] % numbers.shape[0]
            numbers[place] = number
            powers[place] = power
            peaks[place] = peak
            column_of = 0
            for c in range(values.shape[0]):
                k = 0
                if c != trigger_row:
                    column_of += 1
                    k = column_of
                means[place, k], variances[place, k] = _moments(
                    values[c],
                    column,
                    stride if c == trigger_row else 1,
                    hop if c == trigger_row else hop * stride,
                )
            counters[HEAD] += 1
            counters[COUNT] = min(counters[COUNT] + 1, numbers.shape[0])
            update_floor(
                counters, numbers, means, powers, peaks, sigma, bounds, line, threshold, least
            )
        else:
            counters[REJECTED_RUN] += 1
            if counters[REJECTED_RUN] >= patience:
                return h + 1, UNSETTLED, 0
    return hops, QUIET, 0


@njit(cache=True)  # type: ignore[untyped-decorator]
def _moments(
    row: NDArray[np.float32], start: int, stride: int, length: int
) -> tuple[float, float]:
    """Mean and variance; NaN where a sample is."""
    origin = float(row[start])
    total = 0.0
    square = 0.0
    for i in range(length):
        deviation = row[start + i * stride] - origin
        total += deviation
        square += deviation * deviation
    mean = total / length
    return origin + mean, max(square / length - mean * mean, 0.0)


@njit(cache=True)  # type: ignore[untyped-decorator]
def hop_extremes(
    row: NDArray[np.float32], start: int, stride: int, length: int, n: int
) -> tuple[float, float, float, bool]:
    """Mean, largest and smallest n-sample mean, and whether all samples of a hop are finite.

    Windows reach back into the hop before.
    """
    total = 0.0
    for i in range(1 - n, 1):
        total += row[start + i * stride]
    whole = 0.0
    largest = -np.inf
    smallest = np.inf
    finite = np.isfinite(total)
    for i in range(length):
        if i > 0:
            total += row[start + i * stride] - row[start + (i - n) * stride]
        value = row[start + i * stride]
        finite = finite and bool(np.isfinite(value))
        whole += value
        largest = max(largest, total / n)
        smallest = min(smallest, total / n)
    return whole / length, largest, smallest, finite


@njit(cache=True)  # type: ignore[untyped-decorator]
def rest_statistics(
    row: NDArray[np.float32],
    start: int,
    stride: int,
    length: int,
    scales: NDArray[np.int64],
    sigma: NDArray[np.float64],
    threshold: float,
    powers: NDArray[np.float64],
) -> tuple[float, float]:
    """Level of a stretch and the largest deviation from it in sigma, over all windows.

    ``powers`` (n_scales + 1,) receives the mean square of the windows' means about the level,
    samples limited as in the scan. Level and deviation are NaN where a sample is not finite.
    """
    level = 0.0
    for i in range(length):
        level += row[start + i * stride]
    level /= length
    powers[:] = 0.0
    if not np.isfinite(level):
        return np.nan, np.nan
    bound = limit(sigma, threshold)
    largest = 0.0
    for i in range(length):
        deviation = min(max(row[start + i * stride] - level, -bound), bound)
        powers[0] += deviation * deviation / length
    for s in range(scales.shape[0]):
        n = scales[s]
        total = 0.0
        for i in range(length):
            total += min(max(row[start + i * stride] - level, -bound), bound)
            if i >= n:
                total -= min(max(row[start + (i - n) * stride] - level, -bound), bound)
            if i >= n - 1:
                powers[s + 1] += total * total
                largest = max(largest, abs(total) / (n * sigma[s + 1]))
        powers[s + 1] /= (length - n + 1) * float(n) * n
    return level, largest
