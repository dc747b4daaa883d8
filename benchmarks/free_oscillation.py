"""Efficiency, coverage and speed of the free-oscillation fit, beside curve_fit and lmfit.

Signal: eq. 27 with 32.3 Hz, damping ratio 0.07, first peak of 60 N, 1 s at 1 and 5 kHz, white
noise; SNR is the first peak over the noise's RMS. ``curve_fit`` fits eq. 26: for efficiency from
where the paper's fit may have begun (largest value, the FFT's peak, light damping, mean), for
speed from values near the truth. A fit that lands far from the truth counts as a failure.
"""

from __future__ import annotations

import argparse
import math
import platform
import time
import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeWarning, curve_fit
from scipy.stats import binomtest

from impactscope.errors import EstimationError
from impactscope.estimate.free_oscillation import fit_free_oscillation
from impactscope.estimate.free_vibration_span import choose_span

Array = NDArray[np.float64]

FREQUENCY, DAMPING, PEAK, PHASE, OFFSET = 32.3, 0.07, 60.0, -0.07, 0.5
WN = 2 * math.pi * FREQUENCY
WD = WN * math.sqrt(1 - DAMPING**2)
DECAY = DAMPING * WN


def model(t: Array, frequency: float, damping: float, a: float, phase: float, b: float) -> Array:
    """Eq. 27."""
    wn = 2 * math.pi * frequency
    wd = wn * math.sqrt(1 - damping**2)
    return a * np.exp(-damping * wn * t) * np.cos(wd * t + phase) + b


def eq26(t: Array, b1: float, b2: float, b3: float, b4: float, b5: float) -> Array:
    """Eq. 26."""
    return b1 * np.exp(-b2 * t) * np.cos(2 * np.pi / b3 * t + b4) + b5


def bound(t: Array, noise: float) -> Array:
    """Cramér-Rao bound of (frequency, damping ratio), by central differences."""
    p = np.array([FREQUENCY, DAMPING, PEAK, PHASE, OFFSET])
    columns = []
    for k, step in enumerate((1e-5, 1e-7, 1e-4, 1e-6, 1e-4)):
        h = np.zeros(5)
        h[k] = step
        columns.append((model(t, *(p + h)) - model(t, *(p - h))) / (2 * step))
    j = np.array(columns).T
    return noise * np.sqrt(np.diag(np.linalg.inv(j.T @ j)))[:2]


def paper_start(t: Array, y: Array) -> list[float]:
    """Where a person would begin: largest value, peak of the FFT, a light damping, the mean."""
    b5 = float(np.mean(y))
    spectrum = np.abs(np.fft.rfft(y - b5))
    frequency = max(int(np.argmax(spectrum)), 1) / (t.size * (t[1] - t[0]))
    return [float(np.max(np.abs(y - b5))), 0.05 * 2 * math.pi * frequency, 1 / frequency, 0.0, b5]


def fit_curve(t: Array, y: Array, start: list[float] | None) -> tuple[float, float] | None:
    """(frequency, damping ratio) by curve_fit; None where it fails or lands elsewhere."""
    try:
        p, _ = curve_fit(eq26, t, y, p0=start)
    except RuntimeError:
        return None
    wd = 2 * math.pi / abs(p[2])
    wn = math.hypot(wd, p[1])
    frequency, damping = wn / (2 * math.pi), p[1] / wn
    if abs(frequency - FREQUENCY) > 0.2 * FREQUENCY or abs(damping - DAMPING) > DAMPING:
        return None
    return frequency, damping


def interval(hits: int, trials: int) -> str:
    """Exact 95 % binomial interval, in %."""
    found = binomtest(hits, trials).proportion_ci(0.95)
    return f'{100 * hits / trials:5.1f} [{100 * found.low:.1f}, {100 * found.high:.1f}]'


def efficiency(rate: float, decibel: float, trials: int, rng: np.random.Generator) -> None:
    """One row for each of frequency and damping ratio."""
    t = np.arange(int(rate)) / rate
    noise = PEAK / 10 ** (decibel / 20)
    clean = model(t, FREQUENCY, DAMPING, PEAK, PHASE, OFFSET)
    limit = bound(t, noise)
    truth = np.array([FREQUENCY, DAMPING])
    ours, spans, others = [], [], []
    failures = [0, 0, 0, 0]
    for k in range(trials):
        y = clean + noise * rng.normal(size=t.size)
        try:
            fit = fit_free_oscillation(y, rate)
            ours.append((*fit.natural_frequency, *fit.damping_ratio))
        except EstimationError:
            failures[0] += 1
        try:
            fit = choose_span(y, rate, earliest=0.0).fit
            spans.append((*fit.natural_frequency, *fit.damping_ratio))
        except EstimationError:
            failures[1] += 1
        if k % 4 == 0:  # the slow one, on every fourth record
            other = fit_curve(t, y, paper_start(t, y))
            if other is None:
                failures[2] += 1
            else:
                others.append(other)
        if k % 80 == 0:
            failures[3] += fit_curve(t, y, None) is None
    for column, name in enumerate(('frequency', 'damping')):
        print(f'{rate:6.0f} Hz {decibel:3.0f} dB  {name:9s}', end='')
        for rows in (np.array(ours), np.array(spans)):
            error = rows[:, 2 * column] - truth[column]
            hits = int(np.sum(np.abs(error) < 1.96 * rows[:, 2 * column + 1]))
            print(
                f' | {error.std() / limit[column]:5.3f} {error.mean() / error.std():+6.3f}'
                f' {interval(hits, len(rows))}',
                end='',
            )
        error = np.array(others).reshape(-1, 2)[:, column] - truth[column]
        print(f' | {error.std() / limit[column]:5.3f} {error.mean() / error.std():+6.3f}', end='')
        lost = f'{failures[0]}/{trials} {failures[1]}/{trials} {failures[2]}/{-(-trials // 4)}'
        lost += f' {failures[3]}/{-(-trials // 80)}'
        print(f' | {lost}')


def median_time(function: Callable[[], object], repeats: int) -> tuple[float, float, float]:
    """Median and quartiles of the time of one call, in s."""
    function()
    taken = np.empty(repeats)
    for k in range(repeats):
        begin = time.perf_counter()
        function()
        taken[k] = time.perf_counter() - begin
    low, middle, high = np.percentile(taken, [25, 50, 75])
    return middle, low, high


def speed(repeats: int, rng: np.random.Generator) -> None:
    """One blow of 1 s at 1 kHz, all in the same run, one after the other in turn."""
    t = np.arange(1000) / 1000
    clean = model(t, FREQUENCY, DAMPING, PEAK, PHASE, OFFSET)
    y = clean + 0.6 * rng.normal(size=1000)
    record = np.r_[np.linspace(0, PEAK, 100), y]
    good = [0.95 * PEAK, 0.9 * DECAY, 1.01 * 2 * math.pi / WD, 0.1, 0.0]
    runs: list[tuple[str, Callable[[], object], int]] = [
        ('span, start values and fit', lambda: choose_span(record, 1000, earliest=0.1), 10),
        ('start values and fit', lambda: fit_free_oscillation(y, 1000), 10),
        ('curve_fit from a good start', lambda: curve_fit(eq26, t, y, p0=good), 2),
    ]
    try:
        import lmfit
    except ImportError:
        print('lmfit is not installed: not compared')
    else:
        names = dict(zip(('b1', 'b2', 'b3', 'b4', 'b5'), good, strict=True))
        fitter = lmfit.Model(eq26)
        runs.append(('lmfit from the same start', lambda: fitter.fit(y, t=t, **names), 1))
    reference = 0.0
    for name, function, share in runs:
        middle, low, high = median_time(function, max(10, repeats * share // 10))
        reference = reference or middle
        print(
            f'{name:30s} {1e6 * middle:8.0f} us  [quartiles {1e6 * low:.0f}, {1e6 * high:.0f}]'
            f'  {middle / reference:6.1f} x'
        )


def main(argv: list[str] | None = None) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='few trials')
    parser.add_argument('--trials', type=int, default=4000)
    parser.add_argument('--seed', type=int, default=20261120)
    arguments = parser.parse_args(argv)
    trials = 200 if arguments.quick else arguments.trials
    rng = np.random.default_rng(arguments.seed)
    warnings.simplefilter('ignore', OptimizeWarning)
    warnings.simplefilter('ignore', RuntimeWarning)  # curve_fit's overflows on its way
    print(f'{platform.machine()}, Python {platform.python_version()}, NumPy {np.__version__}')
    begin = time.perf_counter()
    clean = model(np.arange(1000) / 1000, FREQUENCY, DAMPING, PEAK, PHASE, OFFSET)
    choose_span(clean + rng.normal(size=1000), 1000, earliest=0.0)
    print(f'first call, compiled code loaded or made: {time.perf_counter() - begin:.2f} s')
    print(f'{trials} trials each; std over Cramér-Rao bound, bias over std, coverage of the')
    print('nominal 95 % interval in % with its exact 95 % binomial interval')
    print(
        '                             | fit of the whole record           '
        '| span chosen, then fit             | curve_fit (eq. 26)'
        ' | failures: fit, span, curve_fit, curve_fit from its default start'
    )
    for rate in (1000.0, 5000.0):
        for decibel in (40.0, 30.0, 20.0, 10.0):
            efficiency(rate, decibel, trials, rng)
    print()
    speed(200 if arguments.quick else 2000, rng)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
