"""Comparison by chi-square, where a right model leaves the noise of the sensor alone.

Every sample counts there, and the fall of chi-square is that of Wilks' theorem.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.fits.friction_jumps import unsteady_turns
from impactscope.discrepancy.driven.fits.innovations import innovations
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.model_comparison import Gain, Judge
from impactscope.discrepancy.driven.model_selection.overdispersion import worth_of
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.terms import Term, key
from impactscope.discrepancy.evidence import Thresholds, family_p_value, least_gain

__all__ = [
    'LOOKS',
    'OWN',
    'PRICE',
    'NoiseJudge',
    'fitted_chi_square',
    'fitted_samples',
    'priced',
    'reduced',
    'slight',
]

Array = NDArray[np.float64]

PRICE = 7.0  # chi-square that a further number must bring to be preferred
EACH = 4.0  # the same for a further effect: two at once are rarer than one
OWN = 2.0  # the same for a number that one recording has of its own
# of the amplitude of what was found: a further effect as slight as that is the error of its law
SLIGHT = 3e-3
ROUGHLY = 0.03  # the same where single contacts decide
# the same of filters and clocks: how they act between samples, and of what shape they are; of dry
# friction whose turns fall between samples
BETWEEN = 0.01
# reduced chi-square of a model that leaves noise, and of one that leaves more: what leads from the
# one to the other is no error of a law
SOUND, UNSOUND = 1.5, 3.0
DELAYING = ('low_pass_filter', 'clock_error')
AT_THE_END = 0.003  # of the logarithm of a number's range, from the least that it may be
NEVER = 1e12  # chi-square that no gain makes up for
LOOKS = 60  # independent candidates, about


def slight(made: Fit) -> float:
    """Share of what a fit has gained that the error of its own laws may be."""
    if any(t.rough for t in made.terms):
        return ROUGHLY**2
    return (BETWEEN if any(t.name in DELAYING for t in made.terms) else SLIGHT) ** 2


def degenerate(made: Fit) -> bool:
    """Whether an effect is told by nothing but what every recording has of its own.

    A coupling whose corner is at the least that is allowed no longer fades within a recording:
    what it held of the time before is a level of each recording, which slow noise has as well.
    """
    return any(
        n.lower > 0.0 and made.values[key(t, n)] < n.lower * (n.upper / n.lower) ** AT_THE_END
        for t in made.terms
        if t.own
        for n in t.numbers
    )


def priced(fit: Fit, reference: Fit) -> float:
    """Chi-square that what a fit has beyond a reference must bring."""
    own = fit.own - reference.own
    shared = fit.added - reference.added - own
    return PRICE * shared + OWN * own + EACH * (len(fit.terms) - len(reference.terms))


class NoiseJudge(Judge):
    """Chi-square decides: residuals are the sensor's noise."""

    def __init__(
        self,
        segments: Sequence[Segment],
        muffled: Callable[[Fit], Sequence[float]] | None = None,
        thresholds: Thresholds | None = None,
        *,
        scatter: float = 0.0,
    ) -> None:
        """Judge of fits to some segments.

        Args:
            segments: recordings, or parts of them.
            muffled: by segment, chi-square that a fit takes from the input's noise on average.
            thresholds: chance that is given.
            scatter: by how many roots of that chance may take more: what is believed gains it
                beyond that, while of laws that explain alike none is behind for it.
        """
        super().__init__(segments, LOOKS, thresholds)
        self.muffled, self.scatter = muffled, scatter
        self.reference: Fit | None = None  # against which findings together are measured
        self._largest = 0.0  # gain of any fit that was seen
        self._known: dict[int, tuple[float, ...]] = {}
        self._muffled: dict[int, tuple[float, ...]] = {}

    def chi_squares(self, made: Fit) -> tuple[float, ...]:
        """Chi-square of each segment.

        A low-pass smooths the input's noise in the prediction, which is no merit of its own: what
        that brings is added again.
        """
        if id(made) not in self._known:
            parts = [innovations(s, r) for s, r in zip(self.segments, made.residuals, strict=True)]
            lost = (0.0,) * len(parts) if self.muffled is None else self.muffled(made)
            self._muffled[id(made)] = tuple(map(float, lost))
            self._known[id(made)] = tuple(
                float(p @ p) + float(more) for p, more in zip(parts, lost, strict=True)
            )
            self._keep.append(made)
        return self._known[id(made)]

    def weights(self, fit: Fit) -> tuple[float, ...]:  # noqa: ARG002
        """Samples that count in each segment: all."""
        return tuple(float(s.measured.size) for s in self.segments)

    def gain(self, small: Fit, large: Fit, weights: Sequence[float] | None = None) -> Gain:  # noqa: ARG002
        """Fall of chi-square from one fit to another.

        Of held-out recordings that of the deviance: numbers that the fitted ones do not tell for
        certain are not held against a law.
        """
        fitted = held_out = count = 0.0
        pairs = zip(self.segments, self.chi_squares(small), self.chi_squares(large), strict=True)
        for segment, before, after in pairs:
            if segment.held_out:
                held_out += before - after
            else:
                fitted += before - after
                count += segment.measured.size
        held_out += large.excused - small.excused
        worse = held_out < -self.thresholds.held_out_loss - 0.1 * max(fitted, 0.0)
        return Gain(fitted, held_out, worse, large.added - small.added, count)

    def worth(self, small: Fit, large: Fit) -> Gain:
        """The gain over the dispersion that the larger model leaves, less what chance may add."""
        gain = self.gain(small, large)
        pairs = zip(self.segments, small.residuals, large.residuals, strict=True)
        parts = [(s, innovations(s, old), innovations(s, new)) for s, old, new in pairs]
        plain = [float(old @ old - new @ new) for _, old, new in parts]
        before, after = [old for _, old, _ in parts], [new for _, _, new in parts]
        true = worth_of(before, after, [s.channel for s in self.segments])

        def total(of: Sequence[float], held: bool) -> float:
            return math.fsum(
                x for (s, _, _), x in zip(parts, of, strict=True) if s.held_out is held
            )

        fitted = gain.fitted - total(plain, False) + total(true, False)
        as_is, dispersed = total(plain, True), total(true, True)
        if gain.held_out > 0.0 and as_is > 0.0:  # what is excused of one is so of the other
            held_out = gain.held_out * min(dispersed / as_is, 1.0)
        else:
            held_out = gain.held_out - as_is + dispersed
        more, less = self._by_chance(large), self._by_chance(small)
        fitted, held_out = fitted - (more[0] - less[0]), held_out - (more[1] - less[1])
        return dataclasses.replace(gain, fitted=fitted, held_out=held_out)

    def _by_chance(self, made: Fit) -> tuple[float, float]:
        """Chi-square that a fit may take from the input's noise beyond the mean of it.

        Of fitted and of held-out recordings; both in the proportion of their means.
        """
        self.chi_squares(made)
        pairs = list(zip(self.segments, self._muffled[id(made)], strict=True))
        fitted = math.fsum(x for s, x in pairs if not s.held_out)
        if fitted <= 0.0:
            return 0.0, 0.0
        held_out = math.fsum(x for s, x in pairs if s.held_out)
        root = math.sqrt(fitted)
        return self.scatter * root, self.scatter * held_out / root

    def needed(self, gain: Gain) -> float:
        """Gain from which the larger model is believed."""
        return least_gain(max(gain.numbers, 1), self.looks, self.thresholds.false_finding)

    def better(self, small: Fit, large: Fit) -> bool:
        """Whether the larger model is to be believed."""
        return self._believed(small, large, self.looks)

    def fuller(self, plain: Fit, law: Fit) -> bool:
        """Whether a law that contains another one is to be believed in its place.

        Of two laws of one kind neither is likelier from the outset, and no others were looked at:
        it is asked whether chance would gain as much by its further numbers.
        """
        return self._believed(plain, law, 1)

    def _believed(self, small: Fit, large: Fit, places: int) -> bool:
        if degenerate(large):
            return False
        gain = self.gain(small, large)
        if gain.held_out_worse or gain.fitted < -1e-9:
            return False
        gain = self.worth(small, large)
        looks = round(places * _looks(small, large))
        least = least_gain(max(gain.numbers, 1), looks, self.thresholds.false_finding)
        if reduced(self, large) < SOUND and reduced(self, small) > UNSOUND:
            return gain.total > least  # no error of a law is explained to the noise
        return gain.total > least + self.beside(small, large)

    def beside(self, small: Fit, large: Fit | None = None) -> float:
        """Gain that says nothing beside what ``small`` has gained already.

        Of a hum, which ``large`` may have: the error of a filter or a clock is at frequencies
        where these act.
        """
        if self.reference is None or small is self.reference:
            return 0.0
        share = slight(small)
        jumps = any(t.rough for t in small.terms)
        if unsteady_turns(small.terms, small.values, self.segments):
            share, jumps = max(share, BETWEEN**2), True
        gained = share * max(self.gain(self.reference, small).fitted, 0.0)
        if large is None or jumps or not _hums(small, large):
            return gained
        return gained * self._same_lines(self.reference, small, large)

    def _same_lines(self, reference: Fit, small: Fit, large: Fit) -> float:
        """Share of what one fit has gained that lies at the lines of what another adds.

        An error of no more than a share of the former's effect at each line explains, along the
        latter's, no more than this part of it (Cauchy and Schwarz).
        """
        together = effect = added = 0.0
        parts = zip(
            self.segments, reference.residuals, small.residuals, large.residuals, strict=True
        )
        for s, first, then, last in parts:
            if s.held_out:
                continue
            mine = np.abs(np.fft.rfft(innovations(s, first - then)))
            new = np.abs(np.fft.rfft(innovations(s, then - last)))
            together += float(mine @ new)
            effect += float(mine @ mine)
            added += float(new @ new)
        return together**2 / (effect * added) if effect * added > 0.0 else 1.0

    def criterion(self, fit: Fit, reference: Fit) -> float:
        """Minus the gain over a reference, and a price for every number: smaller is better."""
        shared = fit.added - reference.added - (fit.own - reference.own)
        gain = self.gain(reference, fit)
        self._largest = max(self._largest, gain.fitted)
        price = priced(fit, reference) + (NEVER if degenerate(fit) else 0.0)
        if reduced(self, fit) < SOUND:
            return price - gain.total
        return price + slight(fit) * self._largest * shared - gain.total

    def p_value(self, small: Fit, large: Fit) -> float:
        """Chance of such a gain where nothing is missing."""
        gain = self.worth(small, large)
        looks = round(self.looks * _looks(small, large))
        return family_p_value(max(gain.total, 0.0), max(gain.numbers, 1), looks)


def _hums(small: Fit, large: Fit) -> bool:
    """Whether all that one fit has beyond another is a hum of the mains."""
    new = _beyond(small, large)
    return bool(new) and all(t.name == 'mains_hum' for t in new)


def _looks(small: Fit, large: Fit) -> float:
    """Places in which what one fit has beyond another was looked for."""
    return math.prod(t.looks for t in _beyond(small, large))


def _beyond(small: Fit, large: Fit) -> list[Term]:
    had = {t.label for t in small.terms}
    return [t for t in large.terms if t.label not in had]


def reduced(judge: NoiseJudge, made: Fit) -> float:
    """Chi-square of a fit over its samples, on the fitted recordings."""
    return fitted_chi_square(judge, made) / max(fitted_samples(judge), 1)


def fitted_chi_square(judge: NoiseJudge, made: Fit) -> float:
    """Chi-square of a fit on the fitted recordings."""
    pairs = zip(judge.segments, judge.chi_squares(made), strict=True)
    return math.fsum(chi for s, chi in pairs if not s.held_out)


def fitted_samples(judge: NoiseJudge) -> int:
    """Samples of the fitted recordings."""
    return sum(s.measured.size for s in judge.segments if not s.held_out)
