"""The measuring chain of a structure of several modes: filters, couplings, clocks of an output.

The structure is linear, and so are these: what stands behind a channel may as well stand before
the structure. So the input is filtered or shifted, channel by channel, and the modes are fitted to
that. A filter beside modes looks like a further mode that is hardly one, with four numbers for
one; it is told where it predicts no worse.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.model_comparison import Judge
from impactscope.discrepancy.driven.models.channel_effects import channel_terms
from impactscope.discrepancy.driven.models.measuring_chain import (
    HIGHEST_ORDER,
    before_sampling,
    delayed,
    filter_of,
    passed_on,
)
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.terms import Number, Term, key
from impactscope.discrepancy.driven.systems.modal import STEPS, ModalProblem, Modes, minimum
from impactscope.discrepancy.evidence import noise_std
from impactscope.discrepancy.processes import in_processes

__all__ = ['chain_of_modes']

Array = NDArray[np.float64]

FOLLOWED = 5  # candidates that are fitted, and a clock in any case
STARTS = 12  # cut-offs to start from
DELAYS = (0.2, 1.0, 3.0)  # samples, of a clock, to start from
EVALUATIONS = 30
STEP = 1e-4  # of the effect's number over its scale, for slopes
TOLERANCE = 1e-7
NEARLY_NOTHING = 1e-6  # Hz, of a corner
NOTHING = 1e-300  # power of a noise that is not there
LEFT = 0.1  # of what the stated modes leave beyond noise, that an effect may leave


class _Behind(ModalProblem):
    """Modes whose answer one channel shows behind an effect of its chain."""

    def __init__(self, parts: Sequence[Cut], segments: Sequence[Segment], term: Term) -> None:
        super().__init__(parts, segments)
        self.term = term
        self.values: Mapping[str, float] = {}

    def drive(self, i: int) -> Array:
        """The input as if the effect stood before the structure, shape (n,)."""
        given, segment = super().drive(i), self.segments[i]
        if segment.channel != self.term.channel:
            return given
        if self.term.name == 'clock_error':
            late = self.values[f'{self.term.label}.offset']
            return delayed(given, late, segment.period)
        chain = {self.term.name: self.term}
        return passed_on(
            given, chain, self.values, segment.period, segment.begin, moving=(False, False)
        )

    def left(self, theta: Array) -> Array:
        """What is left with poles and, last, the effect's number over its scale, shape (n,)."""
        self.values = self.named(theta)
        return self.residual(theta[:-1])

    def named(self, theta: Array) -> dict[str, float]:
        """The effect's number by its key."""
        (number,) = self.term.numbers
        value = float(theta[-1])
        return {key(self.term, number): value if _plain(number) else math.exp(value)}


def chain_of_modes(
    parts: Sequence[Cut], segments: Sequence[Segment], modes: Modes, judge: Judge
) -> tuple[Fit, tuple[Fit, ...]] | None:
    """What the chain of one output does, where that explains what further modes do, and rivals.

    None where nothing in the chain explains more than the stated modes, or further ones do better.
    """
    stated, poles = modes.stated, modes.poles
    if stated is None or poles is None:
        return None
    problems = [_Behind(parts, segments, term) for term in _candidates(parts, segments)]

    def tried(problem: _Behind) -> tuple[float, Array]:
        (number,) = problem.term.numbers
        starts = [np.append(poles, s if _plain(number) else math.log(s)) for s in number.starts]
        costs = [float(np.sum(problem.left(theta) ** 2)) for theta in starts]
        best = int(np.argmin(costs))
        return costs[best], starts[best]

    begun = sorted(
        zip(in_processes(tried, problems), problems, strict=True), key=lambda pair: pair[0][0]
    )
    clocks = [p for p in begun[FOLLOWED:] if p[1].term.name == 'clock_error']
    found = in_processes(
        lambda pair: _fitted(pair[1], pair[0][1], stated), [*begun[:FOLLOWED], *clocks]
    )
    believed = [
        made
        for made in found
        if judge.better(stated, made) and _explains(made, stated, parts, segments)
    ]
    if not believed:
        return None
    for made in (*found, modes.fit):
        judge.weights(made)
    believed.sort(key=lambda made: judge.criterion(made, stated))
    best = believed[0]
    further = modes.fit is not stated
    if further and judge.criterion(best, stated) > judge.criterion(modes.fit, stated):
        return None
    return best, tuple(f for f in found if f is not best)


def _explains(made: Fit, stated: Fit, parts: Sequence[Cut], segments: Sequence[Segment]) -> bool:
    """Whether an effect explains nearly all that is left beyond noise, fitted and held out.

    A structure of metal has errors of its own, of which a filter may explain a part as well.
    """
    beyond: dict[bool, list[float]] = {}
    rows = zip(parts, segments, stated.residuals, made.residuals, strict=True)
    for part, segment, before, after in rows:
        noise = part.noise if math.isfinite(part.noise) else noise_std(after)
        least = max(noise**2, NOTHING) * before.size
        sums = beyond.setdefault(segment.held_out, [0.0, 0.0])
        sums[0] += (float(before @ before) - least) / least
        sums[1] += (float(after @ after) - least) / least
    return all(after < LEFT * before for before, after in beyond.values())


def _candidates(parts: Sequence[Cut], segments: Sequence[Segment]) -> Iterator[Term]:
    channels = dict.fromkeys(s.channel for s in segments)
    for channel in channels:
        mine = [s for s in segments if s.channel == channel]
        unit, rate = mine[0].unit, 1.0 / mine[0].period
        longest = max(s.measured.size * s.period for s in mine)
        peak = max(float(np.max(np.abs(s.measured))) for s in mine)
        noise = next((p.noise for p in parts if p.channel == channel), math.nan)
        tag = channel if len(channels) > 1 else ''
        for term in channel_terms(channel, unit, rate, longest, noise, peak, tag=tag):
            if term.name == 'ac_coupling' and not term.own:
                yield term
            elif term.name == 'clock_error' and [n.name for n in term.numbers] == ['offset']:
                yield _from(term, tuple(sign * k / rate for k in DELAYS for sign in (1, -1)))
            elif term.name == 'low_pass_filter' and not term.own:
                if filter_of(term)[0] > HIGHEST_ORDER:
                    continue
                if before_sampling(term):  # exact at any cut-off
                    starts = tuple(float(f) for f in np.geomspace(0.01 * rate, 5.0 * rate, STARTS))
                    term = _from(term, starts, 0.1 / longest)
                yield term


def _from(term: Term, starts: tuple[float, ...], lower: float | None = None) -> Term:
    """The same with other values to start from, and down to another one."""
    (number,) = term.numbers
    least = number.lower if lower is None else lower
    return dataclasses.replace(
        term, numbers=(dataclasses.replace(number, starts=starts, lower=least),)
    )


def _plain(number: Number) -> bool:
    """Whether a number may be zero or less, and is not fitted by its logarithm."""
    return number.name == 'offset'


def _fitted(problem: _Behind, start: Array, stated: Fit) -> Fit:
    """The modes and an effect of the chain together."""
    (number,) = problem.term.numbers
    scale = np.ones(start.size)
    if _plain(number):
        scale[-1] = number.scale
    steps = np.append(np.tile(STEPS, start.size // 2), STEP)
    low, high = problem.bounds(start.size // 2)
    least = number.lower if _plain(number) else math.log(max(number.lower, NEARLY_NOTHING))
    most = number.upper if _plain(number) else math.log(number.upper)
    theta, slopes = minimum(
        lambda theta: problem.left(theta * scale),
        start / scale,
        steps,
        (np.append(low, least) / scale, np.append(high, most) / scale),
        EVALUATIONS,
        TOLERANCE,
    )
    left = problem.left(theta * scale)  # which also takes the numbers over
    values = problem.values
    modal, _ = problem.fit(theta[:-1], slopes[:, :-1], (theta.size - 1) // 2)
    gram = np.linalg.pinv(slopes.T @ slopes)
    noise = float(left @ left) / left.size
    error = math.sqrt(max(float(gram[-1, -1]) * noise, 0.0)) * scale[-1]
    (label,) = values
    return Fit(
        (problem.term,),
        {**modal.values, **values},
        {label: error if _plain(number) else error * values[label]},
        (),
        modal.residuals,
        stated.added + 1,
        problem.term.label,
    )
