"""What the uncertainty of fitted numbers excuses of a prediction's misfit.

A recording that was not fitted is predicted with numbers that the fitted ones tell only so well.
Its residual has then not the noise's covariance alone but that and ``J P J'``, with ``P`` the
covariance of the numbers and ``J`` the slopes of the prediction: its deviance is
``r' (I + J P J')^-1 r + log det (I + J P J')`` (Bishop, Pattern Recognition and Machine Learning,
sec. 3.3.2), which is one Gauss-Newton step of a fit to all recordings. Judged by ``r' r`` a right
law with an uncertain number would lose against a wrong one whose number is well known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.fits.orthonormal import orthonormal

__all__ = ['excused']

Array = NDArray[np.float64]

BEFOREHAND = 1.0  # standard deviation of a number, over its scale, without any recording


def excused(fitted: Array, shared: int, held_out: Sequence[tuple[Array, Array, Array]]) -> float:
    """Fall of the held-out recordings' deviance, against that with numbers known for certain.

    Negative where a certain prediction would have been likelier. Where a recording is missed by
    more than noise, whatever is missing passes for noise: it shall not tune the numbers.

    Args:
        fitted: slopes of the fitted residuals by all fitted numbers over their scales, those that
            all recordings share first, in units of the noise, shape (n, k).
        shared: number of the former.
        held_out: of each held-out recording the residual, shape (m,), its slopes by the shared
            numbers, shape (m, ``shared``), and by those of its own, shape (m, o), which are
            adjusted to it.
    """
    information = _without(fitted[:, :shared], fitted[:, shared:])
    information = information.T @ information + np.eye(shared) / BEFOREHAND**2
    seen, along = np.zeros((shared, shared)), np.zeros(shared)
    for residual, slopes, own in held_out:
        left, way = _without(np.column_stack([residual, slopes]), own), slice(1, None)
        left /= max(1.0, float(np.sqrt(np.mean(left[:, 0] ** 2))))
        seen += left[:, way].T @ left[:, way]
        along += left[:, way].T @ left[:, 0]
    # numbers over what they are known to: the same result, and no loss of digits
    size = np.sqrt(np.diag(information) + np.diag(seen))
    known = information / np.outer(size, size)
    together = known + seen / np.outer(size, size)
    fall = float(along / size @ np.linalg.solve(together, along / size))
    return fall - float(np.linalg.slogdet(together)[1] - np.linalg.slogdet(known)[1])


def _without(columns: Array, adjusted: Array) -> Array:
    """Columns without what numbers can take that are adjusted to them, shape (n, k)."""
    basis = orthonormal(adjusted)
    return np.asarray(columns - basis @ (basis.T @ columns))
