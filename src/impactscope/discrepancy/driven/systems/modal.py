"""Further modes: the linear explanation of what one mode leaves.

A sum of modes in the time domain. Each is a recursive filter with the poles of a damped mode;
its two weights on the input are linear unknowns (the hold between samples is absorbed in them),
so that only frequencies and damping ratios are searched: variable projection (Golub and
Pereyra, Inverse Problems 19, 2003). Modes are added where the residual's response to the input
is strongest, as long as recordings held out are predicted better.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.optimize import least_squares

from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.fits.weighted_residuals import channel_scales
from impactscope.discrepancy.driven.model_selection.model_comparison import Judge
from impactscope.discrepancy.driven.models.model import Segment

__all__ = ['STEPS', 'ModalProblem', 'Modes', 'further_modes', 'minimum', 'poles_apart']

Array = NDArray[np.float64]

MOST_MODES = 10
RIDGE = 1e-10
NARROWEST, WIDEST = 1e-4, 0.9  # damping ratios
SAME = 0.003  # relative difference of two frequencies that are one
APART = 0.25  # the same, of two modes that a single bent resonance is not taken for
STEPS = (1e-5, 1e-3)  # of the logarithms of a frequency and of a damping ratio, for slopes


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """A fitted sum of modes."""

    fit: Fit
    frequencies: tuple[float, ...]  # Hz
    damping_ratios: tuple[float, ...]
    std: tuple[tuple[float, float], ...]  # of frequency and damping ratio
    stated: Fit | None = None  # as many modes as the campaign says, where these are several
    poles: Array | None = None  # of these, see :class:`ModalProblem`


def _columns(drive: Array, poles: Array, period: float) -> Array:
    """Input, and each mode's two responses to it, shape (n, 1 + 2 n_modes)."""
    columns = [drive]
    for omega, ratio in np.exp(poles.reshape(-1, 2)):
        ratio = min(ratio, WIDEST)
        decay = math.exp(-ratio * omega * period)
        turn = omega * math.sqrt(1.0 - ratio**2) * period
        denominator = [1.0, -2.0 * decay * math.cos(turn), decay**2]
        columns.append(signal.lfilter([1.0], denominator, drive))
        columns.append(np.concatenate([[0.0], columns[-1][:-1]]))
    return np.stack(columns, axis=1)


def minimum(
    left: Callable[[Array], Array],
    start: Array,
    steps: Array,
    bounds: tuple[Array, Array],
    evaluations: int,
    tolerance: float,
) -> tuple[Array, Array]:
    """Numbers of the least squares within bounds, shape (k,), and the Jacobian there, (n, k).

    ``tolerance``: relative fall of the sum of squares at which the search ends.
    """

    def jacobian(theta: Array) -> Array:
        base = left(theta)
        found = np.empty((base.size, theta.size))
        for j in range(theta.size):
            moved = theta.copy()
            moved[j] += steps[j]
            found[:, j] = (left(moved) - base) / steps[j]
        return found

    low, high = bounds
    made = least_squares(
        left,
        np.clip(start, low + 1e-9, high - 1e-9),
        jacobian,
        bounds=bounds,
        x_scale='jac',
        max_nfev=evaluations,
        ftol=tolerance,
        xtol=1e-7,
    )
    return made.x, made.jac


class ModalProblem:
    """Frequencies and damping ratios as unknowns; the rest is linear.

    ``poles``: logarithms of angular frequencies, rad/s, and of damping ratios, in turn,
    shape (2 n_modes,).
    """

    def __init__(self, parts: Sequence[Cut], segments: Sequence[Segment]) -> None:
        self.parts = parts
        self.segments = segments
        self.scales = channel_scales(segments)
        self.channels = sorted({s.channel for s in segments})
        self.fitted = [i for i, s in enumerate(segments) if not s.held_out]
        self.period = segments[0].period

    def drive(self, i: int) -> Array:
        """What drives the modes as a recording's channel shows them, shape (n,)."""
        drive = self.parts[i].drive
        assert drive is not None  # noqa: S101 - modes need an input
        return drive

    def columns(self, poles: Array, i: int) -> Array:
        """Input, and each mode's two responses to it, shape (n, 1 + 2 n_modes)."""
        return _columns(self.drive(i), poles, self.segments[i].period)

    def weights(self, poles: Array) -> dict[str, Array]:
        """Linear unknowns by channel: modes are shared, how they show is not."""
        found = {}
        for channel in self.channels:
            mine = [i for i in self.fitted if self.segments[i].channel == channel]
            a = np.concatenate([self.columns(poles, i) for i in mine])
            b = np.concatenate([self.segments[i].measured for i in mine])
            size = np.linalg.norm(a, axis=0)
            size[size == 0.0] = 1.0
            a = a / size
            gram = a.T @ a + RIDGE * np.eye(a.shape[1])
            found[channel] = np.linalg.solve(gram, a.T @ b) / size
        return found

    def residual(self, poles: Array) -> Array:
        """What is left of the fitted recordings, over the scales of their channels, (n,)."""
        weights = self.weights(poles)
        parts = [
            (
                self.segments[i].measured
                - self.columns(poles, i) @ weights[self.segments[i].channel]
            )
            / self.scales[self.segments[i].channel]
            for i in self.fitted
        ]
        return np.concatenate(parts)

    def refine(
        self, poles: Array, evaluations: int, near: float = math.inf
    ) -> tuple[Array, Array]:
        """Refined poles and the projected Jacobian; frequencies stay near, by their logarithm."""
        modes = poles.size // 2
        steps = np.tile(STEPS, modes)
        low, high = self.bounds(modes)
        low[::2] = np.maximum(low[::2], poles[::2] - near)
        high[::2] = np.minimum(high[::2], poles[::2] + near)
        return minimum(self.residual, poles, steps, (low, high), evaluations, 1e-4)

    def bounds(self, modes: int) -> tuple[Array, Array]:
        """Bounds of the poles of so many modes, shapes (2 modes,)."""
        slowest = 2.0 * math.pi * 0.5 / self._longest()
        low = np.tile([math.log(slowest), math.log(NARROWEST)], modes)
        high = np.tile([math.log(0.97 * math.pi / self.period), math.log(WIDEST)], modes)
        return low, high

    def _longest(self) -> float:
        return max(s.measured.size * s.period for s in self.segments)

    def peak(
        self, residuals: Sequence[Array], known: Array, same: float = SAME
    ) -> tuple[float, float]:
        """Where the residual answers the input most: logarithms of pole frequency and ratio.

        ``same``: relative difference from the frequencies of known poles that is left out.
        """
        length = max(self.segments[i].measured.size for i in self.fitted)
        lines = length // 2 + 1
        cross, power = np.zeros(lines, np.complex128), np.zeros(lines)
        for i in self.fitted:
            drive = self.parts[i].drive
            assert drive is not None  # noqa: S101
            u = np.fft.rfft(drive, length)
            e = np.fft.rfft(residuals[i], length) / self.scales[self.segments[i].channel]
            cross = cross + e * np.conj(u)
            power = power + np.abs(u) ** 2
        frequency = np.fft.rfftfreq(length, self.period)
        explained = np.abs(cross) ** 2 / (power + 1e-12 * np.max(power))
        explained[: max(2, length // 2000)] = 0.0
        explained[frequency > 0.45 / self.period] = 0.0
        width = max(3, length // 4000)
        smooth = np.convolve(explained, np.ones(width) / width, mode='same')
        for omega, _ in np.exp(known.reshape(-1, 2)):
            smooth[np.abs(frequency * 2.0 * math.pi - omega) < same * omega] = 0.0
        best = int(np.argmax(smooth))
        return math.log(2.0 * math.pi * max(frequency[best], frequency[1])), math.log(0.01)

    def fit(self, poles: Array, jacobian: Array, first: int) -> tuple[Fit, Array]:
        """The fit of all recordings with these poles, and their standard deviations."""
        weights = self.weights(poles)
        residuals = tuple(
            s.measured - self.columns(poles, i) @ weights[s.channel]
            for i, s in enumerate(self.segments)
        )
        modes = poles.size // 2
        fitted = np.concatenate(
            [residuals[i] / self.scales[self.segments[i].channel] for i in self.fitted]
        )
        gram = np.linalg.pinv(jacobian.T @ jacobian)
        std = np.sqrt(np.maximum(np.diag(gram), 0.0) * float(fitted @ fitted) / fitted.size)
        added = 4 * (modes - first) + 1
        values = {f'mode_{k + 1}.frequency': v for k, v in enumerate(np.exp(poles[::2]))}
        made = Fit((), values, {}, (), residuals, max(added, 1), f'{modes} modes')
        return made, std


def poles_apart(parts: Sequence[Cut], segments: Sequence[Segment], modes: int) -> Array:
    """Poles of so many modes, none near another, see :class:`ModalProblem`.

    A resonance that something bends is fitted best by two modes side by side.
    """
    problem = ModalProblem(parts, segments)
    poles = np.zeros(0)
    left = [s.measured for s in segments]
    for _ in range(modes):
        poles = np.concatenate([poles, problem.peak(left, poles, APART)])
        poles, jacobian = problem.refine(poles, 12, 0.5 * APART)
        left = list(problem.fit(poles, jacobian, modes)[0].residuals)
    return poles


def further_modes(
    parts: Sequence[Cut], segments: Sequence[Segment], baseline: Fit, modes: int, judge: Judge
) -> Modes | None:
    """The linear system with as many modes as recordings bear out; None where none helps.

    ``modes``: how many the baseline is said to have; if several, the fit with these alone is
    given besides, and as the answer where no further one helps.
    """
    problem = ModalProblem(parts, segments)
    omega = math.sqrt(
        abs(baseline.values['stiffness']) / max(abs(baseline.values['mass']), 1e-300)
    )
    ratio = baseline.values['damping'] / (2.0 * baseline.values['mass'] * max(omega, 1e-300))
    poles = np.log([omega, min(max(ratio, 2 * NARROWEST), 0.5)])
    best: tuple[Fit, Array, Array] | None = None
    previous, idle = baseline, 0
    stated: Fit | None = None
    known: Array | None = None
    while poles.size // 2 <= max(MOST_MODES, modes + 2) and idle < 2:
        poles, jacobian = problem.refine(poles, 12)
        made, std = problem.fit(poles, jacobian, modes)
        if 1 < poles.size // 2 <= modes or poles.size // 2 < modes:
            best, previous, stated = (made, poles.copy(), std), made, made
            known = poles.copy()
        elif judge.better(previous, made):
            best, previous, idle = (made, poles.copy(), std), made, 0
        else:
            idle += 1
        poles = np.concatenate([poles, problem.peak(made.residuals, poles)])
    if best is None or (best[1].size // 2 <= modes and stated is None):
        return None
    made, poles, std = best
    order = np.argsort(poles[::2])
    return Modes(
        made,
        tuple(float(np.exp(poles[2 * k]) / (2.0 * math.pi)) for k in order),
        tuple(float(np.exp(poles[2 * k + 1])) for k in order),
        tuple(
            (
                float(std[2 * k] * np.exp(poles[2 * k]) / (2.0 * math.pi)),
                float(std[2 * k + 1] * np.exp(poles[2 * k + 1])),
            )
            for k in order
        ),
        stated,
        known,
    )
