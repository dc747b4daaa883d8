"""Standardised residuals of a channel straight from what was simulated; compiled.

Between two simulations this is most of what a fit does, and compiled it runs beside other threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from impactscope.discrepancy.impact.data.binning import BinnedChannel

__all__ = ['standardised']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


def standardised(
    channel: BinnedChannel,
    simulated: Array,
    where: IntArray,
    gain: float,
    mask: NDArray[np.bool_],
) -> Array:
    """Measured minus simulated over the noise, shape (n_used,).

    Args:
        channel: of which no effect of a measuring chain acts.
        simulated: of the channel, shape (n_moments,).
        where: the channel's nodes among the moments, shape (n_nodes,).
        gain: of the chain.
        mask: bins that are wanted, shape (n_bins,).
    """
    return np.asarray(
        _standardised(
            simulated,
            where,
            gain,
            channel.first_nodes,
            channel.node_counts,
            channel.means,
            channel.std,
            mask,
        )
    )


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _standardised(
    simulated: Array,
    where: IntArray,
    gain: float,
    first: IntArray,
    counts: IntArray,
    means: Array,
    std: Array,
    mask: NDArray[np.bool_],
) -> Array:
    out = np.empty(np.count_nonzero(mask))
    place = 0
    for i in range(means.size):
        if mask[i]:
            total = 0.0
            for j in range(first[i], first[i] + counts[i]):
                total += simulated[where[j]]
            out[place] = (means[i] - gain * total / counts[i]) / std[i]
            place += 1
    return out
