"""Motion prescribed, force measured: a spring, a damper, a mass, and what may be missing.

Dry friction may act beside the spring or in series with it: then the spring carries what the
slider holds, and after a reversal the force comes back over the slider's free travel. Play in
series with the slider leaves a stretch without force between (lost motion).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven import layout as at
from impactscope.discrepancy.driven.fitting import FINE, Fit, fit
from impactscope.discrepancy.driven.mechanics import Sizes, enter, mechanical_terms
from impactscope.discrepancy.driven.model import Segment
from impactscope.discrepancy.driven.oscillator import slider_force, smooth_force
from impactscope.discrepancy.driven.recordings import Cut, derivative_of
from impactscope.discrepancy.driven.terms import Number, Term
from impactscope.errors import InputError

__all__ = ['PrescribedModel', 'linear_prescribed']

Array = NDArray[np.float64]

CORNER = 0.05  # of the sampling rate: low-pass before the motion is differentiated
RIGID = 0.002  # of the largest displacement: travel in which friction beside a spring builds up
_FRICTIONS = ('coulomb_friction', 'asymmetric_friction')


@dataclass(frozen=True, eq=False)
class PrescribedModel:
    """Force of a device whose motion is prescribed. ``drive`` holds x, v, a, shape (3, n)."""

    numbers: tuple[Number, ...]
    terms: tuple[Term, ...]
    position_scale: float
    position_unit: str = 'm'

    def starts(self, segment: Segment) -> tuple[Number, ...]:  # noqa: ARG002
        """Where the slider stands at the first sample."""
        return (Number('slip', self.position_unit, (0.0,), 0.05 * self.position_scale),)

    @property
    def drifts(self) -> bool:
        """Nothing accumulates here."""
        return False

    def predict(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> Array:
        """Force, shape (n,)."""
        p = np.zeros(at.SIZE)
        p[at.HYSTERESIS_EXPONENT] = 1.0
        enter(p, values)
        x, v, a = segment.drive
        forward, backward, gap = p[at.KINETIC_FORWARD], p[at.KINETIC_BACKWARD], p[at.GAP]
        rubs = any(t.name in _FRICTIONS for t in terms)
        series = any(t.variant == 'series' for t in terms)
        stiffness = p[at.STIFFNESS]
        if rubs:
            p[at.GAP] = 0.0
        if series:
            p[at.STIFFNESS] = 0.0
        out = np.empty(x.size)
        smooth_force(p, x, v, a, segment.period, out)
        if rubs:
            strongest = max(forward, backward, 1e-300)
            if not series:
                stiffness = strongest / (RIGID * self.position_scale)
            if stiffness > 0.0:
                slip = float(start[0])
                slider_force(x, stiffness, forward, backward, gap, slip, out)
        return out

    def motion(
        self,
        values: Mapping[str, float],  # noqa: ARG002
        terms: tuple[Term, ...],  # noqa: ARG002
        start: Array,  # noqa: ARG002
        segment: Segment,
    ) -> tuple[Array, Array]:
        """The prescribed motion."""
        return segment.drive[0], segment.drive[1]


def _motion(cut: Cut) -> Array:
    """Position, speed, acceleration, shape (3, n), the latter from the smoothed position."""
    assert cut.drive is not None  # noqa: S101 - a prescribed motion is always there
    order = derivative_of(cut.drive_unit)
    if order == 2:
        raise InputError(
            f'{cut.recording}: {cut.drive_channel} is an acceleration; a prescribed motion must '
            'be a position or a speed'
        )
    period = 1.0 / cut.rate
    position = cut.drive
    if order == 1:
        steps = 0.5 * period * (position[1:] + position[:-1])
        position = np.concatenate([[0.0], np.cumsum(steps)])
    sections = signal.butter(4, CORNER * cut.rate, fs=cut.rate, output='sos')
    smooth = signal.sosfiltfilt(sections, position)
    speed = np.gradient(smooth, period)
    return np.stack([smooth, speed, np.gradient(speed, period)])


def linear_prescribed(cuts: Sequence[Cut]) -> tuple[PrescribedModel, list[Segment], Fit]:
    """Fit spring, damper and mass; the model knows what may be missing."""
    segments = [
        Segment(
            c.recording,
            c.channel,
            c.unit,
            c.held_out,
            c.begin,
            1.0 / c.rate,
            c.output,
            _motion(c),
            noise=c.noise,
        )
        for c in cuts
    ]
    fitted = [s for s in segments if not s.held_out]
    motion = np.concatenate([s.drive for s in fitted], axis=1)
    force = np.concatenate([s.measured for s in fitted])
    f, x = cuts[0].unit, cuts[0].drive_unit.split('/', 1)[0] or '1'
    rms = np.maximum(np.sqrt(np.mean(motion**2, axis=1)), 1e-300)
    level = float(np.sqrt(np.mean(force**2))) or 1.0
    linear = np.linalg.lstsq((motion / rms[:, None]).T, force, rcond=None)[0] / rms
    numbers = tuple(
        Number(name, unit, (float(value),), level / float(size))
        for name, unit, value, size in zip(
            ('stiffness', 'damping', 'mass'),
            (f'{f}/{x}', f'{f} s/{x}', 'kg' if (f, x) == ('N', 'm') else f'{f} s^2/{x}'),
            linear,
            rms,
            strict=True,
        )
    )
    position = float(np.max(np.abs(motion[0] - np.mean(motion[0])))) or 1.0
    sizes = Sizes(
        position,
        float(np.quantile(np.abs(motion[1]), 0.99)) or 1.0,
        level,
        level / position,
        f,
        x,
    )
    terms = mechanical_terms(
        sizes, spring=True, driven=True, angle=False, offset_channel=cuts[0].channel
    )
    model = PrescribedModel(numbers, _variants(terms, sizes), position, x)
    made = fit(dataclasses.replace(model, terms=()), (), segments, {}, tolerance=FINE)
    return model, segments, made


def _variants(terms: Sequence[Term], sizes: Sizes) -> tuple[Term, ...]:
    """Friction beside and in series with the spring; no stiction, which needs a free mass."""
    found = []
    for term in terms:
        if term.name in ('stribeck_friction', 'end_stop'):
            continue
        if term.name in _FRICTIONS:
            numbers = tuple(
                dataclasses.replace(n, starts=(0.8 * sizes.force, 0.3 * sizes.force))
                for n in term.numbers
            )
            found.append(dataclasses.replace(term, numbers=numbers))
            found.append(
                dataclasses.replace(
                    term,
                    numbers=numbers,
                    variant='series',
                    equation=f'{term.equation}, behind the spring k',
                    restart={'stiffness': 8.0 * sizes.force / sizes.position, 'mass': 0.0},
                )
            )
        else:
            found.append(term)
    return tuple(found)
