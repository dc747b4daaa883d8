"""Mass and damping of what no spring holds, fitted in the time domain.

In spectra the ends of a motion that does not come back are most of what is seen: a slow ramp of
the force, by which something rolls away, has next to nothing above its first lines.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.data.recordings import Cut, derivative_of

__all__ = ['answers_in_time']

Array = NDArray[np.float64]

CORNERS = 40
SLOWEST, FASTEST = 0.1, 0.125  # over the longest recording; of the sampling rate
THINNED = 10_000  # samples of a recording, about


def answers_in_time(cuts: Sequence[Cut]) -> list[tuple[float, float, float]]:
    """What is left, the gain (one over the mass, 1/kg) and the loss (1/s), best first.

    Of positions or speeds under a force. Place and speed at the begin are free in each recording;
    for each loss the gain, and a load that stays the same in all, are linear unknowns.
    """
    driven = [(c, c.drive) for c in cuts if c.drive is not None]
    if not driven:
        return []
    longest = max(c.output.size / c.rate for c, _ in driven)
    fastest = FASTEST * min(c.rate for c, _ in driven)
    found = []
    for loss in 2.0 * math.pi * np.geomspace(SLOWEST / longest, fastest, CORNERS):
        products = np.zeros((3, 3))
        for c, drive in driven:
            columns = _beyond_its_own(c, drive, float(loss))
            products += columns.T @ columns
        factors = np.linalg.lstsq(products[:2, :2], products[:2, 2], rcond=1e-12)[0]
        left = float(products[2, 2] - factors @ products[:2, 2])
        found.append((left, float(factors[0]), float(loss)))
    return sorted(found)


def _beyond_its_own(cut: Cut, drive: Array, loss: float) -> Array:
    """Answers of a mass of one to the force and to a load, and the output, as columns (n, 3).

    Without what the place and the speed at the begin may do.
    """
    period = 1.0 / cut.rate
    keep = math.exp(-loss * period)
    forces = np.stack([drive, np.ones(drive.size)], axis=1)
    answers = signal.lfilter(
        [0.0, -math.expm1(-loss * period) / loss], [1.0, -keep], forces, axis=0
    )
    if derivative_of(cut.unit) == 0:
        answers = signal.lfilter([0.5 * period, 0.5 * period], [1.0, -1.0], answers, axis=0)
    fades = np.exp(-loss * period * np.arange(drive.size))
    own = [fades] if derivative_of(cut.unit) else [np.ones(drive.size), fades]
    thin = slice(None, None, max(1, drive.size // THINNED))
    basis = np.linalg.qr(np.stack(own, axis=1)[thin])[0]
    columns = np.column_stack([answers, cut.output])[thin]
    return np.asarray(columns - basis @ (basis.T @ columns))
