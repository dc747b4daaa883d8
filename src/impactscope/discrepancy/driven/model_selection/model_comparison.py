"""Comparison of two models where residuals are the error of the model, not noise.

On real machines what is left is never white: the model's own error is larger than the sensor's
noise and correlated over thousands of samples, so that counting samples proves anything. Here

* the number of samples that count is that of independent ones, n / sum(rho_k^2), which is what
  the variance of an estimated variance goes with (Bartlett; Priestley, Spectral Analysis and
  Time Series, sec. 5.3);
* where the residual is not the sensor's noise but an error of the model, at most
  ``WORTH`` samples count, however long the recording: an effect must remove a tenth or so of
  the error that is left, or it is not named (the discrepancy floor);
* recordings that were not fitted count as much as those that were.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.noise.quantisation import step_of
from impactscope.discrepancy.evidence import Thresholds, least_gain, noise_std

__all__ = ['WORTH', 'Gain', 'Judge', 'counting_samples', 'noise_floor', 'noise_share']

Array = NDArray[np.float64]

WORTH = 120.0  # independent samples that an error of the model is worth at most
SCATTER = 3.5  # standard errors from which an estimated autocorrelation counts
FINEST = 1e-7  # of the channel's spread: what single precision leaves


def counting_samples(residual: Array) -> float:
    """Number of independent samples, n / sum of squared autocorrelations, at least 1."""
    n = residual.size
    if n < 8:
        return float(n)
    centred = residual - np.mean(residual)
    length = 1 << (2 * n - 1).bit_length()
    power = np.abs(np.fft.rfft(centred, length)) ** 2
    rho = np.fft.irfft(power, length)[: n // 2]
    if rho[0] <= 0.0:
        return float(n)
    rho = rho / rho[0]
    # The scatter of an estimated autocorrelation, total / n, says nothing but would add up.
    squares, total = rho[1:] ** 2, 1.0
    for _ in range(3):
        total = 1.0 + 2.0 * float(np.sum(squares[squares > SCATTER**2 * total / n]))
    return max(n / total, 1.0)


def noise_share(residual: Array, noise: float) -> float:
    """Share of a residual's power that is the sensor's noise; ``noise`` NaN: estimated."""
    power = float(np.mean(residual**2))
    if power == 0.0:
        return 1.0
    if not math.isfinite(noise):
        noise = noise_std(residual)
    return min(noise**2 / power, 1.0) if math.isfinite(noise) else 0.0


def noise_floor(segment: Segment, residual: Array) -> float:
    """Noise of a sample: as stated, or of the residual and not below what the converter leaves."""
    if math.isfinite(segment.noise):
        return segment.noise
    step = step_of(segment.measured)
    least = FINEST * float(np.max(np.abs(segment.measured)))
    return max(noise_std(residual), step / math.sqrt(12.0), least)


def _as_seen(segment: Segment, residual: Array) -> tuple[Array, float]:
    """A residual, whitened where its noise is known, and the noise in it; NaN: not known."""
    return segment.whitened(residual), segment.noise if segment.whitener is None else 1.0


@dataclass(frozen=True, slots=True)
class Gain:
    """What a model gains over another: falls of chi-square-like evidence."""

    fitted: float
    held_out: float
    held_out_worse: bool
    numbers: int
    samples: float

    @property
    def total(self) -> float:
        """Both together."""
        return self.fitted + self.held_out


class Judge:
    """Compares fits of the same segments."""

    def __init__(
        self, segments: Sequence[Segment], candidates: int, thresholds: Thresholds | None = None
    ) -> None:
        self.segments = segments
        self.looks = max(candidates, 1)
        self.thresholds = thresholds or Thresholds()
        self.has_held_out = any(s.held_out for s in segments)
        self._weights: dict[int, tuple[float, ...]] = {}
        self._keep: list[Fit] = []  # so that identities stay unique
        self._most = [0.0] * len(segments)

    def weights(self, fit: Fit) -> tuple[float, ...]:
        """Samples that count in each segment, with this fit's residuals."""
        if id(fit) not in self._weights:
            found = []
            for segment, residual in zip(self.segments, fit.residuals, strict=True):
                left, noise = _as_seen(segment, residual)
                white = noise_share(left, noise)
                count = counting_samples(left)
                if white < 1.0:
                    count = min(count, WORTH / (1.0 - white))
                found.append(count)
            self._weights[id(fit)] = tuple(found)
            self._keep.append(fit)
            self._most = [max(a, b) for a, b in zip(self._most, found, strict=True)]
        return self._weights[id(fit)]

    def gain(self, small: Fit, large: Fit, weights: Sequence[float] | None = None) -> Gain:
        """What ``large`` gains over ``small``; negative where it is worse.

        ``weights``: samples that count by segment; those of whichever fit leaves more.
        """
        if weights is None:
            both = zip(self.weights(small), self.weights(large), strict=True)
            weights = [max(pair) for pair in both]
        fitted = held_out = count = 0.0
        worse = False
        for i, segment in enumerate(self.segments):
            size = float(np.sqrt(np.mean(segment.measured**2)))
            size = size if segment.whitener is None else size / segment.noise
            least = (FINEST * size) ** 2 + 1e-300
            before = float(np.mean(_as_seen(segment, small.residuals[i])[0] ** 2)) + least
            after = float(np.mean(_as_seen(segment, large.residuals[i])[0] ** 2)) + least
            weight = weights[i]
            value = weight * math.log(before / after)
            if segment.held_out:
                held_out += value
            else:
                fitted += value
                count += weight
        if self.has_held_out:
            worse = held_out < 0.0
        return Gain(fitted, held_out, worse, large.added - small.added, count)

    def needed(self, gain: Gain) -> float:
        """Gain from which the larger model is believed."""
        k = max(gain.numbers, 0)
        return max(self.by_chance(max(k, 1)), k * math.log(max(gain.samples, math.e)))

    def by_chance(self, numbers: int) -> float:
        """Gain of so many numbers that nothing but chance hardly ever reaches."""
        return least_gain(numbers, self.looks, self.thresholds.false_finding)

    def better(self, small: Fit, large: Fit) -> bool:
        """Whether the larger model is to be believed."""
        gain = self.gain(small, large)
        # numbers gain one each by chance: what is not seen where it was fitted is not found
        if gain.held_out_worse or gain.fitted < max(gain.numbers, 0) - 1e-9:
            return False
        return gain.total > self.needed(gain)

    def fuller(self, plain: Fit, law: Fit) -> bool:
        """Whether a law that contains another one is to be believed in its place."""
        return self.better(plain, law)

    def criterion(self, fit: Fit, reference: Fit) -> float:
        """Information criterion of a fit against a reference: smaller is better.

        All fits are weighted alike, by the samples that count where most do: criteria are
        comparable once every fit has been seen (:meth:`weights`).
        """
        self.weights(fit)
        gain = self.gain(reference, fit, self._most)
        price = math.log(max(gain.samples, math.e))
        loss = 0.0
        if gain.held_out < 0.0 and self.has_held_out:
            loss = -gain.held_out  # a worse prediction counts twice
        return -gain.total + loss + fit.added * price
