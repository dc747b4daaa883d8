"""The simulated bench as a model of a whole campaign: numbers in, standardised residuals out.

Every number has a key (``sensor.stiffness``, ``coulomb_friction.force``); ``key@2`` is the number
of the blow with index 2 alone. A model is a set of constants, the numbers that are free, and the
effects that act beside the bench. Candidates for missing physics only add to these.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.impact.data.binning import BinnedChannel
from impactscope.discrepancy.impact.data.blows import BlowData, CampaignData
from impactscope.discrepancy.impact.models.bench_parameters import (
    GRAVITY,
    after_loss,
    describe,
    follow_weight,
    weight_as_stated,
)
from impactscope.discrepancy.impact.models.measuring_chain import (
    coupled_since,
    distort,
    fineness,
    moments_of,
    sample_moments,
    softened,
)
from impactscope.discrepancy.impact.models.result_cache import ResultCache
from impactscope.discrepancy.impact.models.standardised_residuals import (
    FittedBins,
    fitted_bins,
    standardised,
)
from impactscope.discrepancy.impact.noise.whitening import Whitener, whitener
from impactscope.discrepancy.parallel import in_parallel
from impactscope.physics.mechanisms.registry import mechanism
from impactscope.physics.pendulum import STANDARD_GRAVITY
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.assembly import Effect, assemble
from impactscope.physics.twin.bench import (
    Bench,
    Blow,
    HammerTap,
)
from impactscope.physics.twin.simulate import CHANNELS, solve

__all__ = [
    'PHASE',
    'RECORDING_END',
    'SPEED_RATIO',
    'ActiveEffect',
    'Free',
    'ImpactModel',
    'Layout',
    'Prediction',
]

Array = NDArray[np.float64]
_Moments = tuple[Array, dict[str, NDArray[np.int64]]]
_Solution = tuple[Array, Array, NDArray[np.int64]]  # rows, event times and kinds

SPEED_RATIO = 'impact_speed_loss.ratio'
PHASE = ('sine', 'cosine')  # numbers of a hum in each recording
_SOLUTIONS = 8  # kept for each blow
_MOMENTS, _WHITENERS = 60, 300  # kept
_FILTERED = 256  # samples at least, that a filter is given
RECORDING_END = 8e-3  # s, in which a filter that runs backwards gives what came after
_QUICKEST = 5e-5  # s, in which a branch of a layer relaxes
_BEYOND = 0.01  # s beyond the last bin of a layout, up to which is simulated
_TELLS = 3.0  # of its noise, uncertainty of a bin up to which it is fitted
_WHOLE = ('low_pass_filter', 'ac_coupling')  # effects that need every sample
_WEIGHTS = ('gravity_load', 'restoring_force')
_EVENTS = np.arange(16)
_FRICTION_EVENT = np.isin(_EVENTS, (at.STICKS, at.SLIPS, at.REVERSES))
_CONTACT_EVENT = np.isin(_EVENTS, (at.CONTACT_BEGINS, at.CONTACT_ENDS))


@dataclass(frozen=True, slots=True)
class Free:
    """A number that is fitted, in its own unit or, ``logarithmic``, in its logarithm.

    ``scale`` is the step at which an influence is felt, for a logarithmic number relative to it.
    """

    key: str
    start: float
    scale: float
    lower: float = -math.inf
    upper: float = math.inf
    logarithmic: bool = False
    prior: tuple[float, float] | None = None  # mean and standard deviation, own unit
    blow: int | None = None

    def to_inner(self, value: float) -> float:
        """Value in own unit to the number that is fitted."""
        value = min(max(value, self.lower), self.upper)
        if not value > 0 and self.logarithmic:
            value = max(self.lower, 1e-300)
        return math.log(value) if self.logarithmic else value

    def to_outer(self, inner: float) -> float:
        """Number that is fitted to the value in own unit."""
        return math.exp(inner) if self.logarithmic else inner

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the number that is fitted."""
        if not self.logarithmic:
            return self.lower, self.upper
        low = math.log(self.lower) if self.lower > 0 else -math.inf
        return low, math.log(self.upper) if self.upper > 0 else math.inf


@dataclass(frozen=True, slots=True)
class ActiveEffect:
    """A mechanism in a model; its values are found under ``tag.<parameter>``.

    ``shares``: key of a factor for each blow (``share@i``) by which its first value is scaled.
    """

    name: str
    channel: str = ''
    shares: str = ''

    @property
    def tag(self) -> str:
        """Prefix of the keys of its values."""
        return f'{self.name}:{self.channel}' if self.channel else self.name


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """What a model says of one blow: means over the bins of each channel, shape (n_bins,)."""

    means: Mapping[str, Array]
    kinks: Array  # times of reversals, s
    jump: float  # of the plate's acceleration at a reversal, m/s^2
    rows: Array  # all outputs of the twin at ``BlowData.times``
    contacts: Array  # times at which contact is lost or found, s
    contact_kinds: NDArray[np.int64]
    start: float  # s, first contact


@dataclass(frozen=True, slots=True, eq=False)
class _Simulated:
    """The twin's outputs for one blow, and what its measuring chains do to them."""

    rows: Array  # at the first moments, shape (n_simulated, N_LEAN_COLUMNS)
    where: Mapping[str, NDArray[np.int64]]  # of each channel among the moments
    chain: Mapping[str, list[tuple[str, dict[str, float]]]]
    whole: Mapping[str, int]  # channels that need every sample, and moments for each
    gains: Mapping[str, float]
    event_times: Array  # s
    event_kinds: NDArray[np.int64]
    jump: float  # of the plate's acceleration at a reversal, m/s^2
    start: float  # s, first contact
    end: float  # s, up to which there is anything at all

    @property
    def kinks(self) -> Array:
        """Times of reversals, s."""
        return self.event_times[_FRICTION_EVENT[self.event_kinds]]


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Which bins of which blows enter a fit, in their order in the residual vector."""

    blows: tuple[int, ...]
    masks: Mapping[tuple[int, str], NDArray[np.bool_]]
    spans: Mapping[tuple[int, str], slice]
    blow_spans: Mapping[int, slice]
    ends: Mapping[int, float]  # s, of the last bin of each blow
    size: int
    window: float = math.inf  # s after the onset
    fitted: dict[int, FittedBins] = field(default_factory=dict, repr=False)  # of each blow

    def bins_of(self, i: int, blow: BlowData) -> FittedBins:
        """The bins of blow ``i`` that are fitted."""
        kept = self.fitted.get(i)
        if kept is None or kept.blow is not blow:
            kept = fitted_bins(blow, {name: self.masks[i, name] for name in blow.channels})
            self.fitted[i] = kept
        return kept

    @property
    def samples(self) -> int:
        """Number of bins that are fitted."""
        return self.size


@dataclass(eq=False)
class ImpactModel:
    """A model of the campaign: see the module's description."""

    data: CampaignData
    constants: Mapping[str, float]
    free: tuple[Free, ...]
    effects: tuple[ActiveEffect, ...]
    steps: Mapping[str, float] = field(default_factory=dict, repr=False)  # of finite differences
    solutions: list[ResultCache[_Solution]] = field(
        default_factory=list, repr=False
    )  # of each blow
    moments: ResultCache[_Moments] = field(
        default_factory=lambda: ResultCache(_MOMENTS), repr=False
    )
    whiteners: ResultCache[tuple[Whitener, NDArray[np.bool_], Array]] = field(
        default_factory=lambda: ResultCache(_WHITENERS), repr=False
    )

    def __post_init__(self) -> None:
        if not self.solutions:
            self.solutions = [ResultCache(_SOLUTIONS) for _ in self.data.blows]

    def extended(
        self,
        *,
        free: Sequence[Free] = (),
        effects: Sequence[ActiveEffect] = (),
        constants: Mapping[str, float] | None = None,
        without_effects: Sequence[str] = (),
    ) -> ImpactModel:
        """This model with more in it; a free number replaces the one of the same key."""
        keys = {f.key for f in free}
        return dataclasses.replace(
            self,
            constants={**self.constants, **(constants or {})},
            free=(*(f for f in self.free if f.key not in keys), *free),
            effects=(*(e for e in self.effects if e.name not in without_effects), *effects),
        )

    # --- numbers ---------------------------------------------------------------------------

    def start(self) -> Array:
        """Start of a fit, in the numbers that are fitted, shape (n_free,)."""
        return self.vector({})

    def scales(self) -> Array:
        """Scale of each number that is fitted, shape (n_free,)."""
        return np.array([f.scale for f in self.free])

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the numbers that are fitted."""
        pairs = [f.bounds for f in self.free]
        return np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])

    def vector(self, values: Mapping[str, float]) -> Array:
        """Numbers that are fitted, by values in their own units, shape (n_free,).

        Where a value is missing, the number's start.
        """
        return np.array([f.to_inner(values.get(f.key, f.start)) for f in self.free])

    def values(self, x: Array) -> dict[str, float]:
        """All numbers by key, own units."""
        values = dict(self.constants)
        values.update({f.key: f.to_outer(v) for f, v in zip(self.free, x.tolist(), strict=True)})
        return values

    def index(self, key: str) -> int:
        """Place of a free number in the vector."""
        return next(i for i, f in enumerate(self.free) if f.key == key)

    # --- residuals -------------------------------------------------------------------------

    def layout(
        self,
        blows: Sequence[int],
        window: float = math.inf,
        taps: float | None = None,
        *,
        without_ends: Collection[str] = (),
    ) -> Layout:
        """Bins up to ``window`` s after the onset, of the given blows.

        Bins that tell next to nothing, because a bench does not repeat them, stay out. Taps
        count whole in all but the shortest windows, which for them begin when the hammer
        has gone; or ``taps`` s of them, where that is given. What a filter gives that runs
        backwards, too, hangs on what came after a recording's end: right before it nothing counts,
        nor in the channels of ``without_ends``.
        """
        turned = set(without_ends)
        turned |= {e.channel for e in self.effects if self.constants.get(f'{e.tag}.zero_phase')}
        masks, spans, blow_spans, ends, begin = {}, {}, {}, {}, 0
        for i in blows:
            blow = self.data.blows[i]
            first, ends[i] = begin, blow.onset
            length = window
            if blow.recording.kind == 'tap':
                whole = math.inf if window > 0.02 else window
                length = whole if taps is None else taps
            for name, channel in blow.channels.items():
                mask = channel.used & (channel.centres < blow.settled + length)
                mask &= channel.std < _TELLS * channel.own_std
                if name in turned and channel.time.size:
                    mask &= channel.centres < channel.time[-1] - RECORDING_END
                count = int(np.count_nonzero(mask))
                masks[i, name] = mask
                spans[i, name] = slice(begin, begin + count)
                begin += count
                if count:
                    ends[i] = max(ends[i], float(channel.centres[mask][-1]))
            blow_spans[i] = slice(first, begin)
        return Layout(tuple(blows), masks, spans, blow_spans, ends, begin, window)

    def residuals(self, x: Array, layout: Layout) -> Array:
        """Measured minus simulated over the noise, then the priors; shape (size + n_free,)."""
        values = self.values(x)
        out = np.empty(layout.size + len(self.free))
        parts = in_parallel(lambda i: self.blow_residuals(values, i, layout), layout.blows)
        for i, part in zip(layout.blows, parts, strict=True):
            out[layout.blow_spans[i]] = part
        out[layout.size :] = self.prior_residuals(values, layout)
        return out

    def prior_residuals(self, values: Mapping[str, float], layout: Layout) -> Array:
        """Distance of each free number from what is known of it; zero without a prior."""
        out = np.zeros(len(self.free))
        everywhere = values.get(SPEED_RATIO, 1.0)
        for j, number in enumerate(self.free):
            absent = number.blow is not None and number.blow not in layout.blow_spans
            if number.prior is None or absent:
                continue
            mean, std = number.prior
            ratio = values.get(f'{SPEED_RATIO}@{number.blow}', everywhere)
            if ratio != 1.0 and number.blow is not None:
                mean = after_loss(number.key, mean, ratio, values)
            out[j] = (values[number.key] - mean) / std
        return out

    def blow_residuals(self, values: Mapping[str, float], i: int, layout: Layout) -> Array:
        """Standardised residuals of one blow in the order of the layout."""
        blow = self.data.blows[i]
        if not blow.channels:
            return np.zeros(0)
        simulated = self._simulated(values, i, layout.ends[i])
        distorted = {*simulated.chain, *simulated.whole}
        kinks = simulated.kinks
        out = standardised(
            layout.bins_of(i, blow), simulated.rows, simulated.where, simulated.gains, distorted
        )
        begin = layout.blow_spans[i].start
        for name, channel in blow.channels.items():
            bends = name == 'acceleration.plate' and kinks.size > 0
            if not (bends or name in distorted or channel.colour is not None):
                continue
            mask, span = layout.masks[i, name], layout.spans[i, name]
            part = out[span.start - begin : span.stop - begin]
            if name in distorted:
                mean = self._mean(simulated, channel)
                part[:] = (channel.means[mask] - mean[mask]) / channel.std[mask]
            if bends:
                jump = simulated.jump / channel.std[mask]
                part[:] = softened(part, jump, channel.centres[mask], kinks)
            part[:] = self.whitened(part, i, name, layout)
        return out

    def whitened(self, rows: Array, i: int, name: str, layout: Layout) -> Array:
        """Standardised rows of a channel of blow ``i``, each less what the noise before it tells.

        Shape (n_used,) or (n_used, n_columns); as they are where the noise is white.
        """
        channel = self.data.blows[i].channels[name]
        if channel.colour is None:
            return rows
        mask = layout.masks[i, name]
        place = i, name, id(mask), id(channel.std)
        kept = self.whiteners.get(place)
        if kept is None:
            key = b''.join((bytes((i,)), name.encode(), mask.tobytes(), channel.std.tobytes()))
            same = self.whiteners.get(key)
            known = same[0] if same is not None else None
            if known is None:
                known = whitener(
                    channel.colour, channel.centres[mask], channel.counts[mask], channel.std[mask]
                )
            kept = known, mask, channel.std  # held, so that no other array takes its place
            self.whiteners.keep(key, kept)
            self.whiteners.keep(place, kept)
        return kept[0](rows)

    # --- simulation ------------------------------------------------------------------------

    def predict(self, values: Mapping[str, float], i: int, until: float = math.inf) -> Prediction:
        """What the model says of blow ``i``; beyond ``until`` s means need not be right."""
        simulated = self._simulated(values, i, until)
        contact = _CONTACT_EVENT[simulated.event_kinds]
        return Prediction(
            means={
                name: self._mean(simulated, channel)
                for name, channel in self.data.blows[i].channels.items()
            },
            kinks=simulated.kinks,
            jump=simulated.jump,
            rows=simulated.rows,
            contacts=simulated.event_times[contact],
            contact_kinds=simulated.event_kinds[contact],
            start=simulated.start,
        )

    def mean_squares(self, values: Mapping[str, float], layout: Layout) -> dict[str, float]:
        """Mean square of measured minus simulated samples, by channel, of a layout's bins.

        A sample counts by what it can tell: less at a moment that no bench repeats, or right at
        a reversal.
        """
        squares: dict[str, float] = {}
        weights: dict[str, float] = {}
        for i in layout.blows:
            blow = self.data.blows[i]
            simulated = self._simulated(values, i, layout.ends[i], tuple(blow.channels))
            for name, channel in blow.channels.items():
                tells = channel.own_std / channel.std
                if name == 'acceleration.plate' and simulated.kinks.size:
                    jump = simulated.jump / channel.std
                    tells = softened(tells, jump, channel.centres, simulated.kinks)
                weight = np.repeat(tells * layout.masks[i, name], channel.counts) ** 2
                left = np.nan_to_num(channel.samples - self._samples(simulated, channel))
                squares[name] = squares.get(name, 0.0) + float(weight @ left**2)
                weights[name] = weights.get(name, 0.0) + float(np.sum(weight))
        return {name: squares[name] / weight for name, weight in weights.items() if weight > 0.0}

    def _simulated(
        self,
        values: Mapping[str, float],
        i: int,
        until: float,
        every_sample: Sequence[str] = (),
    ) -> _Simulated:
        """The twin's outputs for blow ``i``, at the moments that its channels need.

        ``every_sample``: channels of which every sample is wanted, whatever acts on them.
        """
        blow = self.data.blows[i]
        chain = self._chain(values, i)
        start = values[f'time@{i}']
        times, where = blow.times, blow.where
        shifted = {n: e for n, e in chain.items() if any(k == 'clock_error' for k, _ in e)}
        whole = {
            n: fineness(e, blow.channels[n])
            for n, e in chain.items()
            if n in blow.channels and any(k in _WHOLE for k, _ in e)
        }
        whole = dict.fromkeys(every_sample, 1) | whole
        if shifted or whole:
            needed = i, *whole.items()
            kept = self.moments.get(needed) if not shifted else None
            times, where = kept or moments_of(blow, shifted, whole)
            if kept is None and not shifted:
                self.moments.keep(needed, (times, where))
        par = self.parameters(values, i)
        rows, event_times, event_kinds = self._solve(par, i, times, start, until)
        return _Simulated(
            rows=rows,
            where=where,
            chain=chain,
            whole=whole,
            gains={name: values.get(f'gain.{name}', 1.0) for name in blow.channels},
            event_times=event_times + start,
            event_kinds=event_kinds,
            jump=float((par[at.KINETIC_FORWARD] + par[at.KINETIC_BACKWARD]) / par[at.PLATE_MASS]),
            start=start,
            end=until + _BEYOND,
        )

    def _mean(self, simulated: _Simulated, channel: BinnedChannel) -> Array:
        """Means of a channel over its bins, shape (n_bins,), after all that its chain does."""
        samples = self._samples(simulated, channel)
        if channel.name in simulated.whole:
            return np.asarray(np.add.reduceat(samples, channel.edges) / channel.counts)
        return channel.averaged(samples)

    @staticmethod
    def _samples(simulated: _Simulated, channel: BinnedChannel) -> Array:
        """A channel after all that its chain does, at its samples where these were simulated.

        Shape (n_samples,), or (n_nodes,) at its nodes; zero beyond what was simulated.
        """
        name = channel.name
        fine = simulated.whole.get(name, 1)
        moments = sample_moments(channel, fine) if name in simulated.whole else channel.nodes
        result = np.zeros(-(-moments.size // fine))
        moments = moments[: max(_FILTERED * fine, np.searchsorted(moments, simulated.end))]
        where = simulated.where[name][: moments.size]
        there = where < len(simulated.rows)
        clean = np.zeros(moments.size)
        clean[there] = simulated.gains[name] * simulated.rows[where[there], CHANNELS[name][1]]
        chain = simulated.chain.get(name, ())
        for place, (kind, numbers) in enumerate(chain):
            if kind == 'ac_coupling' and name == 'acceleration.impactor':
                behind = chain[place:]
                clean = coupled_since(simulated.start, clean, moments, channel, behind, fine)
                continue
            clean = distort(kind, clean, moments, channel, numbers, fine)
        seen = clean[::fine]
        result[: seen.size] = seen
        return result

    def _solve(self, par: Array, i: int, times: Array, start: float, until: float) -> _Solution:
        count = int(times.searchsorted(until + _BEYOND))
        key = par.tobytes() + np.array([start, count, times.size, times[-1], times[0]]).tobytes()
        key += times[:: max(1, times.size // 7)].tobytes()
        known = self.solutions[i].get(key)
        if known is not None:
            return known
        found = solve(par, times[:count] - start, lean=True)[:3]
        self.solutions[i].keep(key, found)
        return found

    def parameters(self, values: Mapping[str, float], i: int) -> Array:
        """Parameter vector of the compiled bench for blow ``i``."""
        bench, blow = describe(values, self.data.blows[i], i)
        par = assemble(bench, blow, self._bench_effects(values, i, bench, blow))
        for place in range(at.BRANCH, at.BRANCH + 2 * int(par[at.BRANCHES]), 2):
            stiffness, damping = par[place : place + 2]
            # quicker than any sample it is but damping, and costs a hundred times the steps
            relaxes = damping / max(stiffness, 1e-30)
            relaxes = math.sqrt(math.hypot(relaxes**2, _QUICKEST**2))
            par[place] = damping / relaxes
        return par

    def _bench_effects(
        self, values: Mapping[str, float], i: int, bench: Bench, blow: Blow
    ) -> list[Effect]:
        there = set() if isinstance(blow, HammerTap) else {'impactor'}
        there |= {'damper'} if bench.damper is not None else {'bare'}
        found = []
        for active in self.effects:
            kind = mechanism(active.name)
            if active.name == 'impact_speed_loss' and SPEED_RATIO in values:
                continue  # see after_loss
            if kind.on_channel or not kind.needs <= there:
                continue
            numbers = self._numbers(values, active, i)
            if active.name in _WEIGHTS and not follow_weight(
                numbers,
                blow,
                bench,
                weight_as_stated(values, active.tag),
                values.get(GRAVITY, STANDARD_GRAVITY),
            ):
                continue
            if active.name == 'stribeck_friction':
                numbers['static_force'] = max(numbers['static_force'], numbers['kinetic_force'])
            found.append(Effect(active.name, numbers))
        return found

    def _numbers(
        self, values: Mapping[str, float], active: ActiveEffect, i: int
    ) -> dict[str, float]:
        numbers = {}
        for parameter in mechanism(active.name).parameters:
            key = f'{active.tag}.{parameter.name}'
            value = values.get(f'{key}@{i}', values.get(key, parameter.default))
            numbers[parameter.name] = value
        if active.shares and numbers:
            first = next(iter(numbers))
            numbers[first] *= values[f'{active.shares}@{i}']
        return numbers

    def _chain(
        self, values: Mapping[str, float], i: int
    ) -> dict[str, list[tuple[str, dict[str, float]]]]:
        chain: dict[str, list[tuple[str, dict[str, float]]]] = {}
        for active in self.effects:
            if not mechanism(active.name).on_channel:
                continue
            numbers = self._numbers(values, active, i)
            if active.name == 'mains_hum':
                for part in PHASE:
                    numbers[part] = values.get(f'{active.tag}.{part}@{i}', 0.0)
            if active.name == 'low_pass_filter':
                numbers['ahead'] = values.get(f'{active.tag}.ahead', 0.0)
            chain.setdefault(active.channel, []).append((active.name, numbers))
        return chain
