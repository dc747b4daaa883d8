"""Where a model and recordings differ: time, phase of the blow, frequency band, state.

Each channel of each recording is cut at the turns of the blow (contact, peak, loss of contact) and
into pieces of at most ``PIECE`` s. Two things name a piece: its misfit, a chi-square of its own,
by the rate of false discoveries over all pieces; and what was found, by where it changes the
prediction. The second knows no noise: a weak effect stands out of no piece, yet the model says in
which it acts.
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
MOST = 200  # regions that are named
SURE = 2.0  # standard deviations of chi-square that noise may have
ENOUGH = 0.8  # share of what the findings change that the named pieces hold, the densest first


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
    held_out: bool = False


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

    Args:
        strips: of all channels of all recordings.
        rate: share of false discoveries among the pieces that their misfit names.
    """
    pieces = [piece for strip in strips for piece in _pieces(strip)]
    if not pieces:
        return ()
    found = first_discoveries([p.p_value for p in pieces], rate)
    chosen = {i for i, yes in enumerate(found) if yes}
    for held_out in (False, True):  # nothing was re-tuned to what was held out: more shows there
        places = [i for i, p in enumerate(pieces) if p.strip.held_out is held_out]
        acting = _where_findings_act([pieces[i] for i in places])
        chosen |= {places[i] for i in acting}
    runs = _runs([p for i, p in enumerate(pieces) if i in chosen or _between(pieces, chosen, i)])
    ordered = sorted(runs, key=_strength, reverse=True)
    return tuple(_region(run) for run in ordered[:MOST])


def _where_findings_act(pieces: Sequence[_Piece]) -> set[int]:
    """Places of the pieces in which most of what the findings change lies."""
    changes = np.array([p.change for p in pieces])
    densest = np.argsort([-p.change / (p.end - p.start) for p in pieces])
    before = np.cumsum(changes[densest]) - changes[densest]
    needed = (before < ENOUGH * np.sum(changes)) & (changes[densest] > 0.0)
    return {int(i) for i in densest[needed]}


def _between(pieces: Sequence[_Piece], chosen: set[int], i: int) -> bool:
    """Whether both neighbours of a piece are named: what acts there passes through a zero."""
    if i - 1 not in chosen or i + 1 not in chosen:
        return False
    return all(
        p.strip is pieces[i].strip and p.phase == pieces[i].phase
        for p in (pieces[i - 1], pieces[i + 1])
    )


def _strength(run: Sequence[_Piece]) -> float:
    """Evidence of a run of pieces: what findings change there, or the misfit beyond noise."""
    beyond = sum(p.chi_square - int(np.count_nonzero(p.mask)) for p in run)
    return max(sum(p.change for p in run), beyond)


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    strip: Strip
    phase: str
    mask: NDArray[np.bool_]
    start: float
    end: float
    chi_square: float
    p_value: float
    change: float  # of the whitened prediction by the findings, squared and summed


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
                    float(np.sum((baseline - extended) ** 2)),
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
    change = residual - strip.extended[mask]
    # what is found there is known without noise, unless it is not most of what is wrong there
    beyond = chi_square - residual.size - SURE * math.sqrt(2.0 * residual.size)
    told = float(change @ change) > 0.5 * max(beyond, 0.0)
    shown = change if told else residual
    return Region(
        recording=strip.recording,
        channel=strip.channel,
        start_s=run[0].start,
        end_s=run[-1].end,
        phase=run[0].phase,
        band_hz=band_of(strip.time[mask], shown),
        p_value=_chance(residual, change, chi_square),
        ratio=math.sqrt(chi_square / residual.size),
        state=state_of(shown, strip.displacement[mask], strip.velocity[mask]),
    )


def _chance(residual: Array, change: Array, chi_square: float) -> float:
    """Chance that noise alone has so large a misfit, or one so like what the findings change."""
    by_size = float(stats.chi2.sf(chi_square, residual.size))
    length = float(np.linalg.norm(change))
    if not length > 0.0:
        return by_size
    return min(1.0, 2.0 * min(by_size, float(stats.norm.sf(change @ residual / length))))


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
