"""A case: a campaign in which a right model leaves noise alone, ready to be searched."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.adequacy.unmodelled_laws import Laws
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.chi_square import NoiseJudge
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.locate import Phase

__all__ = ['Case', 'Settled', 'throughout']

Array = NDArray[np.float64]

Settled = Callable[[Fit], tuple[Fit, list[Segment]]]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """What the noise-limited search works on. ``phases`` by segment, ``noise`` by channel."""

    model: Model
    segments: list[Segment]
    baseline: Fit
    judge: NoiseJudge
    laws: Laws
    phases: tuple[tuple[Phase, ...], ...]
    noise: Mapping[str, float]  # standard deviation of a sample
    settled: Settled | None = None  # a fit as it looks with an input as well known as may be


def throughout(segments: Sequence[Segment]) -> tuple[tuple[Phase, ...], ...]:
    """Every recording as one phase without a name."""
    return tuple((Phase('', float(s.time[0]), float(s.time[-1])),) for s in segments)
