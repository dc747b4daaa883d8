"""At which frequencies something swings in time, of all that recordings could show."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from impactscope.discrepancy.driven.adequacy.unmodelled_laws import LOOKS, Group
from impactscope.discrepancy.driven.fits.innovations import each_alone, innovations, joined
from impactscope.discrepancy.driven.models.model import Segment

__all__ = ['Swing', 'answers_of_swings', 'frequencies', 'swinging_laws', 'swings_seen']

Array = NDArray[np.float64]

BEST = 3  # frequencies that are looked at closely, of one phase and of many
APART = 3  # lines of a frequency, between which another one lies
# looks by Hz and second: with one phase or with one in each recording, at lines half a line apart
LOOKS_BY_LINE = 4


class Swing(NamedTuple):
    """What a recording shows of something that swings, by frequency of the swing, shape (k,).

    The sum over the recordings of ``|along|^2 / power`` is the chi-square that swings of any phase
    take away, and the same of their sums what one phase of all does.
    """

    along: NDArray[np.complex128]
    power: Array


def swinging_laws(
    what: str,
    segments: Sequence[Segment],
    residuals: Sequence[Array],
    shapes: Sequence[Array],
    highest: float,
    *,
    through: Callable[[Sequence[Array]], Sequence[Array]] = list,
    kinds: int = 1,
) -> Iterator[Group]:
    """Laws of a force that swings in time, at the frequencies that explain most.

    Args:
        what: swings, as in: a stiffness that swings at ...
        segments: that are fitted.
        residuals: of these, whitened, in units of their noise, each shape (n,).
        shapes: the force that swings, by recording, each shape (n,).
        highest: Hz, up to which it is taken to swing.
        through: channel that small forces make; the forces themselves unless told.
        kinds: of what is taken to swing.
    """
    period, longest = segments[0].period, max(x.size for x in shapes)
    seen = [
        answers_of_swings(rest, x, _pulse(s, through), longest)
        for s, rest, x in zip(segments, residuals, shapes, strict=True)
    ]
    together, apart = swings_seen(seen, frequencies(longest, period), highest)
    sought = round(kinds * LOOKS_BY_LINE * highest * longest * period)
    looks = max(LOOKS, sought)
    for frequency in dict.fromkeys((*together, *apart)):
        turn = 2.0 * math.pi * frequency * period
        waves = [
            through([x * wave(turn * np.arange(x.size)) for x in shapes])
            for wave in (np.sin, np.cos)
        ]
        law = f'a {what} that swings at {frequency:.3g} Hz'
        if frequency in together:
            yield Group(law, [joined(segments, w) for w in waves], looks, sought=sought)
        if len(shapes) > 1 and frequency in apart:  # it does not wait for recordings to begin
            columns = [column for w in waves for column in each_alone(segments, w)]
            yield Group(law, columns, looks, sought=sought)


def _pulse(segment: Segment, through: Callable[[Sequence[Array]], Sequence[Array]]) -> Array:
    """Whitened answer of a recording to a force of one sample."""
    force = np.zeros(segment.measured.size)
    begin = force.size // 2  # where whitening has begun
    force[begin] = 1.0
    (answer,) = through([force])
    return innovations(segment, answer)[begin:]


def frequencies(longest: int, period: float) -> Array:
    """Frequencies of swings, Hz, half a line of the longest recording apart, shape (longest + 1,).

    Args:
        longest: samples of the longest recording.
        period: s between samples.
    """
    return np.asarray(fft.rfftfreq(2 * longest, period))


def answers_of_swings(residual: Array, shape: Array, pulse: Array, longest: int) -> Swing:
    """How like the answers to a force that swings a residual is.

    Args:
        residual: whitened, in units of its noise, shape (n,).
        shape: what swings: a force, shape (n,).
        pulse: whitened answer to a force of one sample, shape (m,), m at most n.
        longest: samples of the longest recording.
    """
    length = 2 * longest
    through = fft.rfft(pulse, length)
    # carried back to the force; beyond the recording there is none
    back = fft.irfft(np.conj(through) * fft.rfft(residual, length), length)[: shape.size]
    along = fft.rfft(back * shape, length)
    # a swing moves the spectrum of what swings along that of the answer
    passed, swung = np.abs(fft.fft(pulse, length)) ** 2, np.abs(fft.fft(shape, length)) ** 2
    power = fft.ifft(fft.fft(passed) * np.conj(fft.fft(swung))).real / length
    return Swing(along, 0.5 * np.maximum(power[: along.size], 0.0))


def swings_seen(
    seen: Sequence[Swing], frequency: Array, highest: float
) -> tuple[list[float], list[float]]:
    """Frequencies, Hz, at which a swing explains most: with one phase, and with many.

    Args:
        seen: by recording.
        frequency: of all of these, see :func:`frequencies`.
        highest: Hz, up to which something is taken to swing.
    """
    along, power = sum(s.along for s in seen), sum(s.power for s in seen)
    together = _worth(np.asarray(along), np.asarray(power))
    apart = np.sum([_worth(s.along, s.power) for s in seen], axis=0)
    outside = (frequency > highest) | (frequency < frequency[1])
    return _peaks(together, frequency, outside), _peaks(apart, frequency, outside)


def _worth(along: NDArray[np.complex128], power: Array) -> Array:
    least = 1e-9 * float(np.max(power, initial=0.0))
    worth = np.zeros(power.size)
    np.divide(np.abs(along) ** 2, power, out=worth, where=power > least)
    return worth


def _peaks(worth: Array, frequency: Array, outside: NDArray[np.bool_]) -> list[float]:
    left = np.where(outside, 0.0, worth)
    found = []
    for _ in range(BEST):
        best = int(np.argmax(left))
        if left[best] <= 0.0:
            break
        found.append(float(frequency[best]))
        left[max(best - APART, 0) : best + APART + 1] = 0.0
    return found
