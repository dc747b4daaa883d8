"""A mass under a force, or left alone, where a right model leaves noise alone.

Three things stand between a right model and white residuals, and each is part of the noise here:
the noise of the force's own sensor, which rings in the mass on its spring; a sensor whose noise is
not white; samples that stand out alone. What the force does between its samples is not known
either: the course that the recordings bear out is taken.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from impactscope.discrepancy.driven.adequacy.plate_laws import plate_laws
from impactscope.discrepancy.driven.data.measured_force import KnownForce, known_force
from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.fits.innovations import innovations
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.model_selection.chi_square import NoiseJudge
from impactscope.discrepancy.driven.models.backlash import COUPLED, backlash_terms
from impactscope.discrepancy.driven.models.candidate_effects import FRICTION, candidate_effects
from impactscope.discrepancy.driven.models.driven_mass_model import DrivenMassModel, name_of
from impactscope.discrepancy.driven.models.measuring_chain import (
    HIGHEST_ORDER,
    filter_of,
    power_passed,
    power_retimed,
    smooths,
)
from impactscope.discrepancy.driven.models.mechanical_effects import Sizes
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel, inside_samples
from impactscope.discrepancy.driven.models.terms import Term, key
from impactscope.discrepancy.driven.systems.case import Case, Settled, throughout
from impactscope.discrepancy.driven.systems.driven_mass_noise import whitened

__all__ = ['driven_mass_case', 'taken_over']

Array = NDArray[np.float64]

ROUNDS = 3
MOST = 60  # evaluations
MOVING = 20.0  # chi-square by which a recording begins in motion
AT_FIRST = 0.5  # of that, in the first half of what the beginning does
ASIDE = 1e-3  # of position and speed, by which a beginning is moved
FAR = 1e4  # reduced chi-square that tells nothing of how recordings begin
BETTER = 25.0  # chi-square by which another course between samples is believed
ALIKE = 6.0  # chi-square within which it stands before an effect of the chain
MOSTLY = 0.1  # of chi-square is left where beginnings in motion are all that is missing
# of the chi-square that a law takes from the force's noise, by chance, for the output's may look
# like it: two standard deviations of what that makes of one unit
SCATTER = 4.0
ABOUT = 31  # lines of a spectrum whose mean counts
SLOW = 0.01  # of half the rate: corner of an encoder's noise, as long as effects are looked for


def driven_mass_case(
    parts: Sequence[Cut],
    model: OscillatorModel,
    segments: Sequence[Segment],
    made: Fit,
    *,
    held: bool,
    found: tuple[Case, Fit] | None = None,
) -> Case | None:
    """The campaign as one in which noise is all that a right model leaves; None if it is none.

    Args:
        parts: usable parts of the recordings, maybe longer than the segments.
        model: of the mass.
        segments: that were fitted.
        made: fit of the linear baseline.
        held: whether the force stays constant between samples.
        found: a case made before and a fit that leaves less, from which the noise is known better.
    """
    if made.values['damping'] < 0.0 and 'stiffness' not in made.values:
        return None
    forces = [None if held or c.drive is None else known_force(c.drive) for c in parts]
    parts = [
        c if f is None else dataclasses.replace(c, drive=f.force)
        for c, f in zip(parts, forces, strict=True)
    ]
    if found is None:
        steps = (segments[0].drive.shape[1] - 1) // 2
        ready = [
            dataclasses.replace(
                s,
                measured=cut.output,
                drive=s.drive
                if cut.drive is None and cut.output.size == s.measured.size
                else _course(cut, steps, 'held' if held else 'band'),
                state=s.state if model.free or model.drifts else (0.0, 0.0),
                whitener=None,
            )
            for s, cut in zip(segments, parts, strict=True)
        ]
        linear, base = _linear(model, ready, made)
    else:
        assert isinstance(found[0].model, DrivenMassModel)  # noqa: S101 - made below
        ready, linear, base = found[0].segments, found[0].model, found[0].baseline
    spectra: list[Array] = []
    best = base if found is None else found[1]
    for _ in range(ROUNDS if found is None else 1):
        if not all(math.isfinite(v) for v in best.values.values()):
            return None
        # what a missing force does to an axis falls with the frequency, as slow noise does:
        # only what is left beside a finding tells how slow the noise is
        slowest = SLOW if model.drifts and found is None else 0.0
        beside = model.drifts and found is not None
        ready, spectra = whitened(parts, ready, best, forces, slowest, beside=beside)
        if not spectra:
            return None
        if found is not None:
            linear = _in_motion(linear, ready, best)
            continue
        if model.drifts and _chi_square(ready, base) > FAR * _counted(ready):
            # where it begins is seen once what is missing is known, unless that is all
            every = frozenset(name_of(s) for s in ready)
            moving = dataclasses.replace(linear, moving=every, _last={})
            trial = fit(moving, (), ready, base.values, tolerance=FINE)
            if _chi_square(ready, trial) > MOSTLY * _chi_square(ready, base):
                break
            linear, base, best = moving, trial, trial
            continue
        linear = _in_motion(linear, ready, base)
        base = best = fit(
            dataclasses.replace(linear, terms=()), (), ready, base.values, tolerance=FINE
        )
    if found is None and not held and not model.free:
        ready, base = _between(parts, linear, ready, base)
    if found is None:
        linear = _sized(linear, ready, base)
        linear = dataclasses.replace(linear, terms=_terms(linear, ready, base, parts), _last={})
    else:
        base = fit(linear, (), ready, base.values, base.starts, tolerance=FINE)
    noise = {s.channel: s.noise for s in ready}
    return Case(
        linear,
        list(ready),
        base,
        NoiseJudge(ready, _muffled(linear, ready, spectra), scatter=SCATTER),
        plate_laws,
        throughout(ready),
        noise,
        _with_felt_force(linear, ready, forces),
    )


def _with_felt_force(
    model: DrivenMassModel, segments: Sequence[Segment], forces: Sequence[KnownForce | None]
) -> Settled | None:
    """How a fit looks under the force as force and motion together tell it; None: no better.

    A prediction answers the noise of the force's sensor, which the mass has not felt, and the
    residual shows it the other way round: slopes and laws are bent towards it, and whatever
    weakens the answer somewhere explains something (errors in variables). By its share of the
    residual, line by line, that noise is taken off the force; what is left is in no way
    correlated with the motion then.
    """
    noises = [math.nan if f is None or f.error is not None else f.noise for f in forces]
    if model.drifts or model.free or not any(n > 0.0 for n in noises):
        return None

    def settled(made: Fit) -> tuple[Fit, list[Segment]]:
        better = []
        for i, (s, noise) in enumerate(zip(segments, noises, strict=True)):
            if not noise > 0.0:
                better.append(s)
                continue
            left = made.residuals[i]
            change = _felt_beside(s, left, made.values, noise)
            steps = (s.drive.shape[1] - 1) // 2
            known = dataclasses.replace(
                s, drive=s.drive + inside_samples(change, steps, held=False)
            )
            predicted = model.predict(made.values, made.terms, made.starts[i], known)
            better.append(dataclasses.replace(known, measured=predicted + left))
        return made, better

    return settled


def _felt_beside(s: Segment, left: Array, values: Mapping[str, float], noise: float) -> Array:
    """What the residual tells of the force beyond its samples, shape (n,); of linear answers."""
    omega = 2.0 * math.pi * np.fft.rfftfreq(left.size, s.period)
    mass, damping = values.get('mass', 1.0), values['damping']
    stiff = values.get('stiffness', 0.0) - mass * omega**2 + 1j * damping * omega
    stiff[0] = stiff[0] or 1.0
    answer = (1j * omega) ** s.derivative / stiff
    spectrum = np.fft.rfft(left)
    level = ndimage.uniform_filter1d(np.abs(spectrum) ** 2, ABOUT) / left.size
    level = np.maximum(level, noise * np.abs(answer) ** 2)  # it is no more than all that is left
    shown = np.divide(spectrum, level, out=np.zeros_like(spectrum), where=level > 0.0)
    return np.asarray(np.fft.irfft(noise * np.conj(answer) * shown, left.size))


def _course(cut: Cut, steps: int, how: str) -> Array:
    """Force inside the sampling periods: ``band`` limited, ``held`` or straight (``line``)."""
    if cut.drive is None:
        return np.zeros((cut.output.size - 1, 2 * steps + 1))
    if how != 'line':
        return inside_samples(cut.drive, steps, held=how == 'held')
    share = np.linspace(0.0, 1.0, 2 * steps + 1)
    return np.ascontiguousarray(
        cut.drive[:-1, None] + np.diff(cut.drive)[:, None] * share, np.float64
    )


def _linear(
    model: OscillatorModel, ready: Sequence[Segment], made: Fit
) -> tuple[DrivenMassModel, Fit]:
    moving = (
        frozenset(name_of(s) for s in ready) if model.free else frozenset[tuple[str, str, float]]()
    )
    linear = DrivenMassModel(
        model.numbers, (), model.free, model.position_scale, model.speed_scale, {}, moving
    )
    starts = made.starts if model.free else None
    # beginnings are not known yet: a fit without them would bend the numbers
    most = MOST if model.free else 1
    return linear, fit(linear, (), ready, made.values, starts, most, FINE)


def _in_motion(linear: DrivenMassModel, ready: Sequence[Segment], base: Fit) -> DrivenMassModel:
    """The model with a beginning of its own for each recording that begins in motion."""
    if linear.free:
        return linear
    if linear.drifts:
        # an axis may begin anywhere: a beginning that is read from a few samples and kept would
        # have to be made up for by an offset
        every = frozenset(name_of(s) for s in ready if s.derivative == 0)
        return dataclasses.replace(linear, moving=linear.moving | every, _last={})
    moving = set(linear.moving)
    # where in its band friction holds a mass is seen in no beginning and bears on all that follows
    terms = tuple(t for t in base.terms if t.name not in FRICTION)
    held = {key(t, n) for t in base.terms if t.name in FRICTION for n in t.numbers}
    values = {k: v for k, v in base.values.items() if k not in held}
    for i, s in enumerate(ready):
        if name_of(s) in moving:
            continue
        rest = innovations(s, base.residuals[i])
        none = linear.predict(values, terms, np.array(s.state), s)
        columns = []
        for begin in ((linear.position_scale, 0.0), (0.0, linear.speed_scale)):
            small = np.array(s.state) + ASIDE * np.array(begin)
            moved = linear.predict(values, terms, small, s)
            columns.append(innovations(s, moved - none))
        answer = np.stack(columns, axis=1)
        # an error of the law, or of what a blow did later, is no beginning
        first = _first_of(answer)
        if (
            _explained(answer, rest) > MOVING
            and _explained(answer[:first], rest[:first]) > AT_FIRST * MOVING
        ):
            moving.add(name_of(s))
    return dataclasses.replace(linear, moving=frozenset(moving), _last={})


def _first_of(answer: Array) -> int:
    """Samples by which half of what a beginning does has been seen; ``answer``: (n, k)."""
    size = np.linalg.norm(answer, axis=0)
    seen = np.cumsum(np.sum((answer / np.where(size > 0.0, size, 1.0)) ** 2, axis=1))
    return int(np.searchsorted(seen, 0.5 * seen[-1])) + 1


def _explained(answer: Array, rest: Array) -> float:
    """Chi-square that a beginning takes away, over that of a sample where it is more than 1."""
    factors = np.linalg.lstsq(answer, rest, rcond=1e-9)[0]
    left = rest - answer @ factors
    return float(rest @ (answer @ factors)) / max(float(left @ left) / rest.size, 1.0)


def _between(
    parts: Sequence[Cut], linear: DrivenMassModel, ready: Sequence[Segment], base: Fit
) -> tuple[list[Segment], Fit]:
    """Segments with the course between samples that the recordings bear out, and their fit."""
    bare = dataclasses.replace(linear, terms=(), _last={})
    steps = (ready[0].drive.shape[1] - 1) // 2
    known = _chi_square(ready, base)
    chosen = list(ready), base
    for how, mimic in (('held', 'clock_error/output'), ('line', 'low_pass_filter/zero-1')):
        other = [
            dataclasses.replace(s, drive=_course(c, steps, how))
            for s, c in zip(ready, parts, strict=True)
        ]
        made = fit(bare, (), other, base.values, base.starts, tolerance=FINE)
        reached = _chi_square(other, made)
        if reached > known - BETTER or reached > _chi_square(chosen[0], chosen[1]):
            continue
        terms = [t for t in _terms(linear, ready, base, parts) if t.label == mimic]
        rivals = [fit(bare, (t,), ready, base.values, base.starts, tolerance=FINE) for t in terms]
        if all(reached < _chi_square(ready, r) + ALIKE for r in rivals):
            chosen = other, made
    return chosen


def _chi_square(segments: Sequence[Segment], made: Fit) -> float:
    pairs = zip(segments, made.residuals, strict=True)
    return float(sum(np.sum(innovations(s, r) ** 2) for s, r in pairs if not s.held_out))


def _counted(segments: Sequence[Segment]) -> int:
    return sum(s.measured.size for s in segments if not s.held_out)


def _muffled(
    linear: DrivenMassModel, segments: Sequence[Segment], shares: Sequence[Array]
) -> Callable[[Fit], Sequence[float]]:
    """Chi-square that a fit takes from the force's noise, by segment.

    A filter smooths that noise in the prediction, and friction that holds the mass keeps it from
    ringing: neither is a merit.
    """

    def lost(made: Fit) -> Sequence[float]:
        found = []
        rough = any(t.name in FRICTION for t in made.terms)
        filters = any(t.output for t in made.terms)
        for i, (s, share) in enumerate(zip(segments, shares, strict=True)):
            kept = np.ones(share.size - 1)
            if not np.any(share) or not (rough or filters):
                found.append(0.0)
                continue
            if filters:
                frequency = np.linspace(0.0, 0.5 / s.period, share.size)[1:]
                kept = power_passed(made.terms, made.values, frequency, 1.0 / s.period)
                kept = kept * power_retimed(made.terms, made.values, frequency, s.period)
            if rough:
                _, speed = linear.motion(made.values, made.terms, made.starts[i], s)
                kept = kept * float(np.mean(speed != 0.0))
            found.append(float(np.mean(share[1:] * (1.0 - kept))) * s.measured.size)
        return found

    return lost


def _motions(
    linear: DrivenMassModel, segments: Sequence[Segment], made: Fit
) -> list[tuple[Array, Array]]:
    return [
        linear.motion(made.values, (), made.starts[i], s)
        for i, s in enumerate(segments)
        if not s.held_out
    ]


def _sized(linear: DrivenMassModel, segments: Sequence[Segment], made: Fit) -> DrivenMassModel:
    motions = _motions(linear, segments, made)
    return dataclasses.replace(
        linear,
        position_scale=max(float(np.max(np.abs(x))) for x, _ in motions) or 1.0,
        speed_scale=max(float(np.max(np.abs(v))) for _, v in motions) or 1.0,
        _last={},
    )


def _terms(
    linear: DrivenMassModel, segments: Sequence[Segment], made: Fit, parts: Sequence[Cut]
) -> tuple[Term, ...]:
    motions = _motions(linear, segments, made)
    x = max(float(np.max(np.abs(x))) for x, _ in motions) or 1.0
    v = max(float(np.max(np.abs(v))) for _, v in motions) or 1.0
    values: Mapping[str, float] = made.values
    stiffness = values.get('stiffness', 0.0)
    drives = [np.max(np.abs(s.drive)) for s in segments]
    force = max(float(max(drives)), stiffness * x) or 1.0
    first = parts[0]
    unit = first.unit.split('/', 1)[0] or '1'
    sizes = Sizes(
        x,
        v,
        force,
        stiffness if stiffness > 0.0 else force / x,
        (first.drive_unit or '1') if not linear.free else f'{unit}/s^2',
        unit,
    )
    found: list[Term] = []
    channels = list(dict.fromkeys(s.channel for s in segments))
    for channel in channels:
        mine = [i for i, s in enumerate(segments) if s.channel == channel]
        terms = candidate_effects(
            sizes,
            (values.get('mass', 1.0), values['damping'], sizes.stiffness),
            (channel, segments[mine[0]].unit),
            first.rate,
            max(segments[i].measured.size * segments[i].period for i in mine),
            segments[mine[0]].noise,
            max(float(np.max(np.abs(segments[i].measured))) for i in mine),
            len(mine),
            ends=(len(mine), len(mine)) if linear.drifts else (0, 0),
            kind='free' if linear.free else 'driven' if stiffness > 0.0 else 'axis',
            drive=first.drive_channel,
            tag=channel if len(channels) > 1 else '',
            joint=unit == 'rad' and stiffness <= 0.0 and not linear.free,
        )
        found += [t for t in terms if t.output or channel == channels[0]]
    if linear.drifts:  # its motion is far below any filter: the delay is all that shows
        found = [
            t
            for t in found
            if t.name != 'low_pass_filter' or (filter_of(t)[0] <= HIGHEST_ORDER and not smooths(t))
        ]
        # and what a coupling holds of the time before is where the recording begins
        found = [t for t in found if t.name != 'ac_coupling' or not t.own]
    if linear.drifts and all(s.derivative == 0 for s in segments):
        able = {
            'mass',
            'damping',
            'offset',
            'clearance',
            COUPLED,
        }  # what the two masses have beside it
        others = frozenset(t.name for t in found if not t.output) - able
        found += backlash_terms(x, sizes.position_unit, first.rate, others)
    return tuple(found)


def taken_over(case: Case, found: Fit) -> tuple[Case, Fit]:
    """A case that knows the effects another search has found, and these as a fit of it."""
    model = case.model
    assert isinstance(model, DrivenMassModel)  # noqa: S101 - made above
    known = {t.label for t in model.terms}
    further = tuple(t for t in found.terms if t.label not in known)
    model = dataclasses.replace(model, terms=(*model.terms, *further), _last={})
    values = {**case.baseline.values, **found.values}
    begun = [(found.terms, values), *_with_own_yield(model, found.terms, values)]
    seeds = [fit(model, t, case.segments, v, case.baseline.starts) for t, v in begun]
    return dataclasses.replace(case, model=model), min(seeds, key=lambda f: f.cost)


def _with_own_yield(
    model: DrivenMassModel, terms: tuple[Term, ...], values: Mapping[str, float]
) -> list[tuple[tuple[Term, ...], dict[str, float]]]:
    """The same effects with hysteresis in the form that the exact search has, by its yield.

    Another search knows forms that yield otherwise on the way back; each would keep the other out.
    """
    old = next((t for t in terms if t.name == 'hysteresis'), None)
    own = next((t for t in model.terms if t.label == 'hysteresis/share'), None)
    if old is None or own is None or old is own:
        return []
    had = {n.name: values[key(old, n)] for n in old.numbers}
    rate = had.get('closing', 0.0) + had.get('leaning', 0.0)
    if 'share' not in had or rate <= 0.0:
        return []
    numbers = {'share': had['share'], 'yield_displacement': 1.0 / rate}
    given = {key(own, n): numbers[n.name] for n in own.numbers}
    return [(tuple(own if t is old else t for t in terms), {**values, **given})]
