"""The oscillator under a measured input, or swinging freely, as a model of recordings."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.models import parameter_layout as at
from impactscope.discrepancy.driven.models.equation_of_motion import run, run_on_base
from impactscope.discrepancy.driven.models.measuring_chain import passed_on, retimed
from impactscope.discrepancy.driven.models.mechanical_effects import (
    enter,
    with_slots_that_follow,
)
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.terms import Number, Term

__all__ = ['OscillatorModel', 'gain_of', 'inside_samples']

Array = NDArray[np.float64]

AT_REST = 0.02  # of the largest position and speed: what counts as a beginning at rest


def gain_of(channel: str) -> str:
    """Name of an output's gain over that of the first output."""
    return f'gain.{channel}'


def inside_samples(samples: Array, steps: int, *, held: bool) -> Array:
    """Input inside each sampling period, shape (n - 1, 2 steps + 1).

    ``held``: it stays constant until the next sample, as a controller's output does. Else it is
    the band-limited signal through the samples: a straight line between them would be a low-pass
    (0.26 of the amplitude lost at half the sampling rate) that looks like missing physics.
    """
    n = samples.size
    if held:
        return np.asarray(np.repeat(samples[:-1, None], 2 * steps + 1, axis=1), np.float64)
    factor = 2 * steps
    padded = np.concatenate(
        [2 * samples[0] - samples[32:0:-1], samples, 2 * samples[-1] - samples[-2:-34:-1]]
    )
    fine = signal.resample_poly(padded, factor, 1, window=('kaiser', 8.0))
    fine = fine[32 * factor : 32 * factor + (n - 1) * factor + 1]
    rows = np.lib.stride_tricks.sliding_window_view(fine, factor + 1)[::factor]
    return np.ascontiguousarray(rows, np.float64)


@dataclass(frozen=True, eq=False)
class OscillatorModel:
    """One degree of freedom under a measured input, or swinging freely."""

    numbers: tuple[Number, ...]
    terms: tuple[Term, ...]
    free: bool  # no input: the beginning is unknown, the mass is one
    position_scale: float
    speed_scale: float
    _last: dict[Any, Any] = field(default_factory=dict, repr=False)  # motion of each recording

    def starts(self, segment: Segment) -> tuple[Number, ...]:
        """Position and speed at the first sample of a free swing.

        A driven recording may begin in the midst of motion: then its beginning is an unknown where
        it is fitted, and as measured where it is only predicted.
        """
        x, v = segment.state
        position = Number('position', '', (x,), 0.1 * self.position_scale)
        speed = Number('speed', '', (v,), 0.1 * self.speed_scale)
        if self.free:
            return position, speed
        if segment.held_out or segment.derivative != 0 or self.drifts:
            return ()
        moving = abs(x) > AT_REST * self.position_scale or abs(v) > AT_REST * self.speed_scale
        return (position, speed) if moving else ()

    @property
    def drifts(self) -> bool:
        """Whether nothing brings the mass back."""
        return not any(n.name == 'stiffness' for n in self.numbers)

    def vector(self, values: Mapping[str, float], terms: tuple[Term, ...]) -> Array:
        """Parameters of the compiled oscillator."""
        p = np.zeros(at.SIZE)
        outside = {t.label for t in terms if t.output}
        enter(p, {k: v for k, v in values.items() if k.partition('.')[0] not in outside})
        for term in terms:
            if term.fixed:
                enter(p, term.fixed)
        if p[at.SHARE] > 0.0:
            p[at.HYSTERESIS_STIFFNESS] = p[at.SHARE] * p[at.STIFFNESS]
            p[at.STIFFNESS] -= p[at.HYSTERESIS_STIFFNESS]
        if p[at.BASE_MASS] > 0.0:
            omega = 2.0 * math.pi * p[at.BASE_FREQUENCY]
            p[at.BASE_STIFFNESS] = p[at.BASE_MASS] * omega**2
            p[at.BASE_DAMPING] = 2.0 * p[at.BASE_RATIO] * p[at.BASE_MASS] * omega
        if p[at.MASS] == 0.0:
            p[at.MASS] = 1.0
        with_slots_that_follow(p)
        return p

    def _run(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> Array:
        x, v = segment.state
        if start.size:
            x, v = start[0], start[1]
        p = self.vector(values, terms)
        state = (id(segment), x, v, p.tobytes())
        place = segment.recording, threading.get_ident()  # fits go on side by side
        last = self._last.get(place)
        if last is None or last[0] != state:
            out = np.zeros((segment.measured.size, 4))
            simulate = run_on_base if p[at.BASE_MASS] > 0.0 else run
            simulate(p, segment.drive, segment.period, x, v, out)
            last = self._last[place] = state, out, segment
        made: Array = last[1]
        return made

    def predict(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> Array:
        """Predicted channel, shape (n,)."""
        moved = self._run(values, terms, start, segment)[:, segment.derivative]
        moved = values.get(gain_of(segment.channel), 1.0) * moved
        parts = {t.name: t for t in terms if t.output}
        if not parts:
            return moved
        if 'clock_error' in parts:
            clock = parts['clock_error'].label
            offset, drift = values.get(f'{clock}.offset', 0.0), values.get(f'{clock}.drift', 0.0)
            moved = retimed(moved, offset, drift, segment.period)
        return passed_on(
            moved,
            parts,
            values,
            segment.period,
            segment.begin,
            measured=segment.measured,
            # of an axis a slow motion may be small beside its way and large beside its noise
            moving=(True, True) if self.drifts else None,
            # where an axis stands plays no part behind a coupling that has long forgotten it: it
            # begins where the channel does, and the coupling forgets that
            before=0.0 if self.drifts and start.size else None,
        )

    def motion(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> tuple[Array, Array]:
        """Position and speed, shapes (n,)."""
        out = self._run(values, terms, start, segment)
        return out[:, 0], out[:, 1]
