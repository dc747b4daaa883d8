"""Whether an answer explains anything, or noise and effects stand for the unexplained."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from impactscope.discrepancy.answer import Answer
from impactscope.discrepancy.campaign import Campaign
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.search.beam_search import Outcome

__all__ = ['explains_nothing', 'leaves_most_as_noise', 'of_what_is_explained']

# of a channel: a model that leaves half of the recordings that it was fitted to, and more than the
# first of some or more than the last of what the baseline leaves of all, explains nothing
NEXT_TO_NOTHING, HALF_OF_IT, LITTLE = 0.9, 0.5, 0.8


def leaves_most_as_noise(answer: Answer | None) -> bool:
    """Whether noise is said to be all that is left, where that is most of the channel.

    Noise of some colour would then be nearly all there is: a channel that has nothing to do with
    the input, or a fit that went astray. So it did where a corner may as well be none: what the
    coupling holds of the time before is then an offset.
    """
    if answer is None or 'unknown' in answer.accepted:
        return False
    for finding in answer.ranking[: len(answer.accepted)]:
        corner = finding.parameters.get('corner')
        if corner is not None and float(corner.value) < corner.std:
            return True
    return _left(answer) > (HALF_OF_IT if answer.accepted else NEXT_TO_NOTHING)


def explains_nothing(answer: Answer | None) -> bool:
    """Whether an answer is that something is not known, where that is most of the channel.

    Beside so much, noise of some colour may have taken what plain effects would explain.
    """
    return answer is not None and answer.accepted == ('unknown',) and _left(answer) > HALF_OF_IT


def _left(answer: Answer) -> float:
    """What is left of the fitted recordings, over what they scatter."""
    told = [t for t in answer.traces if not t.held_out]
    left = sum(float(np.sum((t.measured - t.extended) ** 2)) for t in told)
    power = sum(float(np.sum((t.measured - np.mean(t.measured)) ** 2)) for t in told)
    return math.sqrt(left / power) if power > 0.0 else 0.0


def of_what_is_explained(
    campaign: Campaign, outcome: Outcome, segments: Sequence[Segment], notes: list[str]
) -> Outcome:
    """The outcome without findings where even the best model explains next to nothing."""

    def left_of(made: Fit, held_out: bool) -> float:
        pairs = zip(made.residuals, segments, strict=True)
        mine = [(r, s) for r, s in pairs if s.held_out == held_out]
        power = sum(float(np.sum((s.measured - np.mean(s.measured)) ** 2)) for _, s in mine)
        return math.sqrt(sum(float(np.sum(r**2)) for r, _ in mine) / (power or 1.0))

    fitted, predicted = left_of(outcome.best, False), left_of(outcome.best, True)
    before = left_of(outcome.baseline, False), left_of(outcome.baseline, True)
    little = fitted > LITTLE * before[0] and predicted >= LITTLE * before[1]
    if fitted < HALF_OF_IT or not (little or max(fitted, predicted) > NEXT_TO_NOTHING):
        return outcome
    drive = campaign.input_channel
    cause = f'not the answer to {drive} alone' if drive else 'no free oscillation'
    names = ', '.join(dict.fromkeys(s.channel for s in segments))
    ahead = f' and {predicted:.2g} where it was predicted' if predicted else ''
    notes.append(
        f'No mass, spring and damper, with or without a known effect, explains {names}: '
        f'{fitted:.2g} of it is left where it was fitted{ahead}. It is {cause}, or the machine is '
        'of another kind; look at the choice of channels.'
    )
    base = outcome.baseline
    rivals = (outcome.best, *outcome.rivals) if outcome.best is not base else outcome.rivals
    return Outcome(base, base, rivals, believed=False)
