"""How visible an effect is once the baseline has been re-tuned to hide it: d'.

d' is the norm, in units of the noise, of what remains between the campaign with the effect and
the baseline after the baseline's own freedom has been used up: stiffness within its stated
uncertainty, mass, damping, contact law, the gain of each channel within its calibration, and
for each blow its moment, its release angle within the tolerance or the strength of the tap.
Where an effect can be re-tuned away completely d' is 0, however large it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .measurement import noise_free, whitened
from .scenario import Blow, Scenario, impactor

__all__ = ['Freedom', 'Knob', 'norm', 'samples']

Array = NDArray[np.float64]


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
        whitened(noise_free(blow, scenario), scenario, span)
        for blow, span in zip(scenario.blows, (spans or scenario).blows, strict=True)
    ]


class Freedom:
    """What a baseline can re-tune: its sensitivities, and the projection past them."""

    def __init__(self, baseline: Scenario) -> None:
        self.baseline = baseline
        self.knobs = _knobs(baseline)
        self.reference = samples(baseline)
        self._blocks: list[tuple[Array, list[int]]] = []
        for index in range(len(baseline.blows)):
            own = [i for i, k in enumerate(self.knobs) if k.blow in (-1, index)]
            columns = [self._sensitivity(i, index) for i in own]
            self._blocks.append((np.stack(columns, axis=1), own))
        n = len(self.knobs)
        normal = np.zeros((n, n))
        for block, own in self._blocks:
            normal[np.ix_(own, own)] += block.T @ block
        self._prior = np.array([k.std**-2 for k in self.knobs])
        normal[np.diag_indices(n)] += self._prior
        self._scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        scaled = normal / np.outer(self._scale, self._scale)
        values, vectors = np.linalg.eigh(scaled)
        kept = values > 1e-11 * values[-1]
        self._inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T

    def remainder(self, difference: Sequence[Array]) -> list[Array]:
        """What is left of a difference (noise units) after linear re-tuning; priors last."""
        change = np.zeros(len(self.knobs))
        left = list(difference)
        for _ in range(2):  # the second time mends rounding
            change += self._retune(left, change)
            left = [
                d - block @ change[own]
                for d, (block, own) in zip(difference, self._blocks, strict=True)
            ]
        return [*left, -change * np.sqrt(self._prior)]

    def detectability(self, truth: Scenario, *, refine: int = 0) -> float:
        """Size of a truth against the baseline, d'; arguments as of :meth:`fitted`."""
        return self.fitted(truth, refine=refine)[1]

    def fitted(self, truth: Scenario, *, refine: int = 0) -> tuple[list[Array], float]:
        """What is left of a truth after re-tuning, priors last, and its norm d'.

        Args:
            truth: campaign with the same recordings and channels.
            refine: damped Gauss-Newton steps with the baseline simulated anew (0: linear).

        With ``refine`` the norm is the least that was reached: never below the true one.
        """
        target = samples(truth, self.baseline)
        left = [a - b for a, b in zip(target, self.reference, strict=True)]
        if refine == 0:
            parts = self.remainder(left)
            return parts, norm(parts)
        change = np.zeros(len(self.knobs))
        best = norm(left)
        for _ in range(refine):
            step = self._retune(left, change)
            for share in (1.0, 0.5, 0.2):
                ahead = change + share * step
                tuned = samples(self._tuned(ahead), self.baseline)
                rest = [a - b for a, b in zip(target, tuned, strict=True)]
                size = norm([*rest, ahead * np.sqrt(self._prior)])
                if size < best:
                    break
            if not size < 0.995 * best:
                break
            change, left, best = ahead, rest, size
        return [*left, -change * np.sqrt(self._prior)], best

    def _retune(self, left: Sequence[Array], change: Array) -> Array:
        pull = -self._prior * change
        for d, (block, own) in zip(left, self._blocks, strict=True):
            pull[own] += block.T @ d
        result: Array = (self._inverse @ (pull / self._scale)) / self._scale
        return result

    def _sensitivity(self, knob: int, blow: int) -> Array:
        name = self.knobs[knob].name
        if name.startswith('gain '):
            return self._of_channel(name.removeprefix('gain '), blow)
        step = self.knobs[knob].step
        ends = []
        for sign in (1, -1):
            change = np.zeros(len(self.knobs))
            change[knob] = sign * step
            turned = self._tuned(change, only=blow)
            span = self.baseline.blows[blow]
            ends.append(whitened(noise_free(turned.blows[blow], turned), turned, span))
        result: Array = (ends[0] - ends[1]) / (2 * step)
        return result

    def _of_channel(self, name: str, blow: int) -> Array:
        """The part of a recording's reference that a channel's gain scales."""
        part = np.zeros_like(self.reference[blow])
        begin = 0
        for channel in self.baseline.channels:
            rate = self.baseline.rates[channel]
            size = math.ceil(self.baseline.blows[blow].duration * rate)
            if channel == name:
                part[begin : begin + size] = self.reference[blow][begin : begin + size]
            begin += size
        return part

    def _tuned(self, change: Array, only: int = -1) -> Scenario:
        """The baseline with its knobs turned; ``only``: leave the other recordings as they are."""
        blows = list(self.baseline.blows)
        chains = dict(self.baseline.chains)
        for knob, value in zip(self.knobs, change, strict=True):
            if value == 0:
                continue
            if knob.name.startswith('gain '):
                name = knob.name.removeprefix('gain ')
                chains[name] = chains[name]._replace(gain=chains[name].gain * (1 + value))
                continue
            for i, blow in enumerate(blows):
                if knob.blow in (-1, i) and only in (-1, i):
                    blows[i] = _turned(blow, knob.name, value, self.baseline)
        return replace(self.baseline, blows=tuple(blows), chains=chains)


def norm(parts: Sequence[Array]) -> float:
    """Euclidean norm over all parts."""
    return float(np.sqrt(sum(float(p @ p) for p in parts)))


def _knobs(scenario: Scenario) -> list[Knob]:
    sensor = scenario.sensor
    stated = scenario.kind == 'impact'
    loose = sensor.stiffness_std / sensor.stiffness if stated else np.inf
    knobs = [Knob('stiffness', 1e-4, loose), Knob('mass', 1e-4), Knob('damping', 1e-3)]
    if any(b.bench.hertz_stiffness > 0 for b in scenario.blows):
        knobs += [Knob('hertz_stiffness', 1e-4), Knob('hertz_damping', 1e-3)]
    knobs += [
        Knob(f'gain {name}', 1e-4, scenario.gain_std[name])
        for name in scenario.channels
        if name in scenario.gain_std
    ]
    for i, blow in enumerate(scenario.blows):
        if blow.kind == 'driven':
            continue  # input and output are on one clock
        knobs.append(Knob('start', 1e-7, blow=i))
        if blow.kind == 'tap':
            knobs.append(Knob('tap', 1e-3, blow=i))
        else:
            knobs.append(Knob('angle', 1e-4, scenario.angle_std_deg, blow=i))
    return knobs


def _turned(blow: Blow, name: str, value: float, scenario: Scenario) -> Blow:
    if name == 'start':
        return replace(blow, start=blow.start + value)
    if name == 'tap':
        pulses = tuple(p._replace(peak=p.peak * (1 + value)) for p in blow.pulses)
        return replace(blow, pulses=pulses)
    if name == 'angle':
        least = 0.1 * blow.angle_deg - (blow.angle_deg + blow.angle_error_deg)
        turned = replace(blow, angle_error_deg=blow.angle_error_deg + max(value, least))
        fields = impactor(scenario.pendulum, turned, scenario.orientation, turned.bench)
        speed = fields['speed']
        return replace(turned, bench=turned.bench._replace(speed=speed))
    old = float(getattr(blow.bench, name))
    factor = max(1 + value, 0.1)
    return replace(blow, bench=blow.bench._replace(**{name: old * factor}))
