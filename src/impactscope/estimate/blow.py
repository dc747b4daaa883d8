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

_LARGEST_LEFTOVER = 0.5  # of what the opposite sign of acceleration leaves, after contact
_LARGEST_LOADED = 0.95  # the same where the impactor stays on the plate and swings with it
_LARGEST_DOUBT = 0.3  # relative uncertainty of an inverted peak that is no answer any more
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


def _is_force(event: ImpactEvent, name: str) -> bool:
    """Whether a channel, the event's first where not named, is a force: the sensor's own."""
    row = event.index_of(name) if name else 0
    return row is not None and event.channels[row].unit == 'N'


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
        if sensor is not None and sensor.valid and _is_force(event, sensor.channel):
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
        """The contact force over the grid; None where sensor or samples do not tell it.

        By the plate's accelerometer where there is one that can be believed, else by inversion.
        """
        if not self.sensor.known:
            return None
        plate, least = self.event.index_of(plate_channel), 0.0
        if plate is not None and self.sensor.stiffness.value > 0:
            channel = self.event.channels[plate]
            signal = signal_of(self.event, plate)
            if channel.unit == 'm/s^2' and not channel.quality & Quality.CLIPPED:
                found = self._by_accelerometer(signal, acceleration_uncertainty)
                if found is not None and self._agrees_after_contact(found):
                    return found
            elif channel.unit == 'm/s^2' and np.isfinite(signal.values).any():
                # Clipped: the force was more than it took to drive the plate to the range's end.
                least = self.sensor.mass.value * float(np.nanmax(signal.values))
        return self._by_inversion(least)

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

    def _agrees_after_contact(self, found: ContactForce) -> bool:
        """Whether plate and reading move as spring and mass do once the first contact is over.

        Where nothing touches the plate m a cancels the reading; with an impactor on it, it still
        takes away from it. If the opposite sign would do nearly as well, the accelerometer's
        sign, unit or timing is not what it is taken for.
        """
        event = self.event
        lo, hi = self.samples(event.contacts[0].end, event.event_end)
        reading = self.reading.values[lo:hi]
        if hi - lo < 0.5 * self.rate / self.sensor.natural_frequency.value:
            return True
        if float(np.std(reading)) < _CLEAR * self.reading.noise:
            return True
        left = float(np.std(found.force[lo:hi]))
        opposite = float(np.std(2 * reading - found.force[lo:hi]))
        loaded = event.quality & Quality.HELD or abs(event.rest_level) > 3 * self.reading.noise
        return left < (_LARGEST_LOADED if loaded else _LARGEST_LEFTOVER) * opposite

    def _by_inversion(self, least: float) -> ContactForce | None:
        """Up to the end of the largest contact; None where its peak is not above ``least``."""
        event = self.event
        step = event.oversampling if self.row == 0 else 1
        rate, period = self.rate / step, 1 / self.sensor.natural_frequency.value
        margin = 0.1 * period  # a reading starts slowly: contact began before it was seen
        largest = max(range(len(event.contacts)), key=lambda i: event.contacts[i].peak_force)
        contacts = event.contacts[: largest + 1]
        after = contacts[-1].end + period
        if largest + 1 < len(event.contacts):
            after = min(after, event.contacts[largest + 1].start - margin)
        lo, _ = self.samples(event.contact_start - 2 * margin, event.contact_start)
        _, hi = self.samples(event.contact_start, max(after, contacts[-1].end + 1 / rate))
        offset = lo / self.rate
        spans = tuple((c.start - margin - offset, c.end + margin - offset) for c in contacts)
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
        value, time = part.peak.value, part.peak.time
        if not (value.std < _LARGEST_DOUBT * value.value and value.value + 2 * value.std > least):
            return None
        grid = np.arange(self.reading.values.size) / self.rate
        own = offset + np.arange(part.force.size) / rate
        return dataclasses.replace(
            part,
            force=np.interp(grid, own, part.force, left=0.0, right=math.nan),
            std=np.interp(grid, own, part.std, right=math.nan),
            peak=Peak(value, Estimate(time.value + offset, time.std)),
        )
