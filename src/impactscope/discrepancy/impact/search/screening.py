"""Screening: candidates tried at a fitted model by simulation, before any joint fit.

What the numbers of the model can re-tune is projected out of a candidate's signature; what is
left of it, against the residual, says what a joint fit would gain and where it should start.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.impact.candidates.candidate import Candidate, stronger
from impactscope.discrepancy.impact.fits.least_squares import (
    Fit,
    at_point,
    exact_slope,
    jacobian,
    projector,
    stepping,
    weighted_median,
)
from impactscope.discrepancy.impact.models.bench_model import ImpactModel
from impactscope.discrepancy.processes import in_processes
from impactscope.errors import ImpactscopeError

__all__ = ['Remembered', 'Screening', 'Trial']

Array = NDArray[np.float64]
_FELT = 15.0  # norm of the change by an effect that is weak
_WEAKER = 4  # times that a trial is made weaker
_MILDER, _MILD = 6, 0.1  # times that a start without a simulation is made weaker, and by how much
_FAINT = 0.2  # of that norm: weaker ones tell less
_NEAR = 1.15  # reduced chi-square up to which strong effects are out of the question
_STARTS = 3  # of a candidate that are refined
_MANY = 8  # starts of a candidate that are tried again in a longer window
_STRONGEST = 30.0  # times the strength of a start, beyond which nothing is linear
_RE_TUNED = 0.1  # of an effect, left of it, below which a trial says more of its bends
_SLIGHT = (0.3, 1.0, 3.0)  # norms of the change by far weaker effects, that tell the slope
_TOLD = 0.1  # s after the onset, from which a window tells them apart


@dataclass(eq=False)
class Remembered:
    """What earlier trials of a search tell later ones, where nothing strong is missing."""

    weak: dict[tuple[str, tuple[tuple[str, float], ...]], dict[str, float]] = field(
        default_factory=dict
    )
    """Starts of candidates, by label and value, at which their effect was weak."""

    ahead: dict[tuple[str, ...], tuple[int, ...]] = field(default_factory=dict)
    """Which of many starts did best beside the same numbers, by label and those numbers' keys."""

    def about(self, label: str) -> Remembered:
        """What is known of one candidate."""
        return Remembered(
            {place: start for place, start in self.weak.items() if place[0] == label},
            {place: best for place, best in self.ahead.items() if place[0] == label},
        )

    def learn(self, more: Remembered) -> None:
        """Take over what was learnt elsewhere."""
        self.weak.update(more.weak)
        self.ahead.update(more.ahead)


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A candidate tried at a model: estimated fall of chi-square and where to start a fit."""

    candidate: Candidate
    gain: float
    model: ImpactModel
    x: Array
    signature: Array | None = None  # what it does at ``weak`` that no fitted number can re-tune
    weak: Mapping[str, float] = field(default_factory=dict)
    one_sided: bool = False  # whether its strength has one sign only
    by_slope: Array | None = None  # another start, of which slopes promise the gain
    plain: Array | None = None  # another start: as it was before its numbers were adjusted


class Screening:
    """Candidates tried at a fitted model, with everything it can re-tune projected out."""

    def __init__(self, current: Fit, remembered: Remembered | None = None) -> None:
        self.current = current
        self.remembered = remembered if current.reduced < _NEAR else None
        self.basis = projector(current.jacobian)
        self.residual = self._out(current.residuals)
        self.power = float(self.residual @ self.residual)
        self.keys = [f.key for f in current.model.free]
        jac = current.jacobian
        scale = np.linalg.norm(jac, axis=0)
        self.scale = np.where(scale > 0, scale, 1.0)
        self.normal = (jac / self.scale).T @ (jac / self.scale)
        self.slope = (jac / self.scale).T @ current.residuals

    def _out(self, vector: Array) -> Array:
        return vector - self.basis @ (self.basis.T @ vector)

    def _aligned(self, model: ImpactModel, residuals: Array) -> Array:
        """Residuals of an extended model in the order of the current one's."""
        size = self.current.layout.size
        out = np.zeros(size + len(self.keys))
        out[:size] = residuals[:size]
        place = {f.key: j for j, f in enumerate(model.free)}
        for j, key in enumerate(self.keys):
            out[size + j] = residuals[size + place[key]]
        return out

    def best(self, candidate: Candidate) -> list[Trial]:
        """The best of a candidate's starts, each simulated, the best first."""
        if candidate.free and candidate.free[0].key in self.keys:
            return [self._released(candidate)]
        if self.remembered is not None and _is_stated(candidate):
            freed = self._freed(candidate)
            return [] if freed is None else [freed]
        place = candidate.label, *self.keys
        known = self.remembered.ahead.get(place) if self.remembered is not None else None
        tried = []
        for i in range(len(candidate.starts)) if known is None else known:
            trial = self._tried(candidate, candidate.starts[i])
            if trial is not None:
                tried.append((i, trial))
        tried.sort(key=lambda item: item[1].gain, reverse=True)
        telling = self.current.layout.window > _TOLD and len(candidate.starts) > _MANY
        if self.remembered is not None and known is None and telling:
            self.remembered.ahead[place] = tuple(i for i, _ in tried[:_MANY])
        return [t for _, t in tried[:_STARTS]]

    def peaks(self, candidate: Candidate, starts: Sequence[Mapping[str, float]]) -> list[Trial]:
        """The trials that gain more than those next to them in a row of starts, best first.

        What would need a strength of the other sign gains nothing.
        """
        tried = in_processes(lambda start: self._tried(candidate, start), starts)
        gains = [-math.inf, *(-math.inf if t is None else t.gain for t in tried), -math.inf]
        tops = [
            trial
            for i, trial in enumerate(tried)
            if trial is not None and gains[i] < gains[i + 1] >= gains[i + 2] and trial.gain > 0.0
        ]
        return sorted(tops, key=lambda t: t.gain, reverse=True)

    def vector(self, model: ImpactModel, start: Mapping[str, float]) -> Array:
        """Numbers of an extended model: those of ``start``, the others as they were fitted."""
        return model.vector({**self.current.values, **start})

    def _left(self, model: ImpactModel, x: Array) -> Array:
        """What the fitted numbers cannot re-tune of the residuals of an extended model."""
        return self._out(self._residuals(model, x))

    def _residuals(self, model: ImpactModel, x: Array) -> Array:
        """An extended model simulated: residuals as :meth:`_aligned` orders them."""
        return self._aligned(model, model.residuals(x, self.current.layout))

    def _tried(
        self, candidate: Candidate, start: Mapping[str, float], milder: int = _MILDER
    ) -> Trial | None:
        """A start simulated, or as strong a one as can be, weaker ``milder`` times at most.

        What a stiff spring hardly feels lets a soft one, which moves ten times as far, run away.
        """
        model = candidate.extend(self.current.model)
        x = self.vector(model, start)
        if candidate.fitted:  # a number for each blow: linear
            return self.refined(Trial(candidate, 0.0, model, x), 1)
        place = candidate.label, tuple(sorted(start.items()))
        known = None if self.remembered is None else self.remembered.weak.get(place)
        plain, begun = -math.inf, x  # fall of chi-square without any re-tuning, and where
        # what does so far away is not in proportion to its number
        vanishes = math.inf in candidate.amplitudes.values()
        whole: Array | None = None  # residuals, with everything that can be re-tuned
        try:
            if known is None or vanishes:
                whole = self._residuals(model, x)
                plain = float(self.current.residuals @ self.current.residuals - whole @ whole)
            if known is not None:
                changed = self._residuals(model, self.vector(model, known))
                felt = float(np.linalg.norm(self._out(changed) - self.residual)) / _FELT
                if _FAINT < felt < 1.0 / _FAINT:
                    start, whole = known, changed
            if whole is None:
                whole = self._residuals(model, x)
        except ImpactscopeError:
            weaker = stronger(candidate, start, _MILD)
            if milder == 0 or weaker == dict(start):
                return None
            return self._tried(candidate, weaker, milder - 1)
        left = self._out(whole)
        gain = self.power - float(left @ left)
        if not candidate.amplitudes:
            return Trial(candidate, gain, model, x)
        seen = self.vector(model, start)  # where it gains that
        effect = float(np.linalg.norm(left - self.residual))
        for _ in range(_WEAKER):  # a strong trial says nothing of a weak effect
            if effect < _FELT:
                break
            weaker = stronger(candidate, start, 0.5 * _FELT / effect)
            there = self.vector(model, weaker)
            if np.array_equal(there, self.vector(model, start)):
                break  # as weak as it is credible
            try:
                whole = self._residuals(model, there)
            except ImpactscopeError:
                break
            start, left = weaker, self._out(whole)
            gained = self.power - float(left @ left)
            if gained > gain:
                gain, seen = gained, there
            effect = float(np.linalg.norm(left - self.residual))
        if self.remembered is not None:
            self.remembered.weak[place] = dict(start)
        one_sided = self._one_sided(candidate, start)
        near = self.current.reduced < _NEAR
        exact = self._slope(candidate, model, start, whole, one_sided) if near else None
        if exact is not None:
            left = self.residual + exact
            gain = 0.0  # of the trial itself: mostly what it bends, and fits straighten that
        factor, linear = self._factor(left)
        turned = factor < 0.0 and one_sided
        if turned:
            linear = -math.inf
        if vanishes and gain > max(linear, 0.0):
            x = seen  # a weaker one is of another shape
        elif turned:
            gain, x = min(gain, 0.0), self.vector(model, start)
        else:
            factor = float(np.clip(factor, -_STRONGEST, _STRONGEST))
            x = self.vector(model, stronger(candidate, start, factor))
        if plain > max(gain, linear):
            gain, x = plain, begun  # whatever slopes say of a weaker one
        return Trial(
            candidate,
            max(gain, linear),
            model,
            x,
            left - self.residual,
            dict(start),
            one_sided,
        )

    def _slope(
        self,
        candidate: Candidate,
        model: ImpactModel,
        start: Mapping[str, float],
        whole: Array,
        one_sided: bool,
    ) -> Array | None:
        """What cannot be re-tuned of an effect, in proportion to much weaker ones; at ``start``.

        Where nearly all of an effect is re-tuned, what seems left of a trial is how the rest bends
        under it, and the contacts that go to the other side. None where enough is left, or where
        a weaker one is not credible.

        ``whole``: residuals at ``start``, shape (n_residuals,).
        """
        size, now = self.current.layout.size, self.current.residuals
        felt = float(np.linalg.norm(whole[:size] - now[:size]))
        left = float(np.linalg.norm(self._out(whole) - self.residual))
        if left > _RE_TUNED * felt or felt == 0.0:
            return None
        begun = self.vector(model, start)
        rows, lengths = [], []
        try:
            for share in _SLIGHT:
                for way in (share / felt,) if one_sided else (share / felt, -share / felt):
                    x = self.vector(model, stronger(candidate, start, way))
                    if np.array_equal(x, begun):
                        return None
                    rows.append((self._residuals(model, x) - now) / way)
                    lengths.append(share)
        except ImpactscopeError:
            return None
        return self._out(weighted_median(np.stack(rows), np.array(lengths)))

    def _factor(self, left: Array) -> tuple[float, float]:
        """By how much an effect must be scaled to fit best, and what it then gains; linear."""
        effect = left - self.residual
        size = float(effect @ effect)
        if size < 1e-12:
            return 1.0, 0.0
        match = -float(effect @ self.residual)
        return match / size, match * match / size

    @staticmethod
    def _one_sided(candidate: Candidate, start: Mapping[str, float]) -> bool:
        if math.inf in candidate.amplitudes.values():
            return True
        return any(
            f.key in candidate.amplitudes
            and (f.lower == candidate.amplitudes[f.key] or f.upper == candidate.amplitudes[f.key])
            for f in candidate.free
            if f.key in start
        )

    def scaled(self, trial: Trial, rounds: int = 3) -> Trial:
        """A trial with its strength brought to where it fits best, by simulation."""
        candidate = trial.candidate
        alone = candidate.fitted or not candidate.amplitudes
        if alone or candidate.free[0].key in self.keys:
            return trial
        model, x = trial.model, trial.x
        best: Trial | None = None
        for _ in range(rounds):
            try:
                left = self._left(model, x)
            except ImpactscopeError:
                break
            gain = self.power - float(left @ left)
            if best is None or gain > best.gain:
                best = Trial(candidate, gain, model, x)
            factor, _ = self._factor(left)
            if abs(factor - 1.0) < 0.15 or not math.isfinite(factor):
                break
            values = model.values(x)
            start = {f.key: values[f.key] for f in candidate.free}
            x = self.vector(model, stronger(candidate, start, float(np.clip(factor, 0.05, 10))))
        return best or trial

    def _released(self, candidate: Candidate) -> Trial:
        """A number whose prior is let go: in the linear approximation, in closed form."""
        model = candidate.extend(self.current.model)
        j = self.keys.index(candidate.free[0].key)
        row = self.current.layout.size + j
        a = np.zeros(len(self.keys))
        a[j] = self.current.jacobian[row, j] / self.scale[j]
        normal = self.normal - np.outer(a, a)
        slope = self.slope - a * self.current.residuals[row]
        step = np.linalg.lstsq(normal, slope, rcond=1e-12)[0]
        residuals = self.current.residuals
        before = float(residuals @ residuals)
        after = before - float(residuals[row]) ** 2 - float(slope @ step)
        gain = self.power - after
        known = dict(zip(self.keys, self.current.x - step / self.scale, strict=True))
        x = np.array([known[f.key] for f in model.free])
        lower, upper = model.bounds()
        # where contacts amplify the least step, what is gained without any counts
        here = self.vector(model, {})
        return Trial(candidate, gain, model, np.clip(x, lower, upper), by_slope=here)

    def _freed(self, candidate: Candidate) -> Trial | None:
        """A stated number set free: by its slope where it stands.

        A length enters masses, speeds and moments of every blow, which the fitted numbers re-tune
        but for a small part. That part drowns in the curvature of the rest, and in the contacts
        that go to the other side, for any step that is long enough to be felt by itself.
        """
        (number,) = candidate.free
        stated = candidate.amplitudes[number.key]
        model = candidate.extend(self.current.model)
        x = self.vector(model, {number.key: stated})
        layout, j = self.current.layout, model.index(number.key)
        try:
            here = at_point(model, layout, x)
            norm = float(np.linalg.norm(jacobian(model, x, layout, here.residuals, [j])[:, j]))
            column = exact_slope(here, j, norm) if norm > 0.0 else None
        except ImpactscopeError:
            return None
        if column is None:
            return None
        slope = self._out(self._aligned(model, column))
        size, match = float(slope @ slope), -float(slope @ self.residual)
        if not size > 0.0:
            return None
        start = candidate.starts[0]
        step = number.to_inner(start[number.key]) - x[j]
        lower, upper = (bounds[j] - x[j] for bounds in model.bounds())
        most = _STRONGEST * abs(step)
        move = float(np.clip(match / size, max(lower, -most), min(upper, most)))
        x[j] += move
        return Trial(
            candidate,
            move * (2.0 * match - move * size),
            model,
            x,
            step * slope,
            dict(start),
            self._one_sided(candidate, start),
        )

    def best_refined(self, trials: Sequence[Trial]) -> Trial:
        """The best of some trials of a candidate, their strength and other numbers adjusted."""
        return max((self.refined(self.scaled(t)) for t in trials), key=lambda t: t.gain)

    def refined(self, trial: Trial, iterations: int = 2) -> Trial:
        """A trial with its own numbers adjusted, the others re-tuned in linear approximation."""
        new = [j for j, f in enumerate(trial.model.free) if f.key not in self.keys]
        if not new:
            return trial
        layout, model, x = self.current.layout, trial.model, trial.x.copy()
        lower, upper = model.bounds()
        try:
            residuals = model.residuals(x, layout)
            left = self._out(self._aligned(model, residuals))
            cost = float(left @ left)
            for _ in range(iterations):
                slopes = jacobian(model, x, layout, residuals, only=new)
                model = stepping(model, layout, slopes, only=new)
                slopes = slopes[:, new]
                columns = np.stack(
                    [self._out(self._aligned(model, slopes[:, k])) for k in range(len(new))], 1
                )
                scale = np.linalg.norm(columns, axis=0)
                scale[scale == 0.0] = 1.0
                step = -np.linalg.lstsq(columns / scale, left, rcond=1e-6)[0] / scale
                accepted = False
                for share in (1.0, 0.3, 0.1):
                    moved = x.copy()
                    moved[new] = np.clip(x[new] + share * step, lower[new], upper[new])
                    trial_residuals = model.residuals(moved, layout)
                    out = self._out(self._aligned(model, trial_residuals))
                    moved_cost = float(out @ out)
                    if moved_cost < cost - 0.01:
                        accepted = True
                        break
                if not accepted:
                    break
                fallen = cost - moved_cost
                x, residuals, left, cost = moved, trial_residuals, out, moved_cost
                if fallen < 0.02 * max(self.power - cost, 1.0):
                    break
        except ImpactscopeError:
            return trial
        gain = self.power - cost
        return Trial(trial.candidate, gain, model, x) if gain >= trial.gain else trial


def _is_stated(candidate: Candidate) -> bool:
    """Whether a candidate only sets a number free that the model has, and leaves it as it is."""
    if candidate.effects or candidate.constants or len(candidate.free) != 1:
        return False
    absent = candidate.amplitudes.get(candidate.free[0].key, math.inf)
    return math.isfinite(absent) and candidate.name == 'wrong_parameter'
