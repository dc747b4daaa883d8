"""The sensor's plate between and during contacts: free ring-down, and response to a pulse.

The reading r = k x of a plate on its spring follows r'' / wn^2 + 2 zeta r' / wn + r = f_i, with
the contact force f_i (equations 7 to 10 of the paper). It rises with the third power of time
after contact begins and swings on after contact has ended, often before its own peak: so a
threshold finds neither instant. Both are found by fitting the response to a contact force

    f_i(t) = sum_j p_j sin(j pi (t - t0) / T),  0 < t - t0 < T,  j = 1, 2, 3

in closed form: t0 and T by search, p_j by linear least squares (variable projection), with a
weak preference for the half-sine that only weighs where noise leaves the shape open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ['PlateModel', 'PulseFit', 'fit_pulse', 'fit_ring_down', 'pulse_response']

TERMS = 3
SHAPE_PRIOR = 0.1  # standard deviation of p_2 / p_1 and p_3 / p_1 expected beforehand
LEAST_SLOPE = 0.5  # of the force when contact begins, over that of a half-sine
SHORTEST = 0.02  # of the plate's period, contact that its reading still has a length of
STIFFNESS = 0.1  # noise over peak that a search begins with
MOST_BINS = 320  # samples that a fit uses; more are averaged into these
LEAST_PERIODS = 2.0  # of ring-down above noise from which a plate's model is learned
SIMPLEX_STEPS = 60


@dataclass(frozen=True, slots=True)
class PlateModel:
    """Undamped natural frequency in rad/s and damping ratio of the plate on its spring."""

    natural_frequency: float
    damping_ratio: float

    @property
    def period(self) -> float:
        """Of the undamped oscillation, s."""
        return 2 * math.pi / self.natural_frequency


@dataclass(frozen=True, slots=True)
class PulseFit:
    """A contact as fitted; times in s on the axis of the samples given."""

    start: float
    duration: float
    amplitudes: NDArray[np.float64]  # p_j, shape (3,)
    rms: float  # of the residual of the averaged samples, N
    noise: float  # standard deviation of the averaged samples, N

    def moved(self, by: float) -> PulseFit:
        """The same contact on an axis that begins ``by`` seconds earlier."""
        return replace(self, start=self.start + by)

    def response(self, n: int, rate: float, plate: PlateModel) -> NDArray[np.float64]:
        """The plate's reading, ring-down included, at n samples; N, shape (n,)."""
        basis = np.empty((TERMS, n))
        pulse_response(
            0.0,
            1 / rate,
            self.start,
            self.duration,
            plate.natural_frequency,
            plate.damping_ratio,
            basis,
        )
        reading: NDArray[np.float64] = self.amplitudes @ basis
        return reading


@njit(cache=True)  # type: ignore[untyped-decorator]
def pulse_response(
    origin: float,
    step: float,
    start: float,
    duration: float,
    natural_frequency: float,
    damping_ratio: float,
    basis: NDArray[np.float64],
) -> None:
    """Reading of a plate at rest pushed by sin(j pi (t - start) / duration) in the contact.

    ``basis`` has shape (3, n) and receives the responses for j = 1, 2, 3 at the times
    origin + i step. The phasors are turned from sample to sample rather than computed anew.
    """
    n = basis.shape[1]
    decay = damping_ratio * natural_frequency
    damped = natural_frequency * np.sqrt(1 - damping_ratio * damping_ratio)
    free_turn = np.exp((-decay + 1j * damped) * step)
    basis[:, :] = 0.0
    first = max(int(np.floor((start - origin) / step)) + 1, 0)
    if first >= n:
        return
    split = min(max(int(np.ceil((start + duration - origin) / step)), first), n)
    began = origin + first * step - start
    ended = origin + split * step - start - duration
    sign = 1.0
    for j in range(TERMS):
        drive = (j + 1) * np.pi / duration
        gain = natural_frequency**2 / (natural_frequency**2 - drive**2 + 2j * decay * drive)
        # At rest when contact begins: the free part cancels reading and slope of the driven one.
        cosine = -gain.imag
        sine = (decay * cosine - gain.real * drive) / damped
        free = np.exp((-decay + 1j * damped) * began) * (cosine - 1j * sine)
        driven = np.exp(1j * drive * began) * gain
        turn = np.exp(1j * drive * step)
        for i in range(first, split):
            basis[j, i] = driven.imag + free.real
            driven *= turn
            free *= free_turn
        free += sign * np.exp((-decay + 1j * damped) * ended) * (cosine - 1j * sine)
        for i in range(split, n):
            basis[j, i] = free.real
            free *= free_turn
        sign = -sign


@njit(cache=True)  # type: ignore[untyped-decorator]
def _misfit(
    origin: float,
    step: float,
    reading: NDArray[np.float64],
    start: float,
    duration: float,
    natural_frequency: float,
    damping_ratio: float,
    variance: float,
    basis: NDArray[np.float64],
    amplitudes: NDArray[np.float64],
) -> float:
    """Sum of squares, prior included, at the best amplitudes for a start and a duration."""
    if duration < SHORTEST * 2 * np.pi / natural_frequency:
        return np.inf
    pulse_response(origin, step, start, duration, natural_frequency, damping_ratio, basis)
    power = 0.0
    along = 0.0
    for i in range(reading.shape[0]):
        power += basis[0, i] * basis[0, i]
        along += basis[0, i] * reading[i]
    if power == 0.0 or along <= 0.0:
        return np.inf
    ridge = variance / (SHAPE_PRIOR * along / power) ** 2
    normal = np.zeros((TERMS, TERMS))
    right = np.zeros(TERMS)
    for j in range(TERMS):
        for m in range(j, TERMS):
            total = 0.0
            for i in range(reading.shape[0]):
                total += basis[j, i] * basis[m, i]
            normal[j, m] = total
            normal[m, j] = total
        total = 0.0
        for i in range(reading.shape[0]):
            total += basis[j, i] * reading[i]
        right[j] = total
        if j > 0:
            normal[j, j] += ridge
    amplitudes[:] = np.linalg.solve(normal, right)
    misfit = 0.0
    for i in range(reading.shape[0]):
        model = 0.0
        for j in range(TERMS):
            model += amplitudes[j] * basis[j, i]
        misfit += (reading[i] - model) ** 2
    for j in range(1, TERMS):
        misfit += ridge * amplitudes[j] ** 2
    # A spring pushes back from the first instant on: contact does not begin with a creep.
    slope = (amplitudes[0] + 2 * amplitudes[1] + 3 * amplitudes[2]) / amplitudes[0]
    if slope < LEAST_SLOPE:
        misfit += variance * ((LEAST_SLOPE - slope) / 0.02) ** 2
    return misfit


@njit(cache=True)  # type: ignore[untyped-decorator]
def _grid(
    origin: float,
    step: float,
    reading: NDArray[np.float64],
    latest: float,
    natural_frequency: float,
    damping_ratio: float,
    variance: float,
    basis: NDArray[np.float64],
    amplitudes: NDArray[np.float64],
) -> tuple[float, float]:
    """Start and duration of the least misfit on a coarse grid."""
    period = 2 * np.pi / natural_frequency
    best = np.inf
    point = latest, 0.3 * period
    for a in range(8):
        for b in range(10):
            begin = latest - 0.5 * period * a / 7
            length = 0.04 * period * 1.5**b
            cost = _misfit(
                origin, step, reading, begin, length, natural_frequency, damping_ratio,
                variance, basis, amplitudes,
            )  # fmt: skip
            if cost < best:
                best = cost
                point = begin, length
    return point


@njit(cache=True)  # type: ignore[untyped-decorator]
def _refine(
    origin: float,
    step: float,
    reading: NDArray[np.float64],
    start: float,
    duration: float,
    natural_frequency: float,
    damping_ratio: float,
    variance: float,
    basis: NDArray[np.float64],
    amplitudes: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Start, duration and misfit by the simplex method of Nelder and Mead."""
    period = 2 * np.pi / natural_frequency
    points = np.array(
        [[start, duration], [start + 0.03 * period, duration], [start, 1.2 * duration]]
    )
    costs = np.empty(3)
    for k in range(3):
        costs[k] = _misfit(
            origin, step, reading, points[k, 0], points[k, 1], natural_frequency,
            damping_ratio, variance, basis, amplitudes,
        )  # fmt: skip
    for _ in range(SIMPLEX_STEPS):
        order = np.argsort(costs)
        points, costs = points[order], costs[order]
        if np.abs(points[1:] - points[0]).max() < 1e-5 * period:
            break
        centre = (points[0] + points[1]) / 2
        away = centre - points[2]
        trial = centre + away
        cost = _misfit(
            origin, step, reading, trial[0], trial[1], natural_frequency, damping_ratio,
            variance, basis, amplitudes,
        )  # fmt: skip
        if cost >= costs[1]:
            nearer = centre + 0.5 * away if cost < costs[2] else centre - 0.5 * away
            second = _misfit(
                origin, step, reading, nearer[0], nearer[1], natural_frequency, damping_ratio,
                variance, basis, amplitudes,
            )  # fmt: skip
            if second < min(cost, costs[2]):
                points[2], costs[2] = nearer, second
                continue
            for k in range(1, 3):
                points[k] = (points[k] + points[0]) / 2
                costs[k] = _misfit(
                    origin, step, reading, points[k, 0], points[k, 1], natural_frequency,
                    damping_ratio, variance, basis, amplitudes,
                )  # fmt: skip
            continue
        if cost < costs[0]:
            further = centre + 2 * away
            second = _misfit(
                origin, step, reading, further[0], further[1], natural_frequency,
                damping_ratio, variance, basis, amplitudes,
            )  # fmt: skip
            if second < cost:
                trial, cost = further, second
        points[2], costs[2] = trial, cost
    best = np.argmin(costs)
    cost = _misfit(
        origin, step, reading, points[best, 0], points[best, 1], natural_frequency,
        damping_ratio, variance, basis, amplitudes,
    )  # fmt: skip
    return points[best, 0], points[best, 1], cost


def fit_pulse(
    reading: NDArray[np.float64], rate: float, plate: PlateModel, rise: float, noise: float
) -> PulseFit | None:
    """Start and duration of one contact from the reading around it.

    Args:
        reading: N, from a plate at rest (earlier motion taken off) to before the next contact,
            shape (n_samples,).
        rate: Hz.
        plate: natural frequency and damping ratio.
        rise: s, by which the reading has visibly risen; contact began before.
        noise: standard deviation of a sample, N.

    Returns:
        the fit, or None where the reading does not follow such a response.
    """
    width = max(-(-reading.size // MOST_BINS), 1)
    count = reading.size // width
    if count < 8 or not np.isfinite(reading).all():
        return None
    binned = reading[: count * width].reshape(count, width).mean(axis=1)
    basis = np.empty((TERMS, count))
    amplitudes = np.zeros(TERMS)
    variance = max(noise**2 / width, (1e-4 * float(np.abs(binned).max())) ** 2)
    sampling = (width - 1) / 2 / rate, width / rate
    oscillator = plate.natural_frequency, plate.damping_ratio
    # The shape is held close to a half-sine first: with it free, the search would stop in a
    # valley where a longer contact of an odd shape imitates the true one.
    stiff = max(variance, (STIFFNESS * float(np.abs(binned).max())) ** 2)
    start, duration = _grid(*sampling, binned, rise, *oscillator, stiff, basis, amplitudes)
    cost = math.inf
    for level in (stiff, math.sqrt(stiff * variance), variance):
        start, duration, cost = _refine(
            *sampling, binned, start, duration, *oscillator, level, basis, amplitudes
        )
    if not math.isfinite(cost) or duration > 2.2 * plate.period:
        return None
    rms = math.sqrt(cost / count)
    if not _is_one_push(amplitudes):
        return None
    return PulseFit(start, duration, amplitudes, rms, noise / math.sqrt(width))


def _is_one_push(amplitudes: NDArray[np.float64]) -> bool:
    """Whether the force is nowhere pulling and not two humps with a gap between them."""
    phase = np.linspace(0, math.pi, 65)
    force = sum(p * np.sin((j + 1) * phase) for j, p in enumerate(amplitudes))
    largest = float(np.max(force))
    before = np.maximum.accumulate(force)
    after = np.maximum.accumulate(force[::-1])[::-1]
    dip = float(np.max(np.minimum(before, after) - force))
    return bool(largest > 0 and np.min(force) > -0.1 * largest and dip < 0.5 * largest)


def fit_ring_down(
    reading: NDArray[np.float64], rate: float, noise: float
) -> tuple[PlateModel, float] | None:
    """Natural frequency and damping ratio from a free ring-down, if it is one.

    Args:
        reading: from the end of contact on, shape (n_samples,).
        rate: Hz.
        noise: standard deviation of a sample.

    Returns:
        the plate's model and the weight of what it rests on (amplitude over noise, squared,
        times samples); None where there is no such oscillation or more than one.
    """
    width = max(-(-reading.size // (2 * MOST_BINS)), 1)
    count = reading.size // width
    if count < 32 or not np.isfinite(reading).all():
        return None
    values: NDArray[np.float64] = reading[: count * width].reshape(count, width).mean(axis=1)
    step = width / rate
    t = np.arange(count, dtype=np.float64) * np.float64(step)
    centred = values - values[count // 2 :].mean()
    spectrum = np.abs(np.fft.rfft(centred, 4 * count))
    omega = 2 * math.pi * int(np.argmax(spectrum)) / (4 * count * step)
    if omega == 0:
        return None
    deviation = noise / math.sqrt(width)
    for ratio in (0.05, 0.02, 0.15):
        found, decay, amplitude, rms = _damped_fit(t, values, omega, ratio * omega)
        if rms < 1.2 * deviation:
            break
    omega = found
    natural = math.hypot(omega, decay)
    ratio = decay / natural
    if not (0.003 < ratio < 0.4) or natural * step > 1:
        return None
    heard = math.log(max(amplitude / max(deviation, 1e-12), 1.0)) / decay
    if min(heard, t[-1]) * omega / (2 * math.pi) < LEAST_PERIODS:
        return None
    if rms > 1.5 * deviation + 0.03 * amplitude:
        return None
    weight = (amplitude / max(rms, 1e-12)) ** 2 / (decay * step)
    return PlateModel(natural, ratio), weight


def _damped_fit(
    t: NDArray[np.float64], values: NDArray[np.float64], omega: float, decay: float
) -> tuple[float, float, float, float]:
    """Gauss-Newton on frequency and decay; amplitude, phase and offset are linear."""
    rms = math.inf
    amplitude = 0.0
    best = (omega, decay, 0.0, math.inf)
    for _ in range(12):
        fall = np.exp(-decay * t)
        c, s = fall * np.cos(omega * t), fall * np.sin(omega * t)
        basis = np.stack([c, s, np.ones_like(t)], axis=1)
        linear, *_ = np.linalg.lstsq(basis, values, rcond=None)
        model = basis @ linear
        residual = values - model
        rms = float(np.sqrt(np.mean(residual**2)))
        amplitude = math.hypot(linear[0], linear[1])
        if rms < best[3]:
            best = (omega, decay, amplitude, rms)
        by_omega = t * (linear[1] * c - linear[0] * s)
        by_decay = -t * (linear[0] * c + linear[1] * s)
        jacobian = np.column_stack([basis, by_omega, by_decay])
        change, *_ = np.linalg.lstsq(jacobian, residual, rcond=None)
        limit = 0.2 * omega
        omega += float(np.clip(change[3], -limit, limit))
        decay += float(np.clip(change[4], -0.5 * decay, decay))
        if abs(change[3]) < 1e-7 * omega and abs(change[4]) < 1e-6 * decay:
            break
        if omega <= 0 or decay <= 0:
            break
    return best
