"""The linear baseline of an oscillator, and the model that the search extends."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.driven.data.recordings import Cut, derivative_of, first_state, rests
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.models.channel_effects import channel_terms
from impactscope.discrepancy.driven.models.mechanical_effects import Sizes, mechanical_terms
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import (
    AT_REST,
    OscillatorModel,
    gain_of,
    inside_samples,
)
from impactscope.discrepancy.driven.models.terms import Number, Term
from impactscope.discrepancy.driven.systems.mass_and_damper import answers_in_time

__all__ = ['linear_oscillator', 'reversed_channels']

Array = NDArray[np.float64]

BEGINNINGS = (1.0, 0.25, 0.06)  # shares of a free swing whose strongest lines are tried
FEWEST, SAME = 64, 0.02  # samples of them; relative difference of two lines that are one
STEP_ANGLE = 0.4  # rad of the natural oscillation in a sub-step: phase error 2e-4 rad a radian
MOST_STEPS = 16
ROUNDS = 3  # of beginnings and numbers by turns
STOPPED = 0.63  # of the way that a speed leads in the end, within which it is told
LITTLE, AT_FIRST = 0.2, 0.75  # of what is left, beside a speed that was missed: in all, first
FIRST = 24  # samples of an axis that tell whether it begins at rest
QUARTER = 0.25  # of a cycle is used to find the state at the first sample
SLOWEST = 4.0  # periods in a recording, of an axis, below which its ends are most of what is seen
SMOOTH = 25  # samples, through which a speed is taken
AGREES = math.sqrt(0.5)  # cosine from which a force and an acceleration go together
REVERSED = 0.6  # of what the right sign leaves, below which a sign is taken for wrong
DAMPING_RATIOS = (0.005, 0.02, 0.08, 0.3, 0.9)


def linear_oscillator(
    cuts: Sequence[Cut], *, spring: bool, held: bool
) -> tuple[OscillatorModel, list[Segment], Fit]:
    """Fit mass, damping and (with ``spring``) stiffness; the model knows what may be missing.

    ``held``: the input stays constant between samples, as a controller's does. Without input the
    mass is one: only ratios show in a free swing.
    """
    free = cuts[0].drive is None
    starts = _free_starts(cuts) if free else _driven_starts(cuts, spring=spring)
    fastest = max((math.sqrt(max(k, 0.0) / m) for m, _, k in starts), default=0.0)
    period = 1.0 / cuts[0].rate
    steps = int(np.clip(math.ceil(1.5 * fastest * period / STEP_ANGLE), 1, MOST_STEPS))
    cycle = 2.0 * math.pi / (fastest * period) if fastest > 0.0 else 9.0 / QUARTER
    segments = [_segment(c, steps, min(cycle, 80.0), spring=spring, held=held) for c in cuts]
    best: tuple[float, OscillatorModel, Fit] | None = None
    for mass, damping, stiffness in starts:
        model = OscillatorModel(
            (
                *_numbers(mass, damping, stiffness, cuts[0], spring=spring, free=free),
                *_gains(cuts),
            ),
            (),
            free,
            float(np.max(np.abs(cuts[0].output))) or 1.0,
            float(np.max(np.abs(np.gradient(cuts[0].output, period)))) or 1.0,
        )
        made = fit(model, (), segments, {}, evaluations=12)
        error = sum(
            float(np.sum(r**2))
            for r, s in zip(made.residuals, segments, strict=True)
            if not s.held_out
        )
        if best is None or error < best[0]:
            best = error, model, made
    assert best is not None  # noqa: S101 - there is always a start
    _, model, made = best
    if not spring:
        segments = _at_rest(model, made, segments)
        for _ in range(ROUNDS):  # wrong beginnings have bent the numbers
            before = segments
            segments = _under_way(model, made, before)
            if segments == before:
                break
            made = fit(model, (), segments, made.values, tolerance=FINE)
    made = fit(model, (), segments, made.values, made.starts, tolerance=FINE)
    sizes = _sizes(model, made, segments, cuts)
    angle = cuts[0].unit == 'rad'
    terms = mechanical_terms(
        sizes,
        spring=spring,
        driven=not free,
        angle=angle,
        axis=not spring and not free and not angle,
        offset_channel=cuts[0].channel if free else cuts[0].drive_channel,
    )
    terms = tuple(_shared(t) if t.name == 'hysteresis' else t for t in terms)
    if not spring:
        terms = (*terms, _late(cuts[0]))
    full = OscillatorModel(model.numbers, terms, free, sizes.position, sizes.speed)
    begun = zip(segments, made.starts, strict=True)
    if any(len(full.starts(s)) != own.size for s, own in begun):
        # whether a recording begins in motion is judged by the size of the motion, known now
        made = fit(full, (), segments, made.values, tolerance=FINE)
    return full, segments, made


def _at_rest(model: OscillatorModel, made: Fit, segments: Sequence[Segment]) -> list[Segment]:
    """Segments that begin at rest wherever that is nearer to what was measured.

    The speed of an axis is read from a few samples. Noise of any colour makes one up, and nothing
    but friction ever stops it.
    """
    found = []
    for s, left in zip(segments, made.residuals, strict=True):
        still = dataclasses.replace(s, state=(s.state[0], 0.0))
        rest = s.measured - model.predict(made.values, (), np.zeros(0), still)
        nearer = s.state[1] != 0.0 and float(rest @ rest) < float(left @ left)
        found.append(still if nearer else s)
    return found


def _under_way(model: OscillatorModel, made: Fit, segments: Sequence[Segment]) -> list[Segment]:
    """Segments of an axis that begin with a speed wherever that explains most of what is left.

    A slow axis moves by no more than its encoder's steps in the few samples from which a speed is
    read. What it does in the time in which its damping would stop it tells better; and since
    nothing brings an axis back, a speed that was missed stays in all that follows.
    """
    found = []
    for s, left in zip(segments, made.residuals, strict=True):
        if s.derivative != 0:
            found.append(s)
            continue
        unit = dataclasses.replace(s, state=(s.state[0], s.state[1] + model.speed_scale))
        answer = model.predict(made.values, (), np.zeros(0), unit) - (s.measured - left)
        first = max(FIRST, int(np.searchsorted(np.abs(answer), STOPPED * np.max(np.abs(answer)))))
        columns = np.stack([np.ones(first), answer[:first]], axis=1)
        shift, share = np.linalg.lstsq(columns, left[:first], rcond=None)[0]
        rest = left - shift - share * answer
        early = float(np.sum((left[:first] - np.mean(left[:first])) ** 2))
        whole = float(left @ left)
        clear = float(rest[:first] @ rest[:first]) < AT_FIRST * early
        speed = s.state[1] + share * model.speed_scale
        moved = dataclasses.replace(s, state=(s.state[0] + float(shift), float(speed)))
        found.append(moved if clear and float(rest @ rest) < LITTLE * whole else s)
    return found


def _shared(term: Term) -> Term:
    """Hysteresis as a share of the baseline's stiffness that yields.

    A yielding spring beside the whole stiffness would start far off resonance, in another valley.
    """
    share = Number('share', '1', (0.5, 0.15), 0.1, 0.0, 1.0)
    numbers = tuple(share if n.name == 'stiffness' else n for n in term.numbers)
    equation = term.equation.replace('s h with', '(1 - a) k x + a k h with')
    return dataclasses.replace(term, numbers=numbers, equation=equation)


def _late(cut: Cut) -> Term:
    """An output that comes late: of an axis' motion even that may be most of what is left."""
    period = 1.0 / cut.rate
    terms = channel_terms(cut.channel, cut.unit, cut.rate, 1.0, 1.0, 1.0)
    term = next(t for t in terms if t.label == 'clock_error/output')
    (offset,) = term.numbers
    offset = dataclasses.replace(
        offset, starts=(period, 4.0 * period), scale=period, lower=-0.1, upper=0.1
    )
    return dataclasses.replace(term, numbers=(offset,))


def _segment(cut: Cut, steps: int, period_samples: float, *, spring: bool, held: bool) -> Segment:
    period = 1.0 / cut.rate
    n = cut.output.size
    if cut.drive is None:
        drive = np.zeros((n - 1, 2 * steps + 1))
    else:
        drive = inside_samples(cut.drive, steps, held=held)
    derivative = derivative_of(cut.unit)
    output = cut.output
    if derivative == 2 and spring:
        # A mass on a spring stays where it is, so that its mean acceleration is the sensor's.
        output = output - np.mean(output)
    state = (0.0, 0.0)
    if derivative == 0:
        width = 20 if cut.drive is None else round(QUARTER * period_samples)
        state = first_state(cut.output, period, width)
        near = np.max(np.abs(cut.output[:4])) < AT_REST * np.max(np.abs(cut.output))
        if near and cut.drive is not None and spring:
            state = (0.0, 0.0)  # quieter than any estimate from a few samples
        elif cut.drive is not None and not spring and rests(cut.output, FIRST):
            state = (state[0], 0.0)
    elif derivative == 1:
        state = (0.0, float(cut.output[0]))
    return Segment(
        cut.recording,
        cut.channel,
        cut.unit,
        cut.held_out,
        cut.begin,
        period,
        output,
        drive,
        derivative,
        state,
        cut.noise,
    )


def _position_unit(unit: str) -> str:
    return unit.split('/', 1)[0] or '1'


def _force_unit(cut: Cut) -> str:
    if cut.drive is None:
        return f'{_position_unit(cut.unit)}/s^2'
    return cut.drive_unit or '1'


def _numbers(
    mass: float, damping: float, stiffness: float, cut: Cut, *, spring: bool, free: bool
) -> tuple[Number, ...]:
    f, x = _force_unit(cut), _position_unit(cut.unit)
    small = 0.05 * math.sqrt(max(stiffness, 0.0) * mass) if spring else 0.3 * damping
    small = small if small > 0.0 else 0.1
    numbers = []
    if not free:
        unit = 'kg' if (f, x) == ('N', 'm') else f'{f} s^2/{x}'
        numbers.append(Number('mass', unit, (mass,), mass, 1e-6 * mass, 1e6 * mass))
    # what nothing brings back would run away under a damping below zero
    least = -math.inf if spring else 0.0
    numbers.append(Number('damping', f'{f} s/{x}', (damping,), small, least))
    if spring:
        numbers.append(Number('stiffness', f'{f}/{x}', (stiffness,), stiffness, 1e-6 * stiffness))
    return tuple(numbers)


def _gains(cuts: Sequence[Cut]) -> list[Number]:
    """Gains of further outputs over that of the first one, which mass and spring take up."""
    others = list(dict.fromkeys(c.channel for c in cuts))[1:]
    return [Number(gain_of(channel), '1', (1.0,), 1e-3, 0.0) for channel in others]


def _free_starts(cuts: Sequence[Cut]) -> list[tuple[float, float, float]]:
    """Stiffness from the strongest line of a free swing; the mass is one.

    Of all of it and of its beginning: a swing dies away, and what noise is left may be louder.
    """
    cut = max((c for c in cuts if not c.held_out), key=lambda c: c.output.size)
    found: list[float] = []
    for share in BEGINNINGS:
        samples = cut.output[: max(int(share * cut.output.size), FEWEST)]
        samples = samples - np.mean(samples)
        length = 8 * samples.size
        window = np.hanning(2 * samples.size)[samples.size :]  # its beginning is loudest
        spectrum = np.abs(np.fft.rfft(samples * window, length))
        line = 1 + int(np.argmax(spectrum[1:]))
        omega = 2.0 * math.pi * line * cut.rate / length
        if all(abs(omega - other) > SAME * other for other in found):
            found.append(omega)
    return [(1.0, 2.0 * ratio * omega, omega**2) for omega in found for ratio in (0.01, 0.05)]


@dataclass(frozen=True, slots=True)
class _Scanned:
    """A natural frequency and a loss, with the gain that fits best and what that leaves."""

    error: float
    gain: float
    omega: float  # rad/s
    loss: float  # 1/s


def _scan(cuts: Sequence[Cut], *, spring: bool) -> list[_Scanned]:
    """Natural frequencies and damping ratios over the band, in order of what they leave.

    In the frequency domain, transients neglected; for each pair the gain is a linear unknown.
    """
    spectra = []
    for c in cuts:
        length = 1 << (2 * c.output.size - 1).bit_length()
        frequency = np.fft.rfftfreq(length, 1.0 / c.rate)
        assert c.drive is not None  # noqa: S101 - free swings do not come here
        drive, output = np.fft.rfft(c.drive, length), np.fft.rfft(c.output, length)
        # thinned out: a scan needs no fine lines
        keep = slice(1, None, max(1, frequency.size // 20000))
        if not spring:
            # a load that stays and a motion that does not come back would say most of it
            window = np.hanning(c.output.size)
            drive = np.fft.rfft(window * (c.drive - np.mean(c.drive)), length)
            output = np.fft.rfft(window * (c.output - np.mean(c.output)), length)
            keep = slice(int(np.searchsorted(frequency, SLOWEST * c.rate / c.output.size)), None)
            keep = slice(keep.start, None, max(1, frequency.size // 20000))
        spectra.append(
            (2j * math.pi * frequency[keep], drive[keep], output[keep], derivative_of(c.unit))
        )
    longest = max(c.output.size / c.rate for c in cuts)
    fs = min(c.rate for c in cuts)
    if spring:
        pairs = [
            (omega, 2.0 * ratio * omega)
            for omega in 2.0 * math.pi * np.geomspace(1.0 / longest, 0.4 * fs, 240)
            for ratio in DAMPING_RATIOS
        ]
    else:
        pairs = [
            (0.0, corner) for corner in 2.0 * math.pi * np.geomspace(0.1 / longest, fs / 8, 60)
        ]
    total = sum(float(np.real(np.vdot(output, output))) for _, _, output, _ in spectra)
    found = []
    for omega, loss in pairs:
        above = below = 0.0
        for s, drive, output, derivative in spectra:
            shape = drive * s**derivative / (s * s + loss * s + omega**2)
            above += float(np.real(np.vdot(shape, output)))
            below += float(np.real(np.vdot(shape, shape)))
        gain = above / below
        found.append(_Scanned(total - gain * above, gain, omega, loss))
    return sorted(found, key=lambda x: x.error)


def reversed_channels(cuts: Sequence[Cut], *, spring: bool) -> tuple[str, ...]:
    """Outputs that answer the input with the wrong sign: a sensor that looks the other way.

    A mass below zero would fit these far better than any above.
    """
    found = []
    for channel in dict.fromkeys(c.channel for c in cuts):
        mine = [c for c in cuts if c.channel == channel and c.drive is not None and not c.held_out]
        if not mine:
            continue
        if not spring and derivative_of(mine[0].unit) == 2:
            if _agreement(mine) < -AGREES:
                found.append(channel)
            continue
        scanned = _scan(mine, spring=spring)
        forward = min((x.error for x in scanned if x.gain > 0.0), default=math.inf)
        if not (scanned[0].gain < 0.0 and scanned[0].error < REVERSED * forward):
            continue
        # in spectra the ends of what rolls away are most of what is seen, and in time a stop or a
        # spring that is missing: where one of the two has the right sign, it is right
        if spring or answers_in_time(mine)[0][1] < 0.0:
            found.append(channel)
    return tuple(found)


def _driven_starts(cuts: Sequence[Cut], *, spring: bool) -> list[tuple[float, float, float]]:
    """Mass, damping and stiffness of up to three natural frequencies that fit best."""
    chosen: list[tuple[float, float, float]] = []
    fitted = [c for c in cuts if not c.held_out]
    for x in _scan(fitted, spring=spring):
        if x.gain <= 0.0:
            continue
        apart = (abs(x.omega - math.sqrt(k / m)) > 0.15 * x.omega for m, _, k in chosen)
        if all(apart) or not chosen:
            mass = 1.0 / x.gain
            chosen.append((mass, mass * x.loss, mass * x.omega**2))
        if len(chosen) == 3:
            break
    if not spring and derivative_of(cuts[0].unit) == 2:
        chosen += _mass_alone(fitted)
    elif not spring:
        _, gain, loss = answers_in_time(fitted)[0]
        chosen += [(1.0 / gain, loss / gain, 0.0)] if gain > 0.0 else []
    return chosen or [(1.0, 1.0, 1.0)]


def _agreement(cuts: Sequence[Cut]) -> float:
    """Cosine of the angle between force and acceleration, all recordings together, -1 to 1.

    Of a mass that only a damper holds back it is positive: <F a> = m <a²> where the motion begins
    and ends at rest.
    """
    driven = [(c.drive, c.output) for c in cuts if c.drive is not None]
    forces = sum(float(drive @ drive) for drive, _ in driven)
    accelerations = sum(float(output @ output) for _, output in driven)
    both = sum(float(drive @ output) for drive, output in driven)
    return both / max(math.sqrt(forces * accelerations), 1e-300)


def _mass_alone(cuts: Sequence[Cut]) -> list[tuple[float, float, float]]:
    """Mass, damping and stiffness of a mass that is hardly held back, by its acceleration."""
    if not _agreement(cuts) > AGREES:
        return []
    driven = [(c.drive, c.output) for c in cuts if c.drive is not None]
    both = sum(float(drive @ output) for drive, output in driven)
    mass = sum(float(drive @ drive) for drive, _ in driven) / both
    longest = max(c.output.size / c.rate for c in cuts)
    return [(mass, 0.1 * mass / longest, 0.0)]


def _sizes(
    model: OscillatorModel, made: Fit, segments: Sequence[Segment], cuts: Sequence[Cut]
) -> Sizes:
    position = speed = force = 0.0
    for i, segment in enumerate(segments):
        if segment.held_out:
            continue
        x, v = model.motion(made.values, (), made.starts[i], segment)
        if segment.derivative == 0:
            x = segment.measured
            if model.drifts:  # under a load that it lacks the baseline may stand still
                v = signal.savgol_filter(x, SMOOTH, 2, deriv=1, delta=segment.period)
        position = max(position, float(np.max(np.abs(x))))
        speed = max(speed, float(np.quantile(np.abs(v), 0.99)))
        drive = cuts[i].drive
        if drive is not None:
            force = max(force, float(np.sqrt(np.mean(drive**2))))
        elif 'stiffness' in made.values:
            force = max(force, made.values['stiffness'] * float(np.sqrt(np.mean(x**2))))
        else:  # what runs down is held back by its friction alone
            force = max(force, abs(made.values['damping']) * float(np.max(np.abs(v))))
    position, speed, force = position or 1.0, speed or 1.0, force or 1.0
    stiffness = made.values.get('stiffness', force / position)
    return Sizes(
        position,
        speed,
        force,
        stiffness,
        _force_unit(cuts[0]),
        _position_unit(cuts[0].unit),
    )
