"""The search: forwards and backwards through candidates, over windows that grow.

Candidates are tried and judged by :mod:`.joint_fits`; recordings that were held out must not
contradict. The window after the onset grows: what is missing is found where the blow is still
simple, and checked where later contacts have amplified every error.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.evidence import (
    Thresholds,
    family_p_value,
)
from impactscope.discrepancy.impact.adequacy.residual_tests import adequacy
from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.fits.growing_windows import (
    fit_unless_far_behind,
    followed,
    held_out_fit,
    with_repeatability,
)
from impactscope.discrepancy.impact.fits.least_squares import Fit, at_point, fit, settled
from impactscope.discrepancy.impact.models.bench_model import ImpactModel, Layout
from impactscope.discrepancy.impact.search.baseline_conventions import (
    other_conventions,
    with_conventions_of,
)
from impactscope.discrepancy.impact.search.errors_of_laws import (
    is_error_of_a_law,
    rest_of_a_law,
)
from impactscope.discrepancy.impact.search.fuller_forms import (
    filter_in_place_of_two,
    fuller,
    law_in_place_of_two,
    law_that_contains,
)
from impactscope.discrepancy.impact.search.held_out import check_held_out
from impactscope.discrepancy.impact.search.joint_fits import LOST, JointFits
from impactscope.discrepancy.impact.search.other_minima import other_modes, rung
from impactscope.discrepancy.impact.search.outcome import (
    QUIET,
    Found,
    Outcome,
    chance_of,
    evidence_for,
    weigh,
    with_findings,
)
from impactscope.discrepancy.impact.search.pairs import Pair, pairs
from impactscope.discrepancy.impact.search.prediction_misfit import further_misfit
from impactscope.discrepancy.impact.search.profile_likelihood import profiled
from impactscope.discrepancy.impact.search.pruning import (
    at_bottom,
    no_weight_along,
    one_for_two,
    prune,
)
from impactscope.discrepancy.impact.search.returns import swept
from impactscope.discrepancy.impact.search.screening import Screening, Trial
from impactscope.discrepancy.impact.search.strong_effects import (
    from_first_contact,
    from_taps,
)
from impactscope.discrepancy.impact.search.time_offsets import with_late_channel
from impactscope.discrepancy.processes import in_processes
from impactscope.discrepancy.time_limit import time_left
from impactscope.errors import ImpactscopeError

__all__ = ['Search']

Array = NDArray[np.float64]

WINDOWS = (0.04, 0.1, 0.25, math.inf)
"""s after the onset over which blows are compared in turn; taps count whole from the start."""

_LOOKED = (0.25,)  # windows in which is looked for weak effects, beside the last
_MOST = 3  # findings
_SURE = 4.0  # standard deviations of what is left
_ALONE = 5  # candidates that are fitted jointly in place of what was found
_AHEAD = 3  # candidates that are fitted jointly where only the way is sought
_BEAM = 2  # first steps that are followed when none explains the recordings
_FIRST = 0.012  # s after the onset from which fits grow
_BEYOND = 1.15  # ratio of the window in which is looked to the one that was reached
_DETOURS = 3
_SHORTER = 0.8  # of the samples, that another structure must follow at least
_TELLING = 4.0  # ratio of reduced chi-squares from which a structure is another
_WORSE = 1.1  # the same from which a name is taken otherwise
_DOUBTED = 5  # candidates that are looked at again where what is left is no noise
_LEAST_GAIN = 9.0  # of chi-square, of such a candidate with one number
_LEAST_CHANCE = 0.0027  # that noise alone gives it as much, whatever its numbers
_FAR_BEHIND = 100.0  # of chi-square, that the last digits of a fit do not make up for
_ROUGHLY = 1.0  # fall of chi-square at which a fit ends that only tells that
_WORTH = 6.0  # of chi-square, that a number less is worth
_AS_LONG = 0.98  # of the samples, that a baseline taken otherwise has to follow
_MOVED = 1.0  # of chi-square, from which what is held out is predicted anew
_PRUNED = 2  # rounds in which findings are asked for again
_SIMPLER = 3  # candidates in place of several findings, that count from their lowest minima ...
_MISSED = 0.5  # ... where they lack no more than that share of what these explain
_SOUND = 10.0  # times the chance from which what is left is no noise


def _silent(share: float, text: str) -> None:
    """Progress that nobody wants to see."""


@dataclass(eq=False)
class Search:
    """The search on one campaign; see the module's description."""

    baseline_names: Sequence[str]
    thresholds: Thresholds = field(default_factory=Thresholds)
    progress: Callable[[float, str], None] = _silent
    windows: Sequence[float] = WINDOWS
    fits: JointFits = field(init=False)

    def __post_init__(self) -> None:
        self.fits = JointFits(self.baseline_names, self.thresholds)

    def run(self, baseline: Fit) -> Outcome:
        """Search from a fitted baseline on."""
        outcome = self._searched(*self._structure(baseline))
        if outcome.final.reduced > LOST and time_left('another start'):
            cold = self._from_cold(baseline)
            if cold is not None:
                again = self._searched(*cold)
                if again.final.reduced < outcome.final.reduced:
                    return again
        return outcome

    def _from_cold(self, baseline: Fit) -> tuple[Fit, Outcome] | None:
        """A start with what meets the first contacts, where nothing else has led anywhere."""
        tried = from_first_contact(baseline, self.baseline_names)
        if not tried:
            return None
        candidate, other = tried[0]
        plain = dataclasses.replace(baseline.model, data=other.model.data)
        without = fit(plain, other.layout, baseline.x, iterations=12)
        if other.reduced * _TELLING > without.reduced:
            return None
        looks = len(candidates(baseline, self.baseline_names))
        return other, _begun_with(candidate, other, without, looks)

    def _searched(self, current: Fit, outcome: Outcome) -> Outcome:
        """The search from a fit on that may have findings already."""
        baseline = outcome.baseline
        sound: Fit | None = None  # the last fit that a window was content with
        waiting, reached, detours = list(self.windows), _FIRST, _DETOURS
        followed_whole = _follows_whole(baseline)
        if not followed_whole:
            current = fit(current.model, _up_to(current, reached), current.x)
        while waiting:
            window = waiting.pop(0)
            self.progress(self._share(window), f'up to {window:g} s')
            current = _renewed(current, outcome)
            if followed_whole and not outcome.accepted:
                # a shorter window knows less: it shall not lead away from what the whole one tells
                current = dataclasses.replace(current, x=baseline.x)
            grown, until = _by_convention(current, outcome, reached, window)
            if current.reduced <= QUIET and _worse(current, grown):
                grown = swept(current, grown, outcome.accepted)
            if until < window and detours:
                # look where the misfit has only begun
                detours -= 1
                waiting.insert(0, window)
                sound, window = grown, _BEYOND * until
            current = grown
            if until < window:
                current = fit(grown.model, _up_to(grown, window), grown.x)
            last, reached = not waiting, window
            outcome.window = self.fits.window = window
            current = fuller(current, outcome, self.thresholds.false_finding, sound)
            astray = current.reduced > QUIET and outcome.accepted
            if astray and time_left('the last finding sought anew'):
                current = self._reconsider(current, outcome, sound)
                current = fuller(current, outcome, self.thresholds.false_finding, sound)
            if last or current.reduced > QUIET or window in _LOOKED:
                current = self._forward(current, outcome, sound, last=last)
            if current.reduced > LOST and not last:
                break  # what comes later only amplifies what is not understood
            sound = current if current.reduced < QUIET else None
        current = self._simpler(current, outcome)
        if len(outcome.accepted) > 1 and time_left('one law in place of two effects'):
            one = law_in_place_of_two(current, outcome, self.baseline_names)
            current = current if one is None else one
        one = filter_in_place_of_two(current, outcome)
        current = current if one is None else one
        outcome.final = self._doubted(current, outcome)
        return self._finished(outcome)

    def with_conventions(self, outcome: Outcome, ways: Sequence[ImpactModel]) -> Outcome:
        """What was found, the names taken as in one of ``ways`` where that explains it as well.

        A finding that only made up for the choice is not needed there.
        """
        fits = in_processes(lambda taken: _taken_so(outcome, taken), ways)
        first = outcome
        for taken, fitted in zip(ways, fits, strict=True):
            known = fitted if outcome is first else _taken_so(outcome, taken)
            outcome = self._with_convention(outcome, *known)
        return outcome

    def _with_convention(self, outcome: Outcome, other: Fit, cold: Fit | None) -> Outcome:
        final = outcome.final
        if other.reduced > _TELLING * final.reduced:
            return self._from_the_other(outcome, cold)
        if other.chi_square > final.chi_square + _LEAST_GAIN:
            return outcome
        model = with_conventions_of(outcome.baseline.model, other.model)
        swung = dataclasses.replace(
            outcome,
            baseline=dataclasses.replace(outcome.baseline, model=model),
            final=other,
            accepted=list(outcome.accepted),
            found=dict(outcome.found),
            rivals=dict(outcome.rivals),
            doubted=set(outcome.doubted),
            notes=list(outcome.notes),
            tests=None,
        )
        return _likelier_way(outcome, self._finished(swung))

    def _from_the_other(self, outcome: Outcome, cold: Fit | None) -> Outcome:
        """The search from a baseline taken otherwise from the start, if it needs nothing else."""
        final = outcome.final
        if cold is None:
            return outcome
        added = len(final.model.free) - len(outcome.baseline.model.free)
        size, whole = final.layout.size, cold.layout.size  # a bin more or less that tells much
        more = (cold.chi_square - whole) - (final.chi_square - size)
        return self.run(cold) if whole > _AS_LONG * size and more <= _WORTH * added else outcome

    def _finished(self, outcome: Outcome) -> Outcome:
        """What can be spared goes; the numbers, what is certain of them, and the baseline then."""
        for _ in range(_PRUNED):
            doubted = outcome.final
            prune(outcome, self.thresholds, self.windows[1], self.progress)
            if one_for_two(outcome):
                prune(outcome, self.thresholds, self.windows[1], self.progress)
            no_weight_along(outcome)
            if outcome.final is not doubted:
                outcome.tests = None
            if not outcome.accepted:
                break
            unsettled = outcome.final
            self._to_lowest(outcome)
            far = outcome.final.chi_square < unsettled.chi_square - _LEAST_GAIN
            if not far or len(outcome.accepted) < 2:
                break  # else beside numbers that were wrong a finding may have made up for them
        if outcome.accepted:
            outcome.final, outcome.factors = profiled(outcome.final, outcome.accepted)
        self._bare(outcome)
        return outcome

    def _to_lowest(self, outcome: Outcome) -> None:
        """The final model in its lowest minimum, and the others that are about as good."""
        final = outcome.final
        final = settled(fit(final.model, final.layout, final.x, near=final))
        best, outcome.modes = other_modes(final, outcome.accepted, self._rung(outcome))
        outcome.final = best if best is final else settled(best)

    @staticmethod
    def _rung(outcome: Outcome) -> list[dict[str, float]]:
        """Numbers of the final model where what rings explains most, from scans of it alone."""
        found = []
        for candidate in outcome.accepted:
            rings = any(f.key.endswith('.frequency') for f in candidate.free)
            if rings and not candidate.channel and time_left('other frequencies of what rings'):
                rest = [c for c in outcome.accepted if c is not candidate]
                without = with_findings(outcome, rest, outcome.final.layout)
                found += rung(without, candidate)
        return found

    def _bare(self, outcome: Outcome) -> None:
        """The baseline over the final window; what it can do as well without is no finding."""
        final = outcome.final
        outcome.baseline = with_findings(outcome, [], final.layout)
        if not outcome.accepted or _misses_more(outcome.baseline, final):
            return
        gain = evidence_for(final, outcome.baseline)
        if len(outcome.accepted) == 1:
            chance = chance_of(outcome.accepted[0], final, gain, outcome.looks)
        else:
            cost = sum(c.cost for c in outcome.accepted)
            chance = family_p_value(gain, cost, outcome.looks)
        structural = any(not c.free for c in outcome.accepted)
        if outcome.doubted and not structural and gain < _LEAST_GAIN:
            # what made the finding needed was gone with the samples that the last fit left out
            tests = adequacy(outcome.baseline)
            if tests.p_value > self.thresholds.inadequate:
                outcome.accepted.clear()
                outcome.final, outcome.tests, outcome.p_value = outcome.baseline, tests, 1.0
                return
        if chance > self.thresholds.false_finding and not structural and not outcome.doubted:
            if len(outcome.accepted) == 1:  # held-out recordings may yet bear it out
                (alone,) = outcome.accepted
                found = dataclasses.replace(outcome.found[alone.label], fit=final)
                outcome.last = [
                    weigh(f.candidate, f.fit, outcome.baseline, outcome.looks)
                    for f in (found, *outcome.rivals.get(alone.label, ()))
                    if f.fit.layout.size == final.layout.size
                ]
            outcome.accepted.clear()
            outcome.final, outcome.tests = outcome.baseline, None
            outcome.p_value = chance

    def _structure(self, baseline: Fit) -> tuple[Fit, Outcome]:
        """A baseline that cannot follow the recordings, with another structure from the start.

        What has no number (a contact that cannot pull, the bench's other orientation) changes the
        motion at once and for good: no fit leads there from a fit without it.
        """
        outcome = Outcome(baseline, baseline, [])
        whole = baseline.model.layout(baseline.model.data.fitted).size
        if baseline.reduced < LOST and baseline.layout.size == whole:
            return baseline, outcome
        listed = candidates(baseline, self.baseline_names)
        best: tuple[Candidate, Fit, Fit] | None = None
        others = [c for c in listed if not c.free]
        fits = in_processes(
            lambda c: fit_unless_far_behind(c.extend(baseline.model), baseline), others
        )
        tried = [(c, f) for c, f in zip(others, fits, strict=True) if f is not None]
        if 'contact.stiffness' in baseline.values and baseline.reduced > LOST:
            tried += from_taps(baseline, self.baseline_names)
        tried += with_late_channel(baseline, self.baseline_names)
        for candidate, other in tried:
            if other.layout.size < _SHORTER * baseline.layout.size:
                continue
            plain = dataclasses.replace(baseline.model, data=other.model.data)
            without = fit(plain, other.layout, baseline.x, iterations=12)
            if other.reduced * _TELLING < without.reduced and (
                best is None or other.reduced < best[1].reduced
            ):
                best = candidate, other, without
        if best is None:
            return baseline, outcome
        candidate, other, without = best
        return other, _begun_with(candidate, other, without, len(listed))

    def _doubted(self, current: Fit, outcome: Outcome) -> Fit:
        """What is left is not noise: the candidate that makes it noise needs less evidence."""
        while True:
            outcome.tests = adequacy(current)
            if outcome.tests.p_value > self.thresholds.inadequate:
                break
            if rest_of_a_law(outcome, outcome.tests):
                break
            if time_left('laws that contain a finding'):
                more = law_that_contains(
                    current, outcome, self.baseline_names, self.thresholds.false_finding
                )
                if more is not None:
                    current = more
                    continue
            # what was seen along a law alone has to be gone there
            laws = outcome.tests.p_values.get('laws', 1.0) < self.thresholds.inadequate
            able = []
            room = len(outcome.accepted) < _MOST
            for item in outcome.last[:_DOUBTED] if room else ():
                new = item.candidate not in outcome.accepted and not item.refused
                chance = family_p_value(item.gain, item.candidate.cost, 1)
                if chance < _LEAST_CHANCE and new:
                    chance = adequacy(item.fit, laws=laws).p_value
                    if chance > _SOUND * self.thresholds.inadequate:
                        able.append((item.criterion, item))
            if not able:
                return self._another_pair(current, outcome)
            best = min(able, key=lambda pair: pair[0])[1]
            outcome.accepted.append(best.candidate)
            outcome.found[best.candidate.label] = best
            outcome.rivals[best.candidate.label] = [f for f in outcome.last if f is not best]
            outcome.p_value = min(outcome.p_value, self.thresholds.inadequate)
            outcome.doubted.add(best.candidate.label)
            current = best.fit
            outcome.last = []
            outcome.tests = None
        return current

    def _simpler(self, current: Fit, outcome: Outcome) -> Fit:
        """One candidate in place of several, where over the whole window it does as well.

        In a short window a wrong number of the simulation may stand for what is missing, and the
        next finding then for the difference; or a law for another that bends as much there.
        """
        if not outcome.accepted or any(not c.free for c in outcome.accepted):
            return current
        if not time_left('one effect in place of what was found'):
            return current
        start = with_findings(dataclasses.replace(outcome, final=current), [], current.layout)
        if len(outcome.accepted) == 1 and not self._seen_in_part(start, current, outcome):
            return current
        listed = candidates(start, self.baseline_names)
        several = len(outcome.accepted) > 1
        # one of several may have another minimum, in which it needs none of the others
        tried = [c for c in listed if several or c.name != outcome.accepted[0].name]
        price = sum(c.price(outcome.found[c.label].gain, current) for c in outcome.accepted)
        gain = evidence_for(current, start)
        # each further finding was chosen among all candidates, which one alone was but once
        chosen = 2.0 * math.log(len(listed)) * (len(outcome.accepted) - 1)
        reached = price - gain + chosen
        found = self._alone(start, current, tried, len(listed), chosen + price)
        if all(item.criterion > reached for item in found):
            # later contacts fold the ground: what is not far behind may have stopped too early
            most = current.chi_square + _MISSED * (start.chi_square - current.chi_square)
            found[:_SIMPLER] = [at_bottom(item, most) for item in found[:_SIMPLER]]
            if start.reduced < LOST and several and all(f.criterion > reached for f in found):
                found += self._from_first_contacts(
                    start, current, tried, len(listed), chosen + price
                )
            found.sort(key=lambda f: f.criterion)
        for item in found:
            if item.criterion > reached or item.refused or item.fit.reduced > QUIET:
                continue
            outcome.accepted.clear()
            outcome.accepted.append(item.candidate)
            outcome.found[item.candidate.label] = item
            outcome.rivals[item.candidate.label] = [f for f in found if f is not item]
            outcome.p_value = min(outcome.p_value, item.p_value)
            outcome.last = []
            return _likelier(item.fit, outcome)
        return current

    @staticmethod
    def _seen_in_part(start: Fit, current: Fit, outcome: Outcome) -> bool:
        """Whether the one finding was made in a shorter window, beside nothing strong.

        Then the whole window would not show by its misfit that it is another.
        """
        (alone,) = outcome.accepted
        shorter = outcome.found[alone.label].fit.layout.size < current.layout.size
        return shorter and start.reduced < QUIET

    def _alone(
        self, start: Fit, current: Fit, listed: Sequence[Candidate], looks: int, dearer: float
    ) -> list[Found]:
        """Candidates fitted alone over the whole window of a fit without any.

        Where that fit is lost its numbers are bent, and trials beside them say little.
        """
        if start.reduced < LOST:
            return self.fits.judge(start, self.fits.order(start, listed), looks, _ALONE)
        found = self._from_first_contacts(start, current, listed, looks, dearer)
        return sorted(found, key=lambda f: f.criterion)

    def _from_first_contacts(
        self, start: Fit, current: Fit, listed: Sequence[Candidate], looks: int, dearer: float
    ) -> list[Found]:
        """Candidates fitted alone, from the first contacts on over windows that grow.

        What explains everything alone explains the first contacts alone, no worse than
        ``current``, which has findings that count for ``dearer`` of chi-square.
        """
        first = self.windows[0]
        near, as_good = _near(start, first), _near(current, first).chi_square + dearer
        found = []
        for item in self.fits.judge(near, self.fits.order(near, listed), looks, _ALONE):
            if item.fit.reduced < QUIET and item.fit.chi_square < as_good:
                whole, _ = _grown(item.fit, first, start.layout.window)
                if whole.layout.size == start.layout.size:
                    found.append(weigh(item.candidate, whole, start, looks))
        return found

    def _another_pair(self, current: Fit, outcome: Outcome) -> Fit:
        """A pair in place of all findings that do not explain the recordings.

        Looked for where the blows are still simple: a step at a time may have gone astray.
        """
        if any(not c.free for c in outcome.accepted) or not time_left('pairs of effects'):
            return current
        start = with_findings(dataclasses.replace(outcome, final=current), [], current.layout)
        allowed = self.thresholds.inadequate
        numbers = sum(c.cost for c in outcome.accepted)
        for window in (self.windows[0], outcome.window):
            near = start if window == outcome.window else _near(start, window)
            listed = candidates(near, self.baseline_names)
            self.fits.order(near, listed)
            residual, trials = self.fits.tried
            for pair in pairs(near, residual, trials, len(listed), allowed):
                if pair.p_value > allowed or pair.fit.reduced > QUIET:
                    continue
                whole, _ = _grown(pair.fit, min(window, _FIRST), outcome.window)
                if whole.layout.size < current.layout.size:
                    continue
                fewer = numbers - sum(c.cost for c in pair.candidates)
                if whole.chi_square > current.chi_square + _WORTH * fewer:
                    continue
                if adequacy(whole, laws=False).p_value > _SOUND * allowed:
                    outcome.accepted.clear()
                    outcome.tests = None
                    return self._take(dataclasses.replace(pair, fit=whole), [], outcome)
        return current

    def _share(self, window: float) -> float:
        done = sum(w <= window for w in self.windows) - 1
        return 0.1 + 0.6 * max(done, 0) / len(self.windows)

    # --- forwards ----------------------------------------------------------------------------

    def _forward(self, current: Fit, outcome: Outcome, sound: Fit | None, *, last: bool) -> Fit:
        """Add what is missing within the current window, one candidate after the other."""
        suspected, outcome.last = outcome.last, []
        while len(outcome.accepted) < _MOST:
            spare = bool(outcome.accepted) or (outcome.looks > 1 and not last)
            if spare and not time_left('further effects'):
                break
            found, outcome.looks, current = self.fits.step(current, sound, suspected=suspected)
            sound, suspected = None, []
            outcome.last = found
            allowed = self.thresholds.false_finding / (1 + len(_LOOKED))
            good = [f for f in found if f.counts(allowed)]
            good = [f for f in good if not is_error_of_a_law(f.candidate, f.gain, outcome)]
            if not good:
                joint = self._together(current, outcome, allowed)
                if joint is not None:
                    current = joint
                    continue
                if not outcome.accepted:
                    chances = [f.p_value for f in found if not f.refused]
                    outcome.p_value = min(outcome.p_value, *chances, 1.0)
                break
            best = good[0]
            if best.fit.reduced > LOST and len(good) > 1 and not outcome.accepted:
                best = self._look_ahead(good)
            outcome.accepted.append(best.candidate)
            outcome.found[best.candidate.label] = best
            outcome.rivals[best.candidate.label] = [f for f in found if f is not best]
            outcome.p_value = min(outcome.p_value, best.p_value)
            current = fuller(best.fit, outcome, self.thresholds.false_finding)
            if current.reduced < QUIET and not last:
                break
        return current

    def _together(self, current: Fit, outcome: Outcome, allowed: float) -> Fit | None:
        """Two candidates at once, where each alone hides behind the other."""
        if len(outcome.accepted) > _MOST - 2:
            return None
        residual, trials = self.fits.tried
        if residual.size != current.residuals.size:
            return None
        found = pairs(current, residual, trials, outcome.looks, allowed)
        if found and all(
            is_error_of_a_law(c, found[0].gain, outcome) for c in found[0].candidates
        ):
            return None
        if not found or found[0].p_value > allowed:
            return None
        return self._take(found[0], found[1:], outcome)

    def _take(self, best: Pair, others: Sequence[Pair], outcome: Outcome) -> Fit:
        """Both of a pair are findings; what else stood in their place are their rivals."""
        for candidate, beside in zip(best.candidates, reversed(best.candidates), strict=True):
            outcome.accepted.append(candidate)
            outcome.found[candidate.label] = Found(
                candidate, best.fit, best.gain, best.p_value, best.criterion
            )
            outcome.rivals[candidate.label] = [
                Found(instead, p.fit, p.gain, p.p_value, p.criterion)
                for p in others
                if any(c.label == beside.label for c in p.candidates)
                for instead in p.candidates
                if instead.label != beside.label
            ]
        outcome.p_value = min(outcome.p_value, best.p_value)
        outcome.last = []
        return best.fit

    def _reconsider(self, current: Fit, outcome: Outcome, sound: Fit | None) -> Fit:
        """Find the last finding anew, where a longer window does not bear it out."""
        candidate = outcome.accepted[-1]
        model = outcome.model_with(outcome.accepted[:-1])
        known = current.values if sound is None else sound.values
        x = model.vector(known)
        without = at_point(model, current.layout, x)
        found = self.fits.judge(
            without,
            self.fits.order(without, candidates(without, self.baseline_names)),
            outcome.looks,
        )
        found += self._restarted(without, candidate, outcome.looks)
        found += _rivals_followed(without, outcome.rivals.get(candidate.label, ()), outcome.looks)
        found.sort(key=lambda f: f.criterion)
        better = [f for f in found if f.fit.chi_square < 0.8 * current.chi_square]
        if not better:
            return current
        best = better[0]
        outcome.put_in_place([candidate], best, found)
        return best.fit

    def _restarted(self, without: Fit, candidate: Candidate, looks: int) -> list[Found]:
        """A candidate fitted jointly from each of its starts."""
        screening = Screening(without)

        def fitted(start: Mapping[str, float]) -> Found | None:
            model = candidate.extend(without.model)
            trial = Trial(candidate, 0.0, model, screening.vector(model, start))
            try:
                joint = fit(model, without.layout, screening.scaled(trial).x, iterations=12)
            except ImpactscopeError:
                return None
            return weigh(candidate, joint, without, looks)

        tried = in_processes(fitted, candidate.starts[:6])
        return [f for f in tried if f is not None]

    def _look_ahead(self, good: Sequence[Found]) -> Found:
        """Of the best first steps, the one from which the next step leads furthest."""
        reached = []
        for first in good[:_BEAM]:
            found, _, _ = self.fits.step(first.fit, most=_AHEAD)
            best = min((f.fit.chi_square for f in found), default=first.fit.chi_square)
            reached.append((best, first))
        return min(reached, key=lambda item: item[0])[1]

    def check(self, outcome: Outcome) -> None:
        """Let the held-out recordings judge; see :func:`check_held_out`."""
        judged = outcome.final
        check_held_out(outcome, self.thresholds, _MOST, self.windows[1])
        if outcome.accepted and outcome.final is not judged:
            brought = outcome.final
            self._to_lowest(outcome)
            outcome.final, outcome.factors = profiled(outcome.final, outcome.accepted)
            if outcome.final.chi_square < brought.chi_square - _MOVED:
                self._predict_anew(outcome)
        _without_strayed_line(outcome)

    @staticmethod
    def _predict_anew(outcome: Outcome) -> None:
        """The held-out recordings by numbers that another minimum has."""
        held_out = outcome.final.model.data.held_out
        with contextlib.suppress(ImpactscopeError):
            predicted = held_out_fit(outcome.final, held_out, outcome.window)
            if predicted is not None:
                outcome.held_out_final = predicted


def _taken_so(outcome: Outcome, taken: ImpactModel) -> tuple[Fit, Fit | None]:
    """What was found with the names taken as in ``taken``; the baseline from a cold start, too.

    Bounces that one choice has bent the numbers to meet may be met by the other with numbers
    to which no fit leads from these: the second where the first is far off, else None.
    """
    final = outcome.final
    most = _TELLING * final.chi_square
    model = with_conventions_of(final.model, taken)
    other = fit(model, final.layout, final.x, near=final, most=most)
    far = other.reduced > _TELLING * final.reduced
    if not far or not time_left('a cold start with names taken otherwise'):
        return other, None
    model = with_conventions_of(outcome.baseline.model, taken)
    return other, fit_unless_far_behind(model, final)


def _likelier_way(outcome: Outcome, swung: Outcome) -> Outcome:
    """Of two ways to take the names what fitted and held-out recordings are met by better.

    Fitted ones alone may say next to nothing of what later contacts of a harder blow tell.
    """
    fewer = len(swung.accepted) < len(outcome.accepted)
    worse = swung.final.chi_square - outcome.final.chi_square
    worse += _predicted_worse(outcome, swung)
    return swung if worse < 0.0 or (fewer and worse < _LEAST_GAIN) else outcome


def _predicted_worse(outcome: Outcome, other: Outcome) -> float:
    """Rise of chi-square of the held-out recordings from one outcome to another; 0 if unknown.

    So it is where neither meets them: what they alone show would be taken for the choice.
    """
    predictions = []
    for each in (outcome, other):
        final = each.final
        try:
            predicted = held_out_fit(final, final.model.data.held_out, each.window)
        except ImpactscopeError:
            return 0.0
        if predicted is None:
            return 0.0
        predictions.append((final, predicted))
    if min(predicted.reduced for _, predicted in predictions) > QUIET:
        return 0.0
    return further_misfit(*predictions)


def _without_strayed_line(outcome: Outcome) -> None:
    """Drop a hum whose frequency has left the mains, where it does not pay for any other."""
    if len(outcome.accepted) != 1:
        return
    (alone,) = outcome.accepted
    if weigh(alone, outcome.final, outcome.baseline, outcome.looks).refused:
        outcome.accepted.clear()
        outcome.final, outcome.held_out_final = outcome.baseline, outcome.held_out_baseline
        outcome.tests, outcome.p_value = None, 1.0


def _rivals_followed(without: Fit, rivals: Sequence[Found], looks: int) -> list[Found]:
    """What did about as well up to a shorter window, from its own numbers there."""
    found: list[Found] = []
    for rival in rivals:
        if rival.fit.reduced > QUIET or len(found) == _BEAM:
            continue
        model = rival.candidate.extend(without.model)
        known = rival.fit.values
        x = model.vector(known)
        with contextlib.suppress(ImpactscopeError):
            joint = fit(model, without.layout, x, iterations=12)
            found.append(weigh(rival.candidate, joint, without, looks))
    return found


def _begun_with(candidate: Candidate, other: Fit, without: Fit, looks: int) -> Outcome:
    """What a search sets out from that has a finding already."""
    outcome = Outcome(without, other, [candidate], looks=looks)
    item = weigh(candidate, other, without, looks)
    outcome.found[candidate.label] = item
    outcome.rivals[candidate.label] = []
    outcome.p_value = item.p_value
    return outcome


def _follows_whole(baseline: Fit) -> bool:
    """Whether a baseline follows every blow to its end and leaves little more than noise."""
    whole = baseline.model.layout(baseline.layout.blows).size
    return baseline.reduced < QUIET and baseline.layout.size >= whole


def _up_to(found: Fit, window: float) -> Layout:
    return found.model.layout(found.layout.blows, window)


def _grown(current: Fit, reached: float, window: float) -> tuple[Fit, float]:
    """A fit extended to a longer window, and the window to which it could be followed."""
    direct = fit(current.model, _up_to(current, window), current.x)
    if direct.reduced < QUIET * max(1.0, current.reduced):
        return direct, window
    return followed(current, reached, window, renew=False)


def _worse(before: Fit, grown: Fit) -> bool:
    """Whether what a longer window has beyond a shorter one is explained less well by far."""
    further = grown.layout.size - before.layout.size
    left = grown.chi_square - before.chi_square
    usual = max(1.0, before.reduced)
    return left > usual * (further + _SURE * math.sqrt(2.0 * max(further, 1)))


def _near(found: Fit, window: float) -> Fit:
    return fit(found.model, _up_to(found, window), found.x)


def _by_convention(
    current: Fit, outcome: Outcome, reached: float, window: float
) -> tuple[Fit, float]:
    """A longer window, what the names leave open taken otherwise where that goes further.

    While something large is missing the baseline cannot tell how they are meant. What it gets
    wrong shows in late bounces, and would be sought among the effects. See `_grown`.
    """
    best, until = _grown(current, reached, window)
    if current.reduced > LOST:
        return best, until
    if until == window and best.reduced < QUIET:
        return _likelier(best, outcome) if outcome.accepted else best, until
    for model in other_conventions(best):
        meant = with_conventions_of(current.model, model)
        other = fit(meant, current.layout, current.x, iterations=12)
        if other.reduced > max(QUIET, _WORSE * current.reduced):
            continue
        grown, further = _grown(other, reached, window)
        if further > until or (further == until and _WORSE * grown.reduced < best.reduced):
            best, until = grown, further
    _mean(outcome, best)
    return best, until


def _likelier(found: Fit, outcome: Outcome) -> Fit:
    """A fit with what the names leave open taken in the way that leaves least.

    When it was taken for the baseline something large may have been missing.
    """
    best = found

    def roughly(model: ImpactModel) -> Fit:
        most = found.chi_square + _FAR_BEHIND
        return fit(
            model, found.layout, found.x, settled=_ROUGHLY, near=found, fresh=False, most=most
        )

    models = other_conventions(found)
    for model, other in zip(models, in_processes(roughly, models), strict=True):
        if other.chi_square > best.chi_square + _FAR_BEHIND:
            continue
        other = fit(model, found.layout, other.x)
        if other.chi_square < best.chi_square - _LEAST_GAIN:
            # from there the usual way may lead further, too
            back = fit(best.model, found.layout, other.x)
            best = min(best, back, key=lambda f: f.chi_square)
            if other.chi_square < best.chi_square - _LEAST_GAIN:
                best = other
    if best is not found:
        _mean(outcome, best)
    return best


def _mean(outcome: Outcome, found: Fit) -> None:
    """Take the names of the baseline as a fit does."""
    meant = with_conventions_of(outcome.baseline.model, found.model)
    outcome.baseline = dataclasses.replace(outcome.baseline, model=meant)


def _misses_more(baseline: Fit, final: Fit) -> bool:
    """Whether a baseline is lost where a fit with findings says that no bench repeats anything.

    A contact at the end of a long way is no more repeatable than that way, so little of it counts
    in a fit that has it. A baseline without it has no such excuse.
    """
    model = with_repeatability(baseline.model, baseline.x, baseline.layout.blows)
    own = at_point(model, model.layout(baseline.layout.blows, final.layout.window), baseline.x)
    more = own.layout.size > final.layout.size
    return more and own.reduced > LOST * max(baseline.reduced, final.reduced)


def _renewed(current: Fit, outcome: Outcome) -> Fit:
    """What no bench repeats estimated anew, for a fit and for the baseline beside it."""
    model = with_repeatability(current.model, current.x, current.layout.blows)
    base = dataclasses.replace(outcome.baseline.model, data=model.data)
    outcome.baseline = dataclasses.replace(outcome.baseline, model=base)
    return dataclasses.replace(current, model=model)
