"""When evidence is enough: rules that every search for missing physics shares.

A candidate with k further parameters lowers chi-square by ``gain``. By Wilks' theorem the gain of
a superfluous candidate is distributed as chi-square with k degrees of freedom; among many
candidates the best gain is larger, which the number of independent looks accounts for. The
ranking uses the Bayesian information criterion with the prior over models that makes up for the
number of candidates (Chen and Chen, Biometrika 95, 2008). Regions are controlled for false
discoveries after Benjamini and Hochberg (J. R. Stat. Soc. B 57, 1995).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

__all__ = [
    'BESIDE_UNKNOWN',
    'Thresholds',
    'at_a_bound',
    'borne_by_many',
    'family_p_value',
    'first_discoveries',
    'flat_top',
    'information',
    'is_white',
    'least_gain',
    'noise_std',
    'price',
    'probabilities',
    'quantisation_step',
    'shape_price',
    'spread_over_minima',
    'spread_p_value',
    'white_p_value',
]

Array = NDArray[np.float64]

_INTERVAL, _HELD = 1.96, 0.95  # standard deviations to either side, and what lies between
_HALVINGS = 30
_FLAT, _NEAR = 3, 3.0  # readings at the top that tell a limit, and times the noise to it
_LEAST_LEFT = 1e-12  # of a variance that was credible
_AT_A_BOUND = 1e-3  # of a bound: what is nearer to it stands at it
BESIDE_UNKNOWN = 0.7  # of a finding's probability, at most, where something is not known


@dataclass(frozen=True, slots=True)
class Thresholds:
    """The few numbers on which decisions rest; the same for every campaign."""

    false_finding: float = 0.003  # chance of a finding in a campaign where nothing is missing
    false_region: float = 0.01  # share of false regions among those that are named
    unexplained_ratio: float = 1.2  # reduced chi-square above which something is unknown
    inadequate: float = 0.002  # chance of what is left under noise, below which it is not noise
    confusable: float = 0.02  # relative probability from which an explanation is not excluded
    held_out_loss: float = 9.0  # chi-square by which held-out recordings may get worse by chance


def at_a_bound(value: float, lower: float, upper: float) -> bool:
    """Whether a number stands at the end of what is credible for it; an end at zero is none."""
    ends = (end for end in (lower, upper) if end != 0.0 and math.isfinite(end))
    return any(abs(value - end) < _AT_A_BOUND * abs(end) for end in ends)


def family_p_value(gain: float, parameters: int, looks: int) -> float:
    """Chance that the best of ``looks`` superfluous candidates gains this much.

    A candidate without parameters that can be fitted counts as one with one.
    """
    single = float(stats.chi2.sf(max(gain, 0.0), max(parameters, 1)))
    return float(-math.expm1(max(looks, 1) * math.log1p(-min(single, 1 - 1e-12))))


def borne_by_many(fall: Array, lone: int, most: float | Array) -> float:
    """A fall of chi-square, sample by sample, in which no few samples decide.

    A sample on the verge of a contact, or in which a friction turns round, is right or wrong by
    hundredths of its duration: it may tell many standard deviations and mean nothing.

    Args:
        fall: of each sample's square, shape (n,).
        lone: number of samples that must not decide; all count in full where there are no more.
        most: by which each of the ``lone`` that are furthest above it may count; of all samples,
            or of each, shape (n,).
    """
    whole = float(np.sum(fall))
    if fall.size <= lone:
        return whole
    beyond = np.partition(fall - most, -lone)[-lone:]
    return whole - float(np.sum(np.maximum(beyond, 0.0)))


def least_gain(parameters: int, looks: int, false_finding: float) -> float:
    """Fall of chi-square from which a candidate counts, given the chance of a false finding."""
    single = -math.expm1(math.log1p(-false_finding) / max(looks, 1))
    return float(stats.chi2.isf(single, max(parameters, 1)))


def information(chi_square: float, parameters: int, samples: int, looks: int = 1) -> float:
    """Extended Bayesian information criterion: smaller is better."""
    return chi_square + parameters * math.log(max(samples, 2)) + 2.0 * math.log(max(looks, 1))


def price(gain: float, shared: int, own: int, samples: int) -> float:
    """What numbers cost of the fall of chi-square that they bring; after Bayes.

    Numbers of one kind, one set for each recording, are drawn from one distribution about zero:
    its variance is the only thing to be learnt from all samples, and what each of them costs goes
    by how far they stand out (George and Foster, Biometrika 87, 2000).

    Args:
        gain: fall of chi-square by all of them.
        shared: numbers that all recordings share.
        own: numbers that belong to one recording each, all of one kind.
        samples: that are fitted.
    """
    each = math.log(max(samples, 2))
    if not own:
        return shared * each
    alike = own * (1.0 + math.log(gain / own)) if gain > own else max(gain, 0.0)
    return shared * each + min(own * each, alike + each)


def shape_price(covariance: Array, spread: Array) -> float:
    """What numbers cost that only shape a law: when a push begins, how long it rises; after Bayes.

    Twice the logarithm of how much of what was credible of them is left once they are fitted
    (Laplace's approximation, normal before and after). What the recordings leave open costs
    nothing: a law is no less likely for a number of which they tell nothing, and the price of
    a number that all samples tell would turn it down for a stiffer one that fits worse.

    Args:
        covariance: of the fitted numbers, all else re-tuned, shape (k, k).
        spread: standard deviation of each before anything was measured, shape (k,).
    """
    left = np.linalg.eigvalsh(covariance / np.outer(spread, spread))
    return float(np.sum(np.log1p(1.0 / np.maximum(left, _LEAST_LEFT))))


def probabilities(criteria: Sequence[float]) -> list[float]:
    """Probability of each of several models that exclude each other, from their criteria."""
    values = np.asarray(criteria, dtype=np.float64)
    if values.size == 0:
        return []
    weight = np.exp(-0.5 * np.clip(values - np.min(values), 0.0, 1400.0))
    return [float(w) for w in weight / np.sum(weight)]


def first_discoveries(p_values: Sequence[float], rate: float) -> NDArray[np.bool_]:
    """Which hypotheses are discoveries at a false discovery rate (Benjamini, Hochberg)."""
    p = np.asarray(p_values, dtype=np.float64)
    if p.size == 0:
        return np.zeros(0, dtype=np.bool_)
    order = np.argsort(p)
    passed = p[order] <= rate * np.arange(1, p.size + 1) / p.size
    last = int(np.max(np.nonzero(passed)[0], initial=-1))
    found = np.zeros(p.size, dtype=np.bool_)
    found[order[: last + 1]] = True
    return found


def spread_over_minima(
    stds: Sequence[float], away: Sequence[float], likely: Sequence[float]
) -> float:
    """Standard deviation whose 95 % interval holds 95 % of what several minima leave likely.

    Args:
        stds: standard deviation of the number in each of them, that which is told first.
        away: of each, its distance from the value that is told.
        likely: of each, its probability, in one unit.

    Returns:
        No less than the first of ``stds``.
    """
    shares = [share / sum(likely) for share in likely]
    low, high = stds[0], max(stds) + max(away)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        reach = _INTERVAL * middle
        held = sum(
            share * float(stats.norm.cdf(reach, d, std) - stats.norm.cdf(-reach, d, std))
            for std, d, share in zip(stds, away, shares, strict=True)
            if share > 0.0
        )
        low, high = (low, middle) if held > _HELD else (middle, high)
    return high


def spread_p_value(residuals: Array) -> float:
    """Chance that standardised residuals, shape (n,), are spread this much by noise alone."""
    if residuals.size == 0:
        return 1.0
    return float(stats.chi2.sf(float(residuals @ residuals), residuals.size))


def is_white(residuals: Array, p_value: float = 1e-4) -> bool:
    """Whether standardised residuals in time order look white, see :func:`white_p_value`."""
    return white_p_value(residuals) > p_value


def white_p_value(residuals: Array) -> float:
    """Chance that white noise is as alike from sample to sample: first ten lags (Ljung, Box)."""
    n = residuals.size
    lags = min(10, n // 5)
    if lags < 1:
        return 1.0
    centred = residuals - np.mean(residuals)
    power = float(centred @ centred)
    if power == 0.0:
        return 1.0
    rho = np.array([float(centred[k:] @ centred[:-k]) / power for k in range(1, lags + 1)])
    statistic = n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return float(stats.chi2.sf(statistic, lags))


def noise_std(samples: Array) -> float:
    """Standard deviation of white noise in a quiet stretch, shape (n,); slow changes drop out.

    From the second differences, by their interquartile range, so that a blow or a spike inside
    does not count; where the steps of the converter are coarser than that, from the variance.
    """
    finite = samples[np.isfinite(samples)]
    if finite.size < 8:
        return math.nan
    difference = finite[2:] - 2.0 * finite[1:-1] + finite[:-2]
    step = quantisation_step(finite)
    low, high = _quartiles(difference, step)
    scale = float(high - low) / (1.3489795 * math.sqrt(6.0))
    rough = float(np.std(difference)) / math.sqrt(6.0)
    if step > 0.8 * scale:
        return max(rough, step / math.sqrt(12.0))
    return scale


def _quartiles(values: Array, step: float) -> tuple[float, float]:
    """Quartiles; of values on a lattice those of what it has rounded, evenly within each step.

    Their own would be multiples of the step, and a range of five steps be told as four or six.
    """
    if not step > 0.0:
        low, high = np.quantile(values, [0.25, 0.75])
        return float(low), float(high)
    level, count = np.unique(np.round(values / step), return_counts=True)
    below = np.cumsum(count) / values.size
    edges = np.concatenate([[level[0] - 0.5], level + 0.5])
    low, high = np.interp([0.25, 0.75], np.concatenate([[0.0], below]), step * edges)
    return float(low), float(high)


def flat_top(
    readings: Sequence[Array], step: float, limit: float, noise: float
) -> tuple[float, float] | None:
    """Limit of a channel that reads in steps, and its standard uncertainty.

    Equal readings do not show such a limit, for most are equal to others. Noise before it is cut
    off with the signal, so that a fit of the readings by their mean comes out too low; the largest
    ones are the limit to half a step. None where fewer than three readings reach it, or it is not
    near what was fitted.

    Args:
        readings: of each recording, shape (n,).
        step: of the converter, 0 where there is none.
        limit: as fitted.
        noise: standard deviation of a reading.
    """
    top = max(float(np.max(np.abs(r))) for r in readings)
    flat = sum(int(np.count_nonzero(np.abs(r) > top - 0.5 * step)) for r in readings)
    if not step > 0.0 or flat < _FLAT or abs(top - limit) > _NEAR * noise + step:
        return None
    return top, step / math.sqrt(12.0)


def quantisation_step(samples: Array) -> float:
    """Step of the lattice on which samples lie, 0 where there is none that matters."""
    levels = np.unique(samples[np.isfinite(samples)])
    if levels.size < 3 or levels.size > 0.5 * samples.size:
        return 0.0
    gaps = np.diff(levels)
    step = float(np.min(gaps))
    scale = float(np.max(np.abs(levels)))
    if step <= 4e-7 * scale:  # as fine as single precision
        return 0.0
    multiples = gaps / step
    return step if float(np.max(np.abs(multiples - np.round(multiples)))) < 0.02 else 0.0
