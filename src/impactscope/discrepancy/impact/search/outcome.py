"""The outcome of a search: findings, their evidence, the fits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.evidence import borne_by_many, family_p_value, information
from impactscope.discrepancy.impact.adequacy.residual_tests import LONE, TOLD, Adequacy
from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.fits.least_squares import Fit, fits_from
from impactscope.discrepancy.impact.models.bench_model import Free, ImpactModel, Layout
from impactscope.physics.twin.simulate import SimulationError

__all__ = [
    'QUIET',
    'Found',
    'Outcome',
    'chance_of',
    'evidence_for',
    'settled_without',
    'weigh',
    'with_findings',
]

_OF_A_HUM = 2  # numbers that all recordings share: amplitude and frequency
_MAINS_BAND = 0.5  # Hz about the mains and their harmonics
_UNBORNE = 4.0  # times the gain that a finding's size explains, from which a fit is doubted
_LEAST = 9.0  # of chi-square, that are worth another fit
_AT_LIMIT = 5.0  # times the noise, by which a reading at a limit may lie beside it
QUIET = 1.15  # reduced chi-square below which a short window holds nothing to look for


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A candidate that was fitted jointly with all else."""

    candidate: Candidate
    fit: Fit
    gain: float  # fall of chi-square, over the reduced chi-square that is left
    p_value: float
    criterion: float  # information criterion, less that of the model without the candidate
    refused: bool = False  # numbers of each recording, or any frequency, that do not pay
    held_out: float = 0.0  # of the criterion, what held-out recordings add to it

    def counts(self, false_finding: float) -> bool:
        """Whether chance would gain as much in no more than that share of campaigns."""
        return self.p_value <= false_finding and not self.refused


@dataclass(eq=False)
class Outcome:
    """What the search came to."""

    baseline: Fit
    final: Fit
    accepted: list[Candidate]
    found: dict[str, Found] = field(default_factory=dict)  # label: the evidence for it
    rivals: dict[str, list[Found]] = field(default_factory=dict)  # label: what else was fitted
    last: list[Found] = field(default_factory=list)  # what was looked at and not accepted
    p_value: float = 1.0
    doubted: set[str] = field(default_factory=set)  # accepted because nothing else was noise
    modes: list[Fit] = field(default_factory=list)  # about as good as the final fit
    factors: dict[str, float] = field(default_factory=dict)  # on standard deviations, by key
    looks: int = 1
    window: float = math.inf
    tests: Adequacy | None = None  # of what the final model leaves
    held_out_baseline: Fit | None = None
    held_out_final: Fit | None = None
    notes: list[str] = field(default_factory=list)

    def model_with(self, chosen: Iterable[Candidate]) -> ImpactModel:
        """The model of the baseline with some candidates in it."""
        model = self.baseline.model
        for candidate in chosen:
            model = candidate.extend(model)
        return model

    def put_in_place(
        self, gone: Sequence[Candidate], best: Found, rivals: Sequence[Found]
    ) -> None:
        """Another finding in the place of one or more, with what else was fitted there."""
        labels = {c.label for c in gone}
        place = min(i for i, c in enumerate(self.accepted) if c.label in labels)
        for label in labels:
            self.found.pop(label, None)
            self.rivals.pop(label, None)
        kept = [c for c in self.accepted if c.label not in labels]
        self.accepted = [*kept[:place], best.candidate, *kept[place:]]
        label = best.candidate.label
        self.found[label] = best
        self.rivals[label] = [f for f in rivals if f.candidate.label != label]


def evidence_for(joint: Fit, without: Fit) -> float:
    """Fall of chi-square, over the reduced chi-square that is left; no few samples decide.

    The ``LONE`` samples that gain most count by no more than ``TOLD`` each, see
    :func:`~impactscope.discrepancy.evidence.borne_by_many`; by more where a limit cuts them.
    """
    gain = without.chi_square - joint.chi_square
    size = joint.layout.size
    if size == without.layout.size:
        fall = without.residuals[:size] ** 2 - joint.residuals[:size] ** 2
        gain += borne_by_many(fall, LONE, _told_by_each(joint, without)) - float(np.sum(fall))
    return gain / max(1.0, joint.reduced)


def _told_by_each(joint: Fit, without: Fit) -> NDArray[np.float64]:
    """By how much each sample may count if few stand out, shape (size,).

    A limit cuts the highest readings, which may be few. That one which is off by chance is among
    these is as unlikely as it is to pick one of all samples, and so much it may tell.
    """
    model, layout = joint.model, joint.layout
    most = np.full(layout.size, TOLD)
    known = {e.tag for e in without.model.effects}
    for effect in model.effects:
        if effect.name != 'saturation' or effect.tag in known:
            continue
        limit = joint.values[f'{effect.tag}.limit']
        for (i, name), span in layout.spans.items():
            if name == effect.channel:
                channel, mask = model.data.blows[i].channels[name], layout.masks[i, name]
                beside = np.abs(np.abs(channel.means[mask]) - limit)
                at_limit = beside < _AT_LIMIT * channel.own_std[mask]
                most[span][at_limit] = max(TOLD, 2.0 * math.log(layout.size))
    return most


def weigh(candidate: Candidate, joint: Fit, current: Fit, looks: int) -> Found:
    """A joint fit against the model without the candidate."""
    gain = evidence_for(joint, current)
    places = _places(candidate, joint)
    samples = joint.layout.size
    criterion = information(candidate.price(gain, joint) - gain, 0, samples, places)
    chance = chance_of(candidate, joint, gain, looks)
    criterion += candidate.doubt_at(joint.values)
    # a line of any frequency, each recording with its own phase, must pay for all
    dear = places > 1 and information(-gain, candidate.cost, samples, places) > 0.0
    # of many numbers chance is sooner excluded than none of them is likelier than nothing
    dear |= bool(candidate.fitted) and criterion > 0.0
    return Found(candidate, joint, gain, chance, criterion, dear)


def chance_of(candidate: Candidate, joint: Fit, gain: float, looks: int) -> float:
    """Chance that the best of ``looks`` candidates gains this much where nothing is missing.

    What rings for long has a narrow line, which could have been found at as many frequencies as
    there are such lines: then these count, and not its frequency and damping as two numbers.
    """
    looks *= _places(candidate, joint)
    chance = family_p_value(gain, candidate.cost, looks)
    hum = candidate.hum_amplitude(joint)
    if hum is not None:  # asked in two ways
        chance = min(chance, family_p_value(gain - hum.taken, _OF_A_HUM, 2 * looks))
    lines = _lines(candidate, joint)
    if lines > 1 and candidate.cost > 2:
        chance = max(chance, family_p_value(gain, candidate.cost - 2, looks * lines))
    return chance


def _lines(candidate: Candidate, joint: Fit) -> int:
    """At how many frequencies a part that rings as long as this one could have been found."""
    tag = candidate.effects[0].tag if candidate.effects else ''
    number = next((f for f in candidate.free if f.key == f'{tag}.frequency'), None)
    ratio = None if number is None else joint.values.get(f'{tag}.damping_ratio')
    if number is None or ratio is None:
        return 1
    return _lines_within(number, 2.0 * ratio * joint.values[number.key], joint)


def _lines_within(frequency: Free, width: float, joint: Fit) -> int:
    """How many lines lie apart in the range of a frequency, each of a width (Hz) or wider."""
    longest = max(float(b.times[-1] - b.times[0]) for b in joint.model.data.blows)
    return max(1, round((frequency.upper - frequency.lower) / max(width, 1.0 / longest)))


def _places(candidate: Candidate, joint: Fit) -> int:
    """At how many frequencies a line was sought: the mains have few, the spectrum has many."""
    if candidate.name != 'mains_hum':
        return 1
    key = candidate.free[0].key
    frequency = joint.values[key]
    if any(abs(frequency - n * mains) < _MAINS_BAND for mains in (50.0, 60.0) for n in (1, 2, 3)):
        return 1
    return _lines_within(candidate.free[0], 0.0, joint)


def with_findings(outcome: Outcome, chosen: Sequence[Candidate], layout: Layout) -> Fit:
    """The baseline with some of the findings, fitted over a window.

    Raises SimulationError where that cannot be simulated from any start.
    """
    known = outcome.final.model.constants
    model = outcome.baseline.model
    # the taps may be known better by now; what a finding has set is not the baseline's
    theirs = {k for c in outcome.accepted for k in c.constants}
    constants = {k: v if k in theirs else known.get(k, v) for k, v in model.constants.items()}
    model = dataclasses.replace(model, constants=constants)
    for candidate in chosen:
        model = candidate.extend(model)
    fits = []
    for values in (outcome.final.values, outcome.baseline.values):
        start = [model.vector(values)]
        fits += fits_from(model, layout, start, settled=0.1, iterations=25, near=[outcome.final])
        if fits and fits[-1].reduced < QUIET:
            break
    if not fits:
        raise SimulationError('without some of the findings the recordings cannot be simulated')
    best = min(fits, key=lambda f: f.chi_square)
    labels = {c.label for c in chosen}
    gone = [c for c in outcome.accepted if c.label not in labels]
    return settled_without(outcome.final, gone, best)


def settled_without(joint: Fit, gone: Sequence[Candidate], without: Fit) -> Fit:
    """A fit without some findings, from a better place where it has missed its minimum.

    A finding whose size is no more than its own uncertainty cannot explain many units of
    chi-square: the fit without it stands in another minimum. The fit with it tells where the
    numbers go as the finding vanishes, and from there the fit without it is taken again. What the
    finding has freed beside itself (how long a tap was) stays as it was fitted: it may be all that
    was wrong.

    Args:
        joint: a fit with them.
        gone: the findings that the other fit does not have.
        without: that fit, over the same samples.
    """
    gain = without.chi_square - joint.chi_square
    if joint.layout.size != without.layout.size or gain < _LEAST:
        return without
    keys = {f.key: j for j, f in enumerate(joint.model.free)}
    moves = np.zeros(joint.x.size)
    beside: dict[str, float] = {}  # what the findings have freed beside themselves, as fitted
    for candidate in gone:
        for key, absent in candidate.amplitudes.items():
            if key not in keys:
                return without
            free = joint.model.free[keys[key]]
            if math.isinf(absent) and free.logarithmic:
                # one over it is the effect's strength: to nothing, its logarithm rises by one
                moves[keys[key]] = 1.0
                continue
            if not math.isfinite(absent) or (free.logarithmic and absent <= 0.0):
                return without
            moves[keys[key]] = free.to_inner(absent) - joint.x[keys[key]]
        for free in candidate.free if candidate.amplitudes else ():
            if free.prior is None or free.key not in keys or free.key in candidate.amplitudes:
                continue
            if free.key in without.model.constants:
                beside[free.key] = joint.values[free.key]
            else:
                moves[keys[free.key]] = free.to_inner(free.prior[0]) - joint.x[keys[free.key]]
    if not any(c.amplitudes for c in gone):  # nothing says where they vanish
        return without
    kept = [keys[f.key] for f in without.model.free if f.key in keys]
    if len(kept) != without.x.size:
        return without
    model = without.model
    model = dataclasses.replace(model, constants={**model.constants, **beside})
    slopes = joint.jacobian
    left = joint.residuals + slopes @ moves
    scale = np.maximum(np.linalg.norm(slopes[:, kept], axis=0), 1e-300)
    answer = np.linalg.lstsq(slopes[:, kept] / scale, -left, rcond=1e-10)[0]
    foreseen = left + slopes[:, kept] @ (answer / scale)
    expected = float(foreseen @ foreseen) - joint.chi_square
    if gain < _UNBORNE * max(expected, 1.0):
        return without
    again = fits_from(
        model, without.layout, [joint.x[kept] + answer / scale], settled=0.1, iterations=25
    )
    return min((without, *again), key=lambda f: f.chi_square)
