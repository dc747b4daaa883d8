"""A measuring chain: what stands between two channels; no mechanics.

Both ends have noise of their own. The input's noise does not pass the chain if the channel was
recorded beside it: a low-pass of the input then removes noise from the prediction and looks like
missing physics (errors in variables; Söderström, Automatica 43 (2007)). So it is found out from
the band without signal whether the output knows the input's noise; where it does not, filters
act on the band with signal alone, and the noise that they remove there is put back in judging.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.adequacy.channel_laws import channel_laws
from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.model_selection.chi_square import NoiseJudge
from impactscope.discrepancy.driven.models.channel_effects import channel_terms
from impactscope.discrepancy.driven.models.measuring_chain import (
    between_samples,
    count_in_motion,
    delayed,
    passed_on,
    power_passed,
    turned,
)
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.terms import Number, Term
from impactscope.discrepancy.driven.noise.input_rounding import rounding_of
from impactscope.discrepancy.driven.noise.noise_bands import (
    BANDS,
    Bands,
    band_levels,
    in_bands,
    quietest,
)
from impactscope.discrepancy.driven.systems.case import Case, Settled, throughout
from impactscope.discrepancy.driven.systems.chain_noise import (
    CLEAR_LINE,
    ChainNoise,
    both_noises,
    settled_ends,
)

__all__ = ['ChainModel', 'chain_case', 'linear_chain']

Array = NDArray[np.float64]

SIGNAL = 8.0  # times the noise: where a band has signal
SILENT = 0.15  # times the noise: where it has none
KNOWN = 0.3  # share of the input's noise that the output knows, if it passes the chain
# of what an output has in bands without signal, that goes with the input's: then noise has passed,
# and not a signal that is nowhere quiet
NEARLY_ALL = 0.99
LINES = 8  # of a band's spectrum that tell whether two channels go together
JOINED = 1.5  # lines of a spectrum that a Hann window makes one of
SURE = 5.0  # standard errors
ALIKE = 1.3  # ratio of the noise in two recordings, at most
WHITE = 1.05  # ratio of two levels that are the same
SCATTER = 6.0  # of a level from many lines of a spectrum, four standard errors
LITTLE = 0.15  # of a residual
MOST_OWN = 0.97  # of a residual
LEAST = 3  # bands that tell a level
LINE = 12.0  # times the median: a line of a signal
PASSED = 0.9  # share of the power
QUARTER = BANDS // 4


@dataclass(frozen=True, eq=False)
class ChainModel:
    """A chain of parts.

    ``drive`` is the input, shape (2 to 4, n): what filters see; what they do not; the quantity as
    both channels tell it; and what of the second is noise alone, which no clock moves: noise
    elsewhere would fit the output's by chance as well.
    """

    numbers: tuple[Number, ...]
    terms: tuple[Term, ...]
    _last: dict[str, Any] = field(default_factory=dict, repr=False)  # input on another clock

    def starts(self, segment: Segment) -> tuple[Number, ...]:  # noqa: ARG002
        """A chain begins with its first sample."""
        return ()

    @property
    def drifts(self) -> bool:
        """Nothing accumulates here."""
        return False

    def predict(
        self,
        values: Mapping[str, float],
        terms: tuple[Term, ...],
        start: Array,  # noqa: ARG002
        segment: Segment,
    ) -> Array:
        """Output channel, shape (n,)."""
        parts = {t.name: t for t in terms}
        gain = values.get('gain', 1.0)
        seen, beyond = segment.drive[:2]
        if 'wrong_parameter' in parts:
            # of the quantity as both channels tell it: the input's noise would lower the gain
            known = segment.drive[2] if len(segment.drive) > 2 else seen + beyond
            seen = seen + values[f'{parts["wrong_parameter"].label}.excess'] * known
        still = segment.drive[3] if len(segment.drive) > 3 else np.zeros(seen.size)
        if 'clock_error' in parts:
            clock = parts['clock_error'].label
            offset, drift = values.get(f'{clock}.offset', 0.0), values.get(f'{clock}.drift', 0.0)
            moved = np.stack([seen, beyond - still])
            seen, beyond = self._retimed(segment, moved, offset, drift)
            beyond = beyond + still
        filters = parts.get('low_pass_filter')
        if filters is not None and len(segment.drive) > 3:
            # what is faint comes as late as by a clock, or a clock would explain more
            cutoff = values[f'{filters.label}.cutoff']
            beyond = turned(filters, cutoff, beyond - still, 1.0 / segment.period) + still
        seen, beyond = gain * seen, gain * beyond
        made = passed_on(
            seen,
            parts,
            values,
            segment.period,
            segment.begin,
            beyond=beyond,
            measured=segment.measured,
        )
        if isinstance(segment.whitener, ChainNoise):
            return segment.whitener.evened(made, terms, values, segment)
        return made

    def _retimed(
        self, segment: Segment, drive: Array, offset: float, drift: float
    ) -> tuple[Array, Array]:
        """The input as a clock has it whose stamp is t (1 + drift) + offset."""
        if drift == 0.0:
            seen, beyond = (
                delayed(part, offset, segment.period) if offset != 0.0 and np.any(part) else part
                for part in drive
            )
            return seen, beyond
        last = self._last.get(segment.recording)
        if last is None or not np.array_equal(last[0], drive):
            courses = [between_samples(part, segment.period) for part in drive]
            last = self._last[segment.recording] = drive, courses
        time = segment.period * np.arange(segment.measured.size)
        place = np.clip((time - offset) / (1.0 + drift), 0.0, time[-1])
        seen, beyond = (np.asarray(c(place)) for c in last[1])
        return seen, beyond

    def motion(
        self,
        values: Mapping[str, float],  # noqa: ARG002
        terms: tuple[Term, ...],  # noqa: ARG002
        start: Array,  # noqa: ARG002
        segment: Segment,  # noqa: ARG002
    ) -> tuple[Array, Array]:
        """Nothing moves in a chain."""
        return np.zeros(0), np.zeros(0)


def linear_chain(cuts: Sequence[Cut]) -> tuple[ChainModel, list[Segment], Fit]:
    """The output as the input, times a gain where the units differ; with candidates."""
    segments = []
    for c in cuts:
        assert c.drive is not None  # noqa: S101 - a chain always has an input
        segments.append(
            Segment(
                c.recording,
                c.channel,
                c.unit,
                c.held_out,
                c.begin,
                1.0 / c.rate,
                c.output,
                np.stack([c.drive, np.zeros(c.drive.size)]),
                noise=c.noise,
            )
        )
    fitted = [s for s in segments if not s.held_out]
    drive = np.concatenate([s.drive[0] for s in fitted])
    output = np.concatenate([s.measured for s in fitted])
    below = float(drive @ drive)
    gain = float(drive @ output) / below if below > 0.0 else 1.0
    same = cuts[0].unit == cuts[0].drive_unit
    numbers: tuple[Number, ...] = ()
    if not same:
        scale = abs(gain) or 1.0
        numbers = (Number('gain', f'{cuts[0].unit}/{cuts[0].drive_unit}', (gain,), scale),)
    made = fit(ChainModel(numbers, ()), (), segments, {}, tolerance=FINE)
    lag = _lag(fitted, made)
    terms = channel_terms(
        cuts[0].channel,
        cuts[0].unit,
        cuts[0].rate,
        max(c.output.size for c in cuts) / cuts[0].rate,
        math.sqrt(_lowest(band_levels([made.residuals[i] for i in _fitted(segments)]))),
        float(np.max(np.abs(output))) or 1.0,
        delays=(lag,) if lag != 0.0 else (),
        gain=same,
        recordings=len(segments),
        ends=count_in_motion([s.drive[0] for s in segments]),
    )
    return ChainModel(numbers, tuple(terms)), segments, made


def _fitted(segments: Sequence[Segment]) -> list[int]:
    return [i for i, s in enumerate(segments) if not s.held_out]


def _lowest(levels: Array) -> float:
    """Level of the quietest quarter of the bands."""
    return float(np.mean(np.sort(levels)[:QUARTER])) or 1e-300


def _lag(fitted: Sequence[Segment], made: Fit) -> float:
    """By how much the output comes later than the input, s, to a sample."""
    del made
    longest = max(s.measured.size for s in fitted)
    length = 1 << (2 * longest - 1).bit_length()
    total = np.zeros(length)
    for s in fitted:
        u, y = np.diff(s.drive[0]), np.diff(s.measured)
        total += np.fft.irfft(np.conj(np.fft.rfft(u, length)) * np.fft.rfft(y, length), length)
    best = int(np.argmax(np.abs(total)))
    best = best - length if best > length // 2 else best
    return best * fitted[0].period if abs(best) < longest // 5 else 0.0


def chain_case(
    model: ChainModel, segments: Sequence[Segment], made: Fit, found: Fit | None = None
) -> Case | None:
    """A chain as one in which noise is all that a right model leaves; None if that is nothing.

    Args:
        model: of the chain.
        segments: of all recordings.
        made: fit of the baseline.
        found: a fit that leaves less, from which the noise is known better.
    """
    both = both_ends(model, segments, made)
    if both is not None:
        return both
    fitted = _fitted(segments)
    rate = 1.0 / segments[0].period
    inputs = [segments[i].drive[0] + segments[i].drive[1] for i in fitted]
    outputs = [segments[i].measured for i in fitted]
    into, out = [band_levels([u]) for u in inputs], [band_levels([y]) for y in outputs]
    tops, floor = _floor(into)
    tops = [max(top, _last_line(u, floor)) for top, u in zip(tops, inputs, strict=True)]
    top = max(tops)
    corner = 0.5 * rate * top / BANDS
    left = band_levels([made.residuals[i] for i in fitted])
    below = above = quietest([made.residuals[i] for i in fitted], 2 * QUARTER)
    if top <= BANDS - LEAST:
        below = above = float(np.mean(left[top:]))
    known = made if found is None else found
    expected = [band_levels([segments[i].measured - known.residuals[i]]) for i in fitted]
    own = _own(expected, out, [band_levels([known.residuals[i]]) for i in fitted])
    alike, shared = _noise_passed(inputs, outputs, into, floor, tops)
    passes = (own < LITTLE and alike) or shared > NEARLY_ALL
    if passes or (found is not None and _white(model, found, segments, top)):
        corner = math.inf
    if found is not None:
        below = _inside(found, segments, top if math.isfinite(corner) else BANDS, below)
        beyond = band_levels([found.residuals[i] for i in fitted])[top:]
        if beyond.size >= LEAST:
            above = min(above, float(np.mean(beyond)))
        if passes:  # what a filter takes of the input's noise, it has taken of the output's
            below = min(below, quietest([found.residuals[i] for i in fitted], 2 * QUARTER))
        above = below if math.isinf(corner) else above
    if not below > 0.0 or not above > 0.0:
        return None
    whitener = Bands(math.sqrt(below), math.sqrt(above), corner, segments[0].period)
    between = 0.0 if passes else own
    if math.isinf(corner):
        own = 0.0
    sigma = math.sqrt(below)
    ready = [
        dataclasses.replace(
            s,
            noise=sigma,
            whitener=dataclasses.replace(whitener, rounding=rounding_of(s.drive[0], sigma)),
            drive=_split(s, corner, between),
        )
        for s in segments
    ]
    judge = NoiseJudge(ready, _muffled(ready, own, corner))
    baseline = fit(model, (), ready, made.values, tolerance=FINE)
    return Case(
        model,
        ready,
        baseline,
        judge,
        channel_laws,
        throughout(ready),
        {segments[0].channel: sigma},
        _settled(model, ready, own) if own > 0.0 else None,
    )


def both_ends(model: ChainModel, segments: Sequence[Segment], made: Fit) -> Case | None:
    """A chain whose ends each have noise that their quiet bands tell; None where they do not."""
    fitted = _fitted(segments)
    inputs = [segments[i].drive[0] + segments[i].drive[1] for i in fitted]
    outputs = [segments[i].measured for i in fitted]
    noises = both_noises(inputs, outputs)
    if noises is None:
        return None
    gain = made.values.get('gain', 1.0)
    ready = []
    for s in segments:
        into, out = (np.full(s.measured.size // 2 + 1, noise) for noise in noises)
        whitener, drive = ChainNoise.of(s, into, out, gain)
        ready.append(
            dataclasses.replace(s, noise=whitener.typical, whitener=whitener, drive=drive)
        )
    baseline = fit(model, (), ready, made.values, tolerance=FINE)
    return Case(
        model,
        ready,
        baseline,
        NoiseJudge(ready),
        channel_laws,
        throughout(ready),
        {segments[0].channel: math.sqrt(noises[1])},
        settled_ends(model, ready),
    )


def _settled(model: ChainModel, segments: Sequence[Segment], own: float) -> Settled:
    """How a fit looks with the input as both channels together tell it.

    A share of the residual is the input's noise: so much of it belongs to the input. What a fit
    leaves is then in no way correlated with the input any more (errors in variables).
    """
    share = min(own, MOST_OWN)

    def settled(made: Fit) -> tuple[Fit, list[Segment]]:
        better, residuals = [], []
        gain = made.values.get('gain', 1.0)
        for i, s in enumerate(segments):
            assert isinstance(s.whitener, Bands)  # noqa: S101 - as made above
            whole = s.drive[:2].sum(axis=0) + share * made.residuals[i] / gain
            whitener = dataclasses.replace(
                s.whitener,
                below=(1.0 - share) * s.whitener.below,
                above=(1.0 - share) * s.whitener.above,
            )
            known = dataclasses.replace(
                s, drive=np.stack([whole, np.zeros(whole.size)]), whitener=whitener
            )
            known = dataclasses.replace(known, drive=_split(known, s.whitener.corner))
            better.append(known)
            predicted = model.predict(made.values, made.terms, made.starts[i], known)
            residuals.append((1.0 - share) * made.residuals[i])
            better[-1] = dataclasses.replace(known, measured=predicted + residuals[-1])
        return dataclasses.replace(made, residuals=tuple(residuals)), better

    return settled


def _own(expected: Sequence[Array], out: Sequence[Array], left: Sequence[Array]) -> float:
    """Share of the residual's power that is the input's noise, from levels by band, (BANDS,).

    The signal is in the prediction and in the output alike: the difference of their spectra is
    that of their noises, and the residual's level, in the same bands, is the sum of these.
    """
    weights, differences, sums = [], [], []
    for u, y, e in zip(expected, out, left, strict=True):
        quiet = np.argsort(u)[:QUARTER]
        level = float(np.mean(e[quiet]))
        weights.append(1.0 / (u[quiet] + y[quiet] + level) ** 2)  # a loud band scatters more
        differences.append(u[quiet] - y[quiet])
        sums.append(e[quiet])
    weight = np.concatenate(weights)
    mean = np.average(np.concatenate(differences), weights=weight)
    level = np.average(np.concatenate(sums), weights=weight)
    return float(np.clip(0.5 * (1.0 + mean / level), 0.0, 1.0))


def _white(model: ChainModel, found: Fit, segments: Sequence[Segment], top: int) -> bool:
    """Whether a low-pass that was found makes the residual white with all of the input."""
    if all(t.name != 'low_pass_filter' for t in found.terms) or top > BANDS - LEAST:
        return False
    fitted = _fitted(segments)
    left = []
    for i in fitted:
        whole = dataclasses.replace(segments[i], drive=_split(segments[i], math.inf))
        predicted = model.predict(found.values, found.terms, found.starts[i], whole)
        left.append(segments[i].measured - predicted)
    levels = band_levels(left)
    lines = sum(x.size for x in left) * min(top, BANDS - top) / (2.0 * BANDS)
    same = WHITE + SCATTER / math.sqrt(lines)
    return bool(float(np.mean(levels[:top])) < same * float(np.mean(levels[top:])))


def _floor(levels: Sequence[Array]) -> tuple[list[int], float]:
    """Number of each recording's bands up to the last with signal, and the noise beyond."""
    tops, floors = [], []
    for level in levels:
        lowest = _lowest(level)
        for _ in range(2):
            top = _top(level, lowest)
            if top <= BANDS - LEAST:
                lowest = float(np.mean(level[top:]))
        tops.append(top)
        floors.append(lowest)
    near = [f for f in floors if f <= ALIKE * min(floors)]
    floor = float(np.mean(near))
    return [_top(level, floor) for level in levels], floor


def _inside(found: Fit, segments: Sequence[Segment], top: int, known: float) -> float:
    """Level of what a fit leaves in the bands with signal that its filters let pass.

    ``known``: level elsewhere, which a misfit must not raise.
    """
    rate = 1.0 / segments[0].period
    centres = (np.arange(BANDS) + 0.5) * 0.5 * rate / BANDS
    passed = power_passed(found.terms, found.values, centres, rate) > PASSED
    passed[top:] = False
    if np.count_nonzero(passed) < LEAST:
        return known
    left = band_levels([found.residuals[i] for i in _fitted(segments)])
    return min(float(np.mean(left[passed])), known)


def _top(levels: Array, floor: float) -> int:
    """Number of the bands up to the last with signal."""
    loud = np.flatnonzero(levels > (1.0 + SIGNAL) * floor)
    return int(loud[-1]) + 1 if loud.size else 1


def _last_line(samples: Array, floor: float) -> int:
    """Number of the bands up to the last with a line of a signal.

    The few lines of a multisine are not seen in the median of a band.
    """
    power, edges = in_bands(samples)
    clear = np.flatnonzero(power > CLEAR_LINE * floor)
    return int(np.searchsorted(edges, clear[-1], 'right')) if clear.size else 0


def _noise_passed(
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    levels: Sequence[Array],
    floor: float,
    tops: Sequence[int],
) -> tuple[bool, float]:
    """Whether the output has the input's noise about as it is, and its share of the output's.

    From the first bands without signal. A low-pass may leave little of the input's noise, and yet
    nearly all of the output's comes from it: that goes with the input's, whatever the gain.
    """
    cross = power = other = count = shared = told = 0.0
    for u, y, level, top in zip(inputs, outputs, levels, tops, strict=True):
        window = np.hanning(u.size)
        a, b = np.fft.rfft(window * (u - np.mean(u))), np.fft.rfft(window * (y - np.mean(y)))
        edges = np.linspace(1, a.size, BANDS + 1).astype(int)
        quiet = [k for k in range(top, BANDS) if level[k] < (1.0 + SILENT) * floor][:QUARTER]
        for k in quiet:
            loud = np.abs(a[edges[k] : edges[k + 1]]) ** 2
            part = edges[k] + np.flatnonzero(loud < LINE * np.median(loud))  # no line of a signal
            into, out = a[part], b[part]
            cross += float(np.real(np.vdot(into, out)))
            power += float(np.sum(np.abs(into) ** 2))
            other += float(np.sum(np.abs(out) ** 2))
            count += (edges[k + 1] - edges[k]) / JOINED
            if into.size >= LINES:
                shared += _going_with(into, out)
                told += float(np.sum(np.abs(out) ** 2))
    if not power > 0.0 or not other > 0.0:
        return False, 0.0
    gain = cross / power
    alike = gain > KNOWN and gain > SURE * math.sqrt(other / power / (2.0 * count))
    return alike, shared / told if told > 0.0 else 0.0


def _going_with(into: NDArray[np.complex128], out: NDArray[np.complex128]) -> float:
    """Power of lines that go with those of an input, shape (n,), less what goes so by chance.

    What passes is turned a little more from line to line.
    """
    turning = np.stack([into, into * np.linspace(-1.0, 1.0, into.size)], axis=1)
    along = np.asarray(turning @ np.linalg.lstsq(turning, out, rcond=None)[0])
    by_chance = turning.shape[1] * JOINED * float(np.mean(np.abs(out - along) ** 2))
    return float(np.sum(np.abs(along) ** 2) - by_chance)


def _split(segment: Segment, corner: float, between: float = 0.0) -> Array:
    """Input as the parts of a model: below a frequency, the rest, both channels', noise, (4, n).

    ``between``: where the quantity lies on the way from the input to the output.
    """
    whole = segment.drive[0] + segment.drive[1]
    known = whole + between * (segment.measured - whole)
    if math.isinf(corner):
        none = np.zeros(whole.size)
        return np.stack([whole, none, known, none])
    n = whole.size
    ramp = np.linspace(whole[0], whole[-1], n)  # so that the ends meet
    spectrum = np.fft.rfft(whole - ramp)
    spectrum[np.fft.rfftfreq(n, segment.period) <= corner] = 0.0
    above = np.fft.irfft(spectrum, n)
    return np.stack([whole - above, above, known, above])


def _muffled(
    segments: Sequence[Segment], own: float, corner: float
) -> Callable[[Fit], Sequence[float]]:
    """Chi-square that a fit's filters take from the input's own noise, by segment."""

    def lost(made: Fit) -> Sequence[float]:
        rate = 1.0 / segments[0].period
        frequency = np.linspace(0.0, 0.5 * rate, 2048)[1:-1]
        share = 1.0 - power_passed(made.terms, made.values, frequency, rate)
        share[frequency > corner] = 0.0
        mean = own * float(np.mean(share))
        return [mean * s.measured.size for s in segments]

    return lost
