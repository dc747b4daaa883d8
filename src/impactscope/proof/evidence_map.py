"""Where in a campaign a concealed effect shows: shares of d'² by recording, channel and time."""

from __future__ import annotations

import math

import numpy as np

from .detectability import Freedom
from .draw import Concealed

__all__ = ['BIN', 'evidence_map']

BIN = 0.01  # s


def evidence_map(concealed: Concealed) -> dict[str, dict[str, dict[str, float]]]:
    """Shares of d'² that stand in 10 ms bins: recording, channel, bin number to share.

    Bins are counted from the first sample of the recording; shares below a thousandth are left
    out.
    """
    freedom = Freedom(concealed.stated)
    parts, _ = freedom.fitted(concealed.truth)
    left = parts[:-1]
    total = sum(float(part @ part) for part in left)
    result: dict[str, dict[str, dict[str, float]]] = {}
    if total == 0:
        return result
    for index, (blow, part) in enumerate(zip(concealed.truth.blows, left, strict=True)):
        begin = 0
        for name in concealed.truth.channels:
            rate = concealed.truth.rates[name]
            size = math.ceil(blow.duration * rate)
            power = part[begin : begin + size] ** 2 / total
            begin += size
            bins = (np.arange(size) / rate / BIN).astype(np.int64)
            shares = np.bincount(bins, weights=power)
            kept = {str(i): round(float(v), 5) for i, v in enumerate(shares) if v >= 1e-3}
            if kept:
                result.setdefault(f'recording_{index:02d}.mcap', {})[name] = kept
    return result
