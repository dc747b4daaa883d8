"""Cogging: a force that repeats with the position of an axis, as its motion shows it.

A weak cogging drowns in a differentiated encoder. The motion adds it up: what
a simulation leaves of the position is many times the encoder's noise, and goes like the answer of
the axis to such a force.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.adequacy.unmodelled_laws import UnmodelledLaw
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Segment

__all__ = ['cogging_of_motion', 'periods_to_try']

Array = NDArray[np.float64]
T = TypeVar('T')

FEWEST = 2.0  # periods in the range of motion
APART = 0.5  # of a period in the range of motion, between those that are tried
AT_LEAST, WORK = 160, 2e7  # of them, and how often all samples are gone through for more
MOVING = 0.1  # of the largest speed, from which something moves
PASSED = 0.25  # of a period, that is passed from sample to sample at most, mostly
STRIDE = 10  # samples over which a speed is looked at
REFINED, FINER = 8, 0.04  # of the best ones, and the steps in which is looked about them
EXPLAINED = 0.8  # share of what is left that the force must explain, beside the axis' numbers
PREDICTED = 0.5  # the same of recordings held out, with the numbers of the others
SCANNED = 10_000  # samples, about


def periods_to_try(positions: Sequence[Array], span: float) -> Array:
    """Numbers of periods in a range of motion ``span`` that a force which repeats may have.

    As many as samples follow, and as there is time for.

    Args:
        positions: of each recording, shape (n,), in order of time.
        span: the range of motion, in their unit.
    """
    parts = [np.abs(x[STRIDE:] - x[:-STRIDE]) / STRIDE for x in positions if x.size > STRIDE]
    steps = np.concatenate([*parts, np.zeros(1)])
    moving = steps[steps > MOVING * float(np.max(steps))]
    followed = PASSED * span / float(np.median(moving)) if moving.size else FEWEST
    samples = sum(x.size for x in positions)
    return np.arange(FEWEST, min(followed, APART * max(AT_LEAST, WORK / samples)), APART)


def cogging_of_motion(
    made: Fit, segments: Sequence[Segment]
) -> tuple[UnmodelledLaw, float] | None:
    """Such a force, told by its period, and the share of what a fit leaves that it leaves.

    None where none explains most of that, or where recordings held out deny it. Of a mass with
    damping alone whose force is recorded and whose position is the output. What is left of a
    position is smooth: as many of its samples count as it changes its sign.
    """
    mass, damping = made.values.get('mass'), made.values.get('damping')
    if mass is None or damping is None or mass <= 0.0 or damping < 0.0:
        return None
    if 'stiffness' in made.values or any(s.derivative != 0 for s in segments):
        return None
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    thin = max(1, sum(segments[i].measured.size for i in fitted) // SCANNED)
    axes = [_Axis(s, mass, damping, thin) for s in segments]
    left = [a.own(r) for a, r in zip(axes, made.residuals, strict=True)]
    numbers = np.concatenate([a.numbers for a in _chosen(axes, fitted)])
    shared = np.linalg.qr(numbers / np.linalg.norm(numbers, axis=0))[0]

    def beyond(columns: Array) -> Array:
        return np.asarray(columns - shared @ (shared.T @ columns))

    whole = np.concatenate(_chosen(left, fitted))
    rest = beyond(whole)
    power = float(rest @ rest)
    span = float(np.ptp(np.concatenate([segments[i].measured for i in fitted])))
    if not power > 0.0 or not span > 0.0:
        return None

    def explained(turns: float) -> float:
        waves = beyond(np.concatenate([a.waves(span / turns) for a in _chosen(axes, fitted)]))
        along = waves.T @ rest
        return float(along @ np.linalg.lstsq(waves.T @ waves, along, rcond=None)[0]) / power

    tried = periods_to_try([segments[i].measured for i in fitted], span)
    if not tried.size:
        return None
    near = sorted(tried.tolist(), key=explained)[-REFINED:]
    best = max((t + d for t in near for d in np.arange(-APART, APART, FINER)), key=explained)
    share, period = explained(best), span / best
    if share <= EXPLAINED:
        return None
    both = [np.concatenate([a.numbers, a.waves(period)], axis=1) for a in axes]
    size = np.linalg.norm(np.concatenate(_chosen(both, fitted)), axis=0)
    factors = np.linalg.lstsq(np.concatenate(_chosen(both, fitted)) / size, whole, rcond=None)[0]
    before = after = 0.0
    for s, was, columns in zip(segments, left, both, strict=True):
        if s.held_out:
            before += float(was @ was)
            after += float(np.sum((was - columns / size @ factors) ** 2))
    if before > 0.0 and after > (1.0 - PREDICTED) * before:
        return None
    counted = int(np.count_nonzero(np.diff(np.sign(rest))))
    gain = counted * share / max(1.0 - share, 1e-9)
    law = f'a force that repeats every {period:.4g} {segments[0].unit} of the position'
    return UnmodelledLaw(law, gain, 2), 1.0 - share


def _chosen(items: Sequence[T], places: Sequence[int]) -> list[T]:
    return [items[i] for i in places]


class _Axis:
    """Answers of an axis to small forces, without what a recording's own beginning makes."""

    def __init__(self, segment: Segment, mass: float, damping: float, thin: int) -> None:
        self._place, self._thin = segment.measured, thin
        above, below, _ = signal.cont2discrete(
            ([1.0], [mass, damping, 0.0]), segment.period, 'bilinear'
        )
        self._filter = np.ravel(above), below
        time = segment.period * np.arange(segment.measured.size)
        fades = np.exp(-damping / mass * time)
        begins = np.stack([np.ones(time.size), fades, time], axis=1)[::thin]
        self._own = np.linalg.qr(begins[:, :2] if damping > 0.0 else begins[:, ::2])[0]
        speed = np.gradient(segment.measured, segment.period)
        force = segment.drive[:, 0]
        force = np.pad(force, (0, speed.size - force.size), mode='edge')
        self.numbers = np.stack([self._answer(speed), self._answer(force)], axis=1)

    def own(self, change: Array) -> Array:
        """A change of the position, thinned, beyond what the beginning can do; shape (k,)."""
        change = change[:: self._thin]
        return np.asarray(change - self._own @ (self._own.T @ change))

    def waves(self, period: float) -> Array:
        """Answers to forces of that period, shape (k, 2)."""
        angle = 2.0 * math.pi / period * self._place
        return np.stack([self._answer(np.sin(angle)), self._answer(np.cos(angle))], axis=1)

    def _answer(self, force: Array) -> Array:
        return self.own(np.asarray(signal.lfilter(*self._filter, force)))
