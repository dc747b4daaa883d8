"""Where in a blow's force reading there is contact, and where the plate only rings.

After the impactor has left, the sensor's plate oscillates freely and its spring reports forces
of both signs. In a free oscillation every half-wave is smaller than the one before it, so a
positive half-wave larger than the negative one before it got new momentum: contact. A reading
that comes back from its zero level without having swung through it was pushed as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.records import Contact

__all__ = ['ContactRules', 'find_contacts']

GROWTH = 1.05  # of a half-wave over the one before it, beyond noise, that proves new momentum


@dataclass(frozen=True, slots=True)
class ContactRules:
    """What counts as contact in one blow; all in the unit of the force and in samples."""

    rate: float  # Hz
    threshold: float  # above it the smoothed reading is pushed (or rings)
    smoothing: int  # samples of the moving mean that the threshold applies to
    hold: int  # samples below the threshold that end a contact
    noise: float  # standard deviation of the smoothed reading


@dataclass(frozen=True, slots=True)
class _Span:
    start: int
    stop: int
    peak: float


def _smoothed(force: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """Centred moving mean; shorter at the ends, non-finite samples counted as zero."""
    finite = np.where(np.isfinite(force), force, 0.0)
    total = np.concatenate(([0.0], np.cumsum(finite)))
    centre = np.arange(force.size)
    low = np.maximum(centre - (n - 1) // 2, 0)
    high = np.minimum(centre + n // 2 + 1, force.size)
    means: NDArray[np.float64] = (total[high] - total[low]) / (high - low)
    return means


def _spans_above(values: NDArray[np.float64], threshold: float) -> list[_Span]:
    edges = np.diff(np.concatenate(([False], values > threshold, [False])).astype(np.int8))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [
        _Span(int(a), int(b), float(values[a:b].max())) for a, b in zip(starts, stops, strict=True)
    ]


def find_contacts(
    force: NDArray[np.float64], trigger: int, rules: ContactRules
) -> tuple[Contact, ...]:
    """Contacts in a force reading with its zero level removed.

    Args:
        force: N, compression positive, shape (n_samples,).
        trigger: sample by which the blow is known to have begun; spans that end before are noise.
        rules: thresholds.

    Returns:
        contacts in order of time, times in s after the first sample; at least one.
    """
    smooth = _smoothed(force, rules.smoothing)
    spans = [s for s in _spans_above(smooth, rules.threshold) if s.stop > trigger]
    if not spans:
        peak = trigger + int(np.argmax(smooth[trigger:]))
        spans = [_Span(peak, peak + 1, float(smooth[peak]))]
    contacts = [spans[0]]
    previous = spans[0]
    for span in spans[1:]:
        gap = smooth[previous.stop : span.start]
        swing = max(-float(gap.min(initial=0.0)), 0.0)
        if swing <= rules.threshold and gap.size < rules.hold:
            previous = _Span(previous.start, span.stop, max(previous.peak, span.peak))
            contacts[-1] = (
                _Span(contacts[-1].start, span.stop, max(contacts[-1].peak, span.peak))
                if contacts[-1].stop >= previous.start
                else contacts[-1]
            )
            continue
        # A swing at the threshold's own size may hide in it.
        bound = GROWTH * max(swing, rules.threshold) + 4 * rules.noise
        if swing <= rules.threshold:
            bound = max(bound, GROWTH * previous.peak if gap.size < rules.hold else bound)
        if span.peak > bound:
            contacts.append(span)
        previous = span
    return tuple(_contact(force, smooth, span, rules.rate) for span in contacts)


def _contact(
    force: NDArray[np.float64], smooth: NDArray[np.float64], span: _Span, rate: float
) -> Contact:
    part = force[span.start : span.stop]
    if not np.isfinite(part).any():
        part = smooth[span.start : span.stop]
    peak = int(np.nanargmax(part))
    return Contact(
        start=span.start / rate,
        end=span.stop / rate,
        peak_force=float(part[peak]),
        peak_time=(span.start + peak) / rate,
        impulse=math.fsum(part[np.isfinite(part)]) / rate,
    )
