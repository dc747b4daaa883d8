"""Impact speed: from the release of a pendulum, and from the impactor's accelerometer.

Source: eq. 5 and 6 of Samarathunga et al., Machines 2024, 12, 26; the rest is the momentum law.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar, nnls

from impactscope.errors import EstimationError, InputError
from impactscope.physics.pendulum import Orientation, Pendulum
from impactscope.records import Estimate

__all__ = ['integrate_span', 'speed_from_contact', 'speed_from_release', 'speed_from_swing']

Array = NDArray[np.float64]

_FEWEST_SAMPLES = 8  # of a contact
_LINEAR = 0.02  # share of the impulse that a linear law leaves at most
_DECISIVE = 0.5  # of what a plain lossy spring leaves, that a law with a branch may leave
_SPEEDS = (0.8, 2.0, 25)  # that are tried, over the speed with nothing squeezed at the end


def speed_from_release(
    pendulum: Pendulum,
    release_angle: Estimate,
    orientation: Orientation = Orientation.VERTICAL,
    uncertainties: Mapping[str, float] | None = None,
) -> Estimate:
    """Impact speed, m/s, of a pendulum released at rest at ``release_angle`` rad.

    ``uncertainties`` gives standard uncertainties of the pendulum's fields by name (SI units);
    they and the angle's are carried through to first order. Friction of hinge and air is not
    in eq. 5 and 6: the value is an upper bound on the real speed. Raises InputError for an
    unknown field, ConfigurationError for an angle that cannot be.
    """
    known = {item.name: getattr(pendulum, item.name) for item in dataclasses.fields(pendulum)}
    unknown = sorted(set(uncertainties or ()) - set(known))
    if unknown:
        raise InputError(f'impact speed: a pendulum has no {", ".join(unknown)}')
    value = pendulum.impact_speed(release_angle.value, orientation)
    variance = 0.0
    if math.isfinite(release_angle.std):
        step = 1e-6 * release_angle.value
        up = pendulum.impact_speed(release_angle.value + step, orientation)
        variance += ((up - value) / step * release_angle.std) ** 2
    for name, std in (uncertainties or {}).items():
        step = 1e-6 * max(known[name], 1e-3)
        changed = dataclasses.replace(pendulum, **{name: known[name] + step})
        slope = (changed.impact_speed(release_angle.value, orientation) - value) / step
        variance += (slope * std) ** 2
    return Estimate(value, math.sqrt(variance))


def speed_from_swing(
    acceleration: ArrayLike,
    sample_rate: float,
    pendulum: Pendulum,
    release_angle: Estimate,
    orientation: Orientation = Orientation.VERTICAL,
    *,
    offset_std: float = 0.0,
    noise_std: float = 0.0,
    gain_std: float = 0.0,
) -> Estimate:
    """Impact speed, m/s, by integrating the impactor's accelerometer over its swing.

    ``acceleration`` has shape (n_samples,), m/s², from the release at rest to the first contact,
    measured at the contact point along its path, positive towards the sensor, by a sensor that
    holds its zero (DC-coupled). It does not feel gravity itself, only its absence: gravity's
    component along the path is added from the angle reached. ``offset_std`` m/s², ``noise_std``
    m/s² a sample and ``gain_std`` (relative) describe the channel.
    """
    a = np.asarray(acceleration, np.float64)
    if a.ndim != 1 or a.size < 2 or not np.isfinite(a).all() or not sample_rate > 0:
        raise InputError(f'impact speed: samples of shape {a.shape} must be 1-D and finite')

    def run(angle: float) -> tuple[float, float]:
        h, speed, felt = 1 / sample_rate, 0.0, 0.0
        along = math.cos if orientation is Orientation.VERTICAL else math.sin
        for sample in 0.5 * (a[1:] + a[:-1]):
            # Midpoint rule: the angle half a step on, from the speed before it.
            middle = angle - 0.5 * h * speed / pendulum.contact_distance
            rate = float(sample) + pendulum.gravity * along(middle)
            angle -= h * (speed + 0.5 * h * rate) / pendulum.contact_distance
            speed += h * rate
            felt += h * float(sample)
        return speed, felt

    speed, felt = run(release_angle.value)
    if speed <= 0:
        raise EstimationError(
            f'impact speed: the integral is {speed:.3g} m/s; the impactor does not approach'
        )
    duration = (a.size - 1) / sample_rate
    angle_std = release_angle.std if math.isfinite(release_angle.std) else 0.0
    by_angle = (run(release_angle.value + 1e-5)[0] - speed) / 1e-5 * angle_std
    terms = (
        offset_std * duration,
        noise_std * math.sqrt(duration / sample_rate),
        gain_std * felt,
        by_angle,
    )
    return Estimate(float(speed), math.hypot(*terms))


def integrate_span(values: Array, sample_rate: float, start: float, end: float) -> float:
    """Integral of the straight line through the samples from ``start`` to ``end``, s.

    ``values`` has shape (n_samples,); the span may begin and end between samples.
    """
    time = np.arange(values.size) / sample_rate
    inside = (time > start) & (time < end)
    t = np.concatenate(([start], time[inside], [end]))
    y = np.interp(t, time, values)
    return float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(t)))


def speed_from_contact(
    deceleration: ArrayLike,
    plate_displacement: ArrayLike,
    contact_force: ArrayLike,
    sample_rate: float,
    *,
    end_std: float = 0.0,
    offset_std: float = 0.0,
    noise_std: float = 0.0,
    gain_std: float = 0.0,
) -> Estimate:
    """Speed at first contact, m/s, from what the impactor's accelerometer felt in one contact.

    An accelerometer knows changes of speed, not speed; the contact closes the gap, whatever its
    law: impactor and plate meet and part with nothing squeezed between them, so
    v T = (double integral of the deceleration) + (plate's displacement when they part). A lossy
    layer is still squeezed then, by its lag times the speed of parting; the lag is taken from
    the force's lead before the squeeze, corrected for, and the correction counts as uncertain.

    A viscoelastic layer that relaxes (a Maxwell branch, eq. 12) is squeezed by more than one lag.
    Where force and squeeze obey such a law much better than that of a lossy spring, v is the
    speed with which they do so best; half of what the branch changes counts as uncertain, since
    further branches may follow.

    All signals have shape (n_samples,), from first to last sample of one contact:
    ``deceleration`` of the impactor in m/s², ``plate_displacement`` in m, ``contact_force`` of
    any unit. ``end_std`` s is that of
    the contact's duration; ``noise_std`` m/s² a sample, ``offset_std`` m/s² and ``gain_std``
    (relative) are the accelerometer's. Raises EstimationError where the contact is too short
    or no deceleration is felt.
    """
    d, x = np.asarray(deceleration, np.float64), np.asarray(plate_displacement, np.float64)
    f = np.asarray(contact_force, np.float64)
    if d.size < _FEWEST_SAMPLES or not d.shape == x.shape == f.shape or d.ndim != 1:
        raise EstimationError(
            f'impact speed: {d.size} samples of contact; at least {_FEWEST_SAMPLES} are needed'
        )
    h = 1 / sample_rate
    lost = _integral(d, h)
    way = _integral(lost, h)
    duration = (d.size - 1) * h
    noise = noise_std * math.sqrt(duration * h)
    if not lost[-1] > 5 * math.hypot(noise, offset_std * duration):
        raise EstimationError(
            f'impact speed: a change of {lost[-1]:.3g} m/s does not rise above the noise'
        )
    time = np.asarray(np.arange(d.size) * h, np.float64)
    common = (
        noise / math.sqrt(3),
        offset_std * duration / 2,
        gain_std * float(way[-1]) / duration,
    )
    plain, without = _by_linear_law(time, way + x, f, branch=False)
    speed, misfit = _by_linear_law(time, way + x, f, branch=True)
    if misfit < min(_LINEAR, _DECISIVE * without):
        sampled = speed * h / duration  # contact began and ended between samples
        return Estimate(speed, math.hypot(*common, sampled, 0.5 * (speed - plain)))
    last = max(4, min(d.size // 4, round(1e-3 * sample_rate)))
    closed = float(way[-1] + x[-1]) / duration
    speed, parting = closed, 0.0
    for _ in range(4):
        squeeze = speed * time - way - x
        rate = np.gradient(np.convolve(np.pad(squeeze, 2, 'edge'), np.ones(5) / 5, 'valid'), h)
        elastic, viscous = np.linalg.lstsq(np.array([squeeze, rate * duration]).T, f, rcond=None)[
            0
        ]
        lag = duration * min(max(viscous / elastic, 0.0), 0.25) if elastic > 0 else 0.0
        slope = np.polyfit(time[-last:] - time[-1], squeeze[-last:], 1)[0]
        parting = max(0.0, -float(slope))
        speed = closed + lag * parting / duration
    # Where force and squeeze are not in the proportion assumed, nor is what is left at the end.
    fitted = elastic * squeeze + viscous * duration * rate
    varies = float(np.linalg.norm(f - f.mean()))
    unlike = float(np.linalg.norm(f - fitted)) / varies if varies > 0 else 1.0
    terms = (
        *common,
        parting * end_std / duration,
        speed - closed,
        0.5 * unlike * float(squeeze.max()) / duration,
    )
    return Estimate(float(speed), math.hypot(*terms))


def _by_linear_law(time: Array, way: Array, force: Array, *, branch: bool) -> tuple[float, float]:
    """Speed, m/s, at which the squeeze v t - way makes the force, and the misfit's share of it.

    The law f + tau f' = E u + eta u', integrated once so that nothing is differentiated, is linear
    in its constants, none of them negative; ``branch`` False leaves out tau. The speed is found
    by search.
    """
    h = time[1]
    impulse = _integral(force, h)
    size = float(np.linalg.norm(impulse))
    if not size > 0:
        return math.nan, math.inf

    def misfit(speed: float) -> float:
        squeeze = speed * time - way
        columns = [squeeze, _integral(squeeze, h)]
        if branch:
            columns.append(-force)
        design = np.column_stack(columns)
        scale = np.linalg.norm(design, axis=0)
        return float(nnls(design / scale, impulse)[1]) / size

    closed = way[-1] / time[-1]
    trials = closed * np.linspace(*_SPEEDS)
    best = int(np.argmin([misfit(trial) for trial in trials]))
    if not 0 < best < trials.size - 1:
        return math.nan, math.inf
    found = minimize_scalar(misfit, bounds=(trials[best - 1], trials[best + 1]), method='bounded')
    return float(found.x), float(found.fun)


def _integral(values: Array, h: float) -> Array:
    """Running integral by the trapezium rule, zero at the first sample."""
    return np.concatenate(([0.0], np.cumsum(0.5 * h * (values[1:] + values[:-1]))))
