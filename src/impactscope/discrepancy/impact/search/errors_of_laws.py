"""What is too slight beside a finding to be more than an error of its law.

No law is exact: dry friction yields a little before it slips, and turns round between samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from impactscope.discrepancy.impact.adequacy.residual_tests import Adequacy
from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.search.outcome import Outcome

__all__ = ['errors_told', 'is_error_of_a_law', 'rest_of_a_law', 'without_errors_of_laws']

_DRY = ('coulomb_friction', 'asymmetric_friction', 'stribeck_friction')
_SLIGHT = 0.01  # of the amplitude of a finding, up to which a further effect is no other one
_ROUGH = 0.03  # likewise beside dry friction
_DELAYING = ('low_pass_filter', 'clock_error')  # of a channel, that a law may look like


def is_error_of_a_law(candidate: Candidate, gain: float, outcome: Outcome) -> bool:
    """Whether a further effect explains so little that the error of a finding's law does as well.

    What the measuring chain adds is no matter of laws.
    """
    if candidate.subsystem == 'measurement' and candidate.name not in _DELAYING:
        return False
    strongest, share = _strongest(outcome)
    return gain < share**2 * strongest


def rest_of_a_law(outcome: Outcome, tests: Adequacy) -> bool:
    """Whether what tests find left is as slight, beside dry friction."""
    strongest, share = _strongest(outcome)
    worst = min(tests.p_values, key=lambda name: tests.p_values[name])
    return share == _ROUGH and tests.excess[worst] < share**2 * strongest


def without_errors_of_laws(outcome: Outcome) -> tuple[list[Candidate], list[Candidate]]:
    """What was found, and what of it is too slight beside the rest to be named."""
    gains = {c.label: outcome.found[c.label].gain for c in outcome.accepted}
    slight = [c for c in outcome.accepted if is_error_of_a_law(c, gains[c.label], outcome)]
    return [c for c in outcome.accepted if c not in slight], slight


def errors_told(slight: Sequence[Candidate], outcome: Outcome) -> tuple[str, ...]:
    """The note on effects that are not named for being so slight; none where there are none."""
    if not slight:
        return ()
    strongest, _ = _strongest(outcome)
    most = max(outcome.found[c.label].gain for c in slight)
    share = math.sqrt(max(most, 0.0) / strongest) if strongest > 0.0 else 0.0
    text = ', '.join(dict.fromkeys(c.name for c in slight))
    return (
        f'The extended model has {text} as well, which explains no more than {share:.1%} of the '
        f'amplitude of what was found: an error of its law, and no finding.',
    )


def _strongest(outcome: Outcome) -> tuple[float, float]:
    """Fall of chi-square by the strongest finding, and the share that its law may be off."""
    found = [(outcome.found[c.label].gain, c) for c in outcome.accepted]
    if not found:
        return 0.0, _SLIGHT
    gain, candidate = max(found, key=lambda pair: pair[0])
    return gain, _ROUGH if candidate.name in _DRY else _SLIGHT
