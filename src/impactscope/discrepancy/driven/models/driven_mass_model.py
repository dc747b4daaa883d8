"""A mass under a force, or left alone, that may begin in motion and have backlash."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.models.backlash import (
    BACKLASH,
    COUPLED,
    NONE,
    follow,
    run_with_backlash,
)
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel
from impactscope.discrepancy.driven.models.terms import Number, Term, key

__all__ = ['DrivenMassModel', 'name_of']

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DrivenMassModel(OscillatorModel):
    """An oscillator some of whose recordings begin in motion."""

    moving: frozenset[tuple[str, str, float]] = field(default_factory=frozenset)

    def predict(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> Array:
        """Predicted channel, shape (n,); what acts in another channel plays no part."""
        mine = tuple(t for t in terms if not t.output or t.channel == segment.channel)
        return super().predict(values, mine, start, segment)

    def _run(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> Array:
        play = next((t for t in terms if t.label in BACKLASH or t.name == COUPLED), None)
        if play is None:
            return super()._run(values, terms, start, segment)
        if play.variant == 'encoder':
            rest = tuple(t for t in terms if t is not play)
            out = super()._run(values, rest, start, segment).copy()
            follow(out[:, 0].copy(), values[key(play, play.numbers[0])], out[:, 0])
            return out
        x, v = start if start.size else segment.state
        plain = np.array([values['mass'], values['damping'], values.get('offset.value', 0.0)])
        numbers = [values[key(play, n)] for n in play.numbers]
        if play.name == COUPLED:
            between = np.array([NONE, *numbers, 1.0])
        else:
            between = np.array([*numbers, float(play.variant == 'load')])
        out = np.zeros((segment.measured.size, 4))
        run_with_backlash(plain, between, segment.drive, segment.period, x, v, out)
        return out

    def starts(self, segment: Segment) -> tuple[Number, ...]:
        """Position and speed at the first sample, where it begins in motion."""
        if name_of(segment) not in self.moving:
            return ()
        x, v = segment.state
        return (
            Number('position', '', (x,), 0.1 * self.position_scale),
            Number('speed', '', (v,), 0.1 * self.speed_scale),
        )


def name_of(segment: Segment) -> tuple[str, str, float]:
    """What tells a segment from others: its recording, its channel, and when it begins (s)."""
    return segment.recording, segment.channel, segment.begin
