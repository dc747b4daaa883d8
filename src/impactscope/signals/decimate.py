"""Fewer samples of a stream, for plots, with every peak kept."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError, InputError

__all__ = ['PeakDecimator']


@njit(cache=True)  # type: ignore[untyped-decorator]
def _decimate(
    values: NDArray[np.float32],
    first: int,
    bucket: int,
    state: NDArray[np.float64],
    indices: NDArray[np.int64],
    kept: NDArray[np.float32],
) -> int:
    """Fold samples into buckets; ``state`` is (least, its index, largest, its index, count)."""
    n = 0
    for k in range(values.size):
        index = first + k
        value = values[k]
        if value == value:
            if state[4] == 0.0 or value < state[0]:
                state[0], state[1] = value, index
            if state[4] == 0.0 or value > state[2]:
                state[2], state[3] = value, index
            state[4] += 1.0
        if (index + 1) % bucket == 0:
            n = _close(index, state, indices, kept, n)
    return n


@njit(cache=True)  # type: ignore[untyped-decorator]
def _close(
    last: int,
    state: NDArray[np.float64],
    indices: NDArray[np.int64],
    kept: NDArray[np.float32],
    n: int,
) -> int:
    """Put out a bucket: extremes in the order of time, or one NaN where nothing else came."""
    if state[4] == 0.0:
        indices[n], kept[n] = last, np.nan
        return n + 1
    early, late = (0, 2) if state[1] <= state[3] else (2, 0)
    indices[n], kept[n] = int(state[early + 1]), state[early]
    n += 1
    if state[1] != state[3]:
        indices[n], kept[n] = int(state[late + 1]), state[late]
        n += 1
    state[4] = 0.0
    return n


class PeakDecimator:
    """Smallest and largest sample of each bucket, in the order of time, streaming.

    Buckets are counted from index 0, so that the result does not depend on how the stream is
    cut. A bucket of NaN alone gives one NaN. A jump of the index closes the open bucket.

    Args:
        bucket: samples that become at most two.

    Raises:
        ConfigurationError: the bucket is below one sample.
    """

    def __init__(self, bucket: int) -> None:
        if bucket < 1:
            raise ConfigurationError(f'bucket is {bucket} samples; at least 1 is needed')
        self._bucket = bucket
        self._next = 0
        self._state = np.zeros(5)

    def push(
        self, first_index: int, values: NDArray[np.float32]
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Take samples of shape (n_samples,) from ``first_index`` on.

        Returns their indices and values, each of shape (n_kept,), of the buckets now complete.

        Raises InputError where ``values`` is not one-dimensional.
        """
        values = np.ascontiguousarray(values, dtype=np.float32)
        if values.ndim != 1:
            raise InputError(f'values have shape {values.shape}; (n_samples,) is needed')
        indices = np.empty(2 * (values.size // self._bucket + 2), dtype=np.int64)
        kept = np.empty(indices.size, dtype=np.float32)
        done = 0
        if first_index != self._next and self._next % self._bucket:
            done = _close(self._next - 1, self._state, indices, kept, 0)
        done += _decimate(
            values, first_index, self._bucket, self._state, indices[done:], kept[done:]
        )
        self._next = first_index + values.size
        return indices[:done], kept[:done]

    def flush(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """The bucket that is still open, as ``push`` gives it; the stream starts afresh."""
        indices, kept = np.empty(2, dtype=np.int64), np.empty(2, dtype=np.float32)
        done = 0
        if self._next % self._bucket:
            done = _close(self._next - 1, self._state, indices, kept, 0)
        self._next = 0
        self._state[:] = 0.0
        return indices[:done], kept[:done]
