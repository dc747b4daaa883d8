"""What the ring-downs of a stream have told of the sensor's plate so far."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from impactscope.detect.plate_motion import PlateModel, fit_ring_down
from impactscope.detect.settings import DetectorSettings

__all__ = ['PlateMemory']

REMEMBERED = 32  # ring-downs


class PlateMemory:
    """Natural frequency and damping ratio: as set, or the weighted median over ring-downs.

    The median, since now and then an oscillation of plate and impactor together, or one fitted
    in much noise, passes for a free ring-down.

    Args:
        settings: of the detector; where they give the plate, nothing is learned.
    """

    def __init__(self, settings: DetectorSettings) -> None:
        self.model: PlateModel | None = None
        self._given = not math.isnan(settings.natural_frequency)
        self._found: deque[tuple[float, float, float]] = deque(maxlen=REMEMBERED)
        if self._given:
            self.model = PlateModel(
                2 * math.pi * settings.natural_frequency, settings.damping_ratio
            )

    def learn(self, ring_down: NDArray[np.float64], rate: float, noise: float) -> None:
        """Take a reading after the last contact into account, if it is a free ring-down."""
        if self._given:
            return
        found = fit_ring_down(ring_down, rate, noise)
        if found is None:
            return
        model, weight = found
        self._found.append((model.natural_frequency, model.damping_ratio, weight))
        frequencies, ratios, weights = np.array(self._found).T
        # One strong ring-down must not outvote all others.
        weights = np.minimum(weights, 3 * np.median(weights))
        self.model = PlateModel(
            _weighted_median(frequencies, weights), _weighted_median(ratios, weights)
        )


def _weighted_median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Median, each value counted by its weight, interpolated between the middle two."""
    order = np.argsort(values)
    share = np.cumsum(weights[order]) - weights[order] / 2
    return float(np.interp(share[-1] / 2 + weights[order][-1] / 4, share, values[order]))
