"""Samples taken at uneven times, as samples on an even grid.

Loggers of robots and of microcontrollers stamp each sample when it comes: intervals scatter, a
stamp comes twice, samples are lost. Between neighbours values follow a monotone cubic (Fritsch
and Carlson, SIAM J. Numer. Anal. 17, 1980), which adds no extremum to steps of an encoder;
where samples were lost nothing is made up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from impactscope.errors import InputError

__all__ = [
    'BACKWARDS_REMEDY',
    'LOST',
    'NO_TIME_REMEDY',
    'EvenGrid',
    'even_grid',
    'refuse_unordered',
]

Array = NDArray[np.float64]

LOST = 10.5  # median intervals without a sample: samples were lost, not late
BACKWARDS_REMEDY = (
    'cut the file there, or where its rows are evenly sampled give sample_rate (--sample-rate) '
    'in place of the time column'
)
NO_TIME_REMEDY = (
    'take such rows out, or where all rows are evenly sampled give sample_rate (--sample-rate) '
    'in place of the time column'
)


@dataclass(frozen=True, slots=True, eq=False)
class EvenGrid:
    """Columns on one even grid; NaN where samples were lost.

    ``rate`` in Hz, ``columns`` each of shape (n_samples,); ``repeated`` rows had the time of the
    row before and count as one with it, ``lost`` samples lie in gaps.
    """

    rate: float
    columns: tuple[Array, ...]
    repeated: int
    lost: int


def _merged(values: Array, first: NDArray[np.intp]) -> Array:
    """Mean of the rows of one time; ``first``: where each time begins, shape (n_times,)."""
    counts = np.diff(np.append(first, values.size))
    return np.asarray(np.add.reduceat(values, first) / counts)


def refuse_unordered(times: Array) -> None:
    """Raise InputError where times in s, shape (n,), run backwards or are not finite."""
    if not np.all(np.isfinite(times)):
        row = int(np.flatnonzero(~np.isfinite(times))[0])
        raise InputError(f'row {row}: the time is {times[row]}; {NO_TIME_REMEDY}')
    steps = np.diff(times)
    if np.any(steps < 0.0):
        row = int(np.flatnonzero(steps < 0.0)[0]) + 1
        raise InputError(
            f'row {row}: the time runs backwards ({times[row - 1]:.9g} s, then '
            f'{times[row]:.9g} s); {BACKWARDS_REMEDY}'
        )


def even_grid(times: Array, columns: Sequence[Array], rate: float | None = None) -> EvenGrid:
    """Bring columns from uneven times to an even grid that begins at the first time.

    Args:
        times: in s, shape (n,); equal ones may follow each other, none may run backwards.
        columns: values at these times, shape (n,) each; NaN counts as lost.
        rate: of the grid in Hz; None: one over the median interval.

    Raises InputError where times run backwards, are not finite, or are fewer than two.
    """
    refuse_unordered(times)
    steps = np.diff(times)
    first = np.flatnonzero(np.concatenate([[True], steps > 0.0]))
    if first.size < 2:
        raise InputError(f'{times.size} rows have {first.size} different times; two are needed')
    own = times[first]
    period = float(np.median(np.diff(own)))
    if rate is None:
        rate = float(f'{1.0 / period:.6g}')
    count = int(np.floor((own[-1] - own[0]) * rate * (1.0 + 1e-12))) + 1
    grid = np.minimum(own[0] + np.arange(count) / rate, own[-1])  # the last may round beyond
    found = []
    lost = 0
    for column in columns:
        values = _merged(column, first)
        there = np.isfinite(values)
        if np.count_nonzero(there) < 2:
            raise InputError(f'{np.count_nonzero(there)} finite samples; two are needed')
        known = own[there]
        made = PchipInterpolator(known, values[there], extrapolate=False)(grid)
        before = np.clip(np.searchsorted(known, grid, 'right') - 1, 0, known.size - 2)
        gap = (known[before + 1] - known[before] > LOST * period) & (grid != known[before])
        made[gap] = np.nan
        lost = max(lost, int(np.count_nonzero(np.isnan(made))))
        found.append(made)
    return EvenGrid(rate, tuple(found), times.size - first.size, lost)
