"""Answers where a right model leaves noise alone: plates, masses, prescribed motions, chains.

What is found tells the noise, and the noise what is found: the search is repeated until neither
changes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from impactscope.discrepancy.answer import Answer
from impactscope.discrepancy.campaign import Campaign
from impactscope.discrepancy.driven.adequacy.unmodelled_laws import Verdict, verdict
from impactscope.discrepancy.driven.data.recordings import Cut, cuts
from impactscope.discrepancy.driven.data.trajectory import KNOTS
from impactscope.discrepancy.driven.findings.describe import describe
from impactscope.discrepancy.driven.findings.effect_and_law import (
    NOISE,
    effect_and_law,
    leaves_noise,
    plain_gain,
)
from impactscope.discrepancy.driven.findings.residual_size import (
    LARGER,
    SURE,
    comes_with_the_signal,
    more_than_noise,
)
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.fits.innovations import innovations, joined
from impactscope.discrepancy.driven.fits.simulation_error import Fit, fit
from impactscope.discrepancy.driven.model_selection.chi_square import (
    OWN,
    PRICE,
    fitted_chi_square,
    fitted_samples,
    priced,
    reduced,
)
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel
from impactscope.discrepancy.driven.models.terms import Term
from impactscope.discrepancy.driven.noise.spectral_whitening import counting_share
from impactscope.discrepancy.driven.search.beam_search import Outcome
from impactscope.discrepancy.driven.search.joint_fits import labels_of
from impactscope.discrepancy.driven.search.noise_limited_search import (
    from_those_left_behind,
    noise_limited_search,
)
from impactscope.discrepancy.driven.search.other_minima import knowing_other_minima
from impactscope.discrepancy.driven.search.screening import prospects, screened
from impactscope.discrepancy.driven.systems.case import Case
from impactscope.discrepancy.driven.systems.chain import ChainModel, chain_case
from impactscope.discrepancy.driven.systems.driven_mass import driven_mass_case, taken_over
from impactscope.discrepancy.driven.systems.force_noise import knowing_noise_of_the_force
from impactscope.discrepancy.driven.systems.linear_baseline import (
    MOST_OF_PLATE,
    Start,
    held_between_samples,
    sprung,
    stated_modes,
    with_known,
)
from impactscope.discrepancy.driven.systems.plate import plate_under_hammer
from impactscope.discrepancy.driven.systems.prescribed_motion_ends import shows_at_ends
from impactscope.discrepancy.driven.systems.prescribed_noise_limited import PARTS, prescribed_case
from impactscope.discrepancy.driven.systems.slow_noise import (
    knowing_slow_noise,
    may_be_slow_noise,
    plain_noise,
    white_logarithm,
    whitened_logarithm,
    without_slow_effects,
)
from impactscope.discrepancy.time_limit import time_left

__all__ = [
    'SLOW_NOISE',
    'Progress',
    'chain_answer',
    'mass_answer',
    'motion_answer',
    'plate_answer',
]

Progress = Callable[[float, str], None]

MOSTLY_NOISE = 30.0  # reduced chi-square of a baseline beyond which it is not looked at as noise
AT_ALL_NOISE = 300.0  # the same under other forces, where a hum or a filter may be large
# reduced chi-square below which what was taken for noise is not: signals that the motion was
# thought to spare were counted in
OVERSTATED = 0.5
LEVELS = ('offset', 'zero_drift')  # effects that only shift a channel
HOPELESS = 8.0  # reduced chi-square that no better knowledge of the noise brings down to it
REPEATS = 2  # searches with noise that is known better
SLOW_NOISE = (
    'The noise of the output is not white: it falls with the frequency, and samples count by what '
    'they tell beyond those before.'
)
NOISE_OF_THE_FORCE = (
    'The recorded force has noise of its own, which the motion adds up: samples count by what '
    'they tell beyond those before.'
)
FAINTLY = 6.0  # twice the logarithm of the likelihood by which noise may be slow
COLOURS = 2  # searches with noise of a colour
MOSTLY_SLOW = 2.0  # times its changes from sample to sample: what is left is mostly slow
PROSPECTS, STEPS = 4, 2  # effects that are fitted, each beside the best one before
MOST_LOOKED_AT = 45_000  # samples of a plate far from its noise that are looked at so
LEVEL = 0.02  # relative change of the noise's level that matters
SAME = 1e-3  # the same, below which a search would find the same
CLOSER = (2.0, 4.0, 8.0)  # times as many knots, in which a finding has to show as well
STAYS = 0.5  # of its gain
CLOSER_COURSE = (
    'The motion has more in it than its own noise lets through: its course is followed more '
    'closely.'
)
NONE_LEFT = 0.1  # of the noise, that a law leaves at least


def plate_answer(campaign: Campaign, begun: Start, tell: Progress) -> tuple[Answer | None, bool]:
    """The answer for a plate under a hammer; None if it is none or leaves far more than noise."""
    parts, model, linear = begun.parts, begun.model, begun.linear
    several = stated_modes(campaign) > 1
    if several or not isinstance(model, OscillatorModel) or 'stiffness' not in linear.values:
        return None, False
    notes = list(campaign.notes)
    whole = cuts(campaign, [parts[0].channel], parts[0].drive_channel, notes, MOST_OF_PLATE)
    if len(whole) != len(parts):
        return None, False
    case = plate_under_hammer(whole, model, begun.segments, linear)
    if case is None:
        return None, False
    seed = None
    if reduced(case.judge, case.baseline) >= MOSTLY_NOISE:
        seed = _towards_noise(case)  # what is strong hides that all else is noise
    start = seed or case.baseline
    near = OVERSTATED * _counting(case) < reduced(case.judge, start) < MOSTLY_NOISE
    if not near and plain_noise(case) is None:
        return None, False
    found = _exact(campaign, case, notes, tell, seed=seed if near else None)
    return found.answer, found.sure


def _towards_noise(case: Case, begin: Fit | None = None) -> Fit:
    """A fit with what leaves least: a level of the channel, or few plain effects.

    Greedy; it only tells where a search to the noise may begin.

    Args:
        case: whose noise is known.
        begin: from what it sets out; the baseline unless told.
    """
    made = begin or case.baseline
    terms = [t for t in case.model.terms if t.name in LEVELS and t.output and not t.own]
    terms = [t for t in terms if all(t.stands_with(o) for o in made.terms)]
    both = [tuple(terms)] if len(terms) == len(LEVELS) else []
    best = min(
        (
            fit(case.model, (*made.terms, *t), case.segments, made.values, made.starts)
            for t in [(), *((t,) for t in terms), *both]
        ),
        key=lambda f: reduced(case.judge, f),
    )
    if sum(s.measured.size for s in case.segments) > MOST_LOOKED_AT:
        return best
    for _ in range(STEPS):
        if reduced(case.judge, best) < MOSTLY_NOISE:
            break
        others = [t for t in case.model.terms if all(t.stands_with(o) for o in made.terms)]
        seen = screened(case.model, made, others, case.segments)
        tries = [
            fit(
                case.model,
                (*made.terms, p.term),
                case.segments,
                {**made.values, **p.initial},
                made.starts,
            )
            for p in prospects(case.model, made, seen, case.segments)[:PROSPECTS]
        ]
        made = min(tries, key=lambda f: reduced(case.judge, f), default=made)
        best = min(best, made, key=lambda f: reduced(case.judge, f))
    return best


def mass_answer(
    campaign: Campaign, begun: Start, tell: Progress, seed: Fit | None = None
) -> tuple[Answer | None, bool]:
    """The answer for a mass under any force, or free; None if far more than noise is left.

    ``seed``: what another search has found, to go on from.
    """
    parts, model, segments, linear = begun.parts, begun.model, begun.segments, begun.linear
    if stated_modes(campaign) > 1 or not isinstance(model, OscillatorModel):
        return None, False
    if not {'mass', 'stiffness'} & set(linear.values):
        return None, False  # what runs down freely, a machine with a machine's errors
    notes = list(campaign.notes)
    channels = list(dict.fromkeys(p.channel for p in parts))
    whole = cuts(campaign, channels, parts[0].drive_channel, notes, MOST_OF_PLATE)
    if len(whole) != len(parts):
        return None, False
    held = held_between_samples(campaign)
    case = driven_mass_case(whole, model, segments, linear, held=held)
    if case is not None and seed is not None:
        case, seed = taken_over(case, seed)
        case = case and driven_mass_case(
            whole, model, segments, linear, held=held, found=(case, seed)
        )
        if case is not None:  # which now knows the noise, and how recordings begin
            case, seed = taken_over(case, seed)
    start = None if case is None else (seed or case.baseline)
    if case is None or start is None:
        return None, False
    least = OVERSTATED * _counting(case) * counting_share([s.whitener for s in case.segments])
    most = AT_ALL_NOISE
    if reduced(case.judge, start) >= most:  # what is strong may hide that all else is noise
        start, most = _towards_noise(case, start), MOSTLY_NOISE
        seed = start if start.terms else seed
    near = least < reduced(case.judge, start) < most
    if not near and (case.model.drifts or plain_noise(case) is None):
        return None, False

    def anew(before: Case, found: Fit) -> Case | None:
        return driven_mass_case(whole, model, segments, linear, held=held, found=(before, found))

    found = _repeated(campaign, case, anew, notes, tell, seed)
    answer = found.answer
    if held and (answer.unexplained or not found.sure) and time_left('noise of the force'):
        noisy = _with_noise_of_the_force(campaign, case, found, whole, notes, tell)
        if noisy is not None:
            return noisy, True
    # on real machines what stands beside the findings is an error of the model; an axis that is
    # explained to its noise is none of these
    beside = 'unknown' in answer.accepted and len(answer.accepted) > 1
    return answer, found.sure and (case.model.drifts or not beside)


def _with_noise_of_the_force(
    campaign: Campaign,
    case: Case,
    exact: _Explained,
    parts: Sequence[Cut],
    notes: Sequence[str],
    tell: Progress,
) -> Answer | None:
    """The answer where a force that was taken for exact has noise; None if that is not all.

    Or if that noise is less likely, even if it were all, than what an ``exact`` force leaves.
    """
    told, made = (*notes, NOISE_OF_THE_FORCE), exact.outcome.best
    for _ in range(REPEATS):
        noisy = knowing_noise_of_the_force(case, made, parts) if case.model.drifts else None
        if noisy is None:
            return None
        if fitted_samples(noisy.judge) + whitened_logarithm(noisy) > exact.misfit:
            return None
        found = _exact(campaign, noisy, told, tell)
        if labels_of(found.outcome.best.terms) == labels_of(made.terms):
            break
        made = found.outcome.best
    return None if found.answer.unexplained else found.answer


def motion_answer(
    campaign: Campaign, parts: Sequence[Cut], notes: Sequence[str], tell: Progress
) -> tuple[Answer | None, bool]:
    """The answer for a prescribed motion that noise hides alone; None if it is none."""
    own: list[str] = []
    whole = cuts(campaign, [parts[0].channel], parts[0].drive_channel, own, MOST_OF_PLATE)
    massless = campaign.baseline and not {
        'linear_mass_spring_damper',
        'linear_mass_damper',
    } & set(campaign.baseline_names)
    device = [
        name
        for name, there in zip(PARTS, (sprung(campaign), True, not massless), strict=True)
        if there
    ]
    case = prescribed_case(whole, device)
    if case is None:
        return None, False

    def anew(before: Case, found: Fit) -> Case | None:
        return prescribed_case(whole, device, before, found)

    found = _repeated(campaign, case, anew, notes, tell)
    for times in CLOSER:
        closer = prescribed_case(whole, device, knots=times * KNOTS)
        if closer is None or not _rounded_off(case, closer, found.outcome, anew):
            break
        if not time_left('courses that follow the motion more closely'):
            break
        case = closer
        found = _repeated(campaign, case, anew, (*notes, CLOSER_COURSE), tell)
    return found.answer, found.sure and not _errs(found.answer)


def _rounded_off(
    case: Case, closer: Case, outcome: Outcome, anew: Callable[[Case, Fit], Case | None]
) -> bool:
    """Whether a finding is what a smoothed course has lost of the motion: a closer one has it.

    The motion's noise may hide a kink that its force shows. Whatever rounds the force, too, then
    explains what is left, as long as the course is as smooth.

    Args:
        case: with the courses in which something was found.
        closer: with courses that follow the motion more closely.
        outcome: what was found.
        anew: a case once more, its noise known from a fit.
    """
    new = [t for t in outcome.best.terms if t.label not in labels_of(outcome.baseline.terms)]
    # the ends of a closer course are told less well: no filter that shows there would stay
    new = [t for t in new if not shows_at_ends(t, case.segments)]
    if not new:
        return False
    held = []
    for each in (case, closer):
        made = fit(each.model, outcome.best.terms, each.segments, outcome.best.values)
        known = anew(each, made) or each
        held.append((known, [_without_and_with(known, made, t) for t in new]))
    (here, mine), (there, theirs) = held
    return any(
        there.judge.gain(*b).fitted
        < STAYS * here.judge.gain(*a).fitted * _seen_as_well(here, there, a)
        for a, b in zip(mine, theirs, strict=True)
    )


def _without_and_with(case: Case, made: Fit, term: Term) -> tuple[Fit, Fit]:
    """Fits with all effects but one, and with all."""
    others = tuple(t for t in made.terms if t is not term)
    without, with_it = (
        fit(case.model, terms, case.segments, made.values) for terms in (others, made.terms)
    )
    return without, with_it


def _seen_as_well(here: Case, there: Case, fits: tuple[Fit, Fit]) -> float:
    """Share of a gain that an effect would have beside the noise of another case, at most 1.

    A closer course lets more of the motion's noise through, and a true effect is seen less, too.
    """
    changes = [a - b for a, b in zip(*(f.residuals for f in fits), strict=True)]
    fitted = [i for i, s in enumerate(here.segments) if not s.held_out]
    columns = [
        joined([case.segments[i] for i in fitted], [changes[i] for i in fitted])
        for case in (here, there)
    ]
    before, after = (float(c @ c) for c in columns)
    return min(1.0, after / max(before, 1e-300))


def chain_answer(
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

    found = _repeated(campaign, case, anew, notes, tell)
    return found.answer, found.sure


def _counting(case: Case) -> float:
    """Samples that count, of all, where coarse readings rest."""
    shares = [float(np.mean(s.weight**2)) for s in case.segments if s.weight is not None]
    return min(shares, default=1.0)


@dataclasses.dataclass(frozen=True, slots=True)
class _Explained:
    """An answer where noise is all that a right model leaves.

    ``sure``: whether it is all; ``misfit``: minus twice the logarithm of the likelihood, in the
    output's unit, with a price for all that was found.
    """

    answer: Answer
    outcome: Outcome
    sure: bool
    misfit: float


def _exact(
    campaign: Campaign,
    case: Case,
    notes: Sequence[str],
    tell: Progress,
    share: float = 1.0,
    seed: Fit | None = None,
) -> _Explained:
    """The answer where noise is all that a right model leaves.

    Where what is found leaves noise of a colour the search is made again with that noise; what
    is likelier of both, with all that was found in it, is the answer.
    """
    plain = None if case.model.drifts or seed is not None else plain_noise(case)
    best = found = _searched(campaign, plain or case, tell, share, seed)
    searched = {plain or case}
    slow = (plain_noise(case) if case.model.drifts else None) or case
    for _ in range(COLOURS):
        last = found[1].best
        if plain is not None and not _terms_of(found):
            if case in searched:
                break  # noise of that colour is all that there is
            tries = [case]  # in which an effect may have been taken for that noise
        elif case.model.drifts and not found[2].left and not last.terms:
            break
        elif case.model.drifts and slow not in searched:
            tries = [slow]
        elif case.model.drifts and not may_be_slow_noise(last, found[2]):
            break
        else:
            bare = without_slow_effects(case, last)
            made = list(dict.fromkeys((last, bare)))
            if isinstance(case.model, ChainModel):
                made = [m for m in made if not comes_with_the_signal(case, m)]
            tries = [knowing_slow_noise(case, m) or case for m in made]
        # noise that would be less likely even if all else were explained is not looked into
        likely = [
            k
            for k in dict.fromkeys(tries)
            if not any(_alike(k, s, SAME) for s in searched)
            and whitened_logarithm(k) < _misfit(*best)
        ]
        searched.update(likely)
        if not likely:
            break
        now = min(
            (_searched(campaign, k, tell, share, _in_its_noise(k, seed)) for k in likely),
            key=lambda f: _misfit(*f),
        )
        if likely == [case] and (now[2].left or _misfit(*now) >= _misfit(*best)):
            break  # nothing that explains what that noise does
        best = min(best, now, key=lambda f: _misfit(*f))
        if _terms_of(now) == _terms_of(found):
            break
        found = now
    if best[0] is case:
        best = _or_faintly_slow(campaign, best, tell, share)
    white, (case, outcome, said) = case, best
    known = tuple(notes) if case is white else (*notes, SLOW_NOISE)
    outcome, said = _with_other_minima(case, outcome, said)
    said = more_than_noise(case, outcome, said)
    if case is not white and outcome.best is outcome.baseline and not said.left:
        known += _taken_for_slow_noise(case, outcome.best)
    tell(0.95 * share, 'describing')
    subject = Subject(
        campaign, case.model, case.segments, case.judge, outcome, None, known, case, said
    )
    sure = reduced(case.judge, outcome.best) < NOISE
    misfit = _misfit(*best) + white_logarithm(case)
    return _Explained(describe(subject), outcome, sure, misfit)


def _or_faintly_slow(
    campaign: Campaign, found: tuple[Case, Outcome, Verdict], tell: Progress, share: float
) -> tuple[Case, Outcome, Verdict]:
    """A law alone beside white noise, or slow noise too faint to be told but for that law.

    What it would explain may be a wander of the few slowest numbers that the recordings have.
    """
    case, outcome, said = found
    if outcome.best is not outcome.baseline or not said.left:
        return found
    slow = knowing_slow_noise(case, outcome.best, FAINTLY)
    if slow is None or whitened_logarithm(slow) >= _misfit(*found):
        return found
    now = _searched(campaign, slow, tell, share)
    nothing = not now[2].left and now[1].best is now[1].baseline
    chosen = 2.0 * math.log(said.strongest.looks) if nothing else 0.0  # of many laws the best one
    return now if _misfit(*now) < _misfit(*found) + chosen else found


def _in_its_noise(case: Case, seed: Fit | None) -> Fit | None:
    """What another search has found, fitted again in a case with another noise."""
    if seed is None:
        return None
    values = {**case.baseline.values, **seed.values}
    return fit(case.model, seed.terms, case.segments, values, case.baseline.starts)


def _taken_for_slow_noise(case: Case, made: Fit) -> tuple[str, ...]:
    """What else noise may be that is far larger than its changes from sample to sample."""
    told = []
    for s, left in zip(case.segments, made.residuals, strict=True):
        size = float(np.sqrt(np.mean(left**2)))
        if size > MOSTLY_SLOW * float(np.std(np.diff(left))):
            told.append(f'{size:.3g} of {s.channel} in {s.recording}')
    if not told:
        return ()
    return (
        f'Taken for slow noise: {", ".join(told)}. An offset, a drift or a slow push would look '
        'the same; a recording at rest tells them apart.',
    )


def _searched(
    campaign: Campaign, case: Case, tell: Progress, share: float, seed: Fit | None = None
) -> tuple[Case, Outcome, Verdict]:
    """What a search with one noise finds, and what is left."""
    baseline = with_known(campaign, case.model, case.segments, case.baseline)
    tell(0.1 * share, 'searching')
    outcome = noise_limited_search(
        case.model,
        baseline,
        case.segments,
        case.judge,
        lambda done: tell((0.1 + 0.75 * done) * share, 'searching'),
        seed,
    )
    tell(0.9 * share, 'looking for what the library lacks')
    said = _held_against_laws(case, outcome)
    beside = said.left and not said.instead and outcome.best is not baseline
    if beside and time_left('effects that were far behind the best'):
        again = from_those_left_behind(case.model, outcome, case.judge)
        if labels_of(again.best.terms) != labels_of(outcome.best.terms):
            outcome, said = again, _held_against_laws(case, again)
    return case, *effect_and_law(case, outcome, said)


def _held_against_laws(case: Case, outcome: Outcome) -> Verdict:
    """The verdict over what a search has chosen, beside laws beyond the vocabulary."""
    judge, baseline, best = case.judge, outcome.baseline, outcome.best
    gain = judge.worth(baseline, best).fitted, judge.gain(baseline, best).fitted
    return verdict(case.laws, case.model, baseline, best, gain, case.segments, case.settled)


def _with_other_minima(case: Case, outcome: Outcome, said: Verdict) -> tuple[Outcome, Verdict]:
    """What was found in its lowest minimum; or a rival, if it is behind that one there.

    A minimum that is a little deeper in the fitted recordings may miss those held out by more.
    What takes the place of what was found is held against laws beyond the vocabulary itself.
    """
    best = _lowest(case, outcome.best, outcome.baseline)

    def criterion(made: Fit) -> float:
        return case.judge.criterion(made, outcome.baseline)

    chosen, now = criterion(outcome.best), criterion(best)
    # one that was ahead already had given way to another rule
    ahead = [f for f in outcome.rivals if f.added <= best.added and chosen <= criterion(f) < now]
    if ahead:
        rival = min(ahead, key=criterion)
        other = _lowest(case, rival, outcome.baseline)
        if criterion(other) < now and case.judge.better(outcome.baseline, other):
            rest = [f for f in outcome.rivals if f is not rival]
            changed = dataclasses.replace(outcome, best=other, rivals=(best, *rest))
            return changed, _held_against_laws(case, changed)
    return dataclasses.replace(outcome, best=best), said


def _lowest(case: Case, made: Fit, baseline: Fit) -> Fit:
    """A fit from the lowest minimum of what it has beyond the baseline."""
    given = labels_of(baseline.terms)
    new = [t for t in made.terms if t.label not in given]
    return knowing_other_minima(case.model, case.judge, made, new) if new else made


def _misfit(case: Case, outcome: Outcome, said: Verdict) -> float:
    """Minus twice the logarithm of the likelihood, with a price for all that was found.

    Of the fitted recordings: where one that was held out goes farther than these, the error of
    what they tell roughly would pass for slow noise.
    """
    alone = said.left and said.instead
    made = outcome.baseline if alone else outcome.best
    left, size = fitted_chi_square(case.judge, made), fitted_samples(case.judge)
    whole = whitened_logarithm(case) + priced(made, outcome.baseline)
    if said.left:
        law = said.strongest
        taken = plain_gain(law) if leaves_noise(case, made, law) else law.gain
        left = max(left - taken, NONE_LEFT * size)
        whole += PRICE * law.numbers
    else:  # a level of its own in each recording is what slow noise has, at a price
        whole += (PRICE - OWN) * (made.own - outcome.baseline.own)
    return whole + _of_any_level(left, size)


def _of_any_level(left: float, size: int) -> float:
    """Chi-square where the noise may be of another level than it was taken for, at a price.

    Noise is judged with what is missing in it: what explains that leaves less than was supposed.
    And a level that is read from few parts of a spectrum may be too low.
    """
    return min(left, size * (1.0 + math.log(left / size)) + PRICE)


def _terms_of(found: tuple[Case, Outcome, Verdict]) -> frozenset[str]:
    return frozenset(t.label for t in found[1].best.terms)


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


def _repeated(
    campaign: Campaign,
    case: Case,
    anew: Callable[[Case, Fit], Case | None],
    notes: Sequence[str],
    tell: Progress,
    seed: Fit | None = None,
) -> _Explained:
    """The answer once the noise, judged ``anew`` by what was found, no longer changes."""
    found = _exact(campaign, case, notes, tell, 0.5, seed)
    erred = False
    for _ in range(REPEATS):
        answer, outcome = found.answer, found.outcome
        if reduced(case.judge, outcome.best) > HOPELESS:
            break
        if case.model.drifts and not answer.accepted and SLOW_NOISE in answer.notes:
            break  # noise of a colour is all that there is
        if erred and _errs(answer):
            break  # knowing the noise better does not help
        erred = _errs(answer)
        again = anew(case, outcome.best)
        if again is None or _alike(case, again):
            break
        # what does not stand in it is searched anew, with time or without
        if _stands(campaign, again, outcome.best) and not time_left(
            'the noise judged anew by what was found'
        ):
            break
        case = again
        found = _exact(campaign, case, notes, tell, seed=outcome.best)
    return found


def _stands(campaign: Campaign, case: Case, found: Fit) -> bool:
    """Whether what was found is to be believed in another noise, too."""
    baseline = with_known(campaign, case.model, case.segments, case.baseline)
    if not labels_of(found.terms) - labels_of(baseline.terms):
        return True  # nothing was found
    case.judge.reference = baseline
    made = fit(case.model, found.terms, case.segments, found.values, found.starts)
    return case.judge.better(baseline, made)


def _alike(one: Case, other: Case, level: float = LEVEL) -> bool:
    """Whether two cases take the noise for the same, up to a relative change of its level."""
    return all(
        abs(math.log(float(np.linalg.norm(innovations(a, p)) / np.linalg.norm(innovations(b, p)))))
        < level
        for a, b in zip(one.segments, other.segments, strict=True)
        if a.whitener is not None and b.whitener is not None
        for white in [np.random.default_rng(0).standard_normal(a.measured.size)]
        for p in (white, np.cumsum(white))  # noise of all frequencies, and slow noise
    )
