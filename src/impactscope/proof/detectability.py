"""How visible an effect is once the baseline has been re-tuned to hide it: d'.

d' is the norm, in units of the noise, of what remains between the campaign with the effect and
the baseline after the baseline's own freedom has been used up: stiffness within its stated
uncertainty, mass, damping, contact law, the gain of each channel within its calibration, and
for each blow its moment, its release angle within the tolerance or the strength of the tap. An
axis in closed loop is compared under the force as recorded, whatever made the controller
command it; where it begins and how fast is free in every recording.
Where an effect can be re-tuned away completely d' is 0, however large it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import InputError

from .measurement import noise_free, whitened
from .scenario import STRIKES, Blow, Scenario, impactor

__all__ = [
    'AXIS_DAMPING',
    'AXIS_MASS',
    'DRIVE_GAIN',
    'STATED',
    'Companion',
    'Freedom',
    'Knob',
    'norm',
    'samples',
]

Array = NDArray[np.float64]

# relative standard deviations of what is stated of an axis, where it is
AXIS_MASS, AXIS_DAMPING, DRIVE_GAIN = 0.01, 0.05, 0.003
STATED = 0.02  # relative: what is known of a stated mass and speed of a robot or a falling body
_SPANS = (0.03, 0.1, 0.3)  # s after the first contact
_FACTOR = 0.1, 5.0  # the least and the most that any other number is turned by
_COMPANION = 'companion'
_COMPANION_SHARE = 1e-3, 3.0  # of its strength: the least and the most that is tried
_STEPS = 20
_SETTLED = 0.02  # of what is left, or of the noise below 1
_STIFFEST = 1e3  # damping after Marquardt, in units of the normal matrix


@dataclass(frozen=True)
class Companion:
    """An effect beside the baseline of which some numbers may be re-tuned with it.

    Args:
        apply: what puts it into a campaign, its numbers times factors, the strength's first.
        numbers: how many factors there are.
    """

    apply: Callable[[Scenario, Sequence[float]], Scenario]
    numbers: int = 1


@dataclass(frozen=True)
class Knob:
    """One number the baseline may re-tune, as a relative or absolute change from its value."""

    name: str
    step: float  # for differences
    std: float = np.inf  # what is known of it beforehand
    blow: int = -1  # the recording it belongs to; -1: all


def samples(scenario: Scenario, spans: Scenario | None = None) -> list[Array]:
    """Noise-free recordings of a campaign in units of the noise, one array a recording.

    ``spans``: the campaign whose taps say which samples carry no weight; by default this one.
    """
    return [
        _sampled(blow, scenario, span)
        for blow, span in zip(scenario.blows, (spans or scenario).blows, strict=True)
    ]


def _sampled(blow: Blow, scenario: Scenario, span: Blow) -> Array:
    if span.role == 'hold_out':  # carries no weight: not worth a simulation
        count = sum(math.ceil(span.duration * scenario.rates[n]) for n in scenario.channels)
        return np.zeros(count)
    return whitened(noise_free(blow, scenario), scenario, span)


@dataclass(frozen=True)
class _Slopes:
    """Sensitivities of a baseline at one setting of its knobs, noise units."""

    blocks: Sequence[tuple[Array, list[int]]]  # a recording: samples by its knobs, which knobs
    prior: Array  # inverse variances, one a knob

    def step(self, left: Sequence[Array], change: Array, damping: float = 0.0) -> Array:
        """Change of the knobs that removes most of ``left``, damped after Marquardt."""
        n = self.prior.size
        if n == 0:
            return np.empty(0)
        normal, pull = np.zeros((n, n)), -self.prior * change
        for d, (block, own) in zip(left, self.blocks, strict=True):
            normal[np.ix_(own, own)] += block.T @ block
            pull[own] += block.T @ d
        normal[np.diag_indices(n)] += self.prior
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        scaled = normal / np.outer(scale, scale)
        scaled[np.diag_indices(n)] += damping
        values, vectors = np.linalg.eigh(scaled)
        kept = values > 1e-11 * values[-1]
        inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
        result: Array = (inverse @ (pull / scale)) / scale
        return result

    def promised(self, left: Sequence[Array], move: Array, ahead: Array) -> float:
        """Norm that would be left after a move were the baseline linear."""
        rest = [d - b @ move[own] for d, (b, own) in zip(left, self.blocks, strict=True)]
        return norm([*rest, ahead * np.sqrt(self.prior)])

    def seen(self, weights: Sequence[Array]) -> _Slopes:
        """The same with weighted samples."""
        blocks = [(w[:, None] * b, own) for w, (b, own) in zip(weights, self.blocks, strict=True)]
        return _Slopes(blocks, self.prior)


class Freedom:
    """What a baseline can re-tune: its sensitivities, and what a truth leaves beside it."""

    def __init__(self, baseline: Scenario, *companions: Companion) -> None:
        """``companions``: effects beside the baseline; their numbers are further knobs."""
        self.baseline = baseline
        self._companions = companions
        self.knobs = _knobs(baseline)
        self.knobs += [Knob(_COMPANION, 1e-3)] * sum(c.numbers for c in companions)
        self.scenario = self._tuned(np.zeros(len(self.knobs)))
        self._prior = np.array([k.std**-2 for k in self.knobs])
        self._leads = _leads(baseline)
        if self._leads:
            return
        self.reference = samples(self.scenario, baseline)
        self._slopes = self._linearised(np.zeros(len(self.knobs)), self.reference)

    @property
    def sensitivities(self) -> Sequence[tuple[Array, list[int]]]:
        """Of each recording: its samples by its knobs, in units of the noise, and which knobs."""
        return self._slopes.blocks

    def of_channels(self, blow: int) -> dict[str, slice]:
        """Where the samples of each channel stand in a recording."""
        places, begin = {}, 0
        for channel in self.baseline.channels:
            size = math.ceil(self.baseline.blows[blow].duration * self.baseline.rates[channel])
            places[channel] = slice(begin, begin + size)
            begin += size
        return places

    def remainder(self, difference: Sequence[Array]) -> list[Array]:
        """What is left of a difference (noise units) after linear re-tuning; priors last."""
        change = np.zeros(len(self.knobs))
        left = list(difference)
        for _ in range(2):  # the second time mends rounding
            change += self._slopes.step(left, change)
            left = [
                d - block @ change[own]
                for d, (block, own) in zip(difference, self._slopes.blocks, strict=True)
            ]
        return [*left, -change * np.sqrt(self._prior)]

    def detectability(self, truth: Scenario, *, linear: bool = False) -> float:
        """Size of a truth against the baseline, d'; arguments as of :meth:`fitted`."""
        return self.fitted(truth, linear=linear)[1]

    def fitted(self, truth: Scenario, *, linear: bool = False) -> tuple[list[Array], float]:
        """What is left of a truth after re-tuning, priors last, and its norm d'.

        The baseline is fitted to the noise-free truth by damped Gauss-Newton steps, simulated
        and linearised anew: over whole recordings, and from the first 30 ms after the contact
        on over growing spans, since behind a few contacts a fit from afar finds no way. The
        least of both counts: never below the true one.

        Args:
            truth: campaign with the same recordings and channels.
            linear: by the sensitivities at the baseline alone (quick; right when small).
        """
        if self._leads:  # what is compared is the motion under the force as recorded
            led = Freedom(self.baseline.led_by(truth), *self._companions)
            return led.fitted(truth, linear=linear)
        target = samples(truth, self.baseline)
        if linear:
            parts = self.remainder([a - b for a, b in zip(target, self.reference, strict=True)])
            return parts, norm(parts)
        rest = np.zeros(len(self.knobs))
        direct, straight = self._follow(target, rest, np.inf)
        ends = [self._left(target, direct)]
        # a step that keeps its word may end in a hollow that later bounces make
        straight &= self.baseline.kind != 'impact' or norm(ends[0]) < 1.0
        if not straight and self.baseline.kind != 'closed_loop':
            for span in _SPANS:
                rest, _ = self._follow(target, rest, span)
            ends.append(self._left(target, self._follow(target, rest, np.inf)[0]))
        parts = min(ends, key=norm)
        return parts, norm(parts)

    def _left(self, target: Sequence[Array], change: Array) -> list[Array]:
        tuned = samples(self._tuned(change), self.baseline)
        left = [a - b for a, b in zip(target, tuned, strict=True)]
        return [*left, -change * np.sqrt(self._prior)]

    def _follow(self, target: Sequence[Array], change: Array, span: float) -> tuple[Array, bool]:
        """Knobs fitted from ``change`` over the first ``span`` seconds after the contact.

        Also whether one step led there, as where the baseline is linear in its knobs.
        """
        weights = [(t < span).astype(float) for t in self._since_contact]

        def parts(at: Array) -> list[Array]:
            *left, pull = self._left(target, at)
            return [*(w * d for w, d in zip(weights, left, strict=True)), pull]

        slopes, damping, fresh = self._slopes.seen(weights), 0.0, not change.any()
        left = parts(change)
        size = norm(left)
        for count in range(_STEPS):
            ahead = change + slopes.step(left[:-1], change, damping)
            try:
                rest = parts(ahead)
                reached = norm(rest)
            except InputError:  # too long a step: no bench moves like that
                reached = math.inf
            promised = slopes.promised(left[:-1], ahead - change, ahead)
            true_to_word = abs(reached - promised) < _SETTLED * max(reached, 1.0)
            if reached < size:
                change, left, damping = ahead, rest, 0.1 * damping
            gained, size = size - reached, min(reached, size)
            if (true_to_word and damping < 1e-6) or 0 <= gained < 0.1 * _SETTLED * max(size, 1.0):
                return change, count == 0
            if gained < 0 and fresh:
                damping = max(10 * damping, 1e-4)
                if damping > _STIFFEST:
                    break
            else:
                slopes = self._linearised(change, samples(self._tuned(change), self.baseline))
                slopes, fresh = slopes.seen(weights), True
        return change, False

    @cached_property
    def _since_contact(self) -> list[Array]:
        """Seconds from the first contact to each whitened sample, an array a recording."""
        scenario = self.baseline
        return [
            np.concatenate(
                [
                    np.arange(math.ceil(b.duration * scenario.rates[n])) / scenario.rates[n]
                    - b.start
                    for n in scenario.channels
                ]
            )
            for b in scenario.blows
        ]

    def _linearised(self, change: Array, tuned: Sequence[Array]) -> _Slopes:
        blocks = []
        for index in range(len(self.baseline.blows)):
            own = [i for i, k in enumerate(self.knobs) if k.blow in (-1, index)]
            block = np.empty((tuned[index].size, len(own)))
            for column, knob in enumerate(own):
                block[:, column] = self._sensitivity(knob, index, change, tuned[index])
            blocks.append((block, own))
        return _Slopes(blocks, self._prior)

    def _sensitivity(self, knob: int, blow: int, change: Array, tuned: Array) -> Array:
        name = self.knobs[knob].name
        if name.startswith('gain '):
            return self._of_channel(name.removeprefix('gain '), blow, tuned)
        step = self.knobs[knob].step
        ends = []
        for sign in (1, -1):
            turned = change.copy()
            turned[knob] += sign * step
            scenario = self._tuned(turned, only=blow)
            span = self.baseline.blows[blow]
            ends.append(_sampled(scenario.blows[blow], scenario, span))
        result: Array = (ends[0] - ends[1]) / (2 * step)
        return result

    def _of_channel(self, name: str, blow: int, tuned: Array) -> Array:
        """The part of a recording that a channel's gain scales."""
        part = np.zeros_like(tuned)
        place = self.of_channels(blow)[name]
        part[place] = tuned[place]
        return part

    def _tuned(self, change: Array, only: int = -1) -> Scenario:
        """The baseline with its knobs turned; ``only``: leave the other recordings as they are."""
        blows = list(self.baseline.blows)
        chains = dict(self.baseline.chains)
        for knob, value in zip(self.knobs, change, strict=True):
            if value == 0 or knob.name == _COMPANION:
                continue
            if knob.name.startswith('gain '):
                name = knob.name.removeprefix('gain ')
                chains[name] = chains[name]._replace(gain=chains[name].gain * (1 + value))
                continue
            for i, blow in enumerate(blows):
                if knob.blow in (-1, i) and only in (-1, i):
                    blows[i] = _turned(blow, knob.name, value, self.baseline)
        tuned = replace(self.baseline, blows=tuple(blows), chains=chains)
        begin = len(change) - sum(c.numbers for c in self._companions)
        for companion in self._companions:
            end = begin + companion.numbers
            first, *others = 1.0 + change[begin:end]
            factors = [np.clip(first, *_COMPANION_SHARE), *np.clip(others, *_FACTOR)]
            tuned = companion.apply(tuned, [float(f) for f in factors])
            begin = end
        return tuned

    def beside(self, companion: Companion) -> Freedom:
        """The freedom of the same baseline with one more companion."""
        return Freedom(self.baseline, *self._companions, companion)


def _leads(scenario: Scenario) -> bool:
    """Whether this axis commands its forces itself."""
    return scenario.kind == 'closed_loop' and any(b.led_by is None for b in scenario.blows)


def norm(parts: Sequence[Array]) -> float:
    """Euclidean norm over all parts."""
    # einsum: threads of a linear algebra library take longer to start than such sums
    return math.sqrt(sum(float(np.einsum('i,i', p, p)) for p in parts))


def _knobs(scenario: Scenario) -> list[Knob]:
    sensor = scenario.sensor
    stated = scenario.kind == 'impact'
    loose = sensor.stiffness_std / sensor.stiffness if stated else np.inf
    knobs = []
    if scenario.kind == 'closed_loop':
        return _axis_knobs(scenario)
    if scenario.kind != 'chain':
        knobs += [Knob('stiffness', 1e-4, loose), Knob('damping', 1e-3)]
    if scenario.kind in ('impact', 'driven'):
        knobs.append(Knob('mass', 1e-4))
    if any(b.bench.hertz_stiffness > 0 for b in scenario.blows):
        knobs += [Knob('hertz_stiffness', 1e-4), Knob('hertz_damping', 1e-3)]
    knobs += [
        Knob(f'gain {name}', 1e-4, scenario.gain_std[name])
        for name in scenario.channels
        if name in scenario.gain_std
    ]
    for i, blow in enumerate(scenario.blows):
        if blow.kind != 'tap' and blow.kind not in STRIKES:
            continue  # input and output are on one clock
        knobs.append(Knob('start', 1e-7, blow=i))
        if blow.kind == 'tap':
            knobs.append(Knob('tap', 1e-3, blow=i))
        elif blow.kind != 'pendulum':
            knobs += [Knob(n, 1e-4, STATED, blow=i) for n in ('speed', 'impactor_mass')]
        else:
            knobs.append(Knob('angle', 1e-4, scenario.angle_std_deg, blow=i))
    return knobs


def _axis_knobs(scenario: Scenario) -> list[Knob]:
    """Mass and damping, within what is stated of them, and where each recording begins."""
    stated = scenario.stated_axis
    mass, damping = (np.inf, np.inf) if stated is None else (AXIS_MASS, AXIS_DAMPING)
    knobs = [Knob('mass', 1e-4, mass), Knob('damping', 1e-3, damping)]
    if stated is not None:  # else it is hidden in both
        knobs.append(Knob('drive_gain', 1e-4, DRIVE_GAIN))
    for i, blow in enumerate(scenario.blows):
        if blow.role == 'fit':
            knobs += [Knob('position', 1e-5, blow=i), Knob('speed_at_begin', 1e-5, blow=i)]
    return knobs


def _turned(blow: Blow, name: str, value: float, scenario: Scenario) -> Blow:
    if name == 'position':
        return replace(blow, begin=(blow.begin[0] + value, blow.begin[1]))
    if name == 'speed_at_begin':
        return replace(blow, begin=(blow.begin[0], blow.begin[1] + value))
    if name == 'start':
        return replace(blow, start=blow.start + value)
    if name == 'tap':
        pulses = tuple(p._replace(peak=p.peak * (1 + value)) for p in blow.pulses)
        return replace(blow, pulses=pulses)
    if name == 'angle':
        released = blow.angle_deg + blow.angle_error_deg
        reached = float(np.clip(released + value, 0.1 * blow.angle_deg, 3 * blow.angle_deg))
        turned = replace(blow, angle_error_deg=reached - blow.angle_deg)
        fields = impactor(scenario.pendulum, turned, scenario.orientation, turned.bench)
        speed = fields['speed']
        return replace(turned, bench=turned.bench._replace(speed=speed))
    old = float(getattr(blow.bench, name))
    factor = float(np.clip(1 + value, *_FACTOR))
    return replace(blow, bench=blow.bench._replace(**{name: old * factor}))
