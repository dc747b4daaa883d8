"""One epoch of a stream: learning its noise, watching for blows, following each to its rest."""

from __future__ import annotations

import enum
import math
from collections import Counter, deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.detect import kernels
from impactscope.detect.event_window import (
    Layout,
    Opening,
    build_event,
    contact_threshold,
    contacts_of,
    opened_reading,
    smoothed_peak,
)
from impactscope.detect.history import History
from impactscope.detect.noise_floor import (
    NoiseFloor,
    alike,
    hop_variances,
    plain_powers,
    quantum,
    quiet_powers,
    window_lengths,
    without_slow_motion,
)
from impactscope.detect.plate_memory import PlateMemory
from impactscope.detect.settings import DetectorSettings
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import NANOSECONDS, Contact, ImpactEvent, Quality, SyncedBlock

__all__ = ['EpochScan']

CLOCK_TOLERANCE = 2  # ns by which a stamp may differ from the timeline without being adopted
CLOCK_JUMP = 1_000_000  # ns beyond which such a difference is a jump and not a slewing clock
REST_POWER = 2.0  # a signal at rest has at most this times the power of its noise floor
ONSET_SLACK = 0.05  # s kept beyond the pre-trigger: a slow rise triggers late


class _State(enum.Enum):
    LEARNING = enum.auto()  # the noise floor
    WATCHING = enum.auto()  # for a blow
    FOLLOWING = enum.auto()  # a blow, to its rest


class EpochScan:
    """Finds the blows of one epoch, hop by hop, hops counted from the epoch's first sample.

    Args:
        record: first block of the epoch; it is not taken in by this.
        row: of the trigger channel in it.
        settings: of the detector.
        profile: the rules of the measurement.
        counts: what happened is counted here.
    """

    def __init__(
        self,
        record: SyncedBlock,
        row: int,
        settings: DetectorSettings,
        profile: MeasurementProfile,
        counts: Counter[str],
    ) -> None:
        stride = record.oversampling if row == 0 else 1
        rate = record.sample_rate / stride
        hop = max(round(settings.window * rate), settings.samples)
        step = hop / rate
        self.settings = settings
        self.profile = profile
        self.counts = counts
        self._layout = Layout(
            channels=record.channels,
            epoch=record.epoch,
            grid_rate=record.sample_rate,
            oversampling=record.oversampling,
            row=row,
            stride=stride,
            hop=hop,
            scales=window_lengths(settings.samples, hop),
        )
        self._in_newtons = record.channels[row].unit == 'N'
        self._learn_hops = max(2 * math.ceil(settings.learning_time / step / 2), 2)
        self._rest_hops = max(math.ceil(profile.rest_hold / step - 1e-9), 1)
        self._memory_hops = math.ceil(settings.memory / step) + kernels.GUARD
        self._width = hop * stride  # of a hop, on the grid
        self._retained = math.ceil((profile.pre_trigger + ONSET_SLACK) * record.sample_rate)
        self._history = History(len(record.channels), record.sample_rate, record.first_index)
        self._history.anchor(record.first_index, record.stamp_ns)
        self._begin = -(-record.first_index // stride) * stride  # of the stream, on a sample
        self._position = self._begin  # next sample to be analysed
        self._jumps: deque[int] = deque(maxlen=64)  # indices at which the clock jumped
        self._plates = PlateMemory(settings)
        self._overlap = False  # the next blow begins before the last one came to rest
        self._enter_learning(cold=True)

    def fits(self, record: SyncedBlock) -> bool:
        """Whether a block continues this epoch."""
        return self._layout.fits(record)

    @property
    def noise_floor(self) -> tuple[float, float]:
        """Zero level and noise of the trigger channel as now known, in its unit; or NaN."""
        if self._state is _State.LEARNING:
            return math.nan, math.nan
        return float(self._floor.line[0]), float(self._floor.sigma[0])

    def finish(self) -> list[ImpactEvent]:
        """The epoch has ended: look at what is left, close an open event as torn."""
        events = self.advance()
        if self._state is _State.LEARNING and self._cold:
            self._learn_from_what_there_is()
            events += self.advance()
        if self._state is _State.WATCHING:
            self._scan_rest()
        if self._state is _State.FOLLOWING:
            # Where only another channel still rings, it alone is torn.
            rest = self._rested
            quality = Quality.TORN if rest is None else Quality.NONE
            torn = self._restless(self._position - self._rest_hops * self._width) if rest else []
            events += self._close(self._history.stop, quality, rest_from=rest, torn=torn)
        return events

    def append(self, record: SyncedBlock) -> list[ImpactEvent]:
        """Take the samples in; an event comes out where too many before them were lost."""
        events: list[ImpactEvent] = []
        history = self._history
        values = record.values
        first = record.first_index
        if first < history.stop:
            seen = min(history.stop - first, values.shape[1])
            self.counts['duplicates'] += seen
            values = values[:, seen:]
            first += seen
            if values.shape[1] == 0:
                return events
        elif first > history.stop:
            events += self._bridge(first)
            history = self._history
        expected = history.stamp(record.first_index)
        difference = abs(record.stamp_ns - expected)
        if difference > CLOCK_TOLERANCE:
            history.anchor(first, record.stamp_ns + self._duration_ns(first - record.first_index))
            if difference > CLOCK_JUMP:
                self._jumps.append(first)
                self.counts['clock_jumps'] += 1
        history.append(values, tuple(channel.quality for channel in record.channels))
        self.counts['samples'] += values.shape[1]
        return events

    def _bridge(self, first: int) -> list[ImpactEvent]:
        """Samples were lost up to ``first``: their place is NaN, unless they are too many."""
        history = self._history
        lost = first - history.stop
        self.counts['lost'] += lost
        if lost <= self.profile.rest_hold * self._layout.grid_rate:
            gap = np.full((len(self._layout.channels), lost), math.nan, dtype=np.float32)
            history.append(gap, (Quality.GAP_BEFORE,) * len(self._layout.channels))
            return []
        events = self.advance()
        if self._state is _State.FOLLOWING:
            events += self._close(history.stop, Quality.TORN | Quality.GAP_BEFORE, rest_from=None)
        layout = self._layout
        stamp = history.stamp(first)
        self._history = History(len(layout.channels), layout.grid_rate, first)
        self._history.anchor(first, stamp)
        # Hops keep their places on the grid.
        self._begin += -(-(first - self._begin) // self._width) * self._width
        self._position = self._begin
        self._enter_learning(cold=True)
        return events

    def _duration_ns(self, samples: int) -> int:
        return round(samples * NANOSECONDS / self._layout.grid_rate)

    def _number(self, index: int) -> int:
        """Number of the hop that begins at a grid index."""
        return (index - self._begin) // self._width

    # States ----------------------------------------------------------------------------------

    def advance(self) -> list[ImpactEvent]:
        """Analyse the whole hops there are; return the events complete with them."""
        events: list[ImpactEvent] = []
        while (ready := (self._history.stop - self._position) // self._width) > 0:
            if self._state is _State.WATCHING:
                self._watch(ready, self._layout.hop)
            elif self._state is _State.LEARNING:
                self._learn()
            else:
                events += self._follow()
        if self._state is _State.WATCHING:
            self._history.drop_before(self._position - self._width - self._retained)
        return events

    def _enter_learning(self, *, cold: bool) -> None:
        layout = self._layout
        self._state = _State.LEARNING
        self._cold = cold
        self._learn_from = self._position
        self._floor = NoiseFloor(
            len(layout.channels), layout.hop, layout.scales, self._memory_hops
        )
        if not cold:
            self.counts['relearned'] += 1

    def _learn(self) -> None:
        """One hop more of a stream whose noise is not known yet."""
        self._position += self._width
        hops = (self._position - self._learn_from) // self._width
        longest = self.profile.longest_ring_down + self.settings.learning_time
        if hops >= self._learn_hops:
            start = self._position - self._learn_hops * self._width
            stretch = self._history.view(start, self._position)
            samples = self._native(start, self._position)
            powers = quiet_powers(
                samples, self._layout.scales, self._layout.hop, self.settings.threshold
            )
            if powers is not None and not self._others_stationary(stretch):
                powers = None
            if powers is not None and self._moves(samples):
                powers = None  # a swing about to turn looks stationary
            late = hops * self._width >= longest * self._layout.grid_rate
            if powers is None and late and np.isfinite(samples).all():
                powers = self._plain_powers(samples)
            if powers is not None:
                in_motion = self._cold and self._moves(samples)
                self._settle(start, self._position, powers)
                if in_motion:
                    self._open_in_motion(start + stretch.shape[1])
                return
            if late:  # no longer worth looking back to
                self._learn_from += self._width
        self._history.drop_before(self._learn_from - self._retained)

    def _others_stationary(self, stretch: NDArray[np.float32]) -> bool:
        """Whether the channels beside the trigger are neither ringing down nor being struck."""
        return not self._changing(stretch)

    def _changing(self, stretch: NDArray[np.float32]) -> list[int]:
        """Rows beside the trigger whose power is not the same in the stretch's two halves."""
        half = stretch.shape[1] // (2 * self._width) * self._width
        if half == 0:
            return []
        before = hop_variances(stretch[:, :half], self._width)
        after = hop_variances(stretch[:, -half:], self._width)
        return [
            row
            for row, (a, b) in enumerate(zip(before, after, strict=True))
            if row != self._layout.row and math.isfinite(a + b) and not alike(a, b, REST_POWER)
        ]

    def _native(self, start: int, stop: int) -> NDArray[np.float64]:
        """The trigger channel's own samples between two grid indices."""
        row = self._history.view(start, stop)[self._layout.row, :: self._layout.stride]
        return row.astype(np.float64)

    def _learn_from_what_there_is(self) -> None:
        """The stream ended before it was quiet: take its quietest part for the noise floor."""
        row = self._history.values[self._layout.row]
        hops = (self._history.stop - self._learn_from) // self._width
        # Perhaps only another channel was not quiet, or the very end was not: the noise is then
        # the mean over all quiet stretches.
        quiet = []
        for end in range(hops, self._learn_hops - 1, -(self._learn_hops // 2)):
            stop = self._learn_from + end * self._width
            start = stop - self._learn_hops * self._width
            powers = quiet_powers(
                self._native(start, stop),
                self._layout.scales,
                self._layout.hop,
                self.settings.threshold,
            )
            if powers is not None and not self._moves(self._native(start, stop)):
                quiet.append((start, stop, powers))
        if quiet:
            self._settle(*quiet[0][:2], np.mean([powers for _, _, powers in quiet], axis=0))
            return
        best, least = -1, math.inf
        for h in range(hops):
            column = self._history.column(self._learn_from + h * self._width)
            spread = float(np.var(row[column : column + self._width].astype(np.float64)))
            if spread <= least:
                best, least = h, spread
        if best >= 0:
            start = self._learn_from + best * self._width
            native = self._native(start, start + self._width)
            self._settle(start, start + self._width, self._plain_powers(native))
            if self._moves(native):
                self._open_in_motion(self._history.stop)

    def _moves(self, samples: NDArray[np.float64]) -> bool:
        """Whether the channel is no force and the stretch part of a slow swing."""
        return not self._in_newtons and without_slow_motion(samples) is not samples

    def _plain_powers(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """Noise of a stretch that is not quiet; a position's or angle's slow swing is none."""
        if not self._in_newtons:
            samples = without_slow_motion(samples)
        return plain_powers(samples, self._layout.scales, self.settings.threshold)

    def _settle(self, start: int, stop: int, powers: NDArray[np.float64]) -> None:
        """The stretch from start to stop is quiet: the noise floor is known, look for blows."""
        stretch = self._history.view(start, stop)
        samples = self._native(start, stop)
        scale = float(np.abs(samples).max())
        self._floor.least = max(1e-6 * scale, quantum(samples) / 4, 1e-12)
        self._floor.settle(
            stretch,
            self._layout.row,
            self._layout.stride,
            self._number(stop) - 1,
            powers,
            self.settings.threshold,
        )
        for changing in self._changing(stretch):
            self._floor.forget(changing + 1 if changing < self._layout.row else changing)
        self._state = _State.WATCHING
        if self._cold:
            # What came before the quiet was not looked at yet.
            self._position = max(self._learn_from, self._begin)
            self._floor.line[1] = 0.0

    def _open_in_motion(self, stop: int) -> None:
        """A position or angle that was never at rest: it moved before the stream began.

        What it swings about is the mean of all that was seen up to ``stop``.
        """
        self._open(self._position, zero=float(np.mean(self._native(self._position, stop))))

    def _watch(self, hops: int, length: int) -> None:
        layout, floor, settings = self._layout, self._floor, self.settings
        done, reason, offset = kernels.scan_hops(
            self._history.values,
            layout.row,
            self._position - self._history.first,
            hops,
            length,
            layout.stride,
            float(self._number(self._position)),
            layout.scales,
            settings.polarity,
            settings.threshold,
            settings.release,
            self._learn_hops,
            floor.least,
            floor.counters,
            floor.numbers,
            floor.means,
            floor.variances,
            floor.powers,
            floor.peaks,
            floor.sigma,
            floor.bounds,
            floor.line,
            floor.rebound,
            floor.work,
            floor.cumulative,
            floor.power,
            floor.peak,
        )
        self._position += done * self._width
        if reason == kernels.TRIGGERED:
            self._open(self._position + offset * layout.stride)
        elif reason == kernels.UNSETTLED:
            self._enter_learning(cold=False)

    def _scan_rest(self) -> None:
        """The samples after the last whole hop, at the end of a stream."""
        length = (self._history.stop - self._position + self._layout.stride - 1) // (
            self._layout.stride
        )
        if length > 0:
            self._watch(1, length)

    def _open(self, trigger: int, zero: float | None = None) -> None:
        floor = self._floor
        number = self._number(self._position)
        means, deviations = floor.channel_levels()
        means[0] = floor.level(number) if zero is None else zero
        deviations[0] = floor.sigma[0]
        quality = Quality.NONE
        if trigger - self._begin < self.profile.rest_hold * self._layout.grid_rate:
            quality |= Quality.COLD_START
        if self._overlap:
            quality |= Quality.OVERLAPPING
        self._overlap = False
        self._opening = Opening(
            trigger=max(trigger, self._begin),
            zero=means,
            noise=deviations,
            sigma=floor.sigma.copy(),
            contact_force=self.profile.contact_end_force if self._in_newtons else 0.0,
            drift=abs(float(floor.line[1])) / self._width,
            in_newtons=self._in_newtons,
            quality=quality,
        )
        self._levels: list[float] = []  # means of the hops since the one with the trigger
        self._swings: list[float] = []  # their largest deviations from the zero level
        self._contacts: tuple[Contact, ...] = ()  # once the signal is quiet
        self._prepared_pressed = False
        self._rested: int | None = None  # from which the trigger channel is at rest
        self._last_contact = self._position  # by what is known while the blow is followed
        self._state = _State.FOLLOWING

    def _follow(self) -> list[ImpactEvent]:
        """One hop more of an open event; the event where it is complete."""
        layout, profile, opening = self._layout, self.profile, self._opening
        row = self._history.values[layout.row]
        column = self._history.column(self._position)
        # Before the first hop of a stream there is nothing for the windows to reach back into.
        reach = min(int(layout.scales[0]), 1 + (self._position - self._begin) // layout.stride)
        mean, largest, smallest, finite = kernels.hop_extremes(
            row, column, layout.stride, layout.hop, reach
        )
        zero = float(opening.zero[0])
        swing, push = _swings(largest - zero, smallest - zero, self.settings.polarity)
        if self._is_new_blow(push):
            events = self._close(self._position, Quality.OVERLAPPING, rest_from=None)
            self._overlap = True
            self._open(self._position)
            return events
        self._position += self._width
        self._levels.append(mean if finite else math.nan)
        self._swings.append(swing if finite else math.nan)
        hold = self._rest_hops
        level = float(np.mean(self._levels[-hold:])) - zero
        # What drift as seen before the blow may explain is no load.
        force = max(opening.contact_force, self._level_noise())
        force += opening.drift * (self._position - opening.trigger)
        pressed = opening.in_newtons and len(self._levels) >= hold and level > force
        held = profile.longest_hold * layout.grid_rate + self._width
        lasting = self._position - opening.trigger >= held
        # A slow swing grows anew with every half-wave: it is followed no longer than a contact.
        if pressed or (self._has_grown() and not lasting):
            self._last_contact = self._position
        if pressed and lasting:
            return self._close(self._position, Quality.HELD, rest_from=self._rest_start())
        rest = self._rest_start()
        self._prepare(pressed=pressed)
        if pressed or self._has_grown():
            self._rested = None
        if rest is not None and not pressed:
            self._rested = rest if self._rested is None else self._rested
            if not self._restless(rest):
                return self._close(self._position, Quality.NONE, rest_from=rest)
        longest = profile.longest_ring_down * layout.grid_rate
        if not pressed and self._position - self._last_contact >= longest:
            return self._close(self._position, Quality.NONE, rest_from=self._rested)
        return []

    def _prepare(self, *, pressed: bool) -> None:
        """Find the contacts half-way into the rest: less is left to do when the event ends."""
        if pressed != self._prepared_pressed or self._has_grown():
            self._contacts = ()
        if self._contacts:
            return
        rest = self._rest_start(max(self._rest_hops // 2, 1))
        if rest is not None:
            start, reading = self._reading(self._position)
            self._contacts = self._find_contacts(start, reading, None if pressed else rest)
            self._prepared_pressed = pressed

    def _level_noise(self) -> float:
        """Deviation of the level over the rest hold that is beyond noise."""
        return self.settings.release * float(self._opening.sigma[-1]) / math.sqrt(self._rest_hops)

    def _has_grown(self) -> bool:
        """Whether the newest swing is larger than all in the hops before it: new momentum."""
        recent = [s for s in self._swings[-1 - self._rest_hops : -1] if math.isfinite(s)]
        if not recent:
            return True
        noise = self.settings.release * float(self._opening.sigma[1])
        return self._swings[-1] > 1.1 * max(recent) + noise

    def _is_new_blow(self, push: float) -> bool:
        """Whether a contact begins that is too late to be a bounce of the blow followed."""
        horizon = self.settings.bounce_horizon * self._layout.grid_rate
        if self._position - self._last_contact < horizon:
            return False
        recent = [s for s in self._swings[-self._rest_hops :] if math.isfinite(s)]
        if not recent:
            return False
        noise = self.settings.threshold * float(self._opening.sigma[1])
        return push > 1.1 * max(recent) + noise

    def _rest_start(self, hops: int | None = None) -> int | None:
        """Index from which the signal has been at its noise for so long, or None."""
        layout, opening = self._layout, self._opening
        hops = hops or self._rest_hops
        start = self._position - hops * self._width
        if start < max(opening.trigger, self._begin):
            return None
        powers = np.empty(layout.scales.size + 1)
        # Most of a ring-down is told from rest by its power alone, before any averaging.
        for scales in (layout.scales[:0], layout.scales):
            found = powers[: scales.size + 1]
            _, largest = kernels.rest_statistics(
                self._history.values[layout.row],
                self._history.column(start),
                layout.stride,
                hops * layout.hop,
                scales,
                opening.sigma,
                self.settings.threshold,
                found,
            )
            if not (found <= REST_POWER * opening.sigma[: found.size] ** 2).all():
                return None
        return start if largest <= self.settings.release else None

    def _restless(self, start: int) -> list[int]:
        """Rows beside the trigger that are not back at their noise; all where it is not known."""
        if len(self._layout.channels) == 1:
            return []
        variances = hop_variances(self._history.view(start, self._position), self._width)
        others = [c for c in range(variances.size) if c != self._layout.row]
        return [
            c
            for c, noise in zip(others, self._opening.noise[1:], strict=True)
            # A channel without data, whose variance is NaN, has nothing to wait for.
            if math.isfinite(variances[c]) and not variances[c] <= REST_POWER * noise**2
        ]

    def _reading(self, stop: int) -> tuple[int, NDArray[np.float64]]:
        """The open event's reading up to ``stop`` and the grid index that it begins at."""
        return opened_reading(
            self._layout,
            self._history,
            self._opening,
            self.settings.polarity,
            self._begin,
            self._retained,
            stop,
        )

    def _find_contacts(
        self, start: int, reading: NDArray[np.float64], rest_from: int | None
    ) -> tuple[Contact, ...]:
        stride = self._layout.stride
        return contacts_of(
            self._layout,
            self._opening,
            self.settings,
            self.profile,
            self._plates,
            reading,
            (self._opening.trigger - start) // stride,
            None if rest_from is None else (rest_from - start) // stride,
        )

    def _close(
        self, stop: int, quality: Quality, rest_from: int | None, torn: Sequence[int] = ()
    ) -> list[ImpactEvent]:
        """Cut the event out, if it has contact; watch on from ``stop`` at the level of its rest.

        ``torn`` are rows that the stream's end cut off while they were not at rest.
        """
        stop = min(stop, self._history.stop)
        if any(self._opening.trigger - self._retained <= j < stop for j in self._jumps):
            quality |= Quality.CLOCK_JUMP
        start, reading = self._reading(stop)
        free = rest_from if Quality.HELD not in quality else None
        contacts = self._contacts or self._find_contacts(start, reading, free)
        # By the profile nothing pressed on the sensor: a plate that slipped, a small step.
        is_blow = (
            bool(
                smoothed_peak(reading, int(self._layout.scales[0]))
                > contact_threshold(self._opening, self.settings)
            )
            or not self._opening.in_newtons
        )
        event = build_event(
            self._layout,
            self._history,
            self._opening,
            self.profile,
            contacts,
            reading,
            contact_threshold(self._opening, self.settings),
            begin=self._begin,
            start=start,
            retained=self._retained,
            stop=stop,
            quality=quality,
            rest_from=rest_from,
            torn=torn,
        )
        if rest_from is not None:
            stretch = self._history.view(stop - self._rest_hops * self._width, stop)
            self._floor.settle(
                stretch,
                self._layout.row,
                self._layout.stride,
                self._number(stop) - 1,
                None,
                self.settings.threshold,
            )
            self._state = _State.WATCHING
        elif Quality.OVERLAPPING not in quality:
            self._enter_learning(cold=False)
        if not is_blow:
            self.counts['without_contact'] += 1
            return []
        return [event]


def _swings(largest: float, smallest: float, polarity: int) -> tuple[float, float]:
    """Largest deviation of either sign, and in the direction of a blow."""
    swing = max(largest, -smallest)
    if polarity > 0:
        return swing, largest
    return swing, swing if polarity == 0 else -smallest
