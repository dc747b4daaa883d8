"""Round numbers for the axes of a figure."""

from __future__ import annotations

import math

__all__ = ['decades', 'nice_range', 'nice_ticks']


def nice_ticks(low: float, high: float, count: int = 8) -> tuple[list[float], int]:
    """About ``count`` multiples of 1, 2 or 5 times a power of ten in [low, high].

    Returns the ticks and the number of decimals that tells them apart.
    """
    span = high - low
    if not math.isfinite(span) or span <= 0:
        return [low], 3
    raw = span / max(count, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * m for m in (1, 2, 5, 10) if power * m >= raw * 0.999)
    if math.floor(high / step + 1e-9) - math.ceil(low / step - 1e-9) < 2:
        # One or two numbers do not make an axis: the next finer round step.
        step /= 2.5 if math.isclose(step, 5 * power) else 2.0
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(i * step, decimals + 2) + 0.0 for i in range(first, last + 1)], decimals


def nice_range(low: float, high: float, margin: float = 0.05) -> tuple[float, float]:
    """[low, high] with a margin on both sides; never empty, never non-finite."""
    if not (math.isfinite(low) and math.isfinite(high)) or low > high:
        return 0.0, 1.0
    span = high - low
    if span <= 1e-9 * max(abs(low), abs(high)):
        span = max(abs(high), 1.0) * 0.2
    return low - margin * span, high + margin * span


def decades(low: float, high: float) -> list[float]:
    """Powers of ten in [low, high], both above zero."""
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    step = max(1, (last - first) // 6)
    return [10.0**i for i in range(first, last + 1, step)]
