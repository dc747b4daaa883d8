"""What the ring-downs of a stream have told of the sensor's plate so far."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impactscope.detect.plate_motion import PlateModel, fit_ring_down
from impactscope.detect.settings import DetectorSettings

__all__ = ['PlateMemory']

SAME_PLATE = 0.05  # relative difference of natural frequencies beyond which it is another plate


class PlateMemory:
    """Natural frequency and damping ratio: as set, or the weighted mean over ring-downs.

    Args:
        settings: of the detector; where they give the plate, nothing is learned.
    """

    def __init__(self, settings: DetectorSettings) -> None:
        self.model: PlateModel | None = None
        self._given = not math.isnan(settings.natural_frequency)
        self._weight = 0.0
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
        known = self.model
        if known is not None:
            ratio = model.natural_frequency / known.natural_frequency
            if abs(math.log(ratio)) < SAME_PLATE:
                total = self._weight + weight
                share = weight / total
                self.model = PlateModel(
                    known.natural_frequency * (1 - share) + model.natural_frequency * share,
                    known.damping_ratio * (1 - share) + model.damping_ratio * share,
                )
                self._weight = total
                return
            if weight < self._weight:
                return
        self.model, self._weight = model, weight
