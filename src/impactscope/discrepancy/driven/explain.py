"""What a driven, free or prescribed motion, or a measuring chain, shows beyond its baseline."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from impactscope.discrepancy.answer import Answer
from impactscope.discrepancy.campaign import Campaign, CampaignKind
from impactscope.discrepancy.driven.adequacy.cogging import cogging_of_motion
from impactscope.discrepancy.driven.adequacy.unmodelled_laws import Verdict
from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.findings.describe import describe
from impactscope.discrepancy.driven.findings.explains_nothing import (
    explains_nothing,
    leaves_most_as_noise,
    of_what_is_explained,
)
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.findings.unit_errors import told, with_right_units
from impactscope.discrepancy.driven.fits.equation_error import equation_start, position_cogging
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.model_comparison import Judge, noise_share
from impactscope.discrepancy.driven.models.model import Model, Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel
from impactscope.discrepancy.driven.models.structure_model import StructureModel
from impactscope.discrepancy.driven.models.terms import Term
from impactscope.discrepancy.driven.noise_limited import (
    SLOW_NOISE,
    Progress,
    chain_answer,
    mass_answer,
    motion_answer,
    plate_answer,
)
from impactscope.discrepancy.driven.search.beam_search import (
    Effort,
    Outcome,
    prospects,
    search,
)
from impactscope.discrepancy.driven.systems.chain import ChainModel
from impactscope.discrepancy.driven.systems.free_decay_start import forced_beginning
from impactscope.discrepancy.driven.systems.linear_baseline import (
    Start,
    held_between_samples,
    linear_start,
    stated_modes,
    with_known,
    with_rest_at_zero,
    with_right_signs,
    with_the_mass_alone,
)
from impactscope.discrepancy.driven.systems.local_elements import (
    LAWS,
    NO_SHAPES,
    Structure,
    linear_structure,
    quiet_structure,
)
from impactscope.discrepancy.driven.systems.modal import Modes, further_modes
from impactscope.discrepancy.driven.systems.modal_chain import chain_of_modes
from impactscope.discrepancy.driven.systems.prescribed_motion import (
    PrescribedModel,
    one_speed_told,
)
from impactscope.discrepancy.time_limit import share_of_time, time_left

__all__ = ['explain_driven']

GLANCE = Effort(depth=1, tried=3, beam=1)
COARSE = 0.01  # of the output's power: more is searched for what is plain before the noise is read
OF_BOTH = 0.5  # of the time, for the first of two searches where the second may well be needed
MODAL = 0.3  # share of the baseline's residual below which more modes explain most of it
MOST_HOLLOW = 10_000  # fitted samples that are searched to the noise although nothing is explained
MOST_TO_THE_NOISE = 120_000  # samples of a sprung mass; more take minutes and have told already
MANY = 3  # findings, of which some may stand for a beginning that was not free
FOLLOWED = 0.1  # of what a baseline leaves, in power: a search that leaves less follows the motion
CLEARLY_MORE = 1.1  # times what another model leaves
CHAIN_EFFORT = Effort(numbers=6, depth=4, tried=8, beam=3)
LOCAL_EFFORT = Effort(numbers=6, depth=2, tried=8, beam=2)
PROMISED = 0.5  # of the chi-square that a law needs, which it must promise where it sets out from


def explain_driven(campaign: Campaign, progress: Progress | None = None) -> Answer:
    """Find what the baseline of a campaign without unknown blows leaves out.

    Args:
        campaign: of kind driven (input ``none``: a free motion), prescribed_motion or chain,
            with samples in its recordings.
        progress: called with the share that is done, 0 to 1, and what is being done.

    Raises ConfigurationError for a baseline that is not known here, MissingChannelError for
    channels that no recording has, InputError where nothing is left to fit.
    """
    tell = progress or (lambda _share, _text: None)
    tell(0.02, 'fitting the baseline')
    campaign = with_rest_at_zero(with_right_signs(with_the_mass_alone(campaign)))
    campaign, wrong = with_right_units(campaign)
    return told(_explained(campaign, tell), wrong)


def _explained(campaign: Campaign, tell: Progress) -> Answer:
    """The answer for a campaign whose signs and units are right."""
    notes = list(campaign.notes)
    begun = linear_start(campaign, notes)
    answer = _searched(campaign, begun, notes, tell)
    if 'unknown' in answer.accepted or len(answer.accepted) >= MANY:
        told = forced_beginning(campaign, begun)
        if told:
            return dataclasses.replace(answer, notes=(*answer.notes, told))
    return answer


def _searched(campaign: Campaign, begun: Start, notes: list[str], tell: Progress) -> Answer:
    """The answer from the linear baseline on."""
    parts, model, segments, linear = begun.parts, begun.model, begun.segments, begun.linear
    if isinstance(model, PrescribedModel):
        notes += one_speed_told(segments)
    answer: Answer | None = None
    sure = False
    recorded = campaign.kind in {CampaignKind.DRIVEN, CampaignKind.PRESCRIBED_MOTION}
    coarse = recorded and _coarse(linear, segments)
    if campaign.kind is CampaignKind.DRIVEN:
        answer, sure = plate_answer(campaign, begun, tell)
        if answer is None and not coarse:
            answer, sure = mass_answer(campaign, begun, tell)
    elif campaign.kind is CampaignKind.PRESCRIBED_MOTION:
        with share_of_time(OF_BOTH if coarse else 1.0):
            answer, sure = motion_answer(campaign, parts, notes, tell)
    elif isinstance(model, ChainModel):
        answer, sure = chain_answer(campaign, model, segments, linear, notes, tell)
    if leaves_most_as_noise(answer):
        answer, sure = None, False
    elif explains_nothing(answer):
        sure = False
    doubted = sure and _may_err(answer) and coarse and isinstance(model, PrescribedModel)
    sure = sure and not doubted
    unknown = answer is not None and answer.accepted == ('unknown',)
    if answer is not None and sure and not (unknown and _modal(campaign, parts)):
        return answer
    if answer is not None and not time_left(
        'a search that does not take all that is left for noise'
    ):
        return answer
    baseline = with_known(campaign, model, segments, linear)
    judge = Judge(segments, len({t.name for t in model.terms}))
    modes, effort = None, Effort()
    if campaign.kind is CampaignKind.CHAIN:
        effort = CHAIN_EFFORT
    elif 'stiffness' in linear.values and 'mass' in linear.values and _modal(campaign, parts):
        tell(0.1, 'trying further modes')
        modes = further_modes(parts, segments, baseline, stated_modes(campaign), judge)
        if modes is not None and modes.stated is not None:
            return _of_modes(campaign, model, parts, segments, judge, modes, notes, tell)
        if modes is not None and _power(modes.fit, segments) < MODAL * _power(baseline, segments):
            effort = GLANCE
    if answer is not None and sure:
        if modes is None or _power(modes.fit, segments) > MODAL * _power(baseline, segments):
            return answer
        only = Outcome(baseline, baseline, (), believed=False)
        return describe(Subject(campaign, model, segments, judge, only, modes, tuple(notes)))
    tell(0.3, 'searching')
    outcome = search(
        model,
        baseline,
        segments,
        judge,
        lambda share: tell(0.3 + 0.65 * share, 'searching'),
        effort,
        equation_start if isinstance(model, OscillatorModel) else None,
    )
    if modes is not None and not _prefer(modes.fit, outcome, judge):
        modes = None
    known = len(notes)
    if campaign.kind is CampaignKind.DRIVEN and modes is None:
        outcome = of_what_is_explained(campaign, outcome, segments, notes)
    lengthy = (
        'stiffness' in linear.values and sum(s.measured.size for s in segments) > MOST_TO_THE_NOISE
    )
    if (
        isinstance(model, OscillatorModel)
        and modes is None
        and (coarse or outcome.believed)
        and not (lengthy and outcome.believed)
        and not (len(notes) > known and _counted(segments) > MOST_HOLLOW)
    ):
        tell(0.85, 'searching to the noise')
        seed = outcome.best if outcome.believed else None
        exact, sure = None, False
        if time_left('a search to the noise'):
            exact, sure = mass_answer(campaign, begun, tell, seed)
        if (
            exact is not None
            and sure
            and not leaves_most_as_noise(exact)
            and not _left_more(exact, seed, segments)
        ):
            return exact
    tell(0.95, 'describing')
    period = None
    if isinstance(model, OscillatorModel) and model.drifts:
        shown = cogging_of_motion(baseline, segments)
        if shown is not None and shown[1] * _power(baseline, segments) < _power(
            outcome.best, segments
        ):
            only = Outcome(baseline, baseline, outcome.rivals, believed=False)
            said = Verdict(True, True, shown[0], 1.0 - shown[0].p_value)
            return describe(
                Subject(campaign, model, segments, judge, only, None, tuple(notes), None, said)
            )
        period = _ripple(outcome, segments)
    if period is not None:
        outcome = Outcome(outcome.baseline, outcome.baseline, (), believed=False)
    subject = Subject(campaign, model, segments, judge, outcome, modes, tuple(notes))
    described = describe(subject)
    if period is not None and described.accepted == ('unknown',):
        return _rippled(described, period, segments[0].unit)
    if doubted and answer is not None:
        return described if _explains_less(answer, described) else answer
    if answer is None or _leaves_more(answer, described):
        return described
    better = _leaves_far_less(answer, described) or (
        'unknown' in answer.accepted
        and 'unknown' in described.accepted
        and isinstance(model, ChainModel)
        and not _leaves_far_less(described, answer)
    )
    return answer if better or set(described.accepted) <= {'unknown'} else described


def _left_more(answer: Answer, made: Fit | None, segments: Sequence[Segment]) -> bool:
    """Whether an answer leaves clearly more than a fit that is no richer, fitted and held out.

    What it takes for slow noise is then an error of its model.
    """
    if made is None or len(answer.accepted) < len(made.terms):
        return False
    if not any(s.held_out for s in segments):
        return False
    more = []
    for held_out, figures in (
        (False, answer.fit.extended.rmse),
        (True, answer.fit.extended.held_out_rmse),
    ):
        for channel, rmse in figures.items():
            pairs = zip(made.residuals, segments, strict=True)
            mine = [r for r, s in pairs if s.channel == channel and s.held_out == held_out]
            if mine:
                more.append(
                    rmse > CLEARLY_MORE * float(np.sqrt(np.mean(np.concatenate(mine) ** 2)))
                )
    return bool(more) and all(more)


def _leaves_far_less(one: Answer, other: Answer) -> bool:
    """Whether what one answer found leaves less than half the power of the other's, throughout."""
    left = _left_by(one, other)
    return bool(left) and all(2.0 * mine**2 < others**2 for mine, others in left)


def _may_err(answer: Answer | None) -> bool:
    """Whether what an answer leaves to noise may be an error of its model.

    It has something unknown beside its findings, or noise that is slow.
    """
    if answer is None or not set(answer.accepted) - {'unknown'}:
        return False
    return 'unknown' in answer.accepted or SLOW_NOISE in answer.notes


def _explains_less(one: Answer, other: Answer) -> bool:
    """Whether one answer leaves more than another that names no more, and somewhere clearly."""
    if not set(other.accepted) - {'unknown'} or len(other.accepted) > len(one.accepted):
        return False
    clearly = any(mine > CLEARLY_MORE * others for mine, others in _left_by(one, other))
    return clearly and _leaves_more(one, other)


def _leaves_more(one: Answer, other: Answer) -> bool:
    """Whether one answer leaves more than the other, throughout, for all that it names.

    What it takes for noise of some colour is then an error of its model.
    """
    left = _left_by(one, other)
    return bool(left) and all(mine > others for mine, others in left)


def _left_by(one: Answer, other: Answer) -> list[tuple[float, float]]:
    """RMSE of both answers, fitted and held out, by channel; empty where the first names nothing.

    And where they are not of the same recordings.
    """

    def left(answer: Answer) -> list[float]:
        fitted, held_out = answer.fit.extended.rmse, answer.fit.extended.held_out_rmse
        return [rmse for part in (fitted, held_out) for _, rmse in sorted(part.items())]

    mine, others = left(one), left(other)
    if not set(one.accepted) - {'unknown'} or len(mine) != len(others):
        return []
    return list(zip(mine, others, strict=True))


def _counted(segments: Sequence[Segment]) -> int:
    return sum(s.measured.size for s in segments if not s.held_out)


def _ripple(outcome: Outcome, segments: Sequence[Segment]) -> float | None:
    """Period of a force that repeats with the position of an axis, in the way of a search.

    None where the search has followed the motion without it: beside what it has found such a
    force is small, and what is slow goes like one of few periods anyway.
    """
    if _power(outcome.best, segments) < FOLLOWED * _power(outcome.baseline, segments):
        return None
    return position_cogging(segments)


def _rippled(answer: Answer, period: float, unit: str) -> Answer:
    """An answer that says that what is left repeats with the position."""
    text = (
        'Something is missing that is not in the library; it goes like a force that repeats '
        f'every {period:.4g} {unit} of the position.'
    )
    first = dataclasses.replace(answer.ranking[0], sentence=text)
    return dataclasses.replace(
        answer, ranking=(first, *answer.ranking[1:]), unexplained_description=text
    )


def _coarse(linear: Fit, segments: Sequence[Segment]) -> bool:
    """Whether a baseline leaves much of the signal that is not the sensor's white noise.

    Noise cannot be read from that: whatever is missing would be taken for its colour.
    """
    return any(
        np.mean(r**2) > COARSE * np.mean(s.measured**2) and noise_share(r, s.noise) < 0.5
        for r, s in zip(linear.residuals, segments, strict=True)
        if not s.held_out
    )


def _of_modes(
    campaign: Campaign,
    model: Model,
    parts: Sequence[Cut],
    segments: list[Segment],
    judge: Judge,
    modes: Modes,
    notes: Sequence[str],
    tell: Progress,
) -> Answer:
    """The answer for a structure that is said to have several modes: what more it has."""
    stated = modes.stated
    assert stated is not None  # noqa: S101 - called only then
    bent = _coarse(stated, segments)
    exact = held_between_samples(campaign)
    linear = linear_structure(parts, segments, modes, exact=exact, bent=bent)
    if linear is not None:
        segments, judge = list(linear.segments), linear.judge
        if not judge.better(stated, modes.fit):
            modes = dataclasses.replace(modes, fit=stated)  # the input's noise had looked like one
    further = modes.fit is not stated
    chain = chain_of_modes(parts, segments, modes, judge)
    others = [f for f in (chain[0] if chain else None, modes.fit if further else None) if f]
    if linear is not None:
        tell(0.4, 'searching for what is not linear at one place')
        begun = [linear]
        if bent:
            begun.append(quiet_structure(parts, segments, linear.model.modes))
        begun = [_knowing(campaign, structure) for structure in begun]
        local = _local(begun, [stated, *others], tell)
        if local is not None:
            structure, found = local
            return describe(
                Subject(
                    campaign,
                    structure.model,
                    structure.segments,
                    structure.judge,
                    found,
                    None,
                    tuple(notes),
                )
            )
        notes = [*notes, 'Laws that are not linear were looked for at and between the outputs.']
    else:
        notes = [*notes, 'Nothing that is not linear was looked for: ' + NO_SHAPES]
    if chain is not None:
        outcome = Outcome(stated, *chain, believed=True)
        return describe(Subject(campaign, model, segments, judge, outcome, None, tuple(notes)))
    outcome = Outcome(stated, stated, (), believed=False)
    more = modes if further else None
    return describe(Subject(campaign, model, segments, judge, outcome, more, tuple(notes)))


def _local(
    begun: Sequence[Structure], others: Sequence[Fit], tell: Progress
) -> tuple[Structure, Outcome] | None:
    """What is not linear at places of a structure; None where other fits explain as much.

    ``begun``: the structure as it is searched from. ``others``: first the stated modes.
    """
    stated = others[0]
    found = []
    for i, structure in enumerate(begun):
        judge = structure.judge

        def heard(share: float, done: int = i) -> None:
            tell(0.4 + 0.55 * (done + share) / len(begun), 'searching for what is not linear')

        effort = dataclasses.replace(LOCAL_EFFORT, least=PROMISED * judge.by_chance(1))
        model = _with_likely_places(structure)
        outcome = search(model, structure.begun, structure.segments, judge, heard, effort)
        if outcome.believed and judge.better(structure.linear, outcome.best):
            outcome = dataclasses.replace(outcome, baseline=structure.linear)
            found.append((structure, outcome))
        elif structure.linear.terms:
            alone = Outcome(structure.linear, structure.linear, outcome.rivals, believed=False)
            found.append((structure, alone))
    if not found:
        return None
    judge = found[0][0].judge
    fits = [dataclasses.replace(o.best, added=o.best.added + stated.added) for _, o in found]
    for made in (*fits, *others):
        judge.weights(made)
    criteria = [judge.criterion(made, stated) for made in fits]
    best = int(np.argmin(criteria))
    if any(judge.criterion(made, stated) <= criteria[best] for made in others):
        return None
    return found[best]


def _knowing(campaign: Campaign, structure: Structure) -> Structure:
    """The structure with what the campaign says that its simulation has at one place."""
    known = tuple(item for item in campaign.baseline if item.name in LAWS)
    if not known:
        return structure
    stated = dataclasses.replace(campaign, baseline=known)
    linear, begun = (
        with_known(stated, structure.model, structure.segments, made)
        for made in (structure.linear, structure.begun)
    )
    return dataclasses.replace(structure, linear=linear, begun=begun)


def _with_likely_places(structure: Structure) -> StructureModel:
    """The structure's model with each law where no output is in its likeliest place alone.

    Places to set out from lead to one and the same.
    """
    model = structure.model
    found: dict[Any, Term] = {}
    for prospect in prospects(model, structure.begun, model.terms, structure.segments):
        term = prospect.term
        found.setdefault((term.name, model.places[term.variant], term.fixed is None), term)
    return dataclasses.replace(model, terms=tuple(found.values()), _last={})


def _modal(campaign: Campaign, parts: Sequence[Cut]) -> bool:
    """Whether more modes are an explanation at all: a measured input drives a structure."""
    return campaign.kind is CampaignKind.DRIVEN and all(p.drive is not None for p in parts)


def _power(made: Fit, segments: Sequence[Segment]) -> float:
    """Power of the residuals over that of the channels, the mean of all recordings."""
    pairs = zip(made.residuals, segments, strict=True)
    return float(np.mean([np.mean(r**2) / (np.mean(s.measured**2) or 1.0) for r, s in pairs]))


def _prefer(modes: Fit, outcome: Outcome, judge: Judge) -> bool:
    """Whether a linear system of more modes explains better than what the search found."""
    if not judge.better(outcome.baseline, modes):
        return False
    judge.weights(modes)
    judge.weights(outcome.best)
    base = outcome.baseline
    return judge.criterion(modes, base) < judge.criterion(outcome.best, base)
