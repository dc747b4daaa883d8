"""The drift of a late clock where the recordings tell its offset alone.

An offset is told where a blow is, a good part of a second after the first sample to which it is
referred; what two quartz clocks may differ by in between is no less than the offset itself.
"""

from __future__ import annotations

import math

import numpy as np

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.fits.least_squares import Fit, fit
from impactscope.discrepancy.impact.models.bench_model import Free
from impactscope.errors import ImpactscopeError
from impactscope.physics.mechanisms.registry import mechanism

__all__ = ['with_rate']

_QUARTZ = 5e-5  # relative, to either side: what crystals without a trim are sold within
_APART = _QUARTZ * math.sqrt(2.0 / 3.0)  # standard deviation of the difference of two of them
_ITERATIONS = 6


def with_rate(candidate: Candidate, fitted: Fit) -> Fit:
    """The fit with the rate of a clock free of which the candidate knows the offset alone.

    The rate has the prior of two untrimmed quartz clocks. Other candidates' fits, and one that
    cannot be extended, are returned as they are.
    """
    if candidate.name != 'clock_error' or len(candidate.free) != 1:
        return fitted
    active = candidate.effects[0]
    limits = next(p for p in mechanism(active.name).parameters if p.name == 'drift')
    rate = Free(
        f'{active.tag}.drift', 0.0, _APART, limits.lower, limits.upper, prior=(0.0, _APART)
    )
    model = fitted.model.extended(free=(rate,))
    x = np.append(fitted.x, 0.0)
    try:
        return fit(model, fitted.layout, x, iterations=_ITERATIONS, near=fitted)
    except ImpactscopeError:
        return fitted
