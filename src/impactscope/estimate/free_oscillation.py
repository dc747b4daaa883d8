"""The free oscillation of a plate on its spring: eq. 26 and 27 of Samarathunga et al. 2024.

    f(t) = A exp(-zeta wn t) cos(wd t + phi) + B,    wd = wn sqrt(1 - zeta²)

Least squares by variable projection, from starting values that the data give. The standard
uncertainties are those of least squares with the noise taken from the residual; where the
residual is not white they grow with its power around the oscillation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import EstimationError, InputError
from impactscope.estimate import oscillation_kernels as kernels
from impactscope.records import Estimate

__all__ = ['FreeOscillationFit', 'fit_free_oscillation']

Array = NDArray[np.float64]

PARAMETERS = 5
FEWEST_SAMPLES = 12
FEWEST_PERIODS = 1.0  # below, offset and oscillation cannot be told apart
BATCHED = 4096  # samples up to which all starting spectra are made in one call
LAGS = 8  # of the whiteness test
ROUNDED = 1e-20  # residual's share of the energy at the resolution of float64
WHITE_LIMIT = 31.83  # Ljung-Box over 8 lags: exceeded by white noise once in 10,000
NOISE_SEARCH = 4.0  # how many independent lines a sample offers to the search, about
TWO_PI = 2.0 * math.pi


@dataclass(frozen=True, slots=True, eq=False)
class FreeOscillationFit:
    """One fit; time zero is the first sample.

    ``covariance`` has shape (5, 5), in the order natural frequency (Hz), damping ratio,
    amplitude, phase (rad), offset.
    """

    natural_frequency: Estimate  # Hz, undamped
    damped_frequency: Estimate  # Hz
    damping_ratio: Estimate
    decay_rate: Estimate  # 1/s: damping ratio times natural angular frequency
    amplitude: Estimate  # unit of the values, at the first sample
    phase: Estimate  # rad, in (-pi, pi]
    offset: Estimate  # unit of the values
    covariance: Array
    r_squared: float
    rmse: float  # unit of the values: root of the mean squared residual
    noise_std: float  # unit of the values: the same over the degrees of freedom
    autocorrelation: float  # of the residual at lag 1
    whiteness: float  # Ljung-Box statistic over 8 lags; chi-squared with 8 degrees if white
    white: bool  # no correlation found in the residual (false once in 10,000 if there is none)
    inflation: float  # factor on the standard uncertainties for a residual that is not white
    significance: float  # bound on the probability of such a fit in noise alone
    n_samples: int
    sample_rate: float  # Hz
    iterations: int

    @property
    def periods(self) -> float:
        """Damped periods in the fitted span."""
        return self.damped_frequency.value * self.n_samples / self.sample_rate

    def evaluate(self, time: ArrayLike) -> Array:
        """The fitted model at times in s after the first sample; the shape of ``time``."""
        t = np.asarray(time, dtype=np.float64)
        angle = TWO_PI * self.damped_frequency.value * t + self.phase.value
        envelope = self.amplitude.value * np.exp(-self.decay_rate.value * t)
        return np.asarray(envelope * np.cos(angle) + self.offset.value)

    def residuals(self, values: ArrayLike) -> Array:
        """Values minus model, for samples that begin at the fit's first sample."""
        y = np.asarray(values, dtype=np.float64)
        return np.asarray(y - self.evaluate(np.arange(y.size) / self.sample_rate))


class Solution(NamedTuple):
    """A fit in the span's own units: decay s and angle w over the span."""

    s: float
    w: float
    linear: Array  # a, b, offset (of the centred record)
    products: Array  # (5, 5), of the columns
    curvature: Array  # (5, 5), residual times second derivatives
    energy: float  # sum of squares about the mean
    rss: float
    residual: Array
    autocorrelation: float  # of the residual at lag 1
    whiteness: float  # Ljung-Box statistic of the residual
    iterations: int

    @property
    def white(self) -> bool:
        """Whether the residual shows no correlation, or is no more than rounding."""
        return self.rss <= ROUNDED * self.energy or self.whiteness <= WHITE_LIMIT

    def significance(self, inflation: float = 1.0) -> float:
        """Bound on the probability that noise alone gives so strong a line anywhere."""
        n = self.residual.size
        left = self.rss / self.energy
        gain = -0.5 * (n - PARAMETERS) * math.log(left) / inflation**2 if left > 0.0 else math.inf
        return min(1.0, NOISE_SEARCH * n * math.exp(-min(gain, 700.0)))


def fit_free_oscillation(
    values: ArrayLike,
    sample_rate: float,
    *,
    start: tuple[float, float] | None = None,
) -> FreeOscillationFit:
    """Fit eq. 27 to samples of free vibration.

    Args:
        values: Shape (n_samples,), any unit; contact must have ended before the first.
        sample_rate: Hz.
        start: Damped frequency in Hz and decay rate in 1/s to begin from; found from the
            record's spectrum where not given.

    Raises:
        InputError: values that are not a finite vector, or a rate that is not positive.
        EstimationError: too few samples or periods, no oscillation above the noise.
    """
    y, mean = centred(values, sample_rate)
    solution = solve(y, None if start is None else in_span_units(start, y.size, sample_rate))
    return describe(solution, mean, sample_rate)


def centred(values: ArrayLike, sample_rate: float) -> tuple[Array, float]:
    """Checked samples as float64 with their mean removed, and the mean."""
    y = np.array(values, dtype=np.float64)
    if y.ndim != 1:
        raise InputError(f'samples of a free oscillation have shape {y.shape}; one row is needed')
    if not (math.isfinite(sample_rate) and sample_rate > 0):
        raise InputError(f'the sample rate is {sample_rate!r} Hz; it must be positive')
    if y.size < FEWEST_SAMPLES:
        raise EstimationError(
            f'the span has {y.size} samples; a free oscillation needs {FEWEST_SAMPLES}'
        )
    mean = float(y.mean())
    if not math.isfinite(mean):
        raise InputError('the span holds samples that are not finite')
    y -= mean
    return y, mean


def in_span_units(start: tuple[float, float], n: int, sample_rate: float) -> Array:
    """(damped frequency, decay rate) as one row (s, w)."""
    frequency, decay = start
    if not (0.0 < frequency < 0.5 * sample_rate and math.isfinite(decay)):
        raise InputError(f'start {start!r} is not a frequency below {0.5 * sample_rate} Hz')
    return np.array([[decay * n / sample_rate, TWO_PI * frequency * n / sample_rate]])


def starting_values(y: Array) -> Array:
    """Candidates (s, w), shape (n, 2): the strongest line in ever shorter first parts.

    A part about as long as the decay is close to the matched filter (2 dB at worst).
    """
    lengths = [y.size]
    while lengths[-1] >= 4 * FEWEST_SAMPLES:
        lengths.append(lengths[-1] // 4)
    if y.size > BATCHED:
        spectra = [np.fft.rfft(y[:n], 2 << (n - 1).bit_length()) for n in lengths]
        return np.array(
            [kernels.strongest_line(y, n, x) for n, x in zip(lengths, spectra, strict=True)]
        )
    # One call for all: for a short record its overhead outweighs the transform.
    parts = np.zeros((len(lengths), 1 << (y.size - 1).bit_length()))
    for row, n in enumerate(lengths):
        parts[row, :n] = y[:n]
    lines: Array = _strongest_lines(y, np.array(lengths), np.fft.rfft(parts))
    return lines


@njit(cache=True)  # type: ignore[untyped-decorator]
def _strongest_lines(y: Array, lengths: NDArray[np.int64], spectra: kernels.Spectrum) -> Array:
    out = np.empty((lengths.size, 2))
    for k in range(lengths.size):
        out[k, 0], out[k, 1] = kernels.strongest_line(y, lengths[k], spectra[k])
    return out


@njit(cache=True)  # type: ignore[untyped-decorator]
def _solve(
    y: Array, starts: Array
) -> tuple[float, float, Array, Array, Array, float, float, Array, float, float, int]:
    """Gauss-Newton from the best start, the next best where it fails; then the residual."""
    n = y.size
    c, q, r = np.empty(n), np.empty(n), np.empty(n)
    g, h = np.zeros((5, 5)), np.zeros(5)
    linear, gradient, hessian = np.zeros(3), np.zeros(2), np.zeros((2, 2))
    energy = 0.0
    for i in range(n):
        energy += y[i] * y[i]
    explained = np.full(starts.shape[0], -1.0)
    for k in range(starts.shape[0]):
        kernels.moments(y, starts[k, 0], starts[k, 1], c, q, g, h)
        if kernels.project(g, h, linear, gradient, hessian):
            explained[k] = h[0] * linear[0] + h[1] * linear[1] + h[2] * linear[2]
    s, w, iterations = 0.0, 0.0, -1
    for _ in range(starts.shape[0]):
        k = int(np.argmax(explained))
        explained[k] = -1.0
        s, w, iterations = kernels.gauss_newton(y, starts[k, 0], starts[k, 1], c, q, g, h, linear)
        if iterations > 0:
            break
    rss = kernels.residuals(y, s, w, linear, c, q, r)
    bend = kernels.curvature(r, linear, c, q)
    correlations = kernels.autocorrelations(r, LAGS)
    whiteness = 0.0
    for k in range(LAGS):
        whiteness += n * (n + 2.0) * correlations[k] ** 2 / (n - k - 1)
    return s, w, linear, g, bend, energy, rss, r, correlations[0], whiteness, iterations


def solve(y: Array, starts: Array | None = None) -> Solution:
    """The fit of a centred record in span units; raises EstimationError where there is none."""
    if starts is None:
        starts = starting_values(y)
    solution = Solution(*_solve(y, starts))
    if solution.energy == 0.0:
        raise EstimationError('the span does not vary; nothing oscillates')
    if not math.isfinite(solution.rss):
        raise InputError('the span holds samples that are not finite')
    if solution.iterations < 0:
        raise EstimationError(
            f'no damped oscillation fits the span ({-solution.iterations} iterations tried)'
        )
    if solution.w < TWO_PI * FEWEST_PERIODS:
        raise EstimationError(
            f'the span holds {solution.w / TWO_PI:.2f} periods; '
            f'{FEWEST_PERIODS:g} or more are needed, or the response is overdamped'
        )
    return solution


@njit(cache=True)  # type: ignore[untyped-decorator]
def _uncertainties(
    g: Array,
    bend: Array,
    linear: Array,
    sigma: float,
    omega: float,
    duration: float,
    variance: float,
) -> Array:
    """Covariance (7, 7) in the order of FreeOscillationFit.covariance, then fd and decay.

    H^-1 J'J H^-1 with H the objective's own Hessian at the minimum: it tends to the usual
    (J'J)^-1 as the noise falls, and covers as stated down to 10 dB, where that one does not.
    """
    a, b = linear[0], linear[1]
    wn = math.hypot(sigma, omega)
    amplitude = math.hypot(a, b)
    # From (s, w, a, b, offset) to what people name.
    jacobian = np.zeros((7, PARAMETERS))
    jacobian[0, 0], jacobian[0, 1] = sigma / wn / TWO_PI, omega / wn / TWO_PI
    jacobian[1, 0], jacobian[1, 1] = omega**2 / wn**3, -sigma * omega / wn**3
    jacobian[5, 1] = 1.0 / TWO_PI
    jacobian[6, 0] = 1.0
    jacobian[:, :2] /= duration
    jacobian[2, 2], jacobian[2, 3] = a / amplitude, b / amplitude
    jacobian[3, 2], jacobian[3, 3] = b / amplitude**2, -a / amplitude**2
    jacobian[4, 4] = 1.0
    matrix = kernels.information(g, linear)
    observed = matrix - bend
    scale = np.sqrt(np.diag(matrix))
    if not scale.min() > 0.0:
        return np.full((7, 7), np.nan)
    for i in range(PARAMETERS):
        for k in range(PARAMETERS):
            matrix[i, k] /= scale[i] * scale[k]
            observed[i, k] /= scale[i] * scale[k]
    inverse = np.empty((PARAMETERS, PARAMETERS))
    if kernels.invert(observed, inverse):
        inverse = _sandwich(inverse, matrix)
    elif not kernels.invert(matrix, inverse):
        return np.full((7, 7), np.nan)
    for i in range(PARAMETERS):
        for k in range(PARAMETERS):
            inverse[i, k] *= variance / (scale[i] * scale[k])
    physical: Array = _sandwich(jacobian, inverse)
    return physical


@njit(cache=True)  # type: ignore[untyped-decorator]
def _sandwich(outer: Array, inner: Array) -> Array:
    """Outer times inner times outer transposed: quicker than a library for so small ones."""
    rows, size = outer.shape
    half = np.zeros((rows, size))
    out = np.zeros((rows, rows))
    for i in range(rows):
        for k in range(size):
            for m in range(size):
                half[i, k] += outer[i, m] * inner[m, k]
    for i in range(rows):
        for k in range(rows):
            for m in range(size):
                out[i, k] += half[i, m] * outer[k, m]
    return out


def describe(solution: Solution, mean: float, sample_rate: float) -> FreeOscillationFit:
    """The solution in physical units with its uncertainties."""
    n = solution.residual.size
    variance = solution.rss / (n - PARAMETERS)
    whiteness = solution.whiteness
    white = solution.white
    inflation = 1.0 if white else _inflation(solution, n)
    a, b, offset = solution.linear.tolist()
    duration = n / sample_rate
    sigma, omega = solution.s / duration, solution.w / duration
    wn = math.hypot(sigma, omega)
    covariance = _uncertainties(
        solution.products,
        solution.curvature,
        solution.linear,
        sigma,
        omega,
        duration,
        variance * inflation**2,
    )
    std = [math.sqrt(max(v, 0.0)) for v in covariance.diagonal().tolist()]
    return FreeOscillationFit(
        natural_frequency=Estimate(wn / TWO_PI, std[0]),
        damped_frequency=Estimate(omega / TWO_PI, std[5]),
        damping_ratio=Estimate(sigma / wn, std[1]),
        decay_rate=Estimate(sigma, std[6]),
        amplitude=Estimate(math.hypot(a, b), std[2]),
        phase=Estimate(math.atan2(-b, a), std[3]),
        offset=Estimate(offset + mean, std[4]),
        covariance=covariance[:PARAMETERS, :PARAMETERS],
        r_squared=1.0 - solution.rss / solution.energy,
        rmse=math.sqrt(solution.rss / n),
        noise_std=math.sqrt(variance),
        autocorrelation=solution.autocorrelation,
        whiteness=whiteness,
        white=white,
        inflation=inflation,
        significance=solution.significance(inflation),
        n_samples=n,
        sample_rate=sample_rate,
        iterations=solution.iterations,
    )


def _inflation(solution: Solution, n: int) -> float:
    """Root of the residual's power at the oscillation over what white noise would have.

    Once for the whole span, as a stationary noise shows itself best, and once weighted by the
    envelope, as the estimate weighs it and a wrong model shows itself; the larger counts. The
    spectrum is smoothed over half the oscillation's frequency (a lag window of two periods).
    """
    envelope = np.exp(-solution.s * np.arange(n) / n)
    span = max(2, min(n // 2, math.ceil(2.0 * TWO_PI * n / solution.w)))
    lags = np.arange(1, span)
    window = 2.0 * (1.0 - lags / span) * np.cos(solution.w * lags / n)
    variance = solution.rss / (n - PARAMETERS)
    ratio = 1.0
    for weight in (np.ones(n), envelope):
        spectrum = np.fft.rfft(solution.residual * weight, 1 << (2 * n - 1).bit_length())
        covariance = np.fft.irfft(spectrum.real**2 + spectrum.imag**2)[:span]
        power = float(covariance[0] + np.sum(window * covariance[1:]))
        ratio = max(ratio, power / (variance * float(np.sum(weight**2))))
    return math.sqrt(ratio)
