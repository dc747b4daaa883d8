"""What is not linear at one place of a structure of several modes.

A structure of as many modes as stated is linear but for an element somewhere: a stop at its tip,
dry friction between two of its masses. Modes that are fitted freely take a part of that, and each
recording asks for others. Here modes, shapes and elements are fitted together. Where the driven
place is one of the outputs the shapes tell how a force at another output moves the structure
(reciprocity).
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.data.measured_force import known_force
from impactscope.discrepancy.driven.data.recordings import Cut
from impactscope.discrepancy.driven.fits.simulation_error import FINE, Fit, fit
from impactscope.discrepancy.driven.model_selection.model_comparison import Judge, noise_floor
from impactscope.discrepancy.driven.models.candidate_effects import candidate_effects
from impactscope.discrepancy.driven.models.mechanical_effects import Sizes, mechanical_terms
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.structure_model import (
    Place,
    StructureModel,
    coupling,
    damping_ratio,
    direct,
    frequency,
    hidden_shape,
    mobility,
    shape,
)
from impactscope.discrepancy.driven.models.terms import Number, Term
from impactscope.discrepancy.driven.noise.spectral_whitening import whitening
from impactscope.discrepancy.driven.systems.modal import Modes, poles_apart

__all__ = ['LAWS', 'NO_SHAPES', 'Structure', 'linear_structure', 'quiet_structure']

Array = NDArray[np.float64]

NO_SHAPES = 'there are more than four modes, or none that shapes at the outputs describe.'
FINEST_LINES = 16  # of a spectrum of noise, as a power of two
MOST_MODES = 4  # more have too many numbers to be told from what is not linear
LAWS = frozenset(
    {
        'coulomb_friction',
        'asymmetric_friction',
        'stribeck_friction',
        'quadratic_damping',
        'hardening_spring',
        'softening_spring',
        'asymmetric_spring',
        'clearance',
        'end_stop',
        'hysteresis',
    }
)
# shapes of a place that no output shows, over those of the driven place, to start from
HIDDEN = {2: (-3.0, -1.0, -0.3, 0.3, 3.0), 3: (-3.0, -0.5, 1.0)}  # by the number of modes
TRAVELS, STOPS = (0.9, 0.7, 0.45), (0.1, 1.0)  # of the largest motion, of the stiffness: starts
SLIPS = (0.03, 0.2, 1.0)  # of the largest motion, where a yielding spring slips
NEAR, FAR = 1.15, 10.0  # factors within which a frequency stays
MOBILITIES = (1e-3, 1e3)  # of a further mode over that of the first
AS_WELL = 1.05  # of the power that freely fitted modes leave


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """A structure as a model with elements to look for.

    ``segments``: with their noise, where the linear fit tells it. ``linear``: the fit without
    elements, to all recordings. ``begun``: where a search sets out.
    """

    model: StructureModel
    segments: Sequence[Segment]
    linear: Fit
    begun: Fit
    judge: Judge


def linear_structure(
    parts: Sequence[Cut], segments: Sequence[Segment], modes: Modes, *, exact: bool, bent: bool
) -> Structure | None:
    """The structure of the stated modes by shapes at its outputs; None where it is none.

    None as well where it has too many modes, or modes without any shape fit clearly better.

    Args:
        parts: the recordings, in the order of the segments.
        segments: of all recordings.
        modes: what was fitted without shapes.
        exact: whether the input is commanded, and has no noise.
        bent: whether more is missing than leaves noise to be read.
    """
    stated, poles = modes.stated, modes.poles
    if stated is None or poles is None or poles.size // 2 > MOST_MODES:
        return None
    poles = poles.reshape(-1, 2)[np.argsort(poles[::2])]
    model, made = _linear(poles, segments)
    if _power(made, segments) > AS_WELL * _power(stated, segments):
        return None
    if not bent:
        segments = _with_noise(model, made, parts, segments, exact=exact)
        made = fit(model, (), segments, made.values, tolerance=FINE)
    return _with_elements(model, made, made, parts, segments)


def _with_noise(
    model: StructureModel,
    made: Fit,
    parts: Sequence[Cut],
    segments: Sequence[Segment],
    *,
    exact: bool,
) -> list[Segment]:
    """Segments whose noise is known: white, and what the noise of a measured input moves.

    A structure answers that at its resonances, and no model leaves white residuals there.
    """
    least = min(
        made.values[damping_ratio(k)] * made.values[frequency(k)] for k in range(model.modes)
    )
    found = []
    for part, segment, left in zip(parts, segments, made.residuals, strict=True):
        noise = noise_floor(segment, left) or 1.0
        level = math.nan if exact or part.drive is None else known_force(part.drive).noise
        lines = 1
        if math.isfinite(level):
            width = 0.5 / segment.period / max(least, 0.1 / (segment.period * left.size))
            lines = 1 << min(max(math.ceil(math.log2(4.0 * width)), 6), FINEST_LINES)
        place = np.linspace(0.0, 0.5 / segment.period, lines + 1)
        power = np.full(lines + 1, noise**2)
        if math.isfinite(level):
            answer = model.answer(made.values, segment.channel, segment.derivative, place)
            power += level * np.abs(answer) ** 2
        whitener = whitening(power)
        found.append(dataclasses.replace(segment, noise=noise, whitener=whitener))
    return found


def quiet_structure(parts: Sequence[Cut], segments: Sequence[Segment], modes: int) -> Structure:
    """The structure as the quietest recording shows it, with modes that stand apart.

    There a strong element bends it least.
    """
    fitted = [i for i, s in enumerate(segments) if not s.held_out]
    least = min(fitted, key=lambda i: float(np.std(segments[i].drive[:, 0])))
    mine = [i for i in fitted if segments[i].recording == segments[least].recording]
    of_it = [segments[i] for i in mine]
    poles = poles_apart([parts[i] for i in mine], of_it, modes).reshape(-1, 2)
    model, quiet = _linear(poles[np.argsort(poles[:, 0])], of_it, NEAR)
    none = np.zeros(0)
    left = tuple(s.measured - model.predict(quiet.values, (), none, s) for s in segments)
    quiet = dataclasses.replace(quiet, residuals=left, starts=tuple(none for _ in segments))
    linear = fit(model, (), segments, quiet.values, tolerance=FINE)
    return _with_elements(model, linear, quiet, parts, segments)


def _with_elements(
    model: StructureModel,
    linear: Fit,
    begun: Fit,
    parts: Sequence[Cut],
    segments: Sequence[Segment],
) -> Structure:
    elements = list(_terms(model, begun, segments, parts[0].drive_unit))
    terms = tuple(term for term, _ in elements)
    places = {term.variant: place for term, place in elements}
    whole = dataclasses.replace(model, terms=terms, places=places, _last={})
    return Structure(whole, segments, linear, begun, Judge(segments, len(terms)))


def _linear(
    poles: Array, segments: Sequence[Segment], near: float = FAR
) -> tuple[StructureModel, Fit]:
    """The linear structure that fits best, whichever output is at its driven place, if any is.

    ``near``: factor within which its frequencies stay.
    """
    residues = _residues(poles, segments)
    found = []
    for driven in [c for c in residues if np.all(residues[c][:-1] > 0.0)] or ['']:
        model = _model(poles, residues, driven, segments, near)
        found.append((model, fit(model, (), segments, {}, tolerance=FINE)))
    made, best = min(found, key=lambda pair: _power(pair[1], segments))
    return _model(poles, residues, made.driven, segments), best


def _power(made: Fit, segments: Sequence[Segment]) -> float:
    """Power of the residuals of fitted recordings over that of their channels, the mean."""
    pairs = zip(made.residuals, segments, strict=True)
    return float(
        np.mean(
            [np.mean(r**2) / (np.mean(s.measured**2) or 1.0) for r, s in pairs if not s.held_out]
        )
    )


def _residues(poles: Array, segments: Sequence[Segment]) -> dict[str, Array]:
    """Weights of the modes, of modal mass one, and of the input in each output, (k + 1,)."""
    k = poles.shape[0]
    channels = dict.fromkeys(s.channel for s in segments)
    bare = _model(poles, dict.fromkeys(channels, np.ones(k + 1)), '', segments)
    values = {n.name: n.starts[0] for n in bare.numbers}
    found = {}
    for channel in channels:
        columns, measured = [], []
        for s in segments:
            if s.channel == channel and not s.held_out:
                moved, given = bare.modal_motion(values, (), s)
                mine = moved[:, s.derivative * k : (s.derivative + 1) * k]
                columns.append(np.column_stack([mine, given]))
                measured.append(s.measured)
        a, b = np.concatenate(columns), np.concatenate(measured)
        size = np.linalg.norm(a, axis=0)
        size[size == 0.0] = 1.0
        found[channel] = np.linalg.lstsq(a / size, b, rcond=1e-9)[0] / size
    return found


def _model(
    poles: Array,
    residues: Mapping[str, Array],
    driven: str,
    segments: Sequence[Segment],
    near: float = FAR,
) -> StructureModel:
    """The linear structure with numbers to set out from."""
    k, channels = poles.shape[0], tuple(residues)
    # weights of the driven place are squares of its shapes
    root = np.sqrt(residues[driven][:-1]) if driven else np.ones(k)
    numbers = []
    for mode, (omega, ratio) in enumerate(np.exp(poles)):
        hertz = omega / (2.0 * math.pi)
        numbers.append(
            Number(frequency(mode), 'Hz', (hertz,), 0.01 * hertz, hertz / near, hertz * near)
        )
        numbers.append(Number(damping_ratio(mode), '1', (ratio,), 0.1 * ratio, 0.0, 2.0))
    for one, other in itertools.combinations(range(k), 2):
        omegas = np.exp(poles[[one, other], 0])
        size = 2.0 * math.sqrt(float(np.prod(np.exp(poles[[one, other], 1]) * omegas)))
        numbers.append(Number(coupling(one, other), '1/s', (0.0,), 0.1 * size))
    for channel in channels:
        shapes = residues[channel][:-1] / root
        largest = float(np.max(np.abs(shapes)))
        unit = next(s.unit for s in segments if s.channel == channel)
        for mode in range(k):
            start = float(shapes[mode])
            numbers.append(Number(shape(mode, channel), '', (start,), 0.01 * largest))
        start = float(residues[channel][-1])
        spread = max(float(np.max(np.abs(s.measured))) for s in segments if s.channel == channel)
        drive = max(float(np.max(np.abs(s.drive))) for s in segments)
        scale = 1e-3 * spread / drive if drive > 0.0 else 1.0
        numbers.append(Number(direct(channel), unit, (start,), scale))
    return StructureModel(tuple(numbers), (), channels, driven, k, {})


def _places(
    model: StructureModel, units: Mapping[str, str]
) -> Iterator[tuple[str, Place, dict[str, float]]]:
    """Every output against the ground, every two against each other, and where no output is.

    Each with a name, and with values of an element's own numbers to set out from. ``units``: of
    the outputs' positions.
    """
    further = range(1, model.modes)
    own = {} if model.driven else {mobility(k): 1.0 for k in further}
    for i, channel in enumerate(model.channels):
        yield f'at_{i + 1}', Place(f'at {channel}', channel), own
    for (i, one), (j, other) in itertools.combinations(enumerate(model.channels), 2):
        if units[one] != units[other]:
            continue
        yield f'between_{i + 1}_{j + 1}', Place(f'between {one} and {other}', one, other), own
    if len(model.channels) >= model.modes or model.modes not in HIDDEN:
        return
    hidden = Place('at a place that no output shows')
    for i, ratios in enumerate(itertools.product(HIDDEN[model.modes], repeat=model.modes - 1)):
        shapes = {hidden_shape(k): r for k, r in zip(further, ratios, strict=True)}
        yield f'hidden_{i + 1}', hidden, {**own, **shapes}


def _terms(
    model: StructureModel, made: Fit, segments: Sequence[Segment], drive_unit: str
) -> Iterator[tuple[Term, Place]]:
    """Laws at every place, with values to set out from by how far that moves."""
    units = {s.channel: s.unit.split('/', 1)[0] for s in segments}
    shapes = model.shapes(made.values)
    stiffness, _ = model.matrices(made.values)
    fitted = [s for s in segments if not s.held_out]
    for name, place, own in _places(model, units):
        row = place.row(model.drive(shapes), shapes, own)
        moved = [model.at(row, made.values, (), s) for s in fitted]
        x = max(float(np.max(np.abs(z))) for z, _ in moved)
        v = max(float(np.quantile(np.abs(v), 0.99)) for _, v in moved)
        if x == 0.0:
            continue
        k = 1.0 / float(np.sum(row**2 / stiffness))
        numbers = [Number(n, '1', (v,), 0.1 * abs(v), *_within(n)) for n, v in own.items()]
        unit = units[place.channel or model.channels[0]]
        for term in _laws(Sizes(x, v, k * x, k, drive_unit, unit)):
            with_own = dataclasses.replace(term, numbers=(*term.numbers, *numbers))
            yield from _at(with_own, name, place)


def _within(name: str) -> tuple[float, float]:
    """Bounds of an element's own number: a mass is more than nothing."""
    return MOBILITIES if name.startswith('mobility') else (-math.inf, math.inf)


def _laws(sizes: Sizes) -> Iterator[Term]:
    """Laws of an element whose place moves so far."""
    k, x = sizes.stiffness, sizes.position
    plain = mechanical_terms(sizes, spring=True, driven=True, angle=False)
    found = candidate_effects(sizes, (1.0, 0.0, k), ('', ''), 1.0, 1.0, 1.0, 1.0)
    for term in (*found, *(t for t in plain if t.name == 'asymmetric_spring')):
        if term.name not in LAWS or term.output:
            continue
        if term.name == 'end_stop':
            starts = {
                'travel': tuple(s * x for s in TRAVELS),
                'stiffness': tuple(s * k for s in STOPS),
            }
            numbers = (dataclasses.replace(n, starts=starts[n.name]) for n in term.numbers)
            yield dataclasses.replace(term, numbers=tuple(numbers))
        elif term.name in {'hysteresis', 'clearance'}:
            yield _with_stiffness(term, sizes)
        else:
            yield term


def _with_stiffness(term: Term, sizes: Sizes) -> Term:
    """Play, or a yielding spring, with a stiffness of its own beside the structure's."""
    k, x, unit = sizes.stiffness, sizes.position, f'{sizes.force_unit}/{sizes.position_unit}'
    own = Number('stiffness', unit, (0.03 * k, 0.5 * k), 0.1 * k, 0.0)
    if term.name == 'clearance':
        return dataclasses.replace(term, numbers=(*term.numbers, own))
    slip = next(n for n in term.numbers if n.name == 'yield_displacement')
    slip = dataclasses.replace(slip, starts=tuple(x * s for s in SLIPS))
    return dataclasses.replace(
        term,
        numbers=(own, slip),
        amounts=('stiffness',),
        equation="s h with h' = v (1 - [v h > 0] |h| / x_y)",
    )


def _at(term: Term, name: str, place: Place) -> Iterator[tuple[Term, Place]]:
    """A law at a place; what is there on one side may be there on the other."""
    sentence = f'{term.sentence.removesuffix(".")}, {place.words}.'
    term = dataclasses.replace(term, sentence=sentence)
    if term.variant == 'one-way':
        yield dataclasses.replace(term, variant=f'{name}_above'), place
        other = dataclasses.replace(place, reversed=True)
        yield dataclasses.replace(term, variant=f'{name}_below'), other
    else:
        yield dataclasses.replace(term, variant=name), place
