"""Relaxation: a spring and a dashpot in series, beside the others, on a known course.

The branch's force follows F' = k v - F / t_r, which is solved exactly for a course between samples
of the third order in the speed. Where a recording begins in motion, what the branch holds of the
time before fades with t_r.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.models.measuring_chain import begins_in_motion
from impactscope.discrepancy.driven.models.mechanical_effects import Sizes
from impactscope.discrepancy.driven.models.terms import Number, Term

__all__ = ['NAME', 'TIME', 'branch_force', 'relaxation']

Array = NDArray[np.float64]

NAME = 'rate_dependent_damper'
TIME = 'relaxation_time'
SHORTEST = 1.0  # samples; what relaxes faster is viscous
FORGOTTEN = 40.0  # relaxation times
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


def relaxation(
    sizes: Sizes,
    stiffness: Sequence[float],
    times: Sequence[float],
    period: float,
    longest: float,
    moving: int,
) -> Term:
    """The candidate.

    Args:
        sizes: of the recordings.
        stiffness: of the branch, to set out from.
        times: of relaxation, s, to set out from.
        period: s between samples.
        longest: recording, s; what relaxes slower is a spring.
        moving: recordings that are fitted and begin in motion.
    """
    shortest = SHORTEST * period
    inside = tuple(t for t in times if shortest < t < longest) or (0.1 * longest,)
    return Term(
        NAME,
        'damper',
        'The device relaxes: a further spring and dashpot in series act in it, so that stiffness '
        'and damping depend on the frequency.',
        "F' = k_b v - F / t_r, t_r = c_b / k_b",
        'Maxwell (1867); standard linear solid',
        'a step that is held: the force falls off after it; sines of several frequencies',
        (
            Number(
                'stiffness',
                f'{sizes.force_unit}/{sizes.position_unit}',
                tuple(stiffness),
                stiffness[0],
                0.0,
            ),
            Number(TIME, 's', inside, 0.1 * inside[0], shortest, longest),
        ),
        amounts=('stiffness',),
        own=moving,
    )


@functools.lru_cache(maxsize=64)
def _steps(ratio: float) -> tuple[float, tuple[float, ...]]:
    """What is kept over a sample, and weights of speed and acceleration at its ends.

    ``ratio``: of a sample to the relaxation time. Weights are over a sample's length; those of the
    accelerations over its square.
    """
    s = 0.5 * (_NODES + 1.0)
    fading = 0.5 * _WEIGHTS * np.exp(-(1.0 - s) * ratio)
    shapes = (
        (1.0 + 2.0 * s) * (1.0 - s) ** 2,
        s**2 * (3.0 - 2.0 * s),
        s * (1.0 - s) ** 2,
        s**2 * (s - 1.0),
    )
    return math.exp(-ratio), tuple(float(fading @ shape) for shape in shapes)


def branch_force(
    terms: Sequence[Term],
    values: Mapping[str, float],
    motion: Array,
    rest: Array,
    period: float,
) -> Array | None:
    """Force of the branch, shape (n,); None where no term has one.

    Args:
        terms: of the model.
        values: numbers by key.
        motion: position, speed and acceleration, shape (3, n).
        rest: what the other forces leave of the measured one, shape (n,), from which is taken what
            the branch holds of the time before.
        period: s between samples.
    """
    term = next((t for t in terms if t.name == NAME), None)
    if term is None:
        return None
    stiffness, time = values[f'{term.label}.stiffness'], values[f'{term.label}.{TIME}']
    time = max(time, SHORTEST * period)
    keep, (v0, v1, a0, a1) = _steps(period / time)
    x, v, a = motion
    fed = np.zeros(v.size)
    fed[1:] = period * (v0 * v[:-1] + v1 * v[1:] + period * (a0 * a[:-1] + a1 * a[1:]))
    force = stiffness * signal.lfilter([1.0], [1.0, -keep], fed)
    if not begins_in_motion(x):
        return np.asarray(force)
    most = min(v.size, 1 + int(FORGOTTEN * time / period))
    fades = keep ** np.arange(most)
    left = rest[:most] - force[:most]
    force[:most] += float(fades @ left) / float(fades @ fades) * fades
    return np.asarray(force)
