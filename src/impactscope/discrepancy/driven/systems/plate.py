"""A plate under a hammer: its force zero between blows, its noise known, residuals white."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.adequacy.plate_laws import plate_laws
from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.model_selection.chi_square import NoiseJudge
from impactscope.discrepancy.driven.models.candidate_effects import candidate_effects
from impactscope.discrepancy.driven.models.measuring_chain import power_retimed
from impactscope.discrepancy.driven.models.mechanical_effects import Sizes
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel, inside_samples
from impactscope.discrepancy.driven.models.terms import Term
from impactscope.discrepancy.driven.noise.kalman_whitening import (
    HammerForce,
    hammer_force,
    whitener,
)
from impactscope.discrepancy.driven.noise.quantisation import step_of
from impactscope.discrepancy.driven.noise.spectral_whitening import weight_by_runs
from impactscope.discrepancy.driven.systems.case import Case
from impactscope.discrepancy.locate import Phase

__all__ = ['plate_under_hammer', 'white_level']

Array = NDArray[np.float64]

ROUNDS = 4  # of knowing the noise and the plate
BANDS = 256  # of the noise's spectrum


def plate_under_hammer(
    parts: Sequence[Cut], model: OscillatorModel, segments: Sequence[Segment], made: Fit
) -> Case | None:
    """The campaign as one in which the noise is all that a right model leaves; None if not.

    It may be one if the force is that of a hammer and there is one output. ``parts`` may be
    longer than the segments, which were fitted.
    """
    if len({p.channel for p in parts}) != 1 or any(p.drive is None for p in parts):
        return None
    forces = []
    for cut in parts:
        assert cut.drive is not None  # noqa: S101 - looked at above
        force = hammer_force(cut.drive, 1.0 / cut.rate)
        if force is None:
            return None
        forces.append(force)
    quiet = [
        dataclasses.replace(
            s,
            measured=cut.output,
            drive=inside_samples(h.force, (s.drive.shape[1] - 1) // 2, held=False),
            state=(0.0, 0.0),
        )
        for s, h, cut in zip(segments, forces, parts, strict=True)
    ]
    linear = dataclasses.replace(model, terms=(), _last={})
    noise = _noise(parts, quiet, made)
    for _ in range(ROUNDS):
        plate = made.values['mass'], made.values['damping'], made.values['stiffness']
        if not noise > 0.0 or plate[0] <= 0.0 or plate[2] <= 0.0:
            return None
        quiet = [
            dataclasses.replace(
                s,
                noise=noise,
                whitener=whitener(plate, s.derivative, s.period, noise, h, s.measured.size),
                weight=weight_by_runs(s.measured, noise),
            )
            for s, h in zip(quiet, forces, strict=True)
        ]
        made = fit(linear, (), quiet, made.values, tolerance=FINE)
        noise = _noise(parts, quiet, made)
    through = [1.0 / made.values['mass'] ** 2 if s.derivative == 2 else 0.0 for s in quiet]
    loud = [
        float(np.sum(t * h.smooth_variance / (noise**2 + t * h.smooth_variance)))
        for t, h in zip(through, forces, strict=True)
    ]
    rate = parts[0].rate

    def muffled(fitted: Fit) -> Sequence[float]:
        smooth = _share_beyond(fitted, rate)
        return [smooth * value for value in loud]

    judge = NoiseJudge(quiet, muffled)
    full = dataclasses.replace(
        linear, terms=_terms(linear, quiet, made, forces, noise, parts[0]), _last={}
    )
    stretches = tuple(_phases(s, h) for s, h in zip(quiet, forces, strict=True))
    return Case(full, quiet, made, judge, plate_laws, stretches, {parts[0].channel: noise})


def _share_beyond(made: Fit, rate: float) -> float:
    """Share of white noise that a fit's low-pass and clock take away; 0 without one."""
    kept = 1.0
    for term in made.terms:
        if term.name == 'low_pass_filter':
            kept *= min(2.0 * made.values[f'{term.label}.cutoff'] / rate, 1.0)
    frequency = np.linspace(0.0, 0.5 * rate, BANDS)[1:-1]
    clocked = power_retimed(made.terms, made.values, frequency, 1.0 / rate)
    return 1.0 - kept * float(np.mean(clocked))


def _phases(segment: Segment, force: HammerForce) -> tuple[Phase, ...]:
    """Before the first blow, each blow to its peak and from it, and the ring-downs."""
    time = segment.time
    end = float(time[-1])
    begins = [float(time[first]) for first, _ in force.blows]
    found = [Phase('before', float(time[0]), begins[0])]
    for (first, last), after in zip(force.blows, [*begins[1:], end], strict=True):
        peak = float(time[first + int(np.argmax(np.abs(force.force[first:last])))])
        lost = float(time[min(last, time.size - 1)])
        found.append(Phase('loading', float(time[first]), peak))
        found.append(Phase('unloading', peak, lost))
        found.append(Phase('ring_down', lost, float(after)))
    return tuple(p for p in found if p.end > p.start)


def _noise(parts: Sequence[Cut], segments: Sequence[Segment], made: Fit) -> float:
    """Standard deviation of a sample: as stated, or from what is left between the lines.

    Once the force's noise is whitened, that of the output is what is left of it.
    """
    stated = parts[0].noise
    if math.isfinite(stated) and stated > 0.0:
        return stated
    found = []
    for s, residual in zip(segments, made.residuals, strict=True):
        if not s.held_out:
            white = residual if s.whitener is None else s.noise * s.whitener(residual)
            found.append(white_level(white))
    # where a coarse reading rests it shows no noise
    steps = [step_of(s.measured) for s in segments if not s.held_out]
    return max(float(np.median(found)), min(steps) / math.sqrt(12.0))


def white_level(residual: Array) -> float:
    """Standard deviation of the white part of a residual, shape (n,).

    From the median of its spectrum: lines and bands do not count, steps of a converter do. A drift
    does not either, whose ends would leak into all of it.
    """
    power = np.abs(np.fft.rfft(signal.detrend(residual))[1:-1]) ** 2 / residual.size
    return float(np.sqrt(np.median(power) / math.log(2.0)))


def _terms(
    linear: OscillatorModel,
    segments: Sequence[Segment],
    made: Fit,
    forces: Sequence[HammerForce],
    noise: float,
    part: Cut,
) -> tuple[Term, ...]:
    motions = [
        linear.motion(made.values, (), made.starts[i], s)
        for i, s in enumerate(segments)
        if not s.held_out
    ]
    sizes = Sizes(
        max(float(np.max(np.abs(x))) for x, _ in motions),
        max(float(np.max(np.abs(v))) for _, v in motions),
        max(float(np.max(np.abs(h.force))) for h in forces),
        made.values['stiffness'],
        part.drive_unit or '1',
        part.unit.split('/', 1)[0] or '1',
    )
    return candidate_effects(
        sizes,
        (made.values['mass'], made.values['damping'], made.values['stiffness']),
        (part.channel, part.unit),
        part.rate,
        max(s.measured.size * s.period for s in segments),
        noise,
        max(float(np.max(np.abs(s.measured))) for s in segments),
        len(segments),
    )
