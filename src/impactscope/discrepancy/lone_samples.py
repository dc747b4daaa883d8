"""Samples that are further from a model than its noise would ever be, and too few to say why.

A lost sample, a disturbance on the line, an amplifier that is too slow for a blow of a few
samples: no law of many samples stands behind them, so they decide nothing. But who measures has to
be told, and where.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from impactscope.discrepancy.answer import Finding

__all__ = ['Left', 'lone_samples_told']

Array = NDArray[np.float64]

CHANCE = 1e-4  # that noise has one such sample among all
MOST = 40  # samples that are few
LISTED = 5
_ROUNDS = frozenset({'quantisation', 'saturation'})
NOISY = 1.1  # times what it should be: what is left of a channel that is not noise alone


class Left(NamedTuple):
    """What a model leaves of one channel of one recording, over its noise, shape (n,)."""

    recording: str
    channel: str
    time: Array  # s
    residual: Array


def lone_samples_told(
    channels: Iterable[Left], findings: Iterable[Finding] = ()
) -> tuple[str, ...]:
    """A note that names such samples, the furthest first; none where there are none, or many.

    Channels of which more than noise is left do not count: there a model is wrong for more than
    a few samples. Nor do those that ``findings`` say to be rounded or clipped, which is what
    such samples are then.
    """
    told = {f.channel for f in findings if f.name in _ROUNDS}
    known = [
        c for c in channels if c.channel not in told and c.residual.size and _is_noise(c.residual)
    ]
    total = sum(c.residual.size for c in known)
    if not total:
        return ()
    most = float(stats.norm.isf(0.5 * CHANCE / total))
    off = [
        (abs(float(c.residual[i])), c.channel, c.recording, float(c.time[i]))
        for c in known
        for i in np.flatnonzero(np.abs(c.residual) > most).tolist()
    ]
    if not 0 < len(off) <= MOST:
        return ()
    off.sort(reverse=True)
    places = ', '.join(
        f'{name} of {file} at {t:.5g} s ({z:.1f})' for z, name, file, t in off[:LISTED]
    )
    more = f' and {len(off) - LISTED} more' if len(off) > LISTED else ''
    samples = '1 sample is' if len(off) == 1 else f'{len(off)} samples are'
    return (
        f'{samples} further off than noise would ever be, and too few to say why: {places}{more}; '
        'in brackets: standard deviations. Lost or disturbed samples and amplifiers that are too '
        'slow read so.',
    )


def _is_noise(residual: Array) -> bool:
    """Whether the bulk of what is left is no more than noise."""
    finite = bool(np.all(np.isfinite(residual)))
    return finite and 1.4826 * float(np.median(np.abs(residual))) < NOISY * (
        1.0 + 2.0 / math.sqrt(residual.size)
    )
