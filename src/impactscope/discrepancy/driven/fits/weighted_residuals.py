"""What a fit adjusts, and the weighted residuals that it makes least.

Numbers that all recordings share come first, then those of each recording's beginning; all are
measured by their scales.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.fits.friction_jumps import (
    LEAP,
    beside_turns,
    may_jump,
    steady_slope,
)
from impactscope.discrepancy.driven.fits.recordings_in_parallel import by_recording
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import Number, Term, key

__all__ = [
    'STEP',
    'WeightedResiduals',
    'channel_scales',
    'counted',
    'in_units',
    'numbers_of',
    'step_of',
]

Array = NDArray[np.float64]

STEP = 1e-4  # of a number's scale, for differences ...
SMALL = 1e-6  # ... and where noise is all that is left: what rings for long bends much sooner
NEARLY = 2.0  # mean square, in units of the noise, below which that is so
LEAST = 1e-8  # of a number itself, for one that is measured by next to nothing
MEMORY = 0.1  # of a recording, beyond which accumulated errors are forgotten
FARTHEST = 1e9  # times a channel's spread: farther off is no worse


def channel_scales(segments: Sequence[Segment]) -> dict[str, float]:
    """What one is measured by in each channel: its spread in the fitted recordings."""
    scales: dict[str, float] = {}
    for channel in {s.channel for s in segments}:
        of_channel = [s for s in segments if s.channel == channel]
        chosen = [s for s in of_channel if not s.held_out] or of_channel
        spread = float(np.sqrt(np.mean(np.concatenate([s.measured for s in chosen]) ** 2)))
        scales[channel] = spread if spread > 0.0 else 1.0
    return scales


def numbers_of(model: Model, terms: tuple[Term, ...]) -> list[tuple[str, Number]]:
    """Key and number of everything shared in a model with these terms."""
    found = [(n.name, n) for n in model.numbers]
    return found + [(key(t, n), n) for t in terms for n in t.numbers]


def counted(model: Model, residual: Array, segment: Segment) -> Array:
    """A residual as a fit counts it: whitened where the noise is known, else as it is.

    Where errors of force accumulate, old ones are forgotten: the position of a mass without spring
    walks off at random under every small error of the force; plain least squares would tune
    friction to that walk. A first-order high-pass with a memory of a tenth of the recording makes
    the walk nearly white (generalised least squares).
    """
    if segment.whitener is not None:
        return segment.whitened(residual)
    if not model.drifts:
        return residual
    keep = math.exp(-1.0 / (MEMORY * residual.size))
    return np.asarray(signal.lfilter([1.0, -1.0], [1.0, -keep], residual), np.float64)


def in_units(residual: Array, segment: Segment, scales: Mapping[str, float]) -> Array:
    """A residual in units of its noise where that is known, else of its channel's spread."""
    if segment.whitener is not None:
        return segment.whitened(residual)
    return np.asarray(residual / scales[segment.channel], np.float64)


def _bounded(value: float, number: Number) -> float:
    margin = 1e-3 * number.scale
    lower, upper = number.lower + margin, number.upper - margin
    return float(min(max(value, lower), upper)) if lower < upper else value


def step_of(
    model: Model, terms: Sequence[Term], segments: Sequence[Segment], left: float
) -> float:
    """Step of a number over its scale for differences of predictions.

    It is small where something may ring and noise is about all that is ``left``: the mean square
    in units of the noise. Elsewhere, as in a motion that turns under dry friction, slopes have to
    lead across what is rough.
    """
    known = all(s.whitener is not None for s in segments)
    rings = not model.drifts and not may_jump(terms, segments)
    return SMALL if known and rings and left < NEARLY else STEP


class WeightedResiduals:
    """Residuals of a model with some effects, by what a fit adjusts.

    Attributes:
        shared: key and number of what all recordings share.
        fitted: of the segments those that are not held out.
        known: whether the noise of all segments is known; residuals are whitened then.
        jumps: whether a prediction jumps where a motion turns under dry friction.
        weights: by segment; the sum of squares is then a mean.
        begin: values to set out from, over their scales; without those of held-out recordings.
        lower, upper: bounds of all numbers, those of held-out recordings last.
    """

    def __init__(
        self,
        model: Model,
        terms: tuple[Term, ...],
        segments: Sequence[Segment],
        initial: Mapping[str, float],
        starts: Sequence[Array] | None,
    ) -> None:
        """See :func:`.simulation_error.fit`."""
        self.model, self.terms, self.segments = model, terms, segments
        self.shared = numbers_of(model, terms)
        self.own = [model.starts(s) for s in segments]
        self.fitted = [i for i, s in enumerate(segments) if not s.held_out]
        self.total = sum(segments[i].measured.size for i in self.fitted)
        self.known = all(s.whitener is not None for s in segments)
        self.jumps = may_jump(terms, segments)
        self.scales = channel_scales(segments)
        self.weights = [
            (1.0 if self.known else 1.0 / self.scales[s.channel]) / math.sqrt(self.total)
            for s in segments
        ]
        self._starts = starts
        self._last: list[tuple[Array, Array]] = []
        order = [*self.fitted, *(i for i, s in enumerate(segments) if s.held_out)]
        numbers = [*(n for _, n in self.shared), *(n for i in order for n in self.own[i])]
        self.lower = np.array([n.lower / n.scale for n in numbers])
        self.upper = np.array([n.upper / n.scale for n in numbers])
        behind = np.cumsum([len(self.shared), *(len(self.own[i]) for i in order)]).tolist()
        self._place = dict(
            zip(order, itertools.starmap(slice, itertools.pairwise(behind)), strict=True)
        )
        shared = [_bounded(initial.get(k, n.starts[0]), n) / n.scale for k, n in self.shared]
        self.begin = np.array(shared)
        for i in self.fitted:
            self.begin = self.with_beginning(self.begin, i, self.beginning(i))
        ends = np.cumsum([segments[i].measured.size for i in self.fitted])
        self._rows = {
            i: slice(int(end) - segments[i].measured.size, int(end))
            for i, end in zip(self.fitted, ends, strict=True)
        }

    def beginning(self, i: int) -> Array:
        """Where a segment's own numbers set out."""
        if self._starts is not None and self._starts[i].size == len(self.own[i]):
            return self._starts[i]
        return np.array([n.starts[0] for n in self.own[i]])

    def with_beginning(self, theta: Array, i: int, begin: Array) -> Array:
        """What is adjusted, with the next segment's own numbers behind it, in their units."""
        return np.append(theta, begin / np.array([n.scale for n in self.own[i]]))

    def values(self, theta: Array) -> dict[str, float]:
        """Shared numbers in their units."""
        return {k: float(theta[j] * n.scale) for j, (k, n) in enumerate(self.shared)}

    def start(self, theta: Array, i: int) -> Array:
        """A segment's own numbers in their units."""
        scale = np.array([n.scale for n in self.own[i]])
        return np.asarray(theta[self._place[i]] * scale, np.float64)

    def error(self, values: Mapping[str, float], begin: Array, i: int) -> Array:
        """Measured minus predicted of one segment, in the channel's unit."""
        segment = self.segments[i]
        predicted = self.model.predict(values, self.terms, begin, segment)
        left = segment.measured - predicted
        if self.jumps and self.known and segment.derivative == 2:
            _, speed = self.model.motion(values, self.terms, begin, segment)
            left = beside_turns(left, predicted, speed, LEAP * segment.noise)
        most = FARTHEST * self.scales[segment.channel]
        # a model that runs away is far off: finite, so that the fit turns back
        bounded = np.nan_to_num(left, nan=most, posinf=most, neginf=-most)
        return np.asarray(np.clip(bounded, -most, most))

    def weighted(self, error: Array, i: int) -> Array:
        """An error of one segment as it counts."""
        return self.weights[i] * counted(self.model, error, self.segments[i])

    def of_segment(self, theta: Array, i: int) -> Array:
        """Residual of one segment as it counts."""
        return self.weighted(self.error(self.values(theta), self.start(theta, i), i), i)

    def slope(self, theta: Array, j: int, i: int, here: Array, step: float = STEP) -> Array:
        """Slope of one segment's residual, which is ``here``, by a number over its scale."""
        if self.jumps:
            return self._steady(theta, j, i)
        step = max(step, LEAST * abs(float(theta[j])))
        moved = theta.copy()
        moved[j] += step
        return (self.of_segment(moved, i) - here) / step

    def _steady(self, theta: Array, j: int, i: int) -> Array:
        """The same but for samples that jump."""
        here = self.error(self.values(theta), self.start(theta, i), i)
        ways = []
        for step in (STEP, -STEP):
            moved = theta.copy()
            moved[j] += step
            if self.lower[j] <= moved[j] <= self.upper[j]:
                there = self.error(self.values(moved), self.start(moved, i), i)
                ways.append((there - here) / step)
        return self.weighted(steady_slope(ways), i)

    def residual(self, theta: Array) -> Array:
        """Residuals of all fitted segments as they count."""
        parts = by_recording(partial(self.of_segment, theta), self.fitted, self.segments)
        whole = np.concatenate(parts)
        self._last[:] = [*self._last[-2:], (theta.copy(), whole)]
        return whole

    def jacobian(self, theta: Array, first: Array | None = None) -> Array:
        """Slopes of these residuals by all that is adjusted, shape (n, k).

        ``first``: those by the first numbers, where they are known.
        """
        made = next((r for t, r in self._last if np.array_equal(t, theta)), None)
        at_theta = self.residual(theta) if made is None else made
        slopes = np.zeros((at_theta.size, theta.size))
        step = step_of(self.model, self.terms, self.segments, float(at_theta @ at_theta))
        given = 0 if first is None else first.shape[1]
        if first is not None:
            slopes[:, :given] = first
        for j in range(given, len(self.shared)):

            def column(i: int, j: int = j) -> Array:
                return self.slope(theta, j, i, at_theta[self._rows[i]], step)

            parts = by_recording(column, self.fitted, self.segments)
            slopes[:, j] = np.concatenate(parts)

        def own_columns(i: int) -> None:
            rows, place = self._rows[i], self._place[i]
            for j in range(place.start, place.stop):
                slopes[rows, j] = self.slope(theta, j, i, at_theta[rows], step)

        by_recording(own_columns, self.fitted, self.segments)
        return slopes

    def linearised(self, theta: Array, i: int) -> tuple[Array, Array, Array]:
        """Residual of one segment, its slopes by the shared numbers and by its own; all weighted.

        Shapes (m,), (m, n_shared), (m, n_own).
        """
        here, place = self.of_segment(theta, i), self._place[i]
        numbers = [*range(len(self.shared)), *range(place.start, place.stop)]
        columns = np.empty((here.size, len(numbers)))
        left = float(here @ here) * self.total / here.size
        step = step_of(self.model, self.terms, self.segments, left)
        for k, j in enumerate(numbers):
            columns[:, k] = self.slope(theta, j, i, here, step)
        return here, columns[:, : len(self.shared)], columns[:, len(self.shared) :]
