"""What a driven, free or prescribed motion, or a measuring chain, shows beyond its baseline."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from impactscope.discrepancy.answer import Answer
from impactscope.discrepancy.campaign import Campaign, CampaignKind
from impactscope.discrepancy.driven.case import Case
from impactscope.discrepancy.driven.chain import ChainModel, chain_case, linear_chain
from impactscope.discrepancy.driven.decide import Judge, noise_share
from impactscope.discrepancy.driven.describe import describe
from impactscope.discrepancy.driven.exact import exact_search
from impactscope.discrepancy.driven.fitting import FINE, Fit, fit
from impactscope.discrepancy.driven.guess import equation_start, position_ripple
from impactscope.discrepancy.driven.modal import Modes, further_modes
from impactscope.discrepancy.driven.model import Model, OscillatorModel, Segment
from impactscope.discrepancy.driven.moved import MovedModel, moved_case
from impactscope.discrepancy.driven.noise_judge import reduced, slight
from impactscope.discrepancy.driven.oscillation import linear_oscillator, reversed_channels
from impactscope.discrepancy.driven.plate import plate_under_hammer
from impactscope.discrepancy.driven.prescribed import linear_prescribed
from impactscope.discrepancy.driven.recordings import Cut, cuts
from impactscope.discrepancy.driven.search import Effort, Outcome, search
from impactscope.discrepancy.driven.shaken import shaken_case, taken_over
from impactscope.discrepancy.driven.slow_noise import knowing_slow_noise, may_be_slow_noise
from impactscope.discrepancy.driven.spectral import counting_share
from impactscope.discrepancy.driven.strangers import Stranger, Verdict, verdict
from impactscope.discrepancy.driven.subject import Subject
from impactscope.discrepancy.driven.terms import Term
from impactscope.errors import ConfigurationError

__all__ = ['explain_driven']

Progress = Callable[[float, str], None]

FREE = ('', 'none', 'null')
LINEAR = (
    'linear_sensor',
    'linear_mass_damper',
    'linear_spring_damper',
    'linear_mass_spring_damper',
)
GLANCE = Effort(depth=1, tried=3, beam=1)
MOST_OF_PLATE = 150_000  # samples of all fitted recordings of a plate under a hammer
MOSTLY_NOISE = 30.0  # reduced chi-square of a baseline beyond which it is not looked at as noise
AT_ALL_NOISE = 300.0  # the same under other forces, where a hum or a filter may be large
# reduced chi-square below which what was taken for noise is not: signals that the motion was
# thought to spare were counted in
OVERSTATED = 0.5
COARSE = 0.01  # of the output's power: more is searched for what is plain before the noise is read
NOISE = 4.0  # reduced chi-square of an answer up to which nothing else is tried
HOPELESS = 8.0  # reduced chi-square that no better knowledge of the noise brings down to it
MODAL = 0.3  # share of the baseline's residual below which more modes explain most of it
# of a channel: a model that leaves half of the recordings that it was fitted to, and more than the
# first of some or more than the last of what the baseline leaves of all, explains nothing
NEXT_TO_NOTHING, HALF_OF_IT, LITTLE = 0.9, 0.5, 0.8
MOST_HOLLOW = 10_000  # fitted samples that are searched to the noise although nothing is explained
REPEATS = 2  # searches with noise that is known better
MOST_TO_THE_NOISE = 45_000  # samples of a sprung mass; more take minutes and have told already
SLOW_NOISE = (
    'The level of the output wanders from recording to recording as noise does that goes with one '
    'over the frequency; it counts as noise.'
)
LARGER = 0.25  # of reduced chi-square, by which what is left is more than noise
SURE = 6.0  # standard deviations of it
LEVEL = 0.02  # relative change of the noise's level that matters
CHAIN_EFFORT = Effort(numbers=6, depth=4, tried=8, beam=3)


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
    campaign = _turned(campaign)
    notes = list(campaign.notes)
    parts, model, segments, linear = _start(campaign, notes)
    answer: Answer | None = None
    sure = False
    coarse = campaign.kind is CampaignKind.DRIVEN and _coarse(linear, segments)
    if campaign.kind is CampaignKind.DRIVEN and isinstance(model, OscillatorModel):
        answer, sure = _under_hammer(campaign, parts, model, segments, linear, tell)
        if answer is None and not coarse:
            answer, sure = _shaken(campaign, parts, model, segments, linear, tell)
    elif campaign.kind is CampaignKind.PRESCRIBED_MOTION:
        answer, sure = _moved(campaign, parts, notes, tell)
    elif isinstance(model, ChainModel):
        answer, sure = _through_chain(campaign, model, segments, linear, notes, tell)
    if _hollow(answer):
        answer, sure = None, False
    unknown = answer is not None and answer.accepted == ('unknown',)
    if answer is not None and sure and not (unknown and _modal(campaign, parts)):
        return answer
    baseline = _with_known(campaign, model, segments, linear)
    judge = Judge(segments, len({t.name for t in model.terms}))
    modes, effort = None, Effort()
    if campaign.kind is CampaignKind.CHAIN:
        effort = CHAIN_EFFORT
    elif 'stiffness' in linear.values and 'mass' in linear.values and _modal(campaign, parts):
        tell(0.1, 'trying further modes')
        modes = further_modes(parts, segments, baseline, _modes(campaign), judge)
        if modes is not None and modes.stated is not None:
            return _of_modes(campaign, model, segments, judge, modes, notes)
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
    told = len(notes)
    if campaign.kind is CampaignKind.DRIVEN and modes is None:
        outcome = _of_what_is_explained(campaign, outcome, segments, notes)
    lengthy = (
        'stiffness' in linear.values and sum(s.measured.size for s in segments) > MOST_TO_THE_NOISE
    )
    if (
        isinstance(model, OscillatorModel)
        and modes is None
        and (coarse or outcome.believed)
        and not (lengthy and outcome.believed)
        and not (len(notes) > told and _counted(segments) > MOST_HOLLOW)
    ):
        tell(0.85, 'searching to the noise')
        seed = outcome.best if outcome.believed else None
        exact, sure = _shaken(campaign, parts, model, segments, linear, tell, seed)
        if exact is not None and sure and not _hollow(exact):
            return exact
    tell(0.95, 'describing')
    period = None
    if isinstance(model, OscillatorModel) and model.drifts:
        period = position_ripple(segments)
    if period is not None:
        outcome = Outcome(outcome.baseline, outcome.baseline, (), believed=False)
    subject = Subject(campaign, model, segments, judge, outcome, modes, tuple(notes))
    described = describe(subject)
    if period is not None and described.accepted == ('unknown',):
        return _rippled(described, period, segments[0].unit)
    if answer is not None and set(described.accepted) <= {'unknown'}:
        return answer
    return described


def _counted(segments: Sequence[Segment]) -> int:
    return sum(s.measured.size for s in segments if not s.held_out)


def _hollow(answer: Answer | None) -> bool:
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
    told = [t for t in answer.traces if not t.held_out]
    left = sum(float(np.sum((t.measured - t.extended) ** 2)) for t in told)
    power = sum(float(np.sum((t.measured - np.mean(t.measured)) ** 2)) for t in told)
    return left > (HALF_OF_IT if answer.accepted else NEXT_TO_NOTHING) ** 2 * power


def _of_what_is_explained(
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
    drive = str(campaign.bench.get('input', ''))
    cause = 'no free oscillation' if drive.lower() in FREE else f'not the answer to {drive} alone'
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


def _exact(
    campaign: Campaign,
    case: Case,
    notes: Sequence[str],
    tell: Progress,
    share: float = 1.0,
    seed: Fit | None = None,
    *,
    slow: bool = False,
) -> tuple[Answer, Outcome, bool]:
    """The answer where noise is all that a right model leaves, and whether it is.

    ``slow``: slow noise is known already.
    """
    baseline = _with_known(campaign, case.model, case.segments, case.baseline)
    tell(0.1 * share, 'searching')
    outcome = exact_search(
        case.model,
        baseline,
        case.segments,
        case.judge,
        lambda done: tell((0.1 + 0.75 * done) * share, 'searching'),
        seed,
    )
    tell(0.9 * share, 'looking for what the library lacks')
    gain = case.judge.worth(baseline, outcome.best).fitted
    said = verdict(
        case.laws, case.model, baseline, outcome.best, gain, case.segments, case.settled
    )
    if not slow and may_be_slow_noise(outcome.best, said):
        knowing = knowing_slow_noise(case, outcome.best)
        if knowing is not None:
            known = (*notes, SLOW_NOISE)
            return _exact(campaign, knowing, known, tell, share, slow=True)
    if case.model.__class__ is MovedModel or case.model.drifts:
        said = _and_its_size(case, outcome.best, said)
    tell(0.95 * share, 'describing')
    subject = Subject(
        campaign, case.model, case.segments, case.judge, outcome, None, tuple(notes), case, said
    )
    return describe(subject), outcome, reduced(case.judge, outcome.best) < NOISE


def _and_its_size(case: Case, best: Fit, said: Verdict) -> Verdict:
    """What a verdict becomes where more than noise is left in any recording, as it is."""
    if said.left:
        return said
    before = case.judge.chi_squares(case.baseline)
    for s, was, chi_square in zip(
        case.segments, before, case.judge.chi_squares(best), strict=True
    ):
        count = s.measured.size
        error = slight(best) * was / count
        if chi_square / count > 1.0 + LARGER + SURE * math.sqrt(2.0 / count) + error:
            law = f'nothing that was tried; {s.recording} is left {chi_square / count:.3g} times'
            rest = Stranger(f'{law} its noise in power', chi_square - count, 1)
            return Verdict(True, not best.terms, rest, 1.0)
    return said


def _coarse(linear: Fit, segments: Sequence[Segment]) -> bool:
    """Whether a baseline leaves much of the signal that is not the sensor's white noise.

    Noise cannot be read from that: whatever is missing would be taken for its colour.
    """
    return any(
        np.mean(r**2) > COARSE * np.mean(s.measured**2) and noise_share(r, s.noise) < 0.5
        for r, s in zip(linear.residuals, segments, strict=True)
        if not s.held_out
    )


def _under_hammer(
    campaign: Campaign,
    parts: Sequence[Cut],
    model: OscillatorModel,
    segments: Sequence[Segment],
    linear: Fit,
    tell: Progress,
) -> tuple[Answer | None, bool]:
    """The answer for a plate under a hammer; None if it is none or leaves far more than noise."""
    if 'stiffness' not in linear.values or _modes(campaign) > 1:
        return None, False
    notes = list(campaign.notes)
    whole = cuts(campaign, [parts[0].channel], parts[0].drive_channel, notes, MOST_OF_PLATE)
    if len(whole) != len(parts):
        return None, False
    case = plate_under_hammer(whole, model, segments, linear)
    if case is None or not OVERSTATED < reduced(case.judge, case.baseline) < MOSTLY_NOISE:
        return None, False
    answer, _, sure = _exact(campaign, case, notes, tell)
    return answer, sure


def _shaken(
    campaign: Campaign,
    parts: Sequence[Cut],
    model: OscillatorModel,
    segments: Sequence[Segment],
    linear: Fit,
    tell: Progress,
    seed: Fit | None = None,
) -> tuple[Answer | None, bool]:
    """The answer for a mass under any force, or free; None if far more than noise is left.

    ``seed``: what another search has found, to go on from.
    """
    if _modes(campaign) > 1:
        return None, False
    notes = list(campaign.notes)
    channels = list(dict.fromkeys(p.channel for p in parts))
    whole = cuts(campaign, channels, parts[0].drive_channel, notes, MOST_OF_PLATE)
    if len(whole) != len(parts):
        return None, False
    held = _held(campaign)
    case = shaken_case(whole, model, segments, linear, held=held)
    if case is not None and seed is not None:
        case, seed = taken_over(case, seed)
        case = case and shaken_case(whole, model, segments, linear, held=held, found=(case, seed))
        if case is not None:  # which now knows the noise, and how recordings begin
            case, seed = taken_over(case, seed)
    start = None if case is None else (seed or case.baseline)
    if case is None or start is None:
        return None, False
    least = OVERSTATED * counting_share([s.whitener for s in case.segments])
    if not least < reduced(case.judge, start) < AT_ALL_NOISE:
        return None, False

    def anew(before: Case, found: Fit) -> Case | None:
        return shaken_case(whole, model, segments, linear, held=held, found=(before, found))

    answer, sure = _repeated(campaign, case, anew, notes, tell, seed)
    # on real machines what stands beside the findings is an error of the model; an axis that is
    # explained to its noise is none of these
    beside = 'unknown' in answer.accepted and len(answer.accepted) > 1
    return answer, sure and (case.model.drifts or not beside)


def _held(campaign: Campaign) -> bool:
    """Whether the input is commanded: it stays constant between samples."""
    bench = campaign.bench
    return 'reference' in bench or 'controller' in bench or bench.get('hold') is True


def _moved(
    campaign: Campaign, parts: Sequence[Cut], notes: Sequence[str], tell: Progress
) -> tuple[Answer | None, bool]:
    """The answer for a prescribed motion that noise hides alone; None if it is none."""
    if not _sprung(campaign):
        return None, False
    own: list[str] = []
    whole = cuts(campaign, [parts[0].channel], parts[0].drive_channel, own, MOST_OF_PLATE)
    mass = 'linear_mass_spring_damper' in campaign.baseline_names or not campaign.baseline
    case = moved_case(whole, mass)
    if case is None:
        return None, False

    def anew(before: Case, found: Fit) -> Case | None:
        return moved_case(whole, mass, before, found)

    answer, sure = _repeated(campaign, case, anew, notes, tell)
    return answer, sure and not _errs(answer)


def _errs(answer: Answer) -> bool:
    """Whether an answer with findings and something unknown beside them leaves more than noise.

    What is left is then an error of the model: under it noise's measure finds filters, limits and
    stops that are not there.
    """
    if 'unknown' not in answer.accepted or len(answer.accepted) < 2:
        return False
    made = answer.fit.extended
    left = [made.reduced_chi_square, made.held_out_reduced_chi_square]
    least = min(t.measured.size for t in answer.traces)
    most = 1.0 + LARGER + SURE * math.sqrt(2.0 / least)
    return any(math.isfinite(x) and x > most for x in left)


def _through_chain(
    campaign: Campaign,
    model: ChainModel,
    segments: Sequence[Segment],
    linear: Fit,
    notes: Sequence[str],
    tell: Progress,
) -> tuple[Answer | None, bool]:
    """The answer for a chain between two channels with noise; what is found tells the noise."""
    case = chain_case(model, segments, linear)
    if case is None:
        return None, False

    def anew(_: Case, found: Fit) -> Case | None:
        return chain_case(model, segments, linear, found)

    return _repeated(campaign, case, anew, notes, tell)


def _repeated(
    campaign: Campaign,
    case: Case,
    anew: Callable[[Case, Fit], Case | None],
    notes: Sequence[str],
    tell: Progress,
    seed: Fit | None = None,
) -> tuple[Answer, bool]:
    """The answer once the noise, judged ``anew`` by what was found, no longer changes."""
    answer, outcome, sure = _exact(campaign, case, notes, tell, 0.5, seed)
    erred = False
    for _ in range(REPEATS):
        if reduced(case.judge, outcome.best) > HOPELESS:
            break
        if erred and _errs(answer):
            break  # knowing the noise better does not help
        erred = _errs(answer)
        again = anew(case, outcome.best)
        if again is None or _alike(case, again):
            break
        case = again
        answer, outcome, sure = _exact(campaign, case, notes, tell, seed=outcome.best)
    return answer, sure


def _alike(one: Case, other: Case) -> bool:
    """Whether two cases take the noise for the same."""
    return all(
        abs(math.log(float(np.linalg.norm(a.whitener(p)) / np.linalg.norm(b.whitener(p))))) < LEVEL
        for a, b in zip(one.segments, other.segments, strict=True)
        if a.whitener is not None and b.whitener is not None
        for white in [np.random.default_rng(0).standard_normal(a.measured.size)]
        for p in (white, np.cumsum(white))  # noise of all frequencies, and slow noise
    )


def _of_modes(
    campaign: Campaign,
    model: Model,
    segments: list[Segment],
    judge: Judge,
    modes: Modes,
    notes: Sequence[str],
) -> Answer:
    """The answer for a structure that is said to have several modes: whether it has more."""
    stated = modes.stated
    assert stated is not None  # noqa: S101 - called only then
    notes = [*notes, 'On a structure of several modes only further modes are looked for.']
    outcome = Outcome(stated, stated, (), believed=False)
    more = modes if modes.fit is not stated else None
    return describe(Subject(campaign, model, segments, judge, outcome, more, tuple(notes)))


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


def _modes(campaign: Campaign) -> int:
    value: Any = campaign.model.get('modes', 1)
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ConfigurationError(
            f'{campaign.name}: model.modes is {value!r}; it must be a whole number from 1'
        )
    return value


def _turned(campaign: Campaign) -> Campaign:
    """The campaign with the sign of outputs turned that answer their input the wrong way."""
    drive = str(campaign.bench.get('input', ''))
    if campaign.kind is not CampaignKind.DRIVEN or drive.lower() in FREE:
        return campaign
    outputs = [str(name) for name in campaign.bench['outputs']]
    parts = cuts(campaign, outputs, drive, [])
    turned = reversed_channels(parts, spring=_sprung(campaign))
    if not turned:
        return campaign
    recordings = tuple(
        dataclasses.replace(
            r,
            channels={
                n: dataclasses.replace(c, values=-c.values) if n in turned else c
                for n, c in r.channels.items()
            },
        )
        for r in campaign.recordings
    )
    note = f'{", ".join(turned)}: the sign is opposite to that of {drive}; it is turned here.'
    return dataclasses.replace(campaign, recordings=recordings, notes=(*campaign.notes, note))


def _start(campaign: Campaign, notes: list[str]) -> tuple[list[Cut], Model, list[Segment], Fit]:
    """Usable parts of the recordings, the model, and the fitted linear baseline."""
    bench = campaign.bench
    if campaign.kind is CampaignKind.PRESCRIBED_MOTION:
        parts = cuts(campaign, [str(bench['output'])], str(bench['motion']), notes)
        return parts, *linear_prescribed(parts, spring=_sprung(campaign))
    if campaign.kind is CampaignKind.CHAIN:
        names = [str(bench['output'])], str(bench['input'])
        parts = cuts(campaign, *names, notes, MOST_OF_PLATE)
        return parts, *linear_chain(parts)
    drive = str(bench.get('input', ''))
    drive = '' if drive.lower() in FREE else drive
    parts = cuts(campaign, [str(name) for name in bench['outputs']], drive, notes)
    spring = _sprung(campaign)
    if not drive and not spring:
        raise ConfigurationError(
            f'{campaign.name}: a free motion without restoring force shows nothing'
        )
    return parts, *linear_oscillator(parts, spring=spring, held=_held(campaign))


def _sprung(campaign: Campaign) -> bool:
    """Whether the baseline has a restoring force."""
    restoring = campaign.model.get('restoring', 'linear')
    return (
        restoring not in (None, 'none', False)
        and 'linear_mass_damper' not in campaign.baseline_names
    )


def _with_known(campaign: Campaign, model: Model, segments: Sequence[Segment], linear: Fit) -> Fit:
    """The baseline with the mechanisms that the campaign says the simulation has."""
    baseline = linear
    for item in campaign.baseline:
        if item.name in LINEAR:
            continue
        forms = [t for t in model.terms if t.name == item.name]
        if not forms:
            known = ', '.join(sorted({t.name for t in model.terms}.union(LINEAR)))
            raise ConfigurationError(
                f'{campaign.name}: baseline {item.name!r} is not known for a campaign of kind '
                f'{campaign.kind.value}; known are {known}'
            )
        tries = [_extended(model, segments, baseline, term, item.values) for term in forms]
        baseline = min(tries, key=lambda f: _misfit(f, segments))
    return baseline


def _extended(
    model: Model,
    segments: Sequence[Segment],
    baseline: Fit,
    term: Term,
    stated: Mapping[str, float],
) -> Fit:
    initial = {**baseline.values, **(term.restart or {})}
    initial.update({f'{term.label}.{k}': v for k, v in stated.items()})
    return fit(model, (*baseline.terms, term), segments, initial, baseline.starts, tolerance=FINE)


def _misfit(made: Fit, segments: Sequence[Segment]) -> float:
    pairs = zip(made.residuals, segments, strict=True)
    return sum(float(np.sum(r**2)) for r, s in pairs if not s.held_out)
