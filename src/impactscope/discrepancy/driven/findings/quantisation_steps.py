"""Quantisation of a channel as a finding: coarse steps, from the lattice of its samples."""

from __future__ import annotations

import math

import numpy as np

from impactscope.discrepancy.answer import Finding, ParameterEstimate
from impactscope.discrepancy.campaign import CampaignKind
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.noise.quantisation import step_of
from impactscope.discrepancy.evidence import quantisation_step

__all__ = ['STEPS', 'rounding', 'steps_found']

STEPS = 25.0  # chi-square of rounding from which steps are named
ANGLE = 'rad'


def steps_found(s: Subject, final: Fit) -> list[Finding]:
    """Coarse steps of a channel, where they are beyond doubt."""
    if s.case is not None:
        return [_steps(x, step) for x, step, gain in rounding(s).values() if gain > STEPS]
    if s.campaign.kind.value != 'chain':
        return []
    for segment, residual in zip(s.segments, final.residuals, strict=True):
        step = quantisation_step(segment.measured)
        spread = float(np.std(residual))
        coarse = 0.0 < spread <= step and step / math.sqrt(12.0) > 0.5 * spread
        if coarse and abs(quantisation_step(segment.drive[0]) - step) > 1e-3 * step:
            return [_steps(segment, step)]
    return []


def rounding(s: Subject) -> dict[str, tuple[Segment, float, float]]:
    """Channels with steps where the noise is known: a segment, the step, its chi-square."""
    found: dict[str, tuple[Segment, float, float]] = {}
    if s.case is None:
        return found
    commanded = 'reference' in s.campaign.bench or 'controller' in s.campaign.bench
    for channel, noise in s.case.noise.items():
        if commanded and channel.startswith('displacement'):
            continue  # the encoder of an axis: its steps are its noise
        fitted = [x for x in s.segments if not x.held_out and x.channel == channel]
        if any(x.unit == ANGLE for x in fitted):
            continue  # what reads an angle is an encoder, too
        steps = [step_of(x.measured) for x in fitted]
        if not steps or min(steps) <= 0.0 or max(steps) > 1.01 * min(steps):
            continue
        if s.campaign.kind is CampaignKind.CHAIN:
            own = [
                step_of(x.drive[:2].sum(axis=0).astype(np.float32).astype(np.float64))
                for x in fitted
            ]
            if abs(max(own) - min(steps)) < 0.01 * min(steps):
                continue  # the input has them already
        share = min(steps) ** 2 / 12.0 / noise**2
        gain = share * sum(x.measured.size for x in fitted)
        found[channel] = fitted[0], min(steps), gain
    return found


def _steps(segment: Segment, step: float) -> Finding:
    return Finding(
        'quantisation',
        1.0,
        'measurement',
        {'step': ParameterEstimate(step, 1e-3 * step, segment.unit)},
        channel=segment.channel,
        sentence='The channel has coarse steps.',
        equation='round to multiples of the step',
        source='Widrow and Kollar, Quantization Noise (2008)',
    )
