"""An effect and a law beyond the library that explain to the noise what neither does alone."""

from __future__ import annotations

import math
from collections.abc import Sequence

from impactscope.discrepancy.driven.adequacy.unmodelled_laws import (
    BESIDE,
    UnmodelledLaw,
    Verdict,
    unmodelled_laws,
)
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.chi_square import (
    PRICE,
    fitted_chi_square,
    fitted_samples,
    priced,
)
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.search.beam_search import Outcome
from impactscope.discrepancy.driven.systems.case import Case

__all__ = ['NOISE', 'effect_and_law', 'leaves_noise', 'plain_gain']

NOISE = 4.0  # reduced chi-square of an answer up to which nothing else is tried
LEVEL = 2.5  # standard deviations of chi-square, to which a spectrum's few parts tell its level
CHANCE = 3.0 * math.hypot(1.0, LEVEL)  # the same, up to which what is left is noise
TOGETHER = 20.0  # chi-square by which an effect and a law are better than a law alone
WITH_A_LAW = 3  # effects, of those with the best criterion, beside which a law is looked for


def effect_and_law(case: Case, outcome: Outcome, said: Verdict) -> tuple[Outcome, Verdict]:
    """The outcome and the verdict, where an effect and a law together are the better explanation.

    What a law leaves beside the effect alone makes the effect look like the error of another.
    """
    judge, baseline = case.judge, outcome.baseline
    alone = outcome.best is baseline or said.instead
    if not (said.left and alone):
        return outcome, said

    def whole(made: Fit, law: UnmodelledLaw) -> float:
        left = fitted_chi_square(case.judge, made) - plain_gain(law)
        return left + priced(made, baseline) + PRICE * law.numbers

    least = whole(baseline, said.strongest) - TOGETHER
    several = sorted(
        (f for f in (outcome.best, *outcome.rivals) if len(f.terms) == 1 + len(baseline.terms)),
        key=lambda f: judge.criterion(f, baseline),
    )
    for made in several[:WITH_A_LAW]:
        if judge.gain(baseline, made).held_out_worse:
            continue
        law = unmodelled_laws(case.laws, case.model, *_settled(case, made))[0]
        believed = law.p_value < BESIDE and leaves_noise(case, made, law)
        if believed and whole(made, law) < least:
            least = whole(made, law)
            others = tuple(f for f in (outcome.best, *outcome.rivals) if f is not made)
            outcome = Outcome(baseline, made, others, True)
            said = Verdict(True, False, law, 1.0 - law.p_value)
    return outcome, said


def _settled(case: Case, made: Fit) -> tuple[Fit, Sequence[Segment]]:
    return (made, case.segments) if case.settled is None else case.settled(made)


def plain_gain(law: UnmodelledLaw) -> float:
    """Chi-square that a law takes away, without regard to what is left about it."""
    return law.gain if law.plain is None else law.plain


def leaves_noise(case: Case, made: Fit, law: UnmodelledLaw) -> bool:
    """Whether a law beside a fit leaves what noise does, to within its chance.

    Of a fit that is far from the noise a law, which is a small change, says nothing so exact.
    """
    size = fitted_samples(case.judge)
    left = fitted_chi_square(case.judge, made)
    return left < NOISE * size and left - plain_gain(law) < size + CHANCE * math.sqrt(2.0 * size)
