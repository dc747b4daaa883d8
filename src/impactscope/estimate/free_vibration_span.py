"""Where in a record the plate vibrates freely: after the last contact, until the noise.

A span passes if leaving out its beginning does not change the answer (Hausman's test on
decay and frequency, for half a period and for half of the information) and if its residual is
no larger early than late. Contact, a bounce or a transient inside the span fails both; so does
a vibration whose damping depends on its amplitude, which no later start mends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import EstimationError, InputError
from impactscope.estimate import free_oscillation as model
from impactscope.estimate import oscillation_kernels as kernels

__all__ = ['FreeVibration', 'choose_span']

Array = NDArray[np.float64]

HAUSMAN_LIMIT = 18.42  # chi-squared, 2 degrees: exceeded once in 10,000
VARIANCE_LIMIT = 3.72  # standard normal: exceeded once in 10,000
AMPLITUDE_LEFT = 0.001  # the span ends where the oscillation has this share of its start ...
NOISE_LEFT = 0.1  # ... and is below this share of the noise; what follows tells nothing
FEWEST_PERIODS = 3.0  # a trimmed span, or one found late, has at least so many, and ...
SHORTEST = 48  # ... so many samples
LEAST_AMPLITUDE = 0.4  # share of an oscillation's amplitude that a later start must keep
LEAST_SNR = 10.0  # amplitude over noise of an oscillation found somewhere after a long contact
GOOD_FIT = 0.9  # R² without noise below which a span that fails the tests is no free vibration
NEARLY_ALL = 0.95  # of the energy, R² without noise, where no start passes the tests
MOST_DAMPING = 0.3  # beyond it a vibration is too short to differ from a contact's end
MOST_STARTS = 32
SIGNIFICANT = 1e-4
NOTHING = 'no oscillation stands out of the noise after the last contact'
LEAST_BINS = 8  # of the spectrum, to know the noise's level from


@dataclass(frozen=True, slots=True, eq=False)
class FreeVibration:
    """A span of free vibration and the fit over it; indices count the record's samples."""

    start: int
    stop: int  # one past the last sample
    fit: model.FreeOscillationFit
    consistent: bool  # the tests found nothing against free linear vibration
    shift: float  # Hausman statistic; chi-squared with 2 degrees where consistent
    excess: float  # log variance ratio of early over late residual, in its standard deviation


def choose_span(
    values: ArrayLike,
    sample_rate: float,
    *,
    earliest: float | None = None,
    latest: float | None = None,
) -> FreeVibration:
    """Find the free vibration in a record and fit eq. 27 to it.

    Args:
        values: Shape (n_samples,), the force of one blow.
        sample_rate: Hz.
        earliest: s after the first sample at which the last contact had ended. Where it is
            not known the search begins at the largest excursion, and the span starts a quarter
            of a period after the first start that passes.
        latest: s after the first sample; nothing beyond is used.

    Raises:
        InputError: values that are not a finite vector, or times outside it.
        EstimationError: no free vibration was found; the message says why.
    """
    record, mean = model.centred(values, sample_rate)
    stop = record.size if latest is None else _index(latest, sample_rate, record.size)
    if earliest is None:
        level = float(np.median(record[:stop]))
        first = int(np.argmax(np.abs(record[:stop] - level)))
    else:
        first = _index(earliest, sample_rate, record.size)
    record = record[:stop]
    trial = _try(record, first)
    if not trial.passes and trial.reason != NOTHING:
        trial = _search(record, first, trial)
    if not trial.passes and earliest is not None and trial.reason != NOTHING:
        trimmed = _try(record, first, trim=True)
        if trimmed.passes or trial.solution is None:
            trial = trimmed
    if trial.passes and earliest is None:
        quarter = round(0.25 * trial.period)
        later = _try(record, trial.start + quarter)
        trial = later if later.passes else trial
    if trial.solution is None:
        raise EstimationError(trial.reason)
    if not trial.passes and trial.agreement < GOOD_FIT:
        raise EstimationError(
            'no span after the last contact behaves as one free damped oscillation '
            f'(R² without the noise is {trial.agreement:.2f} at best)'
        )
    fit = model.describe(trial.solution, mean + trial.mean, sample_rate)
    if earliest is None and fit.damping_ratio.value > MOST_DAMPING:
        raise EstimationError(
            f'a damping ratio of {fit.damping_ratio.value:.2f} cannot be told from a contact '
            'that fades; the time at which contact ended is needed'
        )
    return FreeVibration(
        start=trial.start,
        stop=trial.start + fit.n_samples,
        fit=fit,
        consistent=trial.passes,
        shift=trial.shift,
        excess=trial.excess,
    )


def _index(time: float, sample_rate: float, size: int) -> int:
    """Index of the first sample at or after a time."""
    index = math.ceil(time * sample_rate - 1e-6) if math.isfinite(time) else -1
    if not 0 <= index <= size:
        raise InputError(f'{time!r} s lies outside a record of {size / sample_rate:g} s')
    return index


@dataclass(slots=True, eq=False)
class _Trial:
    """One start and what came of it."""

    start: int
    mean: float = 0.0
    solution: model.Solution | None = None
    passes: bool = False
    shift: float = math.inf
    excess: float = math.inf
    level: float = 0.0  # the noise's variance, near the oscillation
    reason: str = ''

    @property
    def period(self) -> float:
        """Samples."""
        if self.solution is None:
            return math.nan
        return model.TWO_PI * self.solution.residual.size / self.solution.w

    @property
    def periods(self) -> float:
        """In the span; 0 without a fit."""
        return 0.0 if self.solution is None else self.solution.w / model.TWO_PI

    @property
    def damping_ratio(self) -> float:
        """Of the fit; inf without one."""
        if self.solution is None:
            return math.inf
        return self.solution.s / math.hypot(self.solution.s, self.solution.w)

    @property
    def amplitude(self) -> float:
        """At the start; inf without a fit."""
        if self.solution is None:
            return math.inf
        return math.hypot(float(self.solution.linear[0]), float(self.solution.linear[1]))

    @property
    def noise(self) -> float:
        """RMS of the residual; inf without a fit."""
        if self.solution is None:
            return math.inf
        return math.sqrt(self.solution.rss / self.solution.residual.size)

    @property
    def agreement(self) -> float:
        """Share of the energy that is not misfit: R² with the noise left out; -inf without fit."""
        if self.solution is None:
            return -math.inf
        misfit = self.solution.rss - self.level * self.solution.residual.size
        return 1.0 - max(misfit, 0.0) / self.solution.energy

    def test(self, y: Array, solution: model.Solution) -> None:
        """Set ``passes``, ``shift`` and ``excess`` for a fit of y."""
        if solution.rss <= model.ROUNDED * solution.energy:  # rounding has no statistics
            self.passes, self.shift, self.excess = True, 0.0, 0.0
            return
        variance = solution.rss / (y.size - model.PARAMETERS)
        level, misfit = variance, 0.0
        if not solution.white:
            level, misfit = _noise_level(solution.residual, solution.w, variance)
        self.shift, self.excess = _disagreement(
            y, solution.s, solution.w, solution.residual, level, min(1.0, variance / level)
        )
        self.excess = max(self.excess, misfit)
        self.level = level
        self.passes = self.shift <= HAUSMAN_LIMIT and self.excess <= VARIANCE_LIMIT


def _try(record: Array, start: int, *, trim: bool = False) -> _Trial:
    """Fit from ``start`` to the record's end, test, and cut off the part that is mere noise.

    The test is over the whole rest of the record: a contact may look like a short, strongly
    damped oscillation, but not like one followed by nothing. With ``trim`` it is over the
    shortened span, for records whose end is spoilt by a drift or a later disturbance.
    """
    trial = _Trial(start)
    y = record[start:]
    if y.size < model.FEWEST_SAMPLES:
        trial.reason = f'{y.size} samples remain after the last contact'
        return trial
    trial.mean = float(y.mean())
    y = y - trial.mean
    try:
        solution = model.solve(y)
        stop = _end(solution)
        if trim:
            solution = _shorten(trial, y, solution, stop)
            stop = solution.residual.size
        trial.test(y[:stop] if trim else y, solution)
        if not trim and trial.passes and stop < 0.9 * y.size:
            solution = _shorten(trial, y, solution, stop)
    except EstimationError as error:
        trial.passes = False
        trial.reason = str(error)
        return trial
    if solution.significance() > SIGNIFICANT:
        trial.passes = False
        trial.reason = NOTHING
        return trial
    trial.solution = solution
    return trial


def _shorten(trial: _Trial, y: Array, solution: model.Solution, stop: int) -> model.Solution:
    """The fit of the first ``stop`` samples, begun from that of all."""
    warm = np.array([[solution.s, solution.w]]) * (stop / y.size)
    shift = float(y[:stop].mean())
    trial.mean += shift
    return model.solve(y[:stop] - shift, warm)


def _end(solution: model.Solution) -> int:
    """Samples until the oscillation is far below the noise and below its own start."""
    n = solution.residual.size
    if solution.s <= 0.0:
        return n
    amplitude = math.hypot(float(solution.linear[0]), float(solution.linear[1]))
    noise = math.sqrt(solution.rss / n)
    if amplitude * NOISE_LEFT <= 0.0 or noise <= 0.0:
        return n
    folds = max(-math.log(AMPLITUDE_LEFT), math.log(amplitude / (NOISE_LEFT * noise)))
    fewest = FEWEST_PERIODS * model.TWO_PI * n / solution.w
    return min(n, max(math.ceil(folds * n / solution.s), math.ceil(fewest), SHORTEST))


def _search(record: Array, first: int, failed: _Trial) -> _Trial:
    """The earliest later start that passes; the first trial again where none does.

    As the amplitude falls, everything hides in the noise. So where the first trial is an
    oscillation already, a pass counts only while most of its amplitude is left; where it is
    not, it is a contact that lasts, and the oscillation may begin anywhere after it. An
    oscillation far from linear passes nowhere: then the earliest start counts from which on
    one damped oscillation explains nearly all of it.
    """
    size = record.size - first
    step = max(1.0, 0.9 * size / MOST_STARTS)
    last = 0.9 * size
    oscillates = failed.agreement >= GOOD_FIT and failed.damping_ratio <= MOST_DAMPING
    if oscillates and failed.solution is not None:
        step = max(1.0, 0.25 * failed.period)
        decay = max(failed.solution.s, 1e-9) / failed.solution.residual.size
        last = min(0.5 * size, -math.log(LEAST_AMPLITUDE) / decay)
        step = max(step, last / MOST_STARTS)
    nearly: _Trial | None = None
    for k in range(1, int(last / step) + 1):
        trial = _try(record, first + round(k * step))
        clear = (
            trial.damping_ratio <= MOST_DAMPING
            and trial.amplitude >= LEAST_SNR * trial.noise
            and trial.periods >= FEWEST_PERIODS
        )
        if trial.passes and (oscillates or clear):
            return trial
        if nearly is None and clear and not oscillates and trial.agreement >= NEARLY_ALL:
            nearly = trial
    return nearly or failed


@njit(cache=True)  # type: ignore[untyped-decorator]
def _disagreement(
    y: Array, s: float, w: float, residual: Array, variance: float, share: float
) -> tuple[float, float]:
    """(largest Hausman statistic, early over late residual variance in standard deviations).

    ``variance`` is the noise's, as a white one of the same power at the oscillation would have
    it; ``share`` says how many independent samples one sample of the residual is worth.
    """
    n = y.size
    c, q = np.empty(n), np.empty(n)
    g, h = np.zeros((5, 5)), np.zeros(5)
    linear, gradient, whole, part = np.zeros(3), np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2))
    kernels.moments(y, s, w, c, q, g, h)
    kernels.project(g, h, linear, gradient, whole)
    c_whole = np.linalg.inv(whole)
    half_information = n * min(0.25, 0.35 / max(s, 0.1))
    half_period = math.pi * n / w
    shift = 0.0
    for skip in (int(half_period), int(max(half_information, 2.0 * half_period))):
        rest = n - skip
        if rest < 2.0 * half_period or rest < 12 or skip < 1:
            continue
        left = rest / n
        kernels.moments(y[skip:], s * left, w * left, c[:rest], q[:rest], g, h)
        if not kernels.project(g, h, linear, gradient, part):
            continue
        c_part = np.linalg.inv(part)
        step_s = (c_part[0, 0] * gradient[0] + c_part[0, 1] * gradient[1]) / left
        step_w = (c_part[1, 0] * gradient[0] + c_part[1, 1] * gradient[1]) / left
        spread = c_part / (left * left) - c_whole
        det = spread[0, 0] * spread[1, 1] - spread[0, 1] ** 2
        if not det > 1e-12 * spread[0, 0] * spread[1, 1]:
            continue
        quadratic = (
            spread[1, 1] * step_s**2
            - 2.0 * spread[0, 1] * step_s * step_w
            + spread[0, 0] * step_w**2
        )
        shift = max(shift, quadratic / det / variance)
    n_early = int(max(half_information, 12.0))
    n_late = n - 2 * n_early
    if n_late < 12:
        return shift, 0.0
    early = np.mean(residual[:n_early] ** 2)
    late = np.mean(residual[2 * n_early :] ** 2)
    return shift, _ratio_in_std(early, n_early * share, late, n_late * share)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _ratio_in_std(first: float, dof_first: float, second: float, dof_second: float) -> float:
    """How far a variance lies above another, in standard deviations.

    Wilson and Hilferty's cube root makes the ratio close to normal.
    """
    if first <= 0.0 or second <= 0.0:
        return 0.0
    cube = (first / second) ** (1.0 / 3.0)
    a, b = 2.0 / (9.0 * dof_first), 2.0 / (9.0 * dof_second)
    z: float = ((1.0 - b) * cube - (1.0 - a)) / math.sqrt(a + b * cube * cube)
    return z


def _noise_level(residual: Array, w: float, variance: float) -> tuple[float, float]:
    """(variance of a white noise as strong as this one near the oscillation, misfit).

    The noise is taken to be level from the oscillation to ten times its frequency, and is read
    between 3 and 10 times: what a wrong model leaves lies lower. ``misfit`` is how far the
    residual below 2.5 times the frequency stands above that level, in standard deviations.
    """
    n = residual.size
    line = w / model.TWO_PI
    first, last = math.ceil(3.0 * line), min(int(10.0 * line), n // 2 - 1)
    if last - first < LEAST_BINS:
        return variance, 0.0
    window = np.hanning(n)  # keeps the start's transients from leaking up
    spectrum = np.fft.rfft(residual * window)[first : last + 1]
    level = float(np.mean(spectrum.real**2 + spectrum.imag**2) / np.sum(window**2))
    low = np.fft.rfft(residual)[1 : max(2, math.ceil(2.5 * line))]
    power = float(np.mean(low.real**2 + low.imag**2)) / n
    # The fit has taken two lines out of the lower band; Hann's bins are 2/3 independent.
    dof_low, dof_level = 2.0 * low.size, 2.0 * spectrum.size / 1.5
    misfit: float = _ratio_in_std(power, dof_low, max(level, 1e-300), dof_level)
    return level, misfit
