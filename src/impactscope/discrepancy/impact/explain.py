"""The answer to a campaign of blows: baseline, search, findings, and what is still unknown."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.answer import (
    Answer,
    Finding,
    Mismatch,
    ParameterEstimate,
    Region,
    held_out_alone,
    stand_ins_told,
)
from impactscope.discrepancy.campaign import Campaign, Role
from impactscope.discrepancy.evidence import BESIDE_UNKNOWN, Thresholds, at_a_bound
from impactscope.discrepancy.impact.adequacy.residual_tests import (
    TESTED,
    Adequacy,
    adequacy,
    law_instead,
)
from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.data.blows import CampaignData, prepare
from impactscope.discrepancy.impact.findings.estimates import fitted_numbers, saved_model
from impactscope.discrepancy.impact.findings.figures import fit_table, pictures
from impactscope.discrepancy.impact.findings.ranking import ranked, share_of_known, weaker
from impactscope.discrepancy.impact.findings.shifted_parameters import shifted_parameters_told
from impactscope.discrepancy.impact.fits.growing_windows import (
    fit_baseline,
    fit_unless_far_behind,
    further,
    held_out_fit,
)
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.fits.slow_noise import likelier, noise_left
from impactscope.discrepancy.impact.fits.tap_end import with_later_cuts
from impactscope.discrepancy.impact.models.baseline import baseline_model, with_metal_that_lets_go
from impactscope.discrepancy.impact.models.bench_model import ImpactModel
from impactscope.discrepancy.impact.noise.coloured_noise import Colour
from impactscope.discrepancy.impact.search.baseline_conventions import (
    conventions_told,
    other_conventions,
    with_conventions_of,
    with_likelier,
)
from impactscope.discrepancy.impact.search.errors_of_laws import (
    errors_told,
    rest_of_a_law,
    without_errors_of_laws,
)
from impactscope.discrepancy.impact.search.forward_backward import Search
from impactscope.discrepancy.impact.search.held_out import fit_together
from impactscope.discrepancy.impact.search.outcome import Outcome, with_findings
from impactscope.discrepancy.impact.search.prediction_misfit import prediction_misfit
from impactscope.discrepancy.locate import Strip, locate
from impactscope.discrepancy.lone_samples import Left, lone_samples_told
from impactscope.discrepancy.processes import in_processes
from impactscope.discrepancy.time_limit import time_left
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism
from impactscope.physics.twin.simulate import SimulationError

__all__ = ['explain_impact', 'with_direct']

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

_VISIBLE_STEP = 0.15  # of the noise, from which the converter's steps are coarse
_STATED_TESTS = 4
_NOT_MET = 100.0  # reduced chi-square of a blow that no start has met
_NOISE_AT_MOST = 6.0  # reduced chi-square up to which noise may be slower than was known
_SLOW = ('ac_coupling', 'offset', 'zero_drift')  # effects that slow noise may look like
_SEEN_MISSED = 1.21  # reduced chi-square of a prediction, from which it is told
_FIRST_CONTACT = 0.012  # s after the onset
_PRICE = 10.0  # chi-square that a further number must bring
_SHOWN_BY_ONE = 'what one held-out recording alone shows'
_SLOWER_NOISE = 'whether slower noise explains as much'
_OTHER_WAYS = 'other ways to take the names of the baseline'
_CERTAIN = 300.0  # of chi-square, that slow noise does not imitate unseen
_FAR_BEHIND = 100.0  # of chi-square
_SLIGHT = 0.01  # of the amplitude of findings, of what is left beside them
_HARDLY = 0.5  # of the probability of such an effect
_AS_MISSED = 0.9  # of the chi-square of a recording that findings have nothing to do with
_BORNE_OUT = 0.5  # of what findings gain for a fitted sample, for one of what is held out
_OUTDONE = 0.1  # odds of the findings against a law, below which the law is meant
_INDISTINCT = 1.0  # square of the distance of residuals
_WEAK = 2.0  # reduced chi-square of a baseline up to which a missing effect is a weak one


def explain_impact(campaign: Campaign, progress: Progress) -> Answer:
    """The answer for a campaign of blows on the bench; see :func:`explain`."""
    thresholds = Thresholds()
    progress(0.0, 'recordings')
    campaign = with_metal_that_lets_go(campaign)
    data = prepare(campaign)
    outcome = _searched(campaign, data, thresholds, progress)
    data, outcome, noise = _in_slower_noise(campaign, data, outcome, thresholds, progress)
    shown = _shown_by_one(campaign, outcome, noise, thresholds, progress)
    if shown is not None:
        campaign, data, outcome = shown
    progress(0.95, 'regions')
    return _answer(campaign, data, outcome, thresholds)


def _in_slower_noise(
    campaign: Campaign,
    data: CampaignData,
    outcome: Outcome,
    thresholds: Thresholds,
    progress: Progress,
) -> tuple[CampaignData, Outcome, Mapping[str, Colour]]:
    """The search in noise that is slower than the quiet shows, where that explains as much.

    Recordings in the noise that is believed, what was found in it, and the noise of the channels
    in which it is slower.
    """
    near = outcome.final.reduced < _NOISE_AT_MOST
    unexplained = _left(outcome, thresholds)
    explained = bool(outcome.accepted) and not unexplained
    slower: Mapping[str, Colour] = {}
    if near and (unexplained or (explained and not _certain(outcome))):
        slower = noise_left(_without_slow(data, outcome))
    while slower:
        if explained and not time_left(_SLOWER_NOISE):
            break
        told = prepare(campaign, slower)

        def again(share: float, text: str) -> None:
            progress(0.9 + 0.05 * share, f'with slower noise: {text}')

        other = _searched(campaign, told, thresholds, again, outcome.final.model)
        # less explains less: what is found beyond came with the other noise
        fewer = len(other.accepted) <= len(outcome.accepted)
        if explained and (not fewer or _likelier(outcome, other, slower)):
            break
        if explained and not time_left(_SLOWER_NOISE):
            break  # cut off, it finds less than there is
        still = _slower_still(data, outcome, other, slower) if explained else slower
        if still.keys() == slower.keys():
            return told, other, slower
        slower = still
    return data, outcome, {}


def _shown_by_one(
    campaign: Campaign,
    outcome: Outcome,
    slower: Mapping[str, Colour],
    thresholds: Thresholds,
    progress: Progress,
) -> tuple[Campaign, CampaignData, Outcome] | None:
    """The search with the held-out recording that is missed most among the fitted ones.

    A stop that the hardest blow alone reaches is in no other recording. None: nothing is missed,
    or the search does not find all that it found before, something beyond it, and nothing left
    then.
    """
    held = outcome.held_out_final
    missed = held is not None and _unexplained(outcome, thresholds).held_out
    if held is None or not missed or not time_left(_SHOWN_BY_ONE):
        return None
    worst = held.model.data.blows[_missed_most(held)].name
    parts = tuple(
        dataclasses.replace(r, role=Role.FIT) if r.file == worst else r
        for r in campaign.recordings
    )
    moved = dataclasses.replace(campaign, recordings=parts)
    data = prepare(moved, slower)

    def again(share: float, text: str) -> None:
        progress(0.9 + 0.05 * share, f'with {worst} fitted: {text}')

    other = _searched(moved, data, thresholds, again)
    before, now = ({c.name for c in o.accepted} for o in (outcome, other))
    if not before < now or _left(other, thresholds):
        return None
    other.notes.append(
        f'{worst} was held out and shows what no fitted recording does: it is fitted now. What it '
        'alone shows no held-out recording bears out: repeat that blow, and hold it out.'
    )
    return moved, data, other


def _likelier(outcome: Outcome, other: Outcome, slower: Mapping[str, Colour]) -> bool:
    """Whether the findings of ``outcome`` are likelier than ``slower`` noise, as in ``other``."""
    beyond = sum(c.cost for c in outcome.accepted) - sum(c.cost for c in other.accepted)
    return likelier(outcome.final, other.final, slower, max(beyond, 1))


def _slower_still(
    data: CampaignData, outcome: Outcome, other: Outcome, slower: Mapping[str, Colour]
) -> Mapping[str, Colour]:
    """The noise that is slower than was known beside what is found in ``slower`` noise, too.

    That was read from what is left without findings that it looks like. An offset that is found
    in it all the same leaves no level that noise would have to explain.
    """
    again = {c.label for c in other.accepted if c.name in _SLOW}
    channels = {c.channel for c in outcome.accepted if c.label in again} & slower.keys()
    if not channels:
        return slower
    left = noise_left(_without_slow(data, outcome, again))
    return slower if channels <= left.keys() else {n: c for n, c in left.items() if n in slower}


def _certain(outcome: Outcome) -> bool:
    """Whether no finding that explains everything could be slow noise: each is far too strong."""
    found = [outcome.found[c.label] for c in outcome.accepted if c.label in outcome.found]
    return (
        len(found) == len(outcome.accepted) > 0
        and all(f.gain > _CERTAIN for f in found)
        and not any(c.name in _SLOW for c in outcome.accepted)
    )


def _without_slow(data: CampaignData, outcome: Outcome, but: Collection[str] = ()) -> Fit:
    """The final fit without findings that slow noise looks like, where any channel has some.

    With them a fit has taken a part of that noise, and what is left shows less of it. Where one
    channel has slow noise the others may, too weak to be seen in the quiet.

    ``but``: labels of findings that stay.
    """
    coloured = any(c.colour is not None for b in data.blows for c in b.channels.values())
    gone = [c for c in outcome.accepted if coloured and c.name in _SLOW and c.label not in but]
    kept = [c for c in outcome.accepted if c not in gone]
    if len(kept) == len(outcome.accepted):
        return outcome.final
    return with_findings(outcome, kept, outcome.final.layout)


def _searched(
    campaign: Campaign,
    data: CampaignData,
    thresholds: Thresholds,
    progress: Progress,
    like: ImpactModel | None = None,
) -> Outcome:
    """What the search comes to, judged by the recordings that were held out.

    Where it matters what the baseline's names leave open, the search goes on from the likeliest
    choice, and from another one where something is left or that explains as much. Or it is taken
    as in ``like``, unless a baseline taken otherwise explains everything, and better.
    """
    progress(0.02, 'baseline')
    baseline = fit_baseline(with_conventions_of(baseline_model(campaign, data), like))
    if like is None:
        baseline = with_likelier(baseline)
    else:
        ways = in_processes(_baseline_or_none, other_conventions(baseline))
        likelier_way = functools.reduce(further, (w for w in ways if w is not None), baseline)
        if likelier_way is not baseline and likelier_way.reduced < thresholds.unexplained_ratio:
            baseline, like = likelier_way, None
    search = Search(campaign.baseline_names, thresholds, progress)
    outcome = search.run(with_later_cuts(baseline))
    others = other_conventions(outcome.final) if like is None else []
    left = bool(others) and _left(outcome, thresholds)
    if (left or outcome.accepted) and others and not time_left(_OTHER_WAYS):
        others, left = [], False
    if left:
        outcome = _by_other_names(search, outcome, baseline, others)
    elif outcome.accepted:
        outcome = search.with_conventions(outcome, others)
    outcome.tests = None  # of what is left now
    progress(0.9, 'held-out recordings')
    search.check(outcome)
    return outcome


def _by_other_names(
    search: Search, outcome: Outcome, baseline: Fit, others: Sequence[ImpactModel]
) -> Outcome:
    """What is found from a baseline with its names taken as in one of ``others``, if less is left.

    The search as it went where none of them is worth another.
    """
    fits = in_processes(lambda m: _otherwise(baseline, m), others)
    known = [f for f in fits if f is not None]
    if not known:
        return outcome
    other = functools.reduce(further, known)
    if _same(other, baseline):
        return search.with_conventions(outcome, [other.model]) if outcome.accepted else outcome
    if _far_behind(other, baseline):
        return outcome
    both = (outcome, search.run(with_later_cuts(other)))
    return min(both, key=lambda o: (_left(o, search.thresholds), _cost(o)))


def _otherwise(baseline: Fit, taken: ImpactModel) -> Fit | None:
    """The baseline from a cold start, its names taken as in ``taken``; None: far behind.

    What one that is lost on its way leaves tells nothing of how far another one goes.
    """
    model = with_conventions_of(baseline.model, taken)
    return _baseline_or_none(model) if _lost(baseline) else fit_unless_far_behind(model, baseline)


def _baseline_or_none(model: ImpactModel) -> Fit | None:
    """A baseline beside another; None where it cannot be simulated."""
    with contextlib.suppress(SimulationError):
        return fit_baseline(model)
    return None


def _lost(baseline: Fit) -> bool:
    """Whether a baseline does not follow the blows to their end."""
    return baseline.layout.size < baseline.model.layout(baseline.layout.blows).size


def _left(outcome: Outcome, thresholds: Thresholds) -> bool:
    return _unexplained(outcome, thresholds).left


def _same(other: Fit, baseline: Fit) -> bool:
    """Whether two baselines leave the same: a search would go the same way from either."""
    if other.layout.size != baseline.layout.size:
        return False
    size = baseline.layout.size
    apart = other.residuals[:size] - baseline.residuals[:size]
    return float(apart @ apart) < _INDISTINCT


def _far_behind(other: Fit, baseline: Fit) -> bool:
    """Whether a baseline leaves far more than one that lacks no more than something weak."""
    size = baseline.layout.size
    if baseline.reduced > _WEAK or _lost(baseline):
        return False
    excess = other.chi_square - baseline.chi_square
    return other.layout.size < 0.98 * size or excess > _FAR_BEHIND


def _cost(outcome: Outcome) -> float:
    added = len(outcome.final.model.free) - len(outcome.baseline.model.free)
    return outcome.final.chi_square + _PRICE * added


def _answer(
    campaign: Campaign, data: CampaignData, outcome: Outcome, thresholds: Thresholds
) -> Answer:
    direct = _direct_findings(data)
    accepted, slight = without_errors_of_laws(outcome)
    rest = _unexplained(outcome, thresholds)
    unexplained, description = rest.left, rest.description
    instead = unexplained and not rest.beside
    kept = share_of_known(outcome.final.reduced, rest.chance, thresholds)
    seen = bool(direct)
    if not unexplained:  # what was fitted knows more than what was seen
        fitted = {(c.name, c.channel) for c in accepted}
        direct = [f for f in direct if (f.name, f.channel) not in fitted]
    traces, strips = pictures(outcome)
    findings = ranked(outcome, [*accepted, *slight])
    found = [c.name for c in accepted]
    beside = slice(len(accepted), len(accepted) + len(slight))
    findings[beside] = [weaker(f, _HARDLY) for f in findings[beside]]
    if unexplained and not instead:
        findings = [weaker(f, BESIDE_UNKNOWN) for f in findings]
        findings.insert(len(found), _unknown(1.0 - kept))
        found.append('unknown')
    elif instead:
        findings = [weaker(f, kept) for f in findings]
        resembles = ', '.join(dict.fromkeys(f.name for f in findings[:1]))
        if resembles:
            description += f' Of what is known here it most resembles {resembles}.'
        found = ['unknown']
        findings.insert(0, _unknown(1.0 - kept))
    ranking, found = with_direct(findings, found, direct)
    detected = bool(found)
    regions = locate(strips, thresholds.false_region) if detected else ()
    regions = (*_clipped_regions(data), *regions)
    subsystems = dict.fromkeys(f.subsystem for name in found for f in ranking if f.name == name)
    p_value = min(outcome.p_value, 0.0 if seen else 1.0)
    if unexplained:
        p_value = min(p_value, rest.chance)
    figures = fit_table(data, outcome)
    tests = _next_tests(ranking, found, campaign)
    if unexplained:
        tests = (*held_out_alone(figures, thresholds.unexplained_ratio), *tests)
    return Answer(
        campaign=campaign.name,
        kind=campaign.kind.value,
        mismatch=Mismatch(detected, p_value, regions, tuple(subsystems)),
        accepted=tuple(found),
        ranking=tuple(ranking),
        fit=figures,
        unexplained=unexplained,
        unexplained_description=description if unexplained else '',
        next_tests=tests[:_STATED_TESTS],
        baseline=campaign.baseline_names,
        baseline_parameters=fitted_numbers(outcome.baseline),
        extended_parameters=fitted_numbers(outcome.final),
        model=_saved(campaign, outcome, () if instead else accepted),
        notes=(
            *(stand_ins_told(c.name for c in accepted) if instead else ()),
            *errors_told(slight, outcome),
            *campaign.notes,
            *data.notes,
            *conventions_told(outcome.final.model),
            *outcome.notes,
            *(shifted_parameters_told(outcome.baseline, outcome.final) if accepted else ()),
            *_amplified(outcome),
            *(() if unexplained else _lone_samples(strips, ranking[: len(found)])),
        ),
        traces=traces,
    )


def _lone_samples(strips: Sequence[Strip], findings: Sequence[Finding]) -> tuple[str, ...]:
    left = (Left(s.recording, s.channel, s.time, s.extended) for s in strips)
    return lone_samples_told(left, findings)


def _unknown(probability: float) -> Finding:
    return Finding(
        'unknown', probability, 'unknown', sentence='Something is missing that is not known.'
    )


def with_direct(
    findings: Sequence[Finding], found: Sequence[str], direct: Sequence[Finding]
) -> tuple[list[Finding], list[str]]:
    """The ranking, and what is found, with what was seen in the samples themselves.

    What is found stands first in ``findings``. A channel that is cut off comes before it, the
    steps of a converter after it: they hide no motion.
    """
    steps = [f for f in direct if f.name == 'quantisation']
    clipped = [f for f in direct if f.name != 'quantisation']
    ranking = [*clipped, *findings[: len(found)], *steps, *findings[len(found) :]]
    return ranking, [*(f.name for f in clipped), *found, *(f.name for f in steps)]


def _saved(campaign: Campaign, outcome: Outcome, named: Sequence[Candidate]) -> dict[str, object]:
    """The baseline of a next search; what stands in for the unknown is no part of it."""
    if not named:
        outcome = dataclasses.replace(outcome, final=outcome.baseline)
    return saved_model(campaign, outcome, named)


# --- decisions -----------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, slots=True)
class _Rest:
    """Whether something is left that nothing explains, and how it behaves.

    ``chance``: that noise alone leaves it, as far as tests of its kind tell.
    """

    left: bool
    description: str = ''
    chance: float = 1.0
    beside: bool = False  # nothing that puts the names of what was found in doubt
    held_out: bool = False  # only recordings that were held out show it


def _unexplained(outcome: Outcome, thresholds: Thresholds) -> _Rest:
    """Whether something is left that nothing explains, and how it behaves."""
    final = outcome.final
    ratio = final.reduced
    held = outcome.held_out_final
    tests = outcome.tests = outcome.tests or adequacy(final)
    allowed = thresholds.unexplained_ratio * max(1.0, ratio)
    missed = (
        held is not None
        and held.reduced > allowed  # quick to see, and never less than what follows
        and prediction_misfit(final, held) > allowed
        and _missed_early(outcome, allowed)
        and not _met_together(outcome, held, allowed)
    )
    excused = missed and _met_by_no_start(outcome)
    if ratio <= thresholds.unexplained_ratio:
        if tests.p_value < thresholds.inadequate:
            return _Rest(
                True,
                'Something is missing that no known mechanism explains: what is left is as small '
                f'as the noise, but not of its kind ({tests.worst}; by chance in '
                f'{tests.p_value:.1g} of campaigns).',
                tests.p_value,
                _slight(outcome, tests) or rest_of_a_law(outcome, tests),
            )
        strained = _strained(outcome)
        instead, law = _law_instead(outcome, strained)
        outdone = 1.0 if strained else _OUTDONE
        if instead < outdone:
            return _Rest(
                True,
                f'Something is missing that no known mechanism explains: {law} explains the '
                'recordings better than anything that is known here.',
                thresholds.inadequate * instead / outdone,
            )
        if held is None or not missed or excused:
            return _Rest(False, held_out=missed)
        return _Rest(
            True,
            'Something is missing that no known mechanism explains: held-out recordings are '
            f'missed by {math.sqrt(held.reduced):.3g} times the noise{_most_of_all(held)}.',
            tests.p_value,
            _borne_out(outcome) or _one_is_another(outcome, allowed, thresholds.held_out_loss),
            held_out=True,
        )
    parts = []
    for (i, name), span in final.layout.spans.items():
        residual = final.residuals[span]
        if residual.size:
            share = math.sqrt(float(residual @ residual) / residual.size)
            parts.append((share, f'{name} of {final.model.data.blows[i].name}'))
    parts.sort(reverse=True)
    where = parts[0][1] if parts else 'the recordings'
    return _Rest(
        True,
        'Something is missing that no known mechanism explains: with the best of them the '
        f'residual is still {math.sqrt(ratio):.3g} times the noise, most of all in {where} '
        f'({parts[0][0]:.3g} times).',
        tests.p_value,
    )


def _slight(outcome: Outcome, tests: Adequacy) -> bool:
    """Whether the rest is slighter than a hundredth of what was found, by amplitude.

    Tests find no rest that gains less than some ten of chi-square, so findings gain 100 000 then.
    """
    worst = min(tests.p_values, key=lambda name: tests.p_values[name])
    gain = outcome.baseline.chi_square - outcome.final.chi_square
    return bool(outcome.accepted) and tests.excess[worst] < _SLIGHT**2 * gain


def _borne_out(outcome: Outcome) -> bool:
    """Whether held-out recordings gain by what was found about as the fitted ones do.

    What they are missed by is something else then, that shows only in them, such as a stop that
    no other blow has reached.
    """
    before, after = outcome.held_out_baseline, outcome.held_out_final
    if not outcome.accepted or before is None or after is None:
        return False
    fitted = outcome.baseline.reduced - outcome.final.reduced
    return before.reduced - after.reduced > _BORNE_OUT * fitted > 0.0


def _most_of_all(held: Fit) -> str:
    """Which held-out recording is missed most; empty where there is one alone."""
    if len(held.layout.blows) < 2:
        return ''
    worst = _missed_most(held)
    name, missed = held.model.data.blows[worst].name, math.sqrt(_missed_by(held, worst))
    return f', most of all {name} ({missed:.3g} times)'


def _missed_most(held: Fit) -> int:
    """Number of the held-out blow that is missed most."""
    return max(held.layout.blows, key=lambda i: _missed_by(held, i))


def _missed_by(held: Fit, blow: int) -> float:
    """Reduced chi-square of one held-out blow."""
    left = held.residuals[held.layout.blow_spans[blow]]
    return float(np.mean(left**2)) if left.size else 0.0


def _one_is_another(outcome: Outcome, allowed: float, loss: float) -> bool:
    """Whether some held-out recordings are missed with and without what was found, and others met.

    Those that are met must gain by the findings what the fitted ones let expect, but for a
    ``loss`` of chi-square by chance. What is evident from stated numbers alone changes none.
    """
    before, after = outcome.held_out_baseline, outcome.held_out_final
    if not outcome.accepted or before is None or after is None:
        return False
    gained = wanted = 0.0
    met = False
    fitted = (outcome.baseline.reduced - outcome.final.reduced) * _BORNE_OUT
    for i in after.layout.blows:
        left = after.residuals[after.layout.blow_spans[i]]
        without = before.residuals[before.layout.blow_spans[i]]
        if without.size != left.size:
            return False
        worse, better = float(without @ without), float(left @ left)
        if better <= allowed * left.size:
            met = True
            gained += worse - better
            wanted += fitted * left.size
        elif worse < _AS_MISSED * better:
            return False
    return met and gained > wanted - loss


def _strained(outcome: Outcome) -> bool:
    """Whether a number of a finding stands at the end of what is credible for it."""
    values = outcome.final.values
    return any(
        at_a_bound(values[key], p.lower, p.upper)
        for c in outcome.accepted
        if c.name in all_mechanisms()
        for p in mechanism(c.name).parameters
        for key in (f'{c.label}.{p.name}',)
        if any(f.key == key for f in c.free)
    )


def _law_instead(outcome: Outcome, strained: bool) -> tuple[float, str]:
    """Odds of the findings against a law, see :func:`law_instead`; and its name."""
    tunable = outcome.accepted and all(c.free for c in outcome.accepted)
    if not tunable or outcome.baseline.reduced > _WEAK:
        return math.inf, ''
    cost = sum(c.cost for c in outcome.accepted)
    # each further finding was chosen among all mechanisms, too, where one law does
    chosen = 2.0 * math.log(len(all_mechanisms())) * (len(outcome.accepted) - 1)
    return law_instead(outcome.baseline, outcome.final, cost + chosen, strained)


def _missed_early(outcome: Outcome, allowed: float) -> bool:
    """Whether a prediction is missed before many bounces have amplified what is small."""
    final = outcome.final
    held = held_out_fit(final, final.model.data.held_out, TESTED)
    return held is not None and prediction_misfit(final, held) > allowed


def _met_by_no_start(outcome: Outcome) -> bool:
    """Whether a held-out recording may only have met no start, which says nothing of the model.

    That is where the fitted recordings leave only noise and it is missed from its first contact
    on, or contacts of bare metal amplify from the first one: that is told.
    """
    final = outcome.final
    chosen = final.model.data.held_out
    held = held_out_fit(final, chosen, TESTED)
    if held is None or (outcome.accepted and held.reduced < _NOT_MET):
        return False
    first = held_out_fit(final, chosen, _FIRST_CONTACT)
    bare = 'contact.stiffness' in final.values
    if final.reduced >= _WEAK or not (bare or first is None or first.reduced > _WEAK):
        return False
    note = (
        f'A held-out recording is missed by {math.sqrt(held.reduced):.3g} times the noise, '
        'though the fitted ones leave nothing but noise; that alone is no finding. Is it '
        'labelled rightly?'
    )
    if note not in outcome.notes:
        outcome.notes.append(note)
    return True


def _met_together(outcome: Outcome, held: Fit, allowed: float) -> bool:
    """Whether one set of numbers meets the recordings that were fitted and those held out.

    What bounces amplify lets a right model miss: what the fitted recordings leave open of its
    numbers is then more than slopes say.
    """
    final = outcome.final
    together = fit_together(final, held, outcome.accepted)
    if together is None:
        return False
    for blows in (final.layout.blows, held.layout.blows):
        left = np.concatenate([together.residuals[together.layout.blow_spans[i]] for i in blows])
        if float(np.mean(left**2)) > allowed:
            return False
    return True


def _amplified(outcome: Outcome) -> tuple[str, ...]:
    """What of a missed prediction the fitted recordings leave open, in a sentence."""
    final, held = outcome.final, outcome.held_out_final
    if held is None or not _SEEN_MISSED < held.reduced < _NOT_MET or final.reduced > _WEAK:
        return ()
    known = prediction_misfit(final, held)
    if known > _SEEN_MISSED:
        return ()
    return (
        f'Held-out recordings are missed by {math.sqrt(held.reduced):.3g} times the noise, and by '
        f'{math.sqrt(known):.3g} times where what the fitted ones leave open of the numbers that '
        'all share is allowed for: each contact amplifies it.',
    )


def _direct_findings(data: CampaignData) -> list[Finding]:
    """Effects of the chain that are seen in the samples themselves."""
    found = {}
    for blow in data.blows:
        for name, channel in blow.channels.items():
            kind, value = '', 0.0
            if math.isfinite(channel.clipped_at):
                kind, value = 'saturation', channel.clipped_at
            elif channel.step > _VISIBLE_STEP * channel.noise:
                kind, value = 'quantisation', channel.step
            if kind and (kind, name) not in found:
                effect = mechanism(kind)
                parameter = effect.parameters[0].name
                std = channel.noise if kind == 'saturation' else 1e-3 * value
                found[kind, name] = Finding(
                    kind,
                    0.99,
                    effect.subsystem.value,
                    {parameter: ParameterEstimate(value, std, channel.unit)},
                    channel=name,
                    sentence=effect.sentence,
                    equation=effect.equation,
                    source=effect.source,
                )
    return list(found.values())


def _clipped_regions(data: CampaignData) -> list[Region]:
    """Stretches in which a channel is cut off."""
    regions = []
    for blow in data.blows:
        for name, channel in blow.channels.items():
            if not math.isfinite(channel.clipped_at):
                continue
            hit = np.abs(channel.samples) >= channel.clipped_at * (1 - 1e-6)
            times = channel.time[hit]
            parts = np.split(times, np.flatnonzero(np.diff(times) > 5e-3) + 1)
            regions += [
                Region(blow.name, name, float(part[0]), float(part[-1]), 'peak') for part in parts
            ]
    return regions


# --- what to measure next ----------------------------------------------------------


def _next_tests(
    ranking: Sequence[Finding], found: Sequence[str], campaign: Campaign
) -> tuple[str, ...]:
    """The tests that would settle what is open."""
    known = all_mechanisms()
    tests: dict[str, None] = {}
    for finding in ranking:
        if finding.name not in found:
            continue
        for name in finding.confused_with:
            if name in known:
                tests[f'To tell {finding.name} from {name}: {known[name].test}.'] = None
            elif name == 'wrong_parameter':
                tests[
                    f'To tell {finding.name} from a wrong number of the simulation: measure that '
                    'number on its own (stiffness, mass and angle by a static test).'
                ] = None
    if 'unknown' in found:
        kinds = {r.kind for r in campaign.recordings}
        if 'tap' not in kinds:
            tests['Hammer taps of different strength: they show guide and spring alone.'] = None
        else:
            tests['Blows at several speeds and masses, otherwise alike: they part the states.'] = (
                None
            )
    if not found and not any('held out' in note for note in campaign.notes):
        for finding in ranking[:1]:
            if finding.name in known and finding.probability > 0.05:
                tests[f'To rule out {finding.name}: {known[finding.name].test}.'] = None
    return tuple(tests)
