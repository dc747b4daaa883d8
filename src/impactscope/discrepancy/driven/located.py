"""Where a plate under a hammer differs from its baseline: time, phase, band, state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.answer import Region
from impactscope.discrepancy.driven.exact import innovations
from impactscope.discrepancy.driven.fitting import Fit
from impactscope.discrepancy.driven.model import Model, Segment
from impactscope.discrepancy.driven.whitening import HammerForce
from impactscope.discrepancy.locate import Phase, Strip, locate

__all__ = ['plate_regions']

Array = NDArray[np.float64]


def plate_regions(
    model: Model,
    baseline: Fit,
    best: Fit,
    column: Array | None,
    segments: Sequence[Segment],
    forces: Sequence[HammerForce],
    rate: float,
) -> tuple[Region, ...]:
    """Regions by the rate of false discoveries, the strongest first.

    Args:
        model: of the plate.
        baseline: its fit.
        best: the extended fit.
        column: what a law beyond the vocabulary explains of the whitened residual besides, on
            the fitted recordings; None: nothing.
        segments: of all recordings.
        forces: of the same recordings.
        rate: share of false regions among those that are named.
    """
    strips, place = [], 0
    for i, (segment, force) in enumerate(zip(segments, forces, strict=True)):
        before = innovations(segment, baseline.residuals[i])
        after = innovations(segment, best.residuals[i])
        if column is not None and not segment.held_out:
            after = after - column[place : place + after.size]
            place += after.size
        x, v = model.motion(best.values, best.terms, best.starts[i], segment)
        strips.append(
            Strip(
                segment.recording,
                segment.channel,
                segment.time,
                before,
                after,
                np.asarray(x),
                np.asarray(v),
                _phases(segment, force),
            )
        )
    return locate(strips, rate)


def _phases(segment: Segment, force: HammerForce) -> tuple[Phase, ...]:
    """Before the first blow, each blow to its peak and from it, and the ring-downs."""
    time = segment.time
    end = float(time[-1])
    begins = [float(time[first]) for first, _ in force.blows]
    found = [Phase('before', float(time[0]), begins[0])]
    for (first, last), after in zip(force.blows, [*begins[1:], end], strict=True):
        peak = float(time[first + int(np.argmax(np.abs(force.force[first:last])))])
        lost = float(time[min(last, time.size - 1)])
        found.append(Phase('loading', float(time[first]), peak))
        found.append(Phase('unloading', peak, lost))
        found.append(Phase('ring_down', lost, float(after)))
    return tuple(p for p in found if p.end > p.start)
