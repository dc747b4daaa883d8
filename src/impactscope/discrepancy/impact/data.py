"""Recordings of blows made ready for a fit: onset, noise, and bins that keep what matters.

Before the blow, and where a channel is sampled faster than anything on the bench moves, samples
are averaged over bins, and the simulation over the same span by nodes: two are exact for two
samples and for cubics. Around the first contact every sample counts on its own.

Nobody knows the force of a tap, in size or in shape. So a tap is judged by what the bench does of
its own once the hammer has gone: samples during the tap do not count, and the simulated tap only
stands for the state in which the real one left the bench.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import integrate, ndimage

from impactscope.discrepancy.campaign import Campaign, CampaignRecording, ChannelSamples, Role
from impactscope.discrepancy.evidence import noise_std, quantisation_step
from impactscope.discrepancy.impact.noise import Colour, colour_of
from impactscope.errors import InputError
from impactscope.physics.pendulum import Orientation

__all__ = ['CHANNELS', 'BinnedChannel', 'BlowData', 'CampaignData', 'prepare']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

CHANNELS = ('force', 'acceleration.plate', 'acceleration.impactor', 'acceleration.base')

LEAD = 2.0  # s before the onset that are used at most
LENGTH = 4.0  # s after the onset that are used at most
RETURN = 0.35  # s after which a pendulum on the horizontal bench may be back
CAUGHT = 0.09  # s after which a pendulum on the horizontal bench may have been caught
TAP_LEAD = 5e-3  # s before the onset of a tap that may show its beginning
_SHORTEST_TAP = 4e-3  # s, counted out at least
_PRESUMED_TAP = 0.015  # s, counted out where the end cannot be seen
_LONGEST_TAP = 0.035  # s after its onset in which the end of a tap is looked for
_FINE_UNTIL = 0.025  # s after the onset in which every sample counts
_LATE = 0.3  # s after the onset from which a bench may be still
_STILL = 0.02  # s over which it is
_LONG_BIN = 4e-3  # s, where nothing changes
_NODE_STEP = 5e-5  # s
_FLOOR = 0.05  # of the noise, of a sample: what two sound simulations may differ by
_RELATIVE_FLOOR = 2e-4  # of the value
_TIME_FLOOR = 2e-7  # s, of the moment of a sample


_WITHOUT = {
    'force': 'stiffness and mass of the sensor are known in their ratio alone',
    'acceleration.plate': 'taps are counted out by a presumed length, and friction at small '
    'motions is hardly seen',
    'acceleration.impactor': 'what happens in the contact and in the impactor is seen only '
    'through the plate',
    'acceleration.base': 'a fixture that gives way is seen only through the plate',
}  # what cannot be told without a channel


@dataclass(frozen=True, slots=True, eq=False)
class BinnedChannel:
    """One channel of one blow in bins; arrays over the bins, shape (n_bins,), unless said."""

    name: str
    unit: str
    sample_rate: float
    time: Array  # of all samples in use, s, shape (n_samples,)
    samples: Array  # shape (n_samples,)
    edges: IntArray  # first sample of each bin, shape (n_bins,)
    counts: IntArray
    nodes: Array  # times at which the simulation is averaged, s, shape (n_nodes,)
    first_nodes: IntArray  # of each bin, shape (n_bins,)
    node_counts: IntArray
    centres: Array  # s
    means: Array
    std: Array  # standard deviation of the means, with what a bench does not repeat
    own_std: Array  # standard deviation of the means by noise alone
    used: NDArray[np.bool_]
    noise: float  # of a sample
    step: float = 0.0  # of the converter, 0 where it cannot be seen
    clipped_at: float = math.inf
    colour: Colour | None = None  # of the noise; None: white

    def averaged(self, at_nodes: Array) -> Array:
        """Means over the bins of what was simulated at the nodes, shape (n_bins,)."""
        return np.asarray(np.add.reduceat(at_nodes, self.first_nodes) / self.node_counts)


@dataclass(frozen=True, slots=True, eq=False)
class BlowData:
    """One blow: its recording, its onset and its channels.

    ``times``: rising, all moments at which the simulation is needed; ``where[channel]`` says
    which of them are the channel's nodes, shape (n_nodes,). ``settled``: moment from which the
    bench moves of its own after a tap; the onset for any other blow.
    """

    recording: CampaignRecording
    onset: float  # s, first sight of the blow
    channels: Mapping[str, BinnedChannel]
    times: Array
    where: Mapping[str, IntArray]
    settled: float  # s

    @property
    def name(self) -> str:
        """The recording's file name."""
        return self.recording.file


@dataclass(frozen=True, slots=True, eq=False)
class CampaignData:
    """All blows that can be used; those to fit come first."""

    blows: tuple[BlowData, ...]
    notes: tuple[str, ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)  # of a sample, by channel

    @property
    def fitted(self) -> tuple[int, ...]:
        """Indices of the blows that are fitted."""
        return tuple(i for i, b in enumerate(self.blows) if b.recording.role is Role.FIT)

    @property
    def held_out(self) -> tuple[int, ...]:
        """Indices of the blows that are predicted only."""
        return tuple(i for i, b in enumerate(self.blows) if b.recording.role is Role.HOLD_OUT)

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that at least one blow has."""
        return tuple(c for c in CHANNELS if any(c in b.channels for b in self.blows))


def prepare(campaign: Campaign) -> CampaignData:
    """Onset, noise and bins of every recording of an impact campaign.

    Raises InputError where no recording holds a blow that can be used.
    """
    notes: list[str] = []
    onsets: list[tuple[CampaignRecording, float]] = []
    for recording in campaign.recordings:
        known = [c for c in CHANNELS if c in recording.channels]
        others = sorted(set(recording.channels) - set(CHANNELS))
        if others:
            notes.append(f'{recording.file}: channel {", ".join(others)} is not used.')
        if not known:
            notes.append(f'{recording.file}: none of its channels can be used; it is left out.')
            continue
        onset = _onset([recording.channels[c] for c in known if c != 'acceleration.impactor'])
        if known == ['acceleration.impactor']:
            onset = _onset([recording.channels['acceleration.impactor']])
        if onset is None:
            notes.append(f'{recording.file}: no blow can be found; it is left out.')
            continue
        onsets.append((recording, onset))
    if not any(recording.role is Role.FIT for recording, _ in onsets):
        raise InputError(f'{campaign.name}: no recording to fit holds a blow that can be used')
    noise = _noise(onsets, campaign.noise_std)
    colours = _colours(onsets, campaign.noise_std)
    noise |= {name: colour.std for name, colour in colours.items()}
    if colours:
        notes.append(
            f'The noise of {", ".join(colours)} is not white before the blows: residuals are '
            'judged by what each sample tells beyond those before it.'
        )
    blows = []
    for recording, onset in sorted(onsets, key=lambda item: item[0].role is Role.HOLD_OUT):
        swinging = recording.kind == 'pendulum' and campaign.orientation is Orientation.HORIZONTAL
        blows.append(_blow(recording, onset, noise, colours, swinging, notes))
    seen = {name for blow in blows for name in blow.channels}
    struck = any(blow.recording.kind != 'tap' for blow in blows)
    for name, lost in _WITHOUT.items():
        if name not in seen and (struck or name != 'acceleration.impactor'):
            notes.append(f'No recording has {name}: {lost}.')
    return CampaignData(tuple(blows), tuple(notes), noise)


# --- onset and noise -------------------------------------------------------------------------


def _onset(channels: Sequence[ChannelSamples]) -> float | None:
    """Moment at which the first channel leaves its level before the blow, s."""
    found = []
    for channel in channels:
        values = channel.values
        finite = np.isfinite(values)
        if np.count_nonzero(finite) < 32:
            continue
        lead = max(8, min(values.size // 20, round(0.02 * channel.sample_rate)))
        level = float(np.nanmedian(values[:lead]))
        size = np.where(finite, np.abs(values - level), 0.0)
        peak = float(np.max(size))
        sigma = noise_std(values)
        before = float(np.nanmax(np.abs(values[:lead] - level)))
        threshold = max(0.05 * peak, 8.0 * sigma, 1.5 * before)
        if peak <= threshold or peak < 12.0 * sigma:
            continue
        first = int(np.argmax(size > threshold))
        found.append(channel.start + (first - 0.5) / channel.sample_rate)
    return min(found) if found else None


def _noise(
    onsets: Sequence[tuple[CampaignRecording, float]], stated: Mapping[str, float]
) -> dict[str, float]:
    """White noise of a sample by channel: pooled over what lies before the blows."""
    result = {}
    for name in CHANNELS:
        if name in stated:
            result[name] = stated[name]
            continue
        squares, weight = 0.0, 0
        for recording, onset in onsets:
            channel = recording.channels.get(name)
            if channel is None:
                continue
            count = int((onset - 2e-3 - channel.start) * channel.sample_rate)
            quiet = channel.values[:count] if count >= 64 else channel.values[-256:]
            sigma = noise_std(quiet)
            if math.isfinite(sigma):
                squares += quiet.size * sigma**2
                weight += quiet.size
        if weight:
            peak = max(
                float(np.nanmax(np.abs(r.channels[name].values)))
                for r, _ in onsets
                if name in r.channels
            )
            result[name] = max(math.sqrt(squares / weight), 1e-6 * peak, 1e-12)
    return result


def _colours(
    onsets: Sequence[tuple[CampaignRecording, float]], stated: Mapping[str, float]
) -> dict[str, Colour]:
    """Noise of the channels whose quiet before the blows is not white."""
    found = {}
    for name in CHANNELS:
        quiet: dict[float, list[Array]] = {}
        for recording, onset in onsets:
            channel = recording.channels.get(name)
            if channel is None or name in stated:
                continue
            count = int((onset - 2e-3 - channel.start) * channel.sample_rate)
            before = channel.values[: max(count, 0)]
            parts = _about_release(before) if name == 'acceleration.impactor' else [before]
            quiet.setdefault(channel.sample_rate, []).extend(parts)
        if len(quiet) == 1:
            rate, stretches = next(iter(quiet.items()))
            colour = colour_of(stretches, rate)
            if colour is not None:
                found[name] = colour
    return found


def _about_release(before: Array) -> list[Array]:
    """What an impactor shows before the blow, without its swing, and parted where it is let go."""
    if before.size < 16 or not np.isfinite(before).all():
        return []
    jump = int(np.argmax(np.abs(np.cumsum(before - np.mean(before)))))
    parts = [before[: max(jump - 2, 0)], before[jump + 3 :]]
    swing = [np.linspace(-1.0, 1.0, part.size) for part in parts]
    return [
        part - np.polyval(np.polyfit(t, part, 5), t)
        for part, t in zip(parts, swing, strict=True)
        if part.size >= 64
    ]


# --- bins --------------------------------------------------------------------------------------


def _blow(
    recording: CampaignRecording,
    onset: float,
    noise: Mapping[str, float],
    colours: Mapping[str, Colour],
    swinging: bool,
    notes: list[str],
) -> BlowData:
    channels = {}
    for name in CHANNELS:
        channel = recording.channels.get(name)
        if channel is None or name not in noise:
            continue
        last = LENGTH
        if swinging:  # nobody knows whether it comes back
            last = CAUGHT if name == 'acceleration.impactor' else RETURN
        coarse = name in ('force', 'acceleration.base')
        binned = _bin(channel, onset, noise[name], last, colours.get(name), coarse=coarse)
        channels[name] = binned
        if math.isfinite(binned.clipped_at):
            notes.append(
                f'{recording.file}: {name} is cut off at {binned.clipped_at:.4g} {channel.unit}; '
                'those samples are not fitted.'
            )
    settled = onset
    if recording.kind == 'tap':
        settled = onset + _tap_length(channels, onset)
        channels = {
            name: dataclasses.replace(
                c, used=c.used & ((c.centres < onset - TAP_LEAD) | (c.centres > settled))
            )
            for name, c in channels.items()
        }
    times, where = _moments(channels)
    return BlowData(recording, onset, channels, times, where, settled)


def _tap_length(channels: Mapping[str, BinnedChannel], onset: float) -> float:
    """Time after the onset at which a tap is over for certain, s.

    A bench that is left alone rings by ``a = -w^2 x - 2 z w v``, with speed and travel the
    integrals of its acceleration. What that rule, found late, does not say of the early samples
    is the force of the hammer. Without the plate's acceleration a long tap is presumed.
    """
    plate = channels.get('acceleration.plate')
    if plate is None or plate.samples.size < 64:
        return _PRESUMED_TAP
    since = plate.time - onset
    known = np.isfinite(plate.samples)
    a = np.where(known, plate.samples, 0.0)
    a = a - (float(np.mean(a[since < -TAP_LEAD])) if np.any(since < -TAP_LEAD) else 0.0)
    v = integrate.cumulative_trapezoid(a, dx=1 / plate.sample_rate, initial=0.0)
    x = integrate.cumulative_trapezoid(v, dx=1 / plate.sample_rate, initial=0.0)
    # drift of the integrals is a parabola
    columns = np.stack([v, x, np.ones_like(since), since, since**2], axis=1)
    tail = known & (since > _LONGEST_TAP) & (since < 5 * _LONGEST_TAP)
    if np.count_nonzero(tail) < 64:
        return _PRESUMED_TAP
    rule = np.linalg.lstsq(columns[tail], a[tail], rcond=None)[0]
    hammer = np.abs(a - columns @ rule)
    early = known & (since > -TAP_LEAD) & (since < _LONGEST_TAP)
    threshold = max(
        0.04 * float(np.max(hammer[early], initial=0.0)),
        6.0 * float(np.std((a - columns @ rule)[tail])),
    )
    acting = since[early & (hammer > threshold)]
    if not acting.size:
        return _SHORTEST_TAP
    # the threshold hides a soft end, filters and converters lengthen it
    return max(1.4 * float(acting[-1]) + 1e-3, _SHORTEST_TAP)


def _moments(channels: Mapping[str, BinnedChannel]) -> tuple[Array, dict[str, IntArray]]:
    every = [c.nodes for c in channels.values()]
    times, inverse = np.unique(np.concatenate(every), return_inverse=True)
    where, begin = {}, 0
    for name, channel in channels.items():
        size = channel.nodes.size
        where[name] = inverse[begin : begin + size].astype(np.int64)
        begin += size
    return times, where


def _bin(
    channel: ChannelSamples,
    onset: float,
    sigma: float,
    last: float,
    colour: Colour | None,
    *,
    coarse: bool,
) -> BinnedChannel:
    """One channel in bins; ``coarse``: one that contacts and reversals do not make jump."""
    rate = channel.sample_rate
    first = max(0, math.ceil((onset - LEAD - channel.start) * rate))
    stop = min(channel.values.size, math.floor((onset + last - channel.start) * rate) + 1)
    samples = np.asarray(channel.values[first:stop], dtype=np.float64)
    time = channel.start + (first + np.arange(samples.size)) / rate
    since = time - onset
    step = quantisation_step(samples[since < -2e-3])
    clip = _clipping(samples, channel, 8 if step > 0.2 * sigma else 3)
    # two nodes reproduce two samples exactly; longer bins would blur the kinks of contacts
    shortest = max(1, round(2e-4 * rate))
    size = np.full(samples.size, max(2, shortest) if coarse else shortest)
    size[since < -5e-3] = max(1, round(_LONG_BIN * rate))
    size[(since > _LATE) & _still(samples, sigma, round(_STILL * rate))] = max(
        1, round(_LONG_BIN * rate)
    )
    size[(since >= -5e-3) & (since < _FINE_UNTIL)] = 1
    size[_quick(samples, sigma, round(1.5e-3 * rate))] = 1
    edges = _edges(size)
    counts = np.diff(np.append(edges, samples.size))
    means = np.add.reduceat(samples, edges) / counts if samples.size else samples
    centres = time[edges] + 0.5 * (counts - 1) / rate
    nodes, first_nodes, node_counts = _nodes(time, edges, counts, onset, rate)
    slope = np.gradient(means, centres) if means.size > 1 else np.zeros(means.size)
    variance = sigma**2 / counts if colour is None else colour.variance_of_means(counts)
    variance = variance + (_FLOOR * sigma) ** 2 / counts
    variance = variance + (_RELATIVE_FLOOR * means) ** 2 + (_TIME_FLOOR * slope) ** 2
    used = np.isfinite(means)
    if channel.name == 'acceleration.impactor':
        used &= centres > onset + 0.5 / rate
    if math.isfinite(clip):
        hit = np.abs(samples) >= clip * (1 - 1e-6)
        used &= np.add.reduceat(hit.astype(np.int64), edges) == 0
    std = np.where(used, np.sqrt(np.where(used, variance, 1.0)), 1.0)
    return BinnedChannel(
        name=channel.name,
        unit=channel.unit,
        sample_rate=rate,
        time=time,
        samples=samples,
        edges=edges,
        counts=counts,
        nodes=nodes,
        first_nodes=first_nodes,
        node_counts=node_counts,
        centres=centres,
        means=np.where(used, means, 0.0),
        std=std,
        own_std=std,
        used=used,
        noise=sigma,
        step=step,
        clipped_at=clip,
        colour=colour,
    )


def _nodes(
    time: Array, edges: IntArray, counts: IntArray, onset: float, rate: float
) -> tuple[Array, IntArray, IntArray]:
    """Times at which each bin is simulated, the first of each bin, and how many it has.

    One for a sample, and two for two samples or a bin before the blow, so placed that cubics are
    exact. In a bin after the blow contacts may come and go that no noise shows: it is followed
    in steps of ``_NODE_STEP``.
    """
    width = counts / rate
    steps = np.where(counts > 1, 2, 1)
    followed = (width > 2 * _NODE_STEP) & (counts > 2) & (time[edges] > onset)
    steps[followed] = np.ceil(counts / max(1, round(_NODE_STEP * rate)))[followed]
    first = np.concatenate([[0], np.cumsum(steps)[:-1]]).astype(np.int64)
    place = np.arange(int(np.sum(steps))) - np.repeat(first, steps)
    count, parts = np.repeat(counts, steps), np.repeat(steps, steps)
    # means of n equal steps over the samples of a bin; two of them at the nodes of Gauss
    middle = (place + 0.5) / parts * count - 0.5
    half = np.sqrt((count.astype(np.float64) ** 2 - 1.0) / 12.0)
    gauss = 0.5 * (count - 1) + np.where(place > 0, half, -half)
    offset = np.where(parts == 2, gauss, middle)
    return np.repeat(time[edges], steps) + offset / rate, first, steps


def _quick(samples: Array, sigma: float, reach: int) -> NDArray[np.bool_]:
    """Samples near a change that is quicker than a bin could follow."""
    quick = np.zeros(samples.size, dtype=np.bool_)
    if samples.size < 5:
        return quick
    bend = np.abs(samples[2:] - 2.0 * samples[1:-1] + samples[:-2])
    quick[1:-1] = np.nan_to_num(bend) > 8.0 * math.sqrt(6.0) * sigma
    if reach > 0 and quick.any():
        quick = np.convolve(quick, np.ones(2 * reach + 1), 'same') > 0.5
    return quick


def _still(samples: Array, sigma: float, width: int) -> NDArray[np.bool_]:
    """Samples around which nothing is seen but noise."""
    if width < 8:
        return np.zeros(samples.size, dtype=np.bool_)
    known = np.nan_to_num(samples)
    mean = ndimage.uniform_filter1d(known, width)
    power = ndimage.uniform_filter1d((known - mean) ** 2, width)
    loud = power > (1.0 + 4.0 / math.sqrt(width)) * sigma**2
    return np.asarray(~ndimage.binary_dilation(loud, iterations=width))


def _edges(size: IntArray) -> IntArray:
    """First sample of each bin where ``size`` is the wanted length of the bin at each sample."""
    edges = []
    i = 0
    while i < size.size:
        edges.append(i)
        length = int(size[i])
        if length > 1:  # a bin does not reach into a stretch that wants shorter ones
            shorter = np.nonzero(size[i : i + length] < length)[0]
            if shorter.size:
                length = int(shorter[0])
        i += length
    return np.asarray(edges, dtype=np.int64)


def _clipping(samples: Array, channel: ChannelSamples, length: int) -> float:
    """Absolute value at which the channel is cut off, inf where it is not.

    ``length``: samples in a row at the largest value from which that is no coincidence.
    """
    size = np.abs(np.nan_to_num(samples))
    if size.size < 16:
        return math.inf
    peak = float(np.max(size))
    flat = (size >= peak * (1 - 1e-6)).astype(np.int64)
    runs = np.convolve(flat, np.ones(length, dtype=np.int64), 'valid')
    if runs.max() == length and peak > 5 * float(np.median(size)):
        return peak
    stated = min(abs(channel.range_min), abs(channel.range_max))
    if math.isfinite(stated) and peak >= stated * (1 - 1e-6):
        return stated
    return math.inf
