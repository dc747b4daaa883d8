"""Whitened residuals, in units of their noise, of one recording and of several."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.models.model import Segment

__all__ = ['each_alone', 'innovations', 'joined']

Array = NDArray[np.float64]


def innovations(segment: Segment, residual: Array) -> Array:
    """A residual, whitened and in units of its noise, shape (n,)."""
    assert segment.whitener is not None  # noqa: S101 - only such segments come here
    return segment.whitened(residual)


def joined(segments: Sequence[Segment], parts: Sequence[Array]) -> Array:
    """Changes of several recordings as one whitened column, shape (n,)."""
    pairs = zip(segments, parts, strict=True)
    return np.concatenate([innovations(s, p) for s, p in pairs])


def each_alone(segments: Sequence[Segment], parts: Sequence[Array]) -> list[Array]:
    """One such column for each recording, zero in the others."""
    return [
        joined(segments, [p if j == k else np.zeros(p.size) for j, p in enumerate(parts)])
        for k in range(len(parts))
    ]
