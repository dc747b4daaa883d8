"""Jumps of the acceleration where a motion turns under dry friction: slopes, residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.models.candidate_effects import FRICTION
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.terms import Term, key

__all__ = ['LEAP', 'beside_turns', 'may_jump', 'steady_slope', 'unsteady_turns']

Array = NDArray[np.float64]

LEAP = 6.0  # times the noise: a jump that single samples cannot be trusted with


def may_jump(terms: Sequence[Term], segments: Sequence[Segment]) -> bool:
    """Whether predictions jump: under dry friction the acceleration does where a motion turns."""
    return any(t.name in FRICTION for t in terms) and any(s.derivative == 2 for s in segments)


def unsteady_turns(
    terms: Sequence[Term], values: Mapping[str, float], segments: Sequence[Segment]
) -> bool:
    """Whether a misfit is rough: whole jumps count where a turn passes a sample.

    Jumps that are large beside the noise are taken by their nearer side (:func:`beside_turns`);
    small ones are not, since a choice between two that are close is a merit by itself.
    """
    if not may_jump(terms, segments):
        return False
    sizes = [
        max(abs(values.get(key(t, n), 0.0)) for n in t.numbers if 'force' in n.name)
        for t in terms
        if t.name in FRICTION
    ]
    jump = 2.0 * max(sizes) / values.get('mass', 1.0)
    return any(s.derivative == 2 and jump <= LEAP * s.noise for s in segments)


def steady_slope(ways: Sequence[Array]) -> Array:
    """Slope of a prediction by a number from differences to either side, shape (n,).

    Where the motion turns under dry friction the acceleration jumps, and a step, however small,
    moves some turns past a sample: that sample changes by the whole jump. Over a small step such
    changes would be most of the slope, and a fit, which sees steep walls where there is a smooth
    valley, ends anywhere in it, with far too small uncertainties. A turn passes a sample one way
    only: the difference to the other side is steady.
    """
    if len(ways) == 1:
        return ways[0]
    one, other = ways
    return np.where(one * other <= 0.0, 0.0, np.where(np.abs(one) < np.abs(other), one, other))


def beside_turns(left: Array, predicted: Array, speed: Array, least: float) -> Array:
    """A residual by the nearer of both sides of a jump, for samples next to it; shape (n,).

    The moment at which a motion turns is known no better than the force: whether a sample lies
    before or behind it may be chance, but off by the whole jump it would outweigh all others.

    Args:
        left: measured minus predicted.
        predicted: acceleration.
        speed: that goes with it.
        least: jump from which this is so; smaller ones are no more than noise.
    """
    way = np.sign(speed)
    before = np.flatnonzero(way[1:-2] != way[2:-1]) + 1  # samples just before a turn
    from_before = 2.0 * predicted[before] - predicted[before - 1]
    from_behind = 2.0 * predicted[before + 1] - predicted[before + 2]
    leaps = np.minimum(
        np.abs(from_before - predicted[before + 1]), np.abs(from_behind - predicted[before])
    )
    far = leaps > least
    made = left.copy()
    for at, other in ((before[far], from_behind[far]), (before[far] + 1, from_before[far])):
        moved = left[at] + predicted[at] - other
        made[at] = np.where(np.abs(moved) < np.abs(left[at]), moved, left[at])
    return made
