"""Where in a blow's force reading there is contact, and where the plate only rings.

After the impactor has left, the sensor's plate oscillates freely and its spring reports forces
of both signs. Two ways lead to the contacts:

* With a model of the plate (its natural frequency and damping, learned from the ring-down) each
  contact is fitted as a pulse of force, its response is taken off the reading, ring-down and
  all, and what then still pushes is the next contact.
* Without one, or where the reading does not follow it, by the reading alone: in a free
  oscillation every half-wave is smaller than the one before it, so a positive half-wave larger
  than the negative one before it got new momentum. A reading that rises from zero without
  having swung through it was pushed as well.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.detect.plate_motion import PlateModel, PulseFit, fit_pulse
from impactscope.records import Contact

__all__ = ['ContactRules', 'find_contacts', 'moving_mean']

GROWTH = 1.05  # of a half-wave over the one before it, beyond noise, that proves new momentum
LASTING = 1.2  # of the time below the threshold before, beyond which a push is no half-wave
MOST_FITTED = 8  # contacts; later, weaker bounces are left to the reading alone
BINS = 150  # in a period of the plate: finer than that it does not move
DOUBT = 0.12  # share of a ring-down that its model may miss without it being a contact
# Periods of the plate after the rise that a contact is fitted over: the longest that fits.
SPANS = (3.0, 1.0, 0.6, 0.4)
RIVAL = 0.6  # periods; a fit over less does not rival one over more
EVIDENCE = 16.0  # noise variances that the better fit of the earlier part must gain
RISE = 0.5  # periods of the rise of a long contact, for its start alone


@dataclass(frozen=True, slots=True)
class ContactRules:
    """What counts as contact in one blow."""

    rate: float  # Hz
    threshold: float  # N; above it the smoothed reading is pushed (or rings)
    smoothing: int  # samples of the moving mean that the threshold applies to
    hold: int  # samples below the threshold that end a contact
    noise: float  # N, standard deviation of a sample
    smoothed_noise: float  # N, of the smoothed reading

    def coarser(self, width: int) -> ContactRules:
        """The same for means of ``width`` samples."""
        smoothing = max(self.smoothing // width, 1)
        return ContactRules(
            rate=self.rate / width,
            threshold=self.threshold,
            smoothing=smoothing,
            hold=max(self.hold // width, 1),
            noise=max(
                self.noise / math.sqrt(width),
                self.smoothed_noise * math.sqrt(min(self.smoothing / width, 1.0)),
            ),
            smoothed_noise=self.smoothed_noise,
        )


@dataclass(frozen=True, slots=True)
class _Span:
    """Samples of a contact; fractional where it was fitted."""

    start: float
    stop: float

    def scaled(self, by: float) -> _Span:
        return _Span(self.start * by, self.stop * by)


def find_contacts(
    reading: NDArray[np.float64],
    trigger: int,
    rules: ContactRules,
    plate: PlateModel | None = None,
) -> tuple[Contact, ...]:
    """Contacts in a force reading with its zero level removed.

    Args:
        reading: N, compression positive, shape (n_samples,).
        trigger: sample by which the blow is known to have begun; spans that end before are noise.
        rules: thresholds.
        plate: the sensor's free motion; None where it is not known.

    Returns:
        contacts in order of time, times in s after the first sample; at least one. A contact's
        peak and impulse are those of the reading from its start to the end of the half-wave that
        it causes, which may lie after the contact itself.
    """
    pushed = _pushed_spans(reading, trigger, rules)
    spans = _fitted_spans(reading, pushed, trigger, rules, plate) if plate else pushed
    contacts = []
    for place, span in enumerate(spans):
        limit = math.ceil(spans[place + 1].start) if place + 1 < len(spans) else reading.size
        contacts.append(_contact(reading, span, pushed, limit, rules.rate))
    return tuple(contacts)


def moving_mean(reading: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """Centred moving mean; shorter at the ends, non-finite samples counted as zero."""
    finite = np.where(np.isfinite(reading), reading, 0.0)
    total = np.concatenate(([0.0], np.cumsum(finite)))
    centre = np.arange(reading.size)
    low = np.maximum(centre - (n - 1) // 2, 0)
    high = np.minimum(centre + n // 2 + 1, reading.size)
    means: NDArray[np.float64] = (total[high] - total[low]) / (high - low)
    return means


def _spans_above(
    values: NDArray[np.float64], threshold: float | NDArray[np.float64]
) -> list[tuple[int, int]]:
    edges = np.diff(np.concatenate(([False], values > threshold, [False])).astype(np.int8))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(a), int(b)) for a, b in zip(starts, stops, strict=True)]


def _pushed_spans(reading: NDArray[np.float64], trigger: int, rules: ContactRules) -> list[_Span]:
    """Spans by the reading alone: above the threshold, joined over short dips, none ringing."""
    smooth = moving_mean(reading, rules.smoothing)
    above = [span for span in _spans_above(smooth, rules.threshold) if span[1] > trigger]
    if not above:
        # a sample that is missing has no force, though it counts as zero in the mean
        known = np.where(np.isfinite(reading[trigger:]), smooth[trigger:], -math.inf)
        peak = trigger + int(np.argmax(known))
        return [_Span(peak, peak + 1)]
    joined: list[tuple[int, int]] = [above[0]]
    for start, stop in above[1:]:
        last = joined[-1]
        dip = float(smooth[last[1] : start].min())
        if dip > -rules.threshold and start - last[1] < rules.hold:
            joined[-1] = (last[0], stop)
        else:
            joined.append((start, stop))
    spans = [_Span(*joined[0])]
    for before, (start, stop) in itertools.pairwise(joined):
        swing = -float(smooth[before[1] : start].min())
        # A swing below the threshold could not be told from none: it counts as one of its size.
        bound = GROWTH * max(swing, 0.0) + 4 * rules.smoothed_noise
        # Ringing about zero is above the threshold for less time than below it.
        lasts = stop - start > LASTING * (start - before[1]) and stop - start > rules.smoothing
        if lasts or float(smooth[start:stop].max()) > max(bound, rules.threshold * GROWTH):
            spans.append(_Span(start, stop))
    return spans


def _fitted_spans(
    reading: NDArray[np.float64],
    pushed: list[_Span],
    trigger: int,
    rules: ContactRules,
    plate: PlateModel,
) -> list[_Span]:
    """Contacts one after the other, each fitted to what the ones before it leave over."""
    width = max(int(plate.period * rules.rate / BINS), 1)
    count = reading.size // width
    residual = reading[: count * width].reshape(count, width).mean(axis=1)
    spans = _fitted(residual, [span.scaled(1 / width) for span in pushed], trigger / width,
                    rules.coarser(width), plate)  # fmt: skip
    return [span.scaled(width) for span in spans]


def _fitted(
    residual: NDArray[np.float64],
    pushed: list[_Span],
    after: float,
    rules: ContactRules,
    plate: PlateModel,
) -> list[_Span]:
    doubt = np.zeros(residual.size)
    spans: list[_Span] = []
    while True:
        smooth = moving_mean(residual, rules.smoothing)
        above = [s for s in _spans_above(smooth, rules.threshold + doubt) if s[1] > after]
        if not above:
            break
        begin = spans[-1].stop if spans else 0.0
        first = above[0][0]
        fit = _fit(residual, begin, first, rules, plate) if len(spans) < MOST_FITTED else None
        if fit is None:
            low = max(first, after) if spans else first
            left = [span for span in pushed if span.stop > low] or [_Span(*s) for s in above]
            spans += _unfitted(residual, begin, low, left, rules, plate)
            break
        response = fit.response(residual.size, rules.rate, plate)
        residual -= response
        start, stop = fit.start * rules.rate, (fit.start + fit.duration) * rules.rate
        spans.append(_Span(start, stop))
        late = np.arange(residual.size) - math.ceil(stop)
        tail = response[late >= 0]
        if tail.size == 0:
            break
        fall = plate.damping_ratio * plate.natural_frequency / rules.rate
        size = float(np.abs(tail[: round(plate.period * rules.rate)]).max())
        doubt[late >= 0] += DOUBT * size * np.exp(-fall * late[late >= 0])
        after = stop + 0.05 * plate.period * rules.rate
    return spans or pushed


def _fit(
    residual: NDArray[np.float64], begin: float, rise: int, rules: ContactRules, plate: PlateModel
) -> PulseFit | None:
    """The contact that makes the reading rise, over the longest stretch that one explains."""
    period = plate.period * rules.rate
    low = max(math.ceil(begin), round(rise - 0.7 * period), 0)
    best: PulseFit | None = None
    for periods in SPANS:
        high = round(rise + periods * period)
        if high > residual.size and periods != SPANS[0]:
            continue
        part = residual[low : min(high, residual.size)]
        if best is not None and periods < RIVAL:
            break
        fit = fit_pulse(part, rules.rate, plate, (rise - low) / rules.rate, rules.noise)
        # Unless some of the motion after it was seen, where the contact ends is a guess.
        seen = part.size / rules.rate - 0.1 * plate.period
        if fit is None or fit.start + fit.duration > seen:
            continue
        # Nor can contact begin before there is a reading, or in the contact before.
        if low + fit.start * rules.rate < begin - 0.02 * period:
            continue
        peak = float(np.abs(part).max())
        if fit.rms >= 1.3 * max(fit.noise, rules.smoothed_noise / 2) + 0.006 * peak:
            continue
        if best is None:
            best = fit
        elif fit.duration < 0.8 * best.duration:
            # Two contacts passed for one if the earlier part by itself says so.
            excess = _squares(part, best, rules, plate) - _squares(part, fit, rules, plate)
            if excess > EVIDENCE * rules.noise**2:
                best = fit
    return None if best is None else best.moved(low / rules.rate)


def _squares(
    part: NDArray[np.float64], fit: PulseFit, rules: ContactRules, plate: PlateModel
) -> float:
    return float(np.sum((part - fit.response(part.size, rules.rate, plate)) ** 2))


def _unfitted(
    residual: NDArray[np.float64],
    begin: float,
    first: float,
    rest: list[_Span],
    rules: ContactRules,
    plate: PlateModel,
) -> list[_Span]:
    """The remaining contacts by the reading alone; the first one's start from its rise."""
    start = max(rest[0].start, first)
    period = plate.period * rules.rate
    low = max(math.ceil(begin), round(start - 0.7 * period), 0)
    part = residual[low : round(start + RISE * period)]
    fit = fit_pulse(part, rules.rate, plate, (start - low) / rules.rate, rules.noise)
    if fit is not None and fit.duration > 0.8 * RISE * plate.period:
        peak = float(np.abs(part).max())
        if fit.rms < 1.3 * max(fit.noise, rules.smoothed_noise / 2) + 0.006 * peak:
            start = min(start, max(low + fit.start * rules.rate, begin))
    return [_Span(start, rest[0].stop), *rest[1:]]


def _contact(
    reading: NDArray[np.float64], span: _Span, pushed: list[_Span], limit: int, rate: float
) -> Contact:
    """The contact with peak and impulse of the half-wave of the reading that it causes."""
    start = max(math.floor(span.start), 0)
    stop = max(math.ceil(span.stop), start + 1)
    for half_wave in pushed:
        if half_wave.start < span.stop and half_wave.stop > span.start:
            stop = max(stop, math.ceil(half_wave.stop))
    part = reading[start : max(min(stop, limit), start + 1)]
    known = np.where(np.isfinite(part), part, -math.inf)
    peak = int(np.argmax(known))
    return Contact(
        start=max(span.start, 0.0) / rate,
        end=span.stop / rate,
        peak_force=float(part[peak]),
        peak_time=(start + peak) / rate,
        impulse=math.fsum(part[np.isfinite(part)]) / rate,
    )
