"""What the measuring chain does to a simulated channel."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.impact.bins import BinnedChannel
from impactscope.discrepancy.impact.data import BlowData
from impactscope.errors import ImpactscopeError
from impactscope.physics.mechanisms.registry import mechanism

__all__ = ['distort', 'moments_of', 'softened']

Array = NDArray[np.float64]

_KINK_TIME = 1.5e-5  # s around a reversal in which a sample may fall on either side of its jump


def moments_of(
    blow: BlowData,
    shifted: Mapping[str, list[tuple[str, dict[str, float]]]],
    whole: Mapping[str, list[tuple[str, dict[str, float]]]],
) -> tuple[Array, dict[str, NDArray[np.int64]]]:
    """Moments of the simulation where some channels need other moments than their nodes."""
    wanted = {}
    for name, channel in blow.channels.items():
        moments = channel.time if name in whole else channel.nodes
        for kind, numbers in shifted.get(name, ()):
            if kind == 'clock_error':
                moments = (moments - numbers['offset']) / (1.0 + numbers['drift'])
        wanted[name] = moments
    flat = np.concatenate(list(wanted.values()))
    times, inverse = np.unique(flat, return_inverse=True)
    where, begin = {}, 0
    for name, moments in wanted.items():
        where[name] = inverse[begin : begin + moments.size]
        begin += moments.size
    return times, where


def distort(
    kind: str, clean: Array, moments: Array, channel: BinnedChannel, numbers: Mapping[str, float]
) -> Array:
    """Values of a channel at ``moments`` (s), shape (n,), after an effect of its chain."""
    if kind == 'clock_error' or kind == 'quantisation':
        return clean
    if kind == 'offset':
        return clean + numbers['value']
    if kind == 'zero_drift':
        return clean + numbers['rate'] * moments
    if kind == 'mains_hum':
        angle = 2 * math.pi * numbers['frequency'] * moments
        return clean + numbers['sine'] * np.sin(angle) + numbers['cosine'] * np.cos(angle)
    if kind == 'saturation':
        return np.clip(clean, -numbers['limit'], numbers['limit'])
    if kind == 'low_pass_filter':
        return _low_pass(clean, channel.sample_rate, numbers)
    acting = mechanism(kind).distort
    if acting is None:
        raise ImpactscopeError(f'{kind} is not an effect on samples')
    return np.asarray(acting(clean, channel.sample_rate, numbers), dtype=np.float64)


def _low_pass(samples: Array, rate: float, numbers: Mapping[str, float]) -> Array:
    cutoff = numbers['cutoff']
    if cutoff >= 0.49 * rate:
        return samples
    sections, rest = _sections(round(numbers['order']), cutoff, rate)
    if numbers['zero_phase'] > 0.5:
        return np.asarray(signal.sosfiltfilt(sections, samples))
    return np.asarray(signal.sosfilt(sections, samples, zi=rest * samples[0])[0])


@functools.lru_cache(maxsize=64)
def _sections(order: int, cutoff: float, rate: float) -> tuple[Array, Array]:
    """Sections of a filter, and their state at rest under a constant of one."""
    sections = signal.butter(order, cutoff, fs=rate, output='sos')
    return sections, signal.sosfilt_zi(sections)


def softened(residual: Array, jump: Array, centres: Array, kinks: Array) -> Array:
    """Residuals with a jump of the acceleration as an uncertainty right at the reversals.

    ``jump`` is its size over the noise. Without this a sample that changes sides would change
    chi-square by the square of the jump, and no fit could settle.
    """
    place = np.searchsorted(centres, kinks)
    out = residual.copy()
    for shift in (-1, 0):
        index = np.clip(place + shift, 0, centres.size - 1)
        near = np.abs(centres[index] - kinks) / _KINK_TIME
        index, near = index[near < 3.0], near[near < 3.0]
        variance = (0.7 * jump[index]) ** 2 * np.exp(-(near**2))
        out[index] = residual[index] / np.sqrt(1.0 + variance)
    return out
