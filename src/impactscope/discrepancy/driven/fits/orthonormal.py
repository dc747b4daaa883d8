"""What several columns span."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ['orthonormal']

Array = NDArray[np.float64]

NOT_SEEN = 1e-9  # of the largest, a direction that adds nothing


def orthonormal(columns: Array) -> Array:
    """Orthonormal columns, (n, rank), that span those given, (n, k), whatever their lengths."""
    if columns.shape[1] == 0:
        return columns
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return np.asarray(u[:, s > NOT_SEEN * max(float(s[0]), 1e-300)])
