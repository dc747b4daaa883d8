"""One thing that may be missing from a model of the bench: what it adds, where to start."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from impactscope.discrepancy.evidence import price
from impactscope.discrepancy.impact.models.bench_model import ActiveEffect, Free, ImpactModel
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism

__all__ = ['Candidate', 'contains', 'kin_of', 'stronger']

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
    fitted: tuple[int, ...] = ()  # recordings whose own numbers count, where it has such
    implied: int = 0  # numbers of a law of which it is one case, that it holds

    @property
    def cost(self) -> int:
        """Number of further numbers of which nothing is known; at least one."""
        free = sum(f.prior is None and f.blow is None for f in self.free)
        return max(1, free + self._own) + self.implied

    @property
    def _own(self) -> int:
        return sum(f.prior is None and f.blow in self.fitted for f in self.free)

    def doubt_at(self, values: Mapping[str, float]) -> float:
        """-2 log of its prior probability among its like, with these numbers.

        Above what is usual a number is less likely, by the root of how much larger it is.
        """
        beyond = (max(1.0, values[key] / most) for key, most in self.usual.items())
        return self.doubt + sum(map(math.log, beyond))

    def price(self, gain: float, samples: int) -> float:
        """Fall of chi-square that its numbers cost, of the ``gain`` that it brings."""
        return price(gain, self.cost - self._own, self._own, samples)

    def extend(self, model: ImpactModel) -> ImpactModel:
        """The model with this candidate in it."""
        return model.extended(free=self.free, effects=self.effects, constants=self.constants)


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
