"""Noise that is slower than was taken into account: what is left is whitened once more.

Levels that differ between recordings, a drift, a corner of hundredths of a hertz: such findings
and noise that goes with one over the frequency look alike. The noise also stands between the
lowest lines of each recording's spectrum, and goes on to higher ones: there its colour is read.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from impactscope.discrepancy.driven.case import Case
from impactscope.discrepancy.driven.fitting import FINE, Fit, fit
from impactscope.discrepancy.driven.model import Segment
from impactscope.discrepancy.driven.noise_judge import NoiseJudge, innovations
from impactscope.discrepancy.driven.spectral import (
    Colour,
    fitted_colour,
    levels,
    whitening,
)
from impactscope.discrepancy.driven.strangers import Verdict

__all__ = ['knowing_slow_noise', 'may_be_slow_noise']

Array = NDArray[np.float64]

LAWS = ('an offset that differs between recordings', 'a drift that differs between recordings')
SLOW = ('ac_coupling', 'offset', 'zero_drift')  # effects that slow noise may look like
SCATTERED = 1e-3  # chance from which levels differ
IN_LEVEL = 1.5
LONGEST = 1 << 17  # lines of a spectrum


def may_be_slow_noise(best: Fit, said: Verdict) -> bool:
    """Whether slow noise looks like anything that was found, or that is left."""
    found = any(t.name in SLOW for t in best.terms)
    return found or (said.left and said.strongest.law in LAWS)


def knowing_slow_noise(case: Case, made: Fit) -> Case | None:
    """The case with slow noise whitened that a fit leaves; None where it leaves none.

    Args:
        case: as it was searched.
        made: the best fit in it.
    """
    colour = _colour_left(case, made)
    if colour is not None and any(t.name in SLOW and t.own for t in made.terms):
        # with a number of its own for each recording an effect takes a part of the noise
        rest = tuple(t for t in made.terms if not (t.name in SLOW and t.own))
        without = fit(case.model, rest, case.segments, made.values, case.baseline.starts)
        colour = _colour_left(case, without)
    if colour is None:
        return None
    filters, louder = [], []
    for s in case.segments:
        grid = 1 << max(10, min(2 * s.measured.size, LONGEST).bit_length())
        frequency = np.linspace(0.0, 1.0, grid // 2 + 1)
        frequency[0] = 0.5 * frequency[1]
        power = colour.power(frequency, 2.0 / s.measured.size)
        filters.append(whitening(power))
        louder.append(math.sqrt(max(float(np.mean(power)), 1.0)))

    def slowly(these: Sequence[Segment]) -> list[Segment]:
        return [
            dataclasses.replace(s, slow=f, noise=times * s.noise)
            for s, f, times in zip(these, filters, louder, strict=True)
        ]

    def anew(found: Fit) -> tuple[Fit, list[Segment]]:
        assert case.settled is not None  # noqa: S101 - only then is this asked
        there, those = case.settled(found)
        return there, slowly(those)

    ready = slowly(case.segments)
    before = case.baseline
    # a level of its own in each recording is what slow noise has: an effect with one is not told
    able = tuple(t for t in case.model.terms if not (t.name in SLOW and t.own))
    model = dataclasses.replace(case.model, terms=able)  # type: ignore[type-var]
    return dataclasses.replace(
        case,
        model=model,
        segments=ready,
        baseline=fit(model, (), ready, before.values, before.starts, tolerance=FINE),
        judge=NoiseJudge(ready, case.judge.muffled),
        noise={name: std * max(louder) for name, std in case.noise.items()},
        settled=None if case.settled is None else anew,
    )


def _colour_left(case: Case, made: Fit) -> Colour | None:
    """The slow noise that a fit leaves, over what is whitened already; None where it is white."""
    settled, segments = case.settled(made) if case.settled is not None else (made, case.segments)
    pairs = zip(segments, settled.residuals, strict=True)
    left = [innovations(s, r) for s, r in pairs if not s.held_out]
    size = min(r.size for r in left)
    place, level = levels([r[:size] for r in left], slow=True)
    colour = fitted_colour(place, level, np.zeros(place.size), 0.5 * size)
    apart = _by_levels(left)
    if colour is not None and apart is not None:
        return Colour(colour.white, (*colour.parts, *apart.parts))
    return colour or apart


def _by_levels(left: Sequence[Array]) -> Colour | None:
    """One-over-f noise that makes the levels of recordings differ as they do; None where none.

    Of that noise about three halves of what an octave has, over log 2, stand in a recording's
    level. The variance is that of moments (DerSimonian and Laird, Control. Clin. Trials 7, 1986).
    """
    counts = np.array([r.size for r in left], dtype=np.float64)
    means = np.array([float(np.mean(r)) for r in left])
    middle = float(np.average(means, weights=counts))
    scatter, freedom = float(np.sum(counts * (means - middle) ** 2)), len(left) - 1
    if freedom < 1 or stats.chi2.sf(scatter, freedom) > SCATTERED:
        return None
    share = float(np.sum(counts) - np.sum(counts**2) / np.sum(counts))
    return Colour(1.0, (((scatter - freedom) / share / IN_LEVEL, 0.0),))
