"""One thing that may be missing from a model of the bench: what it adds, where to start."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.evidence import price, shape_price
from impactscope.discrepancy.impact.candidates.hum_amplitude import HumAmplitude, hum_amplitude
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.models.bench_model import (
    PHASE,
    ActiveEffect,
    Free,
    ImpactModel,
)
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism

__all__ = ['Candidate', 'contains', 'kin_of', 'stronger']

Array = NDArray[np.float64]

_DECADES = 3  # over which a number may lie that has no bounds

_LIKE_A_NUMBER = {  # what acts as a wrong number of the baseline may
    'damper': ('rate_dependent_damper', 'stiffening_damper'),
    'pendulum': ('impact_speed_loss',),
    'gravity_load': ('external_push',),
}


@dataclass(frozen=True, slots=True)
class Candidate:
    """Something that may be missing: what it adds to a model and where to start.

    ``starts``: values from which the search sets out. ``amplitudes``: the numbers that make the
    effect vanish together when they reach ``absent``; ``along``: those that go with them while it
    grows or shrinks, so that its times stay.
    """

    label: str
    name: str
    subsystem: str
    free: tuple[Free, ...] = ()
    effects: tuple[ActiveEffect, ...] = ()
    constants: Mapping[str, float] = field(default_factory=dict)
    starts: tuple[Mapping[str, float], ...] = ({},)
    amplitudes: Mapping[str, float] = field(default_factory=dict)  # key to absent value
    along: tuple[str, ...] = ()
    channel: str = ''
    recording: str = ''
    striker: str = ''  # kind of the blows in which alone it acts
    parameter: str = ''  # of the baseline, where that is what is wrong
    doubt: float = 0.0  # -2 log of its prior probability among its like
    usual: Mapping[str, float] = field(default_factory=dict)  # key to the most that is usual
    sampled: Mapping[str, float] = field(default_factory=dict)  # key of a cut-off to its rate
    fitted: tuple[int, ...] = ()  # recordings whose own numbers count, where it has such
    implied: int = 0  # numbers of a law of which it is one case, that it holds

    @property
    def cost(self) -> int:
        """Number of further numbers of which nothing is known; at least one."""
        free = sum(f.prior is None and f.blow is None for f in self.free)
        return max(1, free + self._own) + self.implied

    @property
    def shape(self) -> list[Free]:
        """Numbers that nobody states and that are not its strength.

        That is the first one where none is known to make it vanish, as the cut-off of a filter.
        """
        free = [f for f in self.free if f.prior is None and f.blow is None]
        return [f for f in free if f.key not in self.amplitudes] if self.amplitudes else free[1:]

    @property
    def of_several_shapes(self) -> bool:
        """Whether several numbers shape it in time: with minima that slopes do not lead to."""
        return len(self.shape) > 1 and not any(f.key.endswith('.frequency') for f in self.shape)

    @property
    def _own(self) -> int:
        return sum(f.prior is None and f.blow in self.fitted for f in self.free)

    def doubt_at(self, values: Mapping[str, float]) -> float:
        """-2 log of its prior probability among its like, with these numbers.

        Above what is usual a number is less likely, by the root of how much larger it is. A filter
        of samples does next to nothing as its cut-off nears half their rate: of all that anybody
        would choose, few lie where its delay is as small as that (the density of the logarithm
        of that delay, where that of the cut-off has the same everywhere).
        """
        beyond = (max(1.0, values[key] / most) for key, most in self.usual.items())
        turns = (2.0 * math.pi * values[key] / rate for key, rate in self.sampled.items())
        dense = (math.sin(x) / x for x in turns)
        return self.doubt + sum(map(math.log, beyond)) - 2.0 * sum(map(math.log, dense))

    def price(self, gain: float, joint: Fit) -> float:
        """Fall of chi-square that its numbers cost, of the ``gain`` that it brings.

        ``joint``: a fit with it. Its strength, of which anything is credible, costs what a number
        costs that all samples tell; what shapes it no more than the fit tells of it.
        """
        shape, own = self.shape, self._own
        told = _told(joint, shape, np.array([_spread(f) for f in shape])) if shape else 0.0
        samples = joint.layout.size
        cost = price(gain, self.cost - own - len(shape), own, samples)
        hum = self.hum_amplitude(joint)
        if hum is not None:
            cost = min(cost, hum.taken + price(gain, 1, 0, samples))
        return told + cost

    def hum_amplitude(self, joint: Fit) -> HumAmplitude | None:
        """The amplitude that all recordings share, of a hum; None of anything else.

        ``joint``: a fit with it.
        """
        if self.name != 'mains_hum':
            return None
        tag, parts = self.effects[0].tag, []
        covariance = joint.covariance()
        for i in self.fitted:
            places = [joint.model.index(f'{tag}.{part}@{i}') for part in PHASE]
            parts.append((joint.x[places], covariance[np.ix_(places, places)]))
        return hum_amplitude(parts)

    def price_beyond_plain(self, joint: Fit) -> float:
        """Fall of chi-square that what it has beyond a law of one number costs.

        Its further strengths may be anything up to the sum of all; what shapes it as in
        :meth:`price`. None costs more than a number that all samples tell.
        """
        further = [f for f in self.free if f.key in self.amplitudes][1:]
        total = sum(abs(joint.values[key]) for key in self.amplitudes)
        spreads = [total / math.sqrt(12.0)] * len(further) + [_spread(f) for f in self.shape]
        return _told(joint, [*further, *self.shape], np.array(spreads))

    def extend(self, model: ImpactModel) -> ImpactModel:
        """The model with this candidate in it."""
        return model.extended(free=self.free, effects=self.effects, constants=self.constants)


def _told(joint: Fit, numbers: Sequence[Free], spread: Array) -> float:
    """What numbers cost by what a fit tells of them; none more than one that all samples tell.

    ``spread``: their standard deviations before anything was measured, shape as ``numbers``.
    """
    places = [joint.model.index(f.key) for f in numbers]
    covariance = joint.covariance()[np.ix_(places, places)]
    there = np.flatnonzero(np.diag(covariance) > 0.0)  # nothing depends on the others
    cost = shape_price(covariance[np.ix_(there, there)], spread[there])
    return min(cost, len(numbers) * math.log(max(joint.layout.size, 2)))


def _spread(number: Free) -> float:
    """Standard deviation of a number before anything is measured; as it is fitted."""
    lower, upper = number.bounds
    width = upper - lower
    if not math.isfinite(width):
        width = _DECADES * math.log(10.0) if number.logarithmic else math.inf
    return width / math.sqrt(12.0)


def kin_of(candidate: Candidate) -> tuple[str, ...]:
    """Mechanisms of the same family; of a wrong number those that act as it does."""
    if candidate.name in all_mechanisms():
        return mechanism(candidate.name).kin
    return _LIKE_A_NUMBER.get(candidate.parameter.split('.', 1)[0], ())


def contains(fuller: Candidate, plain: Candidate) -> bool:
    """Whether one candidate is the other with further numbers, in the same place."""
    if fuller.name not in all_mechanisms() or fuller.channel != plain.channel:
        return False
    return plain.name in mechanism(fuller.name).contains and fuller.cost > plain.cost


def stronger(candidate: Candidate, start: Mapping[str, float], factor: float) -> dict[str, float]:
    """Values with the numbers that make the effect vanish moved away from there by a factor."""
    scaled = dict(start)
    for key, absent in candidate.amplitudes.items():
        if key not in scaled:
            continue
        if math.isinf(absent):
            scaled[key] = scaled[key] / max(factor, 1e-9)
        else:
            scaled[key] = absent + factor * (scaled[key] - absent)
    for key in candidate.along:
        if key in scaled and factor > 0.0:
            scaled[key] = factor * scaled[key]
    return scaled
