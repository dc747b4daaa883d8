"""What a model predicts: one channel of a recording, from shared numbers and its own beginning."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.models.terms import Number, Term
from impactscope.discrepancy.driven.noise.coloured_noise import Forgetting

__all__ = ['Model', 'Segment']

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """One output channel of one recording. Arrays (n,), ``drive`` as its model wants it."""

    recording: str
    channel: str
    unit: str
    held_out: bool
    begin: float  # s after the recording's first sample
    period: float  # s between samples
    measured: Array
    drive: Array
    derivative: int = 0  # 0: the output is a position, 1: a speed, 2: an acceleration
    state: tuple[float, float] = (0.0, 0.0)  # position and speed at the first sample
    noise: float = float('nan')  # stated standard deviation
    whitener: Callable[[Array], Array] | None = (
        None  # what the fit applies to residuals; None: nothing
    )
    slow: Forgetting | None = None  # and then, where noise of a colour is left

    weight: Array | None = None  # of the innovations, (n,): how much each tells

    def whitened(self, residual: Array) -> Array:
        """A residual as a fit sees it, shape (n,): innovations where the noise is known."""
        known = residual if self.whitener is None else self.whitener(residual)
        known = known if self.slow is None else self.slow(known)
        return known if self.weight is None else self.weight * known

    @property
    def time(self) -> Array:
        """Times of the samples, s after the recording's first, shape (n,)."""
        return np.asarray(self.begin + self.period * np.arange(self.measured.size), np.float64)


class Model(Protocol):
    """What the search asks of a model."""

    @property
    def numbers(self) -> tuple[Number, ...]:
        """Of the baseline."""
        ...

    @property
    def terms(self) -> tuple[Term, ...]:
        """What may be missing."""
        ...

    def starts(self, segment: Segment) -> tuple[Number, ...]:
        """Unknowns of the recording's own beginning."""
        ...

    @property
    def drifts(self) -> bool:
        """Whether an error of the force stays in the prediction for ever."""
        ...

    def predict(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> Array:
        """Predicted channel, shape (n,)."""
        ...

    def motion(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> tuple[Array, Array]:
        """Position and speed that go with the prediction, shapes (n,); may be empty."""
        ...
