"""Laws of a measuring channel that no known effect describes, as small changes of samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.adequacy.unmodelled_laws import Group, Shaped, contrasts
from impactscope.discrepancy.driven.fits.innovations import each_alone, joined
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.noise.quantisation import step_of
from impactscope.physics.slew_limit import behind

__all__ = ['channel_laws']

Array = NDArray[np.float64]

ECHOES = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144, 233)  # samples
RESONANCES = 16
COARSE = 0.3  # of the noise: steps from which they look like other laws
STAIRS = ('a step at zero', 'a dead band', 'a backlash')
SMALL = 0.003  # of the largest reading
BEYOND = 5.0  # times the noise: a reading that is one
ONE_SIGN = 1e-4  # share of the power that the other sign may have
RESONANCE = 'a resonance or a notch'
RATIO = 0.1  # damping ratio of a resonance, to begin with
HIGHEST = 0.45  # of the rate, of its frequency
SLEW = (0.95, 0.85, 0.7)  # of the steepest rate: limits that are tried
MAINS = (50.0, 60.0, 100.0, 120.0, 150.0, 180.0)


def channel_laws(model: Model, made: Fit, segments: Sequence[Segment]) -> Iterator[Group]:  # noqa: ARG001
    """Laws beyond the vocabulary, each with the whitened changes that span it, beside a fit."""
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    chosen = [segments[i] for i in fitted]
    outputs = [segments[i].measured - made.residuals[i] for i in fitted]
    largest = max(float(np.max(np.abs(y))) for y in outputs) or 1.0
    outputs = [y / largest for y in outputs]
    times: list[Array] = [s.period * np.arange(s.measured.size, dtype=np.float64) for s in chosen]

    column, alone = partial(joined, chosen), partial(each_alone, chosen)

    stepped = step_of(chosen[0].measured) > COARSE * chosen[0].noise
    # A low-pass colours what noise of the input is left: a linear law would then whiten it, and
    # a law of small readings would go with that noise.
    apart = any(float(np.std(s.drive[1])) > COARSE * s.noise / 10.0 for s in chosen)
    coloured = apart and any(t.name == 'low_pass_filter' for t in made.terms)
    ones = [np.ones(y.size) for y in outputs]
    # where a reading is no more than noise, its sign is that of noise, which is in the residual
    least = [max(SMALL, BEYOND * s.noise / largest) for s in chosen]
    clear = [np.where(np.abs(y) > b, y, 0.0) for y, b in zip(outputs, least, strict=True)]
    for name, parts in (
        ('a reading that is bent to one side', [y * y for y in outputs]),
        ('a reading that is not straight', [y**3 for y in outputs]),
        ('a reading that is not straight', [y * np.abs(y) for y in outputs]),
        ('a reading that is not straight near its end', [y**7 for y in outputs]),
        ('a gain that depends on the sign', _by_sign(clear)),
        ('a step at zero', [np.sign(y) for y in clear]),
        ('a dead band', [np.clip(y, -0.01, 0.01) for y in clear]),
        ('a dead band', [np.clip(y, -0.1, 0.1) for y in clear]),
        ('a gain that changes in time', [y * t for y, t in zip(outputs, times, strict=True)]),
        ('a zero that runs off', [t**2 for t in times]),
    ):
        if parts and not ((stepped or coloured) and name in STAIRS):
            yield Group(name, [column(parts)])
    rates = [np.gradient(y) for y in outputs]
    sharp = [
        np.sign(r) * (np.abs(r) > max(SMALL * float(np.max(np.abs(r))), b))
        for r, b in zip(rates, least, strict=True)
    ]
    steep = max(float(np.max(np.abs(r))) for r in rates) or 1.0
    for name, parts in (
        ('a reading that lags by its direction', [np.abs(r) / steep for r in rates]),
        ('a reading that is slow where it is steep', [r * np.abs(r) / steep**2 for r in rates]),
        ('a backlash', sharp),
    ):
        if not (coloured and name in STAIRS):
            yield Group(name, [column(parts)])
    most = max(float(np.max(np.abs(np.diff(y)))) for y in outputs)
    for share in SLEW:
        short = [behind(y, share * most) for y in outputs]
        if any(np.any(b) for b in short):
            yield Group('a reading that cannot rise or fall any faster', [column(short)])
    if len(chosen) > 1:
        # where a gain of all recordings is fitted it is fitted to what both channels tell, from
        # which the prediction differs by noise that is in the residual
        yield Group('a gain that differs between recordings', contrasts(alone(outputs)))
        yield Group('an offset that differs between recordings', alone(ones), differs=True)
        yield Group('a drift that differs between recordings', alone(times), differs=True)
    for mains in MAINS:
        if mains * chosen[0].period < 0.45:
            yield Group(
                f'a hum at {mains:g} Hz that swells',
                [
                    column([wave(2.0 * math.pi * mains * t) * t**k for t in times])
                    for wave in (np.sin, np.cos)
                    for k in (1, 2)
                ],
            )
            yield Group(
                f'a hum at {mains:g} Hz that differs between recordings',
                [
                    c
                    for wave in (np.sin, np.cos)
                    for c in alone([wave(2.0 * math.pi * mains * t) for t in times])
                ],
            )
    if coloured:
        return
    for late in ECHOES:
        echo = [np.concatenate([np.zeros(late), y[:-late]]) for y in outputs if y.size > late]
        if len(echo) == len(outputs):
            yield Group('an echo', [column(echo)])
    longest = max(float(t[-1]) for t in times)
    for turn in np.geomspace(2.0 / longest, 0.4 / chosen[0].period, RESONANCES).tolist():
        shape = np.log([turn, RATIO])
        ring = partial(_ringing, outputs, chosen[0].period, column)
        told = partial(_told, chosen[0].period)
        yield Group(RESONANCE, ring(shape), shaped=Shaped(tuple(shape.tolist()), ring, told))


def _ringing(
    outputs: Sequence[Array],
    period: float,
    column: Callable[[Sequence[Array]], Array],
    shape: Array,
) -> list[Array]:
    """What a resonance adds to readings, by the logarithms of its frequency and damping ratio."""
    turn = 2.0 * math.pi * _frequency(period, shape)
    ratio = math.exp(shape[1])
    # Tustin's rule, written out: a search may come to turns far below what scipy thinks sound
    k, lost = 2.0 / period, 4.0 * ratio * turn / period
    below = [k**2 + lost + turn**2, 2.0 * (turn**2 - k**2), k**2 - lost + turn**2]
    ringing = [signal.lfilter([k, 0.0, -k], below, y) for y in outputs]
    return [column(ringing), column([np.gradient(y) for y in ringing])]


def _frequency(period: float, shape: Array) -> float:
    return min(math.exp(shape[0]), HIGHEST / period)


def _told(period: float, shape: Array) -> str:
    return f'{RESONANCE} at {_frequency(period, shape):.3g} Hz'


def _by_sign(outputs: Sequence[Array]) -> list[Array]:
    """Size of readings; none where all have one sign, for there it is the reading itself."""
    below, above = (
        sum(float(np.sum(np.clip(k * y, 0.0, None) ** 2)) for y in outputs) for k in (-1, 1)
    )
    return [np.abs(y) for y in outputs] if min(below, above) > ONE_SIGN * max(below, above) else []
