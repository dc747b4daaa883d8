"""Exact intervals of a share counted in trials."""

from __future__ import annotations

from typing import NamedTuple

from scipy.stats import beta

__all__ = ['Share', 'share']


class Share(NamedTuple):
    """A count of successes with its exact interval."""

    hits: int
    trials: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """Hits over trials; NaN without trials."""
        return self.hits / self.trials if self.trials else float('nan')

    def __str__(self) -> str:
        if not self.trials:
            return 'no campaigns'
        return (
            f'{self.hits}/{self.trials} = {100 * self.value:.1f} % '
            f'[{100 * self.low:.1f}, {100 * self.high:.1f}]'
        )


def share(hits: int, trials: int, confidence: float = 0.95) -> Share:
    """Share with its interval after Clopper and Pearson (Biometrika 26, 1934).

    Raises ValueError where hits are not between 0 and the trials.
    """
    if not 0 <= hits <= trials:
        raise ValueError(f'{hits!r} hits in {trials!r} trials')
    tail = (1 - confidence) / 2
    low = float(beta.ppf(tail, hits, trials - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1 - tail, hits + 1, trials - hits)) if hits < trials else 1.0
    return Share(hits, trials, low, high)
