"""The transient force after a channel filter, shown beside the raw one that is judged.

No open source ties force measurement at robots to a channel frequency class. So the raw reading
is kept and judged, and the class most laboratories know stands beside it: what the two differ by
is noise and ringing.
"""

from __future__ import annotations

import math

import numpy as np

from impactscope.comply.evaluation import ForceEvaluation, ForceReading
from impactscope.errors import InputError
from impactscope.signals.filters import channel_class_filter

__all__ = ['filtered_peak_statement']

CHANNEL_CLASS = 180
# s on either side of the raw peak: several times what the filter takes to settle, so that the
# rest of a long record need not be filtered.
REACH = 0.1


def filtered_peak_statement(
    reading: ForceReading, evaluation: ForceEvaluation, contact_start: float
) -> list[str]:
    """At most one sentence; none where samples near the peak are lost or the rate is too low."""
    peak_time = contact_start + evaluation.transient_time
    if not math.isfinite(peak_time):
        return []
    near = slice(reading.samples_to(peak_time - REACH), reading.samples_to(peak_time + REACH))
    try:
        filtered = channel_class_filter(reading.samples[near], reading.sample_rate, CHANNEL_CLASS)
    except InputError:
        return []
    peak = float(np.max(filtered)) - reading.zero_level
    return [
        f'With CFC {CHANNEL_CLASS} (SAE J211) the transient force would read {peak:.1f} N; '
        'shown beside, not judged.'
    ]
