"""Figures of the answer: regions, errors before and after, curves, what is left."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import signal, stats

from impactscope.discrepancy.answer import Finding, FitFigures, FitTable, Region, Trace
from impactscope.discrepancy.driven.findings.misfit_regions import case_regions
from impactscope.discrepancy.driven.findings.quantisation_steps import STEPS, rounding
from impactscope.discrepancy.driven.findings.ranking import unknown_finding
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.fits.simulation_error import Fit, plainly_begun
from impactscope.discrepancy.driven.model_selection.chi_square import NoiseJudge
from impactscope.discrepancy.driven.model_selection.model_comparison import noise_floor
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.systems.prescribed_motion_noise import counting_of
from impactscope.discrepancy.evidence import (
    family_p_value,
    first_discoveries,
    is_white,
    white_p_value,
)

__all__ = [
    'left_over',
    'p_value_of',
    'p_value_of_rest',
    'p_value_of_wrong',
    'places',
    'table',
    'traces',
]

Array = NDArray[np.float64]

WINDOWS = 32  # into which a recording is cut to say where it differs
LARGE = 0.05  # of the channel: what is left beyond this asks for an explanation
REMOVED = 0.5  # of the baseline's residual: what is left below this was mostly explained
TOO_LARGE = 0.2  # of the channel: what is left beyond this was not, however much it was before


def p_value_of(s: Subject, final: Fit) -> float:
    """Chance of what was found where nothing is missing."""
    if isinstance(s.judge, NoiseJudge):
        tried = [final] if final is not s.outcome.baseline else list(s.outcome.rivals)
        chances = [s.judge.p_value(s.outcome.baseline, f) for f in tried]
        if s.verdict is not None and s.verdict.left:
            chances.append(s.verdict.strongest.p_value)
        chances += [
            family_p_value(gain, 1, s.judge.looks)
            for _, _, gain in rounding(s).values()
            if gain > STEPS
        ]
        return min(chances, default=1.0)
    if s.verdict is not None and s.verdict.left:
        return s.verdict.strongest.p_value
    gain = s.judge.gain(s.outcome.baseline, final)
    if final is s.outcome.baseline:
        gains = [s.judge.gain(final, f) for f in s.outcome.rivals if f.added > final.added]
        best = max(gains, key=lambda g: g.fitted - 2 * g.numbers, default=None)
        if best is None:
            return 1.0
        gain = best
    return family_p_value(max(gain.fitted, 0.0), max(gain.numbers, 1), s.judge.looks)


def p_value_of_wrong(wrong: Finding) -> float:
    """Chance that a number of a file is met so badly where it is right; 1 where unknown."""
    if not math.isfinite(wrong.evidence):
        return 1.0
    return family_p_value(wrong.evidence, 1, 1)


def p_value_of_rest(s: Subject, final: Fit) -> float:
    """Chance that what a fit leaves is white noise, in all recordings together."""
    pairs = zip(s.segments, final.residuals, strict=True)
    chances = [white_p_value(_as_white(segment, left)) for segment, left in pairs]
    return min(1.0, len(chances) * min(chances, default=1.0))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def left_over(s: Subject, base: Fit, final: Fit) -> tuple[bool, str]:
    """Whether what is left is as much as if nothing were known, and a sentence on it.

    The sentence is empty where noise is all that is left.
    """
    if s.verdict is not None:
        return s.verdict.left, unknown_finding(s.verdict).sentence if s.verdict.left else ''
    worst: tuple[float, bool, str] = (0.0, False, '')
    for i, segment in enumerate(s.segments):
        residual, baseline = (_as_white(segment, f.residuals[i]) for f in (final, base))
        left, size, before = _rms(residual), _rms(segment.measured), _rms(baseline)
        noise = noise_floor(segment, residual)
        ratio = left / noise if noise > 0.0 else math.inf
        if left <= 1e-7 * size or ratio**2 <= s.judge.thresholds.unexplained_ratio:
            continue
        if is_white(residual):
            continue
        stated = segment.channel in s.campaign.noise_std
        much = left > REMOVED * before or left > TOO_LARGE * size
        asks = (stated or left > LARGE * size) and much
        low, high = _band(residual, segment.period)
        begin, end = (round(t, 9) + 0.0 for t in _loudest(segment, residual))
        text = (
            f'{segment.recording}: {left:.3g} {segment.unit} rms of {segment.channel} is left '
            f'({left / size:.2g} of the signal, {ratio:.3g} times the noise), mostly from '
            f'{low:.3g} to {high:.3g} Hz, and largest from {begin:.4g} to {end:.4g} s.'
        )
        if (asks, left / size) > (worst[1], worst[0]):
            worst = left / size, asks, text
    return worst[1], worst[2]


def _as_white(segment: Segment, residual: Array) -> Array:
    """A residual whose noise would be white, in the channel's unit."""
    if segment.whitener is None:
        return residual
    return segment.noise * segment.whitened(residual)


def _loudest(segment: Segment, residual: Array) -> tuple[float, float]:
    """From when to when most of a residual is, s after the recording's first sample."""
    parts = np.array_split(residual, min(WINDOWS, residual.size))
    place = int(np.argmax([np.mean(p**2) for p in parts]))
    first = sum(p.size for p in parts[:place])
    edges = first, first + parts[place].size
    return segment.begin + segment.period * edges[0], segment.begin + segment.period * edges[1]


def _band(residual: Array, period: float) -> tuple[float, float]:
    """Band with the middle 80 % of a residual's power, Hz."""
    length = min(residual.size, 8192)
    frequency, power = signal.welch(residual, 1.0 / period, nperseg=length, detrend=False)
    share = np.cumsum(power)
    low, high = np.interp([0.1 * share[-1], 0.9 * share[-1]], share, frequency)
    return float(low), float(high)


def places(s: Subject, base: Fit, final: Fit) -> tuple[Region, ...]:
    """Where the baseline differs from the recordings."""
    if s.case is None:
        return _regions(s, base, final)
    column = None
    if s.verdict is not None and s.verdict.left:
        column = s.verdict.strongest.column
        final = base if s.verdict.instead else final
    rate = s.judge.thresholds.false_region
    found = case_regions(s.model, base, final, column, s.segments, s.case.phases, rate)
    stepped = {c for c, (_, _, gain) in rounding(s).items() if gain > STEPS}
    found += tuple(_throughout(x) for x in s.segments if x.channel in stepped)
    return found


def _throughout(segment: Segment) -> Region:
    """A recording from end to end."""
    return Region(
        segment.recording, segment.channel, segment.begin, float(segment.time[-1]), 'before'
    )


def _regions(s: Subject, base: Fit, final: Fit) -> tuple[Region, ...]:
    """Intervals in which the baseline's residual exceeds what the extended model leaves."""
    rows = []
    for i, segment in enumerate(s.segments):
        edges = np.linspace(0, segment.measured.size, WINDOWS + 1).astype(int)
        floor = max(_rms(final.residuals[i]), 1e-9 * _rms(segment.measured), 1e-300)
        counts = max(s.judge.weights(final)[i] / WINDOWS, 1.0)
        for a, b in itertools.pairwise(edges):
            ratio = _rms(base.residuals[i][a:b]) / floor
            p = float(stats.chi2.sf(counts * ratio**2, counts))
            rows.append((i, int(a), int(b), p))
    hits = first_discoveries([r[3] for r in rows], s.judge.thresholds.false_region)
    if not np.any(hits):  # the strongest windows, so that an answer says where to look
        order = np.argsort([r[3] for r in rows])
        hits[order[: max(1, len(rows) // 16)]] = True
    runs: list[list[tuple[int, int, int, float]]] = []
    for row, hit in zip(rows, hits, strict=True):
        if not hit:
            continue
        if runs and runs[-1][-1][0] == row[0] and runs[-1][-1][2] == row[1]:
            runs[-1].append(row)
        else:
            runs.append([row])
    regions = []
    for run in runs:
        i, a, b = run[0][0], run[0][1], run[-1][2]
        segment = s.segments[i]
        part = base.residuals[i][a:b]
        regions.append(
            Region(
                segment.recording,
                segment.channel,
                segment.begin + a * segment.period,
                segment.begin + b * segment.period,
                '',
                _band(part, segment.period) if part.size >= 16 else None,
                min(r[3] for r in run),
                _rms(part) / max(_rms(final.residuals[i]), 1e-300),
            )
        )
    return tuple(sorted(regions, key=lambda r: -r.ratio))


def table(s: Subject, base: Fit, final: Fit) -> FitTable:
    """Errors before and after, by channel, beside the noise."""
    base, final = _shown(s, base, final)
    floor: dict[str, float] = {}
    for i, segment in enumerate(s.segments):
        value = noise_floor(segment, final.residuals[i])
        floor[segment.channel] = min(value, floor.get(segment.channel, math.inf))
    return FitTable(_figures(s, base, floor), _figures(s, final, floor), floor)


def _shown(s: Subject, base: Fit, final: Fit) -> tuple[Fit, Fit]:
    """Baseline and extended model with the beginnings that their figures and curves have."""
    return plainly_begun(s.model, base, s.segments), plainly_begun(s.model, final, s.segments)


def _figures(s: Subject, made: Fit, floor: Mapping[str, float]) -> FitFigures:
    def rmse(held_out: bool) -> dict[str, float]:
        found = {}
        for channel in dict.fromkeys(x.channel for x in s.segments):
            parts = [
                counting_of(x, made.residuals[i])
                for i, x in enumerate(s.segments)
                if x.channel == channel and x.held_out == held_out
            ]
            if parts:
                found[channel] = _rms(np.concatenate(parts))
        return found

    def reduced(values: Mapping[str, float]) -> float:
        ratios = [(v / floor[c]) ** 2 for c, v in values.items() if floor[c] > 0.0]
        return float(np.mean(ratios)) if ratios else math.nan

    fitted, held_out = rmse(False), rmse(True)
    return FitFigures(fitted, held_out, reduced(fitted), reduced(held_out))


def traces(s: Subject, base: Fit, final: Fit) -> tuple[Trace, ...]:
    """Measured and predicted samples of all recordings."""
    base, final = _shown(s, base, final)
    found = []
    best = s.outcome.best
    for i, segment in enumerate(s.segments):
        x = v = np.zeros(0)
        if best.starts:  # none where the model is a sum of modes
            x, v = s.model.motion(best.values, best.terms, best.starts[i], segment)
        found.append(
            Trace(
                segment.recording,
                segment.channel,
                segment.unit,
                segment.held_out,
                noise_floor(segment, final.residuals[i]),
                segment.time,
                segment.measured,
                segment.measured - base.residuals[i],
                segment.measured - final.residuals[i],
                np.asarray(x),
                np.asarray(v),
            )
        )
    return tuple(found)
