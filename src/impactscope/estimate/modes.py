"""Several decaying modes in one span: what rings where the sensor is no single mass on a spring.

    f(t) = sum over modes of exp(-zeta wn t) (a cos(wd t) + b sin(wd t)),  wd = wn sqrt(1 - zeta²)

Least squares in the spectrum. The discrete Fourier transform of a decaying oscillation that is
cut off after n samples is known in closed form, leakage and all, so nothing is windowed; and
since a mode shows in few lines, all modes are fitted together over the lines around them alone.
Frequencies and damping ratios are searched, amplitudes are linear (variable projection, Golub
and Pereyra, Inverse Problems 19, 2003). Modes are added where most of the rest is. The
standard uncertainties take the noise from the rest near each mode, so it need not be white.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import EstimationError
from impactscope.estimate.free_oscillation import TWO_PI, centred
from impactscope.records import Estimate, Mode

__all__ = ['ModalFit', 'fit_modes']

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

MOST_MODES = 12
LEAST_SHARE = 2e-3  # of the span's energy, that a mode has to explain
FALSE_ALARM = 1e-6  # chance that noise alone passes for a mode anywhere in the spectrum
FEWEST_PERIODS = 3.0  # in the span
MOST_DAMPING = 0.3  # beyond it a mode has no line of its own
LINES = 10  # around a mode, to each side at least ...
WIDTHS = 6.0  # ... and so many of its half widths, which are fitted
FLOOR_LINES = 257  # over which the noise's level is the median
NOISE_LINES = 25  # around each line, over which what is left tells its uncertainty
STEPS = 20
WHILE_ADDING = 1  # steps before the next mode is looked for
CONVERGED = 1e-2  # of a standard uncertainty
HALVINGS = 8
RIDGE = 1e-12  # of a scaled column's square
LARGEST_STD = 0.5  # relative standard uncertainty of a mode's damping ratio


@dataclass(frozen=True, slots=True, eq=False)
class ModalFit:
    """The modes of one span, that with the most energy first; time zero is the first sample."""

    modes: tuple[Mode, ...]
    phases: tuple[float, ...]  # rad, of each mode's cosine
    r_squared: float  # of all modes together, over the span
    rmse: float  # unit of the values
    n_samples: int
    sample_rate: float  # Hz

    def evaluate(self, time: ArrayLike) -> Array:
        """Sum of the modes at times in s after the first sample; the shape of ``time``."""
        t = np.asarray(time, dtype=np.float64)
        total = np.zeros(t.shape)
        for mode, phase in zip(self.modes, self.phases, strict=True):
            wn = TWO_PI * mode.natural_frequency.value
            zeta = mode.damping_ratio.value
            angle = wn * math.sqrt(1.0 - zeta**2) * t + phase
            total += mode.amplitude.value * np.exp(-zeta * wn * t) * np.cos(angle)
        return total


def fit_modes(values: ArrayLike, sample_rate: float, most: int = MOST_MODES) -> ModalFit:
    """Find the modes that ring in a span and fit them together.

    Args:
        values: Shape (n_samples,), any unit, free vibration from the first sample on.
        sample_rate: Hz.
        most: modes that are looked for.

    Raises:
        InputError: values that are not a finite vector, or a rate that is not positive.
        EstimationError: nothing that rings stands out of the noise.
    """
    y, _ = centred(values, sample_rate)
    spectrum = _Spectrum(y)
    poles = np.empty((0, 2))
    while poles.shape[0] < most:
        rest = spectrum.rest(poles)
        candidate = spectrum.candidate(rest, poles)
        if candidate is None:
            break
        alone = spectrum.refine(candidate[np.newaxis], rest)
        if not spectrum.admissible(alone):
            spectrum.forget(candidate)
            continue
        joined = spectrum.refine(np.vstack([poles, alone]), spectrum.transform, WHILE_ADDING)
        if not spectrum.admissible(joined):
            spectrum.forget(candidate)
            continue
        poles = joined
    if poles.shape[0] == 0:
        raise EstimationError('nothing that rings stands out of the noise')
    settled = spectrum.refine(poles, spectrum.transform)
    if spectrum.admissible(settled):
        poles = settled
    return spectrum.describe(poles, sample_rate)


class _Spectrum:
    """Lines of a span's discrete Fourier transform, from 3 periods in the span up.

    Poles are rows (decay, angle), both in rad a sample.
    """

    def __init__(self, y: Array) -> None:
        self.n = y.size
        self.transform: ComplexArray = np.fft.rfft(y)[: (y.size + 1) // 2]
        self.transform[0] = 0.0
        self.turns: ComplexArray = np.exp(-1j * TWO_PI / self.n * np.arange(self.transform.size))
        self.energy = float(np.sum(np.abs(self.transform) ** 2))
        self.open = np.ones(self.transform.size, dtype=bool)  # lines where modes are looked for
        self.open[: math.ceil(FEWEST_PERIODS)] = False
        self.open[-2:] = False

    def columns(self, poles: Array, lines: NDArray[np.int64]) -> ComplexArray:
        """Transforms of every mode's cosine and sine, shape (n_lines, 2 n_modes)."""
        out = np.empty((lines.size, 2 * poles.shape[0]), dtype=np.complex128)
        turn = self.turns[lines]
        for k, z in enumerate(_on_circle(poles)):
            upper = (1.0 - z**self.n) / (1.0 - z * turn)
            lower = (1.0 - z.conjugate() ** self.n) / (1.0 - z.conjugate() * turn)
            out[:, 2 * k] = 0.5 * (upper + lower)
            out[:, 2 * k + 1] = -0.5j * (upper - lower)
        return out

    def derivatives(self, poles: Array, weights: Array, lines: NDArray[np.int64]) -> ComplexArray:
        """Of the sum of modes after each decay and angle, shape (n_lines, 2 n_modes)."""
        out = np.empty((lines.size, 2 * poles.shape[0]), dtype=np.complex128)
        turn = self.turns[lines]
        for k, z in enumerate(_on_circle(poles)):
            factor = 0.5 * complex(weights[2 * k], -weights[2 * k + 1])
            by_decay = np.zeros(lines.size, dtype=np.complex128)
            by_angle = np.zeros(lines.size, dtype=np.complex128)
            for c, p, side in ((factor, z, 1.0), (factor.conjugate(), z.conjugate(), -1.0)):
                down = 1.0 - p * turn
                slope = ((1.0 - p**self.n) * turn / down - self.n * p ** (self.n - 1)) / down
                by_decay -= c * p * slope
                by_angle += side * 1j * c * p * slope
            out[:, 2 * k] = by_decay
            out[:, 2 * k + 1] = by_angle
        return out

    def lines_of(self, poles: Array) -> NDArray[np.int64]:
        """Numbers of the lines around the modes."""
        near = np.zeros(self.transform.size, dtype=bool)
        for decay, angle in poles:
            middle = round(angle * self.n / TWO_PI)
            reach = math.ceil(max(LINES, WIDTHS * decay * self.n / TWO_PI))
            near[max(middle - reach, 1) : middle + reach + 1] = True
        return np.flatnonzero(near)

    def weights(
        self, poles: Array, target: ComplexArray, lines: NDArray[np.int64]
    ) -> tuple[Array, ComplexArray]:
        """Least-squares weights of the columns, and what is left of the target."""
        columns = _real(self.columns(poles, lines))
        found = _least_squares(columns, _real(target[lines]))
        return found, target[lines] - _complex(_times(columns, found))

    def rest(self, poles: Array) -> ComplexArray:
        """What the modes leave of the transform, all lines."""
        if poles.shape[0] == 0:
            return self.transform.copy()
        found, _ = self.weights(poles, self.transform, self.lines_of(poles))
        every = np.arange(self.transform.size)
        sum_of_modes = _complex(_times(_real(self.columns(poles, every)), found))
        left: ComplexArray = self.transform - sum_of_modes
        left[0] = 0.0  # the offset is free
        return left

    def candidate(self, rest: ComplexArray, poles: Array) -> Array | None:
        """Pole of the strongest line that is no noise and worth a mode; None if there is none."""
        power = np.abs(rest) ** 2
        floor = _running_median(power, FLOOR_LINES) / math.log(2.0)
        clear = power > floor * math.log(power.size / FALSE_ALARM)
        clear &= self.open
        for decay, angle in poles:  # a mode is not split in two by its own misfit
            middle, width = angle * self.n / TWO_PI, max(1.0, decay * self.n / TWO_PI)
            clear[max(math.ceil(middle - width), 0) : math.floor(middle + width) + 1] = False
        if not clear.any():
            return None
        peak = int(np.argmax(np.where(clear, power, 0.0)))
        low, high = peak, peak
        while low > 1 and power[low - 1] > 0.5 * power[peak]:
            low -= 1
        while high < power.size - 1 and power[high + 1] > 0.5 * power[peak]:
            high += 1
        if float(np.sum(power[low : high + 1])) < LEAST_SHARE * self.energy:
            return None
        half_width = 0.5 * max(high - low, 0.5)
        return np.array([half_width, float(peak)]) * TWO_PI / self.n

    def forget(self, pole: Array) -> None:
        """Look no more for a mode there."""
        middle = round(pole[1] * self.n / TWO_PI)
        self.open[max(middle - 1, 0) : middle + 2] = False

    def refine(self, poles: Array, target: ComplexArray, steps: int = STEPS) -> Array:
        """Poles after that many steps of Gauss-Newton, shortened where they lead uphill."""
        lines = self.lines_of(poles)
        found, left = self.weights(poles, target, lines)
        rss = float(np.sum(np.abs(left) ** 2))
        for _ in range(steps):
            jacobian = _real(
                np.hstack([self.derivatives(poles, found, lines), self.columns(poles, lines)])
            )
            step = _least_squares(jacobian, _real(left))
            change = step[: poles.size].reshape(poles.shape)
            for _ in range(HALVINGS):
                trial = poles + change
                if ((trial > 0.0) & (trial < math.pi)).all():
                    weights, rest = self.weights(trial, target, lines)
                    smaller = float(np.sum(np.abs(rest) ** 2))
                    if smaller <= rss:
                        break
                change = 0.5 * change
            else:
                return poles
            # The step in standard deviations: its share of what is left, times the degrees.
            gain = (rss - smaller) / max(rss, 1e-300) * 2 * lines.size
            poles, found, left, rss = trial, weights, rest, smaller
            if gain < CONVERGED**2:
                return poles
        return poles

    def admissible(self, poles: Array) -> bool:
        """Whether all are decaying modes apart from each other."""
        ratio = poles[:, 0] / np.hypot(poles[:, 0], poles[:, 1])
        if not ((ratio < MOST_DAMPING) & (poles[:, 1] * self.n > FEWEST_PERIODS * TWO_PI)).all():
            return False
        order = np.sort(poles[:, 1])
        return bool((np.diff(order) > 0.5 * TWO_PI / self.n).all())

    def describe(self, poles: Array, sample_rate: float) -> ModalFit:
        """The modes in physical units with their uncertainties."""
        lines = self.lines_of(poles)
        found, left = self.weights(poles, self.transform, lines)
        covariance = self._covariance(poles, found, lines, left)
        rest = float(np.sum(np.abs(self.rest(poles)) ** 2))
        modes, phases, energies = [], [], []
        for k, (decay, angle) in enumerate(poles * sample_rate):
            a, b = found[2 * k], found[2 * k + 1]
            wn, amplitude = math.hypot(decay, angle), math.hypot(a, b)
            of_pole = covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] * sample_rate**2
            first = 2 * (poles.shape[0] + k)
            of_weights = covariance[first : first + 2, first : first + 2]
            modes.append(
                Mode(
                    Estimate(wn / TWO_PI, _std(np.array([decay, angle]) / wn / TWO_PI, of_pole)),
                    Estimate(
                        decay / wn, _std(np.array([angle**2, -decay * angle]) / wn**3, of_pole)
                    ),
                    Estimate(amplitude, _std(np.array([a, b]) / amplitude, of_weights)),
                )
            )
            phases.append(math.atan2(-b, a))
            energies.append(amplitude**2 / decay)
        told = [
            k
            for k in np.argsort(energies)[::-1].tolist()
            if modes[k].damping_ratio.std <= LARGEST_STD * modes[k].damping_ratio.value
        ]
        if not told:
            raise EstimationError('what rings is too close to the noise to tell its damping')
        return ModalFit(
            modes=tuple(modes[k] for k in told),
            phases=tuple(phases[k] for k in told),
            r_squared=1.0 - rest / self.energy,
            rmse=math.sqrt(2.0 * rest) / self.n,
            n_samples=self.n,
            sample_rate=sample_rate,
        )

    def _covariance(
        self, poles: Array, found: Array, lines: NDArray[np.int64], left: ComplexArray
    ) -> Array:
        """Of decay and angle of every mode, then of every mode's weights; (4 n, 4 n).

        (J'J)^-1 J'SJ (J'J)^-1 with S the power of what is left around each line. Where the rest
        goes together from line to line (a transient at the span's beginning) it is counted so.
        """
        jacobian = _real(
            np.hstack([self.derivatives(poles, found, lines), self.columns(poles, lines)])
        )
        scale = np.linalg.norm(jacobian, axis=0)
        jacobian /= scale
        power = np.abs(left) ** 2
        near = np.ones(min(NOISE_LINES, power.size))
        local = np.convolve(power, near, mode='same')
        local /= np.convolve(np.ones(power.size), near, mode='same')
        # What the fit took away of it, spread evenly.
        local *= power.size / max(power.size - poles.size, 1)
        together = np.diff(lines) == 1
        product = np.sum((left[1:] * left[:-1].conj()).real[together])
        share = float(np.clip(product / max(float(np.sum(power)), 1e-300), 0.0, 0.95))
        local *= (1.0 + share) / (1.0 - share)
        rows = np.zeros(jacobian.shape[0])
        normal, _ = _normal_equations(jacobian, rows)
        inverse = np.linalg.inv(normal + RIDGE * np.eye(normal.shape[0]))
        root = np.sqrt(0.5 * np.concatenate([local, local]))[:, np.newaxis]
        middle, _ = _normal_equations(jacobian * root, rows)
        covariance: Array = inverse @ middle @ inverse / np.outer(scale, scale)
        return covariance


def _on_circle(poles: Array) -> list[complex]:
    """The factor by which each mode's phasor changes from sample to sample."""
    return [complex(z) for z in np.exp(-poles[:, 0] + 1j * poles[:, 1])]


def _real(values: ComplexArray) -> Array:
    """Real parts above imaginary parts."""
    return np.concatenate([values.real, values.imag])


def _complex(values: Array) -> ComplexArray:
    """The inverse of ``_real``, for a column."""
    half = values.size // 2
    return np.asarray(values[:half] + 1j * values[half:])


def _least_squares(columns: Array, target: Array) -> Array:
    """By normal equations of scaled columns: they are few, and far from dependent."""
    gram, right = _normal_equations(columns, target)
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    gram /= np.outer(scale, scale)
    gram[np.diag_indices_from(gram)] += RIDGE
    return np.asarray(np.linalg.solve(gram, right / scale) / scale)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _times(columns: Array, weights: Array) -> Array:
    out = np.empty(columns.shape[0])
    for i in range(columns.shape[0]):
        total = 0.0
        for k in range(weights.size):
            total += columns[i, k] * weights[k]
        out[i] = total
    return out


@njit(cache=True)  # type: ignore[untyped-decorator]
def _normal_equations(columns: Array, target: Array) -> tuple[Array, Array]:
    """X'X and X'y, in an order of summation that no number of threads changes."""
    rows, size = columns.shape
    gram, right = np.zeros((size, size)), np.zeros(size)
    for i in range(rows):
        row = columns[i]
        for j in range(size):
            x = row[j]
            right[j] += x * target[i]
            for k in range(j, size):
                gram[j, k] += x * row[k]
    for j in range(size):
        for k in range(j):
            gram[j, k] = gram[k, j]
    return gram, right


def _std(gradient: Array, covariance: Array) -> float:
    return math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))


def _running_median(values: Array, width: int) -> Array:
    """Median of the stretch around each value, found for every quarter of a width."""
    width = min(width, values.size)
    step = max(width // 4, 1)
    starts = np.arange(0, values.size - width + 1, step)
    windows = np.lib.stride_tricks.sliding_window_view(values, width)[starts]
    return np.interp(
        np.arange(values.size), starts + 0.5 * (width - 1), np.median(windows, axis=1)
    )
