"""Noise of a mass's sensor and of its force, read from what a fit leaves; whitening by it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize

from impactscope.discrepancy.driven.data.measured_force import KnownForce
from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.noise.kalman_whitening import HammerForce, whitener
from impactscope.discrepancy.driven.noise.quantisation import step_of
from impactscope.discrepancy.driven.noise.spectral_whitening import (
    COARSE,
    Colour,
    fitted_colour,
    levels,
    stepped,
    unlike_noise,
    weight_by_runs,
    whitening,
)

__all__ = ['whitened']

Array = NDArray[np.float64]

LONGEST = 1 << 17  # samples of a whitening filter
FINEST_STEP = 4e-7  # of the range, as fine as single precision
QUIET = 30.0  # times the noise: where the spectrum of a prediction is quiet
ENOUGH = 0.2  # of the lines must be quiet
ALONE = 10.0  # times the noise: a sample that stands out
SPIKES = 0.003  # of the samples may do so
NEIGHBOURS = 7
DITHERED = 1.8  # noises, of a step below which they make it one more part of the noise
FEWEST = 3  # parts of a spectrum


def whitened(
    parts: Sequence[Cut],
    ready: Sequence[Segment],
    made: Fit,
    forces: Sequence[KnownForce | None],
    slowest: float = 0.0,
    *,
    beside: bool = False,
) -> tuple[list[Segment], list[Array]]:
    """Segments with their whitening filters, and the share of the force's noise by frequency.

    ``slowest``: corner over half the rate below which the output's noise does not fall;
    ``beside``: the noise is read also where the motion is far louder.
    """
    done = list(ready)
    drifts = 'stiffness' not in made.values
    shares: list[Array] = [np.zeros(0)] * len(done)
    for channel in dict.fromkeys(s.channel for s in ready):
        mine = [i for i, s in enumerate(ready) if s.channel == channel]
        told = [i for i in mine if not ready[i].held_out] or mine
        s = ready[told[0]]
        stated = parts[told[0]].noise
        weights = {i: _alone(made.residuals[i]) for i in mine}
        left = [_filled(made.residuals[i], weights[i]) for i in told]
        predicted = [ready[i].measured - made.residuals[i] for i in told]
        size = min(r.size for r in left)
        place, level = levels([r[:size] for r in left], slow=beside)
        _, loud = levels([p[:size] for p in predicted], slow=beside)
        if beside:
            loud = np.zeros_like(loud)
        noises = [0.0 if f is None else f.noise for f in forces]
        force = float(np.mean([noises[i] for i in told]))
        moves = [1.0 if f is None else f.moves for f in forces]
        rings = _gain(made, s.derivative, math.pi * place / s.period)
        rings = rings * float(np.mean([moves[i] for i in told]))
        white, force, colour = _noise(
            place, level, loud, rings, force, size, slowest, beside=beside
        )
        steps = min(_step(ready[i].measured) for i in told) if drifts else 0.0
        if steps < DITHERED * math.sqrt(white):
            steps = 0.0
        if steps > 0.0:
            white, colour = max(white, steps**2 / 12.0), None
        coarse = 0.0 if drifts else min(step_of(ready[i].measured) for i in told)
        if coarse > COARSE * math.sqrt(white):  # where such a reading rests it shows no noise
            white, colour = max(white, coarse**2 / 12.0), None
        if math.isfinite(stated) and stated > 0.0:
            white, colour = stated**2, None
        if not white > 0.0:
            return [], []
        for i in mine:
            grid = 1 << max(10, min(2 * ready[i].measured.size, LONGEST).bit_length())
            f = np.linspace(0.0, 1.0, grid // 2 + 1)
            f[0] = 0.5 * f[1]
            own = np.full(f.size, white)
            if colour is not None:
                own = colour.power(f, max(2.0 / ready[i].measured.size, 1e-6))
            mine_force = noises[i] if math.isfinite(noises[i]) else force
            rung = mine_force * moves[i] * _gain(made, s.derivative, math.pi * f / s.period)
            rung = np.minimum(rung, 1e12 * own)
            total = float(np.mean(own + rung))
            if colour is not None and drifts:
                total = min(total, float(np.mean([np.mean(r**2) for r in left])))
            filtering: Callable[[Array], Array] = whitening(own + rung, weights[i])
            known = forces[i]
            if known is not None and known.error is not None and colour is None:
                filtering = _along(made, ready[i], math.sqrt(white), known.error)
            repeated = stepped(ready[i].measured, math.sqrt(white), steps) if steps > 0.0 else None
            if repeated is not None:
                filtering = repeated
            runs = None if drifts else weight_by_runs(ready[i].measured, math.sqrt(white))
            done[i] = dataclasses.replace(
                ready[i], noise=math.sqrt(total), whitener=filtering, weight=runs
            )
            shares[i] = rung / (own + rung)
    return done, shares


def _step(samples: Array) -> float:
    """Step of a reading some of whose samples repeat the one before; 0 where none do."""
    change = np.abs(np.diff(samples))
    if np.all(change > 0.0):
        return 0.0
    few = change[change > 0.0]
    step = float(np.min(few)) if few.size else 0.0
    return step if step > FINEST_STEP * float(np.max(np.abs(samples))) else 0.0


def _gain(made: Fit, derivative: int, turn: Array) -> Array:
    """Square of what a unit of force makes of the output, by angular frequency."""
    mass = made.values.get('mass', 1.0)
    k, c = made.values.get('stiffness', 0.0), made.values['damping']
    below = (k - mass * turn**2) ** 2 + (c * turn) ** 2
    return np.asarray(turn ** (2 * derivative) / np.maximum(below, 1e-300))


def _along(
    made: Fit, segment: Segment, noise: float, error: HammerForce
) -> Callable[[Array], Array]:
    """The filter for a force whose error changes in time."""
    plate = made.values.get('mass', 1.0), made.values['damping'], made.values.get('stiffness', 0.0)
    size = segment.measured.size
    return whitener(plate, segment.derivative, segment.period, noise, error, size)


def _alone(residual: Array) -> Array | None:
    """Weights of samples, 0 where one or two stand out alone; None where none do."""
    rest = residual - ndimage.median_filter(residual, NEIGHBOURS)
    noise = float(np.median(np.abs(rest))) / 0.6745
    if not noise > 0.0:
        return None
    out = np.abs(rest) > ALONE * noise
    count = int(np.count_nonzero(out))
    if count == 0 or count > max(SPIKES * residual.size, 1):
        return None
    edges = np.flatnonzero(np.diff(np.concatenate([[0], out.astype(np.int8), [0]])))
    runs = edges.reshape(-1, 2)
    if np.any(runs[:, 1] - runs[:, 0] > 2):
        return None
    return np.where(out, 0.0, 1.0)


def _filled(residual: Array, weight: Array | None) -> Array:
    """A residual with its neighbours' median where samples do not count."""
    if weight is None:
        return residual
    return np.where(weight > 0.0, residual, ndimage.median_filter(residual, NEIGHBOURS))


def _noise(
    place: Array,
    level: Array,
    loud: Array,
    rings: Array,
    force: float,
    size: int,
    slowest: float,
    *,
    beside: bool,
) -> tuple[float, float, Colour | None]:
    """White level of the output, variance of the force's noise, and a colour if there is one."""
    if place.size < FEWEST:
        return float(np.median(level)), 0.0, None
    widths = np.gradient(place)
    widths = widths / float(np.sum(widths))
    if not math.isfinite(force):
        start = float(np.average(level, weights=widths))

        def cost(q: Array) -> float:
            s = np.exp(q[0]) + np.exp(q[1]) * rings
            return float(np.sum(widths * (np.log(s) + level / s)))

        begin = np.log([0.5 * start, 0.5 * start / max(float(np.median(rings)), 1e-300)])
        made = optimize.minimize(cost, begin, method='Nelder-Mead')
        return float(np.exp(made.x[0])), float(np.exp(made.x[1])), None
    rest = np.maximum(level - force * rings, 0.02 * level)
    colour = fitted_colour(place, rest, loud, 0.5 * size, slowest)
    if beside and colour is not None and unlike_noise(colour, place, rest, 0.5 * size):
        colour = None  # an error of the model, which is no noise
    if colour is not None:
        return float(np.average(colour.power(place), weights=widths)), force, colour
    among = [_median(rest, widths), _median(rest[place > 0.5], widths[place > 0.5])]
    quiet = (loud < QUIET * level) & (level > 2.0 * force * rings)
    if float(np.sum(widths[quiet])) > ENOUGH:
        among.append(float(np.average(rest[quiet], weights=widths[quiet])))
    return min(among), force, None


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    half = int(np.searchsorted(total, 0.5 * total[-1]))
    return float(values[order][min(half, values.size - 1)])
