"""Joint fits of candidates beside a fitted model: ordered by screening, judged by chi-square.

Every candidate is tried at the model's numbers; what those could re-tune is projected out of its
signature, and what remains is compared with the residual. The best are fitted jointly with
everything else, and their fall of chi-square is weighed against the number of looks.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.evidence import Thresholds, least_gain
from impactscope.discrepancy.impact.candidates.candidate import Candidate, stronger
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.candidates.channel_effects import delays_like
from impactscope.discrepancy.impact.fits.least_squares import (
    Fit,
    at_point,
    fit,
    raced,
    settled,
)
from impactscope.discrepancy.impact.models.bench_model import ImpactModel
from impactscope.discrepancy.impact.search.other_minima import scanned
from impactscope.discrepancy.impact.search.outcome import QUIET, Found, settled_without, weigh
from impactscope.discrepancy.impact.search.recording_ends import (
    runs_backwards,
    without_odd_ends,
)
from impactscope.discrepancy.impact.search.returns import from_return, only_a_return_is_missed
from impactscope.discrepancy.impact.search.screening import Remembered, Screening, Trial
from impactscope.discrepancy.impact.search.strong_effects import (
    in_place_of,
    race,
    related,
)
from impactscope.discrepancy.processes import in_processes
from impactscope.discrepancy.time_limit import time_left
from impactscope.errors import ImpactscopeError
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism

__all__ = ['LOST', 'JointFits']

Array = NDArray[np.float64]

LOST = 2.0
"""Reduced chi-square above which a longer window tells nothing more."""

_SUSPECTED = 0.1  # chance, all looks together, up to which a candidate is fitted again later
_RUNG, _AS_MUCH = 60.0, 0.3  # of chi-square, and of the best gain, from which that is done
_FREQUENCIES = tuple(float(f) for f in np.geomspace(30.0, 600.0, 9))  # Hz
_SHARES = tuple(float(s) for s in np.geomspace(1.0, 1e-3, 7))  # of an amount to begin with
_HEAT, _ROUGHLY = 12, 1.0  # iterations of a fit from each, and the fall at which it ends
_AHEAD, _LAST = 3, 40  # fits that are brought to their end, and in how many
_BEARABLE = 10.0  # times the chi-square without it
_JOINT = 6  # candidates that are fitted jointly in a step
_TIED = 8.0  # of the gain, within which one promises as much as another
_LOWER = 20.0  # of chi-square, by which a fit that a candidate led to lies in another hollow
_KEPT = 0.6  # of what slopes promise, below which a fit has lost its way


@dataclass(eq=False)
class JointFits:
    """Tries candidates beside fits of a campaign; see the module's description."""

    baseline_names: Sequence[str]
    thresholds: Thresholds
    tried: tuple[Array, list[Trial]] = field(default_factory=lambda: (np.zeros(0), []))
    """Residual and trials of the last ordering."""
    window: float = math.inf  # s after the onset, that is being looked at
    remembered: Remembered = field(default_factory=Remembered)

    def step(
        self,
        current: Fit,
        sound: Fit | None = None,
        most: int = 0,
        suspected: Sequence[Found] = (),
    ) -> tuple[list[Found], int, Fit]:
        """Candidates fitted jointly, the best first; their number; the model without them.

        The last is ``current``, or a better fit of the same model that a candidate led to.

        ``sound``: a fit of the same model to a shorter window that had nothing amiss; where the
        misfit is large, its numbers are closer to the truth than those that were bent to fit.
        ``suspected``: candidates that a shorter window has not borne out.
        """
        found, looks, without = self._tried(current, sound, most, suspected)
        fallen = (current.chi_square - without.chi_square) / max(1.0, without.reduced)
        elsewhere = not most and fallen > _LOWER and without.reduced < QUIET
        if not elsewhere or not time_left('candidates beside a better fit'):
            return found, looks, without
        # what was fitted in another hollow says little of this one
        anew, looks, lowest = self._tried(without, None, 0, found)
        there = {f.candidate.label for f in anew}
        kept = [
            weigh(f.candidate, f.fit, lowest, looks)
            for f in found
            if f.candidate.label not in there
        ]
        return sorted([*anew, *kept], key=lambda f: f.criterion), looks, lowest

    def _tried(
        self, current: Fit, sound: Fit | None, most: int, suspected: Sequence[Found]
    ) -> tuple[list[Found], int, Fit]:
        """One turn of a step; see there."""
        eased = without_odd_ends(current)
        if eased is not None:
            found, looks, without = self._tried_at(eased, sound, most, suspected)
            if found and runs_backwards(found[0].candidate):
                return found, looks, without
        return self._tried_at(current, sound, most, suspected)

    def _tried_at(
        self, current: Fit, sound: Fit | None, most: int, suspected: Sequence[Found]
    ) -> tuple[list[Found], int, Fit]:
        """Candidates fitted to the samples of a fit."""
        if current.reduced < QUIET:
            # what fitted numbers re-tune of a length is hundreds of times what is left of it, and
            # what they have not reached yet would count as gained by whatever is added
            current = settled(current)
        listed = candidates(current, self.baseline_names)
        place = current
        if sound is not None and sound.x.size == current.x.size and current.reduced > LOST:
            place = at_point(current.model, current.layout, sound.x)
        trials = self.order(place, listed)
        found = self.judge(current, trials, len(listed), most or _JOINT)
        found = self._with_suspected(current, found, suspected, len(listed))
        if current.reduced > LOST and not most:
            found = self._strong(current, place, found, listed)
        elif not most and only_a_return_is_missed(current):
            fits = _with_kin(from_return(current, listed), current, listed)
            found = _best_of(found, [weigh(c, f, current, len(listed)) for c, f in fits])
        elif not most and math.isinf(self.window):
            found = self._with_lines(current, found, listed)
        found, without = self._settle(current, found, len(listed))
        return found, len(listed), without

    def _with_lines(
        self, current: Fit, found: list[Found], listed: Sequence[Candidate]
    ) -> list[Found]:
        """What was fitted, and where nothing of it counts, narrow lines of what rings.

        They lie between the frequencies from which a candidate is tried at first.
        """
        if any(f.counts(self.thresholds.false_finding) for f in found):
            return found
        if not time_left('lines between the frequencies that were tried'):
            return found
        screening, looks = Screening(current), len(listed)
        trials = [t for c in listed if not c.channel for t in scanned(screening, c)]
        lines, spread = [], max(1.0, current.reduced)
        for t in trials:
            if t.gain > self._least(t.candidate, looks) * spread:
                with contextlib.suppress(ImpactscopeError):
                    joint = fit(t.model, current.layout, t.x, settled=0.1, near=current)
                    lines.append(weigh(t.candidate, joint, current, looks))
        return _best_of(found, lines)

    @staticmethod
    def _with_suspected(
        current: Fit, found: list[Found], suspected: Sequence[Found], looks: int
    ) -> list[Found]:
        """What was fitted, and what a shorter window was about to find; the best first.

        Numbers of the baseline that late contacts have bent hide it from a look at its slopes.
        """
        known = {f.candidate.label for f in found}

        def fitted(before: Found) -> Found | None:
            candidate = before.candidate
            model = candidate.extend(current.model)
            own = {f.key for f in candidate.free}
            mine = {k: v for k, v in before.fit.values.items() if k in own}
            begins = []
            for numbers in ({**current.values, **mine}, {**current.values, **before.fit.values}):
                with contextlib.suppress(ImpactscopeError):
                    begins.append(at_point(model, current.layout, model.vector(numbers)))
            if begins:
                nearer = min(begins, key=lambda f: f.chi_square)
                with contextlib.suppress(ImpactscopeError):
                    most = current.chi_square
                    joint = fit(
                        model, current.layout, nearer.x, settled=0.1, near=current, most=most
                    )
                    return weigh(candidate, joint, current, looks)
            return None

        open_ones = [
            before
            for before in suspected
            if before.p_value <= _SUSPECTED
            and before.candidate.label not in known
            and before.candidate.free
        ]
        added = [f for f in in_processes(fitted, open_ones) if f is not None]
        return sorted([*found, *added], key=lambda f: f.criterion)

    def _strong(
        self, current: Fit, place: Fit, found: list[Found], listed: Sequence[Candidate]
    ) -> list[Found]:
        """Candidates fitted from better places where much is missing; the best first."""
        looks = len(listed)
        fits = [(f.candidate, f.fit) for f in found]
        if not found or found[0].fit.reduced > QUIET:
            returned = from_return(place, listed)
            fits += returned
            if not returned or returned[0][1].reduced > QUIET:
                fits += race(current, self.baseline_names, self.window)
        if not fits:
            return found
        fits = _with_kin(fits, current, listed)
        return _best_of((), [weigh(c, f, current, looks) for c, f in fits])

    def _settle(self, current: Fit, found: list[Found], looks: int) -> tuple[list[Found], Fit]:
        """Weigh again where a candidate only showed the way to a better fit without it."""
        best = current
        for item in found[:2]:
            if item.fit.reduced > 1.5:
                continue
            if item.counts(self.thresholds.false_finding):
                known = item.fit.values
                x = current.model.vector(known)
                again = fit(current.model, current.layout, x, near=current)
                if again.chi_square < best.chi_square:
                    best = again
            best = settled_without(item.fit, [item.candidate], best)
        if best is current:
            return found, current
        fresh = [weigh(f.candidate, f.fit, best, looks) for f in found]
        return sorted(fresh, key=lambda f: f.criterion), best

    def order(self, current: Fit, listed: Sequence[Candidate]) -> list[Trial]:
        """Every candidate tried, the most promising first."""
        screening = Screening(current, self.remembered)

        def best(candidate: Candidate) -> tuple[list[Trial], Remembered]:
            return screening.best(candidate), self.remembered.about(candidate.label)

        told = in_processes(best, listed)
        for _, learnt in told:  # perhaps in another process
            self.remembered.learn(learnt)
        tried = [found for found, _ in told if found]
        self.tried = screening.residual, [t for found in tried for t in found]
        tried.sort(key=lambda found: found[0].gain, reverse=True)

        def refined(found: Sequence[Trial]) -> Trial:
            best = screening.best_refined(found)
            if found[0].x is not best.x and found[0].candidate.of_several_shapes:
                best = dataclasses.replace(best, plain=found[0].x)
            # at full strength bounces need more re-tuning than a linear one: what it was when
            # weak counts, too
            if best.gain > found[0].gain:
                return best
            other = found[0].x if found[0].by_slope is None else found[0].by_slope
            return dataclasses.replace(best, gain=found[0].gain, by_slope=other)

        top = in_processes(refined, tried[: 2 * _JOINT])
        return sorted(top, key=lambda t: t.gain, reverse=True)

    def judge(
        self, current: Fit, trials: Sequence[Trial], looks: int, most: int = 0
    ) -> list[Found]:
        """The most promising trials fitted jointly; the best by its criterion first."""
        found: list[Found] = []
        seen: dict[str, int] = {}
        strong = current.reduced > QUIET
        spread = max(1.0, current.reduced)
        kin: set[str] = set()
        for trial in trials:
            candidate = trial.candidate
            kind = _kind(candidate)
            if seen.get(kind, 0) >= (1 if candidate.channel else 3):
                continue
            least = self._least(candidate, looks)
            if trial.gain < 0.6 * least * spread:
                continue
            related = candidate.name in kin
            # what a fit has not borne out holds no other back, nor what many numbers gain anyway
            further = max((f.gain - self._least(f.candidate, looks) for f in found), default=0.0)
            top = further + least
            weak = bool(found) and not strong and trial.gain < top - max(20.0, 0.4 * top)
            # what promises as much as the best is fitted as well: held-out recordings may decide
            tied = (most or _JOINT) >= _JOINT and trial.gain > trials[0].gain - _TIED
            full = len(found) >= (most or _JOINT) and not tied
            if (weak or full) and not related:
                continue
            seen[kind] = seen.get(kind, 0) + 1
            try:
                joint = fit(trial.model, current.layout, trial.x, settled=0.1, near=current)
                if trial.plain is not None and not strong:
                    plain = fit(trial.model, current.layout, trial.plain, settled=0.1)
                    joint = min(joint, plain, key=lambda f: f.chi_square)
            except ImpactscopeError:
                continue
            astray = current.chi_square - joint.chi_square < _KEPT * trial.gain
            quiet = joint.reduced < QUIET and trial.gain > least
            if astray and quiet and time_left('numbers that are hardly told apart'):
                joint = settled(joint)
                astray = current.chi_square - joint.chi_square < _KEPT * trial.gain
                if astray:
                    joint = _by_slope(trial, current, joint)
            if candidate.name == 'mains_hum' and not _everywhere(joint, current):
                continue
            found.append(weigh(candidate, joint, current, looks))
            if len(found) == 1 and candidate.name in all_mechanisms():
                kin = set(mechanism(candidate.name).kin)
        promised = {t.candidate.label: t.gain for t in trials}
        found = self._rung_elsewhere(current, found, promised, looks)
        found.sort(key=lambda f: f.criterion)
        like = found and found[0].candidate.name in ('low_pass_filter', 'clock_error')
        if like and time_left('filters of other orders'):
            found += self._delays(current, found[0], looks)
            found.sort(key=lambda f: f.criterion)
        return found

    def _least(self, candidate: Candidate, looks: int) -> float:
        """Gain from which a candidate counts."""
        return least_gain(candidate.cost, looks, self.thresholds.false_finding)

    @staticmethod
    def _rung_elsewhere(
        current: Fit, found: list[Found], promised: Mapping[str, float], looks: int
    ) -> list[Found]:
        """What was fitted, what rings from frequencies all over where it explains about as much.

        A soft fixture of little mass re-tunes the sensor: at which frequency is not seen before
        that is done. ``promised``: fall of chi-square by label before anything was fitted.
        """
        top = max((f.gain for f in found), default=0.0)
        better = []
        for item in found:
            candidate = item.candidate
            key = f'{candidate.label}.frequency'
            told = max(item.gain, promised.get(candidate.label, 0.0))
            strong = told > max(_RUNG, _AS_MUCH * top)
            if key not in {f.key for f in candidate.free} or candidate.channel or not strong:
                better.append(item)
                continue
            if not time_left('other frequencies of what rings'):
                return found
            model = candidate.extend(current.model)

            begins = [
                x
                for frequency in _FREQUENCIES
                for x in _begins(candidate, model, {**current.values, key: frequency}, current)
            ]
            fits = raced(
                model,
                current.layout,
                begins,
                most=_AHEAD,
                iterations=(_HEAT, _LAST),
                settled=(_ROUGHLY, 0.1),
            )
            best = min((item.fit, *fits), key=lambda f: f.chi_square)
            better.append(weigh(candidate, best, current, looks))
        return better

    @staticmethod
    def _delays(current: Fit, like: Found, looks: int) -> list[Found]:
        """Filters of every order, and a late clock, in the place of a filter or a delay."""
        values = like.fit.values
        channel = like.candidate.channel
        rate = next(
            b.channels[channel].sample_rate
            for b in current.model.data.blows
            if channel in b.channels
        )
        found = []
        for candidate, number in delays_like(
            like.candidate, values, rate, current.model.data.channels
        ):
            model = candidate.extend(current.model)
            known = {**values, candidate.free[0].key: number}
            x = model.vector(known)
            try:
                joint = fit(model, current.layout, x, settled=0.1, near=like.fit, fresh=False)
            except ImpactscopeError:
                continue
            found.append(weigh(candidate, joint, current, looks))
        return found


def _kind(candidate: Candidate) -> str:
    """What has candidates of its like, of which few are fitted jointly.

    Lengths and masses of a pendulum do much the same, a number of the layer does not.
    """
    part = candidate.parameter.split('@')[0].split('.')[0]
    return f'{candidate.name}:{candidate.channel}:{part}'


def _by_slope(trial: Trial, current: Fit, joint: Fit) -> Fit:
    """The better of a joint fit and of one from where slopes have promised what it has not kept.

    Brought to where it fits best beside numbers that are only re-tuned along their slopes, an
    effect that these have to make room for is next to nothing; from there a fit hardly leads away.
    """
    if trial.by_slope is None:
        return joint
    with contextlib.suppress(ImpactscopeError):
        other = fit(trial.model, current.layout, trial.by_slope, settled=0.1, near=current)
        return min(joint, other, key=lambda f: f.chi_square)
    return joint


def _begins(
    candidate: Candidate, model: ImpactModel, numbers: Mapping[str, float], current: Fit
) -> list[Array]:
    """Where fits set out: with a usual amount, and one that still looks like the recordings.

    What contacts amplify is felt in so small amounts that from a usual one no slope leads on.
    """
    usual = model.values(model.vector(numbers))
    begins = [model.vector(usual)]
    for share in _SHARES:
        x = model.vector(stronger(candidate, usual, share))
        with contextlib.suppress(ImpactscopeError):
            if at_point(model, current.layout, x).chi_square < _BEARABLE * current.chi_square:
                return [*begins, x] if share < 1.0 else begins
    return begins


def _everywhere(joint: Fit, current: Fit) -> bool:
    """Whether a hum is there before the blows, too: else it stands for something that is not."""
    model, layout = joint.model, joint.layout
    before = np.zeros(layout.size, dtype=np.bool_)
    for (i, name), span in layout.spans.items():
        blow = model.data.blows[i]
        before[span] = blow.channels[name].centres[layout.masks[i, name]] < blow.onset - 2e-3
    old, new = current.residuals[: layout.size], joint.residuals[: layout.size]
    change = (new - old) ** 2
    gain = old**2 - new**2
    share = float(np.sum(change[before])) / max(float(np.sum(change)), 1e-300)
    wanted = share * float(np.sum(gain))
    # one standard deviation of the gain is twice its root; a channel that is not compared before
    # the blows (the impactor while it falls) cannot speak against
    return float(np.sum(gain[before])) >= 0.5 * wanted - 2.0 * math.sqrt(max(wanted, 0.0))


def _with_kin(
    fits: list[tuple[Candidate, Fit]], current: Fit, listed: Sequence[Candidate]
) -> list[tuple[Candidate, Fit]]:
    """Fits, and those of the family of the best of them from the numbers that it has found."""
    if not fits:
        return fits
    candidate, leader = min(fits, key=lambda item: item[1].chi_square)
    tried = [(c, in_place_of(leader, current.model, c)) for c in related(candidate, listed)]
    return [*fits, *((c, f) for c, f in tried if f is not None)]


def _best_of(found: Sequence[Found], others: Sequence[Found]) -> list[Found]:
    """The best fit of each candidate; the best candidate first."""
    best: dict[str, Found] = {}
    for item in (*found, *others):
        known = best.get(item.candidate.label)
        if known is None or item.criterion < known.criterion:
            best[item.candidate.label] = item
    return sorted(best.values(), key=lambda f: f.criterion)
