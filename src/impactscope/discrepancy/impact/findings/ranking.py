"""Findings in order, with probabilities and what they may be confused with."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from impactscope.discrepancy.answer import (
    Finding,
    ParameterEstimate,
    numbers_left_open,
    suspects,
)
from impactscope.discrepancy.evidence import Thresholds, probabilities
from impactscope.discrepancy.impact.candidates.candidate import Candidate, contains
from impactscope.discrepancy.impact.findings.clock_drift import with_rate
from impactscope.discrepancy.impact.findings.estimates import estimates, stated_value
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.search.other_minima import widened
from impactscope.discrepancy.impact.search.outcome import QUIET, Found, Outcome
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism

__all__ = ['ranked', 'share_of_known', 'weaker']

_FAR_UP = 0.6  # of a cut-off, pi times it over the sampling rate
_SEEN = 9.0  # of chi-square, from which a law's shape shows
_AS_GOOD = 0.985  # of the evidence, of an explanation that is as good


def ranked(outcome: Outcome, accepted: Sequence[Candidate]) -> list[Finding]:
    """Every explanation that was fitted, with its probability among those that exclude it."""
    thresholds = Thresholds()
    first: list[Finding] = []
    seen: set[str] = {c.label for c in accepted}
    held = math.nan
    if outcome.held_out_baseline is not None and outcome.held_out_final is not None:
        held = outcome.held_out_baseline.chi_square - outcome.held_out_final.chi_square
    later: list[Finding] = []
    for candidate in accepted:
        mine = outcome.found[candidate.label]
        rivals = outcome.rivals.get(candidate.label, [])
        shares = probabilities([0.0, mine.criterion, *(r.criterion for r in rivals)])
        listed = _listed(mine.gain)
        own, others = listed * shares[1], [listed * share for share in shares[2:]]
        confused: dict[str, float] = {}
        for rival, share in zip(rivals, others, strict=True):
            name = rival.candidate.name
            if name == candidate.name and rival.candidate.channel == candidate.channel:
                own += share if name != 'wrong_parameter' else 0.0
            elif share > thresholds.confusable * own or _nests(rival, mine) or _kin(rival, mine):
                confused[name] = max(confused.get(name, 0.0), share)
        finding = _finding(candidate, outcome.final, own, tuple(confused), mine, held)
        modes = [f for f in outcome.modes if f.layout is outcome.final.layout]
        modes += [r.fit for r in rivals if _another_form(r, mine, outcome.final)]
        if candidate.effects:
            tag = candidate.effects[0].tag
            numbers = widened(finding.parameters, tag, outcome.final, modes, outcome.factors)
            finding = dataclasses.replace(finding, parameters=numbers)
        elif candidate.free:
            factor = outcome.factors.get(candidate.free[0].key, 1.0)
            numbers = {
                name: dataclasses.replace(item, std=factor * item.std)
                for name, item in finding.parameters.items()
            }
            finding = dataclasses.replace(finding, parameters=numbers)
        if candidate.name == 'wrong_parameter':
            least = thresholds.confusable * own
            pairs = zip(rivals, others, strict=True)
            finding = _or_another(finding, [r for r, share in pairs if share > least])
        first.append(_among_orders(finding, mine, rivals))
        for rival, share in zip(rivals, others, strict=True):
            if rival.candidate.label in seen or rival.candidate.name == candidate.name:
                continue
            seen.add(rival.candidate.label)
            instead = _finding(
                rival.candidate, rival.fit, share, (candidate.name,), rival, math.nan
            )
            if _bends_no_further(rival, mine):
                instead = numbers_left_open(instead)
            later.append(_among_orders(instead, rival, rivals))
    if not accepted:
        shares = probabilities([0.0, *(f.criterion for f in outcome.last)])[1:]
        tried = [
            _finding(f.candidate, f.fit, share, (), f, math.nan)
            for f, share in zip(outcome.last, shares, strict=True)
        ]
        later += suspects(tried, thresholds.confusable)
    later.sort(key=lambda f: -f.probability)
    return [*first, *later]


def share_of_known(reduced: float, chance: float, thresholds: Thresholds) -> float:
    """Probability that a known mechanism explains after all what a test calls unexplained.

    Args:
        reduced: chi-square of the final fit.
        chance: that noise alone leaves as much.
        thresholds: those of the answer.
    """
    if reduced > thresholds.unexplained_ratio:
        return 0.1
    return 0.02 + 0.28 * min(1.0, chance / thresholds.inadequate)


def weaker(finding: Finding, share: float) -> Finding:
    """The same finding where its kind of explanation has only this probability."""
    return dataclasses.replace(finding, probability=finding.probability * share)


def _listed(gain: float) -> float:
    """Probability that the truth is among what is known here, for a finding of that evidence.

    A weak effect that nobody has listed looks like one that is.
    """
    return 0.97 - 0.2 * math.exp(-max(gain, 0.0) / 60.0)


def _or_another(finding: Finding, rivals: Sequence[Found]) -> Finding:
    """A wrong number with the others that explain as much if they are wrong in its place."""
    texts = []
    for rival in rivals:
        candidate = rival.candidate
        if candidate.name != finding.name or not candidate.free:
            continue
        where = f' of {candidate.recording}' if candidate.recording else ''
        value = rival.fit.values[candidate.free[0].key]
        texts.append(f'{candidate.parameter.split("@")[0]}{where}, {value:.5g}')
    if not texts:
        return finding
    more = f' Or it is {"; or ".join(texts)}: the recordings cannot tell.'
    return dataclasses.replace(finding, sentence=finding.sentence + more)


def _among_orders(finding: Finding, mine: Found, rivals: Sequence[Found]) -> Finding:
    """A filter's cut-off with the uncertainty of order and form, where data leave them open."""
    if finding.name != 'low_pass_filter':
        return finding
    same = [
        r
        for r in rivals
        if r is not mine
        and r.candidate.name == finding.name
        and r.candidate.channel == finding.channel
    ]
    key = f'low_pass_filter:{finding.channel}.cutoff'
    shares = probabilities([f.criterion for f in (mine, *same)])
    stated = finding.parameters['cutoff']
    cutoffs = [float(stated.value), *(r.fit.values[key] for r in same)]
    spread = sum(p * (f - cutoffs[0]) ** 2 for p, f in zip(shares, cutoffs, strict=True))
    # far up only the delay is seen, of which a filter of samples has less than the analogue one
    # of its cut-off, and nobody says which of the two stands in the channel
    rate = next(
        b.channels[finding.channel].sample_rate
        for b in mine.fit.model.data.blows
        if finding.channel in b.channels
    )
    angle = math.pi * cutoffs[0] / rate
    ahead = f'low_pass_filter:{finding.channel}.ahead' in mine.candidate.constants
    form = 0.0
    if angle > _FAR_UP and not ahead:
        form = cutoffs[0] * (math.tan(angle) / angle - 1.0)
    std = math.hypot(float(stated.std), math.sqrt(spread), form)
    cutoff = ParameterEstimate(stated.value, std if math.isfinite(std) else math.nan, 'Hz')
    return dataclasses.replace(finding, parameters={**finding.parameters, 'cutoff': cutoff})


def _another_form(rival: Found, mine: Found, final: Fit) -> bool:
    """Whether a rival is the same law with the same numbers, meant otherwise.

    A weight that all recordings share, or that goes with their geometry: where one recording alone
    shows it, which is meant is as open as its number.
    """
    same = rival.candidate.name == mine.candidate.name and bool(mine.candidate.effects)
    keys = [f.key for f in rival.candidate.free] == [f.key for f in mine.candidate.free]
    return same and keys and rival.fit.layout is final.layout


def _nests(rival: Found, mine: Found) -> bool:
    """Whether a rival fits as well and only costs more numbers: the data cannot tell them."""
    return rival.candidate.cost > mine.candidate.cost and rival.gain > mine.gain - 3.0


def _bends_no_further(rival: Found, mine: Found) -> bool:
    """Whether a rival is the finding's law with a shape of its own, of which nothing is seen."""
    shaped = any(f.key not in rival.candidate.amplitudes for f in rival.candidate.free)
    fuller = contains(rival.candidate, mine.candidate) and shaped
    return fuller and rival.gain < mine.gain + _SEEN


def _kin(rival: Found, mine: Found) -> bool:
    """Whether a filter explains what a delay does to within what simulations agree, or vice versa.

    Which of the two it is hangs on the finest detail of the fastest samples.
    """
    one, other = mine.candidate, rival.candidate
    if not one.channel or one.channel != other.channel:
        return False
    related = one.name in all_mechanisms() and other.name in mechanism(one.name).kin
    near = rival.fit.reduced < QUIET * max(1.0, mine.fit.reduced)
    return related and near and rival.gain > _AS_GOOD * mine.gain


def _finding(
    candidate: Candidate,
    fitted: Fit,
    probability: float,
    confused: tuple[str, ...],
    found: Found,
    held_out_gain: float,
) -> Finding:
    if candidate.name == 'wrong_parameter':
        sentence, equation, source = _wrong_sentence(candidate, fitted)
    else:
        effect = mechanism(candidate.name)
        sentence, equation, source = effect.sentence, effect.equation, effect.source
        if candidate.striker:
            sentence += f' It acts in the blows of kind {candidate.striker} alone.'
    return Finding(
        name=candidate.name,
        probability=probability,
        subsystem=candidate.subsystem,
        parameters=estimates(candidate, with_rate(candidate, fitted)),
        confused_with=confused,
        channel=candidate.channel,
        recording=candidate.recording,
        sentence=sentence,
        equation=equation,
        source=source,
        evidence=found.gain,
        held_out_gain=held_out_gain,
    )


def _wrong_sentence(candidate: Candidate, fitted: Fit) -> tuple[str, str, str]:
    key = candidate.parameter.split('@')[0]
    where = f' of {candidate.recording}' if candidate.recording else ''
    if not candidate.free:
        text = f'The {key} stated for the bench is wrong: the recordings fit the other one.'
        return text, '', ''
    value, stated = fitted.values[candidate.free[0].key], stated_value(candidate)
    text = f'The file states {key}{where} as {stated:.5g}, the recordings say {value:.5g}.'
    return text, '', ''
