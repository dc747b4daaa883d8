"""Standardised residuals of a blow straight from what was simulated; compiled.

Between two simulations this is most of what a fit does. It takes some microseconds: too little to
give up the interpreter for.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from impactscope.discrepancy.impact.data.blows import BlowData
from impactscope.physics.twin.simulate import CHANNELS

__all__ = ['FittedBins', 'fitted_bins', 'standardised']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class FittedBins:
    """Bins of one blow that are fitted, one channel after the other; arrays of shape (n_used,).

    Nodes count over all channels in a row.
    """

    blow: BlowData
    columns: IntArray  # of the simulation's output, shape (n_channels,)
    which: IntArray  # channel of each bin
    first: IntArray  # node of each bin
    counts: IntArray  # nodes of each bin
    means: Array
    std: Array
    where: IntArray  # moment of each node, shape (n_nodes,)


def fitted_bins(blow: BlowData, masks: Mapping[str, NDArray[np.bool_]]) -> FittedBins:
    """Bins of a blow that ``masks`` have, by channel, each of shape (n_bins,)."""
    which, first, counts, means, std = [], [], [], [], []
    begin = 0
    for place, (name, channel) in enumerate(blow.channels.items()):
        mask = masks[name]
        which.append(np.full(int(np.count_nonzero(mask)), place))
        first.append(begin + channel.first_nodes[mask])
        counts.append(channel.node_counts[mask])
        means.append(channel.means[mask])
        std.append(channel.std[mask])
        begin += channel.nodes.size
    return FittedBins(
        blow=blow,
        columns=np.array([CHANNELS[name][1] for name in blow.channels]),
        which=np.concatenate(which),
        first=np.concatenate(first),
        counts=np.concatenate(counts),
        means=np.concatenate(means),
        std=np.concatenate(std),
        where=np.concatenate([blow.where[name] for name in blow.channels]),
    )


def standardised(
    bins: FittedBins,
    rows: Array,
    where: Mapping[str, IntArray],
    gains: Mapping[str, float],
    left_out: Collection[str] = (),
) -> Array:
    """Measured minus simulated over the noise, shape (n_used,).

    Args:
        bins: of the blow.
        rows: what was simulated at the first moments, shape (n_simulated, n_columns).
        where: nodes of each channel among the moments, each of shape (n_nodes,).
        gains: of the channels.
        left_out: channels on which an effect of a measuring chain acts: theirs stay zero.
    """
    names = bins.blow.channels
    moments = bins.where
    if where is not bins.blow.where:
        moments = np.concatenate(
            [
                np.zeros(c.nodes.size, dtype=np.int64) if n in left_out else where[n]
                for n, c in names.items()
            ]
        )
    factors = np.array([np.nan if n in left_out else gains[n] for n in names])
    return np.asarray(
        _standardised(
            rows,
            moments,
            bins.columns,
            factors,
            bins.which,
            bins.first,
            bins.counts,
            bins.means,
            bins.std,
        )
    )


@njit(cache=True)  # type: ignore[untyped-decorator]
def _standardised(
    rows: Array,
    moments: IntArray,
    columns: IntArray,
    gains: Array,
    which: IntArray,
    first: IntArray,
    counts: IntArray,
    means: Array,
    std: Array,
) -> Array:
    """A channel whose gain is not a number is left out."""
    out = np.zeros(means.size)
    for i in range(means.size):
        gain = gains[which[i]]
        if np.isnan(gain):
            continue
        column = columns[which[i]]
        total = 0.0
        for j in range(first[i], first[i] + counts[i]):
            if moments[j] < rows.shape[0]:
                total += rows[moments[j], column]
        out[i] = (means[i] - gain * total / counts[i]) / std[i]
    return out
