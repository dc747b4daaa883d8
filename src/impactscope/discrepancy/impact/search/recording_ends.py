"""Ends of recordings that only a filter which runs backwards leaves as they are.

Behind a filter that was run forwards and backwards over a recording that ends in motion, the last
samples hang on how it was continued there, of which no file tells. No law of the bench leaves
something in the last milliseconds alone, and no filter is found while these decide.
"""

from __future__ import annotations

import numpy as np

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.fits.least_squares import Fit, fit
from impactscope.discrepancy.impact.models.bench_model import RECORDING_END

__all__ = ['runs_backwards', 'without_odd_ends']

_ODD = 9.0  # times the mean square of all else, from which an end is odd
_FEWEST = 8  # samples at the ends of a channel


def runs_backwards(candidate: Candidate) -> bool:
    """Whether a candidate is a filter that runs backwards, too."""
    return any(
        candidate.constants.get(f'{effect.tag}.zero_phase', 0.0) > 0.5
        for effect in candidate.effects
    )


def without_odd_ends(current: Fit) -> Fit | None:
    """The fit without the ends of channels in which far more is left there than elsewhere.

    None where there are no such channels.
    """
    odd = frozenset(name for name in current.model.data.channels if _is_odd(current, name))
    if not odd:
        return None
    layout = current.layout
    eased = current.model.layout(layout.blows, layout.window, without_ends=odd)
    return fit(current.model, eased, current.x, near=current)


def _is_odd(current: Fit, name: str) -> bool:
    """Whether far more is left at the ends of a channel."""
    layout = current.layout
    at_end, before = [], []
    for (i, channel), span in layout.spans.items():
        if channel != name:
            continue
        measured = current.model.data.blows[i].channels[name]
        last = measured.centres[layout.masks[i, name]] >= measured.time[-1] - RECORDING_END
        squares = current.residuals[span] ** 2
        at_end.append(squares[last])
        before.append(squares[~last])
    ends, rest = np.concatenate(at_end), np.concatenate(before)
    if ends.size < _FEWEST or not rest.size:
        return False
    return float(np.mean(ends)) > _ODD * max(1.0, float(np.mean(rest)))
