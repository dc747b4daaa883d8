"""One blow as the estimators see it: its channels cleaned, its sensor, its contact force."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import EstimationError, InputError
from impactscope.estimate.contact_force import (
    ContactForce,
    Peak,
    contact_force_by_inversion,
    contact_force_from_acceleration,
)
from impactscope.records import Estimate, ImpactEvent, Quality, SensorParameters

__all__ = ['Blow', 'SensorConstants', 'Signal', 'share', 'signal_of']

Array = NDArray[np.float64]

_LARGEST_LEFTOVER = 0.5  # of the ring-down's reading, as contact force where nothing touches
_CLEAR = 5.0  # noise standard deviations


def share(estimate: Estimate) -> float:
    """Relative standard uncertainty; 0 where it is not known."""
    return estimate.std / estimate.value if math.isfinite(estimate.std) else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """One channel of an event, zero level removed, shape (n_samples,) on the event's grid."""

    values: Array
    noise: float  # standard deviation, unit of the channel
    bandwidth: float  # Hz up to which the noise is white
    zero_std: float  # standard uncertainty of the zero level, unit of the channel


def signal_of(event: ImpactEvent, row: int) -> Signal:
    """Channel ``row`` of an event, with its noise from before the blow where that is known."""
    raw = event.values[row].astype(np.float64)
    before = raw[: max(0, int(event.contact_start * event.sample_rate) - 1)]
    before = before[np.isfinite(before)]
    zero = event.zero_level[row] if row < len(event.zero_level) else math.nan
    if not math.isfinite(zero):
        zero = float(np.median(before)) if before.size else 0.0
    noise = event.noise_std[row] if row < len(event.noise_std) else math.nan
    if not (math.isfinite(noise) and noise >= 0):
        # Second differences hide a smooth signal and keep white noise: sqrt(6) of it.
        bends = np.abs(np.diff(raw[:: event.oversampling if row == 0 else 1], 2))
        bends = bends[np.isfinite(bends)]
        noise = float(np.median(bends)) / 0.6745 / math.sqrt(6) if bends.size else 0.0
    native = min(event.channels[row].native_rate or event.sample_rate, event.sample_rate)
    independent = max(before.size * native / event.sample_rate, 1.0)
    return Signal(raw - zero, noise, native / 2, noise / math.sqrt(independent))


@dataclass(frozen=True, slots=True)
class SensorConstants:
    """The sensor's constants, each as well as it is known; NaN where it is not."""

    natural_frequency: Estimate  # Hz, undamped
    damping_ratio: Estimate
    stiffness: Estimate  # N/m

    @property
    def angular_frequency(self) -> float:
        """rad/s, undamped."""
        return 2 * math.pi * self.natural_frequency.value

    @property
    def known(self) -> bool:
        """Whether readings can be turned into contact forces."""
        return self.angular_frequency > 0 and self.damping_ratio.value >= 0

    @property
    def mass(self) -> Estimate:
        """k/w², kg."""
        value = self.stiffness.value / self.angular_frequency**2
        spread = math.hypot(share(self.stiffness), 2 * share(self.natural_frequency))
        return Estimate(value, value * spread)

    @property
    def damping_constant(self) -> Estimate:
        """2 zeta k/w, N s/m."""
        factor = 2 * self.stiffness.value / self.angular_frequency
        value, ratio_std = factor * self.damping_ratio.value, self.damping_ratio.std
        spread = value * math.hypot(share(self.stiffness), share(self.natural_frequency))
        by_ratio = factor * ratio_std if math.isfinite(ratio_std) else 0.0
        return Estimate(value, math.hypot(spread, by_ratio))

    def updated(self, event: ImpactEvent, sensor: SensorParameters | None) -> SensorConstants:
        """These constants, replaced by what the test point states and the blow itself tells."""
        frequency, ratio, stiffness = self.natural_frequency, self.damping_ratio, self.stiffness
        point = event.test_point
        if math.isfinite(point.spring_stiffness):
            stiffness = Estimate(point.spring_stiffness, point.spring_stiffness_std)
        if sensor is not None and sensor.valid:
            frequency, ratio = sensor.natural_frequency, sensor.damping_ratio
            if math.isfinite(sensor.stiffness.value):
                stiffness = sensor.stiffness
        return SensorConstants(frequency, ratio, stiffness)


@dataclass(frozen=True, slots=True, eq=False)
class Blow:
    """An event with its force channel, and what is known of the sensor."""

    event: ImpactEvent
    row: int  # of the force channel
    reading: Signal
    sensor: SensorConstants

    @property
    def rate(self) -> float:
        """Hz, of the grid."""
        return self.event.sample_rate

    def samples(self, start: float, end: float) -> tuple[int, int]:
        """First and last + 1 grid index of a span in s, cut to the window."""
        n = self.reading.values.size
        lo = int(np.clip(math.floor(start * self.rate), 0, n))
        return lo, int(np.clip(math.ceil(end * self.rate) + 1, lo, n))

    def slope(self, moment: float) -> Estimate:
        """Slope of the reading at a moment, N/s, by a parabola over 2 ms or 7 samples."""
        lo, hi = self.samples(moment - 1e-3, moment + 1e-3)
        size = self.reading.values.size
        while hi - lo < min(7, size):
            lo, hi = max(lo - 1, 0), min(hi + 1, size)
        weights = np.linalg.pinv(np.vander(np.arange(lo, hi) / self.rate - moment, 3, True))[1]
        white = self.reading.noise * math.sqrt(max(1.0, self.rate / 2 / self.reading.bandwidth))
        return Estimate(
            float(weights @ self.reading.values[lo:hi]), white * float(np.linalg.norm(weights))
        )

    def plate_speed(self, moment: float) -> Estimate:
        """Speed of the plate, m/s; zero, of unknown certainty, where no stiffness is known."""
        if not self.sensor.stiffness.value > 0:
            return Estimate(0.0)
        slope, k = self.slope(moment), self.sensor.stiffness.value
        return Estimate(slope.value / k, slope.std / k)

    def contact_force(
        self, plate_channel: str, acceleration_uncertainty: float
    ) -> ContactForce | None:
        """The contact force over the grid; None where sensor or samples do not allow it.

        By the plate's accelerometer where there is one that can be believed, else by inversion.
        """
        if not self.sensor.known:
            return None
        plate = self.event.index_of(plate_channel)
        if plate is not None and self.sensor.stiffness.value > 0:
            channel = self.event.channels[plate]
            if channel.unit == 'm/s^2' and not channel.quality & Quality.CLIPPED:
                found = self._by_accelerometer(
                    signal_of(self.event, plate), acceleration_uncertainty
                )
                if found is not None and self._vanishes_without_contact(found):
                    return found
        return self._by_inversion()

    def _by_accelerometer(self, plate: Signal, uncertainty: float) -> ContactForce | None:
        try:
            return contact_force_from_acceleration(
                self.reading.values,
                plate.values,
                self.rate,
                mass=self.sensor.mass,
                damping_constant=self.sensor.damping_constant,
                stiffness=self.sensor.stiffness.value,
                force_noise=self.reading.noise,
                acceleration_noise=plate.noise,
                force_bandwidth=self.reading.bandwidth,
                acceleration_bandwidth=plate.bandwidth,
                acceleration_uncertainty=uncertainty,
            )
        except InputError:  # missing samples
            return None

    def _vanishes_without_contact(self, found: ContactForce) -> bool:
        """Whether nothing is left where nothing touches the plate.

        If much is, the accelerometer's sign, unit or timing is not what it is taken for.
        """
        event, period = self.event, 1 / self.sensor.natural_frequency.value
        lo, hi = self.samples(event.contact_end + 0.1 * period, event.event_end)
        if event.quality & Quality.HELD or hi - lo < 0.5 * period * self.rate:
            return True
        swing = float(np.std(self.reading.values[lo:hi]))
        left = float(np.std(found.force[lo:hi]))
        return swing < _CLEAR * self.reading.noise or left < _LARGEST_LEFTOVER * swing

    def _by_inversion(self) -> ContactForce | None:
        event = self.event
        step = event.oversampling if self.row == 0 else 1
        rate, period = self.rate / step, 1 / self.sensor.natural_frequency.value
        margin = 0.1 * period  # a reading starts slowly: contact began before it was seen
        lo, _ = self.samples(event.contact_start - 2 * margin, event.contact_start)
        _, hi = self.samples(event.contact_start, event.contact_end + 2 * period)
        offset = lo / self.rate
        spans = tuple((c.start - margin - offset, c.end + margin - offset) for c in event.contacts)
        try:
            part = contact_force_by_inversion(
                self.reading.values[lo:hi:step],
                rate,
                natural_frequency=self.sensor.natural_frequency,
                damping_ratio=self.sensor.damping_ratio,
                force_noise=max(self.reading.noise, 1e-6),
                spans=spans,
            )
        except (EstimationError, InputError):
            return None
        grid = np.arange(self.reading.values.size) / self.rate
        own = offset + np.arange(part.force.size) / rate
        value, time = part.peak.value, part.peak.time
        return dataclasses.replace(
            part,
            force=np.interp(grid, own, part.force, left=0.0, right=0.0),
            std=np.interp(grid, own, part.std),
            peak=Peak(value, Estimate(time.value + offset, time.std)),
        )
