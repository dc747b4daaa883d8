"""Start values: numbers that are not known within a factor, and the moment of each blow."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from impactscope.discrepancy.impact.data.binning import BinnedChannel
from impactscope.discrepancy.impact.fits.least_squares import Fit, fit
from impactscope.discrepancy.impact.models.bench_model import ImpactModel, Layout
from impactscope.discrepancy.processes import in_processes
from impactscope.errors import ImpactscopeError

__all__ = ['SHORT', 'cold_starts', 'met', 'place', 'placed']

Array = NDArray[np.float64]

SHORT = (0.004, 0.007, 0.012)  # s after the onset
_MASS_STARTS = (0.4, 0.7, 1.1, 1.7, 2.6, 4.0)  # kg
_CONTACT_STIFFNESSES = (1e7, 2.5e7, 6e7, 1.5e8, 5e8, 2e9, 1e10)  # N/m^1.5
_BOUNCES = (0.8, 0.5, 0.25)
_MEMORIES = (1e-3, 1e-2, 0.1)  # s, in which a branch of the layer relaxes
_CONTACTS = 3  # of the starts for a bare contact, so many are fitted
_BLUR = 5e-5  # s, of a moment, at first
_CONTACT_FITS = 16  # starts for which a contact's law is fitted
_AGAIN = 3  # times that blows which were missed are placed anew
_MISSED = 2.0  # mean square of a blow's residuals, over that of the others, if it was missed
_FINE, _FINE_REACH = 1e-5, 6e-4  # s, of moments about the one that was found
_TOPS = 3  # of its moments that fit best
_EARLIER = (-4e-3, -2e-3, -1e-3)  # s, of moments about the onset
_CLOSE, _CLOSE_BEFORE, _CLOSE_AFTER = 5e-5, 5e-4, 2e-4  # s
_LONGEST_SAMPLE = 2e-3  # s: a blow that is sampled slower is not seen anyway


def cold_starts(model: ImpactModel) -> list[Array]:
    """Starts over what is not known within a factor: the plate's mass, a contact's restitution."""
    taps = [i for i in model.data.fitted if model.data.blows[i].recording.kind == 'tap']
    masses = _rung_masses(model, taps) or _MASS_STARTS
    starts = _varied(model, [model.start()], 'sensor.moving_mass', masses)
    unknown = any(f.key == 'sensor.moving_mass' and f.prior is None for f in model.free)
    if taps and unknown:  # which taps alone tell
        rung = _tapped(model, starts, taps)
        if not rung or rung[0].reduced > _MISSED:  # a ring-down that was none tells nothing
            others = _varied(model, [model.start()], 'sensor.moving_mass', _MASS_STARTS)
            rung = sorted([*rung, *_tapped(model, others, taps)], key=lambda f: f.chi_square)
        starts = [f.x for f in rung[:1]] or starts
    starts = _relaxing(model, starts)
    starts = _varied(model, starts, 'contact.stiffness', _CONTACT_STIFFNESSES)
    return _varied(model, starts, 'contact.restitution', _BOUNCES)


def _relaxing(model: ImpactModel, starts: Sequence[Array]) -> list[Array]:
    """Each start as it is, and with each way in which branches of the layer may relax.

    Fast branches and slow ones are minima of their own, and which of two is the fast one, too.
    """
    branches = [
        f.key.removesuffix('.damping')
        for f in model.free
        if f.key.startswith('damper.branches.') and f.key.endswith('.damping') and f.prior is None
    ]
    found = list(starts)
    if not branches:
        return found
    for x, times in itertools.product(starts, itertools.permutations(_MEMORIES, len(branches))):
        values = model.values(x)
        for branch, memory in zip(branches, times, strict=True):
            values[f'{branch}.damping'] = memory * values[f'{branch}.stiffness']
        found.append(model.vector(values))
    return found


def _tapped(model: ImpactModel, starts: Sequence[Array], taps: Sequence[int]) -> list[Fit]:
    """Fits to the taps alone from each start, the best first."""
    layout = model.layout(taps)

    def fitted(x: Array) -> Fit | None:
        with contextlib.suppress(ImpactscopeError):
            return fit(model, layout, place(model, x, taps), iterations=12, settled=1.0)
        return None

    tried = in_processes(fitted, starts)
    return sorted((f for f in tried if f is not None), key=lambda f: f.chi_square)


def _rung_masses(model: ImpactModel, taps: Sequence[int]) -> tuple[float, ...]:
    """Masses of the plate, kg, that the frequencies after the taps tell; none without taps.

    Of either channel: what is largest in one may be its slow noise.
    """
    stiffness = model.values(model.start())['sensor.stiffness']
    blows = [model.data.blows[i] for i in taps]
    tops = [
        _rings_at(blow.channels[name], blow.settled)
        for blow in blows
        for name in ('force', 'acceleration.plate')
        if name in blow.channels
    ]
    return tuple(sorted({round(stiffness / (2 * math.pi * top) ** 2, 4) for top in tops if top}))


def _rings_at(channel: BinnedChannel, since: float) -> float:
    """Frequency, Hz, at which a channel is strongest from a moment on; 0 where it is too short."""
    rings = np.nan_to_num(channel.samples[channel.time > since])
    if rings.size < 64:
        return 0.0
    size = 8 * rings.size
    power = np.abs(np.fft.rfft((rings - np.mean(rings)) * np.hanning(rings.size), size))
    return float(np.fft.rfftfreq(size, 1.0 / channel.sample_rate)[int(np.argmax(power))])


def met(model: ImpactModel, starts: Sequence[Array]) -> tuple[list[Array], list[int]]:
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
    layout = soft.layout(bare, SHORT[0])

    def near(x: Array) -> tuple[float, Array]:
        with contextlib.suppress(ImpactscopeError):
            moved = place(soft, x, bare, SHORT[0])
            residuals = soft.residuals(moved, layout)
            return float(residuals @ residuals), moved
        return math.inf, x

    def fitted(start: tuple[float, Array]) -> tuple[float, Array]:
        with contextlib.suppress(ImpactscopeError):
            return _contact_alone(soft, start[1], bare)
        return math.inf, start[1]

    placed_ones = sorted(in_processes(near, starts), key=lambda item: item[0])
    placed_ones = [p for p in placed_ones[:_CONTACT_FITS] if p[0] < math.inf]
    tried = sorted(in_processes(fitted, placed_ones), key=lambda item: item[0])
    return [x for cost, x in tried[:_CONTACTS] if cost < math.inf], bare


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
    found = fit(alone, alone.layout(blows, SHORT[0]), start, iterations=8, settled=1.0)
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


def placed(
    model: ImpactModel, x: Array, blows: Sequence[int], unplaced: Sequence[int]
) -> Fit | None:
    """Fits over the shortest windows from a start, blows first placed where they fit best."""
    model = model.extended()  # of which others know nothing: starts are tried side by side
    try:
        soft = _blurred(model)
        x = place(soft, x, unplaced, SHORT[0])
        for window in SHORT:
            x = fit(soft, soft.layout(blows, window), x, iterations=8, settled=1.0).x
        found = fit(model, model.layout(blows, SHORT[-1]), x, iterations=12, settled=1.0)
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
        part = alone.layout((i,), SHORT[-1])
        place_of_time = alone.index(f'time@{i}')
        fitted = np.array([f.to_inner(values[f.key]) for f in own])
        # a blow that is lost may have drawn its release along
        stated = np.array([f.to_inner(f.prior[0] if f.prior else values[f.key]) for f in own])
        reach = max(_FINE_REACH, _sample(model, i))
        tops = [
            top for x in (fitted, stated) for top in _troughs(alone, part, x, place_of_time, reach)
        ]
        for _, trial in sorted(tops, key=lambda c: c[0])[:_TOPS]:
            with contextlib.suppress(ImpactscopeError):
                better = fit(alone, part, trial, iterations=10, settled=1.0)
                if better.chi_square < 0.8 * misfit[i] * part.size:
                    misfit[i] = better.chi_square / part.size
                    moved = found.x.copy() if moved is None else moved
                    for number, inner in zip(own, better.x, strict=True):
                        moved[model.index(number.key)] = inner
    return moved


def _troughs(
    model: ImpactModel, layout: Layout, x: Array, place_of_time: int, reach: float
) -> list[tuple[float, Array]]:
    """Moments about a start from which chi-square rises to either side, with chi-square there."""
    costs = []
    for shift in np.arange(-reach, reach + 0.5 * _FINE, _FINE).tolist():
        trial = x.copy()
        trial[place_of_time] += shift
        with contextlib.suppress(ImpactscopeError):
            residual = model.residuals(trial, layout)
            costs.append((float(residual @ residual), trial))
    threes = zip(costs, costs[1:], costs[2:], strict=False)
    return [c for before, c, after in threes if c[0] < min(before[0], after[0])]


def place(model: ImpactModel, x: Array, chosen: Sequence[int], window: float = 0.012) -> Array:
    """``x`` with the moment of each chosen blow where a short simulation fits best."""
    layout = model.layout(chosen, window)
    best = np.full(len(model.data.blows), math.inf)
    moved = x.copy()
    after = max(_CLOSE_AFTER, max((_sample(model, i) for i in layout.blows), default=0.0))
    close = np.arange(-_CLOSE_BEFORE, after + 0.5 * _CLOSE, _CLOSE).tolist()
    for shift in (*_EARLIER, *close):
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
                moved[model.index(f'time@{i}')] = trial[model.index(f'time@{i}')]
    return moved


def _sample(model: ImpactModel, i: int) -> float:
    """Time between samples of a blow, s: what is seen first may begin as much later."""
    fastest = max(c.sample_rate for c in model.data.blows[i].channels.values())
    return min(1.0 / fastest, _LONGEST_SAMPLE)
