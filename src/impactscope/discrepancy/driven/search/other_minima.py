"""Other minima of what was found in a driven campaign: more than one shape may do as well.

What rings far above the motion shows its stiffness alone, a force that creeps the rate at which it
begins: along such a valley a covariance at one place tells too much. So a fit sets out from either
side of each number that shapes an effect; a better end replaces the fit, one about as good widens
the uncertainty of what differs. Which of minima that are as deep it is, recordings that were held
out may tell: a base that rings a little slower or faster bends a few fitted recordings alike.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.model_selection.chi_square import NoiseJudge, fitted_chi_square
from impactscope.discrepancy.driven.models.model import Model
from impactscope.discrepancy.driven.models.terms import Number, Term, key
from impactscope.discrepancy.evidence import spread_over_minima
from impactscope.discrepancy.processes import in_processes
from impactscope.discrepancy.time_limit import time_left

__all__ = ['foretelling', 'knowing_other_minima', 'starts_to_either_side']

APART = {'frequency': (1.7, 2.9)}  # factors on a number, the others moved along
ELSE = (1.6,)  # the same of any other number
FARTHEST = math.log(30.0)  # of the logarithm of a number that is moved along
ROUGHLY, LAST = 8, 25  # evaluations of a fit from each start, and of one that is near
BEHIND = 100.0  # chi-square from which no end makes up for it
BETTER = 0.1  # of chi-square
OPEN = 8.0  # chi-square up to which a minimum is not excluded
# chi-square by which the best of many narrow minima is ahead by chance, and times its uncertainty
# that another must be away for it to be one of many
LUCK, NARROW = 7.0, 10.0
AS_DEEP = 9.0  # chi-square by which minima differ no more than noise makes them: three deviations
MISSED = 30.0  # chi-square of recordings held out, that one of them leaves and another does not


def knowing_other_minima(model: Model, judge: NoiseJudge, made: Fit, terms: Sequence[Term]) -> Fit:
    """The best fit from either side of each number that shapes one of the terms.

    Its uncertainties reach to the other minima that are about as good.
    """
    begins = starts_to_either_side(made, terms)
    if not begins or not time_left('other values of what was found'):
        return made

    def followed(begin: Mapping[str, float], evaluations: int) -> Fit:
        return fit(model, made.terms, judge.segments, begin, made.starts, evaluations, FINE)

    def chi_square(one: Fit) -> float:
        return fitted_chi_square(judge, one)

    rough = in_processes(lambda begin: followed(begin, ROUGHLY), begins)
    most = chi_square(made) + BEHIND
    ends = in_processes(
        lambda f: followed(f.values, LAST), [f for f in rough if chi_square(f) < most]
    )
    kept = foretelling(judge, [made, *ends])
    best = min(kept, key=chi_square)
    if made in kept and chi_square(best) > chi_square(made) - BETTER:
        best = made
    level = chi_square(best)
    others = [f for f in kept if f is not best and chi_square(f) < level + OPEN + LUCK]
    near = [best, *others]
    std = dict(best.std)
    for name in (key(t, n) for t in terms for n in t.numbers):
        away = [abs(f.values[name] - best.values[name]) for f in near]
        if not std.get(name, 0.0) > 0.0 or max(away) <= std[name]:
            continue
        lucky = [LUCK if d > NARROW * std[name] else 0.0 for d in away]
        behind = [max(chi_square(f) - level - x, 0.0) for f, x in zip(near, lucky, strict=True)]
        std[name] = spread_over_minima(
            [std[name]] * len(near), away, [math.exp(-0.5 * b) for b in behind]
        )
    return dataclasses.replace(best, std=std)


def foretelling(judge: NoiseJudge, ends: Sequence[Fit]) -> list[Fit]:
    """The ends of a fit without those that recordings held out contradict, in their order.

    That is where they are missed and an end about as deep as the deepest foretells them.
    """
    left = [_finite_or(fitted_chi_square(judge, f), math.inf) for f in ends]
    told = [_finite_or(judge.gain(ends[0], f).held_out, -math.inf) for f in ends]
    deepest = min(left)
    most = max(h for h, x in zip(told, left, strict=True) if x <= deepest + AS_DEEP)
    return [f for f, h in zip(ends, told, strict=True) if h >= most - MISSED]


def _finite_or(value: float, worst: float) -> float:
    """A number, or the worst where a simulation ran off."""
    return value if math.isfinite(value) else worst


def starts_to_either_side(made: Fit, terms: Sequence[Term]) -> list[dict[str, float]]:
    """Values from which a fit may set out to either side of each number that shapes a term."""
    return [
        values
        for term in terms
        for number in _shapes(term, made)
        for values in _starts(made, term, number)
    ]


def _shapes(term: Term, made: Fit) -> list[Number]:
    """Numbers of an effect, beside its amounts, that are sizes."""
    if term.output or len(term.numbers) < 2:
        return []
    return [
        n
        for n in term.numbers
        if n.name not in term.amounts
        and made.values[key(term, n)] > 0.0
        and 0.0 < made.std.get(key(term, n), 0.0) < math.inf
    ]


def _starts(made: Fit, term: Term, number: Number) -> Iterator[dict[str, float]]:
    """Values to either side of a number, the term's others moved along as its slopes want them."""
    names, own = list(made.values), {key(term, n): n for n in term.numbers}
    mine = key(term, number)
    value = made.values[mine]
    for factor, sign in itertools.product(APART.get(number.name, ELSE), (1.0, -1.0)):
        change = sign * math.log(factor)
        begin = {**made.values}
        for name, other in own.items():
            along = 1.0
            if name != mine:
                if made.covariance is None or not made.values[name] > 0.0:
                    continue
                i, j = names.index(name), names.index(mine)
                slope = made.covariance[i, j] / made.covariance[j, j]
                along = slope * value / made.values[name]  # of the logarithms
            farther = min(max(along * change, -FARTHEST), FARTHEST)
            moved = made.values[name] * math.exp(farther)
            begin[name] = min(max(moved, other.lower), other.upper)
        yield begin
