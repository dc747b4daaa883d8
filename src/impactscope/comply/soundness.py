"""Whether a recorded blow can be judged at all: what could hide a larger force, or zero it.

A fault is a sentence. A quality flag is a fault unless the samples show that what it speaks of
lies outside the judged span: a flag whose place cannot be found counts against the blow.
"""

from __future__ import annotations

import math

import numpy as np

from impactscope.comply.evaluation import ForceEvaluation, ForceReading
from impactscope.comply.rules import JudgementRules
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import ImpactEvent, Quality

__all__ = ['channel_flags', 'find_faults']

# Flags that speak of the blow as a whole, whichever channel raised them.
_WHOLE_EVENT = Quality.CLOCK_JUMP | Quality.TORN | Quality.OVERLAPPING | Quality.COLD_START
_LOST = Quality.GAP_BEFORE | Quality.MISSING | Quality.NOT_FINITE


def channel_flags(event: ImpactEvent, row: int) -> Quality:
    """The flags that concern one channel: its own, and the event's that no other explains."""
    others = Quality.NONE
    for index, channel in enumerate(event.channels):
        if index != row:
            others |= Quality(channel.quality)
    whole = Quality(event.quality)
    return Quality(event.channels[row].quality) | (whole & _WHOLE_EVENT) | (whole & ~others)


def find_faults(
    event: ImpactEvent,
    reading: ForceReading,
    evaluation: ForceEvaluation,
    profile: MeasurementProfile,
    rules: JudgementRules,
) -> tuple[str, ...]:
    """Why the blow cannot be judged, one sentence each; empty where it can.

    The judged span runs from the window's first sample, as what is lost before first contact
    may have been first contact, to the end of contact or of the transient window, whichever is
    later, and on for the hold after which contact counts as ended.
    """
    flags = channel_flags(event, reading.row)
    start = event.contact_start
    span_end = max(event.contact_end, start + profile.transient_window)
    judged = reading.samples_to(span_end + profile.contact_end_hold)
    faults = [
        _lost_samples(reading, flags, judged, start),
        _clipping(event, reading, flags, judged),
        _zero_and_noise(reading, flags),
        _record_ends(event, reading, flags, profile),
        _time_base(flags),
        _sample_rate(event, reading, rules),
        _sign(reading, evaluation),
        _no_contact(evaluation, profile),
    ]
    return tuple(fault for fault in faults if fault)


def _lost_samples(reading: ForceReading, flags: Quality, judged: int, start: float) -> str:
    lost = np.flatnonzero(~np.isfinite(reading.samples))
    inside = lost[lost < judged]
    if inside.size:
        return (
            f'{inside.size} of {judged} judged force samples are missing or not finite, the '
            f'first {reading.time_of(int(inside[0])) - start:+.4f} s from first contact: '
            'a larger force may be hidden there.'
        )
    if flags & _LOST and not lost.size:
        return (
            'Force samples were lost or not finite, and the event does not show where: '
            'a larger force may be hidden there.'
        )
    return ''


def _clipping(event: ImpactEvent, reading: ForceReading, flags: Quality, judged: int) -> str:
    channel = event.channels[reading.row]
    # float32, as the samples are: a range of 400.1 N is to be found again in them.
    top, bottom = np.float32(channel.range_max), np.float32(channel.range_min)
    if top <= bottom:  # an unset range, 0 to 0, says nothing
        top = bottom = np.float32(math.nan)
    at_top = np.flatnonzero(reading.samples >= top)  # none where the range is NaN
    inside = at_top[at_top < judged]
    if inside.size:
        return (
            f'Force is clipped: {inside.size} judged samples stand at the upper end of the '
            f'range, {float(top):g} N; the true force was larger by an unknown amount.'
        )
    located = math.isfinite(top) and (at_top.size or (reading.samples <= bottom).any())
    if flags & Quality.CLIPPED and (reading.row != 0 or not located):
        return 'Force is clipped, and the event does not show where: the true force may be larger.'
    return ''


def _zero_and_noise(reading: ForceReading, flags: Quality) -> str:
    if math.isnan(reading.zero_level):
        return 'The zero level of the force before the blow is not known.'
    if math.isnan(reading.noise_std):
        return 'The noise of the force is not known, so its uncertainty is not.'
    if flags & Quality.COLD_START:
        return 'No quiet stretch precedes the blow (cold start): its zero level is in doubt.'
    if flags & Quality.OVERLAPPING:
        return 'Blows overlap, one began before the other was at rest: zero is in doubt.'
    return ''


def _record_ends(
    event: ImpactEvent, reading: ForceReading, flags: Quality, profile: MeasurementProfile
) -> str:
    start, end = event.contact_start, event.contact_end
    seen = reading.end - start
    slack = 2 / reading.sample_rate
    ended = end + profile.contact_end_hold <= reading.end + slack
    if not ended and seen < 0.99 * profile.longest_hold - slack:
        return (
            f'The record ends {seen:.3f} s after first contact while contact lasts; it is to '
            f'be followed for {profile.longest_hold:g} s.'
        )
    if flags & Quality.TORN:
        begins_before = reading.samples_to(start) > 1
        through = ended and seen + slack >= profile.transient_window
        if not begins_before or not through:
            return 'The stream began or ended inside the blow: a larger force may be missing.'
    return ''


def _time_base(flags: Quality) -> str:
    if flags & Quality.CLOCK_JUMP:
        return 'The clock jumped inside the blow: when its forces occurred is not known.'
    if flags & Quality.STALLED:
        return 'The device stalled during the blow: its data are stale.'
    return ''


def _sample_rate(event: ImpactEvent, reading: ForceReading, rules: JudgementRules) -> str:
    native = event.channels[reading.row].native_rate
    rate = native if native > 0 else reading.sample_rate
    if math.isfinite(rate) and rate >= 0.99 * rules.minimum_sample_rate:
        return ''
    return (
        f'Force was sampled at {rate:g} Hz; at least {rules.minimum_sample_rate:g} Hz '
        'is needed to see its peak.'
    )


def _sign(reading: ForceReading, evaluation: ForceEvaluation) -> str:
    lowest, highest = reading.smallest(), evaluation.transient.value
    if not -lowest > highest + 6 * evaluation.noise_std:  # true for NaN, too
        return ''
    return (
        f'The force goes further below zero ({lowest:.1f} N) than above ({highest:.1f} N): '
        'the sign of the channel is in doubt.'
    )


def _no_contact(evaluation: ForceEvaluation, profile: MeasurementProfile) -> str:
    highest = evaluation.transient.value
    if not math.isfinite(highest) or highest > profile.contact_end_force:
        return ''
    return (
        f'No contact force is seen: the largest is {highest:.1f} N and contact is above '
        f'{profile.contact_end_force:g} N.'
    )
