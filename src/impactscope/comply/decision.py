"""The decision rule: a force against a limit, with a guard band for the uncertainty.

Four states after ILAC-G8:09/2019 (binary statement with guard band, non-binary acceptance) with
w = U95, see also JCGM 106: pass up to TL - w, conditional pass up to TL, conditional fail up to
TL + w, fail above. Without guard band w is 0 (simple acceptance).
"""

from __future__ import annotations

from dataclasses import dataclass

from impactscope.comply.severity import severity
from impactscope.records import Estimate, Verdict

__all__ = ['PhaseDecision', 'decide', 'newtons', 'rule_in_words']


@dataclass(frozen=True, slots=True)
class PhaseDecision:
    """A force of one phase against the limit that applies to it; all in N."""

    phase: str  # 'Transient' or 'Quasi-static'
    force: Estimate
    limit: float
    guard_band: float
    verdict: Verdict

    @property
    def weight(self) -> tuple[int, float]:
        """Orders decisions: the one that decides has the largest weight."""
        return severity(self.verdict), self.force.value / self.limit

    def sentence(self, region_title: str) -> str:
        """The decision in words, with numbers and units."""
        margin = self.force.value - self.limit
        side = 'above' if margin > 0 else 'below'
        where = ', inside' if self.verdict in _CONDITIONAL else ''
        if self.guard_band == 0:
            band = '(no guard band)'
        elif where:
            band = f'the guard band of {newtons(self.guard_band)}'
        else:
            band = f'(guard band {newtons(self.guard_band)})'
        return (
            f'{self.phase} force {newtons(self.force.value)} is {side} the limit '
            f'{self.limit:g} N for {region_title} by {newtons(abs(margin))}{where} {band}.'
        )


_CONDITIONAL = (Verdict.CONDITIONAL_PASS, Verdict.CONDITIONAL_FAIL)


def decide(phase: str, force: Estimate, limit: float, guard_band: float) -> PhaseDecision:
    """Judge a finite force (N) against a limit (N) with the half-width of the guard band (N)."""
    if force.value <= limit - guard_band:
        verdict = Verdict.PASS
    elif force.value <= limit:
        verdict = Verdict.CONDITIONAL_PASS
    elif force.value <= limit + guard_band:
        verdict = Verdict.CONDITIONAL_FAIL
    else:
        verdict = Verdict.FAIL
    return PhaseDecision(phase, force, limit, guard_band, verdict)


def rule_in_words(guard_band: bool) -> str:
    """How uncertainty enters, as it stands in a verdict."""
    if guard_band:
        return (
            'guard band w = U95 (k = 2) at the limit TL: pass up to TL - w, conditional pass up '
            'to TL, conditional fail up to TL + w, fail above (ILAC-G8:09/2019)'
        )
    return 'simple acceptance: pass up to the limit, fail above, uncertainty not considered'


def newtons(force: float) -> str:
    """A force for people: a tenth of a newton, two digits where it is smaller."""
    return f'{force:.1f} N' if abs(force) >= 1 or force == 0 else f'{force:.2g} N'
