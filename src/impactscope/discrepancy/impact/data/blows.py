"""Recordings of blows made ready for a fit: onset, noise, and which samples count.

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

from impactscope.discrepancy.campaign import (
    IMPACT_CHANNELS,
    Campaign,
    CampaignRecording,
    ChannelSamples,
    Role,
)
from impactscope.discrepancy.evidence import noise_std, quantisation_step
from impactscope.discrepancy.impact.data.binning import BinnedChannel, binned, coarse_step, merged
from impactscope.discrepancy.impact.noise.by_recording import shared_and_own
from impactscope.discrepancy.impact.noise.coloured_noise import SHORTEST, Colour, colour_of
from impactscope.discrepancy.impact.noise.rounding import moving_noise
from impactscope.errors import InputError
from impactscope.physics.pendulum import STANDARD_GRAVITY, Orientation

__all__ = ['BlowData', 'CampaignData', 'prepare']

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


LEAD = 2.0  # s before the onset that are used at most
LENGTH = 4.0  # s after the onset that are used at most
RETURN = 0.35  # s after which a pendulum on the horizontal bench may be back
CAUGHT = 0.09  # s after which a pendulum on the horizontal bench may have been caught
TAP_LEAD = 5e-3  # s before the onset of a tap that may show its beginning
_SHORTEST_TAP = 4e-3  # s, counted out at least
_SOFT_END = 1e-3  # s, of a tap that its threshold hides
_SOFT_END_SAMPLES = 3.0
_PRESUMED_TAP = 0.015  # s, counted out where the end cannot be seen
_DOUBTFUL_TAP = 0.015  # s, from which a tap's length is looked at again
_ONE_SWING = 0.025  # s
_TOLD_BY = 24  # samples
_OF_NOISE = 5.0
_LATER = 0.02  # s, by which a force may show a contact later than the impactor
_LEAST_BEFORE = 16  # samples of the impactor before that
_TOLD = 4  # notes in an error
_MANY_BINS = 80_000  # of a campaign, above which late bins are longer
_COARSER = 0.35  # s after the onset, from which they are
_LET_GO = ('pendulum', 'drop')  # kinds of blows
_RELEASED = 1.25  # times the earth's acceleration, which a release shows
_KEEPS_STILL = ('robot', 'tap')  # whose impactor may show a level before the blow
_RELEASE = 2  # samples at least on either side of the moment in which an impactor is let go
_OF_RELEASE = 1.5  # times the least that is left, from which more than slow noise was there
_SHRUNK = 1.1  # times the least that is left, up to which a shorter gap will do
_BEFORE_RISE = 0.6  # of what precedes a blow, that shows the level
_JUST_BEFORE = 0.12  # s, that show it where it drifts
_RUN = 5  # samples, whose mean has
_RISEN = 3.0  # of the noise
_RISES = 2e-3  # s, at least, for which a blow is seen to begin: nearer it counts as no quiet
_TELLING = 64  # samples before the onset that tell how large the noise is
_HARDLY_TELLING = 24  # likewise, if no recording has more
_ENDING = 256  # samples at the end that do where none has
_STRETCHES = 16  # of a recording, the quietest of which tells it where there are no such samples
_LARGER = 1.3  # times what differences tell
_STEADY = 1.5  # times what is left without a smooth course: slow noise, but hardly a way of moving
_SMOOTH = 5  # order of the course that a swing takes within a recording
_JOLT = 6.0  # of the noise
_A_WHILE = 0.05  # s
_LONGEST_TAP = 0.035  # s after its onset in which the end of a tap is looked for


_WITHOUT = {
    'force': 'stiffness and mass of the sensor are known in their ratio alone',
    'acceleration.plate': 'taps are counted out by a presumed length, and friction at small '
    'motions is hardly seen',
    'acceleration.impactor': 'what happens in the contact and in the impactor is seen only '
    'through the plate',
    'acceleration.base': 'a fixture that gives way is seen only through the plate',
}  # what cannot be told without a channel


@dataclass(frozen=True, slots=True, eq=False)
class BlowData:
    """One blow: its recording, its onset and its channels.

    ``times``: rising, all moments at which the simulation is needed; ``where[channel]`` says
    which of them are the channel's nodes, shape (n_nodes,). ``settled``: moment from which the
    bench moves of its own after a tap; the onset for any other blow. ``caught``: s after first
    contact, from when on the impactor may be held and does not come back to the plate.
    """

    recording: CampaignRecording
    onset: float  # s, first sight of the blow
    channels: Mapping[str, BinnedChannel]
    times: Array
    where: Mapping[str, IntArray]
    settled: float  # s
    caught: float = math.inf

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
    noise_floor: Mapping[str, float] = field(default_factory=dict)  # as far as it can be seen

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
        return tuple(c for c in IMPACT_CHANNELS if any(c in b.channels for b in self.blows))


def prepare(campaign: Campaign, slower: Mapping[str, Colour] | None = None) -> CampaignData:
    """Onset, noise and bins of every recording of an impact campaign.

    ``slower``: noise of channels that is known to be slower than the quiet before the blows shows.

    Raises InputError where no recording holds a blow that can be used.
    """
    notes: list[str] = []
    onsets: list[tuple[CampaignRecording, float]] = []
    for recording in (r.part() for r in campaign.recordings):
        known = [c for c in IMPACT_CHANNELS if c in recording.channels]
        others = sorted(set(recording.channels) - set(IMPACT_CHANNELS))
        if others:
            notes.append(f'{recording.file}: channel {", ".join(others)} is not used.')
        if not known:
            notes.append(f'{recording.file}: none of its channels can be used; it is left out.')
            continue
        onset = _first_sight(recording.channels, let_go=recording.kind in _LET_GO)
        if onset is None:
            notes.append(
                f'{recording.file}: no blow can be found, for no channel leaves the level of '
                'its first 20 ms by more than its noise; does it begin before the blow? '
                'It is left out.'
            )
            continue
        onsets.append((recording, onset))
    if not any(recording.role is Role.FIT for recording, _ in onsets):
        raise InputError(
            f'{campaign.name}: no recording to fit holds a blow that can be used; '
            + ' '.join(notes[:_TOLD])
        )
    noise, unlike = _noise(onsets, campaign.noise_std)
    colours = _colours(onsets, campaign.noise_std, unlike)
    if colours:
        onsets = _seen_again(onsets, {name: colour.std for name, colour in colours.items()})
        noise, unlike = _noise(onsets, campaign.noise_std)
    slower = {n: c for n, c in (slower or {}).items() if n not in campaign.noise_std}
    if slower:
        notes.append(
            f'The noise of {", ".join(slower)} is slower than the quiet before the blows shows: '
            'it is read from what is left while the bench is at rest.'
        )
    only_before = ', '.join(name for name in colours if name not in slower)
    colours |= slower
    noise |= {name: colour.std for name, colour in colours.items()}
    moving = _when_moving(onsets, noise, campaign.noise_std)
    unlike = {(file, name): f for (file, name), f in unlike.items() if name not in moving}
    notes += _told_unlike(unlike)
    for name, std in moving.items():
        if name in colours:
            white = colours[name].white + std**2 - noise[name] ** 2
            colours[name] = dataclasses.replace(colours[name], white=white)
        noise[name] = std
    floor = {name: std * _on_average(onsets, name, unlike) for name, std in noise.items()}
    floor |= _seen(onsets, {n: c for n, c in colours.items() if n not in slower}) | moving
    if only_before:
        notes.append(
            f'The noise of {only_before} is not white before the blows: residuals are '
            'judged by what each sample tells beyond those before it.'
        )
    horizontal = campaign.orientation is Orientation.HORIZONTAL
    caught = horizontal and not _left_to_return(onsets, noise)  # for all one knows
    blows: list[BlowData] = []
    for coarser in (math.inf, _COARSER):
        told: list[str] = []
        blows = []
        for recording, onset in sorted(onsets, key=lambda item: item[0].role is Role.HOLD_OUT):
            doubtful = caught and recording.kind == 'pendulum'
            own = {name: unlike.get((recording.file, name), 1.0) for name in noise}
            own_noise = {name: own[name] * std for name, std in noise.items()}
            own_colours = {name: colour.scaled(own[name]) for name, colour in colours.items()}
            blows.append(_blow(recording, onset, own_noise, own_colours, doubtful, told, coarser))
        if sum(c.centres.size for b in blows for c in b.channels.values()) <= _MANY_BINS:
            break
    notes += told
    seen = {name for blow in blows for name in blow.channels}
    struck = any(blow.recording.kind != 'tap' for blow in blows)
    for name, lost in _WITHOUT.items():
        if name not in seen and (struck or name != 'acceleration.impactor'):
            notes.append(f'No recording has {name}: {lost}.')
    return CampaignData(tuple(blows), tuple(notes), noise, floor)


# --- onset and noise -------------------------------------------------------------------------


def _seen_again(
    onsets: Sequence[tuple[CampaignRecording, float]], noise: Mapping[str, float]
) -> list[tuple[CampaignRecording, float]]:
    """Onsets once all recordings have told how large noise is that is not white.

    A quiet of a few milliseconds shows less of it than its waves, which then pass for the blow.
    """
    again = []
    for recording, onset in onsets:
        let_go = recording.kind in _LET_GO
        later = _first_sight(recording.channels, let_go=let_go, noise=noise)
        again.append((recording, onset if later is None else later))
    return again


def _first_sight(
    channels: Mapping[str, ChannelSamples],
    *,
    let_go: bool = False,
    noise: Mapping[str, float] | None = None,
) -> float | None:
    """Moment at which a blow is first seen, s.

    ``noise``: of a sample, by channel, as far as other recordings tell it.

    A base moves by less and later than what stands on it, and where it does not move at all slow
    noise may look like a blow: it is asked where the others say nothing. An impactor that swings
    is asked where there is nothing else, and for the contact that a force shows milliseconds late:
    a heavy plate has to move before its spring is loaded. Where the impactor is ``let_go`` its
    accelerometer changes by the earth's once, and that is no contact.
    """
    least = _RELEASED * STANDARD_GRAVITY if let_go else 0.0
    for names in (IMPACT_CHANNELS[:2], IMPACT_CHANNELS[3:]):
        group = [channels[c] for c in names if c in channels]
        found = _onset(group, noise=noise)
        if found is not None:
            found = min(_departs(c, found, (noise or {}).get(c.name, 0.0)) for c in group)
            impactor = channels.get('acceleration.impactor')
            if impactor is None or 'acceleration.plate' in channels:
                return found
            return _touched(impactor, found, least, (noise or {}).get(impactor.name, 0.0))
    if any(c in channels for c in IMPACT_CHANNELS if c != 'acceleration.impactor'):
        return None
    alone = [channels['acceleration.impactor']]
    found = _onset(alone, least, noise)
    return _onset(alone, noise=noise) if found is None else found


def _touched(
    channel: ChannelSamples, seen: float, least: float = 0.0, noise: float = 0.0
) -> float:
    """Moment at which an impactor meets what the force shows at ``seen``, s; never later.

    ``least``: change of its acceleration, m/s^2, up to which it may only have been let go.
    ``noise``: of a sample, as other recordings tell it: slow noise may be still for a while.
    """
    since = channel.time - seen
    before = (since > -3.0 * _LATER) & (since < -_LATER) & np.isfinite(channel.values)
    near = (since >= -_LATER) & (since <= 0.0)
    if np.count_nonzero(before) < _LEAST_BEFORE or not np.any(near):
        return seen
    quiet = channel.values[before]
    level = float(np.median(quiet))
    size = np.abs(np.nan_to_num(channel.values[near] - level))
    own = float(np.max(np.abs(quiet - level)))
    sigma = max(noise, noise_std(quiet))
    threshold = max(0.05 * float(np.max(size)), 8.0 * sigma, 1.5 * own, least)
    if not np.any(size > threshold):
        return seen
    first = int(np.argmax(size > threshold))
    return min(seen, float(channel.time[near][first]) - 0.5 / channel.sample_rate)


def _departs(channel: ChannelSamples, seen: float, noise: float = 0.0) -> float:
    """Moment at which a channel begins to go where it is clearly ``seen``, s.

    A twentieth of the peak of a quiet sensor is far above its noise, and a heavy plate loads its
    spring for milliseconds until then. Nothing less counts: noise may precede any blow.
    """
    before = (channel.time < seen) & np.isfinite(channel.values)
    values = channel.values[before]
    if values.size < _TELLING:
        return seen
    early = values[: round(_BEFORE_RISE * values.size)]
    level = float(np.median(early))
    sigma = max(noise, noise_std(early), float(np.median(np.abs(early - level))) / 0.6745)
    since = channel.time[before] - seen
    latest = values[(since > -_JUST_BEFORE) & (since < -_LATER)]
    if latest.size >= _TELLING:  # a drift may have led far away by then
        level = float(np.median(latest))
    run = ndimage.uniform_filter1d(values - level, _RUN, mode='nearest')
    quiet = np.flatnonzero(np.abs(run) <= _RISEN * sigma)
    last = int(quiet[-1]) if quiet.size else -1
    if last + 1 >= values.size:
        return seen
    moment = float(channel.time[before][last + 1])
    return moment if _RISES < seen - moment < _LATER else seen


def _onset(
    channels: Sequence[ChannelSamples],
    least: float = 0.0,
    noise: Mapping[str, float] | None = None,
) -> float | None:
    """Moment at which the first channel leaves its level before the blow by ``least``, s."""
    left = (_leaves(c, least, (noise or {}).get(c.name, 0.0)) for c in channels)
    return min((first for first in left if first is not None), default=None)


def _leaves(channel: ChannelSamples, least: float = 0.0, noise: float = 0.0) -> float | None:
    """Moment at which a channel leaves its level; None where it shows no more than noise.

    ``least``: distance from the level that counts at least. ``noise``: of a sample, as other
    recordings tell it.
    """
    values = channel.values
    finite = np.isfinite(values)
    if np.count_nonzero(finite) < 32:
        return None
    lead = max(8, min(values.size // 20, round(0.02 * channel.sample_rate)))
    level = float(np.nanmedian(values[:lead]))
    size = np.where(finite, np.abs(values - level), 0.0)
    peak = float(np.max(size))
    before = float(np.nanmax(np.abs(values[:lead] - level)))
    sigma = noise_std(values)
    while True:
        threshold = max(0.05 * peak, 8.0 * sigma, 1.5 * before, least)
        if peak <= threshold or peak < 12.0 * sigma:
            return None
        first = int(np.argmax(size > threshold))
        # noise that is not white is larger than its differences tell
        own = float(np.median(size[:first])) / 0.6745 if first >= _TELLING else 0.0
        if first < _TELLING:
            parts = np.array_split(values, _STRETCHES)
            own = max(noise, min(float(np.nanstd(part)) for part in parts))
        if own <= _LARGER * sigma:
            return channel.start + (first - 0.5) / channel.sample_rate
        sigma = own


def _noise(
    onsets: Sequence[tuple[CampaignRecording, float]], stated: Mapping[str, float]
) -> tuple[dict[str, float], dict[tuple[str, str], float]]:
    """White noise of a sample by channel, from what lies before the blows.

    Returns what recordings share, by channel; and of those that are unlike the others for certain
    how many times that their noise is, by file and channel.
    """
    result, unlike = {}, {}
    for name in IMPACT_CHANNELS:
        if name in stated:
            result[name] = stated[name]
            continue
        heard = [(r.channels[name], onset) for r, onset in onsets if name in r.channels]
        files = [r.file for r, _ in onsets if name in r.channels]
        told = []
        quietest, certain = _quietest(heard)
        for i, quiet, step in quietest:
            sigma = max(noise_std(quiet), step / math.sqrt(12.0))
            if math.isfinite(sigma):
                told.append((files[i], sigma, quiet.size))
        if not told:
            continue
        peak = max(float(np.nanmax(np.abs(channel.values))) for channel, _ in heard)
        least = max(1e-6 * peak, 1e-12)
        stds = np.maximum([sigma for _, sigma, _ in told], least)
        sizes = np.array([size for _, _, size in told])
        result[name], own = shared_and_own(stds, sizes)
        if certain:
            for (file, _, _), std in zip(told, own.tolist(), strict=True):
                if std != result[name]:
                    unlike[file, name] = std / result[name]
        else:  # what rings, or a few samples, are no noise of their own
            result[name] = math.sqrt(float(sizes @ stds**2) / float(np.sum(sizes)))
    return result, unlike


def _told_unlike(unlike: Mapping[tuple[str, str], float]) -> list[str]:
    """The note on recordings whose noise is not that of the others."""
    if not unlike:
        return []
    each = ', '.join(f'{name} of {file} ({f:.2g} times)' for (file, name), f in unlike.items())
    return [f'Noise is not the same in all recordings: {each}; each is judged by its own.']


def _on_average(
    onsets: Sequence[tuple[CampaignRecording, float]],
    name: str,
    unlike: Mapping[tuple[str, str], float],
) -> float:
    """RMS of the noise of a channel over all recordings, in units of what they share."""
    there = [r for r, _ in onsets if name in r.channels]
    sizes = [r.channels[name].values.size for r in there]
    squares = [unlike.get((r.file, name), 1.0) ** 2 for r in there]
    return math.sqrt(float(np.average(squares, weights=sizes))) if there else 1.0


def _quietest(
    heard: Sequence[tuple[ChannelSamples, float]],
) -> tuple[list[tuple[int, Array, float]], bool]:
    """Samples of a channel that tell its noise, and the step of its converter, by recording.

    Those before the blows. Recordings with too few of them are asked only where no other is, and
    where there are next to none the end of each: it may still ring. Whether there are enough
    comes last.
    """
    before = [
        (
            i,
            c.values[: max(int((onset - 2e-3 - c.start) * c.sample_rate), 0)],
            coarse_step(c, onset),
        )
        for i, (c, onset) in enumerate(heard)
    ]
    for least in (_TELLING, _HARDLY_TELLING):
        long = [item for item in before if item[1].size >= least]
        if long:
            return long, least == _TELLING
    ends = enumerate(heard)
    return [(i, c.values[-_ENDING:], coarse_step(c, onset)) for i, (c, onset) in ends], False


def _when_moving(
    onsets: Sequence[tuple[CampaignRecording, float]],
    noise: Mapping[str, float],
    stated: Mapping[str, float],
) -> dict[str, float]:
    """Noise while the bench moves, of channels whose coarse steps show less of it at rest."""
    found = {}
    for name in noise:
        if name in stated or name == 'acceleration.impactor':  # that swings at rest
            continue
        squares, most = [], 0.0
        for recording, onset in onsets:
            channel = recording.channels.get(name)
            step = 0.0 if channel is None else quantisation_step(channel.values)
            if channel is not None and step > noise[name]:
                quiet = channel.values[channel.time < onset - 2e-3]
                squares.append(moving_noise(quiet[np.isfinite(quiet)], step) ** 2)
                most = max(most, math.hypot(noise[name], step / math.sqrt(12.0)))
        told = [square for square in squares if square > 0.0]
        if told and math.sqrt(np.mean(told)) > noise[name]:
            found[name] = min(math.sqrt(np.mean(told)), most)
    return found


def _colours(
    onsets: Sequence[tuple[CampaignRecording, float]],
    stated: Mapping[str, float],
    unlike: Mapping[tuple[str, str], float],
) -> dict[str, Colour]:
    """Noise of the channels whose quiet before the blows is not white; as recordings share it."""
    found: dict[str, Colour] = {}
    quiet = {name: _quiet(onsets, name, unlike) for name in IMPACT_CHANNELS if name not in stated}
    for beside in (False, True):
        if beside and not found:
            break
        for name in [n for n, (q, _) in quiet.items() if len(q) == 1 and n not in found]:
            by_rate, bent = quiet[name]
            rate, stretches = next(iter(by_rate.items()))
            colour = colour_of(stretches, rate, bent=bent, beside=beside)
            if colour is not None:
                found[name] = colour
    return found


def _seen(
    onsets: Sequence[tuple[CampaignRecording, float]], colours: Mapping[str, Colour]
) -> dict[str, float]:
    """RMS of the noise before the blows, of channels where that is not white.

    Its colour reckons with slower noise, too, than the quiet is long enough to show; but of an
    impactor a polynomial may leave more of a swing than noise.
    """
    found = {}
    for name, colour in colours.items():
        squares, freedom = 0.0, 0
        for stretch in (s for parts in _quiet(onsets, name)[0].values() for s in parts):
            if stretch.size > 2 and np.isfinite(stretch).all():
                level = stretch - np.mean(stretch)
                squares += float(level @ level)
                freedom += stretch.size - 1
        if freedom:
            found[name] = math.sqrt(squares / freedom)
            if name == 'acceleration.impactor':
                found[name] = min(found[name], colour.std)
    return found


def _quiet(
    onsets: Sequence[tuple[CampaignRecording, float]],
    name: str,
    unlike: Mapping[tuple[str, str], float] | None = None,
) -> tuple[dict[float, list[Array]], bool]:
    """What a channel shows before the blows, by its sample rate; ``unlike``: over its noise.

    And whether a swing was taken off any of it.
    """
    quiet: dict[float, list[Array]] = {}
    bent = False
    for recording, onset in onsets:
        channel = recording.channels.get(name)
        if channel is None:
            continue
        count = int((onset - 2e-3 - channel.start) * channel.sample_rate)
        before = channel.values[: max(count, 0)]
        factor = (unlike or {}).get((recording.file, name), 1.0)
        before = before / factor if factor != 1.0 else before
        parts = [before]
        if name == 'acceleration.impactor':
            unswung = _about_release(before)
            if recording.kind not in _KEEPS_STILL or not _steady(before, unswung):
                parts, bent = unswung, True
        quiet.setdefault(channel.sample_rate, []).extend(parts)
    return quiet, bent


def _steady(before: Array, unswung: Sequence[Array]) -> bool:
    """Whether an impactor shows no more before the blow than without its smooth course."""
    return before.size >= SHORTEST and float(np.std(before)) <= _STEADY * _pooled(unswung)


def _hangs(channel: ChannelSamples, onset: float) -> bool:
    """Whether an impactor is at rest before a hammer strikes the plate."""
    before = channel.values[channel.time < onset - 2e-3]
    return _steady(before, _about_release(before))


def _about_release(before: Array) -> list[Array]:
    """What an impactor shows before the blow, without its swing, and parted where it is let go.

    To let go may take many samples: as many are left out on either side as it takes until what is
    left shrinks no further.
    """
    if before.size < 16 or not np.isfinite(before).all():
        return []
    jump = int(np.argmax(np.abs(np.cumsum(before - np.mean(before)))))
    parts = _without_swing(before, jump, _RELEASE)
    spread = _pooled(parts)
    if spread <= _LARGER * noise_std(before):
        return parts
    gaps = [_RELEASE * 2**n for n in range(1, 12) if _RELEASE * 2**n < before.size // 4]
    tried = [_without_swing(before, jump, gap) for gap in gaps]
    least = min([spread, *map(_pooled, tried)])
    if spread <= _OF_RELEASE * least:
        return parts
    return next(p for p in tried if _pooled(p) <= _SHRUNK * least)


def _without_swing(before: Array, jump: int, gap: int) -> list[Array]:
    """The parts on either side of a jump, ``gap`` samples away, without their smooth course."""
    parts = [before[: max(jump - gap, 0)], before[jump + gap + 1 :]]
    if max(part.size for part in parts) < SHORTEST:  # too short a time to be let go in
        parts = [before]
    swing = [np.linspace(-1.0, 1.0, part.size) for part in parts]
    return [
        part - np.polyval(np.polyfit(t, part, 5), t)
        for part, t in zip(parts, swing, strict=True)
        if part.size >= SHORTEST
    ]


def _pooled(parts: Sequence[Array]) -> float:
    """RMS of all parts."""
    size = sum(part.size for part in parts)
    return math.sqrt(sum(float(part @ part) for part in parts) / size) if size else math.inf


# --- blows -------------------------------------------------------------------------------------


def _blow(
    recording: CampaignRecording,
    onset: float,
    noise: Mapping[str, float],
    colours: Mapping[str, Colour],
    doubtful: bool,
    notes: list[str],
    coarser: float,
) -> BlowData:
    """A blow as it is compared; where ``doubtful`` a hand may have caught its pendulum.

    Caught or not: where nothing on the bench rises again the bench is left to itself.
    """
    channels = {}
    quiet = doubtful and not _may_come_back(recording.channels, onset, noise)
    alone = quiet and _swings_free(recording.channels, onset, noise)
    for name in IMPACT_CHANNELS:
        channel = recording.channels.get(name)
        if channel is None or name not in noise:
            continue
        last = LENGTH
        if doubtful and not alone and name == 'acceleration.impactor':
            last = CAUGHT
        elif doubtful and not quiet:  # nobody knows whether it is the impactor that does that
            last = RETURN
        coarse = name in ('force', 'acceleration.base')
        channels[name] = binned(
            channel,
            (onset, LEAD, last),
            noise[name],
            colours.get(name),
            coarse=coarse,
            hangs=recording.kind == 'tap' and _hangs(channel, onset),
            ringing=min(coarser, RETURN if quiet else math.inf),
        )
        if math.isfinite(channels[name].clipped_at):
            notes.append(
                f'{recording.file}: {name} is cut off at {channels[name].clipped_at:.4g} '
                f'{channel.unit}; those samples are not fitted.'
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
    times, where = merged({name: c.nodes for name, c in channels.items()})
    # one that is caught must not come back in a simulation either
    caught = RETURN if quiet and not alone else math.inf
    return BlowData(recording, onset, channels, times, where, settled, caught)


def _may_come_back(
    channels: Mapping[str, ChannelSamples], onset: float, noise: Mapping[str, float]
) -> bool:
    """Whether anything on the bench rises again after it has rung down, or nobody knows."""
    return any(
        _rises_again(channel, onset, noise[name])
        for name, channel in channels.items()
        if name in noise and name != 'acceleration.impactor'
    )


def _swings_free(
    channels: Mapping[str, ChannelSamples], onset: float, noise: Mapping[str, float]
) -> bool:
    """Whether a pendulum on the horizontal bench is seen not to be caught.

    Its own accelerometer has to say so: what swings free changes smoothly, a hand jolts it.
    """
    own = channels.get('acceleration.impactor')
    if own is None or 'acceleration.impactor' not in noise:
        return False
    free = own.values[own.time > onset + CAUGHT]
    if free.size < _TELLING or not np.isfinite(free).all():
        return False
    course = np.polynomial.Polynomial.fit(np.arange(free.size), free, _SMOOTH)
    left = np.abs(free - course(np.arange(free.size)))
    sigma = noise['acceleration.impactor']
    return float(np.max(left)) <= _JOLT * sigma and float(np.std(left)) <= _LARGER * sigma


def _left_to_return(
    onsets: Sequence[tuple[CampaignRecording, float]], noise: Mapping[str, float]
) -> bool:
    """Whether the bench shows a pendulum to have come back: where one does none was caught.

    A hand that lets it go again would be told by its own accelerometer; with that nothing is
    presumed.
    """
    return not any('acceleration.impactor' in r.channels for r, _ in onsets) and any(
        recording.kind == 'pendulum'
        and name in noise
        and np.isfinite(channel.values[channel.time > onset]).all()
        and float(channel.time[-1]) > onset + RETURN
        and _rises_again(channel, onset, noise[name])
        for recording, onset in onsets
        for name, channel in recording.channels.items()
    )


def _rises_again(channel: ChannelSamples, onset: float, noise: float) -> bool:
    """Whether a channel shows more than before, after the blow has rung down for a while."""
    since = channel.time - onset
    level = float(np.nanmedian(channel.values[since < 0.0])) if np.any(since < 0.0) else 0.0
    after = since > RETURN - _A_WHILE
    blocks = np.floor((since[after] - RETURN) / _A_WHILE).astype(np.int64)
    size = np.abs(channel.values[after] - level)
    if not size.size or not np.isfinite(size).all():
        return True
    peaks = ndimage.maximum(size, blocks, np.unique(blocks))
    return bool(np.any(np.diff(peaks) > _JOLT * noise))


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
    beyond = max(_SOFT_END, _SOFT_END_SAMPLES / plate.sample_rate)
    length = max(1.4 * float(acting[-1]) + beyond, _SHORTEST_TAP)
    if length > _DOUBTFUL_TAP:
        length = min(length, _left_alone(plate, since, a, v, x))
    return length


def _left_alone(plate: BinnedChannel, since: Array, a: Array, v: Array, x: Array) -> float:
    """Time after the onset from which a bench with friction and a bent spring is left alone, s.

    Strong friction or a bent spring break the linear rule for as long as the bench moves. Over
    one swing a rule with both fits to within the noise, reversals apart, once the hammer has
    gone. Infinity where it never does.
    """
    known = np.isfinite(plate.samples)
    turning = ndimage.binary_dilation(np.diff(np.sign(v), append=np.sign(v[-1])) != 0, np.ones(5))
    for begin in np.arange(_SHORTEST_TAP, _LONGEST_TAP, 1e-3).tolist():
        chosen = known & (since > begin) & (since < begin + _ONE_SWING) & ~turning
        t = since[chosen] - begin
        if t.size < _TOLD_BY:
            continue
        own_v, own_x = v[chosen], x[chosen]
        columns = np.stack(
            [own_v, own_x, np.ones_like(t), t, np.sign(own_v), own_x**3, own_v * np.abs(own_v)], 1
        )
        columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        rule = np.linalg.lstsq(columns, a[chosen], rcond=1e-10)[0]
        left = a[chosen] - columns @ rule
        if float(np.max(np.abs(left))) < _OF_NOISE * plate.noise:
            return float(1.2 * begin + 1e-3)
    return math.inf
