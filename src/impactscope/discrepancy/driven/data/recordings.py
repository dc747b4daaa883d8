"""From a campaign's channels to uniform segments on one grid of samples."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from impactscope.discrepancy.campaign import (
    Campaign,
    CampaignRecording,
    ChannelSamples,
    Role,
)
from impactscope.errors import InputError, MissingChannelError

__all__ = ['Cut', 'cuts', 'derivative_of', 'first_state', 'rests']

Array = NDArray[np.float64]

LEAST_SAMPLES = 64
LEAST_WIDTH = 10  # samples from which a speed is taken
SETS_OFF = 15.0  # F of a speed at the first sample, from which a recording begins in motion
BENDS = 9.0  # F of a cubic against a parabola, from which a motion bends too much for it
MOST_SAMPLES = 30_000  # of all fitted recordings together: more would only take longer
_DERIVATIVES = {'m/s': 1, 'rad/s': 1, 'm/s^2': 2, 'rad/s^2': 2}


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """Part of a recording: one output channel and what drives it, on the output's samples."""

    recording: str
    channel: str
    unit: str
    drive_channel: str
    drive_unit: str
    held_out: bool
    begin: float  # s after the recording's first sample
    rate: float
    output: Array
    drive: Array | None
    noise: float


def derivative_of(unit: str) -> int:
    """0 where a channel of this unit is a position, 1 for a speed, 2 for an acceleration."""
    return _DERIVATIVES.get(unit, 0)


def _longest_finite(values: Array) -> tuple[int, int]:
    """Bounds of the longest stretch without a missing sample."""
    finite = np.isfinite(values).astype(np.int8)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], finite, [0]])))
    if edges.size == 0:
        return 0, 0
    runs = edges.reshape(-1, 2)
    best = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    return int(best[0]), int(best[1])


def _cut(
    campaign: Campaign, recording: CampaignRecording, output: str, drive: str, notes: list[str]
) -> Cut | None:
    channel = recording.channel(output)
    source = recording.channel(drive) if drive else None
    period = 1.0 / channel.sample_rate
    time: Array = channel.time
    values = channel.values.astype(np.float64)
    inside = recording.inside(time)
    asked = int(np.count_nonzero(inside))
    driving: Array | None = None
    if source is not None:
        driving = _on_grid(source, time, period)
        inside &= np.isfinite(driving)
    usable = np.where(inside, values, np.nan)
    first, last = _longest_finite(usable)
    if last - first < LEAST_SAMPLES:
        notes.append(
            f'{recording.file}: {output} has only {last - first} samples in one piece; '
            f'{LEAST_SAMPLES} are needed, it is left out.'
        )
        return None
    if last - first < asked - 2:
        notes.append(
            f'{recording.file}: {output} is used for {(last - first) * period:.4g} s only; '
            'samples are missing around that.'
        )
    return Cut(
        recording=recording.file,
        channel=output,
        unit=channel.unit,
        drive_channel=drive,
        drive_unit=source.unit if source is not None else '',
        held_out=recording.role is Role.HOLD_OUT,
        begin=float(time[first]),
        rate=channel.sample_rate,
        output=np.ascontiguousarray(values[first:last]),
        drive=None if driving is None else np.ascontiguousarray(driving[first:last]),
        noise=float(campaign.noise_std.get(output, math.nan)),
    )


def _on_grid(source: ChannelSamples, time: Array, period: float) -> Array:
    """A channel at the sample times of another; a spline where the grids differ."""
    own = source.time
    values = source.values.astype(np.float64)
    same_rate = abs(source.sample_rate * period - 1.0) < 1e-9
    shift = (time[0] - source.start) * source.sample_rate
    if same_rate and abs(shift - round(shift)) < 1e-3:
        result = np.full(time.size, np.nan)
        index = np.arange(time.size) + round(shift)
        there = (index >= 0) & (index < values.size)
        result[there] = values[index[there]]
        return result
    finite = np.isfinite(values)
    if np.count_nonzero(finite) < 4:
        return np.full(time.size, np.nan)
    spline = CubicSpline(own[finite], values[finite], extrapolate=False)
    return np.asarray(spline(time))


def cuts(
    campaign: Campaign,
    outputs: list[str],
    drive: str,
    notes: list[str],
    most: int = MOST_SAMPLES,
) -> list[Cut]:
    """All parts of a campaign's recordings that can be used; what cannot is noted.

    ``most``: samples of all fitted recordings together, beyond which these are cut short.

    Raises MissingChannelError where a channel is in no recording, InputError where nothing is
    left to fit.
    """
    found = []
    missing: MissingChannelError | None = None
    for recording in campaign.recordings:
        for output in outputs:
            try:
                cut = _cut(campaign, recording, output, drive, notes)
            except MissingChannelError as error:
                missing = error
                notes.append(f'{error}; it is left out.')
                continue
            if cut is not None:
                found.append(cut)
    if not any(not c.held_out for c in found):
        if missing is not None:
            raise missing
        raise InputError(f'{campaign.name}: no recording can be fitted; {"; ".join(notes)}')
    for cut in found:
        for name, samples in ((cut.channel, cut.output), (cut.drive_channel, cut.drive)):
            if not cut.held_out and samples is not None and not np.any(samples):
                raise InputError(f'{cut.recording}: {name} is zero throughout: it tells nothing')
    return _shortened(found, notes, most)


def _shortened(found: list[Cut], notes: list[str], most_of_all: int) -> list[Cut]:
    """Fitted recordings cut to their beginnings where all together are very long."""
    fitted = [c for c in found if not c.held_out]
    if sum(c.output.size for c in fitted) <= most_of_all:
        return found
    most = max(most_of_all // len(fitted), 4 * LEAST_SAMPLES)
    longest = max(c.output.size for c in fitted)
    if longest > most:
        notes.append(
            f'Of each fitted recording the first {most} samples are used: a fit to all would '
            'only take longer.'
        )
    return [
        c
        if c.held_out
        else dataclasses.replace(
            c, output=c.output[:most], drive=None if c.drive is None else c.drive[:most]
        )
        for c in found
    ]


def first_state(samples: Array, period: float, width: int) -> tuple[float, float]:
    """Position and speed at the first sample, from a parabola through the first samples.

    Through ``width`` of them, or through fewer where a cubic is clearly closer to the motion.
    """
    width = max(4, min(width, samples.size))
    while True:
        time = np.arange(width) / width
        part = samples[:width]
        parabola, cubic = np.polyfit(time, part, 2), np.polyfit(time, part, 3)
        left = float(np.sum((part - np.polyval(parabola, time)) ** 2))
        rest = float(np.sum((part - np.polyval(cubic, time)) ** 2)) + 1e-300
        if width <= LEAST_WIDTH or (left - rest) * (width - 4) < BENDS * rest:
            return float(parabola[2]), float(parabola[1] / (width * period))
        width = max(LEAST_WIDTH, round(0.7 * width))


def rests(samples: Array, width: int) -> bool:
    """Whether a motion may begin at rest: a constant acceleration from zero speed explains it.

    By the first ``width`` samples. A speed that is not clearly there is none: wrong by its scatter
    it would move a mass without spring for as long as its friction takes to stop it.
    """
    width = max(8, min(width, samples.size))
    time = np.arange(width) / width
    part = samples[:width]
    still = np.stack([np.ones(width), time**2, time**3], axis=1)
    moving = np.column_stack([still, time])
    left = [
        float(np.sum((part - m @ np.linalg.lstsq(m, part, rcond=None)[0]) ** 2))
        for m in (still, moving)
    ]
    return (left[0] - left[1]) * (width - 4) < SETS_OFF * (left[1] + 1e-300)
