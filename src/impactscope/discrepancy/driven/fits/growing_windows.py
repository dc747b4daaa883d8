"""Free swings fitted over windows that grow.

Over many cycles a slight error of the natural frequency adds up to whole cycles, and no slope
leads from one to the next. What the first cycles tell is right enough for twice as many.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.fits.simulation_error import Fit, fit
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel
from impactscope.discrepancy.driven.models.terms import Term

__all__ = ['fit_over_growing_windows', 'lost_count']

FIRST_CYCLES = 4.0
GROWS = 2.0  # from one span to the next
LOST = 0.1  # share of the signal's power that is left, from which cycles may have been miscounted
BRIEF = 20  # evaluations over each span


def lost_count(model: Model, made: Fit, segments: Sequence[Segment]) -> bool:
    """Whether a fit of free swings of many cycles leaves so much that it may have miscounted."""
    if not isinstance(model, OscillatorModel) or not model.free or model.drifts:
        return False
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    left = sum(float(np.sum(made.residuals[i] ** 2)) for i in fitted)
    power = sum(float(np.sum(segments[i].measured ** 2)) for i in fitted)
    longest = max(segments[i].measured.size * segments[i].period for i in fitted)
    return left > LOST * power and longest > GROWS * _first_span(made)


def fit_over_growing_windows(
    model: Model,
    terms: tuple[Term, ...],
    segments: Sequence[Segment],
    initial: Mapping[str, float],
    near: Fit,
) -> Fit:
    """The fit to the whole that the fits to ever longer beginnings lead to.

    Args:
        model: of free swings.
        terms: effects beyond the baseline.
        segments: of all recordings.
        initial: values to set out from, by key.
        near: a fit that tells about how long a cycle is.
    """
    values: Mapping[str, float] = dict(initial)
    starts: Sequence[NDArray[np.float64]] | None = None
    longest = max(s.measured.size * s.period for s in segments if not s.held_out)
    span = _first_span(near)
    while GROWS * span < longest:
        made = fit(model, terms, [_first(s, span) for s in segments], values, starts, BRIEF)
        values, starts = made.values, made.starts
        span *= GROWS
    return fit(model, terms, segments, values, starts)


def _first_span(near: Fit) -> float:
    """Length of the shortest beginning, s."""
    stiffness = max(near.values.get('stiffness', 0.0), 1e-300)
    return FIRST_CYCLES * 2.0 * math.pi / math.sqrt(stiffness)


def _first(segment: Segment, span: float) -> Segment:
    """The beginning of a recording; at least four samples of it."""
    count = min(max(math.ceil(span / segment.period), 4), segment.measured.size)
    return dataclasses.replace(
        segment, measured=segment.measured[:count], drive=segment.drive[: count - 1]
    )
