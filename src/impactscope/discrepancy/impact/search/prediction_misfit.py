"""How far blows that were held out are missed by what others have been fitted to.

What the fit does not know of its numbers for certain is no fault of its prediction, however later
contacts amplify it: residuals are those of the marginal distribution.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.evidence import borne_by_many
from impactscope.discrepancy.impact.adequacy.residual_tests import LONE, without_lone
from impactscope.discrepancy.impact.fits.least_squares import Fit, jacobian, projector

__all__ = ['further_misfit', 'prediction_misfit']

Array = NDArray[np.float64]

_MOMENT = 0.005  # s


def further_misfit(before: tuple[Fit, Fit], after: tuple[Fit, Fit]) -> float:
    """Rise of chi-square from one prediction to another, over the bins that both have.

    Each is a fit and its prediction of recordings that were held out. Neither a rise nor a fall
    is that of a few moments: those in which a late contact just begins tell hundredths of its
    duration, in several samples and channels at once.
    """
    old, new = before[1], after[1]
    weights: tuple[list[Array], list[Array]] = ([], [])
    moments = []
    for (i, name), span in new.layout.spans.items():
        masks = [f.layout.masks[i, name] for f in (old, new)]
        both = masks[0] & masks[1]
        channels = [f.model.data.blows[i].channels[name] for f in (old, new)]
        spread = [channel.std[both] for channel in channels]
        spans = old.layout.spans[i, name], span
        for k, part in enumerate(weights):
            # each by the larger uncertainty: where one cannot tell, neither counts
            weight = np.zeros(spans[k].stop - spans[k].start)
            weight[both[masks[k]]] = spread[k] / np.maximum(*spread)
            part.append(weight)
        moments.append(np.floor(channels[1].centres[both] / _MOMENT) + 1j * i)
    squares = []
    for pair, part in zip((before, after), weights, strict=True):
        weight = np.concatenate(part)
        squares.append(_unforeseen(*pair, weight)[weight > 0.0] ** 2)
    _, moment = np.unique(np.concatenate(moments), return_inverse=True)
    rise = np.bincount(moment, squares[1] - squares[0]).astype(np.float64)
    return _of_many(rise) - _of_many(-rise) - float(np.sum(rise))


def _of_many(rise: Array) -> float:
    """A rise of which the few moments that rise most count no more than the next one."""
    if rise.size <= LONE:
        return float(np.sum(rise))
    return borne_by_many(rise, LONE, float(np.partition(rise, -LONE - 1)[-LONE - 1]))


def prediction_misfit(found: Fit, predicted: Fit) -> float:
    """Reduced chi-square of a prediction, allowing for what the fit knows not of its numbers.

    No few samples decide: the last one may be that in which a contact just begins.
    """
    size = predicted.layout.size
    residuals = without_lone(_unforeseen(found, predicted, np.ones(size)))
    return float(residuals @ residuals) / max(size - predicted.x.size, 1)


def _unforeseen(found: Fit, predicted: Fit, weight: Array) -> Array:
    """Weighted residuals of a prediction, standardised by what is unknown of the shared numbers.

    Returns:
        Shape (samples,); the sum of their squares is chi-square of the marginal distribution.
    """
    layout = predicted.layout
    model = dataclasses.replace(found.model, data=predicted.model.data)
    values = {**found.values, **predicted.values}
    x = np.array([f.to_inner(values[f.key]) for f in model.free])
    shared = [j for j, f in enumerate(model.free) if f.blow is None]
    residuals = model.residuals(x, layout)
    slopes = jacobian(model, x, layout, residuals, only=shared)[: layout.size, shared]
    own = projector(weight[:, None] * predicted.jacobian[: layout.size])
    left = weight * residuals[: layout.size]
    left = left - own @ (own.T @ left)
    reach = weight[:, None] * (slopes @ found.covariance_root(shared))
    reach = reach - own @ (own.T @ reach)
    along, spread, _ = np.linalg.svd(reach, full_matrices=False)
    return np.asarray(left - along @ ((1.0 - 1.0 / np.hypot(1.0, spread)) * (along.T @ left)))
