"""An axis whose recorded force has noise of its own, which adds up in the motion.

A commanded force is taken for exact. Where it was measured all the same, its noise is summed up
twice by the mass, and no model leaves white residuals. How strong it is the recordings tell, by
the likelihood of what is left (Kailath, IEEE Trans. Autom. Control 13 (1968)); but it cannot be
stronger than what the recorded force shows from sample to sample.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.model_selection.chi_square import NoiseJudge
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.noise.coloured_noise import Colour
from impactscope.discrepancy.driven.noise.kalman_whitening import HammerForce, Whitener, whitener
from impactscope.discrepancy.driven.systems.case import Case
from impactscope.discrepancy.evidence import noise_std
from impactscope.discrepancy.parallel import in_parallel

__all__ = ['knowing_noise_of_the_force']

Array = NDArray[np.float64]

MOST = 1.3  # times what the recorded force shows from sample to sample
MATTERS = 25.0  # twice the logarithm of the likelihood, by which there is such noise
ROUNDS = 2
STEPS = 200  # evaluations of the likelihood
# of half the rate: corner of what the output's noise remembers, for some samples only
SLOWEST, FASTEST = 0.01, 0.6


def knowing_noise_of_the_force(case: Case, made: Fit, parts: Sequence[Cut]) -> Case | None:
    """The case with the force's noise whitened; None where there is none or it would be too much.

    Args:
        case: of an axis whose force was taken for exact.
        made: a fit of it that leaves the noise, and maybe more.
        parts: the recordings, in the order of the case's segments.
    """
    shown = [noise_std(p.drive) for p in parts if p.drive is not None]
    steady = all(s.derivative == 0 for s in case.segments)
    if len(shown) < len(parts) or not steady or not all(n > 0.0 for n in shown):
        return None
    ready = list(case.segments)
    before = case.baseline
    for _ in range(ROUNDS):
        noise, gain = _levels(ready, made)
        if gain < MATTERS or noise.force > MOST * min(shown):
            return None
        ready = [
            dataclasses.replace(
                s,
                noise=noise.output,
                weight=None,
                slow=None,
                whitener=_whitener(made, s, noise),
            )
            for s in ready
        ]
        made = fit(case.model, made.terms, ready, made.values, made.starts, tolerance=FINE)
    return dataclasses.replace(
        case,
        segments=ready,
        baseline=fit(case.model, (), ready, before.values, made.starts, tolerance=FINE),
        judge=NoiseJudge(ready),
        noise=dict.fromkeys(case.noise, noise.output),
    )


@dataclass(frozen=True, slots=True)
class _Noise:
    """Of the force, N, and of the output: in all, share that is not white and its corner."""

    force: float
    output: float
    share: float
    corner: float  # over half the rate

    @classmethod
    def of(cls, numbers: Array) -> _Noise:
        """From numbers without bounds, shape (4,)."""
        force, output, odds, corner = (float(v) for v in np.exp(np.clip(numbers, -80.0, 80.0)))
        return cls(force, output, odds / (1.0 + odds), min(max(corner, SLOWEST), FASTEST))


def _levels(segments: Sequence[Segment], made: Fit) -> tuple[_Noise, float]:
    """The likeliest noise, and by how much that of the force is needed.

    The latter as twice the logarithm of the likelihood. What a coarse encoder rounds off lasts
    for some samples: the output's noise has a part that forgets.
    """
    fitted = [i for i, s in enumerate(segments) if not s.held_out]

    def cost(numbers: Array) -> float:
        noise = _Noise.of(numbers)

        def of(i: int) -> float:
            filtering = _whitener(made, segments[i], noise)
            white = filtering(made.residuals[i])
            return float(white @ white) + filtering.logarithm()

        return sum(in_parallel(of, fitted))

    left = np.concatenate([made.residuals[i] for i in fitted])
    rough = float(np.sqrt(np.mean(left**2)))
    duration = max(segments[i].measured.size * segments[i].period for i in fitted)
    # noise of a force summed up twice: its variance grows with the cube of the time
    mass = made.values.get('mass', 1.0)
    begin = rough * mass / math.sqrt(segments[fitted[0]].period * duration**3 / 3.0)
    start = np.log([begin, min(segments[i].noise for i in fitted), 1.0, 0.05])
    least = [_least(cost, start), _least(cost, start - np.array([40.0, 0.0, 0.0, 0.0]))]
    return _Noise.of(least[0].x), float(least[1].fun - least[0].fun)


def _least(cost: Callable[[Array], float], start: Array) -> optimize.OptimizeResult:
    corners = np.vstack([start, start + np.eye(start.size)])
    options = {'initial_simplex': corners, 'maxfev': STEPS, 'xatol': 0.01, 'fatol': 0.1}
    return optimize.minimize(cost, start, method='Nelder-Mead', options=options)


def _whitener(made: Fit, segment: Segment, noise: _Noise) -> Whitener:
    size = segment.measured.size
    error = np.full(size, noise.force**2)
    plate = made.values.get('mass', 1.0), made.values['damping'], 0.0
    known = HammerForce(np.zeros(size), error, error, noise.force, ())
    colour = Colour(1.0 - noise.share, ((noise.share, noise.corner),))
    return whitener(plate, segment.derivative, segment.period, noise.output, known, size, colour)
