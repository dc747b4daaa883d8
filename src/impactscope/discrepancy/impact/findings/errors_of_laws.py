"""What is too slight beside a finding to be more than an error of its law."""

from __future__ import annotations

import math
from collections.abc import Sequence

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.search.outcome import Outcome

__all__ = ['errors_told', 'without_errors_of_laws']

_DRY = ('coulomb_friction', 'asymmetric_friction', 'stribeck_friction')
_SLIGHT = 0.01  # of the amplitude of a finding, up to which a further effect is no other one
_ROUGH = 0.03  # likewise beside dry friction
_DELAYING = ('low_pass_filter', 'clock_error')  # of a channel, that a law may look like


def without_errors_of_laws(outcome: Outcome) -> tuple[list[Candidate], list[Candidate]]:
    """What was found, and what is too slight beside it to be more than an error of its law.

    No law is exact: dry friction yields a little before it slips, and turns round between
    samples. What the measuring chain adds is no matter of laws.
    """
    gains = {c.label: outcome.found[c.label].gain for c in outcome.accepted}
    strongest = max(outcome.accepted, key=lambda c: gains[c.label], default=None)
    if strongest is None:
        return [], []
    share = _ROUGH if strongest.name in _DRY else _SLIGHT
    least = share**2 * gains[strongest.label]

    def slight(candidate: Candidate) -> bool:
        own = candidate.subsystem == 'measurement' and candidate.name not in _DELAYING
        return not own and gains[candidate.label] < least

    kept = [c for c in outcome.accepted if not slight(c)]
    return kept, [c for c in outcome.accepted if slight(c)]


def errors_told(
    named: Sequence[Candidate], slight: Sequence[Candidate], outcome: Outcome
) -> tuple[str, ...]:
    """The note on effects that are not named for being so slight; none where there are none."""
    if not slight:
        return ()
    gains = [outcome.found[c.label].gain for c in named]
    share = math.sqrt(max(outcome.found[c.label].gain for c in slight) / max(gains))
    text = ', '.join(dict.fromkeys(c.name for c in slight))
    return (
        f'The extended model has {text} as well, which explains no more than {share:.1%} of the '
        f'amplitude of what was found: an error of its law, and no finding.',
    )
