"""Noise that is slower than the quiet before the blows, read from what a model leaves.

The quiet before a blow is short, and an impactor swings in it. Slow noise that is not seen there
leaves what a coupling, a drift or a creeping force would leave, and passes for one. While a bench
rests, no physics is at work: what a model leaves there is noise. Where the quiet before the blows
is not white already, if only in another channel, all that is left after them tells more of its
colour. So it does of an impactor, which has no quiet, where the other channels are left with
nothing but noise. Colours are compared by their likelihood, which Kalman's filter gives.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.evidence import information
from impactscope.discrepancy.impact.data.binning import BinnedChannel
from impactscope.discrepancy.impact.data.blows import BlowData
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.noise.coloured_noise import Colour
from impactscope.discrepancy.impact.noise.whitening import whitener
from impactscope.discrepancy.parallel import in_parallel

__all__ = ['likelier', 'noise_left']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_BEFORE = 2e-3  # s before the onset up to which nothing has happened
_SWING = 3.0  # times its noise, that a channel may change while a bench is at rest ...
_STRUCK = 0.03  # s after the onset, from which a channel counts that has no quiet before it
_WITHIN = 0.02  # s, to either side
_FEWEST = 60  # bins
_GAIN = 16.0  # twice the logarithm of the likelihood, from which noise is slower than was known
_GAIN_BESIDE = 5.0  # likewise where the noise of another channel is not white
_DENIED = (
    3.0  # logarithm of the likelihood, by which the quiet before the blows may speak against it
)
_MET = 1.2  # mean square of what is left of the other channels
_APART = 2.0  # ratio of the times in which parts forget
_ADDED = 3  # shapes, one after the other
_LIVES = 2  # steps between the single parts that are tried
_LEVELS = tuple(float(v) for v in np.geomspace(3e-3, 30.0, 13))  # of the variance that is known
_COARSE = 3  # every so many of these are tried, then those beside the best
_FINER = (0.5, 0.7, 1.4, 2.0)  # times the best of these
_SLOPES = (0.0, 1.0)  # powers of the time in which a part forgets: pink, brown noise


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """What a fit leaves of a channel of one blow at rest; arrays over its bins."""

    centres: Array  # s
    counts: IntArray
    left: Array  # in the channel's unit
    own: Array  # variance that is not of the noise

    def part(self, mask: NDArray[np.bool_]) -> _Stretch:
        """Some of its bins."""
        return _Stretch(self.centres[mask], self.counts[mask], self.left[mask], self.own[mask])


def noise_left(found: Fit) -> dict[str, Colour]:
    """Channels whose noise is slower than was taken into account, with what it is like.

    Channels of one converter have noise of one kind: where one shows it, others are asked again.
    """
    slower: dict[str, Colour] = {}
    known: set[str] | None = None
    while known is None or known != set(slower):
        known = set(slower)
        coloured = _coloured(found) | known
        for name in found.model.data.channels:
            if name not in slower:
                best = _slower_than_known(found, name, beside=bool(coloured - {name}))
                if best is not None:
                    slower[name] = best
    return slower


def _slower_than_known(found: Fit, name: str, *, beside: bool) -> Colour | None:
    """The noise of a channel where it is slower than is known.

    ``beside``: that of another channel is not white.
    """
    stretches, known, rate = _at_rest(found, name, beside=beside)
    if sum(s.left.size for s, _ in stretches) < _FEWEST or known is None:
        return None
    best = _slower([s for s, _ in stretches], known, rate, beside=beside)
    if best is None:
        return None
    quiet = [q for _, q in stretches if q is not None]
    if quiet:
        borne_out = _likelihood(quiet, best) > _likelihood(quiet, known) - _DENIED
    else:
        borne_out = _others_met(found, name)
    return best if borne_out else None


def likelier(found: Fit, instead: Fit, slower: Mapping[str, Colour], numbers: int = 1) -> bool:
    """Whether findings explain better what slower noise explains without them.

    Each in the noise that suits it best: a drift that all recordings share is hardly noise. Where
    findings bring more numbers, these have their price (Bayesian information criterion).

    Args:
        found: a fit with the findings, in the noise that was known.
        instead: a fit without them, in slower noise.
        slower: that noise, by channel.
        numbers: that ``found`` has beyond ``instead``.
    """
    ahead = 0.0
    coloured = _coloured(found) | set(slower)
    for name, colour in slower.items():
        beside = bool(coloured - {name})
        mine, known, rate = _at_rest(found, name, beside=beside)
        other, _, _ = _at_rest(found, name, instead, beside=beside)
        if known is None or not mine:
            return False
        with_findings, without = [s for s, _ in mine], [s for s, _ in other]
        own = _slower(with_findings, known, rate, beside=beside) or known
        noises = (known, own, colour)  # what was found for the one may suit the other better
        ahead += _best(with_findings, noises) - _best(without, noises)
    return information(-2.0 * ahead, numbers, found.layout.size) < 0.0


def _best(stretches: list[_Stretch], noises: Iterable[Colour]) -> float:
    """Logarithm of the likelihood of what is left, in the noise that suits it best."""
    return max(_likelihood(stretches, c) for c in noises)


def _coloured(found: Fit) -> set[str]:
    """Channels whose noise is not white already in the quiet before the blows."""
    blows = found.model.data.blows
    return {n for b in blows for n, c in b.channels.items() if c.colour is not None}


def _others_met(found: Fit, name: str) -> bool:
    """Whether all channels but one are left with no more than noise."""
    parts = [found.residuals[s] for (_, other), s in found.layout.spans.items() if other != name]
    left = np.concatenate(parts) if parts else np.zeros(0)
    return left.size > 0 and float(left @ left) < _MET * left.size


def _at_rest(
    found: Fit, name: str, instead: Fit | None = None, *, beside: bool = False
) -> tuple[list[tuple[_Stretch, _Stretch | None]], Colour | None, float]:
    """What is left of a channel while nothing moves, the noise as it was taken, the rate.

    Of each blow all of it, and what lies before the blow where that is compared at all; of another
    fit ``instead`` what it leaves of the same stretches. ``beside``: the noise of another channel
    is not white.
    """
    model, values = found.model, found.values
    instead = found if instead is None else instead
    other = dataclasses.replace(instead.model, data=model.data)  # by the same bins
    stretches: list[tuple[_Stretch, _Stretch | None]] = []
    known: Colour | None = None
    rate = math.nan
    white = not beside and not _coloured(found)
    for i in found.layout.blows:
        blow = model.data.blows[i]
        channel = blow.channels.get(name)
        if channel is None:
            continue
        predicted = model.predict(values, i).means
        left_by = predicted if instead is found else other.predict(instead.values, i).means
        since = channel.centres - blow.onset
        mask = found.layout.masks[i, name]
        quiet = since < -_BEFORE
        if np.any(mask & quiet) and white:
            mask = mask & (quiet | _resting(blow, predicted, channel.centres))
        else:
            mask = mask & (quiet | (since > _STRUCK))
        if known is None:
            known = channel.colour or Colour(
                channel.noise**2, np.zeros(0), np.zeros(0), channel.sample_rate
            )
            rate = channel.sample_rate
        if channel.sample_rate != rate or np.count_nonzero(mask) < 2:
            continue
        noise = known.variance_of_means(channel.counts)
        whole = _Stretch(
            channel.centres,
            channel.counts,
            channel.means - left_by[name],
            _own(channel, noise, known),
        )
        before = mask & (since < 0.0)
        enough = np.count_nonzero(before) > 1
        stretches.append((whole.part(mask), whole.part(before) if enough else None))
    return stretches, known, rate


def _own(channel: BinnedChannel, noise: Array, known: Colour) -> Array:
    """Variance of each bin that is not of the noise, shape (n_bins,).

    What two sound simulations may differ by is allowed for where it is more than what is fresh in
    a sample. Where it is less it would take the place of noise, which the colour then lacks.
    """
    repeated = np.maximum(channel.std**2 - channel.own_std**2, 0.0)
    allowed = np.maximum(channel.own_std**2 - noise, 0.0)
    return np.asarray(repeated + np.where(allowed > known.fresh**2, allowed, 0.0))


def _resting(blow: BlowData, predicted: Mapping[str, Array], moments: Array) -> NDArray[np.bool_]:
    """Whether the bench is simulated to be about at rest at each moment, shape as ``moments``."""
    still = np.ones(moments.size, dtype=np.bool_)
    for name, course in predicted.items():
        channel = blow.channels[name]
        first = np.searchsorted(channel.centres, channel.centres - _WITHIN)
        last = np.searchsorted(channel.centres, channel.centres + _WITHIN, side='right')
        edges = np.stack([first, np.maximum(last, first + 1)], axis=1).ravel()
        ended = np.append(course, course[-1])  # reduceat wants a value beyond the last
        swing = np.maximum.reduceat(ended, edges)[::2] - np.minimum.reduceat(ended, edges)[::2]
        moving = np.interp(moments, channel.centres, swing) > _SWING * channel.noise
        still &= ~moving
    return still & (moments > blow.settled)


def _likelihood(stretches: list[_Stretch], colour: Colour) -> float:
    """Logarithm of the likelihood of what is left, but for a constant."""
    total = 0.0
    for s in stretches:
        std = np.sqrt(colour.variance_of_means(s.counts) + s.own)
        white = whitener(colour, s.centres, s.counts, std)
        left = white(s.left / std)
        total += float(np.sum(np.log(white.scale / std))) - 0.5 * float(left @ left)
    return total


def _slower(
    stretches: list[_Stretch], known: Colour, rate: float, *, beside: bool = False
) -> Colour | None:
    """The likeliest noise with slow parts beside what is known; None where that does.

    ``beside``: the noise of another channel is not white, so that fainter parts are believed.
    """
    gain = _GAIN_BESIDE if beside else _GAIN  # that each further part must bring
    longest = max(float(s.centres[-1] - s.centres[0]) for s in stretches)
    reached, found = _likelihood(stretches, known), known
    if known.variances.size:
        # what a short quiet has taken for many parts may be one
        alone = dataclasses.replace(known, variances=np.zeros(0), times=np.zeros(0))
        lives = _lives(longest * rate).tolist()
        single = [
            _with(alone, {life: 1.0}, level * known.std**2, rate)
            for life, level in itertools.product(lives, _LEVELS)
        ]
        tried = [(_likelihood(stretches, c), c) for c in single]
        reached, found = max([(reached, known), *tried], key=lambda t: t[0])
    least = _likelihood(stretches, known) + 0.5 * gain
    for _ in range(_ADDED):
        added = functools.partial(_levelled, stretches, found, known.std**2, rate)
        tried = in_parallel(added, list(_shapes(longest * rate)))
        best = max([(reached, found), *tried], key=lambda t: t[0])
        if 2.0 * (best[0] - reached) < gain:
            break
        reached, found = best
    return None if found is known or reached < least else found


def _levelled(
    stretches: list[_Stretch],
    known: Colour,
    unit: float,
    rate: float,
    shape: Mapping[float, float],
) -> tuple[float, Colour]:
    """A colour with further parts of a shape, at their likeliest level, after its likelihood.

    ``unit``: variance over which levels are tried.
    """
    shown: dict[float, tuple[float, Colour]] = {}

    def best_of(levels: Iterable[float]) -> float:
        for level in levels:
            if level not in shown:
                colour = _with(known, shape, level * unit, rate)
                shown[level] = _likelihood(stretches, colour), colour
        return max(shown, key=lambda level: shown[level][0])

    near = _LEVELS.index(best_of(_LEVELS[::_COARSE]))
    level = best_of(_LEVELS[max(near - 1, 0) : near + 2])
    return shown[best_of(level * f for f in _FINER)]


def _shapes(longest: float) -> Iterator[Mapping[float, float]]:
    """Shares of parts by the time in which they forget, in samples."""
    lives = _lives(longest)
    for slope in _SLOPES:
        shares = lives**slope
        yield dict(zip(lives.tolist(), (shares / np.max(shares)).tolist(), strict=True))
    for life in lives[2 * _LIVES :: _LIVES].tolist():
        yield {life: 1.0}


def _lives(longest: float) -> Array:
    """Times in which parts may forget, in samples, up to beyond a stretch of that length."""
    count = 2 + math.ceil(math.log(4.0 * max(longest, 2.0), _APART))
    return 0.5 * np.power(_APART, np.arange(count, dtype=np.float64))


def _with(known: Colour, shape: Mapping[float, float], level: float, rate: float) -> Colour:
    """A colour with further parts, of which the largest has the variance ``level``."""
    lives = (known.times * rate).round(6).tolist()
    parts = dict(zip(lives, known.variances.tolist(), strict=True))
    for life, share in shape.items():
        parts[round(life, 6)] = parts.get(round(life, 6), 0.0) + share * level
    total = known.white + sum(parts.values())
    kept = {life: v for life, v in sorted(parts.items()) if v > 1e-4 * total}
    return dataclasses.replace(
        known,
        variances=np.array(list(kept.values())),
        times=np.array(list(kept)) / rate,
    )
