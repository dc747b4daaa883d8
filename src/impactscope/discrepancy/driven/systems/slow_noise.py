"""Slow noise: it falls with the frequency, and is read from what a fit leaves.

Filters, couplings, drifts, levels that differ between recordings: such findings and noise that is
not white look alike. But noise stands between the lines of what moves, and goes on where nothing
moves. Its colour is read from the cosine transform of what each recording leaves, which tells
slow noise best (Ahmed, Natarajan and Rao, IEEE Trans. Comput. C-23 (1974)): the first
coefficients of a recording are its level and its slope.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import fft, stats

from impactscope.discrepancy.driven.adequacy.unmodelled_laws import Verdict
from impactscope.discrepancy.driven.fits.innovations import innovations
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.model_selection.chi_square import NoiseJudge
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.noise.coloured_noise import (
    COLOURED,
    Colour,
    fitted_colour,
    forgetting,
    kept,
    spectrum,
)
from impactscope.discrepancy.driven.noise.kalman_whitening import Whitener
from impactscope.discrepancy.driven.noise.spectral_whitening import Stepped
from impactscope.discrepancy.driven.systems.case import Case
from impactscope.discrepancy.driven.systems.chain_noise import ChainNoise, settled_ends
from impactscope.discrepancy.driven.systems.prescribed_motion_noise import PrescribedMotionNoise

__all__ = [
    'colour_of_recordings',
    'knowing_slow_noise',
    'like_noise',
    'may_be_slow_noise',
    'plain_noise',
    'white_logarithm',
    'whitened_logarithm',
    'without_slow_effects',
]

Array = NDArray[np.float64]

SLOW = ('ac_coupling', 'offset', 'zero_drift')  # effects that slow noise may look like
LAWS = ('an offset that differs between recordings', 'a drift that differs between recordings')
OWN = 2  # lowest coefficients: what all recordings have of them is no noise
ALONE = 4  # lowest coefficients of which each is a part of its own
WIDER = 1.25  # from one part of the spectrum to the next
FEW = 20  # coefficients, of which all count
MOST, SHARE = 0.9, 0.62315  # of more of them that count, and the mean of these where all are noise
LEAST = 1e-12  # of a level
DOUBT = 0.05  # chance of noise that is slower than a recording to be more than is allowed for
# deviance of the middle part of a spectrum, and scatter of a recording's twelfths over that of
# noise, from which what is left is not noise alone
UNLIKE, UNEVEN, BLOCKS = 2.5, 3.0, 12


def may_be_slow_noise(best: Fit, said: Verdict) -> bool:
    """Whether slow noise looks like anything that was found, or that is left."""
    found = any(t.name in SLOW for t in best.terms)
    return found or (said.left and said.strongest.law in LAWS)


def plain_noise(case: Case) -> Case | None:
    """The case with noise whitened that is all that the baseline leaves; None if it is not."""
    known = knowing_slow_noise(case, case.baseline)
    if known is None or not like_noise(_left(known, known.baseline)):
        return None
    return known


def without_slow_effects(case: Case, made: Fit) -> Fit:
    """A fit without what may be slow noise in disguise, of which it takes a part."""
    rest = tuple(t for t in made.terms if t.name not in SLOW)
    if rest == made.terms:
        return made
    return fit(case.model, rest, case.segments, made.values, case.baseline.starts)


def knowing_slow_noise(case: Case, made: Fit, needed: float = COLOURED) -> Case | None:
    """The case with the noise whitened that a fit leaves; None where it is white already.

    Args:
        case: as it was searched.
        made: a fit in it.
        needed: twice the logarithm of the likelihood by which it is not white.
    """
    case = _evenly(case)
    colour = _colour_left(case, made, needed)
    if colour is None:
        return None
    left = _left(case, made)
    louder = math.sqrt(float(np.mean(np.concatenate(_without_common_line(left)) ** 2)))
    size = max(s.measured.size for s in case.segments)
    # what slow noise does to a plate's filter was read as noise: once more, by what is left
    if case.settled is None:
        known = [_whitened_by(s, colour, size) for s in case.segments]
        white = _left(dataclasses.replace(case, segments=known), made)
    else:
        white = [forgetting(colour, size)(r) for r in left]
    _, level, count = _parts_of(white)
    colour = colour.times(float(np.average(level, weights=count)))
    case = _by_its_colour(case, colour)

    def slowly(these: Sequence[Segment]) -> list[Segment]:
        return [
            dataclasses.replace(_whitened_by(s, colour, size), noise=louder * s.noise)
            for s in these
        ]

    def anew(found: Fit) -> tuple[Fit, list[Segment]]:
        assert case.settled is not None  # noqa: S101 - only then is this asked
        there, those = case.settled(found)
        return there, slowly(those)

    ready = slowly(case.segments)
    before = case.baseline
    return dataclasses.replace(
        case,
        segments=ready,
        baseline=fit(case.model, (), ready, before.values, before.starts, tolerance=FINE),
        judge=NoiseJudge(ready, case.judge.muffled, scatter=case.judge.scatter),
        noise={name: std * louder for name, std in case.noise.items()},
        settled=None if case.settled is None else anew,
    )


def _evenly(case: Case) -> Case:
    """A chain whose noise is taken for equally loud everywhere, before its colour is read.

    Lines that its ends are thought to show faintly only may be slow noise.
    """
    if not all(isinstance(s.whitener, ChainNoise) for s in case.segments):
        return case
    evened = []
    for s in case.segments:
        assert isinstance(s.whitener, ChainNoise)  # noqa: S101 - as asked above
        ends = s.whitener.evened_out()
        evened.append(dataclasses.replace(s, whitener=ends, noise=ends.flat))
    return dataclasses.replace(case, segments=evened, settled=settled_ends(case.model, evened))


def _by_its_colour(case: Case, colour: Colour) -> Case:
    """A chain whose filters act where the signal stands clear of noise of a colour."""
    gain = case.baseline.values.get('gain', 1.0)
    inputs = [s.drive[:2].sum(axis=0) for s in case.segments if not s.held_out]
    known = [
        s.whitener.coloured(s, colour, gain, inputs) if isinstance(s.whitener, ChainNoise) else s
        for s in case.segments
    ]
    settled = case.settled
    if all(isinstance(s.whitener, ChainNoise) for s in known):
        settled = settled_ends(case.model, known)
    return dataclasses.replace(case, segments=known, settled=settled)


def _whitened_by(segment: Segment, colour: Colour, size: int) -> Segment:
    """A recording with noise of a colour whitened; beside it a motion's noise tells less."""
    whitener = segment.whitener
    if isinstance(whitener, PrescribedMotionNoise):
        return dataclasses.replace(segment, whitener=whitener.knowing(colour, size))
    if isinstance(whitener, Whitener):
        return dataclasses.replace(segment, whitener=whitener.knowing(colour))
    return dataclasses.replace(segment, slow=forgetting(colour, size))


def whitened_logarithm(case: Case) -> float:
    """Logarithm of the determinant of the noise that is whitened by colour, if fitted."""
    found = 0.0
    for s in case.segments:
        if s.held_out:
            continue
        whitener, slow, size = s.whitener, s.slow, s.measured.size
        if isinstance(whitener, PrescribedMotionNoise):
            slow, size = whitener.slow, whitener.counted(size)
        if isinstance(whitener, ChainNoise):
            found += whitener.logarithm(s.measured.size)
        if isinstance(whitener, Whitener):
            found += whitener.logarithm()
        elif slow is not None:
            found += slow.logarithm(size)
    return found


def white_logarithm(case: Case) -> float:
    """Logarithm of the determinant of the noise beside that, at most; infinite if not known."""
    found = 0.0
    for s in case.segments:
        if isinstance(s.whitener, (PrescribedMotionNoise, ChainNoise, Stepped)):
            return math.inf
        if not s.held_out and not isinstance(s.whitener, Whitener):
            found += 2.0 * s.measured.size * math.log(s.noise)
    return found


def _left(case: Case, made: Fit) -> list[Array]:
    """What a fit leaves of the fitted recordings, over the noise that is whitened already."""
    settled, segments = case.settled(made) if case.settled is not None else (made, case.segments)
    pairs = zip(segments, settled.residuals, strict=True)
    return [innovations(s, r) for s, r in pairs if not s.held_out]


def _without(case: Case, change: Callable[[PrescribedMotionNoise], PrescribedMotionNoise]) -> Case:
    """A case of a prescribed motion with another noise."""
    return dataclasses.replace(
        case,
        segments=[
            dataclasses.replace(s, whitener=change(s.whitener))
            if isinstance(s.whitener, PrescribedMotionNoise)
            else s
            for s in case.segments
        ],
    )


def _colour_left(case: Case, made: Fit, needed: float) -> Colour | None:
    """The colour of what a fit leaves; None where it is white."""
    moved = isinstance(case.segments[0].whitener, PrescribedMotionNoise)
    if not moved:
        return colour_of_recordings(_left(case, made), needed)
    # by which share the motion's noise is there is known once the force's is
    whole = _without(case, lambda w: dataclasses.replace(w, motion=0.0))
    colour = colour_of_recordings(_left(whole, made), needed)
    if colour is None:
        return colour_of_recordings(_left(case, made), needed)
    known = colour
    beside = _without(case, lambda w: dataclasses.replace(w, colour=known))
    return colour_of_recordings(_left(beside, made), needed) or colour


def colour_of_recordings(left: Sequence[Array], needed: float = COLOURED) -> Colour | None:
    """The colour of noise, of which each recording is one stretch, shapes (n,); None: white."""
    place, level, count = _parts_of(left)
    longest = max(r.size for r in left)
    found = fitted_colour(
        place, level, count, seen_as=partial(_seen, place, longest), needed=needed
    )
    if found is None:
        return None
    # of what is slower than a recording few numbers tell: it may be as much as that, if it is as
    # much slower; within a recording it looks the same
    freedom = max(OWN * (len(left) - 1), 1)
    most = freedom / float(stats.chi2.ppf(DOUBT, freedom))
    parts = tuple((v * most, c / most) if c < 1.0 / longest else (v, c) for v, c in found.parts)
    return dataclasses.replace(found, parts=parts)


def like_noise(white: Sequence[Array]) -> bool:
    """Whether whitened residuals are noise everywhere in frequency and in time.

    What an effect leaves is louder where the motion is, and in bands.
    """
    _, level, count = _parts_of(white)
    if float(np.median(2.0 * count * (level - 1.0 - np.log(level)))) > UNLIKE:
        return False
    scatter = [
        0.5 * b.size * (float(np.mean(b**2)) - 1.0) ** 2
        for r in white
        for b in np.array_split(r, BLOCKS)
        if b.size
    ]
    return float(np.mean(scatter)) < UNEVEN


def _parts_of(left: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Middles of the parts of a spectrum over half the rate, their levels, and their lines."""
    longest = max(r.size for r in left)
    edges = list(range(ALONE + 1))
    while edges[-1] < longest:
        edges.append(min(max(edges[-1] + 1, int(WIDER * edges[-1])), longest))
    lines = [fft.dct(r, norm='ortho') for r in _without_common_line(left)]
    place, level, count = [], [], []
    for first, last in itertools.pairwise(edges):
        if last <= OWN:
            freedom = len(left) - 1
            if freedom < 1:
                continue
            level.append(sum(float(x[first]) ** 2 for x in lines) / freedom)
        else:
            parts = [x[first * x.size // longest : last * x.size // longest] for x in lines]
            power = np.concatenate(parts) ** 2
            freedom = power.size
            if freedom == 0:
                continue
            few = freedom < FEW
            level.append(float(np.mean(power) if few else _most(power)))
        place.append(0.5 * (first + last - 1) / longest)
        count.append(0.5 * freedom)
    return np.array(place), np.maximum(level, LEAST), np.array(count)


def _most(power: Array) -> float:
    """Mean of squares of normal numbers, among which a few may be lines, shape (n,)."""
    kept = np.sort(power)[: round(MOST * power.size)]
    return float(np.mean(kept)) / SHARE


def _without_common_line(left: Sequence[Array]) -> list[Array]:
    """Recordings without the level and the slope that all of them have."""
    time = np.concatenate([np.arange(r.size, dtype=np.float64) for r in left])
    line = np.polyfit(time, np.concatenate(left), OWN - 1)
    return [r - np.polyval(line, np.arange(r.size)) for r in left]


def _seen(place: Array, size: int, corner: float) -> Array:
    """Levels that a part of unit variance has in parts of a cosine transform, shape (k,)."""
    level = spectrum(place, corner)
    lags = kept(corner) ** np.arange(size)
    for i, p in enumerate(place):
        k = round(p * size)
        if k < ALONE:  # there a spectrum is not yet what a recording shows
            level[i] = float(_folded(size, k) @ lags)
    return level


@functools.lru_cache(maxsize=16)
def _folded(size: int, k: int) -> Array:
    """How a cosine overlaps with itself, by lags either way, shape (size,)."""
    wave = fft.idct(np.eye(1, size, k)[0], norm='ortho')
    overlap = np.fft.irfft(np.abs(np.fft.rfft(wave, 2 * size)) ** 2)[:size]
    overlap[1:] *= 2.0
    return np.asarray(overlap)
