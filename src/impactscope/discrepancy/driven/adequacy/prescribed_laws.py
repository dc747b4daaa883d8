"""Laws that no known effect describes, as small forces of a device on a prescribed course."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.adequacy.plate_laws import STATE
from impactscope.discrepancy.driven.adequacy.swinging import (
    SWINGS,
    Swing,
    answers_of_swings,
    frequencies,
    swings_seen,
)
from impactscope.discrepancy.driven.adequacy.unmodelled_laws import LOOKS, Group
from impactscope.discrepancy.driven.fits.innovations import each_alone, innovations, joined
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.relaxation import NAME as RELAXING

__all__ = ['prescribed_laws']

Array = NDArray[np.float64]

MEMORIES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # of the motion's own rate
FASTEST = 60.0  # Hz, up to which a stiffness is taken to swing


def prescribed_laws(model: Model, made: Fit, segments: Sequence[Segment]) -> Iterator[Group]:  # noqa: ARG001
    """Laws beyond the vocabulary, each with the whitened changes that span it, beside a fit."""
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    chosen = [segments[i] for i in fitted]
    outputs = [segments[i].measured - made.residuals[i] for i in fitted]
    position = max(float(np.max(np.abs(s.drive[0]))) for s in chosen) or 1.0
    speed = max(float(np.max(np.abs(s.drive[1]))) for s in chosen) or 1.0
    largest = max(float(np.max(np.abs(y))) for y in outputs) or 1.0
    xs = [s.drive[0] / position for s in chosen]
    vs = [s.drive[1] / speed for s in chosen]
    ys = [y / largest for y in outputs]
    times: list[Array] = [s.period * np.arange(s.measured.size, dtype=np.float64) for s in chosen]

    column, alone = partial(joined, chosen), partial(each_alone, chosen)

    for name, law in STATE:
        yield Group(name, [column([law(x, v) for x, v in zip(xs, vs, strict=True)])])
    for name, parts in (
        ('damping one way', [np.maximum(v, 0.0) for v in vs]),
        ('a reading that is not straight', [y * y for y in ys]),
        ('a reading that is not straight', [y**3 for y in ys]),
        ('a stiffness that changes in time', [x * t for x, t in zip(xs, times, strict=True)]),
        ('a damping that changes in time', [v * t for v, t in zip(vs, times, strict=True)]),
        (
            'a friction that changes in time',
            [np.sign(v) * t for v, t in zip(vs, times, strict=True)],
        ),
    ):
        yield Group(name, [column(parts)])
    if len(chosen) > 1:
        yield Group('a stiffness that differs between recordings', alone(xs), differs=True)
        yield Group('a damping that differs between recordings', alone(vs), differs=True)
        yield Group(
            'a friction that differs between recordings',
            alone([np.sign(v) for v in vs]),
            differs=True,
        )
        ones = [np.ones(x.size) for x in xs]
        yield Group('an offset that differs between recordings', alone(ones), differs=True)
    rate = speed / position
    for ratio in MEMORIES:
        late = []
        for s, v in zip(chosen, vs, strict=True):
            keep = math.exp(-s.period * rate * ratio)
            late.append(signal.lfilter([1.0 - keep], [1.0, -keep], v))
        yield Group('a force that relaxes', [column(late)], case_of=RELAXING)
    longest = max(s.measured.size for s in chosen)
    frequency = frequencies(longest, chosen[0].period)
    highest = min(FASTEST, float(frequency[-1]))
    sought = round(2 * SWINGS * highest * longest * chosen[0].period)  # of either of two
    looks = max(LOOKS, sought)
    for what, shapes in (('stiffness', xs), ('damping', vs)):
        seen = [
            _swings(segments[i], made.residuals[i], shape, longest)
            for i, shape in zip(fitted, shapes, strict=True)
        ]
        together, apart = swings_seen(seen, frequency, highest)
        for about in dict.fromkeys((*together, *apart)):
            waves = [
                [p * wave(2.0 * math.pi * about * t) for p, t in zip(shapes, times, strict=True)]
                for wave in (np.sin, np.cos)
            ]
            name = f'a {what} that swings at {about:.3g} Hz'
            if about in together:
                yield Group(name, [column(w) for w in waves], looks, sought=sought)
            if len(chosen) > 1 and about in apart:
                yield Group(name, [c for w in waves for c in alone(w)], looks, sought=sought)


def _swings(segment: Segment, residual: Array, shape: Array, longest: int) -> Swing:
    """What a recording shows of a force that is read as it is."""
    pulse = np.zeros(shape.size)
    pulse[shape.size // 2] = 1.0  # where whitening has begun
    answer = innovations(segment, pulse)[shape.size // 2 :]
    return answers_of_swings(innovations(segment, residual), shape, answer, longest)
