"""Where what has to stay above zero dips or crosses within a step; compiled."""

from __future__ import annotations

import math

from impactscope.physics.mechanisms.compiled import compiled, law

__all__ = ['dip', 'lowest', 'narrowed', 'secant']


@compiled
def lowest(start: float, start_rate: float, end: float, end_rate: float, h: float) -> float:
    """Share of a step at which a cubic through both ends is lowest; 0 if it is at an end."""
    if start_rate >= 0.0 or end_rate <= 0.0:
        return 0.0
    a, b = start_rate * h, end_rate * h
    # derivative of the Hermite cubic: a + c1 s + c2 s^2
    c1 = -4.0 * a - 2.0 * b + 6.0 * (end - start)
    c2 = 3.0 * a + 3.0 * b - 6.0 * (end - start)
    if abs(c2) < 1e-300:
        share = -a / c1
    else:
        root = c1 * c1 - 4.0 * c2 * a
        if root < 0.0:
            return 0.0
        share = (-c1 + math.sqrt(root)) / (2.0 * c2)
    return share if 0.0 < share < 1.0 else 0.0


@compiled
def dip(start: float, start_rate: float, end: float, end_rate: float, h: float) -> float:
    """Share of a step at which a cubic through both ends dips below zero; 0 if it does not."""
    share = lowest(start, start_rate, end, end_rate, h)
    if share == 0.0:
        return 0.0
    a, b = start_rate * h, end_rate * h
    s2, s3 = share * share, share**3
    value = (
        start * (1.0 - 3.0 * s2 + 2.0 * s3)
        + a * (share - 2.0 * s2 + s3)
        + end * (3.0 * s2 - 2.0 * s3)
        + b * (s3 - s2)
    )
    return share if value < 0.0 else 0.0


@law
def secant(low: float, f_low: float, high: float, f_high: float) -> float:
    """Where a line through both ends of a bracket crosses zero."""
    return high - f_high * (high - low) / (f_high - f_low) if f_high != f_low else high


@law
def narrowed(
    low: float, f_low: float, high: float, f_high: float, side: int, at: float, value: float
) -> tuple[float, float, float, float, int]:
    """A bracket about a zero, its high end below, with a further value (Illinois method).

    ``side``: of the end that moved last, which the result tells anew; 0 at first. An end that
    stays twice counts for half.
    """
    if value < 0.0:
        return low, 0.5 * f_low if side == -1 else f_low, at, value, -1
    return at, value, high, 0.5 * f_high if side == 1 else f_high, 1
