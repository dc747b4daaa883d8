"""What one blow tells about impactor and contact: the live graph's impact parameters.

The peak force is the judged one: the largest sample of the reading, zero level removed,
unfiltered and uncorrected, since limits presume the uncorrected device. Beside it stands what
the sensor's own dynamics add or hide: the reconstructed contact force (eq. 24 of Samarathunga
et al., Machines 2024, 12, 26, inverted), impulse, impact speed and effective mass.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from impactscope.errors import ConfigurationError, EstimationError
from impactscope.estimate.blow import Blow, SensorConstants, Signal, share, signal_of
from impactscope.estimate.contact_force import ContactForce, Peak, find_peak
from impactscope.estimate.effective_mass import mass_from_acceleration, mass_from_momentum
from impactscope.estimate.equivalent_mass import EquivalentMass, estimate_equivalent_mass
from impactscope.estimate.impact_speed import integrate_span, speed_from_contact
from impactscope.records import (
    Estimate,
    ImpactEvent,
    ImpactParameters,
    Quality,
    SensorParameters,
)

__all__ = ['ImpactEstimator', 'ImpactSettings', 'estimate_impact', 'reconstruct_contact_force']

_FEWEST_SAMPLES = 3  # of the force channel in contact
_RESTING_TIME = 0.5  # s of contact, from which an impactor rests on the plate
_LIFTING_SHARE = 0.25  # of that contact, its end, in which it may be lifted off
_LEAST_PEAK = 5.0  # noise standard deviations
_THRESHOLD = 0.02  # of the contact force's peak, above which there is contact


@dataclass(frozen=True, slots=True)
class ImpactSettings:
    """Settings of the impact estimator; raises ConfigurationError for values out of range.

    The sensor's constants serve where a blow does not tell them itself, such as one after which
    the pendulum stays on the plate; NaN: not known.
    """

    force_channel: str = ''  # channel of the contact force's reading; empty: the event's first
    plate_acceleration: str = 'acceleration.plate'  # m/s², positive into the sensor
    impactor_acceleration: str = 'acceleration.impactor'  # m/s², along the blow, either sign
    force_uncertainty: float = 0.015  # relative standard uncertainty of the force calibration
    acceleration_uncertainty: float = 0.02  # relative standard uncertainty of acceleration gains
    speed_uncertainty: float = 0.05  # relative standard uncertainty of a test point's stated speed
    impact_speed: float = math.nan  # m/s, where it is known otherwise, e.g. from the release
    impact_speed_std: float = math.nan  # m/s, its standard uncertainty
    natural_frequency: float = math.nan  # Hz, undamped, of the sensor without impactor
    natural_frequency_std: float = math.nan  # Hz, its standard uncertainty
    damping_ratio: float = math.nan  # of the sensor without impactor
    damping_ratio_std: float = math.nan  # its standard uncertainty
    stiffness: float = math.nan  # N/m, of the sensor's spring
    stiffness_std: float = math.nan  # N/m, its standard uncertainty

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, str):
                continue
            optional = isinstance(item.default, float) and math.isnan(item.default)
            if not (value >= 0 and math.isfinite(value)) and not (optional and math.isnan(value)):
                raise ConfigurationError(
                    f'impact estimator: {item.name} is {value!r}; it must be zero or more'
                )


DEFAULTS = ImpactSettings()


def estimate_impact(
    event: ImpactEvent,
    sensor: SensorParameters | None = None,
    settings: ImpactSettings = DEFAULTS,
) -> ImpactParameters:
    """Estimate everything that one blow tells; never raises for what the data lack.

    ``sensor`` is what the same blow told about the sensor, if anything. What cannot be told
    stays NaN; ``valid`` is False, with the reason, where the event is no usable force event.
    ``method`` says how the contact force was found: accelerometer, inversion, or reading where
    it was not, so that impulse and mass are those of the reading.
    """
    blow = _blow(event, sensor, settings)
    if isinstance(blow, str):
        return ImpactParameters(event.event_id, event.stamp_ns, False, blow, 'none')
    reading = blow.reading
    top = _largest_reading(blow)
    contact_force = blow.contact_force(
        settings.plate_acceleration, settings.acceleration_uncertainty
    )
    peak_contact = Estimate()
    if contact_force is not None:
        value, std = contact_force.peak.value
        peak_contact = Estimate(value, math.hypot(std, settings.force_uncertainty * value))
    peak_force = Estimate(
        top, math.hypot(reading.noise, reading.zero_std, settings.force_uncertainty * top)
    )
    span = _first_contact(blow, contact_force)
    speed, mass = _impactor(blow, contact_force, span, settings)
    coupled = _coupled(blow)
    return ImpactParameters(
        event.event_id,
        event.stamp_ns,
        True,
        '',
        contact_force.method if contact_force is not None else 'reading',
        peak_force=peak_force,
        peak_contact_force=peak_contact,
        contact_time=span.duration,
        impulse=_contact_impulse(blow, contact_force, span, settings),
        impact_speed=speed,
        effective_mass=mass,
        transferred_energy=_energy(peak_force, blow.sensor.stiffness),
        coupled_frequency=coupled.fit.natural_frequency if coupled.fit else Estimate(),
        coupled_mass=coupled.mass,
    )


def reconstruct_contact_force(
    event: ImpactEvent,
    sensor: SensorParameters | None = None,
    settings: ImpactSettings = DEFAULTS,
) -> ContactForce | None:
    """The contact force over the event's grid; None where sensor or samples do not allow it."""
    blow = _blow(event, sensor, settings)
    if isinstance(blow, str):
        return None
    return blow.contact_force(settings.plate_acceleration, settings.acceleration_uncertainty)


class ImpactEstimator:
    """Stage: events with their sensor parameters in, impact parameters out; keeps no state."""

    def __init__(self, settings: ImpactSettings = DEFAULTS) -> None:
        self.settings = settings

    def push(self, record: tuple[ImpactEvent, SensorParameters | None]) -> list[ImpactParameters]:
        """Estimate one blow."""
        return [estimate_impact(*record, self.settings)]

    def flush(self) -> list[ImpactParameters]:
        """Nothing is ever open."""
        return []


def _blow(
    event: ImpactEvent, sensor: SensorParameters | None, settings: ImpactSettings
) -> Blow | str:
    """The event made ready, or why it is no usable force event."""
    row = event.index_of(settings.force_channel) if settings.force_channel else 0
    if row is None:
        return f'the event has no channel {settings.force_channel!r}'
    channel = event.channels[row]
    if channel.unit != 'N':
        return f'channel {channel.name!r} is in {channel.unit!r}, not a force in N'
    if channel.quality & Quality.CLIPPED:
        return f'channel {channel.name!r} is clipped: its peak is not known'
    if not event.contacts:
        return 'no contact was found in the event'
    duration = event.contacts[0].end - event.contacts[0].start
    if not duration * event.sample_rate / event.oversampling >= _FEWEST_SAMPLES:
        return (
            f'the first contact of {1e3 * duration:.3g} ms is shorter than {_FEWEST_SAMPLES} '
            'samples of the force'
        )
    constants = SensorConstants(
        Estimate(settings.natural_frequency, settings.natural_frequency_std),
        Estimate(settings.damping_ratio, settings.damping_ratio_std),
        Estimate(settings.stiffness, settings.stiffness_std),
    )
    blow = Blow(event, row, signal_of(event, row), constants.updated(event, sensor))
    lo, hi = blow.samples(event.contacts[0].start, event.contacts[-1].end)
    if hi == lo or not np.isfinite(blow.reading.values[lo:hi]).all():
        return f'channel {channel.name!r} has missing samples during contact'
    top = _largest_reading(blow)
    if not top > _LEAST_PEAK * blow.reading.noise:
        return f'the largest force, {top:.3g} N, does not rise above the noise'
    return blow


def _largest_reading(blow: Blow) -> float:
    """The largest sample of the reading during contact, N; not one that was interpolated."""
    contacts = blow.event.contacts
    recorded = max(contact.peak_force for contact in contacts)
    if blow.row == 0 and math.isfinite(recorded):
        return recorded
    lo, hi = blow.samples(contacts[0].start, contacts[-1].end)
    return float(blow.reading.values[lo:hi].max())


@dataclass(frozen=True, slots=True)
class _Span:
    """A contact, s after the window's first sample."""

    start: float
    end: float
    std: float  # of its duration

    @property
    def duration(self) -> Estimate:
        return Estimate(self.end - self.start, self.std)


def _first_contact(blow: Blow, contact_force: ContactForce | None) -> _Span:
    """The first contact as found, or as the plate's accelerometer tells it better.

    The reading lags behind the contact force; where that is known sample by sample, the contact
    is where it exceeds a fiftieth of its peak and its own uncertainty.
    """
    found = blow.event.contacts[0]
    if contact_force is None or contact_force.method != 'accelerometer':
        sampling = blow.event.oversampling / blow.rate / math.sqrt(12)
        terms = [sampling, sampling]
        for moment in (found.start, found.end):
            slope = abs(blow.slope(moment).value)
            terms.append(min(blow.reading.noise / slope, 1e-2) if slope > 0 else 1e-2)
        return _Span(found.start, found.end, math.hypot(*terms))
    margin = 0.1 / blow.sensor.natural_frequency.value
    lo, hi = blow.samples(found.start - margin, found.end + margin)
    force, std = contact_force.force[lo:hi], contact_force.std[lo:hi]
    above = force > np.maximum(_THRESHOLD * force.max(), _LEAST_PEAK * std)
    first = int(np.argmax(above))
    last = above.size - 1 - int(np.argmax(above[::-1]))
    end = (lo + last + 1) / blow.rate
    start = (lo + max(first - 1, 0)) / blow.rate
    return _Span(start, end, math.hypot(1 / blow.rate, _THRESHOLD / math.pi * (end - start)))


def _contact_impulse(
    blow: Blow, contact_force: ContactForce | None, span: _Span, settings: ImpactSettings
) -> Estimate:
    """Impulse of the first contact, N s: of the contact force where it is known by sample."""
    if contact_force is None or contact_force.method != 'accelerometer':
        return _impulse(blow, span.start, span.end, settings)
    total = integrate_span(contact_force.force, blow.rate, span.start, span.end)
    read = integrate_span(blow.reading.values, blow.rate, span.start, span.end)
    duration = span.end - span.start
    # What the plate took beside the spring is known as well as its mass and acceleration.
    inertia = math.hypot(share(blow.sensor.mass), settings.acceleration_uncertainty)
    terms = (
        settings.force_uncertainty * total,
        inertia * (total - read),
        float(contact_force.std.min()) * math.sqrt(duration / (2 * blow.reading.bandwidth)),
        blow.reading.zero_std * duration,
    )
    return Estimate(total, math.hypot(*terms))


def _impulse(blow: Blow, start: float, end: float, settings: ImpactSettings) -> Estimate:
    """Impulse of the contact force, N s; of the reading alone where the sensor is not known.

    The integral of eq. 24 inverted: that of the reading, plus the plate's momentum m v and drag
    c x at the end, which need the reading and its slope only. After separation the sum stays
    as it is, so a contact that is taken for longer than it was does no harm.
    """
    reading, sensor, span = blow.reading, blow.sensor, end - start
    total = integrate_span(reading.values, blow.rate, start, end)
    terms = [
        reading.noise * math.sqrt(span / (2 * reading.bandwidth)),
        reading.zero_std * span,
        settings.force_uncertainty * total,
    ]
    if sensor.known:
        w, zeta = sensor.angular_frequency, sensor.damping_ratio
        slope, values = blow.slope(end), reading.values
        at_end = float(np.interp(end * blow.rate, np.arange(values.size), values))
        momentum, drag = slope.value / w**2, 2 * zeta.value / w * at_end
        total += momentum + drag
        terms += [
            slope.std / w**2,
            2 * share(sensor.natural_frequency) * momentum,
            2 * (zeta.std if math.isfinite(zeta.std) else 0.0) / w * at_end,
            2 * zeta.value / w * reading.noise,
        ]
    return Estimate(total, math.hypot(*terms))


def _impactor(
    blow: Blow, contact_force: ContactForce | None, span: _Span, settings: ImpactSettings
) -> tuple[Estimate, Estimate]:
    """Impact speed and effective mass, as far as accelerometer or stated speed tell them."""
    event = blow.event
    row = event.index_of(settings.impactor_acceleration)
    if row is not None and event.channels[row].unit == 'm/s^2':
        impactor = signal_of(event, row)
        lo, hi = blow.samples(span.start, span.end)
        clipped = event.channels[row].quality & Quality.CLIPPED
        if np.isfinite(impactor.values[lo:hi]).all() and not clipped:
            return _from_accelerometer(blow, impactor, contact_force, span, settings)
    speed = Estimate(settings.impact_speed, settings.impact_speed_std)
    if not math.isfinite(speed.value):
        stated = event.test_point.speed
        speed = Estimate(stated, settings.speed_uncertainty * stated)
    if not speed.value > 0:
        return Estimate(), Estimate()
    return speed, _from_stated_speed(blow, contact_force, span, speed, settings)


def _from_stated_speed(
    blow: Blow,
    contact_force: ContactForce | None,
    span: _Span,
    speed: Estimate,
    settings: ImpactSettings,
) -> Estimate:
    """Mass from the impulse up to the largest force, when impactor and plate move as one.

    A lossy layer or a push puts that moment off the middle of the contact: half of the
    asymmetry counts as its uncertainty.
    """
    if contact_force is None and not blow.sensor.known:
        return Estimate()  # the reading alone lacks what the plate took
    crest = _crest(blow, contact_force, span)
    lag = crest.time.value - 0.5 * (span.start + span.end)
    impulse = _impulse(blow, span.start, crest.time.value, settings)
    late = crest.value.value * math.hypot(crest.time.std, 0.5 * lag)
    left = blow.plate_speed(crest.time.value)
    try:
        return mass_from_momentum(
            Estimate(impulse.value, math.hypot(impulse.std, late)),
            Estimate(speed.value - left.value, speed.std),
        )
    except EstimationError:
        return Estimate()


def _coupled(blow: Blow) -> EquivalentMass:
    """Mass of an impactor that stays on the bare plate, from their common oscillation.

    With a damper layer between them they are two masses on two springs, not one on one.
    """
    event, sensor = blow.event, blow.sensor
    last = event.contacts[-1]
    if last.end - last.start < _RESTING_TIME:
        return EquivalentMass(False, 'no impactor stays on the plate')
    if event.test_point.damper.strip().lower() not in {'', 'none'}:
        return EquivalentMass(False, 'a damper layer lies between impactor and plate')
    if not (sensor.stiffness.value > 0 and sensor.natural_frequency.value > 0):
        return EquivalentMass(False, 'stiffness and natural frequency of the sensor are not known')
    step = event.oversampling if blow.row == 0 else 1
    rested = last.end - _LIFTING_SHARE * (last.end - last.start)
    lo, hi = blow.samples(event.contact_start, rested)
    reading = blow.reading.values[lo:hi:step]
    if not np.isfinite(reading).all():
        return EquivalentMass(False, 'samples are missing')
    return estimate_equivalent_mass(
        reading,
        blow.rate / step,
        stiffness=sensor.stiffness,
        sensor_frequency=sensor.natural_frequency,
    )


def _crest(blow: Blow, contact_force: ContactForce | None, span: _Span) -> Peak:
    """Peak of contact force, or of the reading, in a contact; s after the window's start."""
    lo, hi = blow.samples(span.start, span.end)
    force, noise = blow.reading.values, blow.reading.noise
    if contact_force is not None:
        force, noise = contact_force.force, float(contact_force.std[lo:hi].mean())
    found = find_peak(force[lo:hi], blow.rate, noise)
    return Peak(found.value, Estimate(found.time.value + lo / blow.rate, found.time.std))


def _from_accelerometer(
    blow: Blow,
    impactor: Signal,
    contact_force: ContactForce | None,
    span: _Span,
    settings: ImpactSettings,
) -> tuple[Estimate, Estimate]:
    gain, reading = settings.acceleration_uncertainty, blow.reading.values
    lo, hi = blow.samples(span.start, span.end)
    slowed = impactor.values[lo:hi]
    slowed = -slowed if slowed.sum() < 0 else slowed  # the channel's sign is free
    stiffness = blow.sensor.stiffness.value
    plate = reading[lo:hi] / stiffness if stiffness > 0 else np.zeros(hi - lo)
    white = impactor.noise * math.sqrt(max(1.0, blow.rate / 2 / impactor.bandwidth))
    speed = mass = Estimate()
    try:
        speed = speed_from_contact(
            slowed,
            plate,
            reading[lo:hi] if contact_force is None else contact_force.force[lo:hi],
            blow.rate,
            end_std=span.std,
            offset_std=impactor.zero_std,
            noise_std=white,
            gain_std=gain,
        )
        if contact_force is not None:
            mass = mass_from_acceleration(
                contact_force.force[lo:hi],
                slowed,
                deceleration_noise=impactor.noise,
                gain_std=math.hypot(
                    gain, settings.force_uncertainty, share(contact_force.peak.value)
                ),
            ).mass
        elif blow.sensor.known:  # the reading alone lacks what the plate took
            change = float(slowed.sum()) / blow.rate
            noise = math.hypot(white * math.sqrt(hi - lo) / blow.rate, gain * change)
            impulse = _impulse(blow, span.start, span.end, settings)
            mass = mass_from_momentum(impulse, Estimate(change, noise))
    except EstimationError:
        pass  # what was found before stands
    return speed, mass


def _energy(peak_force: Estimate, stiffness: Estimate) -> Estimate:
    """Largest energy in the spring, J: F²/(2 k) (eq. A2)."""
    if not stiffness.value > 0:
        return Estimate()
    energy = peak_force.value**2 / (2 * stiffness.value)
    return Estimate(energy, energy * math.hypot(2 * share(peak_force), share(stiffness)))
