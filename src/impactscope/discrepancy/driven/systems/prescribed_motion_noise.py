"""Noise of a force under a prescribed motion: its sensor's, and what the motion's noise does."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from impactscope.discrepancy.driven.data.trajectory import passed_by_spline
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.noise.coloured_noise import Colour, Forgetting, forgetting

__all__ = ['PrescribedMotionNoise', 'between', 'counting_of', 'power_of_noise', 'runs']

Array = NDArray[np.float64]

LITTLE = 0.03  # share of the noise that is left aside
REST = 16  # samples at rest, after which slow noise is met anew


@dataclass(frozen=True, slots=True, eq=False)
class PrescribedMotionNoise:
    """Whitens a force whose noise is a sensor's and what the motion's noise does."""

    force: float  # standard deviation of a sample
    motion: float
    band: float  # Hz, up to which the motion's noise is left in its course
    device: tuple[float, float, float]  # stiffness, damping and mass
    period: float
    ends: Array  # further variance of position, speed and acceleration near the ends, (3, n)
    wanders: Colour | None = None  # colour of the motion's noise, over its variance
    colour: Colour | None = None  # of the force's noise, over the variance of a sample
    slow: Forgetting | None = None  # whitens it
    turns: NDArray[np.bool_] | None = None  # samples that do not count, (n,)
    reach: int = 0  # of these at an end in motion; 0: they count
    _kept: dict[int, tuple[Array, Array | None]] = field(
        init=False, repr=False, default_factory=dict
    )

    def share(self, frequency: NDArray[np.floating]) -> Array:
        """Share of the noise's power that the motion's noise makes."""
        passed = self._passed(frequency)
        own = np.full(frequency.size, self.force**2)
        if self.colour is not None:
            own *= self.colour.power(2.0 * self.period * np.asarray(frequency, np.float64))
        return np.asarray(passed / (passed + own))

    def of_motion(self, size: int) -> float:
        """Mean square of a force, ``size`` samples, that the motion's noise makes."""
        return float(np.mean(self._passed(self._frequencies(size))))

    def _passed(self, frequency: NDArray[np.floating]) -> Array:
        """Power that the motion's noise makes by frequency; its mean is a sample's variance."""
        turn = 2.0 * math.pi * frequency
        stiffness, damping, mass = self.device
        passed = self.motion**2 * ((stiffness - mass * turn**2) ** 2 + (damping * turn) ** 2)
        passed = passed * passed_by_spline(0.5 * frequency / self.band)
        if self.wanders is not None:
            passed = passed * self.wanders.power(2.0 * self.period * np.asarray(frequency))
        return np.asarray(passed)

    def _frequencies(self, size: int) -> Array:
        """Those of the cosines of so many samples, Hz, shape (size,)."""
        return np.asarray(0.5 / (size * self.period) * np.arange(size, dtype=np.float64))

    def __call__(self, residual: Array) -> Array:
        """A residual, shape (n,), in units of its noise."""
        if residual.size not in self._kept:
            self._kept[residual.size] = self._weights(residual.size)
        weight, passes = self._kept[residual.size]
        if self.turns is not None:
            residual = between(residual, self.turns)
        even = weight * (residual if self.slow is None else self._slowly(residual))
        if passes is None:
            return np.asarray(even)
        # by cosines: a recording does not end where it began
        return np.asarray(fft.idct(passes * fft.dct(even)))

    def _slowly(self, residual: Array) -> Array:
        """Innovations, beginning anew after each rest: nothing is known of the level during it."""
        assert self.slow is not None  # noqa: S101 - only then is this asked
        if self.turns is None:
            return self.slow(residual)
        out = np.zeros(residual.size)
        last = 0
        for begin, end in (*runs(self.turns, REST), (residual.size, residual.size)):
            if begin > last:
                out[last:begin] = self.slow(residual[last:begin])
            last = end
        return out

    def counted(self, size: int) -> int:
        """How many of so many samples count at all."""
        return size if self.turns is None else size - int(np.count_nonzero(self.turns))

    def _weights(self, size: int) -> tuple[Array, Array | None]:
        """What each sample counts, and each line where the motion's noise matters, (n,)."""
        more = np.square(self.device) @ self.ends / self.force**2
        if self.slow is not None:
            more = more * self.slow.scale[-1] ** 2
        if self.turns is not None:
            more = np.where(self.turns, np.inf, more)
        share = self.share(self._frequencies(size))
        passes = None if np.max(share) < LITTLE else np.sqrt(1.0 - share)
        return 1.0 / np.sqrt(1.0 + more) / self.force, passes

    def knowing(self, colour: Colour, size: int) -> PrescribedMotionNoise:
        """The same where the noise of the force has a colour, in units of its white level."""
        return dataclasses.replace(self, colour=colour, slow=forgetting(colour, size))


def counting_of(segment: Segment, values: Array) -> Array:
    """Values, shape (n,), at the samples that count: none at which friction has no sign."""
    known = segment.whitener
    if isinstance(known, PrescribedMotionNoise) and known.turns is not None:
        return values[~known.turns]
    return values


def power_of_noise(segment: Segment) -> float:
    """Mean square of a sample by noise: its own, and what that of a prescribed motion makes."""
    known, own = segment.whitener, segment.noise**2
    if isinstance(known, PrescribedMotionNoise):
        return own + known.of_motion(segment.measured.size)
    return own


def between(values: Array, left_out: NDArray[np.bool_]) -> Array:
    """Values with some of them interpolated from their neighbours, shape (n,)."""
    place = np.arange(values.size)
    kept = ~left_out
    return np.where(left_out, np.interp(place, place[kept], values[kept]), values)


def runs(marked: NDArray[np.bool_], least: int = 1) -> list[tuple[int, int]]:
    """First sample of each run of marked ones, and the one behind its last."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]])))
    return [(a, b) for a, b in ends.reshape(-1, 2).tolist() if b - a >= least]
