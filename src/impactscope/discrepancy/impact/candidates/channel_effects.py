"""What a measuring chain may do to a channel: filters, hum, limits, clocks, drifts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.candidates.motion_scales import MotionScales
from impactscope.discrepancy.impact.models.bench_model import PHASE, ActiveEffect, Free
from impactscope.discrepancy.impact.models.measuring_chain import HIGHEST, LOWEST_AHEAD
from impactscope.physics.mechanisms.mechanism import Mechanism
from impactscope.physics.mechanisms.registry import mechanism

__all__ = ['chain_candidates', 'cutoff_of', 'delay_of', 'delays_like', 'of_several']

_FILTERS = ((1, 0), (2, 0), (4, 0), (1, 1), (2, 1), (4, 1))  # order, zero phase, tried at first
_ALL_FILTERS = tuple((order, zero_phase) for zero_phase in (0, 1) for order in (1, 2, 3, 4))
# filters before sampling, tried at first: order, zero phase, cut-offs to start from, of the
# sampling rate; of one with a phase little more than its delay is seen, whatever its order
_AHEAD = ((2, 0, (0.25, 0.7, 2.0)), (1, 1, (0.5, 1.0)), (2, 1, (0.5, 1.0)))
_FAR = 100.0  # of the sampling rate, above which a filter does nothing that is seen
_ORDER_DOUBT = 2.0  # for each order of a filter: the lowest that explains as much stands
_DELAYS = {1: 1.0, 2: 1.4142, 3: 2.0, 4: 2.6131}  # of a Butterworth filter, over 1 / (2 pi cutoff)


def chain_candidates(kind: Mechanism, channel: str, scales: MotionScales) -> Iterator[Candidate]:
    """One mechanism of the measuring chain in a channel, in each of its forms."""
    active = ActiveEffect(kind.name, channel)
    tag = active.tag
    common = {
        'name': kind.name,
        'subsystem': kind.subsystem.value,
        'effects': (active,),
        'channel': channel,
    }
    noise = scales.model.data.noise[channel]
    rate = scales.rates[channel]
    if kind.name == 'low_pass_filter':
        cutoffs = [f for f in (30.0, 100.0, 300.0, 1000.0, 3000.0) if f < 0.9 * HIGHEST * rate]
        for order, zero_phase in _FILTERS:
            yield _low_pass(channel, order, zero_phase, rate, cutoffs)
        for order, zero_phase, shares in _AHEAD:
            cutoffs = [share * rate for share in shares]
            yield _low_pass_ahead(channel, order, zero_phase, rate, cutoffs)
    elif kind.name == 'mains_hum':
        free = [Free(f'{tag}.frequency', 50.0, 0.02, 10.0, 1000.0)]
        free += [
            Free(f'{tag}.{part}@{i}', 0.0, noise, blow=i)
            for i in range(len(scales.model.data.blows))
            for part in PHASE
        ]
        frequencies = dict.fromkeys((50.0, 60.0, *scales.resonances.get(channel, ())[:2]))
        parts = {f.key: noise for f in free[1:]}
        yield Candidate(
            label=tag,
            free=tuple(free),
            constants={f'{tag}.amplitude': 0.0, f'{tag}.phase': 0.0},
            starts=tuple({f'{tag}.frequency': f, **parts} for f in frequencies),
            amplitudes=dict.fromkeys(parts, 0.0),
            fitted=scales.model.data.fitted,
            **common,  # type: ignore[arg-type]
        )
    elif kind.name == 'saturation':
        key = f'{tag}.limit'
        peak = max(scales.peak[channel], noise)
        yield Candidate(
            label=tag,
            free=(Free(key, peak, 0.02, 0.05 * peak, 1.2 * peak, logarithmic=True),),
            starts=tuple({key: s * peak} for s in (0.999, 0.97, 0.85, 0.6)),
            **common,  # type: ignore[arg-type]
        )
    elif kind.name == 'clock_error':
        several = of_several(channel, scales.model.data.channels)
        yield _clock(channel, drifts=False, of_several=several)
        yield _clock(channel, drifts=True, of_several=several)
    else:
        yield from _plain_chain(kind, tag, noise, common)


def _low_pass(
    channel: str, order: int, zero_phase: int, rate: float, cutoffs: Sequence[float]
) -> Candidate:
    """A filter of samples."""
    active = ActiveEffect('low_pass_filter', channel)
    tag, kind = active.tag, mechanism('low_pass_filter')
    key = f'{tag}.cutoff'
    return Candidate(
        label=f'{tag} of order {order}{", zero phase" if zero_phase else ""}',
        name=kind.name,
        subsystem=kind.subsystem.value,
        free=(Free(key, 300.0, 0.05, 1.0, HIGHEST * rate, logarithmic=True),),
        effects=(active,),
        constants={f'{tag}.order': order, f'{tag}.zero_phase': zero_phase},
        starts=tuple({key: f} for f in cutoffs),
        channel=channel,
        doubt=_ORDER_DOUBT * (order - 1),
        sampled={key: rate},
    )


def _low_pass_ahead(
    channel: str, order: int, zero_phase: int, rate: float, cutoffs: Sequence[float]
) -> Candidate:
    """A filter that acts before samples are taken; its cut-off may be above half their rate.

    Hardly anybody builds one that passes many times what the samples can show: where only a delay
    is left of it, a clock is likelier.
    """
    plain = _low_pass(channel, order, zero_phase, rate, cutoffs)
    (number,) = plain.free
    lower, upper = LOWEST_AHEAD * rate, _FAR * rate
    number = dataclasses.replace(number, start=0.5 * rate, lower=lower, upper=upper)
    constants = {**plain.constants, f'{plain.effects[0].tag}.ahead': 1.0}
    return dataclasses.replace(
        plain,
        label=f'{plain.label}, before sampling',
        free=(number,),
        constants=constants,
        amplitudes={number.key: math.inf},  # far above the signal it does next to nothing
        usual={number.key: rate},
        sampled={},
    )


def of_several(channel: str, channels: Sequence[str]) -> bool:
    """Whether a channel is one of several accelerometers, which one device samples as a rule."""
    others = [c for c in channels if c != channel and c.startswith('acceleration')]
    return channel.startswith('acceleration') and bool(others)


def _clock(channel: str, *, drifts: bool, of_several: bool) -> Candidate:
    active, kind = ActiveEffect('clock_error', channel), mechanism('clock_error')
    tag = active.tag
    offset = Free(f'{tag}.offset', 0.0, 1e-5, -0.02, 0.02)
    drift = Free(f'{tag}.drift', 0.0, 1e-4, -0.01, 0.01)
    numbers = (offset, drift) if drifts else (offset,)
    # a delay alone is as likely that of a filter, and likelier in one accelerometer of several:
    # a device is late with all its channels
    doubt = 2.0 * _ORDER_DOUBT if of_several else _ORDER_DOUBT
    return Candidate(
        label=f'{tag} {"and drift" if drifts else "offset"}',
        name=kind.name,
        subsystem=kind.subsystem.value,
        free=numbers,
        effects=(active,),
        constants={} if drifts else {drift.key: 0.0},
        starts=({offset.key: 2e-5, drift.key: 1e-5},),
        amplitudes={f.key: 0.0 for f in numbers},
        channel=channel,
        doubt=0.0 if drifts else doubt,
    )


def delay_of(order: int, cutoff: float) -> float:
    """Delay of a Butterworth filter for slow signals, s."""
    return _DELAYS[order] / (2 * math.pi * cutoff)


def cutoff_of(order: int, delay: float) -> float:
    """Cut-off of a Butterworth filter of that delay, Hz."""
    return _DELAYS[order] / (2 * math.pi * delay)


def delays_like(
    candidate: Candidate,
    values: Mapping[str, float],
    sample_rate: float,
    channels: Sequence[str],
) -> Iterator[tuple[Candidate, float]]:
    """What a fitted low-pass, or a late clock, may be as well, with its first number to start.

    Causal filters of one delay look alike, whatever their order, and a clock that is late by it;
    filters without a phase look alike at one cut-off.
    """
    channel, highest = candidate.channel, HIGHEST * sample_rate
    if candidate.name == 'clock_error':
        delay, cutoff = values[f'clock_error:{channel}.offset'], 0.5 * highest
    else:
        cutoff = values[f'low_pass_filter:{channel}.cutoff']
        delay = delay_of(round(candidate.constants[f'low_pass_filter:{channel}.order']), cutoff)
    clock = _clock(channel, drifts=False, of_several=of_several(channel, channels))
    if clock.label != candidate.label:
        yield clock, delay
    for order, zero_phase in _ALL_FILTERS:
        if zero_phase and candidate.name == 'clock_error' and delay > 0.0:
            continue  # these are not late
        if not zero_phase and delay <= 0.0:
            continue
        start = cutoff if zero_phase else cutoff_of(order, delay)
        other = _low_pass(channel, order, zero_phase, sample_rate, (start,))
        if other.label != candidate.label:
            yield other, min(start, 0.99 * highest)
        if not LOWEST_AHEAD < start / sample_rate < _FAR:
            continue
        ahead = _low_pass_ahead(channel, order, zero_phase, sample_rate, (start,))
        if ahead.label != candidate.label:
            yield ahead, start


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
