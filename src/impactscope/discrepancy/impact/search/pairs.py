"""Pairs of effects that only show together: their signatures partly cancel.

Two effects can hide each other, so that neither lowers chi-square on its own by as much as chance
allows. Their joint gain in the linear approximation costs next to nothing once each signature is
known: b' G^-1 b, with G the Gram matrix of the signatures that no fitted number can re-tune and b
their match with the residual. The best pairs are then fitted jointly with everything else, and
have to gain what the best of all pairs would not gain by chance.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.evidence import family_p_value, least_gain
from impactscope.discrepancy.impact.candidates.candidate import Candidate, stronger
from impactscope.discrepancy.impact.fits.least_squares import Fit, fit
from impactscope.discrepancy.impact.search.outcome import evidence_for
from impactscope.discrepancy.impact.search.screening import Trial
from impactscope.discrepancy.processes import in_processes
from impactscope.errors import ImpactscopeError

__all__ = ['Pair', 'pairs']

Array = NDArray[np.float64]

_FITTED = 4  # pairs that are fitted jointly
_ALIKE = 0.9995  # cosine of signatures that are one
_HOPEFUL = 0.6  # of the gain that counts, from which a pair is fitted
_STRONGEST = 30.0  # times the strength at which a signature was taken


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """Two candidates fitted jointly with all else."""

    candidates: tuple[Candidate, Candidate]
    fit: Fit
    gain: float  # fall of chi-square, over the reduced chi-square that is left
    p_value: float
    criterion: float  # information criterion, less that of the model without both


def pairs(
    current: Fit, residual: Array, trials: Sequence[Trial], looks: int, false_finding: float
) -> list[Pair]:
    """The most promising pairs fitted jointly, the best first.

    Args:
        current: the model without them.
        residual: what its numbers cannot re-tune of its residuals, shape (n_residuals,).
        trials: candidates with their signatures; those without are passed over.
        looks: number of candidates.
        false_finding: chance that a pair may have to be found where nothing is missing.
    """
    known = [t for t in trials if t.signature is not None and np.any(t.signature)]
    looks_at_pairs = max(1, looks * (looks - 1) // 2)
    spread = max(1.0, current.reduced)
    chosen: dict[frozenset[str], tuple[tuple[Trial, Trial], tuple[float, float]]] = {}
    for i, j, factors in _promising(residual, known):
        both = known[i], known[j]
        cost = sum(t.candidate.cost for t in both)
        names = frozenset(f'{t.candidate.name}:{t.candidate.channel}' for t in both)
        wanted = least_gain(cost, looks_at_pairs, false_finding)
        if factors[2] < _HOPEFUL * wanted * spread or len(chosen) >= _FITTED:
            break
        if names not in chosen:
            chosen[names] = both, factors[:2]
    joints = in_processes(lambda pair: _fitted(current, *pair), list(chosen.values()))
    found: list[Pair] = []
    for (both, _), joint in zip(chosen.values(), joints, strict=True):
        if joint is None:
            continue
        cost = sum(t.candidate.cost for t in both)
        gain = evidence_for(joint, current)
        priced = sum(t.candidate.price(gain, joint) for t in both)
        found.append(
            Pair(
                (both[0].candidate, both[1].candidate),
                joint,
                gain,
                family_p_value(gain, cost, looks_at_pairs),
                priced - gain,
            )
        )
    found.sort(key=lambda p: p.criterion)
    return found


def _promising(
    residual: Array, trials: Sequence[Trial]
) -> list[tuple[int, int, tuple[float, float, float]]]:
    """Pairs in the order of their linear gain: places, both factors and the gain."""
    if len(trials) < 2:
        return []
    signatures = np.stack([t.signature for t in trials if t.signature is not None], axis=1)
    gram = signatures.T @ signatures
    match = -signatures.T @ residual
    size = np.diag(gram)
    alone = match**2 / size
    found = []
    for i, j in itertools.combinations(range(len(trials)), 2):
        one, other = trials[i].candidate, trials[j].candidate
        if one.name == other.name and one.channel == other.channel:
            continue
        cosine = gram[i, j] / np.sqrt(size[i] * size[j])
        if abs(cosine) > _ALIKE:
            continue
        determinant = size[i] * size[j] * (1.0 - cosine**2)
        first = (size[j] * match[i] - gram[i, j] * match[j]) / determinant
        second = (size[i] * match[j] - gram[i, j] * match[i]) / determinant
        if (first <= 0.0 and trials[i].one_sided) or (second <= 0.0 and trials[j].one_sided):
            continue
        gain = float(first * match[i] + second * match[j])
        if gain > max(alone[i], alone[j]):
            found.append((i, j, (float(first), float(second), gain)))
    found.sort(key=lambda item: -item[2][2])
    return found


def _fitted(current: Fit, both: Sequence[Trial], factors: Sequence[float]) -> Fit | None:
    """A pair fitted jointly, from the strengths that the linear approximation gives."""
    model, values = current.model, dict(current.values)
    for trial, factor in zip(both, factors, strict=True):
        strength = float(np.clip(factor, -_STRONGEST, _STRONGEST))
        model = trial.candidate.extend(model)
        values.update(stronger(trial.candidate, trial.weak, strength))
    x = model.vector(values)
    try:
        return fit(model, current.layout, x, settled=0.1, near=current)
    except ImpactscopeError:
        return None
