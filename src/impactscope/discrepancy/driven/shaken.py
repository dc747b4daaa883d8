"""A mass under a measured or commanded force, or left alone: a right model leaves noise alone.

Three things stand between a right model and white residuals, and each is part of the noise here:
the noise of the force's own sensor, which rings in the mass on its spring; a sensor whose noise is
not white; samples that stand out alone. What the force does between its samples is not known
either: the course that the recordings bear out is taken.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize

from impactscope.discrepancy.driven.case import Case, throughout
from impactscope.discrepancy.driven.fitting import FINE, Fit, fit
from impactscope.discrepancy.driven.force import KnownForce, known_force
from impactscope.discrepancy.driven.ladders import FRICTION, exact_terms
from impactscope.discrepancy.driven.measuring import before_sampling, filter_of, power_passed
from impactscope.discrepancy.driven.mechanics import Sizes
from impactscope.discrepancy.driven.model import OscillatorModel, Segment, inside_samples
from impactscope.discrepancy.driven.noise_judge import NoiseJudge, innovations
from impactscope.discrepancy.driven.plate_laws import plate_laws
from impactscope.discrepancy.driven.play import PLAY, follow, play_terms, run_with_play
from impactscope.discrepancy.driven.recordings import Cut
from impactscope.discrepancy.driven.spectral import (
    Colour,
    fitted_colour,
    levels,
    stepped,
    whitening,
)
from impactscope.discrepancy.driven.terms import Number, Term, key
from impactscope.discrepancy.driven.whitening import HammerForce, whitener

__all__ = ['ShakenModel', 'shaken_case', 'taken_over']

Array = NDArray[np.float64]

ROUNDS = 3
MOST = 60  # evaluations
LONGEST = 1 << 17  # samples of a whitening filter
MOVING = 20.0  # chi-square by which a recording begins in motion
ASIDE = 1e-3  # of position and speed, by which a beginning is moved
FAR = 1e4  # reduced chi-square that tells nothing of how recordings begin
BETTER = 25.0  # chi-square by which another course between samples is believed
ALIKE = 6.0  # chi-square within which it stands before an effect of the chain
FINEST_STEP = 4e-7  # of the range, as fine as single precision
QUIET = 30.0  # times the noise: where the spectrum of a prediction is quiet
ENOUGH = 0.2  # of the lines must be quiet
ALONE = 10.0  # times the noise: a sample that stands out
SPIKES = 0.003  # of the samples may do so
NEIGHBOURS = 7
HIGHEST_ORDER = 4  # of low-passes of an axis
MOSTLY = 0.1  # of chi-square is left where beginnings in motion are all that is missing
DITHERED = 1.8  # noises, of a step below which they make it one more part of the noise
SLOW = 0.01  # of half the rate: corner of an encoder's noise, as long as effects are looked for
FEWEST = 3  # parts of a spectrum


@dataclass(frozen=True, eq=False)
class ShakenModel(OscillatorModel):
    """An oscillator some of whose recordings begin in motion."""

    moving: frozenset[tuple[str, str, float]] = field(default_factory=frozenset)

    def predict(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> Array:
        """Predicted channel, shape (n,); what acts in another channel plays no part."""
        mine = tuple(t for t in terms if not t.output or t.channel == segment.channel)
        return super().predict(values, mine, start, segment)

    def _run(
        self, values: Mapping[str, float], terms: tuple[Term, ...], start: Array, segment: Segment
    ) -> Array:
        play = next((t for t in terms if t.label in PLAY), None)
        if play is None:
            return super()._run(values, terms, start, segment)
        if play.variant == 'encoder':
            rest = tuple(t for t in terms if t is not play)
            out = super()._run(values, rest, start, segment).copy()
            follow(out[:, 0].copy(), values[key(play, play.numbers[0])], out[:, 0])
            return out
        x, v = start if start.size else segment.state
        plain = np.array([values['mass'], values['damping'], values.get('offset.value', 0.0)])
        side = float(play.variant == 'load')
        between = np.array([*(values[key(play, n)] for n in play.numbers), side])
        out = np.zeros((segment.measured.size, 4))
        run_with_play(plain, between, segment.drive, segment.period, x, v, out)
        return out

    def starts(self, segment: Segment) -> tuple[Number, ...]:
        """Position and speed at the first sample, where it begins in motion."""
        if _name(segment) not in self.moving:
            return ()
        x, v = segment.state
        return (
            Number('position', '', (x,), 0.1 * self.position_scale),
            Number('speed', '', (v,), 0.1 * self.speed_scale),
        )


def _name(segment: Segment) -> tuple[str, str, float]:
    return segment.recording, segment.channel, segment.begin


def shaken_case(
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
        assert isinstance(found[0].model, ShakenModel)  # noqa: S101 - made below
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
        ready, spectra = _whitened(parts, ready, best, forces, slowest, beside=beside)
        if not spectra:
            return None
        if found is not None:
            linear = _in_motion(linear, ready, best)
            continue
        if model.drifts and _chi_square(ready, base) > FAR * _counted(ready):
            # where it begins is seen once what is missing is known, unless that is all
            every = frozenset(_name(s) for s in ready)
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
        NoiseJudge(ready, _muffled(linear, ready, spectra)),
        plate_laws,
        throughout(ready),
        noise,
    )


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
) -> tuple[ShakenModel, Fit]:
    moving = (
        frozenset(_name(s) for s in ready) if model.free else frozenset[tuple[str, str, float]]()
    )
    linear = ShakenModel(
        model.numbers, (), model.free, model.position_scale, model.speed_scale, {}, moving
    )
    starts = made.starts if model.free else None
    # beginnings are not known yet: a fit without them would bend the numbers
    most = MOST if model.free else 1
    return linear, fit(linear, (), ready, made.values, starts, most, FINE)


def _gain(made: Fit, derivative: int, turn: Array) -> Array:
    """Square of what a unit of force makes of the output, by angular frequency."""
    mass = made.values.get('mass', 1.0)
    k, c = made.values.get('stiffness', 0.0), made.values['damping']
    below = (k - mass * turn**2) ** 2 + (c * turn) ** 2
    return np.asarray(turn ** (2 * derivative) / np.maximum(below, 1e-300))


def _whitened(
    parts: Sequence[Cut],
    ready: Sequence[Segment],
    made: Fit,
    forces: Sequence[KnownForce | None],
    slowest: float = 0.0,
    *,
    beside: bool = False,
) -> tuple[list[Segment], list[Array]]:
    """Segments with their whitening filters, and the share of the force's noise by frequency.

    ``slowest``: corner over half the rate below which the output's noise does not fall;
    ``beside``: the noise is read also where the motion is far louder.
    """
    done = list(ready)
    drifts = 'stiffness' not in made.values
    shares: list[Array] = [np.zeros(0)] * len(done)
    for channel in dict.fromkeys(s.channel for s in ready):
        mine = [i for i, s in enumerate(ready) if s.channel == channel]
        told = [i for i in mine if not ready[i].held_out] or mine
        s = ready[told[0]]
        stated = parts[told[0]].noise
        weights = {i: _alone(made.residuals[i]) for i in mine}
        left = [_filled(made.residuals[i], weights[i]) for i in told]
        predicted = [ready[i].measured - made.residuals[i] for i in told]
        size = min(r.size for r in left)
        place, level = levels([r[:size] for r in left], slow=beside)
        _, loud = levels([p[:size] for p in predicted], slow=beside)
        if beside:
            loud = np.zeros_like(loud)
        noises = [0.0 if f is None else f.noise for f in forces]
        force = float(np.mean([noises[i] for i in told]))
        moves = [1.0 if f is None else f.moves for f in forces]
        rings = _gain(made, s.derivative, math.pi * place / s.period)
        rings = rings * float(np.mean([moves[i] for i in told]))
        white, force, colour = _noise(place, level, loud, rings, force, size, slowest)
        steps = min(_step(ready[i].measured) for i in told) if drifts else 0.0
        if steps < DITHERED * math.sqrt(white):
            steps = 0.0
        if steps > 0.0:
            white, colour = max(white, steps**2 / 12.0), None
        if math.isfinite(stated) and stated > 0.0:
            white, colour = stated**2, None
        if not white > 0.0:
            return [], []
        for i in mine:
            grid = 1 << max(10, min(2 * ready[i].measured.size, LONGEST).bit_length())
            f = np.linspace(0.0, 1.0, grid // 2 + 1)
            f[0] = 0.5 * f[1]
            own = np.full(f.size, white)
            if colour is not None:
                own = colour.power(f, max(2.0 / ready[i].measured.size, 1e-6))
            mine_force = noises[i] if math.isfinite(noises[i]) else force
            rung = mine_force * moves[i] * _gain(made, s.derivative, math.pi * f / s.period)
            rung = np.minimum(rung, 1e12 * own)
            total = float(np.mean(own + rung))
            if colour is not None and drifts:
                total = min(total, float(np.mean([np.mean(r**2) for r in left])))
            filtering: Callable[[Array], Array] = whitening(own + rung, weights[i])
            known = forces[i]
            if known is not None and known.error is not None and colour is None:
                filtering = _along(made, ready[i], math.sqrt(white), known.error)
            repeated = stepped(ready[i].measured, math.sqrt(white)) if steps > 0.0 else None
            if repeated is not None:
                filtering = repeated
            done[i] = dataclasses.replace(ready[i], noise=math.sqrt(total), whitener=filtering)
            shares[i] = rung / (own + rung)
    return done, shares


def _step(samples: Array) -> float:
    """Step of a reading some of whose samples repeat the one before; 0 where none do."""
    change = np.abs(np.diff(samples))
    if np.all(change > 0.0):
        return 0.0
    few = change[change > 0.0]
    step = float(np.min(few)) if few.size else 0.0
    return step if step > FINEST_STEP * float(np.max(np.abs(samples))) else 0.0


def _along(
    made: Fit, segment: Segment, noise: float, error: HammerForce
) -> Callable[[Array], Array]:
    """The filter for a force whose error changes in time."""
    plate = made.values.get('mass', 1.0), made.values['damping'], made.values.get('stiffness', 0.0)
    size = segment.measured.size
    return whitener(plate, segment.derivative, segment.period, noise, error, size)


def _alone(residual: Array) -> Array | None:
    """Weights of samples, 0 where one or two stand out alone; None where none do."""
    rest = residual - ndimage.median_filter(residual, NEIGHBOURS)
    noise = float(np.median(np.abs(rest))) / 0.6745
    if not noise > 0.0:
        return None
    out = np.abs(rest) > ALONE * noise
    count = int(np.count_nonzero(out))
    if count == 0 or count > max(SPIKES * residual.size, 1):
        return None
    edges = np.flatnonzero(np.diff(np.concatenate([[0], out.astype(np.int8), [0]])))
    runs = edges.reshape(-1, 2)
    if np.any(runs[:, 1] - runs[:, 0] > 2):
        return None
    return np.where(out, 0.0, 1.0)


def _filled(residual: Array, weight: Array | None) -> Array:
    """A residual with its neighbours' median where samples do not count."""
    if weight is None:
        return residual
    return np.where(weight > 0.0, residual, ndimage.median_filter(residual, NEIGHBOURS))


def _noise(
    place: Array,
    level: Array,
    loud: Array,
    rings: Array,
    force: float,
    size: int,
    slowest: float,
) -> tuple[float, float, Colour | None]:
    """White level of the output, variance of the force's noise, and a colour if there is one."""
    if place.size < FEWEST:
        return float(np.median(level)), 0.0, None
    widths = np.gradient(place)
    widths = widths / float(np.sum(widths))
    if not math.isfinite(force):
        start = float(np.average(level, weights=widths))

        def cost(q: Array) -> float:
            s = np.exp(q[0]) + np.exp(q[1]) * rings
            return float(np.sum(widths * (np.log(s) + level / s)))

        begin = np.log([0.5 * start, 0.5 * start / max(float(np.median(rings)), 1e-300)])
        made = optimize.minimize(cost, begin, method='Nelder-Mead')
        return float(np.exp(made.x[0])), float(np.exp(made.x[1])), None
    rest = np.maximum(level - force * rings, 0.02 * level)
    colour = fitted_colour(place, rest, loud, 0.5 * size, slowest)
    if colour is not None:
        return float(np.average(colour.power(place), weights=widths)), force, colour
    among = [_median(rest, widths), _median(rest[place > 0.5], widths[place > 0.5])]
    quiet = (loud < QUIET * level) & (level > 2.0 * force * rings)
    if float(np.sum(widths[quiet])) > ENOUGH:
        among.append(float(np.average(rest[quiet], weights=widths[quiet])))
    return min(among), force, None


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    half = int(np.searchsorted(total, 0.5 * total[-1]))
    return float(values[order][min(half, values.size - 1)])


def _in_motion(linear: ShakenModel, ready: Sequence[Segment], base: Fit) -> ShakenModel:
    """The model with a beginning of its own for each recording that begins in motion."""
    if linear.free:
        return linear
    if linear.drifts:
        # an axis may begin anywhere: a beginning that is read from a few samples and kept would
        # have to be made up for by an offset
        every = frozenset(_name(s) for s in ready if s.derivative == 0)
        return dataclasses.replace(linear, moving=linear.moving | every, _last={})
    moving = set(linear.moving)
    values, terms = base.values, base.terms
    for i, s in enumerate(ready):
        if _name(s) in moving:
            continue
        rest = innovations(s, base.residuals[i])
        none = linear.predict(values, terms, np.array(s.state), s)
        columns = []
        for begin in ((linear.position_scale, 0.0), (0.0, linear.speed_scale)):
            small = np.array(s.state) + ASIDE * np.array(begin)
            moved = linear.predict(values, terms, small, s)
            columns.append(innovations(s, moved - none))
        answer = np.stack(columns, axis=1)
        factors = np.linalg.lstsq(answer, rest, rcond=1e-9)[0]
        if float(rest @ (answer @ factors)) > MOVING:
            moving.add(_name(s))
    return dataclasses.replace(linear, moving=frozenset(moving), _last={})


def _between(
    parts: Sequence[Cut], linear: ShakenModel, ready: Sequence[Segment], base: Fit
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
    linear: ShakenModel, segments: Sequence[Segment], shares: Sequence[Array]
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
            if rough:
                _, speed = linear.motion(made.values, made.terms, made.starts[i], s)
                kept = kept * float(np.mean(speed != 0.0))
            found.append(float(np.mean(share[1:] * (1.0 - kept))) * s.measured.size)
        return found

    return lost


def _motions(
    linear: ShakenModel, segments: Sequence[Segment], made: Fit
) -> list[tuple[Array, Array]]:
    return [
        linear.motion(made.values, (), made.starts[i], s)
        for i, s in enumerate(segments)
        if not s.held_out
    ]


def _sized(linear: ShakenModel, segments: Sequence[Segment], made: Fit) -> ShakenModel:
    motions = _motions(linear, segments, made)
    return dataclasses.replace(
        linear,
        position_scale=max(float(np.max(np.abs(x))) for x, _ in motions) or 1.0,
        speed_scale=max(float(np.max(np.abs(v))) for _, v in motions) or 1.0,
        _last={},
    )


def _terms(
    linear: ShakenModel, segments: Sequence[Segment], made: Fit, parts: Sequence[Cut]
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
        terms = exact_terms(
            sizes,
            (values.get('mass', 1.0), values['damping'], sizes.stiffness),
            (channel, segments[mine[0]].unit),
            first.rate,
            max(segments[i].measured.size * segments[i].period for i in mine),
            segments[mine[0]].noise,
            max(float(np.max(np.abs(segments[i].measured))) for i in mine),
            len(mine),
            kind='free' if linear.free else 'driven' if stiffness > 0.0 else 'axis',
            drive=first.drive_channel,
            tag=channel if len(channels) > 1 else '',
            joint=unit == 'rad' and stiffness <= 0.0 and not linear.free,
        )
        found += [t for t in terms if t.output or channel == channels[0]]
    if linear.drifts:  # its motion is far below any filter: the delay is all that shows
        found = [t for t in found if t.name != 'low_pass_filter' or _plain_filter(t)]
    if linear.drifts and all(s.derivative == 0 for s in segments):
        able = {'mass', 'damping', 'offset', 'clearance'}  # what the two masses have beside it
        others = frozenset(t.name for t in found if not t.output) - able
        found += play_terms(x, sizes.position_unit, first.rate, others)
    return tuple(found)


def _plain_filter(term: Term) -> bool:
    return filter_of(term)[0] <= HIGHEST_ORDER and not before_sampling(term)


def taken_over(case: Case, found: Fit) -> tuple[Case, Fit]:
    """A case that knows the effects another search has found, and these as a fit of it."""
    model = case.model
    assert isinstance(model, ShakenModel)  # noqa: S101 - made above
    known = {t.label for t in model.terms}
    further = tuple(t for t in found.terms if t.label not in known)
    model = dataclasses.replace(model, terms=(*model.terms, *further), _last={})
    values = {**case.baseline.values, **found.values}
    seed = fit(model, found.terms, case.segments, values, case.baseline.starts)
    return dataclasses.replace(case, model=model), seed
