"""Fewer points for a curve on a page, with every peak kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import InputError

__all__ = ['decimate_for_display']


def decimate_for_display(
    time: ArrayLike, values: ArrayLike, max_points: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Smallest and largest sample of each of ``max_points // 2`` equal stretches, in order.

    ``time`` and ``values`` have shape (n_samples,). Every point that is returned is a sample;
    the smallest and the largest of all are among them. Stretches with NaN or infinite samples
    end in a NaN, so that a drawn line breaks where data is missing. At most ``max_points``
    plus one point a stretch are returned; up to ``max_points`` samples come back as they are.

    Raises InputError where the shapes differ or fewer than two points are asked for.
    """
    t = np.asarray(time, dtype=np.float64)
    v = np.asarray(values, dtype=np.float64)
    if t.shape != v.shape or t.ndim != 1:
        raise InputError(f'time has shape {t.shape} and values {v.shape}; equal (n,) is needed')
    if max_points < 2:
        raise InputError(f'max_points is {max_points}; at least 2 are needed')
    v = np.where(np.isfinite(v), v, np.nan)
    if v.size <= max_points:
        return t, v

    stretches = max_points // 2
    width = -(-v.size // stretches)
    stretches = -(-v.size // width)
    padded = np.full(stretches * width, np.nan)
    padded[: v.size] = v
    rows = padded.reshape(stretches, width)
    missing = np.isnan(rows)
    first = np.arange(stretches) * width
    low = first + np.argmin(np.where(missing, np.inf, rows), axis=1)
    high = first + np.argmax(np.where(missing, -np.inf, rows), axis=1)
    missing[-1, v.size - first[-1] :] = False  # padding is not missing data

    picks = np.stack([np.minimum(low, high), np.maximum(low, high), first], axis=1)
    keep = np.stack(
        [np.ones(stretches, bool), low != high, missing.any(axis=1)], axis=1
    )  # a third column breaks the line
    shown = padded[picks]
    shown[:, 2] = np.nan
    # The break stands at the stretch's last point: time never runs backwards.
    picks[:, 2] = picks[:, 1]
    return t[picks[keep]], shown[keep]
