"""How near anybody can predict the held-out recordings of a campaign.

Who knows what is hidden, and fits the rest of the bench to the other recordings, still knows its
numbers no better than their noise allows, and each contact amplifies what is left open. By the
sensitivities at the truth (Cramer-Rao) that gives the spread of the predictions of the best fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .detectability import Freedom
from .scenario import Scenario

__all__ = ['prediction_limit']

Array = NDArray[np.float64]

_DRAWS = 400
_SHARE = 0.95


def prediction_limit(truth: Scenario) -> float:
    """RMSE over the noise, of the channel where it is largest, that 95 % of the best fits keep.

    At least 1. The numbers of what is hidden count as known: less than this nobody can promise,
    whoever has to find them may need more. What belongs to a held-out recording alone (its
    moment, the strength of its blow within what is stated of it) is adjusted to it, no more.
    """
    judged = [i for i, blow in enumerate(truth.blows) if blow.role == 'hold_out']
    seen = truth.all_fitted()
    if seen.kind == 'closed_loop':
        seen = seen.led_by(seen)
    freedom = Freedom(seen)
    shared = [i for i, knob in enumerate(freedom.knobs) if knob.blow == -1]
    if not judged or not shared:
        return 1.0
    spread = _spread(freedom, judged, shared)
    off = spread @ np.random.default_rng(0).standard_normal((len(shared), _DRAWS))
    if seen.colours:  # errors are counted in samples as they are, not whitened
        freedom = Freedom(replace(seen, colours={}))
    worst = np.ones(_DRAWS)
    for i in judged:
        moved = _beyond_its_own(freedom, i, shared, off)
        for part in freedom.of_channels(i).values():
            worst = np.maximum(worst, np.sqrt(1.0 + np.mean(moved[part] ** 2, axis=0)))
    return float(np.quantile(worst, _SHARE))


def _spread(freedom: Freedom, judged: Sequence[int], shared: Sequence[int]) -> Array:
    """Root of the covariance of the shared knobs once the other recordings are fitted."""
    normal = np.diag([k.std**-2 for k in freedom.knobs])
    for i, (block, own) in enumerate(freedom.sensitivities):
        if i not in judged:
            normal[np.ix_(own, own)] += block.T @ block
    known = [i for i, k in enumerate(freedom.knobs) if k.blow not in judged]
    normal = normal[np.ix_(known, known)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-30))
    inverse = np.linalg.pinv(normal * np.outer(scale, scale), rcond=1e-11, hermitian=True)
    place = [known.index(i) for i in shared]
    covariance = (inverse * np.outer(scale, scale))[np.ix_(place, place)]
    power, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(power, 0.0)))


def _beyond_its_own(freedom: Freedom, blow: int, shared: Sequence[int], off: Array) -> Array:
    """How shared knobs that are off move a recording when it is fitted by its own knobs."""
    block, own = freedom.sensitivities[blow]
    moved = block[:, [own.index(k) for k in shared]] @ off
    alone = [j for j, k in enumerate(own) if k not in shared]
    if not alone:
        return np.asarray(moved)
    free = block[:, alone]
    normal = free.T @ free + np.diag([freedom.knobs[own[j]].std ** -2 for j in alone])
    return np.asarray(moved - free @ np.linalg.lstsq(normal, free.T @ moved, rcond=1e-11)[0])
