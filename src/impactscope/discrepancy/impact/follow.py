"""Fits that follow a blow from its first milliseconds on.

Later contacts amplify small errors of earlier ones. So a fit begins where the blow is simple, with
each blow placed in time, and follows over windows that grow.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from impactscope.discrepancy.impact.fit import Fit, fit, jacobian, projector
from impactscope.discrepancy.impact.model import ImpactModel
from impactscope.errors import ImpactscopeError
from impactscope.physics.twin.simulate import SimulationError

__all__ = [
    'fit_baseline',
    'follow',
    'followed',
    'further_misfit',
    'held_out_fit',
    'place',
    'prediction_misfit',
    'with_repeatability',
]

Array = NDArray[np.float64]

_REPEATABLE = 8e-5  # relative, of a speed
_MASS_STARTS = (0.4, 0.7, 1.1, 1.7, 2.6, 4.0)  # kg
_CONTACT_STIFFNESSES = (1e7, 2.5e7, 6e7, 1.5e8, 5e8, 2e9, 1e10)  # N/m^1.5
_BOUNCES = (0.8, 0.5, 0.25)
_CONTACTS = 3  # of the starts for a bare contact, so many are fitted
_RELEASES = (0.0, 1.0, -1.0, 2.2, -2.2)  # of the standard deviation of a release, as starts
_PREDICTED = 1.15  # reduced chi-square from which other starts are tried
_SHORT = (0.004, 0.007, 0.012)  # s after the onset
_GROWTH = (0.02, 0.03, 0.04, 0.055, 0.08, 0.12, 0.2, 0.35, 0.6, 1.0, 1.7)  # s after the onset
_ROUGH = 1.1  # growth of the reduced chi-square from which a nearer window is tried
_SOUND = 1.5  # reduced chi-square up to which that is worth while
_FINEST = 1.08  # ratio of windows that are next to each other
_TRIES = 14
_FOLLOWED = 4.0  # growth of the reduced chi-square up to which a longer window is followed
_SETTLED = 0.02  # of chi-square
_BLUR = 5e-5  # s, of a moment, at first
_CONTACT_FITS = 16  # starts for which a contact's law is fitted
_OPEN = 0.05  # relative, of a number that a short window does not tell
_WAYS = 2  # pairs of starts within what a short window leaves open
_FAR = 2.0  # standard deviations
_AGAIN = 3  # times that blows which were missed are placed anew
_MISSED = 2.0  # mean square of a blow's residuals, over that of the others, if it was missed
_FINE_SHIFTS = np.arange(-6e-4, 6.05e-4, 1e-5).tolist()  # s
_TOPS = 3  # of its moments that fit best
_TIME_SHIFTS = (-4e-3, -2e-3, -1e-3, *np.arange(-5e-4, 2.1e-4, 5e-5).tolist())  # s


def fit_baseline(model: ImpactModel) -> Fit:
    """The baseline re-tuned to the blows that are fitted, from a cold start; see `follow`."""
    blows = model.data.fitted
    model = _by_noise_alone(model)
    starts, met = _met(model, _cold_starts(model))
    others = [i for i in blows if i not in met]
    tried = [_placed(model, x, blows, others) for x in starts]
    short = min((f for f in tried if f is not None), key=lambda f: f.chi_square)
    found = follow(short)
    if not _settled(found) and _open(short):
        found = _by_other_ways(short, found)
    return found


def _settled(found: Fit) -> bool:
    """Whether a fit follows all blows to their end and leaves no more than noise."""
    whole = found.model.layout(found.layout.blows).size
    return found.layout.size == whole and found.reduced < 1.0 + math.sqrt(2.0 / whole)


def _open(short: Fit) -> bool:
    """Whether a short window leaves a number of the bench open, as of a contact's stiffness."""
    spread = np.sqrt(np.diag(short.covariance()))
    return any(
        f.logarithmic and f.blow is None and s > _OPEN
        for f, s in zip(short.model.free, spread, strict=True)
    )


def _by_other_ways(short: Fit, found: Fit) -> Fit:
    """The best of several fits that set out from what a short window leaves open.

    Where the first contacts tell a number only roughly, the moments of later bounces have several
    minima, and the nearest one need not be the right one.
    """
    power, vectors = np.linalg.eigh(short.covariance())
    reach = vectors * np.sqrt(np.maximum(power, 0.0))
    lower, upper = short.model.bounds()
    rng = np.random.default_rng(0)
    for _ in range(_WAYS):
        step = _FAR * (reach @ rng.standard_normal(power.size))
        for x in (short.x + step, short.x - step):
            start = dataclasses.replace(short, x=np.clip(x, lower, upper))
            with contextlib.suppress(ImpactscopeError):
                other = follow(start)
                longer = other.layout.size > 1.02 * found.layout.size
                as_long = other.layout.size > 0.98 * found.layout.size
                if longer or (as_long and other.reduced < found.reduced - 1e-3):
                    found = other
            if _settled(found):
                return found
    return found


def follow(found: Fit, until: float = math.inf) -> Fit:
    """A fit of a short window extended over longer ones, up to ``until`` s after the onset.

    For as long as the fit follows: where the misfit jumps, because a later contact amplifies what
    the model lacks, the fit of the window before stands.
    """
    return followed(found, _SHORT[-1], until)[0]


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
        short = _placed(model, _released(model, share), blows, blows)
        if short is None:
            continue
        predicted = follow(short, window)
        best = found_best
        further = best is None or predicted.layout.size > 1.02 * best.layout.size
        if best is None or further or predicted.chi_square < best.chi_square - 1.0:
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


def further_misfit(before: tuple[Fit, Fit], after: tuple[Fit, Fit]) -> float:
    """Rise of chi-square from one prediction to another, over the bins that both have.

    Each is a fit and its prediction of recordings that were held out. What the fit does not know
    of its numbers for certain is no fault of its prediction, however later contacts amplify it:
    chi-square is that of the marginal distribution.
    """
    old, new = before[1], after[1]
    rows: tuple[list[Array], list[Array]] = ([], [])
    for (i, name), span in new.layout.spans.items():
        masks = [f.layout.masks[i, name] for f in (old, new)]
        both = masks[0] & masks[1]
        spread = [f.model.data.blows[i].channels[name].std[both] for f in (old, new)]
        spans = old.layout.spans[i, name], span
        for k, part in enumerate(rows):
            # each by the larger uncertainty: where one cannot tell, neither counts
            weight = np.zeros(spans[k].stop - spans[k].start)
            weight[both[masks[k]]] = spread[k] / np.maximum(*spread)
            part.append(weight)
    return _surprise(*after, np.concatenate(rows[1])) - _surprise(*before, np.concatenate(rows[0]))


def prediction_misfit(found: Fit, predicted: Fit) -> float:
    """Reduced chi-square of a prediction, allowing for what the fit knows not of its numbers."""
    size = predicted.layout.size
    surprise = _surprise(found, predicted, np.ones(size))
    return surprise / max(size - predicted.x.size, 1)


def _surprise(found: Fit, predicted: Fit, weight: Array) -> float:
    """Chi-square of a prediction, what is unknown of the shared numbers taken into account."""
    layout = predicted.layout
    model = dataclasses.replace(found.model, data=predicted.model.data)
    values = {**found.values, **predicted.values}
    x = np.array([f.to_inner(values[f.key]) for f in model.free])
    shared = [j for j, f in enumerate(model.free) if f.blow is None]
    residuals = model.residuals(x, layout)
    slopes = jacobian(model, x, layout, residuals, only=shared)[: layout.size, shared]
    own = projector(weight[:, None] * predicted.jacobian[: layout.size])
    left = weight * residuals[: layout.size]
    left = left - own @ (own.T @ left)
    power, vectors = np.linalg.eigh(found.covariance()[np.ix_(shared, shared)])
    reach = weight[:, None] * (slopes @ (vectors * np.sqrt(np.maximum(power, 0.0))))
    reach = reach - own @ (own.T @ reach)
    along = reach.T @ left
    inner = np.eye(along.size) + reach.T @ reach
    return float(left @ left - along @ np.linalg.solve(inner, along))


def _cold_starts(model: ImpactModel) -> list[Array]:
    """Starts over what is not known within a factor: the plate's mass, a contact's restitution."""
    taps = [i for i in model.data.fitted if model.data.blows[i].recording.kind == 'tap']
    masses = _rung_masses(model, taps) or _MASS_STARTS
    starts = _varied(model, [model.start()], 'sensor.moving_mass', masses)
    if taps and len(starts) > 1:  # taps alone tell the mass
        rung = []
        for x in starts:
            with contextlib.suppress(ImpactscopeError):
                placed = place(model, x, taps)
                rung.append(fit(model, model.layout(taps), placed, iterations=12, settled=1.0))
        if rung:
            starts = [min(rung, key=lambda f: f.chi_square).x]
    starts = _varied(model, starts, 'contact.stiffness', _CONTACT_STIFFNESSES)
    return _varied(model, starts, 'contact.restitution', _BOUNCES)


def _rung_masses(model: ImpactModel, taps: Sequence[int]) -> tuple[float, ...]:
    """Masses of the plate, kg, that the frequencies after the taps tell; none without taps."""
    stiffness = model.values(model.start())['sensor.stiffness']
    found = set()
    for i in taps:
        blow = model.data.blows[i]
        channel = blow.channels.get('acceleration.plate', blow.channels.get('force'))
        if channel is None:
            continue
        rings = np.nan_to_num(channel.samples[channel.time > blow.settled])
        if rings.size < 64:
            continue
        size = 8 * rings.size
        power = np.abs(np.fft.rfft((rings - np.mean(rings)) * np.hanning(rings.size), size))
        frequency = np.fft.rfftfreq(size, 1.0 / channel.sample_rate)
        top = float(frequency[int(np.argmax(power))])
        if top > 0.0:
            found.add(round(stiffness / (2 * math.pi * top) ** 2, 4))
    return tuple(sorted(found))


def _met(model: ImpactModel, starts: Sequence[Array]) -> tuple[list[Array], list[int]]:
    """The starts that come closest to bare contacts, and the blows that they meet already.

    A contact of a millisecond is so steep that everything else would be bent to meet it before
    its stiffness is known within a factor of two. So its law is fitted alone first.
    """
    layered = 'damper.parallel_stiffness' in model.values(model.start())
    bare = [
        i
        for i in model.data.fitted
        if (r := model.data.blows[i].recording).kind != 'tap' and not (r.damper and layered)
    ]
    if not bare:
        return list(starts), []
    soft = _blurred(model)
    layout = soft.layout(bare, _SHORT[0])
    placed = []
    for x in starts:
        with contextlib.suppress(ImpactscopeError):
            moved = place(soft, x, bare, _SHORT[0])
            residuals = soft.residuals(moved, layout)
            placed.append((float(residuals @ residuals), moved))
    placed.sort(key=lambda item: item[0])
    tried = []
    for _, x in placed[:_CONTACT_FITS]:
        with contextlib.suppress(ImpactscopeError):
            tried.append(_contact_alone(soft, x, bare))
    tried.sort(key=lambda item: item[0])
    return [x for _, x in tried[:_CONTACTS]], bare


def _contact_alone(model: ImpactModel, x: Array, blows: Sequence[int]) -> tuple[float, Array]:
    """Chi-square and start once only the contact's law and the moments were fitted."""
    values = model.values(x)
    own = tuple(
        f
        for f in model.free
        if f.key.startswith('contact.') or (f.blow in blows and f.key.startswith('time@'))
    )
    alone = model.extended(constants={f.key: values[f.key] for f in model.free if f not in own})
    alone.free = own
    start = np.array([f.to_inner(values[f.key]) for f in own])
    found = fit(alone, alone.layout(blows, _SHORT[0]), start, iterations=8, settled=1.0)
    moved = x.copy()
    for number, value in zip(own, found.x, strict=True):
        moved[model.index(number.key)] = value
    return found.chi_square, moved


def _varied(
    model: ImpactModel, starts: Sequence[Array], key: str, values: Sequence[float]
) -> list[Array]:
    """Each start with each value of a number; as they are where the number is known."""
    number = next((f for f in model.free if f.key == key and f.prior is None), None)
    if number is None:
        return list(starts)
    varied = []
    for x, value in itertools.product(starts, values):
        moved = x.copy()
        moved[model.index(key)] = number.to_inner(value)
        varied.append(moved)
    return varied


def _placed(
    model: ImpactModel, x: Array, blows: Sequence[int], unplaced: Sequence[int]
) -> Fit | None:
    """Fits over the shortest windows from a start, blows first placed where they fit best."""
    try:
        soft = _blurred(model)
        x = place(soft, x, unplaced, _SHORT[0])
        for window in _SHORT:
            x = fit(soft, soft.layout(blows, window), x, iterations=8, settled=1.0).x
        found = fit(model, model.layout(blows, _SHORT[-1]), x, iterations=12, settled=1.0)
        for _ in range(_AGAIN):
            moved = _missed(found)
            if moved is None:
                break
            again = fit(model, found.layout, moved, iterations=12, settled=1.0)
            if again.chi_square >= found.chi_square:
                break
            found = again
    except ImpactscopeError:
        return None
    return found


def _blurred(model: ImpactModel) -> ImpactModel:
    """The model with samples that count by how much a moment off would change them, too.

    A contact of a few samples is otherwise met by bending all that is known of the bench.
    """
    blows = []
    for blow in model.data.blows:
        channels = {}
        for name, channel in blow.channels.items():
            change = np.abs(np.diff(channel.means, append=channel.means[-1:]))
            change = ndimage.maximum_filter1d(change, 3)
            shift = np.minimum(_BLUR * channel.sample_rate / channel.counts, 1.0)
            std = np.where(channel.used, np.hypot(channel.own_std, shift * change), 1.0)
            channels[name] = dataclasses.replace(channel, std=std, own_std=std)
        blows.append(dataclasses.replace(blow, channels=channels))
    return dataclasses.replace(model, data=dataclasses.replace(model.data, blows=tuple(blows)))


def _missed(found: Fit) -> Array | None:
    """Numbers with the blows that were missed placed anew; None where that helps none.

    In a bare contact of three samples a blow that is placed a sample too late is a minimum of its
    own. What the other blows tell of the bench lets it be placed rightly.
    """
    model, layout, moved = found.model, found.layout, None
    misfit = {i: float(np.mean(found.residuals[layout.blow_spans[i]] ** 2)) for i in layout.blows}
    allowed = _MISSED * max(1.0, float(np.median(list(misfit.values()))) if len(misfit) > 2 else 1)
    values = found.values
    for i in layout.blows:
        if misfit[i] < allowed or model.data.blows[i].recording.kind == 'tap':
            continue
        own = tuple(f for f in model.free if f.blow == i)
        alone = model.extended(constants={f.key: values[f.key] for f in model.free})
        alone.free = own
        part = alone.layout((i,), _SHORT[-1])
        place_of_time = alone.index(f'time@{i}')
        start = np.array([f.to_inner(values[f.key]) for f in own])
        costs = []
        for shift in _FINE_SHIFTS:
            trial = start.copy()
            trial[place_of_time] += shift
            with contextlib.suppress(ImpactscopeError):
                residual = alone.residuals(trial, part)
                costs.append((float(residual @ residual), trial))
        tops = [c for c, a, b in zip(costs[1:-1], costs, costs[2:], strict=False)
                if c[0] < min(a[0], b[0])]  # fmt: skip
        for _, trial in sorted(tops, key=lambda c: c[0])[:_TOPS]:
            with contextlib.suppress(ImpactscopeError):
                better = fit(alone, part, trial, iterations=10, settled=1.0)
                if better.chi_square < 0.8 * misfit[i] * part.size:
                    misfit[i] = better.chi_square / part.size
                    moved = found.x.copy() if moved is None else moved
                    for number, inner in zip(own, better.x, strict=True):
                        moved[model.index(number.key)] = inner
    return moved


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


def place(model: ImpactModel, x: Array, chosen: Sequence[int], window: float = 0.012) -> Array:
    """``x`` with the moment of each chosen blow where a short simulation fits best."""
    layout = model.layout(chosen, window)
    best = np.full(len(model.data.blows), math.inf)
    placed = x.copy()
    for shift in _TIME_SHIFTS:
        trial = x.copy()
        for i in layout.blows:
            trial[model.index(f'time@{i}')] = model.data.blows[i].onset + shift
        try:
            values = model.values(trial)
            costs = {i: model.blow_residuals(values, i, layout) for i in layout.blows}
        except ImpactscopeError:
            continue
        for i, residual in costs.items():
            cost = float(residual @ residual)
            if cost < best[i]:
                best[i] = cost
                placed[model.index(f'time@{i}')] = trial[model.index(f'time@{i}')]
    return placed
