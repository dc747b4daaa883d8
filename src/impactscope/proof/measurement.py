"""From the motion of the bench to the samples of its channels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.signal import (
    bilinear,
    butter,
    cont2discrete,
    lfilter,
    sosfilt,
    sosfiltfilt,
    ss2tf,
    tf2sos,
    zpk2ss,
)

from .axis import Motion, between, follow, run_free
from .given_course import course, device_force
from .integrator import COLUMNS, integrate
from .noise import Colour, Whitening, noise
from .scenario import STRIKES, Blow, Chain, Scenario
from .trajectories import position

__all__ = [
    'INPUTS',
    'REFERENCE',
    'REPEATABLE',
    'input_channel',
    'measure',
    'noise_free',
    'reference_channel',
    'whitened',
]

Array = NDArray[np.float64]

INPUTS = {  # what is recorded beside the responses, by kind of campaign
    'driven': 'force.hammer',
    'closed_loop': 'force.drive',
    'prescribed': 'displacement.piston',
    'chain': 'acceleration.raw',
}
REFERENCE = 'displacement.reference'  # what an axis is to follow, recorded beside its input
SLOW = 0.002  # cut-off over the rate, up to which the bilinear transform bends it by 1e-5
RELEASE = 0.01  # s, in which the pendulum is let go
FINE_RATE = 40e3  # Hz at least, at which what is slow in a chain is followed
FAST_RATE = 320e3  # likewise low passes: blows on metal are over within a millisecond
REPEATABLE = 1e-4  # of an impact speed: what no bench repeats and no two simulations agree on
_CONTINUED = 3  # samples beyond an end, over the coefficients of a filter; the usual number
_SETTLING = 1.0  # s in which an axis comes to rest before its recording begins
_REACH = 1e-3  # s around a sample in which a contact may fall


def noise_free(blow: Blow, scenario: Scenario) -> dict[str, Array]:
    """Samples of every response channel as the chain gives them without noise.

    Saturation is in them, quantisation is not: it belongs behind the noise.
    """
    groups: dict[tuple[float, float, float], list[str]] = {}
    factors = {}
    for name in scenario.channels:
        chain, rate = scenario.chains[name], scenario.rates[name]
        factors[name] = (
            math.ceil(_fine_rate(scenario, chain) / rate)
            if chain.cutoff or chain.corner or chain.resonance
            else 1
        )
        key = rate * factors[name], chain.clock_offset, chain.clock_drift
        groups.setdefault(key, []).append(name)
    result = {}
    for (rate, offset, drift), names in groups.items():
        stamps = np.arange(math.ceil(blow.duration * rate)) / rate
        signals = _signals(blow, stamps + offset + drift * stamps, names)
        for name, signal in signals.items():
            chain, finer = scenario.chains[name], factors[name]
            coarse = _filtered(signal, chain, rate, finer)[::finer]
            t = stamps[::finer]
            result[name] = _shifted(coarse, t, chain, blow.hum_phase)
    return {name: result[name] for name in scenario.channels}


def _fine_rate(scenario: Scenario, chain: Chain) -> float:
    """Hz at which a filter is followed; an axis moves slowly."""
    if scenario.kind != 'closed_loop':
        return FAST_RATE if chain.cutoff else FINE_RATE
    return min(max(8e3, 16 * chain.cutoff), FINE_RATE)


def measure(blow: Blow, scenario: Scenario, rng: np.random.Generator) -> dict[str, Array]:
    """Samples with noise, with those of the input where one is measured."""
    result = {}
    unclipped = replace(
        scenario, chains={n: c._replace(limit=0.0) for n, c in scenario.chains.items()}
    )
    for name, clean in noise_free(blow, unclipped).items():
        chain = scenario.chains[name]
        colour = scenario.colour(name)
        values = clean + noise(rng, colour, scenario.noise[name], clean.size)
        if chain.limit > 0:
            values = np.clip(values, -chain.limit, chain.limit)
        step = max(chain.step, colour.step * scenario.noise[name])
        if step > 0:
            values = step * np.round(values / step)
        result[name] = values
    if scenario.kind in INPUTS:
        name, rate = INPUTS[scenario.kind], max(scenario.rates.values())
        given = input_channel(blow, rate)
        if name in scenario.noise:  # a command has none
            given = given + rng.normal(0, scenario.noise[name], given.size)
        result[name] = given
    if scenario.kind == 'closed_loop':
        result[REFERENCE] = reference_channel(blow)
    return result


def input_channel(blow: Blow, rate: float) -> Array:
    """The driving force, the prescribed motion or the raw signal at a recording's samples."""
    if blow.kind == 'closed_loop':
        return _axis(blow).force
    t = np.arange(math.ceil(blow.duration * rate)) / rate
    if blow.kind != 'driven':
        return course(blow.waves, t)[0]
    forces = (pulse.force(t - blow.start) for pulse in blow.pulses)
    return sum(forces, start=np.zeros(t.size))


def reference_channel(blow: Blow) -> Array:
    """What an axis is to follow, at the samples of its recording; m."""
    t = np.arange(math.ceil(blow.duration * blow.law.rate)) / blow.law.rate
    return position(blow.moves, t) + course(blow.waves, t)[0]


@lru_cache(maxsize=64)
def _axis(blow: Blow) -> Motion:
    """An axis in its loop, or under the commands of the recording that leads it."""
    law = blow.law
    if blow.led_by is not None:
        led = _axis(blow.led_by)
        start = led.position[0] + blow.begin[0], led.speed[0] + blow.begin[1]
        return run_free(blow.bench, law, led.force, *start)
    before = round(_SETTLING * law.rate)
    reference = np.pad(reference_channel(blow), (before, 0), mode='edge')
    t = (np.arange(reference.size) - before) / law.rate - blow.start
    forces = (pulse.force(t) for pulse in blow.pulses)
    return follow(blow.bench, law, reference, sum(forces, start=np.zeros(t.size)), before)


def _signals(blow: Blow, t: Array, names: Sequence[str]) -> dict[str, Array]:
    """Quantities before their measuring chain, t in s after the begin of the recording."""
    if blow.kind == 'chain':
        value, _ = course(blow.waves, t)
        return dict.fromkeys(names, value)
    if blow.kind == 'prescribed':
        return dict.fromkeys(names, device_force(blow.bench, t, *course(blow.waves, t)))
    if blow.kind == 'closed_loop':
        return dict.fromkeys(names, between(_axis(blow), blow.law.rate, t))
    motion = _motion(blow, t - blow.start)
    return {name: motion[:, COLUMNS.index(name)] for name in names}


def _motion(blow: Blow, t: Array) -> Array:
    """Motion at times after first contact; before it only the impactor moves."""
    after = t >= 0
    motion = np.zeros((t.size, len(COLUMNS)))
    motion[after] = integrate(blow.bench, t[after], pulses=blow.pulses)
    motion[~after, COLUMNS.index('acceleration.impactor')] = _fall(blow, t[~after])
    return motion


def _fall(blow: Blow, t: Array) -> Array:
    """Acceleration of the impactor between release and contact, m/s²; t < 0."""
    bench = blow.bench
    if bench.impactor_mass == 0 or blow.fall <= 0:
        return np.zeros(t.size)
    pull = bench.gravity_load / bench.impactor_mass
    omega = math.sqrt(bench.restoring / bench.impactor_mass)
    free = pull * np.cos(omega * t) - omega * bench.speed * np.sin(omega * t)
    let_go = np.clip((t + blow.fall) / RELEASE, 0, 1)
    fall: Array = free * np.sin(np.pi / 2 * let_go) ** 2
    return fall


@lru_cache(maxsize=64)
def _sections(order: int, cutoff: float, rate: float) -> Array:
    """Analogue Butterworth low pass at a rate, in sections of second order.

    The bilinear transform bends frequencies: it makes a filter of 15 kHz at 40 kHz one of twice
    that to slow signals. A high cut-off is therefore exact for signals straight between samples.
    """
    if cutoff < SLOW * rate:
        low: Array = butter(order, cutoff, fs=rate, output='sos')
        return low
    a, b, c, d = zpk2ss(*butter(order, 2 * math.pi * cutoff / rate, analog=True, output='zpk'))
    above, below = ss2tf(*cont2discrete((a, b, c, d), 1.0, 'foh')[:4])
    high: Array = tf2sos(above[0], below)
    return high


def _filtered(signal: Array, chain: Chain, rate: float, finer: int = 1) -> Array:
    """A signal at a rate that is so many times that of its channel, after all that is slow.

    What runs backwards over a recording continues its ends: as far as a program does that has the
    channel's samples. The same number of finer ones would end before the filter has forgotten it.
    """
    if not (chain.cutoff or chain.corner or chain.resonance):
        return signal
    begin = signal[0]  # what was there for long has passed, or decayed behind AC coupling
    signal = signal - begin
    if chain.cutoff > 0:
        sections = _sections(chain.order, chain.cutoff, rate)
        if chain.zero_phase:
            beyond = min(_CONTINUED * (chain.order + 1) * finer, signal.size - 1)
            signal = sosfiltfilt(sections, signal, padlen=beyond)
        else:
            signal = sosfilt(sections, signal)
    if chain.resonance > 0:
        omega = 2 * np.pi * chain.resonance_frequency
        swing = bilinear([omega**2], [1.0, 0.06 * omega, omega**2], fs=rate)
        signal = (1 - chain.resonance) * signal + chain.resonance * lfilter(*swing, signal)
    if chain.corner > 0:
        signal = sosfilt(butter(1, chain.corner, 'highpass', fs=rate, output='sos'), signal)
        begin = 0.0
    result: Array = signal + begin
    return result


def _shifted(signal: Array, t: Array, chain: Chain, phase: float) -> Array:
    values = chain.gain * signal
    values = values + chain.curvature * values * np.abs(values)
    values = values + chain.offset + chain.drift * t
    if chain.hum != 0:
        values = values + chain.hum * np.sin(2 * np.pi * chain.hum_frequency * t + phase)
    if chain.limit > 0:
        values = np.clip(values, -chain.limit, chain.limit)
    return values


def whitened(samples: Mapping[str, Array], scenario: Scenario, blow: Blow) -> Array:
    """All channels of one recording in units of their noise, one after another.

    Noise that is not white is made so (:class:`Whitening`): what is left has the norm that its
    true covariance gives it.
    What a speed that is ``REPEATABLE`` more or less would move counts as noise too, since every
    further contact amplifies it. No weight is carried by samples taken while a tap of unknown
    course acts or the impactor is let go and falls, nor by recordings that are held out: they
    judge, they are not fitted.
    """
    plain = blow if blow.led_by is None else replace(blow, led_by=None, begin=(0.0, 0.0))
    return np.concatenate(
        [
            _whitening(
                plain, name, scenario.rates[name], scenario.noise[name], scenario.colour(name)
            )(samples[name] / scenario.noise[name])
            for name in scenario.channels
        ]
    )


@lru_cache(maxsize=256)
def _whitening(blow: Blow, channel: str, rate: float, std: float, colour: Colour) -> Whitening:
    """What a channel's samples are worth beside all that makes them uncertain."""
    count = math.ceil(blow.duration * rate)
    if blow.role == 'hold_out':
        return Whitening(colour, np.zeros(count, dtype=bool))
    seen, extra = np.ones(count, dtype=bool), None
    if blow.excited_until > 0:
        first = math.floor((blow.start - 1e-3) * rate)
        seen[first : math.ceil((blow.start + blow.excited_until + 1e-3) * rate)] = False
    if blow.kind in STRIKES:
        if channel == 'acceleration.impactor':  # how it came there is not told
            seen[: math.ceil(blow.start * rate)] = False
        faster = replace(
            blow, bench=blow.bench._replace(speed=blow.bench.speed * (1 + REPEATABLE))
        )
        t = np.arange(count) / rate - blow.start
        column = COLUMNS.index(channel)
        moved = np.abs(_motion(faster, t)[:, column] - _motion(blow, t)[:, column])
        moved = maximum_filter1d(moved, 2 * math.ceil(_REACH * rate) + 1)
        extra = (moved / std) ** 2
    return Whitening(colour, seen, extra)
