"""Ends of a force under a prescribed motion, where they show a filter that runs both ways.

Where a recording ends in motion its course is told from one side only, so its last samples do not
count. A filter that was run forwards and backwards goes wrong in just these, and may hardly be
seen anywhere else: far below its cut-off the force passes it whole.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal
from scipy.interpolate import CubicSpline

from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.measuring_chain import before_sampling, filter_of
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import Term
from impactscope.discrepancy.driven.systems.prescribed_motion_noise import (
    PrescribedMotionNoise,
    counting_of,
    runs,
)
from impactscope.physics.mechanisms.low_pass_filter import forwards_and_backwards, low_pass

__all__ = ['ends_of_a_filter', 'shows_at_ends']

Array = NDArray[np.float64]

WORSE = 2.0  # times what white noise has it: how far a course may be off at an end
ODD, EXPLAINED = 6.0, 4.0  # times that: what no course makes, and what a filter may leave
# of what stands out, that it may leave as well, and ends that stand out; set, not measured
MOST, FEWEST = 0.25, 2
LOWEST, HIGHEST = 0.02, 0.45  # sampling rates: cut-offs that are tried
CUT_OFFS = 25
FINE = 8  # times the sampling rate, at which a filter runs
MEMORY = 1.0  # times the order, periods of a cut-off in which a filter forgets
# beyond the ends the signal goes on as if turned about them, for as long as a filter remembers or
# for a few samples alone; or it stays; or either run of the filter sets out from its first value
CONTINUED = ('turned', 'few turned', 'held', 'not')


class _End(NamedTuple):
    """An end in motion: the force there as it would be unfiltered, the end last."""

    force: Array  # some samples up to the end
    left: Array  # what the last of them leave of what was measured, over the deviation there
    deviation: Array  # by the noise, or as large as what is left elsewhere
    rate: float

    def farthest(self, order: int, cut_off: float, continued: str) -> float:
        """Largest that such a filter would leave in the last samples, over the deviation."""
        lost = (self._filtered(order, cut_off, continued) - self.force)[-self.left.size :]
        return float(np.max(np.abs(self.left - lost / self.deviation)))

    def _filtered(self, order: int, cut_off: float, continued: str) -> Array:
        if continued == 'few turned':  # the rule of the usual libraries, at the rate of recording
            return forwards_and_backwards(low_pass(order, cut_off, self.rate), self.force)
        fine = np.linspace(0.0, self.force.size - 1.0, FINE * (self.force.size - 1) + 1)
        course = CubicSpline(np.arange(self.force.size), self.force)(fine)
        low = low_pass(order, cut_off, FINE * self.rate)
        pad = min(math.ceil(MEMORY * order * FINE * self.rate / cut_off), fine.size - 1)
        kind = {'turned': 'odd', 'held': 'constant'}.get(continued)
        passed = signal.sosfiltfilt(low, course, padtype=kind, padlen=pad if kind else 0)
        return np.asarray(passed[::FINE])


def ends_of_a_filter(model: Model, segments: Sequence[Segment], made: Fit) -> list[Segment] | None:
    """The segments with their ends in motion counted, where a filter both ways explains these.

    None where not at least two ends stand out, or no such filter explains most of that. It is one
    whose cut-off alone is free: what the signal does beyond its ends is told by the rules that are
    usual, for a filter with free ends would explain any.

    Args:
        model: of the device, with what may be missing.
        segments: whitened by :class:`PrescribedMotionNoise`.
        made: a fit of it, whose residuals tell whether ends stand out.
    """
    ends = [
        end
        for s, residual in zip(segments, made.residuals, strict=True)
        if not s.held_out
        for end in _ends(s, residual)
    ]
    far = sorted(float(np.max(np.abs(e.left))) for e in ends)
    if len(far) < FEWEST or far[-1] < ODD or far[-FEWEST] < EXPLAINED:
        return None
    most = max(EXPLAINED, MOST * far[-1])
    able = [t for t in model.terms if all(t.stands_with(o) for o in made.terms)]
    orders = {filter_of(t)[0] for t in able if _runs_both_ways(t)}
    if not any(_least(ends, order, rule) < most for order in sorted(orders) for rule in CONTINUED):
        return None
    return [dataclasses.replace(s, whitener=_counting(_noise(s))) for s in segments]


def _least(ends: Sequence[_End], order: int, continued: str) -> float:
    """What the filter of the best cut-off leaves in the farthest of the ends."""

    def left(cut_off: float) -> float:
        return max(e.farthest(order, cut_off, continued) for e in ends)

    tried = np.geomspace(LOWEST, HIGHEST, CUT_OFFS) * min(e.rate for e in ends)
    best = int(np.argmin([left(c) for c in tried.tolist()]))
    around = float(tried[max(best - 1, 0)]), float(tried[min(best + 1, CUT_OFFS - 1)])
    found = optimize.minimize_scalar(left, bounds=around, method='bounded')
    return float(found.fun)


def _ends(segment: Segment, residual: Array) -> Iterator[_End]:
    """The ends of a segment that do not count though the motion goes on there."""
    noise = _noise(segment)
    deviation = np.sqrt(noise.force**2 + WORSE**2 * (np.square(noise.device) @ noise.ends))
    # where much is missing everywhere, ends are nothing of their own
    elsewhere = float(np.sqrt(np.mean(counting_of(segment, residual) ** 2)))
    deviation *= max(1.0, elsewhere / noise.force)
    force = segment.measured - residual
    near = noise.reach + math.ceil(1.0 / LOWEST)
    if force.size < near:  # too short to filter
        return
    for end in _in_motion(noise):
        way = slice(None, None, 1 if end.stop == force.size else -1)
        yield _End(
            force[way][-near:],
            (residual / deviation)[end][way],
            deviation[end][way],
            1.0 / segment.period,
        )


def shows_at_ends(term: Term, segments: Sequence[Segment]) -> bool:
    """Whether an effect is such a filter, and ends count since one explains them."""
    return _runs_both_ways(term) and any(_noise(s).reach == 0 for s in segments)


def _runs_both_ways(term: Term) -> bool:
    return term.name == 'low_pass_filter' and filter_of(term)[1] and not before_sampling(term)


def _noise(segment: Segment) -> PrescribedMotionNoise:
    assert isinstance(segment.whitener, PrescribedMotionNoise)  # noqa: S101 - as all of a case
    return segment.whitener


def _counting(noise: PrescribedMotionNoise) -> PrescribedMotionNoise:
    """The same with its ends in motion among the samples that count."""
    if noise.turns is None:
        return noise
    turns = noise.turns.copy()
    for end in _in_motion(noise):
        turns[end] = False
    return dataclasses.replace(noise, turns=turns, reach=0)


def _in_motion(noise: PrescribedMotionNoise) -> Iterator[slice]:
    """The ends that do not count only because they are ends; at others the motion rests."""
    if noise.turns is None or noise.reach == 0:
        return
    size = noise.turns.size
    for first, last in runs(noise.turns):
        if last - first == noise.reach and (first == 0 or last == size):
            yield slice(first, last)
