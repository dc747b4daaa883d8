"""How often an observer who knows every law, all numbers and the noise would be right.

He does not know which of the effects is hidden, if any, and decides by the likelihood (Neyman and
Pearson, Phil. Trans. R. Soc. A 231, 1933). What he finds has to exceed what noise makes of all
candidates in one of a hundred clean campaigns; and between two known courses that differ by d
standard deviations of the noise he errs in Phi(-d/2), if either is as likely. Each chance is that
of the worst of these steps alone, so nobody does better; who has to find the numbers does worse.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from scipy.stats import norm

__all__ = ['chance_of_name', 'chance_of_part', 'chance_of_set']

FALSE_FINDINGS = 0.01  # of clean campaigns in which something may be found


def chance_of_part(size: float, differences: Mapping[str, float]) -> float:
    """Chance that an effect is found and not taken for another one.

    Args:
        size: its d'.
        differences: the d' that each candidate leaves of it which would be a wrong answer.
    """
    looks = 1 + len(differences)
    least = float(norm.isf(-math.expm1(math.log1p(-FALSE_FINDINGS) / looks)))
    nearest = min(differences.values(), default=math.inf)
    return float(min(norm.cdf(size - least), norm.cdf(nearest / 2)))


def chance_of_set(parts: Iterable[Mapping[str, Any]], confusable: Collection[str]) -> float | None:
    """Chance that all parts of a campaign, as sealed, are named; None where it is not known."""
    chances = _chances(parts, confusable)
    return min(chances) if chances else None


def chance_of_name(
    parts: Iterable[Mapping[str, Any]], confusable: Collection[str]
) -> float | None:
    """Chance that the first name is one of the parts', as sealed; None where it is not known."""
    chances = _chances(parts, confusable)
    return 1.0 - math.prod(1.0 - c for c in chances) if chances else None


def _chances(parts: Iterable[Mapping[str, Any]], confusable: Collection[str]) -> list[float]:
    """Of each part; to name what cannot be told from it is no error."""
    told = [(part, part.get('differences') or {}) for part in parts]
    if not all(differences for _, differences in told):
        return []
    return [
        chance_of_part(
            float(part['detectability']),
            {
                name: float(rest)
                for name, rest in differences.items()
                if name != part['name'] and name not in confusable
            },
        )
        for part, differences in told
    ]
