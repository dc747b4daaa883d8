"""The order of verdicts: of several that apply, the worst has the last word."""

from __future__ import annotations

from collections.abc import Iterable

from impactscope.records import Verdict

__all__ = ['SEVERITY', 'severity', 'worst']

# Worst first. A force above a limit was measured; an unsound recording is no such finding, but
# it hides whether there is one; what is merely not stated can still be supplied.
SEVERITY: tuple[Verdict, ...] = (
    Verdict.FAIL,
    Verdict.CONDITIONAL_FAIL,
    Verdict.INVALID,
    Verdict.INCOMPLETE,
    Verdict.CONDITIONAL_PASS,
    Verdict.PASS,
)
_RANK = {verdict: rank for rank, verdict in enumerate(reversed(SEVERITY))}


def severity(verdict: Verdict) -> int:
    """Rank of a verdict, 0 for PASS, larger is worse."""
    return _RANK[verdict]


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """The worst of several verdicts; INCOMPLETE where there is none, since nothing was judged."""
    return max(verdicts, key=severity, default=Verdict.INCOMPLETE)
