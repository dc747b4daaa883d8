"""Whether a residual is more than noise by its size alone, as a whole or in parts.

A law that acts for a few milliseconds only, or in one recording, may look like none of those that
are tried; what it leaves is there all the same.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from impactscope.discrepancy.driven.adequacy.unmodelled_laws import UnmodelledLaw, Verdict
from impactscope.discrepancy.driven.fits.innovations import innovations
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.fits.weighted_residuals import numbers_of
from impactscope.discrepancy.driven.model_selection.chi_square import slight
from impactscope.discrepancy.driven.model_selection.model_comparison import counting_samples
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel
from impactscope.discrepancy.driven.search.beam_search import Outcome
from impactscope.discrepancy.driven.systems.case import Case
from impactscope.discrepancy.driven.systems.chain import ChainModel
from impactscope.discrepancy.driven.systems.prescribed_motion_noise import (
    counting_of,
    power_of_noise,
)
from impactscope.discrepancy.driven.systems.prescribed_noise_limited import NoiseLimitedMotionModel
from impactscope.discrepancy.evidence import quantisation_step

__all__ = ['LARGER', 'SURE', 'comes_with_the_signal', 'left_open', 'more_than_noise']

Array = NDArray[np.float64]

LARGER = 0.25  # of reduced chi-square, by which what is left is more than noise
MUCH_LARGER = 1.0  # the same where the level of the noise is read from the same recordings
SURE = 6.0  # standard deviations of it
STRETCH = 32  # samples in a row
LOUD = 4.0  # times the noise, in power, that no such stretch has by chance
STRETCHES = 16  # of a recording
MOST_OF_THEM = 0.9
COMES = 4.0  # times as large as in the quiet
STILL = 0.25  # of what the baseline leaves there, more than a form of what was found that is off
IMPOSSIBLE = 4.0  # standard uncertainties below nothing
UNLIKELY = 1e-3  # chance of numbers as far away as they would have to be
MOST = 4.0  # times the noise: what a single sample may count, for some stand out alone


def more_than_noise(case: Case, outcome: Outcome, said: Verdict) -> Verdict:
    """What a verdict becomes where more than noise is left, whatever it looks like.

    Of plates and chains the noise's level is known less well: there more than twice the noise is
    asked for. Where nothing was found a recording is compared with what is left of the others. A
    recording that was held out may be missed as far as the fitted ones leave the numbers open.
    """
    if said.left:
        return said
    best = outcome.best
    alone = best is outcome.baseline
    before, left = case.judge.chi_squares(outcome.baseline), case.judge.chi_squares(best)
    usual, larger = 1.0, LARGER
    known = isinstance(case.model, NoiseLimitedMotionModel) or case.model.drifts
    if not known:
        if not alone and isinstance(case.model, ChainModel):
            return said
        pairs = zip(left, case.segments, strict=True)
        ratios = [x / s.measured.size for x, s in pairs if not s.held_out]
        usual, larger = max(1.0, float(np.median(ratios))) if alone else 1.0, MUCH_LARGER
    for s, was, chi_square in zip(case.segments, before, left, strict=True):
        count = s.measured.size
        error = slight(best) * was / count
        if not any(t.rough for t in best.terms):  # however much a law has explained
            error = min(error, larger)
        if chi_square / count > usual * (1.0 + larger + SURE * math.sqrt(2.0 / count)) + error:
            if s.held_out and left_open(case, best):
                continue
            law = f'nothing that was tried; {s.recording} is left {chi_square / count:.3g} times'
            rest = UnmodelledLaw(f'{law} its noise in power', chi_square - count, 1)
            return Verdict(True, alone, rest, 1.0)
    if known and not alone:
        louder = _louder_than_its_noise(case, best)
        if louder:
            rest = UnmodelledLaw(f'nothing that was tried; {louder}', 1e3, 1)
            return Verdict(True, False, rest, 1.0)
    doubt = _no_machine(best) or _comes_and_goes(case, best) if alone else ''
    if doubt:
        return Verdict(True, True, UnmodelledLaw(f'nothing that was tried; {doubt}', 1e3, 1), 1.0)
    # an error of the force rings on; a filter's own errors stand where a blow begins
    if isinstance(case.model, OscillatorModel) or not alone:
        return said
    loudest = max(_loudest(case, best, i, usual) for i in range(len(case.segments)))
    if loudest[0] > LOUD:
        return Verdict(
            True, alone, UnmodelledLaw(loudest[1], (loudest[0] - 1.0) * STRETCH, 1), 1.0
        )
    return said


def _louder_than_its_noise(case: Case, made: Fit) -> str:
    """What is left of the fitted recordings, where its noise has no such power at all.

    A filter makes anything white; whether noise of that colour is as loud is another question.
    """
    pairs = zip(case.segments, made.residuals, strict=True)
    rows = [(s, counting_of(s, r)) for s, r in pairs if not s.held_out]
    power = float(np.mean([np.mean(r**2) / power_of_noise(s) for s, r in rows]))
    independent = math.fsum(counting_samples(r) for _, r in rows)
    if power < 1.0 + MUCH_LARGER + SURE * math.sqrt(2.0 / independent):
        return ''
    return f'what is left is {power:.3g} times its noise in power'


def left_open(case: Case, made: Fit) -> bool:
    """Whether numbers that fit the fitted recordings as well explain those held out, too.

    A stop that is just reached is known roughly, and what presses into it is missed by far.
    """
    together = [dataclasses.replace(s, held_out=False) for s in case.segments]
    joint = fit(case.model, made.terms, together, made.values, made.starts, tolerance=FINE)
    rise = 0.0
    both = case.judge.chi_squares(made), case.judge.chi_squares(joint)
    for s, before, after in zip(case.segments, *both, strict=True):
        if s.held_out:
            count = s.measured.size
            if after / count > 1.0 + LARGER + SURE * math.sqrt(2.0 / count):
                return False
        else:
            rise += after - before
    shared = len(numbers_of(case.model, made.terms))
    return rise < float(stats.chi2.isf(UNLIKELY, max(shared, 1)))


def comes_with_the_signal(case: Case, made: Fit) -> bool:
    """Whether a fit leaves what comes with the signal, and that is much of what there was.

    It is no noise then, of whatever colour.
    """
    for i, (s, left) in enumerate(zip(case.segments, made.residuals, strict=True)):
        part, times, _ = _loudest_part(s, left)
        before = np.array_split(case.baseline.residuals[i], STRETCHES)[part]
        rest = np.array_split(left, STRETCHES)[part]
        if times > COMES and np.linalg.norm(rest) > STILL * np.linalg.norm(before):
            return True
    return False


def _no_machine(made: Fit) -> str:
    """What is impossible in the numbers of a linear model that is said to explain everything."""
    for name in ('mass', 'damping'):
        value, std = made.values.get(name, 0.0), made.std.get(name, math.inf)
        if value < -IMPOSSIBLE * std:
            return f'and the {name} that fits best is negative, {value:.4g} with {std:.2g}'
    return ''


def _comes_and_goes(case: Case, made: Fit) -> str:
    """Where what is left is far larger than in the quiet of the same recording: no noise is.

    By its changes from sample to sample, which are alike everywhere also in slow noise.
    """
    for s, left in zip(case.segments, made.residuals, strict=True):
        _, times, where = _loudest_part(s, left)
        if times > COMES:
            begin, end = (s.begin + s.period * k for k in where)
            return (
                f'what is left of {s.recording} is {times:.3g} times as large from '
                f'{begin:.4g} to {end:.4g} s as where it is quiet'
            )
    return ''


def _loudest_part(segment: Segment, left: Array) -> tuple[int, float, tuple[int, int]]:
    """Which part of a recording is left loudest, times its quiet, and from which sample to which.

    By changes from sample to sample; readings that rest on a step of the converter have none.
    """
    if left.size < STRETCHES * STRETCH:
        return 0, 0.0, (0, 0)
    step = quantisation_step(segment.measured)
    parts = np.array_split(np.diff(left), STRETCHES)
    # samples that stand out alone are no part of it
    sizes = np.array([float(np.quantile(np.abs(p), MOST_OF_THEM)) for p in parts])
    quiet = max(float(np.median(np.sort(sizes)[: STRETCHES // 4])), step)
    place = int(np.argmax(sizes))
    first = sum(p.size for p in parts[:place])
    return place, float(sizes[place]) / (quiet or 1e-300), (first, first + parts[place].size)


def _loudest(case: Case, made: Fit, index: int, usual: float) -> tuple[float, str]:
    """The loudest stretch of a recording in units of the usual noise's power, and where it is."""
    s = case.segments[index]
    left = innovations(s, made.residuals[index])
    if left.size < STRETCH:
        return 0.0, ''
    even = np.full(STRETCH, 1.0 / STRETCH)
    power = np.convolve(np.clip(left, -MOST, MOST) ** 2, even, 'valid') / usual
    place = int(np.argmax(power))
    begin, end = (s.begin + s.period * k for k in (place, place + STRETCH))
    return float(power[place]), (
        f'nothing that was tried; {s.recording} is left {power[place]:.3g} times its noise in '
        f'power from {begin:.4g} to {end:.4g} s'
    )
