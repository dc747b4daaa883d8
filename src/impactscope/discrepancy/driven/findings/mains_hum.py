"""Whether a hum that an axis shows stands in its recorded force.

A line in the force that the axis never felt is missing from its motion: what the motion lacks is
the axis' answer to that line, by size and by phase. A hum of the encoder is nothing like that.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.answer import ParameterEstimate
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.terms import Term

__all__ = ['hum_in_force']

Array = NDArray[np.float64]

ALIKE = 0.8  # cosine between what the force says and what the motion lacks
RATIO = 1.6  # of their sizes, at most
TURNED = 0.6  # rad


def hum_in_force(s: Subject, term: Term, made: Fit) -> ParameterEstimate | None:
    """Amplitude of a hum in the recorded force, where it is there; else None.

    Args:
        s: the campaign and what was found.
        term: the hum.
        made: the fit that has it.
    """
    values = made.values
    if s.case is None or term.name != 'mains_hum' or 'stiffness' in values or 'mass' not in values:
        return None
    frequency = values[f'{term.label}.frequency']
    turn = 2.0 * math.pi * frequency
    rest = tuple(t for t in made.terms if t is not term)
    told, lacked = [], []
    for i, segment in enumerate(s.segments):
        if segment.held_out or segment.derivative != 0 or not np.any(segment.drive):
            continue
        predicted = s.model.predict(values, rest, made.starts[i], segment)
        force = np.append(segment.drive[:, 0], segment.drive[-1, -1])
        told.append(_line(force, turn * segment.period))
        lacked.append(_line(segment.measured - predicted, turn * segment.period))
    if not told:
        return None
    period = s.segments[0].period
    # the axis' answer to a force that stays constant between samples
    held = np.sinc(frequency * period) * cmath.exp(-0.5j * turn * period)
    answer = held / complex(-values['mass'] * turn**2, values['damping'] * turn)
    expected, found = -answer * np.array(told), np.array(lacked)
    size, other = float(np.linalg.norm(expected)), float(np.linalg.norm(found))
    if not (size > 0.0 and other > 0.0):
        return None
    along = complex(np.vdot(expected, found))
    if abs(along) < ALIKE * size * other or abs(cmath.phase(along)) > TURNED:
        return None
    if not 1.0 / RATIO < other / size < RATIO:
        return None
    amplitude = f'{term.label}.amplitude'
    unit = s.model.numbers[1].unit.partition(' s/')[0]  # of a damping: force over speed
    return ParameterEstimate(
        values[amplitude] / abs(answer), made.std.get(amplitude, math.nan) / abs(answer), unit
    )


def _line(samples: Array, turn: float) -> complex:
    """Amplitude and phase of a line that turns by ``turn`` rad a sample, shape (n,)."""
    window = np.hanning(samples.size)
    wave = np.exp(-1j * turn * np.arange(samples.size))
    return complex(2.0 * np.sum(window * (samples - np.mean(samples)) * wave) / np.sum(window))
