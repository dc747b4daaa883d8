"""A Butterworth low-pass in one channel."""

from __future__ import annotations

import math

import numpy as np

from impactscope.physics.mechanisms.compiled import compiled
from impactscope.physics.mechanisms.mechanism import Array, Mechanism, Parameter, Subsystem, Values

__all__ = ['MECHANISM', 'forgets_by', 'forwards', 'forwards_and_backwards', 'low_pass']


def low_pass(order: int, cutoff: float, sample_rate: float) -> Array:
    """Sections of a Butterworth low-pass of samples, shape (n_sections, 6), each of gain one.

    The bilinear transform, exact at the cut-off, of each pair of poles of the analogue filter,
    the least resonant first (Oppenheim and Schafer, Discrete-Time Signal Processing, sec. 7.2 and
    app. B): in closed form, since fits ask for it thousands of times and a general design takes
    a hundred times as long.

    Args:
        order: one or more.
        cutoff: Hz, above zero and below half the sampling rate.
        sample_rate: Hz.
    """
    turn = math.tan(math.pi * cutoff / sample_rate)
    sections = np.zeros(((order + 1) // 2, 6))
    if order % 2:
        passed = turn / (1.0 + turn)
        sections[0] = passed, passed, 0.0, 1.0, (turn - 1.0) / (turn + 1.0), 0.0
    for i in range(order % 2, len(sections)):
        angle = math.pi * (2 * (len(sections) - 1 - i) + 1) / (2 * order)
        loss = 2.0 * turn * math.sin(angle)
        scale = 1.0 + loss + turn**2
        passed = turn**2 / scale
        bent = 2.0 * (turn**2 - 1.0) / scale
        sections[i] = passed, 2.0 * passed, passed, 1.0, bent, (1.0 - loss + turn**2) / scale
    return sections


def forgets_by(sections: Array) -> float:
    """Factor by which the slowest part of what sections hold fades from sample to sample."""
    half, square = -0.5 * sections[:, 4], sections[:, 5]
    apart = half**2 - square
    rings, fades = np.sqrt(np.abs(square)), np.abs(half) + np.sqrt(np.maximum(apart, 0.0))
    return float(np.max(np.where(apart < 0.0, rings, fades)))


@compiled
def _pass(sections: Array, samples: Array, before: float) -> None:
    """Samples behind sections of gain one, in their place; they have been ``before`` for long."""
    for j in range(sections.shape[0]):
        b0, b1, b2 = sections[j, 0], sections[j, 1], sections[j, 2]
        a1, a2 = sections[j, 4], sections[j, 5]
        first, second = before * (1.0 - b0), before * (b2 - a2)
        for i in range(samples.size):
            come = samples[i]
            gone = b0 * come + first
            first = b1 * come - a1 * gone + second
            second = b2 * come - a2 * gone
            samples[i] = gone


def forwards(sections: Array, samples: Array, before: float) -> Array:
    """Samples, shape (n,), behind sections of gain one; they have been ``before`` for long.

    A thousand samples pass in less time than SciPy's ``sosfilt`` takes to begin.
    """
    passed = np.array(samples, dtype=np.float64)
    _pass(sections, passed, before)
    return passed


def forwards_and_backwards(sections: Array, samples: Array) -> Array:
    """Samples, shape (n,), behind sections of gain one that run both ways: without a phase.

    At either end they go on, turned about it, as in SciPy's ``sosfiltfilt`` and as long.

    Raises:
        ValueError: with too few samples for that.
    """
    short = min(np.sum(sections[:, 2] == 0.0), np.sum(sections[:, 5] == 0.0))
    pad = 3 * int(2 * len(sections) + 1 - short)
    if samples.size <= pad:
        raise ValueError(f'{samples.size} samples are too few for a filter both ways')
    first = 2.0 * samples[0] - samples[pad:0:-1]
    last = 2.0 * samples[-1] - samples[-2 : -pad - 2 : -1]
    passed = np.concatenate([first, samples, last])
    for _ in range(2):
        _pass(sections, passed, passed[0])
        passed = passed[::-1].copy()
    return passed[pad:-pad]


def _distort(samples: Array, sample_rate: float, values: Values) -> Array:
    if values['cutoff'] >= 0.5 * sample_rate:
        return samples
    sections = low_pass(int(values['order']), values['cutoff'], sample_rate)
    if values['zero_phase']:
        return forwards_and_backwards(sections, samples)
    return forwards(sections, samples, float(samples[0]))


MECHANISM = Mechanism(
    name='low_pass_filter',
    subsystem=Subsystem.MEASUREMENT,
    sentence='A low-pass filter stands in the channel.',
    equation='Butterworth of given order and cut-off, forward or forward and backward',
    parameters=(
        Parameter('cutoff', 'Hz', 0.1, 1e6, (50.0, 200.0, 1000.0), absent=math.inf),
        Parameter('order', '1', 1, 8, (2, 4), default=2, whole=True, logarithmic=False),
        Parameter('zero_phase', '1', 0, 1, (0, 1), default=0, whole=True, logarithmic=False),
    ),
    source='ISO 6487 and SAE J211 channel filters are of this kind',
    test='a hard tap, beside an unfiltered channel',
    distort=_distort,
    kin=('clock_error',),
)
