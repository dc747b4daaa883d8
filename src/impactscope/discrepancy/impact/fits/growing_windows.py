"""Fits over windows that grow from the first milliseconds of a blow.

Later contacts amplify small errors of earlier ones. So a fit begins where the blow is simple, with
each blow placed in time, and follows over windows that grow.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from impactscope.discrepancy.impact.fits.least_squares import Fit, fit
from impactscope.discrepancy.impact.fits.start_values import SHORT, cold_starts, met, placed
from impactscope.discrepancy.impact.models.bench_model import ImpactModel
from impactscope.discrepancy.processes import in_processes
from impactscope.discrepancy.time_limit import time_left
from impactscope.errors import ImpactscopeError
from impactscope.physics.twin.simulate import SimulationError

__all__ = [
    'begun',
    'fit_baseline',
    'fit_unless_far_behind',
    'follow',
    'followed',
    'follows_all',
    'further',
    'held_out_fit',
    'with_repeatability',
]

Array = NDArray[np.float64]

_REPEATABLE = 8e-5  # relative, of a speed
_RELEASES = (0.0, 1.0, -1.0, 2.2, -2.2)  # of the standard deviation of a release, as starts
_PREDICTED = 1.15  # reduced chi-square from which other starts are tried
_GROWTH = (0.02, 0.03, 0.04, 0.055, 0.08, 0.12, 0.2, 0.35, 0.6, 1.0, 1.7)  # s after the onset
_ROUGH = 1.1  # growth of the reduced chi-square from which a nearer window is tried
_SOUND = 1.5  # reduced chi-square up to which that is worth while
_FINEST = 1.08  # ratio of windows that are next to each other
_TRIES = 14
_FOLLOWED = 4.0  # growth of the reduced chi-square up to which a longer window is followed
_SETTLED = 0.02  # of chi-square
_OPEN = 0.05  # relative, of a number that a short window does not tell
_TOLD = 0.005  # relative, likewise of a bare contact: each bounce amplifies it
_STEEP = 'contact.'
_RUNG = 1.15  # reduced chi-square up to which taps are understood
_WAYS = 2  # pairs of starts within what a short window leaves open
_FAR = 2.0  # standard deviations
_FAR_BEHIND = 4.0  # times the chi-square of another fit


def fit_baseline(model: ImpactModel, short: Fit | None = None) -> Fit:
    """The baseline re-tuned to the blows that are fitted, from a cold start; see `follow`.

    ``short``: what `begun` makes of it, where that is known.
    """
    model = _by_noise_alone(model)
    by_taps = _by_taps(model)
    if by_taps is not None and follows_all(by_taps):
        return by_taps
    short = _short(model, cold_starts(model)) if short is None else short
    found = follow(short)
    if not follows_all(found) and _open(short):
        found = _by_other_ways(short, found)
    return found if by_taps is None else further(found, by_taps)


def fit_unless_far_behind(model: ImpactModel, found: Fit) -> Fit | None:
    """A baseline taken otherwise; None where its beginning alone leaves far more than a fit.

    What the first milliseconds leave at least is left of longer windows, too; of a bare contact
    they are met in either way that :func:`fit_baseline` sets out. None as well where no start of
    it can be simulated.
    """
    allowed = _FAR_BEHIND * found.chi_square
    with contextlib.suppress(SimulationError):
        short = begun(model)
        if short.chi_square > allowed:
            by_taps = _begun_by_taps(_by_noise_alone(model))
            if by_taps is None or by_taps.chi_square > allowed:
                return None
        return fit_baseline(model, short)
    return None


def begun(model: ImpactModel) -> Fit:
    """A model fitted to the first milliseconds of all blows, from a cold start."""
    model = _by_noise_alone(model)
    return _short(model, cold_starts(model))


def _short(model: ImpactModel, starts: Sequence[Array]) -> Fit:
    """The fit over the shortest windows that is best.

    Raises:
        SimulationError: none of the starts can be simulated.
    """
    blows = model.data.fitted
    starts, known = met(model, starts)
    others = [i for i in blows if i not in known]
    tried = in_processes(lambda x: placed(model, x, blows, others), starts)
    best = min((f for f in tried if f is not None), key=lambda f: f.chi_square, default=None)
    if best is None:
        raise SimulationError('the first milliseconds of the blows cannot be simulated')
    return best


def _by_taps(model: ImpactModel) -> Fit | None:
    """The fit that :func:`_begun_by_taps` leads to; None where there is none."""
    begin = _begun_by_taps(model)
    if begin is not None:
        with contextlib.suppress(ImpactscopeError, ValueError):
            return follow(begin)
    return None


def _begun_by_taps(model: ImpactModel) -> Fit | None:
    """Bare contacts met first with what the taps tell held, over the shortest windows.

    Bare contacts of a few samples are steep: free to move, everything that is known of the bench
    would be bent to meet them, and the fit not find back. None where nothing is bare, or taps
    tell nothing or miss something.
    """
    start = cold_starts(model)[0]
    blows = model.data.fitted
    taps = [i for i in blows if model.data.blows[i].recording.kind == 'tap']
    if 'contact.stiffness' not in model.values(start) or len(taps) in (0, len(blows)):
        return None
    with contextlib.suppress(ImpactscopeError, ValueError):
        layout = model.layout(taps)
        rung = fit(model, layout, start, iterations=12, settled=1.0)
        if rung.reduced > _RUNG:
            return None
        told = np.linalg.norm(rung.jacobian[: layout.size], axis=0) > 0.0
        held = {
            f.key: rung.values[f.key]
            for f, known in zip(model.free, told, strict=True)
            if f.blow is None and (known or f.key.startswith('gain.'))
        }
        alone = model.extended(constants=held)
        alone.free = tuple(f for f in model.free if f.key not in held)
        short = _short(alone, cold_starts(alone))
        x = np.array([f.to_inner(short.values[f.key]) for f in model.free])
        return fit(model, short.layout, x, iterations=12, settled=1.0)
    return None


def further(found: Fit, other: Fit) -> Fit:
    """The fit that follows the blows further; of two that go as far the one that leaves less.

    A last contact that only one of them meets is few samples, and yet the end of the way.
    """
    longer = other.layout.size > 1.02 * found.layout.size
    longer |= follows_all(other) and not follows_all(found)
    as_long = other.layout.size > 0.98 * found.layout.size
    if longer or (as_long and other.reduced < found.reduced - 1e-3):
        return other
    return found


def follows_all(found: Fit) -> bool:
    """Whether a fit follows all blows to their end and leaves no more than noise."""
    whole = found.model.layout(found.layout.blows).size
    return found.layout.size == whole and found.reduced < 1.0 + math.sqrt(2.0 / whole)


def _open(short: Fit) -> bool:
    """Whether a short window leaves a number of the bench open, as of a contact's stiffness."""
    spread = np.sqrt(np.diag(short.covariance()))
    return any(
        f.blow is None and f.logarithmic and s > (_TOLD if f.key.startswith(_STEEP) else _OPEN)
        for f, s in zip(short.model.free, spread, strict=True)
    )


def _by_other_ways(short: Fit, found: Fit) -> Fit:
    """The best of several fits that set out from what a short window leaves open.

    Where the first contacts tell a number only roughly, the moments of later bounces have several
    minima, and the nearest one need not be the right one.
    """
    reach = short.covariance_root()
    lower, upper = short.model.bounds()
    rng = np.random.default_rng(0)
    for _ in range(_WAYS):
        if not time_left('other starts of the baseline'):
            break
        step = _FAR * (reach @ rng.standard_normal(short.x.size))
        both = [np.clip(x, lower, upper) for x in (short.x + step, short.x - step)]
        for other in in_processes(lambda x: _followed_from(short, x), both):
            if other is not None:
                found = further(found, other)
        if follows_all(found):
            break
    return found


def _followed_from(short: Fit, x: Array) -> Fit | None:
    with contextlib.suppress(ImpactscopeError):
        return follow(dataclasses.replace(short, model=short.model.extended(), x=x))
    return None


def follow(found: Fit, until: float = math.inf) -> Fit:
    """A fit of a short window extended over longer ones, up to ``until`` s after the onset.

    For as long as the fit follows: where the misfit jumps, because a later contact amplifies what
    the model lacks, the fit of the window before stands.
    """
    return followed(found, SHORT[-1], until)[0]


def followed(
    found: Fit, reached: float, until: float = math.inf, *, renew: bool = True
) -> tuple[Fit, float]:
    """See `follow`; and the window, s, that was reached: ``until`` where it went to the end.

    Dozens of bounces can follow a blow. Where a longer window is not fitted as well as the one
    before, a nearer one is tried first, from which the fit may find the way. ``reached``: window
    of the fit to start from. ``renew``: what no bench repeats is estimated anew on the way.
    """
    blows = found.layout.blows
    longest = _longest(found.model, blows)
    ahead = [w for w in _GROWTH if reached < w < min(until, longest)]
    ahead.append(until)
    tries = 0
    while ahead:
        window = ahead[0]
        model = with_repeatability(found.model, found.x, blows) if renew else found.model
        settled = _SETTLED if window == until else 1.0
        grown = fit(model, model.layout(blows, window), found.x, iterations=12, settled=settled)
        near = min(window, longest)
        worse = grown.reduced > _ROUGH * max(found.reduced, 1.0)
        if worse and found.reduced < _SOUND and near > _FINEST * reached and tries < _TRIES:
            ahead.insert(0, math.sqrt(reached * near))
            tries += 1
            continue
        if grown.reduced > _FOLLOWED * max(found.reduced, 1.0):
            break
        found, reached = grown, ahead.pop(0)
    return found, reached


def _longest(model: ImpactModel, blows: Sequence[int]) -> float:
    """Time after the onset at which the last blow ends, s; taps do not count."""
    ends = [
        float(c.centres[-1]) - b.onset
        for b in (model.data.blows[i] for i in blows)
        if b.recording.kind != 'tap'
        for c in b.channels.values()
    ]
    return max(ends, default=0.0)


def held_out_fit(found: Fit, blows: Sequence[int], window: float = math.inf) -> Fit | None:
    """Blows predicted with the shared numbers of a fit; only their own unknowns are adjusted."""
    if not blows:
        return None
    values = found.values
    own = tuple(f for f in found.model.free if f.blow in blows)
    shared = {f.key: values[f.key] for f in found.model.free if f.blow not in blows}
    model = found.model.extended(constants=shared)
    model.free = own
    found_best: Fit | None = None
    for share in _RELEASES:
        short = placed(model, _released(model, share), blows, blows)
        if short is None:
            continue
        predicted = follow(short, window)
        best = found_best
        longer = best is None or predicted.layout.size > 1.02 * best.layout.size
        if best is None or longer or predicted.chi_square < best.chi_square - 1.0:
            found_best = predicted
        if found_best is not None and found_best.reduced < _PREDICTED:
            break
    if found_best is None:
        raise SimulationError('the held-out recordings cannot be simulated')
    return found_best


def _released(model: ImpactModel, share: float) -> Array:
    """Start of a fit with each release off by a share of what it is known to."""
    x = model.start()
    for j, number in enumerate(model.free):
        if number.prior is not None and number.key.startswith(('angle@', 'speed@')):
            mean, std = number.prior
            x[j] = number.to_inner(mean + share * std)
    return x


def with_repeatability(
    model: ImpactModel, x: Array, chosen: Sequence[int] | None = None
) -> ImpactModel:
    """The model with what no bench repeats counted as noise.

    Every further contact amplifies the smallest difference of speed: where a relative change of
    ``_REPEATABLE`` would be seen, a bin tells less than its noise says.
    """
    values = model.values(x)
    blows = []
    for i, blow in enumerate(model.data.blows):
        key = next((k for k in (f'angle@{i}', f'speed@{i}') if k in values), None)
        if key is None or (chosen is not None and i not in chosen):
            blows.append(blow)
            continue
        here = model.predict(values, i)
        there = model.predict({**values, key: values[key] * (1 + _REPEATABLE)}, i)
        channels = {}
        for name, channel in blow.channels.items():
            change = np.abs(there.means[name] - here.means[name])
            change = ndimage.maximum_filter1d(change, 5)
            std = np.where(channel.used, np.hypot(channel.own_std, change), 1.0)
            channels[name] = dataclasses.replace(channel, std=std)
        blows.append(dataclasses.replace(blow, channels=channels))
    data = dataclasses.replace(model.data, blows=tuple(blows))
    return dataclasses.replace(model, data=data)


def _by_noise_alone(model: ImpactModel) -> ImpactModel:
    """The model with bins that count by their noise, whatever a bench repeats."""
    blows = tuple(
        dataclasses.replace(
            b,
            channels={n: dataclasses.replace(c, std=c.own_std) for n, c in b.channels.items()},
        )
        for b in model.data.blows
    )
    return dataclasses.replace(model, data=dataclasses.replace(model.data, blows=blows))
