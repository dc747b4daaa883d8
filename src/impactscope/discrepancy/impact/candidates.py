"""What could be missing from a model of the bench: every mechanism, and every stated number.

Candidates are made from the registry of mechanisms: a further mechanism is a further candidate,
without a word here. Only where start values depend on the recordings (travel, resonances) does
this module know a parameter by its name.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.impact.baseline import STRUCTURE, implied_shares
from impactscope.discrepancy.impact.fit import Fit
from impactscope.discrepancy.impact.model import ActiveEffect, Free, ImpactModel
from impactscope.physics.mechanisms.mechanism import Mechanism, Parameter
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism
from impactscope.physics.twin import layout as at

__all__ = ['Candidate', 'candidates', 'filters_like', 'kin_of', 'stronger']

Array = NDArray[np.float64]

_DIRECT = ('quantisation',)  # seen in the samples themselves, not by a fit
_KEPT = {  # parameters that are not fitted: nothing on this bench tells them
    'external_push': ('hold', 'fall'),
}
_VANISHES = {'base_compliance': 'mass'}  # numbers at whose infinity an effect is absent
_RINGS_ON = ('base_compliance',)  # effects with a motion of their own, which a tap excites
_PULSE_KNOWN = 0.3  # relative, of a tap's duration
_RINGS = tuple(float(f) for f in np.geomspace(20.0, 600.0, 25))  # Hz, where a part may ring
_MOST_STARTS = 32  # of a candidate
_FILTERS = ((1, 0), (2, 0), (4, 0), (1, 1), (2, 1), (4, 1))  # order, zero phase, tried at first
_ALL_FILTERS = tuple((order, zero_phase) for zero_phase in (0, 1) for order in (1, 2, 3, 4))
_ORDER_DOUBT = 2.0  # for each order of a filter: the lowest that explains as much stands
_DELAYS = {1: 1.0, 2: 1.4142, 3: 2.0, 4: 2.6131}  # of a Butterworth filter, over 1 / (2 pi cutoff)
_LIKE_A_NUMBER = {  # what acts as a wrong number of the baseline may
    'damper': ('rate_dependent_damper', 'stiffening_damper'),
    'pendulum': ('impact_speed_loss',),
}
_RINGING = 0.3  # s after the onset in which resonances are looked for
_LARGEST_FREQUENCY = 1500.0  # Hz


@dataclass(frozen=True, slots=True)
class Candidate:
    """Something that may be missing: what it adds to a model and where to start.

    ``starts``: values from which the search sets out. ``amplitudes``: the numbers that make the
    effect vanish together when they reach ``absent``.
    """

    label: str
    name: str
    subsystem: str
    free: tuple[Free, ...] = ()
    effects: tuple[ActiveEffect, ...] = ()
    constants: Mapping[str, float] = field(default_factory=dict)
    starts: tuple[Mapping[str, float], ...] = ({},)
    amplitudes: Mapping[str, float] = field(default_factory=dict)  # key to absent value
    channel: str = ''
    recording: str = ''
    parameter: str = ''  # of the baseline, where that is what is wrong
    doubt: float = 0.0  # -2 log of its prior probability among its like

    @property
    def cost(self) -> int:
        """Number of further numbers of which nothing is known; at least one."""
        return max(1, sum(f.prior is None for f in self.free))

    def extend(self, model: ImpactModel) -> ImpactModel:
        """The model with this candidate in it."""
        return model.extended(free=self.free, effects=self.effects, constants=self.constants)


def kin_of(candidate: Candidate) -> tuple[str, ...]:
    """Mechanisms of the same family; of a wrong number those that act as it does."""
    if candidate.name in all_mechanisms():
        return mechanism(candidate.name).kin
    return _LIKE_A_NUMBER.get(candidate.parameter.split('.', 1)[0], ())


def stronger(candidate: Candidate, start: Mapping[str, float], factor: float) -> dict[str, float]:
    """Values with the numbers that make the effect vanish moved away from there by a factor."""
    scaled = dict(start)
    for key, absent in candidate.amplitudes.items():
        if key not in scaled:
            continue
        if math.isinf(absent):
            scaled[key] = scaled[key] / max(factor, 1e-9)
        else:
            scaled[key] = absent + factor * (scaled[key] - absent)
    return scaled


def candidates(fit: Fit, campaign_baseline: Sequence[str]) -> list[Candidate]:
    """All candidates for a model, with starts that suit the recordings."""
    model = fit.model
    scene = _Scene(fit)
    present = {e.tag for e in model.effects}
    found: list[Candidate] = []
    for kind in all_mechanisms().values():
        if kind.name in _DIRECT or kind.name in STRUCTURE:
            continue
        if not kind.needs <= scene.there:
            continue
        if kind.on_channel:
            for channel in model.data.channels:
                if f'{kind.name}:{channel}' not in present:
                    found.extend(_chain_candidates(kind, channel, scene))
        elif kind.name not in present:
            found.extend(_bench_candidates(kind, model, scene))
    found.extend(_wrong_numbers(model))
    return [c for c in found if not _is_there(c, campaign_baseline)]


def _is_there(candidate: Candidate, baseline: Sequence[str]) -> bool:
    return candidate.name == 'unilateral_contact' and candidate.name in baseline


class _Scene:
    """What the recordings are like: sizes, speeds, frequencies."""

    def __init__(self, fit: Fit) -> None:
        model, values = fit.model, fit.values
        self.model = model
        self.there: set[str] = set()
        self.travel, self.speed = 1e-6, 1e-6
        self.peak: dict[str, float] = {}
        for i in model.data.fitted:
            blow = model.data.blows[i]
            if blow.recording.kind != 'tap':
                self.there.add('impactor')
                damped = blow.recording.damper and 'damper.parallel_stiffness' in values
                self.there.add('damper' if damped else 'bare')
            rows = model.predict(values, i).rows
            self.travel = max(self.travel, float(np.max(rows[:, at.PLATE_POSITION])))
            self.speed = max(self.speed, float(np.max(np.abs(rows[:, at.PLATE_VELOCITY]))))
            for name, channel in blow.channels.items():
                peak = float(np.max(np.abs(channel.means)))
                self.peak[name] = max(self.peak.get(name, 0.0), peak)
        self.rates = {
            name: channel.sample_rate
            for blow in model.data.blows
            for name, channel in blow.channels.items()
        }
        self.resonances = {name: _resonances(fit, name) for name in model.data.channels}


def _resonances(fit: Fit, channel: str, count: int = 3) -> tuple[float, ...]:
    """Frequencies at which the residual of a channel is strongest, Hz."""
    total: Array | None = None
    step = 0.2 / _LARGEST_FREQUENCY
    grid = np.geomspace(8.0, _LARGEST_FREQUENCY, 240)
    for i in fit.layout.blows:
        blow = fit.model.data.blows[i]
        if channel not in blow.channels or (i, channel) not in fit.layout.spans:
            continue
        mask = fit.layout.masks[i, channel]
        residual = fit.residuals[fit.layout.spans[i, channel]]
        time = blow.channels[channel].centres[mask]
        after = (time > blow.onset) & (time < blow.onset + _RINGING)
        if np.count_nonzero(after) < 32:
            continue
        x, t = np.clip(residual[after], -50.0, 50.0), time[after]
        even = np.interp(t[0] + step * np.arange(round(_RINGING / step)), t, x - np.mean(x))
        spectrum = np.abs(np.fft.rfft(even, 4 * even.size)) ** 2
        power = np.interp(grid, np.fft.rfftfreq(4 * even.size, step), spectrum)
        total = power if total is None else total + power
    if total is None:
        return ()
    tops, _ = signal.find_peaks(total)
    tops = tops[np.argsort(total[tops])[::-1]][:count]
    return tuple(float(grid[j]) for j in tops)


# --- mechanisms of the bench -----------------------------------------------------------------


def _bench_candidates(kind: Mechanism, model: ImpactModel, scene: _Scene) -> Iterator[Candidate]:
    active = ActiveEffect(kind.name)
    kept = _KEPT.get(kind.name, ())
    vanishes = _VANISHES.get(kind.name)
    fitted = [p for p in kind.parameters if p.name not in kept]
    constants = {f'{active.tag}.{p.name}': p.default for p in kind.parameters if p.name in kept}
    starts = _starts(kind, fitted, scene)
    candidate = Candidate(
        label=kind.name,
        name=kind.name,
        subsystem=kind.subsystem.value,
        free=(
            *(_free(active.tag, p, scene) for p in fitted),
            *(_pulses(model) if kind.name in _RINGS_ON else ()),
        ),
        effects=(active,),
        constants=constants,
        starts=starts,
        amplitudes={
            f'{active.tag}.{p.name}': p.absent
            for p in fitted
            if p.absent is not None and math.isfinite(p.absent)
        }
        | {f'{active.tag}.{p.name}': math.inf for p in fitted if p.name == vanishes},
    )
    yield candidate
    shares = implied_shares(model, kind.name) if kind.name in _WEIGHTS else {}
    if shares and len(set(shares.values())) > 1:
        yield Candidate(
            label=f'{kind.name} (by geometry)',
            name=kind.name,
            subsystem=kind.subsystem.value,
            free=candidate.free,
            effects=(ActiveEffect(kind.name, shares=f'{kind.name}.share'),),
            constants={**constants, **shares},
            starts=starts,
            amplitudes=candidate.amplitudes,
        )


def _pulses(model: ImpactModel) -> Iterator[Free]:
    """Durations of the taps: what rings beside the plate tells how long the hammer pushed."""
    for i in model.data.fitted:
        blow, key = model.data.blows[i], f'tap_duration@{i}'
        if blow.recording.kind == 'tap' and key in model.constants:
            known = model.constants[key]
            longest = min(3.0 * known, 0.9 * (blow.settled - blow.onset) + 1e-3)
            yield Free(
                key,
                known,
                0.02,
                0.3 * known,
                max(longest, 1.1 * known),
                logarithmic=True,
                prior=(known, _PULSE_KNOWN * known),
                blow=i,
            )


_WEIGHTS = ('gravity_load', 'restoring_force')


def _free(tag: str, parameter: Parameter, scene: _Scene) -> Free:
    """A mechanism's parameter as a number to be fitted."""
    lower, upper = parameter.lower, parameter.upper
    middle = abs(parameter.start[len(parameter.start) // 2])
    key = f'{tag}.{parameter.name}'
    if parameter.name == 'frequency':
        upper = min(upper, 2 * _LARGEST_FREQUENCY)
    if parameter.name in ('travel', 'yield_displacement'):
        upper = min(upper, 3 * scene.travel)
    if parameter.name == 'start':
        lower, upper = 0.0, 0.6
    if parameter.name == 'rise':
        upper = 1.0
    if parameter.absent is None and parameter.logarithmic and lower > 0:
        return Free(key, middle, 0.05, lower, upper, logarithmic=True)
    if parameter.name == 'damping_ratio':
        return Free(key, middle, 0.01, 1e-3, 0.9)
    scale = 0.02 if parameter.absent == 1.0 else max(0.1 * middle, 1e-9)
    return Free(key, middle, scale, lower, upper)


def _starts(
    kind: Mechanism, fitted: Sequence[Parameter], scene: _Scene
) -> tuple[Mapping[str, float], ...]:
    lists = []
    for p in fitted:
        values: tuple[float, ...] = p.start
        if p.name == 'travel':
            values = tuple(share * scene.travel for share in (0.4, 0.6, 0.75, 0.9))
        elif p.name == 'yield_displacement':
            values = tuple(share * scene.travel for share in (0.02, 0.1, 0.4))
        elif p.name == 'speed':
            values = tuple(share * scene.speed for share in (0.02, 0.1, 0.4))
        elif p.name == 'gap':
            values = tuple(share * scene.travel for share in (0.003, 0.05))
        elif p.name == _VANISHES.get(kind.name):
            values = (100.0,)  # its strength is found by scaling
        elif p.name == 'start' and kind.name == 'external_push':
            values = (0.0, 0.05, 0.15)
        elif p.name == 'frequency':
            channel = 'acceleration.base' if 'base' in kind.name else 'acceleration.impactor'
            values = tuple(dict.fromkeys((*scene.resonances.get(channel, ()), *_RINGS)))
        elif p.absent is not None and math.isfinite(p.absent):
            values = p.start[:1]  # its strength is found by scaling
        lists.append(values)
    tag = kind.name
    combinations = itertools.islice(itertools.product(*lists), _MOST_STARTS)
    return tuple(
        {f'{tag}.{p.name}': v for p, v in zip(fitted, combination, strict=True)}
        for combination in combinations
    )


# --- measuring chain -------------------------------------------------------------------------


def _chain_candidates(kind: Mechanism, channel: str, scene: _Scene) -> Iterator[Candidate]:
    active = ActiveEffect(kind.name, channel)
    tag = active.tag
    common = {
        'name': kind.name,
        'subsystem': kind.subsystem.value,
        'effects': (active,),
        'channel': channel,
    }
    noise = scene.model.data.noise[channel]
    rate = scene.rates[channel]
    if kind.name == 'low_pass_filter':
        highest = 0.49 * rate
        cutoffs = [f for f in (30.0, 100.0, 300.0, 1000.0, 3000.0) if f < 0.9 * highest]
        for order, zero_phase in _FILTERS:
            yield _low_pass(channel, order, zero_phase, highest, cutoffs)
    elif kind.name == 'mains_hum':
        free = [Free(f'{tag}.frequency', 50.0, 0.02, 10.0, 1000.0)]
        free += [
            Free(f'{tag}.{part}@{i}', 0.0, noise, blow=i)
            for i in range(len(scene.model.data.blows))
            for part in ('sine', 'cosine')
        ]
        frequencies = dict.fromkeys((50.0, 60.0, *scene.resonances.get(channel, ())[:2]))
        parts = {f.key: noise for f in free[1:]}
        yield Candidate(
            label=tag,
            free=tuple(free),
            constants={f'{tag}.amplitude': 0.0, f'{tag}.phase': 0.0},
            starts=tuple({f'{tag}.frequency': f, **parts} for f in frequencies),
            amplitudes=dict.fromkeys(parts, 0.0),
            **common,  # type: ignore[arg-type]
        )
    elif kind.name == 'saturation':
        key = f'{tag}.limit'
        peak = max(scene.peak[channel], noise)
        yield Candidate(
            label=tag,
            free=(Free(key, peak, 0.02, 0.05 * peak, 1.2 * peak, logarithmic=True),),
            starts=tuple({key: s * peak} for s in (0.999, 0.97, 0.85, 0.6)),
            **common,  # type: ignore[arg-type]
        )
    elif kind.name == 'clock_error':
        offset = Free(f'{tag}.offset', 0.0, 1e-5, -0.02, 0.02)
        drift = Free(f'{tag}.drift', 0.0, 1e-4, -0.01, 0.01)
        for numbers in ((offset,), (offset, drift)):
            yield Candidate(
                label=f'{tag} {"offset" if len(numbers) == 1 else "and drift"}',
                free=numbers,
                constants={} if len(numbers) == 2 else {drift.key: 0.0},
                starts=({offset.key: 2e-5, drift.key: 1e-5},),
                amplitudes={f.key: 0.0 for f in numbers},
                **common,  # type: ignore[arg-type]
            )
    else:
        yield from _plain_chain(kind, tag, noise, common)


def _low_pass(
    channel: str, order: int, zero_phase: int, highest: float, cutoffs: Sequence[float]
) -> Candidate:
    active = ActiveEffect('low_pass_filter', channel)
    tag, kind = active.tag, mechanism('low_pass_filter')
    key = f'{tag}.cutoff'
    return Candidate(
        label=f'{tag} of order {order}{", zero phase" if zero_phase else ""}',
        name=kind.name,
        subsystem=kind.subsystem.value,
        free=(Free(key, 300.0, 0.05, 1.0, highest, logarithmic=True),),
        effects=(active,),
        constants={f'{tag}.order': order, f'{tag}.zero_phase': zero_phase},
        starts=tuple({key: f} for f in cutoffs),
        channel=channel,
        doubt=_ORDER_DOUBT * (order - 1),
    )


def filters_like(
    candidate: Candidate, values: Mapping[str, float], sample_rate: float
) -> Iterator[tuple[Candidate, float]]:
    """Every low-pass filter that a fitted one, or a late clock, may be; with its cut-off to start.

    Causal filters of one delay look alike, whatever their order; those without a phase of one
    cut-off.
    """
    channel, highest = candidate.channel, 0.49 * sample_rate
    if candidate.name == 'clock_error':
        delay, cutoff = values[f'clock_error:{channel}.offset'], 0.5 * highest
    else:
        cutoff = values[f'low_pass_filter:{channel}.cutoff']
        delay = _DELAYS[round(candidate.constants[f'low_pass_filter:{channel}.order'])]
        delay = delay / (2 * math.pi * cutoff)
    for order, zero_phase in _ALL_FILTERS:
        if not zero_phase and delay <= 0.0:
            continue
        start = cutoff if zero_phase else _DELAYS[order] / (2 * math.pi * delay)
        other = _low_pass(channel, order, zero_phase, highest, (start,))
        if other.label != candidate.label:
            yield other, min(start, 0.99 * highest)


def _plain_chain(
    kind: Mechanism, tag: str, noise: float, common: Mapping[str, object]
) -> Iterator[Candidate]:
    """Effects of the chain that are small numbers of the channel's unit, or a corner."""
    free, start = [], {}
    for p in kind.parameters:
        key = f'{tag}.{p.name}'
        trial = 0.3 if p.unit == 'Hz' else noise
        start[key] = trial
        free.append(Free(key, trial, trial, p.lower, p.upper))
    yield Candidate(
        label=tag,
        free=tuple(free),
        starts=(start,),
        amplitudes={f.key: 0.0 for f in free},
        **common,  # type: ignore[arg-type]
    )


# --- wrong numbers of the baseline -------------------------------------------------------------


def _wrong_numbers(model: ImpactModel) -> Iterator[Candidate]:
    """Stated numbers that may be wrong: constants set free, and priors let go."""
    values = model.values(model.start())
    for number in model.free:
        if number.prior is None or number.key.startswith('tap_'):
            continue
        recording = '' if number.blow is None else model.data.blows[number.blow].name
        if number.blow is not None and number.blow not in model.data.fitted:
            continue
        freed = Free(
            number.key,
            number.start,
            number.scale,
            number.lower,
            number.upper,
            number.logarithmic,
            None,
            number.blow,
        )
        yield Candidate(
            label=f'wrong {number.key}',
            name='wrong_parameter',
            subsystem='parameter',
            free=(freed,),
            parameter=number.key,
            recording=recording,
        )
    for key, value in model.constants.items():
        stated = key.startswith(('sensor.', 'damper.', 'pendulum.', 'mass_distance@'))
        place = key.startswith('mass_distance@')  # that may be nought
        if not stated or not (value > 0 or place):
            continue
        blow = int(key.split('@')[1]) if '@' in key else None
        if blow is not None and blow not in model.data.fitted:
            continue
        yield Candidate(
            label=f'wrong {key}',
            name='wrong_parameter',
            subsystem='parameter',
            free=(
                Free(key, value, 0.005, 0.0, 0.6, blow=blow)
                if place
                else Free(key, value, 0.02, value / 20, value * 20, logarithmic=True, blow=blow),
            ),
            starts=({key: value + 0.005 if place else 1.05 * value},),
            amplitudes={key: value},
            parameter=key,
            recording='' if blow is None else model.data.blows[blow].name,
        )
    swings = any(b.recording.kind == 'pendulum' for b in model.data.blows)
    if swings and 'pendulum.contact_distance' in values:
        yield from _other_orientation(model)


def _other_orientation(model: ImpactModel) -> Iterator[Candidate]:
    """The label of the bench's orientation is wrong: speed and weight change.

    A hanging pendulum is pulled back to where it hit, unless it is caught or led.
    """
    other = 1.0 - model.constants['orientation']
    missing = 'restoring_force' if other > 0.5 else 'gravity_load'
    parameter = 'stiffness' if other > 0.5 else 'force'
    effects: tuple[ActiveEffect, ...] = ()
    constants: dict[str, float] = {'orientation': other}
    if missing not in {e.name for e in model.effects}:
        effects = (ActiveEffect(missing),)
        constants[f'{missing}.{parameter}'] = math.nan
    whole = Candidate(
        label='wrong orientation',
        name='wrong_parameter',
        subsystem='parameter',
        effects=effects,
        constants=constants,
        parameter='orientation',
    )
    yield whole
    if effects and missing == 'restoring_force':
        yield dataclasses.replace(
            whole,
            label='wrong orientation, nothing pulls back',
            effects=(),
            constants={'orientation': other},
        )
