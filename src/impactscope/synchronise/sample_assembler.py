"""From samples that come one by one, each with its stamp, to blocks with rate and index."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import ConfigurationError, InputError
from impactscope.records import NANOSECONDS, Quality, SampleBlock
from impactscope.synchronise.sample_numbering import (
    BACKWARDS,
    DUPLICATE,
    JUMPED,
    TAKEN,
    UNSTAMPED,
    estimate_rate,
    number_stamps,
)

__all__ = ['AssemblerStatistics', 'SampleAssembler']

LEARNING_SAMPLES = 128
MOST_HELD = 100 * LEARNING_SAMPLES  # of samples whose stamps do not tell the rate


@dataclass(frozen=True, slots=True)
class AssemblerStatistics:
    """Counts since the assembler was made."""

    samples: int = 0  # taken
    lost_samples: int = 0  # by the gaps between stamps
    duplicates: int = 0  # same stamp again; dropped
    backwards: int = 0  # stamps earlier than the one before, within the jump; dropped
    unstamped: int = 0  # stamp of zero; dropped
    clock_jumps: int = 0
    unplaced: int = 0  # too few for an estimate of the rate when the stream ended; dropped


class _Samples(NamedTuple):
    """Samples with their index, time in ns and kind; each of shape (n_samples,)."""

    indices: NDArray[np.int64]
    times: NDArray[np.int64]
    values: NDArray[np.float32]
    kinds: NDArray[np.int64]

    def part(self, begin: int, end: int) -> _Samples:
        return _Samples(
            self.indices[begin:end], self.times[begin:end],
            self.values[begin:end], self.kinds[begin:end],
        )  # fmt: skip

    def joined(self, other: _Samples) -> _Samples:
        if not self.indices.size:
            return other
        return _Samples(
            np.concatenate((self.indices, other.indices)),
            np.concatenate((self.times, other.times)),
            np.concatenate((self.values, other.values)),
            np.concatenate((self.kinds, other.kinds)),
        )


def _no_samples() -> _Samples:
    none = np.empty(0, dtype=np.int64)
    return _Samples(none, none, np.empty(0, dtype=np.float32), none)


class SampleAssembler:
    """Blocks of one channel from stamped samples (WrenchStamped, AccelStamped, Imu, ...).

    Each stamp is held against a line that runs at the nominal rate and is pulled towards every
    stamp a little, so that jitter of less than half a period neither loses nor invents a
    sample. A stamp later by about k periods means k samples lost: the index jumps, and the
    block says GAP_BEFORE. Duplicates, stamps of zero and stamps running backwards are dropped
    and counted; back by more than ``jump``, the clock was set: CLOCK_JUMP, and samples go on.
    Blocks depend on the sequence of samples alone, not on how it was handed over.

    Args:
        channel: name.
        unit: SI unit of the values.
        rate: Hz, nominal; 0 means estimated from the first 128 stamps, which are held back
            until then.
        block_duration: s.
        jump: s, by which a stamp must run backwards for the clock to have been set.
        frame_id: where the sensor sits.
        epoch: of the blocks.
        range_min: what the channel can represent, in ``unit``.
        range_max: likewise.

    Raises:
        ConfigurationError: a value is out of its range.
    """

    def __init__(
        self,
        channel: str,
        unit: str,
        rate: float = 0.0,
        block_duration: float = 0.02,
        *,
        jump: float = 0.02,
        frame_id: str = '',
        epoch: int = 0,
        range_min: float = math.nan,
        range_max: float = math.nan,
    ) -> None:
        for name, value in (('rate', rate), ('jump', jump)):
            if not (math.isfinite(value) and value >= 0):
                raise ConfigurationError(f'channel {channel!r}: {name} is {value}; not below zero')
        if not (math.isfinite(block_duration) and block_duration > 0):
            raise ConfigurationError(
                f'channel {channel!r}: block_duration is {block_duration} s; it must be above zero'
            )
        self.channel = channel
        self._unit = unit
        self._given_rate = rate
        self._block_duration = block_duration
        self._jump_ns = jump * NANOSECONDS
        self._frame_id = frame_id
        self._epoch = epoch
        self._range = (range_min, range_max)
        self._statistics = AssemblerStatistics()
        self._forget()

    def _forget(self) -> None:
        self._rate = 0.0
        self._size = 1
        self._stamps: list[int] = []  # of samples that came one by one
        self._values: list[float] = []
        self._room = LEARNING_SAMPLES  # so many of them may wait
        self._due_ns = 1 << 62  # and until this stamp
        self._held = (np.empty(0, np.int64), np.empty(0, np.float32))  # until the rate is known
        self._state = np.array([-1, 0, 0], dtype=np.int64)
        self._fraction = np.zeros(1)
        self._open = _no_samples()  # of the block that is filling
        self._look_closely = True  # at the values of blocks: some are odd, or it is not known
        self._next_index = 0
        if self._given_rate:
            self._set_rate(self._given_rate)

    def _set_rate(self, rate: float) -> None:
        self._rate = rate
        self._size = max(1, round(rate * self._block_duration))
        self._room = 1

    @property
    def rate(self) -> float:
        """Hz, nominal; 0 while it is being estimated."""
        return self._rate

    @property
    def statistics(self) -> AssemblerStatistics:
        """The counts so far."""
        return self._statistics

    def push(self, stamp_ns: int, value: float) -> list[SampleBlock]:
        """Take one sample; return the blocks complete with it."""
        self._stamps.append(stamp_ns)
        self._values.append(value)
        if len(self._stamps) < self._room and stamp_ns < self._due_ns:
            return []
        return self._take_single()

    def extend(self, stamps_ns: ArrayLike, values: ArrayLike) -> list[SampleBlock]:
        """Take samples: stamps int64 in ns and values, each of shape (n_samples,).

        Raises InputError where the shapes differ.
        """
        stamps = np.ascontiguousarray(stamps_ns, dtype=np.int64)
        with np.errstate(over='ignore'):  # too large for float32 is inf, and flagged
            array = np.ascontiguousarray(values, dtype=np.float32)
        if stamps.ndim != 1 or stamps.shape != array.shape:
            raise InputError(
                f'channel {self.channel!r}: stamps have shape {stamps.shape} and values '
                f'{array.shape}; equal (n_samples,) is needed'
            )
        return [*self._take_single(), *self._take(stamps, array)]

    def end(self) -> list[SampleBlock]:
        """The stream has ended: the rest, then the end marker; the next epoch starts afresh."""
        blocks = self._take_single()
        if not self._rate:
            stamps, values = self._held
            self._held = (stamps[:0], values[:0])
            if self._learn(stamps):
                blocks += self._place(stamps, values)
            else:
                self._count(unplaced=stamps.size)
        if self._open.indices.size:
            blocks.append(self._block(self._open))
        if self._rate:
            end_ns = int(self._state[2]) + round(NANOSECONDS / self._rate)
            blocks.append(self._make(self._next_index, end_ns, np.empty(0, np.float32)))
        self._epoch += 1
        self._forget()
        return blocks

    def _take_single(self) -> list[SampleBlock]:
        if not self._stamps:
            return []
        stamps = np.array(self._stamps, dtype=np.int64)
        with np.errstate(over='ignore'):
            values = np.array(self._values, dtype=np.float32)
        self._stamps.clear()
        self._values.clear()
        return self._take(stamps, values)

    def _take(self, stamps: NDArray[np.int64], values: NDArray[np.float32]) -> list[SampleBlock]:
        if not self._rate:
            stamps = np.concatenate((self._held[0], stamps))
            values = np.concatenate((self._held[1], values))
            # Learn from the same samples however they came.
            known = LEARNING_SAMPLES * (self._held[0].size // LEARNING_SAMPLES + 1)
            while known <= stamps.size and not self._learn(stamps[:known]):
                known += LEARNING_SAMPLES
            if not self._rate:
                self._held = (stamps[-MOST_HELD:], values[-MOST_HELD:])
                self._count(unplaced=stamps.size - self._held[0].size)
                return []
            self._held = (stamps[:0], values[:0])
        return self._place(stamps, values)

    def _learn(self, stamps: NDArray[np.int64]) -> bool:
        """Estimate the rate; whether the stamps tell it."""
        stamps = stamps[stamps > 0]
        if stamps.size < 2:
            return False
        rising = np.concatenate(([True], stamps[1:] > np.maximum.accumulate(stamps)[:-1]))
        stamps = stamps[rising]
        if stamps.size < 2:
            return False
        self._set_rate(estimate_rate(stamps))
        return True

    def _place(self, stamps: NDArray[np.int64], values: NDArray[np.float32]) -> list[SampleBlock]:
        """Number samples and cut them into blocks."""
        period = NANOSECONDS / self._rate
        numbers = np.empty((3, stamps.size), dtype=np.int64)
        new = _Samples(numbers[0], numbers[1], values, numbers[2])
        number_stamps(
            stamps, period, self._jump_ns, self._state, self._fraction,
            new.indices, new.times, new.kinds,
        )  # fmt: skip
        samples = self._open.joined(self._keep_taken(new))
        blocks = []
        begin = 0
        if samples.indices.size:
            self._look_closely = not self._is_clean(samples.values)
            for end in self._ends_in(samples):
                blocks.append(self._block(samples.part(begin, end)))
                begin = end
        self._open = samples.part(begin, samples.indices.size)
        self._room = self._size - int(self._state[0] + 1) % self._size
        self._due_ns = int(self._state[2] + (self._room - 0.5) * period)
        return blocks

    def _keep_taken(self, new: _Samples) -> _Samples:
        kinds = new.kinds
        taken = (kinds == TAKEN) | (kinds == JUMPED)
        self._count(
            samples=int(np.count_nonzero(taken)),
            duplicates=int(np.count_nonzero(kinds == DUPLICATE)),
            backwards=int(np.count_nonzero(kinds == BACKWARDS)),
            unstamped=int(np.count_nonzero(kinds == UNSTAMPED)),
            clock_jumps=int(np.count_nonzero(kinds == JUMPED)),
        )
        if taken.all():
            return new
        return _Samples(new.indices[taken], new.times[taken], new.values[taken], kinds[taken])

    def _ends_in(self, samples: _Samples) -> list[int]:
        """Where blocks end: at whole multiples of their size, before a gap, before a jump."""
        indices = samples.indices
        begins = (np.diff(indices) != 1) | (samples.kinds[1:] == JUMPED)
        begins |= indices[1:] // self._size != indices[:-1] // self._size
        ends: list[int] = (np.flatnonzero(begins) + 1).tolist()
        if (indices[-1] + 1) % self._size == 0:
            ends.append(indices.size)
        return ends

    def _is_clean(self, values: NDArray[np.float32]) -> bool:
        """Whether all is finite and within the range; NaN limits are never reached."""
        least, most = float(values.min()), float(values.max())  # NaN where a value is
        if not (math.isfinite(least) and math.isfinite(most)):
            return False
        low, high = (float(np.float32(limit)) for limit in self._range)
        return not (least <= low or most >= high)

    def _flags_of(self, values: NDArray[np.float32]) -> Quality:
        quality = Quality.NONE
        if not np.isfinite(values).all():
            quality |= Quality.NOT_FINITE
        low, high = np.float32(self._range[0]), np.float32(self._range[1])
        if ((values <= low) | (values >= high)).any():
            quality |= Quality.CLIPPED
        return quality

    def _block(self, samples: _Samples) -> SampleBlock:
        first, values = int(samples.indices[0]), samples.values
        quality = Quality.NONE
        if first > self._next_index:
            quality |= Quality.GAP_BEFORE
            self._count(lost_samples=first - self._next_index)
        if samples.kinds[0] == JUMPED:
            quality |= Quality.CLOCK_JUMP
        if self._look_closely:
            quality |= self._flags_of(values)
        self._next_index = first + values.size
        return self._make(first, int(samples.times[0]), values.copy(), quality)

    def _make(
        self,
        first_index: int,
        stamp_ns: int,
        values: NDArray[np.float32],
        quality: Quality = Quality.NONE,
    ) -> SampleBlock:
        return SampleBlock(
            channel=self.channel,
            unit=self._unit,
            sample_rate=self._rate,
            stamp_ns=stamp_ns,
            first_index=first_index,
            values=values,
            epoch=self._epoch,
            quality=quality,
            range_min=self._range[0],
            range_max=self._range[1],
            frame_id=self._frame_id,
        )

    def _count(self, **more: int) -> None:
        now = self._statistics
        self._statistics = dataclasses.replace(
            now, **{name: getattr(now, name) + extra for name, extra in more.items()}
        )
