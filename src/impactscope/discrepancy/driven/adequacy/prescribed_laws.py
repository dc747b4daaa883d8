"""Laws that no known effect describes, as small forces of a device on a prescribed course."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.adequacy.plate_laws import STATE
from impactscope.discrepancy.driven.adequacy.swinging import swinging_laws
from impactscope.discrepancy.driven.adequacy.unmodelled_laws import Group
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
    residuals = [innovations(segments[i], made.residuals[i]) for i in fitted]
    highest = min(FASTEST, 0.5 / chosen[0].period)
    for what, shapes in (('stiffness', xs), ('damping', vs)):
        yield from swinging_laws(what, chosen, residuals, shapes, highest, kinds=2)
