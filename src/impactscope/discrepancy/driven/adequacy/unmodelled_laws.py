"""Tests whether a law that no known effect describes is left in the residual, and which.

A weak effect from outside the library lifts chi-square by some tens among fifty thousand: no
ratio shows it. So the residual is held against many laws that physics has and the vocabulary
lacks, each projected on what the model cannot re-tune, and against lines in the spectrum. None of
these laws is ever named as the finding; the strongest one describes what is left.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize, stats

from impactscope.discrepancy.driven.fits.innovations import innovations
from impactscope.discrepancy.driven.fits.linearisation import Linearisation, linearised
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.chi_square import LOOKS as EFFECTS
from impactscope.discrepancy.driven.model_selection.chi_square import slight
from impactscope.discrepancy.driven.model_selection.overdispersion import levels_above, worth_of
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.terms import key
from impactscope.discrepancy.driven.noise.spectral_whitening import Stepped
from impactscope.discrepancy.evidence import at_a_bound, borne_by_many

__all__ = [
    'BESIDE',
    'LOOKS',
    'Group',
    'Laws',
    'UnmodelledLaw',
    'Verdict',
    'contrasts',
    'equivalent_gain',
    'fitted_numbers',
    'unmodelled_laws',
    'verdict',
]

Array = NDArray[np.float64]
LOOKS = 600  # independent laws at most, about
FALSE = 0.002  # chance that something is called left where nothing is
PERHAPS = 0.05  # the same chance, up to which it is looked at who bears what a law takes away
BESIDE = (
    1e-4  # the same beside a finding: what the finding's own errors leave looks like a law, too
)
LONE, TOLD = 6, 4.0  # samples that may stand out, and the chi-square that each of them may tell
LEAST_TO_SHAPE = 14.0  # worth of a law, from which its shape is sought further
SHAPE_STEP, SHAPES = 0.2, 80  # first step, in logarithms, and shapes at most
ELSEWHERE, RESOLVED = 1.6, 9.0  # ratio of two frequencies, and chi-square that tells them apart
MARGIN = 10.0  # chi-square by which a law beyond the vocabulary must be the better explanation
# share of what a law explains alone, by which a finding and a law beside it must explain more to
# stand together
FAR_MORE = 0.1


class Shaped(NamedTuple):
    """A law by the logarithms of the numbers that shape it."""

    start: tuple[float, ...]
    columns: Callable[[Array], list[Array]]
    law: Callable[[Array], str]


class Group(NamedTuple):
    """A law and the whitened changes that span it, each shape (n,)."""

    law: str
    columns: list[Array]
    looks: int = LOOKS  # independent laws of which it is the best; more than LOOKS where sought
    shaped: Shaped | None = None  # where it goes on between the shapes that are tried first
    differs: bool = False  # a column for each recording, which must differ to be such a law
    sought: int = 0  # independent laws of which it is the best one
    case_of: str = ''  # the mechanism of the vocabulary that it is where one number is held


Laws = Callable[[Model, Fit, Sequence[Segment]], Iterator[Group]]


@dataclass(frozen=True, slots=True, eq=False)
class UnmodelledLaw:
    """A law beyond the vocabulary and the chi-square that it would take away."""

    law: str  # as in: the rest goes like ...
    gain: float
    numbers: int
    column: Array | None = None  # whitened change on the fitted recordings, shape (n,)
    plain: float | None = None  # the same chi-square without regard to what is left about it
    looks: int = LOOKS
    sought: int = 0  # independent laws of which it is the best one
    tried: int = LOOKS  # that were held against the fit beside these
    case_of: str = ''  # the mechanism of the vocabulary that it is where one number is held

    @property
    def p_value(self) -> float:
        """Chance that the best of all laws gains this much where nothing is left."""
        single = float(stats.chi2.sf(self.gain, self.numbers))
        return float(-math.expm1(self.looks * math.log1p(-min(single, 1.0 - 1e-12))))

    @property
    def among_tried(self) -> UnmodelledLaw:
        """The same as the best of what was held against a fit, where that was less than may be."""
        fewer = LOOKS - min(self.tried + self.sought, LOOKS)
        return dataclasses.replace(self, looks=self.looks - fewer)

    @property
    def worth(self) -> float:
        """Gain of one number that would be as unlikely, the longer search paid for."""
        return equivalent_gain(self.gain, self.numbers) - 2.0 * math.log(self.looks / LOOKS)


def equivalent_gain(gain: float, numbers: int) -> float:
    """Gain of one number that is as unlikely by chance as this of several."""
    if numbers <= 1:
        return gain
    logarithm = float(stats.chi2.logsf(max(gain, 0.0), numbers))
    if logarithm > -650.0:
        return float(stats.chi2.isf(math.exp(logarithm), 1))
    return gain - (numbers - 1) * math.log(max(gain, math.e))


def _line(residuals: Sequence[Array], period: float) -> UnmodelledLaw | None:
    """The strongest line in the spectrum, at the same frequency in all recordings."""
    longest = max(r.size for r in residuals)
    length = 2 * longest
    power = np.zeros(longest + 1)
    for r in residuals:
        power += 2.0 * np.abs(np.fft.rfft(r, length)) ** 2 / r.size
    best = int(np.argmax(power[2:-1])) + 2
    # against its neighbours; of the lines of a longer transform every other one is its own
    mean = power / (2.0 * len(residuals))
    near = np.concatenate([mean[: max(best - 2, 1)], mean[best + 3 :]])
    level = levels_above(near, 2.0 / len(residuals))[min(max(best - 2, 0), near.size - 1)]
    power = power / level
    # as unlikely as that of one number, the search over frequencies paid for
    chance = float(stats.chi2.logsf(power[best], 2 * len(residuals))) + math.log(longest)
    gain = float(stats.chi2.isf(math.exp(min(chance, 0.0)), 1)) if chance > -650.0 else 1300.0
    return UnmodelledLaw(f'a line at {best / (length * period):.4g} Hz', gain, 1)


def fitted_numbers(made: Fit, segments: Sequence[Segment]) -> int:
    """Added numbers without those that the recordings held out have of their own."""
    share = sum(not s.held_out for s in segments) / len(segments)
    return made.added - made.own + round(share * made.own)


def unmodelled_laws(
    laws: Laws,
    model: Model,
    made: Fit,
    segments: Sequence[Segment],
) -> list[UnmodelledLaw]:
    """Laws beyond the vocabulary by their worth beside a fit, the strongest first."""
    here = linearised(model, made, segments)
    sizes = [s.measured.size for s in segments if not s.held_out]
    found: list[UnmodelledLaw] = []
    leading, tried = -math.inf, 1  # with the line

    def keep(new: UnmodelledLaw) -> None:
        """Without its column, which is large, where another is better."""
        nonlocal leading
        if new.worth > leading:
            leading = new.worth
        else:
            new = dataclasses.replace(new, column=None)
        found.append(new)

    shapes: dict[str, tuple[float, Shaped]] = {}  # by the law, the best start
    for law, columns, looks, shaped, differs, sought, case_of in laws(model, made, segments):
        tried += 1
        if differs and not _differ(here, columns, looks):
            continue
        new = _beside(here, sizes, law, columns, looks)
        if new is None:
            continue
        keep(dataclasses.replace(new, sought=sought, case_of=case_of))
        if shaped is not None and new.worth > shapes.get(law, (0.0, shaped))[0]:
            shapes[law] = new.worth, shaped
    for worth, shaped in shapes.values():
        if worth > LEAST_TO_SHAPE:
            for finer in _shaped(here, sizes, shaped):
                keep(finer)
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    whitened = [innovations(segments[i], made.residuals[i]) for i in fitted]
    # an axis at rest hunts between two readings of a coarse encoder: a line of its own rounding
    hunts = any(isinstance(segments[i].whitener, Stepped) for i in fitted)
    line = None if hunts else _line(whitened, segments[0].period)
    if line is not None:
        found.append(line)
    found = [dataclasses.replace(law, tried=tried) for law in found]
    return sorted(found, key=lambda s: -s.worth)


def _beside(
    here: Linearisation, sizes: Sequence[int], law: str, columns: Sequence[Array], looks: int
) -> UnmodelledLaw | None:
    """A law beside a fit; None where it says nothing of its own."""
    stack = np.stack(columns)
    size = np.linalg.norm(stack, axis=1)
    if not np.all(np.isfinite(size)) or not np.all(size > 0.0):
        return None
    gain, rank, column = _gain(here, stack / size[:, None])
    if rank == 0:
        return None
    plain = gain
    if UnmodelledLaw(law, gain, rank, looks=looks).p_value < PERHAPS:
        gain = min(_worth(here.residual, column, sizes), _of_many(here.residual, column))
    return UnmodelledLaw(law, gain, rank, column, plain, looks)


def contrasts(rows: Sequence[Array]) -> list[Array]:
    """What differs between rows of equal length, without what they have in common."""
    total = np.sum(rows, axis=0)
    power = float(total @ total) or 1.0
    return [row - (row @ total) / power * total for row in rows[:-1]]


def _differ(here: Linearisation, columns: Sequence[Array], looks: int) -> bool:
    """Whether recordings differ by a law; what they have in common is an effect of the library."""
    if len(columns) < 2:
        return False
    rows = np.stack(contrasts(columns))
    size = np.linalg.norm(rows, axis=1)
    if not np.all(np.isfinite(size)) or not np.all(size > 0.0):
        return False
    gain, rank, _ = _gain(here, rows / size[:, None])
    return UnmodelledLaw('', gain, max(rank, 1), looks=looks).p_value < FALSE


def _shaped(here: Linearisation, sizes: Sequence[int], shaped: Shaped) -> list[UnmodelledLaw]:
    """The law at the shape that takes most away, from a start near it."""

    def left(shape: Array) -> float:
        new = _beside(here, sizes, '', shaped.columns(shape), LOOKS)
        return 0.0 if new is None else -(new.plain or 0.0)

    start = np.array(shaped.start)
    corners = np.vstack([start, start + SHAPE_STEP * np.eye(start.size)])
    best = optimize.minimize(
        left,
        start,
        method='Nelder-Mead',
        options={'initial_simplex': corners, 'maxfev': SHAPES, 'xatol': 1e-3, 'fatol': 0.1},
    ).x
    new = _beside(here, sizes, shaped.law(best), shaped.columns(best), LOOKS)
    if new is None:
        return []
    # what was sought is as good as further numbers
    return [dataclasses.replace(new, numbers=new.numbers + start.size)]


def _of_many(residual: Array, column: Array) -> float:
    """Chi-square that a law takes away where no few samples decide."""
    return borne_by_many(residual**2 - (residual - column) ** 2, LONE, TOLD)


def _worth(residual: Array, column: Array, sizes: Sequence[int]) -> float:
    """Chi-square that a law takes away, over the dispersion that it leaves."""
    ends = np.cumsum(sizes)[:-1]
    return math.fsum(worth_of(np.split(residual, ends), np.split(residual - column, ends)))


def _gain(here: Linearisation, rows: Array) -> tuple[float, int, Array]:
    """Chi-square that rows of unit length, (c, n), could take away, how many count, and how."""
    seen = rows @ here.basis.T
    gram = rows @ rows.T - seen @ seen.T
    along = rows @ here.residual
    size, vectors = linalg.eigh(gram)
    keep = size > 1e-7
    if not np.any(keep):
        return 0.0, 0, np.zeros(0)
    parts = vectors[:, keep].T @ along
    factors = vectors[:, keep] @ (parts / size[keep])
    column = factors @ rows
    column = column - here.basis.T @ (here.basis @ column)
    return float(np.sum(parts**2 / size[keep])), int(np.count_nonzero(keep)), column


def _strained(best: Fit, baseline: Fit) -> bool:
    """Whether a number of a finding stands at the end of what is credible for it."""
    return any(
        at_a_bound(best.values[key(t, n)], n.lower, n.upper)
        for t in best.terms
        if t not in baseline.terms
        for n in t.numbers
        if key(t, n) in best.values
    )


def _resolved(law: UnmodelledLaw, listed: Sequence[UnmodelledLaw]) -> bool:
    """Whether the recordings tell at which frequency a law acts, to a factor of ``ELSEWHERE``.

    A resonance that might as well be anywhere has not been seen: far above or below the motion it
    is a stiffness, a mass, a delay, and stands for several effects by having no law of its own.
    """
    kind, frequency = _kind_and_frequency(law)
    return not any(
        alike == kind
        and abs(math.log(other / frequency)) > math.log(ELSEWHERE)
        and gain > law.gain - RESOLVED
        for (alike, other), gain in ((_kind_and_frequency(o), o.gain) for o in listed)
    )


def _kind_and_frequency(law: UnmodelledLaw) -> tuple[str, float]:
    """What goes like a law of that kind, and at which frequency, Hz; NaN where it has none."""
    kind, _, place = law.law.partition(' at ')
    return kind, float(place.removesuffix(' Hz')) if place.endswith(' Hz') else math.nan


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """Whether something from outside the vocabulary is at work.

    ``instead``: it explains the recordings better than what the search found, and stands in its
    place; else beside it.
    """

    left: bool
    instead: bool
    strongest: UnmodelledLaw
    probability: float  # that something outside the vocabulary is at work


def verdict(
    laws: Laws,
    model: Model,
    baseline: Fit,
    best: Fit,
    gain: tuple[float, float],
    segments: Sequence[Segment],
    settled: Callable[[Fit], tuple[Fit, Sequence[Segment]]] | None = None,
) -> Verdict:
    """Hold a search's outcome against laws beyond the vocabulary.

    Args:
        laws: beyond the vocabulary.
        model: that was searched.
        baseline: its fit.
        best: the fit that the search chose; may be the baseline.
        gain: fall of chi-square from one to the other on the fitted recordings, over the
            dispersion that is left and as it is.
        segments: of all recordings.
        settled: gives a fit as it looks with an input as well known as may be.
    """
    # what the search has held against all others, a law says nothing new of; nor what it has found
    known = {term.name for term in (*model.terms, *best.terms)}
    known -= {term.name for term in baseline.terms}

    def sought(made: Fit) -> tuple[UnmodelledLaw, bool]:
        there = settled(made) if settled is not None else (made, segments)
        listed = unmodelled_laws(laws, model, *there)
        # beside what was found even the same law says more; in its place it says the same
        beside = made is best is not baseline
        other = (law for law in listed if beside or law.case_of not in known)
        strongest = next(other, listed[0])
        return strongest, _resolved(strongest, listed)

    alone, resolved = sought(baseline)
    if best is baseline:
        # beside findings all laws count that may be: there their own errors look like laws, too
        alone = alone.among_tried
        left = alone.p_value < FALSE
        return Verdict(left, left, alone, 1.0 - alone.p_value if left else 0.0)
    beside, _ = sought(best)
    added = fitted_numbers(best, segments) - fitted_numbers(baseline, segments)
    # dispersions are known to some tens of per cent: a law must be ahead with them and without
    plain = alone.gain if alone.plain is None else alone.plain
    ahead = alone.worth - equivalent_gain(gain[0], added)
    ahead = min(ahead, equivalent_gain(plain, alone.numbers) - equivalent_gain(gain[1], added))
    # a law is paid for by its looks; of several effects each was chosen among many, too
    several = len(best.terms) - len(baseline.terms) - 1 if resolved else 0
    ahead += 2.0 * math.log(EFFECTS) * max(several, 0)
    # a finding that has to be as no such thing is, within what the data would have it be, is not
    # the likelier one for being listed
    margin = 0.0 if _strained(best, baseline) else MARGIN
    ahead -= margin
    # a law as slight as that, as it is or over the dispersion, is an error of what was found
    rest = beside.gain if beside.plain is None else beside.plain
    much = beside.gain > slight(best) * gain[0] and rest > slight(best) * gain[1]
    needed = much and beside.p_value < BESIDE
    together = needed and gain[0] + beside.gain > (1.0 + FAR_MORE) * alone.gain
    # one law as good as several effects is the likelier one
    far = ahead > margin or several > 0 or beside.worth > MARGIN
    # what held-out recordings alone have shown is not outweighed by a law that nothing shows
    shown = alone.p_value < FALSE
    clearly = ahead > 0.0 and far and not together and shown
    same = _kind_and_frequency(alone)[0] == _kind_and_frequency(beside)[0]
    instead = clearly or (needed and same and ahead > -MARGIN)
    left = instead or needed
    chance = 1.0 / (1.0 + math.exp(-min(max(0.5 * ahead, -300.0), 300.0)))
    if left and not instead:
        chance = max(chance, 1.0 - beside.p_value)
    elif not left:
        # what is not believed is not the likelier one
        chance = min(chance, 0.5) if shown else 0.0
    return Verdict(left, instead, alone if instead else beside, chance)
