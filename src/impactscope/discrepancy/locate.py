"""Where a model and recordings differ: time, phase of the blow, frequency band, state.

Each channel of each recording is cut at the turns of the blow (contact, peak, loss of contact) and
into pieces of at most ``PIECE`` s. The misfit of each piece is a chi-square of its own; which
pieces are named is decided by the rate of false discoveries over all of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from impactscope.discrepancy.answer import Region
from impactscope.discrepancy.evidence import first_discoveries

__all__ = ['Phase', 'Strip', 'band_of', 'locate', 'phases', 'state_of']

Array = NDArray[np.float64]

PIECE = 0.025  # s
_ENOUGH = 0.8  # share of the evidence that the named regions hold, where none stands out


@dataclass(frozen=True, slots=True)
class Phase:
    """A named span of a blow, s."""

    name: str
    start: float
    end: float


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """One channel of one recording: standardised residuals over its bins, shape (n_bins,)."""

    recording: str
    channel: str
    time: Array
    baseline: Array
    extended: Array
    displacement: Array
    velocity: Array
    phases: tuple[Phase, ...]


def phases(
    start: float, peak: float, contacts: Sequence[tuple[float, bool]], end: float
) -> tuple[Phase, ...]:
    """Phases of a blow from its first contact, first peak and later losses and finds of contact.

    ``contacts``: times in order, True where contact begins. ``end``: of the recording's part.
    """
    losses = [t for t, begins in contacts if not begins]
    finds = [t for t, begins in contacts if begins]
    first_loss = losses[0] if losses else end
    peak = min(peak, first_loss)
    onset = start + 0.2 * (peak - start)
    marks = [Phase('before', -math.inf, start), Phase('onset', start, onset)]
    marks += [Phase('loading', onset, peak), Phase('unloading', peak, first_loss)]
    edge = first_loss
    for found, lost in itertools.zip_longest(finds, losses[1:]):
        if found is None:
            break
        marks.append(Phase('separated', edge, found))
        edge = end if lost is None else lost
        marks.append(Phase('recontact', found, edge))
    if edge < end:
        marks.append(Phase('separated' if losses else 'ring_down', edge, end))
    return tuple(p for p in marks if p.end > p.start)


def locate(strips: Sequence[Strip], rate: float) -> tuple[Region, ...]:
    """Regions in which the baseline differs from the recordings, the strongest first.

    Where a small effect hides everywhere and no piece stands out on its own, the pieces in which
    the extended model gains most are named instead.
    """
    pieces = [piece for strip in strips for piece in _pieces(strip)]
    if not pieces:
        return ()
    found = first_discoveries([p.p_value for p in pieces], rate)
    chosen = [p for p, yes in zip(pieces, found, strict=True) if yes]
    if not chosen:
        gaining = sorted((p for p in pieces if p.gain > 0), key=lambda p: p.gain, reverse=True)
        total, sum_so_far = sum(p.gain for p in gaining), 0.0
        for piece in gaining:
            if sum_so_far > _ENOUGH * total or len(chosen) >= 12:
                break
            chosen.append(piece)
            sum_so_far += piece.gain
    regions = [_region(run) for run in _runs(chosen)]
    regions.sort(key=lambda r: -r.ratio)
    return tuple(regions[:200])


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    strip: Strip
    phase: str
    mask: NDArray[np.bool_]
    start: float
    end: float
    chi_square: float
    p_value: float
    gain: float


def _pieces(strip: Strip) -> list[_Piece]:
    found: list[_Piece] = []
    if strip.time.size == 0:
        return found
    for phase in strip.phases:
        start = max(phase.start, float(strip.time[0]))
        end = min(phase.end, float(strip.time[-1]))
        if end <= start:
            continue
        count = max(1, math.ceil((end - start) / PIECE))
        for low, high in itertools.pairwise(np.linspace(start, end, count + 1)):
            mask = (strip.time >= low) & (strip.time <= high)
            n = int(np.count_nonzero(mask))
            if n < 2:
                continue
            baseline, extended = strip.baseline[mask], strip.extended[mask]
            chi_square = float(baseline @ baseline)
            found.append(
                _Piece(
                    strip,
                    phase.name,
                    mask,
                    float(low),
                    float(high),
                    chi_square,
                    float(stats.chi2.sf(chi_square, n)),
                    chi_square - float(extended @ extended),
                )
            )
    return found


def _runs(pieces: Sequence[_Piece]) -> list[list[_Piece]]:
    """Neighbouring pieces of one phase together."""
    ordered = sorted(pieces, key=lambda p: (p.strip.recording, p.strip.channel, p.start))
    runs: list[list[_Piece]] = []
    for piece in ordered:
        last = runs[-1][-1] if runs else None
        if (
            last is not None
            and last.strip is piece.strip
            and last.phase == piece.phase
            and piece.start <= last.end + 1e-9
        ):
            runs[-1].append(piece)
        else:
            runs.append([piece])
    return runs


def _region(run: Sequence[_Piece]) -> Region:
    strip = run[0].strip
    mask = np.logical_or.reduce([p.mask for p in run])
    residual = strip.baseline[mask]
    chi_square = float(residual @ residual)
    return Region(
        recording=strip.recording,
        channel=strip.channel,
        start_s=run[0].start,
        end_s=run[-1].end,
        phase=run[0].phase,
        band_hz=band_of(strip.time[mask], residual),
        p_value=float(stats.chi2.sf(chi_square, residual.size)),
        ratio=math.sqrt(chi_square / residual.size),
        state=state_of(residual, strip.displacement[mask], strip.velocity[mask]),
    )


def band_of(time: Array, residual: Array) -> tuple[float, float] | None:
    """Band that holds the middle 80 % of the residual's power, Hz; None for a short stretch."""
    if residual.size < 16:
        return None
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step)
    values = np.interp(even, time, np.clip(residual, -1e3, 1e3))
    power = np.abs(np.fft.rfft((values - np.mean(values)) * np.hanning(values.size))) ** 2
    share = np.cumsum(power)
    if not share[-1] > 0:
        return None
    width = 1.0 / (values.size * step)
    low, high = np.searchsorted(share, [0.1 * share[-1], 0.9 * share[-1]])
    return max(0.0, (float(low) - 0.5) * width), (float(high) + 0.5) * width


def state_of(residual: Array, displacement: Array, velocity: Array) -> str:
    """With what state of the plate a residual goes, in words; empty where with none."""
    if residual.size < 24 or displacement.size != residual.size:
        return ''
    centred = residual - np.mean(residual)
    power = float(centred @ centred)
    best, name = 0.4, ''
    laws = {
        'its displacement': displacement,
        'the cube of its displacement': displacement**3,
        'its velocity': velocity,
        'the sign of its velocity': np.sign(velocity),
        'its velocity times its speed': velocity * np.abs(velocity),
    }
    for label, law in laws.items():
        shape = law - np.mean(law)
        size = float(shape @ shape)
        if size <= 0 or power <= 0:
            continue
        share = float(shape @ centred) ** 2 / (size * power)
        if share > best:
            best, name = share, label
    return f'{best:.0%} of the residual goes with {name}' if name else ''
