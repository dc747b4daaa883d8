"""What one blow tells about the sensor, or why it cannot tell.

After the last contact the plate vibrates freely on its spring; its frequency and decay are the
sensor's own (section 3.1.1 of Samarathunga et al. 2024). While the impactor rests on the plate
they are those of both together, and no sensor parameter.

Where several modes ring, all are given; where frequency or damping depends on the amplitude, how.
Stiffness and mass follow from a force alone.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError, EstimationError, InputError
from impactscope.estimate import free_oscillation as model
from impactscope.estimate.amplitude_dependence import AmplitudeDependence, amplitude_dependence
from impactscope.estimate.averaging import amplitude_factor, average_blocks
from impactscope.estimate.free_vibration_span import FreeVibration, choose_span
from impactscope.estimate.modes import fit_modes
from impactscope.estimate.spectrum import bandwidth, estimate_from_spectrum
from impactscope.records import Channel, Estimate, ImpactEvent, Quality, SensorParameters

__all__ = ['FitterSettings', 'estimate_sensor', 'moving_mass']

Array = NDArray[np.float64]

METHOD = 'free oscillation (eq. 27), variable projection'
MODAL_METHOD = 'several decaying modes, least squares in the spectrum'
SIGNIFICANT_DEPENDENCE = 1e-3  # p-value at which damping or frequency depends on amplitude
LEAST_MODE_GAIN = 0.5  # of the residual's power, that a second oscillation has to explain
MODE_SIGNIFICANCE = 1e-6
LARGEST_FREQUENCY_STD = 0.05  # relative standard uncertainty of the natural frequency
HAMMER = 'force.hammer'  # an instrumented hammer's force
MODAL_SAMPLES = 32768  # that are searched for modes, at most
LEAST_EXPLAINED = 0.8  # R² of all modes together


@dataclass(frozen=True, slots=True)
class FitterSettings:
    """Settings of the fitter; raises ConfigurationError for values out of range."""

    channel: str = ''  # that is fitted; empty: the event's first that is no hammer's force
    spring_stiffness: float = math.nan  # N/m, where the test point does not state it
    spring_stiffness_std: float = math.nan  # N/m, its standard uncertainty
    settle: float = 0.0  # s left out after the end of the last contact
    fewest_periods: float = 3.0  # of free vibration in the span
    least_snr: float = 3.0  # amplitude at the span's start over the residual's RMS
    resting_force: float = 3.0  # N after the blow, above which the impactor rests on the plate
    largest_std: float = 0.5  # relative standard uncertainty of the damping ratio, at most
    largest_second_mode: float = 0.2  # amplitude of a second oscillation over the first's

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, str):
                continue
            optional = isinstance(item.default, float) and math.isnan(item.default)
            if not (value >= 0 and math.isfinite(value)) and not (optional and math.isnan(value)):
                raise ConfigurationError(
                    f'fitter: {item.name} is {value!r}; it must be zero or more'
                )
        if self.spring_stiffness == 0:
            raise ConfigurationError('fitter: spring_stiffness is 0 N/m; a spring has more')


class _CannotTell(Exception):  # noqa: N818 - a reason on its way out of this module, no error
    """Why the event does not tell the sensor's parameters."""


def estimate_sensor(
    event: ImpactEvent, settings: FitterSettings = FitterSettings()
) -> SensorParameters:
    """Fit the free vibration after a blow; never raises for what the data lack.

    ``valid`` is False, with the reason, where the blow cannot tell. The fit's figures still
    stand beside the reason where there is a fit that a reader may want to judge.
    """
    try:
        row = _response_row(event, settings)
        free = _free_part(event, row, settings)
    except _CannotTell as error:
        return _untold(event, _channel_name(event, settings), str(error))
    try:
        result, several = _one_oscillation(event, row, free, settings)
    except (EstimationError, InputError) as error:
        result, several = _untold(event, event.channels[row].name, str(error)), True
    if not several:
        return result
    modal = _several_modes(event, row, free)
    return result if modal is None else modal


@dataclass(frozen=True, slots=True, eq=False)
class _FreePart:
    """Samples after the last contact at the channel's own rate."""

    samples: Array
    begin: int  # index of the first in the event's window
    stride: int  # from one to the next in it
    rate: float  # Hz


def _untold(event: ImpactEvent, channel: str, reason: str) -> SensorParameters:
    return SensorParameters(
        event.event_id,
        event.stamp_ns,
        valid=False,
        reason=reason,
        method=METHOD,
        channel=channel,
    )


def _one_oscillation(
    event: ImpactEvent, row: int, free: _FreePart, settings: FitterSettings
) -> tuple[SensorParameters, bool]:
    """The fit of one oscillation, and whether there may be several instead.

    Raises EstimationError where no span of the free part is one oscillation.
    """
    values, factor = average_blocks(free.samples, free.rate)
    rate, step = free.rate / factor, factor * free.stride
    vibration = choose_span(values, rate, earliest=0.0 if event.contacts else None)
    span = values[vibration.start : vibration.stop]
    fit = vibration.fit
    dependence = _dependence(span, rate, vibration)
    frequency_term, damping_term = _amplitude_terms(vibration, dependence)
    natural = _widened(fit.natural_frequency, frequency_term)
    zeta = _widened(fit.damping_ratio, damping_term)
    covariance = float(fit.covariance[0, 1])
    second = _second_mode(span, fit)
    several = second is not None and second[1] > settings.largest_second_mode * fit.amplitude.value
    if several and second is not None:
        reason = (
            f'several modes: beside {fit.damped_frequency.value:.4g} Hz there is one of '
            f'{second[0]:.4g} Hz with {second[1] / fit.amplitude.value:.0%} of its amplitude'
        )
    else:
        reason = _doubt(event.channels[row], vibration, dependence, natural, zeta, settings)
    span_samples = free.samples[vibration.start * factor : vibration.stop * factor]
    amplitude, r_squared, rmse = _at_full_rate(fit, span_samples, factor)
    result = SensorParameters(
        event.event_id,
        event.stamp_ns,
        valid=not reason,
        reason=reason,
        method=METHOD,
        channel=event.channels[row].name,
        span_start=(free.begin + vibration.start * step) / event.sample_rate,
        span_end=(free.begin + vibration.stop * step - free.stride) / event.sample_rate,
        natural_frequency=natural,
        damped_frequency=_widened(fit.damped_frequency, frequency_term),
        damping_ratio=zeta,
        amplitude=amplitude,
        offset=fit.offset,
        r_squared=r_squared,
        rmse=rmse,
    )
    if dependence is not None:
        result = dataclasses.replace(
            result,
            frequency_slope=dependence.frequency_slope,
            damping_slope=dependence.damping_slope,
            small_amplitude_frequency=dependence.small_amplitude_frequency,
            linearity_p_value=dependence.p_value,
        )
    try:
        spectrum = estimate_from_spectrum(span, rate)
    except EstimationError:
        pass
    else:
        result = dataclasses.replace(
            result,
            spectral_frequency=spectrum.frequency,
            spectral_damping_ratio=spectrum.damping_ratio,
        )
    if reason:
        return result, several
    stiffness = _stiffness(event, settings) if event.channels[row].unit == 'N' else Estimate()
    result = dataclasses.replace(
        result,
        bandwidth=bandwidth(natural, Estimate(max(zeta.value, 0.0), zeta.std), covariance),
        stiffness=stiffness,
        moving_mass=moving_mass(stiffness, natural),
        damping_constant=_damping_constant(stiffness, natural, zeta, covariance),
    )
    return result, False


def _several_modes(event: ImpactEvent, row: int, free: _FreePart) -> SensorParameters | None:
    """What rings where it is no one oscillation; None where modes do not explain it either."""
    samples = free.samples[:MODAL_SAMPLES]
    try:
        fit = fit_modes(samples, free.rate)
    except EstimationError:
        return None
    if len(fit.modes) < 2 or fit.r_squared < LEAST_EXPLAINED:
        return None
    first = fit.modes[0]
    zeta = first.damping_ratio.value
    damped = math.sqrt(1.0 - zeta**2)
    last = free.begin + (samples.size - 1) * free.stride
    return SensorParameters(
        event.event_id,
        event.stamp_ns,
        valid=False,
        reason=f'{len(fit.modes)} modes ring: no sensor of one degree of freedom',
        method=MODAL_METHOD,
        channel=event.channels[row].name,
        span_start=free.begin / event.sample_rate,
        span_end=last / event.sample_rate,
        natural_frequency=first.natural_frequency,
        damped_frequency=Estimate(
            first.natural_frequency.value * damped, first.natural_frequency.std * damped
        ),
        damping_ratio=first.damping_ratio,
        amplitude=first.amplitude,
        r_squared=fit.r_squared,
        rmse=fit.rmse,
        modes=fit.modes,
    )


def _channel_name(event: ImpactEvent, settings: FitterSettings) -> str:
    """The channel to fit: a hammer's own force is what makes the others ring."""
    if settings.channel or not event.channels:
        return settings.channel
    names = [channel.name for channel in event.channels]
    return next((name for name in names if name != HAMMER), names[0])


def _response_row(event: ImpactEvent, settings: FitterSettings) -> int:
    """The channel to fit; raises where the event as a whole cannot tell."""
    name = _channel_name(event, settings)
    row = event.index_of(name)
    if row is None:
        raise _CannotTell(f'the event has no channel {name!r}')
    if Quality.HELD in event.quality:
        raise _CannotTell(
            'the impactor stayed on the plate: they oscillate together, not the sensor alone'
        )
    in_newtons = event.channels[row].unit == 'N'
    if row == 0 and in_newtons and event.rest_level > settings.resting_force:
        raise _CannotTell(
            f'a force of {event.rest_level:.3g} N remains after the blow: the impactor rests on '
            'the plate and oscillates with it'
        )
    return row


def _free_part(event: ImpactEvent, row: int, settings: FitterSettings) -> _FreePart:
    """What follows the last contact; raises where it cannot be fitted."""
    grid = event.sample_rate
    if not (math.isfinite(grid) and grid > 0):
        raise _CannotTell(f'the sample rate is {grid!r} Hz')
    size = event.values.shape[1]
    begin, end = 0, size
    if event.contacts:
        last = max(event.contact_end, max(contact.end for contact in event.contacts))
        begin = math.ceil((last + settings.settle) * grid - 1e-6) if math.isfinite(last) else size
    if Quality.OVERLAPPING in event.quality and math.isfinite(event.event_end):
        end = min(end, math.floor(event.event_end * grid))  # the next blow follows
    begin = max(begin, 0)
    # Samples that were interpolated onto the grid tell nothing new and correlate the noise.
    native = event.channels[row].native_rate
    step = max(1, math.floor(grid / native + 1e-6)) if native > 0 else 1
    values = np.array(event.values[row, begin:end:step], dtype=np.float64)
    if values.size < model.FEWEST_SAMPLES:
        raise _CannotTell(f'{values.size} samples follow the last contact; too few to fit')
    if not np.isfinite(values).all():
        missing = int(np.count_nonzero(~np.isfinite(values)))
        raise _CannotTell(f'{missing} samples after the last contact are missing or not finite')
    channel = event.channels[row]
    if np.any(values <= channel.range_min) or np.any(values >= channel.range_max):
        raise _CannotTell(
            f'channel {channel.name!r} is clipped after the last contact '
            f'(range {channel.range_min:g} to {channel.range_max:g} {channel.unit})'
        )
    return _FreePart(values, begin, step, grid / step)


def _at_full_rate(
    fit: model.FreeOscillationFit, samples: Array, factor: int
) -> tuple[Estimate, float, float]:
    """Amplitude, R² and RMSE over the channel's own samples, where block means were fitted."""
    if factor == 1:
        return fit.amplitude, fit.r_squared, fit.rmse
    rate = fit.sample_rate * factor
    shrunk = amplitude_factor(factor, fit.decay_rate.value, fit.damped_frequency.value, rate)
    amplitude = Estimate(fit.amplitude.value / shrunk, fit.amplitude.std / shrunk)
    # A block's mean stands for its middle, but for what it smooths away.
    middle = 0.5 * (factor - 1) / rate
    smoothed = shrunk * math.exp(fit.decay_rate.value * middle)
    wave = fit.evaluate(np.arange(samples.size) / rate - middle) - fit.offset.value
    residual = samples - wave / smoothed - fit.offset.value
    power = float(np.mean(residual**2))
    return amplitude, 1.0 - power / float(np.var(samples)), math.sqrt(power)


def _dependence(span: Array, rate: float, vibration: FreeVibration) -> AmplitudeDependence | None:
    """How frequency and damping vary along the decay; None where it is too short to tell."""
    try:
        return amplitude_dependence(span, rate, fit=vibration.fit)
    except EstimationError:
        return None


def _depends(vibration: FreeVibration, dependence: AmplitudeDependence) -> bool:
    return not vibration.consistent or dependence.p_value <= SIGNIFICANT_DEPENDENCE


def _amplitude_terms(
    vibration: FreeVibration, dependence: AmplitudeDependence | None
) -> tuple[float, float]:
    """Standard uncertainties of frequency (Hz) and damping ratio for a plate that is not linear.

    What varies along the decay is no noise. Where it does so significantly, or where the span
    failed its tests, the linear sensor's values may lie as far away as the limits of large and
    small amplitude; NaN where the record is too short to tell them.
    """
    if dependence is None:
        return (0.0, 0.0) if vibration.consistent else (math.nan, math.nan)
    if not _depends(vibration, dependence):
        return 0.0, 0.0
    fit = vibration.fit
    return (
        max(abs(f - fit.natural_frequency.value) for f in dependence.linear_frequency),
        max(abs(z - fit.damping_ratio.value) for z in dependence.viscous_damping),
    )


def _widened(estimate: Estimate, term: float) -> Estimate:
    return Estimate(estimate.value, math.hypot(estimate.std, term))


def _doubt(
    channel: Channel,
    vibration: FreeVibration,
    dependence: AmplitudeDependence | None,
    natural: Estimate,
    zeta: Estimate,
    settings: FitterSettings,
) -> str:
    """Why the fit is not the sensor's; empty where it may be trusted."""
    fit = vibration.fit
    snr = fit.amplitude.value / fit.rmse if fit.rmse > 0 else math.inf
    if fit.periods < settings.fewest_periods:
        return f'the span holds {fit.periods:.1f} periods; {settings.fewest_periods:g} are needed'
    if snr < settings.least_snr and not (dependence and _depends(vibration, dependence)):
        return f'the oscillation is {snr:.1f} times the noise; {settings.least_snr:g} are needed'
    if math.isnan(zeta.std):
        return 'the vibration is not that of a linear sensor, and too short to see why'
    if zeta.value < -3.0 * zeta.std:
        return f'the oscillation grows (damping ratio {zeta.value:.3g}): it is driven, not free'
    vague = ''
    if not zeta.std <= settings.largest_std * max(abs(zeta.value), 1e-3):
        vague = (
            f'damping ratio {zeta.value:.3g} with a standard uncertainty of {zeta.std:.2g} '
            'tells too little'
        )
    elif not natural.std <= LARGEST_FREQUENCY_STD * natural.value:
        vague = (
            f'natural frequency {natural.value:.4g} Hz with a standard uncertainty of '
            f'{natural.std:.2g} Hz tells too little'
        )
    if vague and dependence is not None and _depends(vibration, dependence):
        amplitude, frequency = dependence.amplitude, dependence.frequency
        damping = dependence.damping_ratio
        return (
            f'no linear oscillator: from {amplitude[0]:.3g} to {amplitude[-1]:.3g} '
            f'{channel.unit} its frequency goes from {frequency[0]:.4g} to {frequency[-1]:.4g} '
            f'Hz, its damping ratio from {damping[0]:.3g} to {damping[-1]:.3g}'
        )
    return vague


def _second_mode(span: Array, fit: model.FreeOscillationFit) -> tuple[float, float] | None:
    """(frequency in Hz, amplitude) of a second oscillation in the residual, if there is one."""
    if fit.white:
        return None
    try:
        other = model.fit_free_oscillation(fit.residuals(span), fit.sample_rate)
    except EstimationError:
        return None
    apart = abs(other.damped_frequency.value - fit.damped_frequency.value)
    width = (fit.decay_rate.value + abs(other.decay_rate.value)) / model.TWO_PI
    if apart < max(width, 2.0 * fit.sample_rate / fit.n_samples):
        return None  # the first one's own misfit
    if other.r_squared < LEAST_MODE_GAIN or other.significance > MODE_SIGNIFICANCE:
        return None
    return other.damped_frequency.value, other.amplitude.value


def _stiffness(event: ImpactEvent, settings: FitterSettings) -> Estimate:
    """As the test point states it, else as the settings do; NaN where neither does."""
    stated = event.test_point.spring_stiffness
    if math.isfinite(stated) and stated > 0:
        return Estimate(stated, event.test_point.spring_stiffness_std)
    return Estimate(settings.spring_stiffness, settings.spring_stiffness_std)


def moving_mass(stiffness: Estimate, natural: Estimate) -> Estimate:
    """Moving mass k / wn², kg; its uncertainty is NaN where the stiffness's is not known."""
    mass = stiffness.value / (model.TWO_PI * natural.value) ** 2
    relative = math.hypot(stiffness.std / stiffness.value, 2.0 * natural.std / natural.value)
    return Estimate(mass, mass * relative)


def _damping_constant(
    stiffness: Estimate, natural: Estimate, zeta: Estimate, covariance: float
) -> Estimate:
    """Damping constant 2 zeta k / wn."""
    by_zeta = 2.0 * stiffness.value / (model.TWO_PI * natural.value)
    value = by_zeta * zeta.value
    variance = (
        (value * stiffness.std / stiffness.value) ** 2
        + (value * natural.std / natural.value) ** 2
        + (by_zeta * zeta.std) ** 2
        - 2.0 * by_zeta * value / natural.value * covariance
    )
    return Estimate(value, math.sqrt(max(variance, 0.0)) if variance == variance else math.nan)
