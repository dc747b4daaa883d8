"""What a gain is worth where more than the supposed noise is left about it.

A noise that is taken for too small, by a few per cent or in one band, makes every gain too large.
So a gain is measured by what the larger model leaves near it, in frequency and in time, wherever
that is clearly more than noise: a line by its neighbours, a blow by what is left of that blow (the
dispersion of a quasi-likelihood; Wedderburn, Biometrika 61 (1974)).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ['levels_above', 'worth_of']

Array = NDArray[np.float64]

NARROW = 12  # lines or samples, about, of the narrowest window
WIDER = 4  # from one width of windows to the next
CLEARLY = 3.0  # standard deviations of a mean over a window


def levels_above(power: Array, spread: float) -> Array:
    """Level of powers whose mean should be one, shape (n,), where it is clearly above that.

    Running means over ever narrower windows, each where it is clearly above the one before.

    Args:
        power: shape (n,).
        spread: variance of one of them, where nothing but noise is left.
    """
    n = power.size
    level = np.ones(n)
    total = np.concatenate([[0.0], np.cumsum(power)])
    place = np.arange(n)
    halves = [NARROW // 2]
    while halves[-1] < n:
        halves.append(WIDER * halves[-1])
    for half in reversed(halves):
        first = np.clip(place - half, 0, max(n - 2 * half - 1, 0))
        last = np.minimum(first + 2 * half + 1, n)
        count = last - first
        mean = (total[last] - total[first]) / count
        clear = mean > level * (1.0 + CLEARLY * np.sqrt(spread / count))
        level = np.where(clear, mean, level)
    return level


def worth_of(
    before: Sequence[Array], after: Sequence[Array], channels: Sequence[str] = ()
) -> list[float]:
    """Falls of chi-square from one model to another, by recording, over the dispersion left.

    Recordings of one channel have one noise: what is left of a band is seen by all of them
    together, too. A level or a drift lives in a few lines of each, which alone tell too little.

    Args:
        before: whitened residuals of the smaller model, each shape (n,).
        after: those of the larger one.
        channels: of each recording; without them every recording stands for itself.
    """
    left = [np.abs(np.fft.rfft(new)) ** 2 / new.size for new in after]
    common = _together(left, channels or [str(k) for k in range(len(left))])
    found = []
    for old, new, b, shared in zip(before, after, left, common, strict=True):
        n = new.size
        a = np.abs(np.fft.rfft(old)) ** 2 / n
        twice = np.full(a.size, 2.0)
        twice[0] = 1.0
        if n % 2 == 0:
            twice[-1] = 1.0
        lines = float(np.sum(twice * (a - b) / np.maximum(levels_above(b, 1.0), shared)))
        samples = float(np.sum((old**2 - new**2) / levels_above(new**2, 2.0)))
        gain = float(np.sum(twice * (a - b)))
        least = min(lines, samples, gain) if gain > 0.0 else gain
        found.append(least if math.isfinite(least) else gain)
    return found


def _together(powers: Sequence[Array], channels: Sequence[str]) -> list[Array]:
    """Levels of the lines of each recording, by those of its whole channel at like frequencies."""
    found = [np.ones(p.size) for p in powers]
    for channel in dict.fromkeys(channels):
        members = [k for k, c in enumerate(channels) if c == channel]
        if len(members) < 2:
            continue
        place = np.concatenate([np.linspace(0.0, 1.0, powers[k].size) for k in members])
        order = np.argsort(place, kind='stable')
        level = np.empty(place.size)
        level[order] = levels_above(np.concatenate([powers[k] for k in members])[order], 1.0)
        ends = np.cumsum([powers[k].size for k in members])[:-1]
        for k, part in zip(members, np.split(level, ends), strict=True):
            found[k] = part
    return found
