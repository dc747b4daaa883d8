"""Transient and quasi-static force of one blow, with their uncertainty.

F_T is the largest force up to ``transient_window`` after first contact, F_S the largest after
it while contact lasts (ISO/TS 15066 divides contact at 0.5 s; which samples count is a rule of
the measurement profile). The zero level is removed; nothing is filtered or corrected, since the
limits presume the reading of the device as it is.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import InputError
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import Estimate, ImpactEvent

__all__ = ['ForceEvaluation', 'ForceReading', 'evaluate', 'read_force']

COVERAGE_FACTOR = 2.0  # expanded uncertainty (95 %) over standard uncertainty


@dataclass(frozen=True, slots=True, eq=False)
class ForceReading:
    """The samples that are judged, as the device gave them; times in s after the first of them.

    ``samples`` (N) has shape (n_samples,), float32, the zero level still in it; it is a view of
    the event's values.
    """

    row: int  # of the channel in the event
    samples: NDArray[np.float32]
    sample_rate: float  # Hz, of these samples
    zero_level: float  # N; NaN where not known
    noise_std: float  # N; NaN where not known

    @property
    def end(self) -> float:
        """Time of the last sample."""
        return self.time_of(self.samples.size - 1)

    def time_of(self, index: int) -> float:
        """Time of a sample."""
        return index / self.sample_rate

    def samples_to(self, time: float) -> int:
        """How many samples there are up to and including this time."""
        # A millionth of a sample, so that a time that falls on a sample includes it.
        count = math.floor(time * self.sample_rate + 1e-6) + 1
        return min(max(count, 0), self.samples.size)

    def largest(self, first: int, stop: int) -> tuple[float, float]:
        """Largest finite force, zero level removed, of samples first...stop-1, and its time.

        NaN where there is none.
        """
        span = self.samples[first:stop]
        if not span.size:
            return math.nan, math.nan
        at = int(np.argmax(span))  # a NaN or an infinity is found first
        if not math.isfinite(span[at]):
            finite = np.isfinite(span)
            if not finite.any():
                return math.nan, math.nan
            at = int(np.argmax(np.where(finite, span, -np.inf)))
        return float(span[at]) - self.zero_level, self.time_of(first + at)

    def smallest(self) -> float:
        """Smallest finite force, zero level removed; NaN where there is none."""
        low = float(np.min(self.samples))
        if not math.isfinite(low):
            finite = self.samples[np.isfinite(self.samples)]
            low = float(np.min(finite)) if finite.size else math.nan
        return low - self.zero_level


@dataclass(frozen=True, slots=True)
class ForceEvaluation:
    """F_T and F_S of one blow; times in s after first contact, NaN where there is no such phase.

    ``quasi_static`` is NaN where contact ended within the transient window.
    """

    transient: Estimate  # N
    transient_time: float
    quasi_static: Estimate  # N
    quasi_static_time: float
    contact_duration: float  # s, first contact to the end of the last
    noise_std: float  # N, of one sample
    zero_std: float  # N, of the zero level
    relative_uncertainty: float  # expanded (95 %), of the calibration

    def standard_uncertainty(self, force: float) -> float:
        """Standard uncertainty in N of a reading of this size: calibration, noise, zero level."""
        calibration = self.relative_uncertainty / COVERAGE_FACTOR * force
        return math.hypot(calibration, self.noise_std, self.zero_std)

    def guard_band(self, limit: float) -> float:
        """Half-width in N of the guard band at a limit: the expanded uncertainty there.

        Taken at the limit and not at the reading, so that the edges are known beforehand and
        stay where they are when the force rises.
        """
        return COVERAGE_FACTOR * self.standard_uncertainty(limit)


def read_force(event: ImpactEvent, channel: str = 'force') -> ForceReading:
    """The samples of the force channel that are judged.

    For the reference channel (row 0) these are its own, which stand untouched at every
    ``oversampling``-th sample of the window; another channel's are taken from the grid.

    Raises:
        InputError: the event lacks the channel, or its parts contradict each other.
    """
    row = event.index_of(channel)
    if row is None:
        raise InputError(f'event {event.event_id} has no channel {channel!r}')
    values = event.values
    if values.ndim != 2 or values.shape[0] != len(event.channels) or values.shape[1] == 0:
        raise InputError(
            f'event {event.event_id} has values of shape {values.shape} '
            f'for {len(event.channels)} channels'
        )
    if not math.isfinite(event.sample_rate) or event.sample_rate <= 0 or event.oversampling < 1:
        raise InputError(
            f'event {event.event_id} has the sample rate {event.sample_rate} Hz '
            f'and the oversampling {event.oversampling}'
        )
    end = (values.shape[1] + 0.5) / event.sample_rate  # times are rounded
    if not 0 <= event.contact_start <= event.contact_end <= end:  # false for NaN, too
        raise InputError(
            f'event {event.event_id} has contact from {event.contact_start} s to '
            f'{event.contact_end} s in a window of {end:.4g} s'
        )
    step = event.oversampling if row == 0 else 1
    rate = event.sample_rate / step
    zero = event.zero_level[row] if row < len(event.zero_level) else math.nan
    noise = event.noise_std[row] if row < len(event.noise_std) else math.nan
    return ForceReading(
        row=row,
        samples=values[row, ::step],
        sample_rate=rate,
        zero_level=zero if math.isfinite(zero) else math.nan,
        noise_std=noise if math.isfinite(noise) and noise >= 0 else math.nan,
    )


def evaluate(
    event: ImpactEvent, reading: ForceReading, profile: MeasurementProfile
) -> ForceEvaluation:
    """F_T and F_S from the finite samples of a reading.

    Samples before first contact count as transient: a contact that was noticed late must not
    hide its peak. Where noise is not known it enters as zero; such a blow is not judged, but a
    force far above a limit is still seen.
    """
    start = event.contact_start
    noise = reading.noise_std if math.isfinite(reading.noise_std) else 0.0
    # The zero level is a mean over the quiet samples before the blow, whose noise is taken as
    # independent.
    quiet = max(1, reading.samples_to(start))
    split = reading.samples_to(start + profile.transient_window)
    end = reading.samples_to(event.contact_end)
    transient, transient_at = reading.largest(0, split)
    quasi_static, quasi_static_at = reading.largest(split, end)
    blank = ForceEvaluation(
        transient=Estimate(),
        transient_time=transient_at - start,
        quasi_static=Estimate(),
        quasi_static_time=quasi_static_at - start,
        contact_duration=event.contact_end - start,
        noise_std=noise,
        zero_std=noise / math.sqrt(quiet),
        relative_uncertainty=profile.relative_uncertainty,
    )
    return dataclasses.replace(
        blank,
        transient=Estimate(transient, blank.standard_uncertainty(transient)),
        quasi_static=Estimate(quasi_static, blank.standard_uncertainty(quasi_static)),
    )
