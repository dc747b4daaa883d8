"""Where recordings whose residual is noise differ from a baseline: time, phase, band, state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.answer import Region
from impactscope.discrepancy.driven.fits.innovations import innovations
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.locate import Phase, Strip, locate

__all__ = ['case_regions']

Array = NDArray[np.float64]


def case_regions(
    model: Model,
    baseline: Fit,
    best: Fit,
    column: Array | None,
    segments: Sequence[Segment],
    phases: Sequence[tuple[Phase, ...]],
    rate: float,
) -> tuple[Region, ...]:
    """Regions by the rate of false discoveries, the strongest first.

    Args:
        model: of the case.
        baseline: its fit.
        best: the extended fit.
        column: what a law beyond the vocabulary explains of the whitened residual besides, on
            the fitted recordings; None: nothing.
        segments: of all recordings.
        phases: of the same recordings.
        rate: share of false regions among those that are named.
    """
    strips, place = [], 0
    for i, (segment, stretch) in enumerate(zip(segments, phases, strict=True)):
        before = innovations(segment, baseline.residuals[i])
        after = innovations(segment, best.residuals[i])
        if column is not None and not segment.held_out:
            after = after - column[place : place + after.size]
            place += after.size
        x, v = model.motion(best.values, best.terms, best.starts[i], segment)
        still = np.zeros(segment.measured.size)
        x, v = (x, v) if x.size else (still, still)
        strips.append(
            Strip(
                segment.recording,
                segment.channel,
                segment.time,
                before,
                after,
                np.asarray(x),
                np.asarray(v),
                stretch,
                segment.held_out,
            )
        )
    return locate(strips, rate)
