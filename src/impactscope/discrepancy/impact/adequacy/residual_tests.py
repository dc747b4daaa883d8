"""Tests whether a fitted model leaves only noise, with power against what physics would leave.

A weak effect lifts the reduced chi-square of ten thousand samples by less than its own scatter.
But what an unknown effect leaves lies where the bench can move. Three kinds of tests look there.

Constancy of the numbers: were each shared number allowed a value of its own in every recording,
in every channel, and in every stretch of time, by how much would chi-square fall? With the right
model by one for each further number; with a wrong one the numbers have to differ between strong
and weak blows, between channels, between the loaded plate and the free one.

Laws that no mechanism here has, along the motion that was fitted: see :mod:`.bench_laws`.

Colour: the power of what is left in bands of frequency, against white noise.

Level: the power of what is left after a blow, at all frequencies, or where the noise is not white
above those bands, against the quiet before it.

All count what is left in units of the noise as the residual itself shows it from sample to
sample, so that a noise that is stated or estimated a little wrong is no finding.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft, integrate, stats

from impactscope.discrepancy.impact.adequacy.bench_laws import GROUPS, Law, law_responses
from impactscope.discrepancy.impact.adequacy.channel_laws import chain_laws
from impactscope.discrepancy.impact.candidates.candidate import Candidate, stronger
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.data.blows import BlowData
from impactscope.discrepancy.impact.fits.least_squares import Fit, fit, projector
from impactscope.discrepancy.impact.noise.coloured_noise import slowest_seen
from impactscope.discrepancy.impact.noise.whitening import whitener
from impactscope.discrepancy.parallel import in_parallel
from impactscope.errors import ImpactscopeError
from impactscope.physics.mechanisms.registry import all_mechanisms

__all__ = [
    'LONE',
    'TESTED',
    'TOLD',
    'Adequacy',
    'adequacy',
    'law_instead',
    'rounding_error',
    'without_lone',
]

LONE = 3  # samples that must not decide anything
TOLD = 9.0  # chi-square that each of them may tell at most

TESTED = 0.35
"""s after the onset up to which what is left of a blow is tested; taps are tested whole."""

Array = NDArray[np.float64]

_SEGMENTS = (0.03, 0.12)  # s after the onset: the blow, what follows it, the rest
_ALLOWED = 0.03  # of the noise of a sample: what two sound simulations may differ by
_FELT = 10.0  # norm of a weak effect
_ALLOWED_ALONE = 0.007  # likewise, along one direction: half the largest of another solver
_BANDS = (60.0, 400.0)  # Hz, upper edges
_SHORT_QUIET = 0.05  # s before a blow, that do not tell whether noise is white
_BAND_LENGTH = 0.35  # s after the onset in which bands are looked at
_QUIET = 2e-3  # s before the onset, up to which a channel is quiet
_ROUNDED = 0.5  # of the noise: steps of a converter from which a quiet channel may stand still
_LEAST_QUIET = 64  # samples
_GROUP_PRICE = 2.0  # of chi-square, of each number of a law without a form of its own
_STRANGE = 0.1  # of what is missing is none of the known mechanisms
_SHOWN = 0.1  # of what findings explain, that the tested window must show for laws to be compared
_APART = 0.01  # of what an effect explains, that its form may differ by
_LEAST_RANK = 1e-3  # of a further number's influence that the model's numbers leave of it


@dataclass(frozen=True, slots=True)
class Adequacy:
    """The tests of one fit: chance of each under noise alone, by what was allowed to vary."""

    p_values: dict[str, float]
    excess: dict[str, float]  # fall of chi-square beyond what noise gives
    law: str = ''  # of those that no mechanism has, the one that would explain most

    @property
    def p_value(self) -> float:
        """Chance of the most telling test, all of them together."""
        others = [p for name, p in self.p_values.items() if name != 'laws']
        least = min((p * len(others) for p in others), default=1.0)
        # laws that somebody wrote down deserve as much as all the rest together
        return min(1.0, 2.0 * least, 2.0 * self.p_values.get('laws', 1.0))

    @property
    def worst(self) -> str:
        """What varies most, in words."""
        worst = min(self.p_values, key=lambda k: self.p_values[k], default='')
        return f'it is like {self.law}' if worst == 'laws' else worst


@lru_cache(maxsize=4)
def adequacy(found: Fit, *, laws: bool = True) -> Adequacy:
    """Tests of what a fit leaves; see the module's description. The last few are kept.

    ``laws``: whether laws that no mechanism has are among them, which takes most of the time.

    Blows are looked at up to ``TESTED`` s, the fit first brought to its best there: what only
    shows after many bounces, each of which amplifies, tells of the bounces.
    """
    layout = found.model.layout(found.layout.blows, TESTED)
    if layout.size < found.layout.size:
        found = fit(found.model, layout, found.x, iterations=8)
    return _tested_fit(found, laws)


def without_lone(residuals: Array) -> Array:
    """Residuals of which the few largest are cut down to what noise may leave.

    A sample on the verge of a contact can be off by twenty times the noise where the contact is
    off by a hundredth of its duration; whatever is missing shows in more samples than these.
    """
    if residuals.size <= LONE:
        return residuals
    limited = residuals.copy()
    most = np.argpartition(np.abs(limited), -LONE)[-LONE:]
    limited[most] = np.clip(limited[most], -math.sqrt(TOLD), math.sqrt(TOLD))
    return limited


def _tested_fit(fit: Fit, laws: bool) -> Adequacy:
    size = fit.layout.size
    weight = np.ones(size)
    for name, spans in _by_channel(fit).items():
        spread = _spread(fit, name, spans)
        for span in spans.values():
            weight[span] = 1.0 / spread
    limited = without_lone(fit.residuals[:size])
    residual = np.concatenate([weight * limited, fit.residuals[size:]])
    slopes = fit.jacobian.copy()
    slopes[:size] *= weight[:, None]
    basis = projector(slopes)
    left = residual - basis @ (basis.T @ residual)
    p_values, excess = {}, {}
    numbers = slopes.shape[1]
    further = {'chain': _chain(fit), 'mechanisms': _mechanisms(fit)}
    full = [
        (label, np.concatenate([weight[:, None] * c, np.zeros((numbers, c.shape[1]))]))
        for label, c in further.items()
    ]
    for label, columns in (*_varied(fit, slopes), *full):
        p_values[label], excess[label] = _tested(left, columns, basis, size)
    law = ''
    if laws:
        p_values['laws'], excess['laws'], law = _laws(fit, weight, left, basis)
    for label, (power, count, quiet, rounded) in _bands(fit, weight * limited).items():
        allowed = _ALLOWED**2 * count + rounded
        p_values[label] = float(stats.ncx2.sf(power, count, allowed))
        if quiet < 1.0 or not count:
            p_values[label] = 1.0
        elif math.isfinite(quiet):  # the colour is known no better than the quiet tells it
            p_values[label] = float(stats.f.sf(power / (count + allowed), count, quiet))
        excess[label] = power - count
    for label, (power, count, quiet) in _louder(fit, limited).items():
        p_values[label] = float(stats.f.sf(power / (count * (1.0 + _ALLOWED**2)), count, quiet))
        excess[label] = power - count
    return Adequacy(p_values, excess, law)


def _louder(fit: Fit, residual: Array) -> dict[str, tuple[float, int, float]]:
    """Power of what is left after the blows, by channel and stretch of time.

    In units of the noise as the quiet before the blows has it; with the number of samples, and
    that of the quiet ones. What rattles, squeaks or jars leaves no course that could be followed,
    but it makes a sensor noisier than it was. Of white noise alone that the converter does not
    round away before the blow.
    """
    found = {}
    for name, spans in _by_channel(fit).items():
        quiet = [
            b.samples[b.time < fit.model.data.blows[i].onset - _QUIET]
            for i in spans
            if (b := fit.model.data.blows[i].channels[name]).colour is None
            and b.step < _ROUNDED * b.noise
        ]
        quiet = [q for q in quiet if q.size >= _LEAST_QUIET and np.isfinite(q).all()]
        if not quiet or name == 'acceleration.impactor':  # which moves before the blow, too
            continue
        sigma = next(iter(fit.model.data.blows[i].channels[name].noise for i in spans))
        squares = [max(float(np.var(q)), float(np.var(np.diff(q))) / 2.0) * q.size for q in quiet]
        count = sum(q.size for q in quiet)
        level = max(sum(squares) / count / sigma**2, 1.0)
        for label, late in (('after the blow', False), ('later', True)):
            power, number = 0.0, 0
            for i, span in spans.items():
                blow = fit.model.data.blows[i]
                time = blow.channels[name].centres[fit.layout.masks[i, name]]
                stretch = (time > blow.onset + _SEGMENTS[-1]) == late
                r = residual[span][stretch & (time > blow.settled)]
                power, number = power + float(r @ r), number + r.size
            if number >= _LEAST_QUIET:
                found[f'the noise of {name} {label}'] = power / level, number, float(count)
    return found


def _laws(fit: Fit, weight: Array, left: Array, basis: Array) -> tuple[float, float, str]:
    """Chance and excess of the most telling law that no mechanism has, and its name."""
    laws = [*law_responses(fit), *chain_laws(fit), *_levels(fit)]
    best = 1.0, 0.0, ''
    for law in laws:
        power, count = _along(law, left, basis, weight)
        chance = (
            float(stats.ncx2.sf(power, count, _ALLOWED_ALONE**2 * weight.size)) if count else 1
        )
        if chance < best[0]:
            best = chance, power - count, law.label
    return min(1.0, best[0] * len(laws)), best[1], best[2]


def _levels(fit: Fit) -> list[Law]:
    """Each number of an effect that is fitted, as if it grew with the strength of the blow."""
    layout, model = fit.layout, fit.model
    level = {}
    for i in layout.blows:
        channels = model.data.blows[i].channels
        channel = channels.get('force') or next(iter(channels.values()))
        level[i] = math.log(max(float(np.max(np.abs(channel.means))), channel.noise))
    middle = float(np.mean(list(level.values())))
    found = []
    for j, number in enumerate(model.free):
        active = next((e for e in model.effects if number.key.startswith(f'{e.tag}.')), None)
        if active is None or number.blow is not None:
            continue
        column = fit.jacobian[: layout.size, j].copy()
        for i, span in layout.blow_spans.items():
            column[span] *= level[i] - middle
        if np.any(column):
            name = number.key.rsplit('.', 1)[-1]
            label = f'{active.name} of which the {name} grows with the strength of the blow'
            found.append(Law(label, column[:, None]))
    return found


@lru_cache(maxsize=4)
def law_instead(
    before: Fit, after: Fit, price: float, strained: bool = False
) -> tuple[float, str]:
    """Odds of the findings against a law that explains more in their place, and its name; kept.

    ``before``: the baseline, ``after``: with the findings, of which chance explains that much of
    the fall of chi-square: one for each number, and what it is to have several to choose. The
    fall of chi-square that a law has ahead of the findings counts as evidence: a law that only
    resembles what is there gets ahead by no more than noise, or by a share of the whole in which
    two sound simulations may differ. Before that, one thing in ten that are missing is none that
    is known, each mechanism is as likely as any other, and so is each law. ``strained``: findings
    have to be as no such thing is; for being listed they are not the likelier ones then.
    """
    fits = []
    for found in (before, after):
        layout = found.model.layout(found.layout.blows, TESTED)
        fits.append(fit(found.model, layout, found.x, iterations=8))
    old, new = fits
    size = old.layout.size
    beyond = before.layout.size == after.layout.size and (
        old.chi_square - new.chi_square < _SHOWN * (before.chi_square - after.chi_square)
    )
    if size != new.layout.size or beyond:  # beyond: laws do not reach what tells the findings
        return math.inf, ''
    spread = max(1.0, new.reduced)
    basis = projector(old.jacobian)
    left = old.residuals - basis @ (basis.T @ old.residuals)
    needed = old.chi_square - new.chi_square - price
    best = -math.inf, ''
    laws = [*law_responses(old), *chain_laws(old)]
    for law in laws:
        power, count = _along(law, left, basis, np.ones(size))
        own = count + (_GROUP_PRICE * count if law.label in GROUPS else 0.0)
        best = max(best, (power - own - needed, law.label))
    ahead = max(best[0] - _APART * max(needed, 0.0), 0.0) / spread
    each = (1.0 - _STRANGE) / len(all_mechanisms()), _STRANGE / len(laws)
    prior = 1.0 if strained else each[0] / each[1]
    return prior * math.exp(-0.5 * min(ahead, 1e3)), best[1]


def _along(law: Law, left: Array, basis: Array, weight: Array) -> tuple[float, int]:
    """Power of the residuals along a law, and the number of its directions."""
    columns = weight[:, None] * law.columns
    norm = np.linalg.norm(columns, axis=0)
    columns = columns[:, norm > 0] / norm[norm > 0]
    size = columns.shape[0]
    beyond = -basis @ (basis[:size].T @ columns)
    beyond[:size] += columns
    return _power(beyond, left, 10 * _LEAST_RANK)


def _power(columns: Array, left: Array, least: float) -> tuple[float, int]:
    """Power of a vector in the span of columns of about unit length, and its directions.

    Those that are shorter than ``least`` do not count.
    """
    size, vectors = np.linalg.eigh(columns.T @ columns)
    sound = size > least**2
    along = vectors[:, sound].T @ (columns.T @ left)
    return float(np.sum(along**2 / size[sound])), int(np.count_nonzero(sound))


def _by_channel(fit: Fit) -> dict[str, dict[int, slice]]:
    found: dict[str, dict[int, slice]] = {}
    for (i, name), span in fit.layout.spans.items():
        found.setdefault(name, {})[i] = span
    return found


def _spread(fit: Fit, name: str, spans: dict[int, slice]) -> float:
    """Standard deviation from bin to bin of a channel's standardised residuals; at least one."""
    squares = []
    for i, span in spans.items():
        time = fit.model.data.blows[i].channels[name].centres[fit.layout.masks[i, name]]
        r = fit.residuals[span]
        if r.size < 16:
            continue
        even = np.diff(time, 2) < 0.1 * np.diff(time)[1:]
        squares.append(np.diff(r, 2)[even] ** 2 / 6.0)
    pooled = np.concatenate(squares) if squares else np.ones(1)
    if pooled.size < 32:
        return 1.0
    # mean of the lower nine tenths: single jumps shall not pass for noise
    high = float(np.quantile(pooled, 0.9))
    share = float(np.mean(pooled[pooled <= high]))
    return max(1.0, math.sqrt(share / _TRIMMED))


_TRIMMED = float(
    stats.chi2.cdf(stats.chi2.ppf(0.9, 1), 3) / 0.9
)  # mean of a squared normal number below its 90 % quantile


def _varied(fit: Fit, slopes: Array) -> Iterator[tuple[str, Array]]:
    """Influences of the shared numbers, restricted to parts of the recordings."""
    layout, model = fit.layout, fit.model
    size = layout.size
    shared = [
        j for j, f in enumerate(model.free) if f.blow is None and np.any(slopes[:size, j] != 0.0)
    ]
    mechanical = [j for j in shared if not model.free[j].key.startswith('gain.')]
    segment = np.zeros(size, dtype=np.int64)
    for (i, name), span in layout.spans.items():
        blow = model.data.blows[i]
        since = blow.channels[name].centres[layout.masks[i, name]] - blow.onset
        segment[span] = np.searchsorted(np.asarray(_SEGMENTS), since)
    channels = list(_by_channel(fit).values())
    by_blow, by_channel, by_time = [], [], []
    for i in layout.blows:
        rows = np.zeros(size, dtype=np.bool_)
        rows[layout.blow_spans[i]] = True
        by_blow += _parts(slopes, shared, [rows])
        cut = [rows & (segment == s) for s in range(len(_SEGMENTS) + 1)]
        by_time += _parts(slopes, mechanical, cut)
        own = [np.zeros(size, dtype=np.bool_) for _ in channels]
        for mask, spans in zip(own, channels, strict=True):
            if i in spans:
                mask[spans[i]] = True
        by_channel += _parts(slopes, mechanical, own)
    length = slopes.shape[0]
    for label, parts in (
        ('recordings', by_blow),
        ('channels', by_channel),
        ('time', by_time),
    ):
        columns = np.zeros((length, len(parts)))
        for k, part in enumerate(parts):
            columns[:size, k] = part
        yield label, columns


def _chain(fit: Fit) -> Array:
    """What a measuring chain may do to a channel, shape (size, n): each to first order.

    Squares and cubes of the values, other channels, rates of change, sums and drift.
    """
    layout, model, values = fit.layout, fit.model, fit.values
    columns: dict[tuple[str, str], Array] = {}
    for i in layout.blows:
        prediction = model.predict(values, i)
        blow = model.data.blows[i]
        for name, channel in blow.channels.items():
            span, mask = layout.spans[i, name], layout.masks[i, name]
            time = channel.centres
            y = prediction.means[name]
            sums = integrate.cumulative_trapezoid(y, time, initial=0.0)
            shapes = {
                'square': y * y,
                'cube': y**3,
                'rate': np.gradient(y, time),
                'rate of rate': np.gradient(np.gradient(y, time), time),
                'sum': sums,
                'constant': np.ones_like(y),
                'drift': time,
            }
            for other, its in prediction.means.items():
                if other != name:
                    shapes[other] = np.interp(time, blow.channels[other].centres, its)
            for label, shape in shapes.items():
                column = columns.setdefault((name, label), np.zeros(layout.size))
                part = (shape / channel.std)[mask]
                column[span] = model.whitened(part, i, name, layout)
    return np.stack(list(columns.values()), axis=1)


def _mechanisms(fit: Fit) -> Array:
    """Signatures of every effect on the bench, with a strength of its own in each recording."""
    layout = fit.layout
    acting = [
        c
        for c in candidates(fit, ())
        if c.amplitudes and not c.channel and c.name != 'wrong_parameter'
    ]
    found = []
    for signature in in_parallel(lambda c: _signature(fit, c), acting):
        if signature is None:
            continue
        for span in layout.blow_spans.values():
            part = np.zeros(layout.size)
            part[span] = signature[span]
            found.append(part)
    return np.stack(found, axis=1) if found else np.zeros((layout.size, 0))


def _signature(fit: Fit, candidate: Candidate) -> Array | None:
    """Change of the residuals by a weak effect, shape (size,)."""
    model, size = candidate.extend(fit.model), fit.layout.size
    known, start = fit.values, dict(candidate.starts[0])
    for _ in range(4):
        values = {**known, **start}
        x = model.vector(values)
        try:
            change = model.residuals(x, fit.layout)[:size] - fit.residuals[:size]
        except ImpactscopeError:
            change = np.full(size, math.inf)
        norm = float(np.linalg.norm(change))
        if norm < _FELT:
            return change if norm > 0.0 else None
        share = 0.3 * _FELT / norm if math.isfinite(norm) else 0.01
        start = stronger(candidate, start, share)
    return None


def _parts(slopes: Array, numbers: list[int], masks: list[NDArray[np.bool_]]) -> list[Array]:
    size = masks[0].size if masks else 0
    found = []
    for j, mask in itertools.product(numbers, masks):
        part = np.where(mask, slopes[:size, j], 0.0)
        if float(part @ part) > 0.0:
            found.append(part)
    return found


def _tested(left: Array, columns: Array, basis: Array, size: int) -> tuple[float, float]:
    """Chance and excess of the residual's power in the span of columns beyond the basis."""
    norm = np.linalg.norm(columns, axis=0)
    columns = columns[:, norm > 0] / norm[norm > 0]
    beyond = columns - basis @ (basis.T @ columns)
    power, count = _power(beyond, left, _LEAST_RANK)
    if not count:
        return 1.0, 0.0
    together = float(stats.ncx2.sf(power, count, _ALLOWED**2 * size))
    # and each on its own: a single one stands out more
    length = np.linalg.norm(beyond, axis=0)
    sound = length > 10 * _LEAST_RANK
    alone = (beyond[:, sound].T @ left / length[sound]) ** 2
    best = float(np.max(alone, initial=0.0))
    single = float(stats.ncx2.sf(best, 1, _ALLOWED_ALONE**2 * size)) * alone.size
    return min(1.0, 2.0 * min(together, single)), max(power - count, best)


def _bands(fit: Fit, residual: Array) -> dict[str, tuple[float, int, float, float]]:
    """Power and number of terms of the residual in bands, all recordings and channels.

    And the number of terms in the quiet before the blows, from which the colour of a noise that
    is not white is known; infinite where it is white. Of a noise that is not white also what is
    above the bands, in units of what the quiet has there. Last the power that a converter's steps
    may leave in a band.
    """
    total: dict[str, list[float]] = {}
    rounded: dict[str, float] = {}
    for (i, name), span in fit.layout.spans.items():
        blow = fit.model.data.blows[i]
        channel, mask = blow.channels[name], fit.layout.masks[i, name]
        time = channel.centres[mask]
        r = residual[span]
        after = (time > blow.settled) & (time < blow.onset + _BAND_LENGTH)
        r, time = r[after], time[after]
        if r.size < 32:
            continue
        steps = rounding_error(channel.step, channel.noise)
        steps *= float(np.sum(channel.std[mask][after] ** -2.0))
        length = float(time[-1] - time[0])
        before = blow.onset - blow.recording.channels[name].start
        white = blow.channels[name].colour is None and before > _SHORT_QUIET
        bent = name == 'acceleration.impactor'
        slowest = 0.0 if white else slowest_seen(before, bent=bent)
        low, power, terms = 0.0, 0.0, 0
        for high in _BANDS:
            if 2 * high * length > 0.4 * r.size:
                break
            orders = np.arange(math.ceil(2 * low * length), math.floor(2 * high * length))
            low = high
            if not orders.size:
                continue
            phase = np.pi * (time - time[0]) / length
            waves = np.cos(phase[:, None] * orders[None, :])
            q, _ = np.linalg.qr(waves)
            inside = (q.T @ r) ** 2
            power, terms = power + float(np.sum(inside)), terms + inside.size
            sure = inside[orders >= 2 * slowest * length]
            entry = total.setdefault(f'{name} below {high:g} Hz', [0.0, 0.0, 0.0])
            entry[0] += float(np.sum(sure))
            entry[1] += sure.size
            entry[2] += math.inf if white else before / length * sure.size
            rounded[f'{name} below {high:g} Hz'] = (
                rounded.get(f'{name} below {high:g} Hz', 0.0) + steps
            )
        quiet = _quiet_above(blow, name, low)
        if quiet[1]:
            above = total.setdefault(f'{name} above the bands', [0.0, 0.0, 0.0, 0.0])
            rest = float(r @ r) - power, float(r.size - terms), *quiet
            total[f'{name} above the bands'] = [a + b for a, b in zip(above, rest, strict=True)]
    found = {}
    for label, (power, count, *quiet_ones) in total.items():
        if len(quiet_ones) == 2:
            squares, number = quiet_ones
            found[label] = power / max(squares / number, 1.0), int(count), number, 0.0
        else:
            found[label] = power, int(count), quiet_ones[0], rounded[label]
    return found


def rounding_error(step: float, noise: float) -> float:
    """Mean square of what a converter's steps leave of a slow reading that noise does not blur.

    The first harmonic of the staircase, weakened by the noise before it, which is what the steps
    have not made themselves (Widrow and Kollár, Quantization Noise (2008), ch. 5).
    """
    if step <= 0.0:
        return 0.0
    before = max(noise**2 - step**2 / 12.0, 0.0) / step**2
    return step**2 / (2.0 * math.pi**2) * math.exp(-4.0 * math.pi**2 * before)


def _quiet_above(blow: BlowData, name: str, low: float) -> tuple[float, float]:
    """Power and number of terms above a frequency in a channel's whitened quiet before a blow.

    None of a noise that is white, of a channel that moves before the blow, too, and of a coarse
    converter: that rounds what moves otherwise than what is quiet.
    """
    channel = blow.channels[name]
    coarse = channel.step > channel.noise
    if channel.colour is None or coarse or name == 'acceleration.impactor':
        return 0.0, 0.0
    before = channel.time < blow.onset - _QUIET
    quiet, time = channel.samples[before], channel.time[before]
    if quiet.size < _LEAST_QUIET or not np.isfinite(quiet).all():
        return 0.0, 0.0
    ones = np.ones(quiet.size, dtype=np.int64)
    white = whitener(channel.colour, time, ones, np.full(quiet.size, channel.colour.std))
    orders = fft.dct(white((quiet - np.mean(quiet)) / channel.colour.std), norm='ortho')
    first = math.ceil(2 * low * quiet.size / channel.sample_rate)
    return float(np.sum(orders[first:] ** 2)), float(max(quiet.size - first, 0))
