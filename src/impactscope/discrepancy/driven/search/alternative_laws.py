"""Alternatives to what was found that the search does not reach one effect at a time.

Laws that are written in two ways, or that look alike as long as one effect is added at a time.
"""

from __future__ import annotations

import itertools
import math

from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.model_comparison import Judge
from impactscope.discrepancy.driven.models.candidate_effects import FRICTION
from impactscope.discrepancy.driven.models.terms import Term, key
from impactscope.discrepancy.driven.search.joint_fits import Fits, labels_of

__all__ = [
    'base_in_place_of_play',
    'friction_of_baseline',
    'other_asymmetry',
    'other_friction',
    'other_levels',
    'other_zero',
    'peak_at_rest',
    'plain_friction',
    'spring_beside_stop',
    'spring_of_position',
    'uneven_friction',
    'weight_in_place_of_cube',
]

RELATIVES = ('stribeck_friction', 'asymmetric_friction')
SLOW = ('offset', 'zero_drift', 'ac_coupling')
SLIDING = ('force', 'force_forward', 'force_backward', 'kinetic_force')
UNEVEN = (1.3, 0.7)  # shares of a plain friction, from which one by direction sets out
PEAK = (0.9, 0.2)  # shares of a plain friction: while sliding, and what is added at rest
AS_GOOD = 4.0  # of the criterion, within which two laws are one


def base_in_place_of_play(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A fixture that gives way against a play whose two masses never part.

    Relative to a base an axis swings as the driven one of two masses on one spring does; the
    latter has a gap, too, and is found from farther away.
    """
    play = next((t for t in best.terms if t.label == 'clearance/drive'), None)
    base = next((t for t in fits.model.terms if t.name == 'base_compliance'), None)
    if play is None or base is None:
        return best
    told = {n.name: best.values[key(play, n)] for n in play.numbers}
    share = told['load_share']
    values = {
        'frequency': told['contact_frequency'],
        'mass': best.values['mass'] * (1.0 - share) / share,
        'damping_ratio': told['contact_damping_ratio'],
    }
    rest = tuple(t for t in best.terms if t is not play)
    if not all(base.stands_with(t) for t in rest):
        return best
    initial = {
        key(base, n): min(max(values[n.name], n.lower), n.upper)
        for n in base.numbers
        if n.name in values
    }
    made = fits.once_more(best, (*rest, base), initial)
    ahead = judge.criterion(made, fits.baseline) < judge.criterion(best, fits.baseline)
    return made if ahead else best


def spring_beside_stop(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A stop of an axis against a stop beside a spring that the axis is said not to have.

    Alone it begins half-way, so as to be a spring as well, and what it misses looks like a load
    or a friction; beside a spring it begins where it is.
    """
    stop = next((t for t in best.terms if t.name == 'end_stop'), None)
    spring = next((t for t in fits.model.terms if t.label == 'restoring_force'), None)
    if stop is None or spring is None or not fits.model.drifts:
        return best
    if spring.label in labels_of(best.terms):
        return best
    rest = tuple(t for t in best.terms if t is not stop and spring.stands_with(t))
    given = tuple(t for t in rest if t.label in labels_of(fits.baseline.terms))
    start = {key(spring, n): n.starts[0] for n in spring.numbers}
    for others in dict.fromkeys((rest, given)):
        beside = fits.make(best, (*others, spring), start)
        for term in fits.model.terms:
            if term.name == stop.name and all(term.stands_with(t) for t in beside.terms):
                fits.from_each_shape(beside, term)
    return _best(fits, judge)


def weight_in_place_of_cube(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A hanging weight against a spring that gets softer with the cube of the angle.

    The cube comes near its sine, and what is left of it looks like a further effect; once one of
    them is found no single effect leads to the other.
    """
    cube = next((t for t in best.terms if t.name == 'softening_spring'), None)
    weight = next((t for t in fits.model.terms if t.label == 'restoring_force'), None)
    if cube is None or weight is None or weight.numbers:  # of an axis it is a spring
        return best
    rest = tuple(t for t in best.terms if t is not cube)
    if not all(weight.stands_with(t) for t in rest):
        return best
    made = fits.once_more(best, (*rest, weight), {})
    ahead = judge.criterion(made, fits.baseline) < judge.criterion(best, fits.baseline)
    return made if ahead else best


def plain_friction(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A friction of several numbers against the one of the same force both ways.

    A search that goes on from a seed may never have tried it; one that met it before what it
    stands beside was known, as a play, may have left it where no slope leads on.
    """
    plain = next((t for t in fits.model.terms if t.label == 'coulomb_friction'), None)
    old = next((t for t in best.terms if t.name in FRICTION and len(t.numbers) > 1), None)
    if plain is None or old is None:
        return best
    size = _plain_size(best, old)
    if size is None:
        return best
    rest = tuple(t for t in best.terms if t is not old)
    initial = {key(plain, plain.numbers[0]): size}
    made = fits.once_more(best, (*rest, plain), initial)
    return best if judge.fuller(made, best) else made


def peak_at_rest(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A friction that was found against one with a peak at rest, in its place.

    How the peak falls off with the speed has minima of its own: a fit sets out from each of its
    starts, from the size that is known.
    """
    old = next((t for t in best.terms if t.name in FRICTION), None)
    peak = next((t for t in fits.model.terms if t.name == 'stribeck_friction'), None)
    if old is None or peak is None or old in fits.baseline.terms:
        return best
    rest = tuple(t for t in best.terms if t is not old)
    size = _plain_size(best, old)
    if size is None or not all(peak.stands_with(t) for t in rest):
        return best
    sizes = {'kinetic_force': PEAK[0] * size, 'excess_force': PEAK[1] * size}
    initial = {key(peak, n): sizes.get(n.name, n.starts[0]) for n in peak.numbers}
    speed = next(n for n in peak.numbers if n.name == 'speed')
    for start in speed.starts:
        fits.once_more(best, (*rest, peak), {**initial, key(peak, speed): start})
    return _best(fits, judge)


def other_friction(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A friction that differs by direction against one with a peak at rest and an offset.

    The first of these is what the second looks like as long as one effect at a time is added.
    """
    old = next((t for t in best.terms if t.name == 'asymmetric_friction'), None)
    offset = next((t for t in fits.model.terms if t.name == 'offset'), None)
    if old is None or offset is None:
        return best
    forces = [best.values[key(old, n)] for n in old.numbers if n.name.startswith('force')]
    mean = sum(forces) / len(forces)
    rest = tuple(t for t in best.terms if t is not old)
    for term in fits.model.terms:
        if term.name != 'stribeck_friction' or not all(term.stands_with(t) for t in rest):
            continue
        terms = (*rest, offset, term)
        sizes = {'kinetic_force': 0.8 * mean, 'excess_force': 0.4 * mean}
        initial = {key(term, n): sizes.get(n.name, n.starts[0]) for n in term.numbers}
        initial[key(offset, offset.numbers[0])] = 0.5 * (forces[0] - forces[-1])
        speed = next(n for n in term.numbers if n.name == 'speed')
        later = {**initial, key(term, speed): speed.starts[len(speed.starts) // 2]}
        fits.make(best, terms, initial, later)
    return _best(fits, judge)


def friction_of_baseline(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A plain friction that the baseline has against its relatives, which stand in its place.

    They cannot be found beside it.
    """
    old = next((t for t in fits.baseline.terms if t.name == 'coulomb_friction'), None)
    if old is None:
        return best
    known = {n.name: fits.baseline.values[key(old, n)] for n in old.numbers}
    size = known.pop('force')
    known |= {'force_forward': size, 'force_backward': size}
    known |= {'kinetic_force': PEAK[0] * size, 'excess_force': PEAK[1] * size}
    for base in (fits.baseline, best):
        rest = tuple(t for t in base.terms if t is not old)
        for term in fits.model.terms:
            if term.name not in RELATIVES or not all(term.stands_with(t) for t in rest):
                continue
            first = {key(term, n): known.get(n.name, n.starts[0]) for n in term.numbers}
            last = {key(term, n): known.get(n.name, n.starts[-1]) for n in term.numbers}
            fits.make(base, (*rest, term), first, last)
    return _best(fits, judge)


def uneven_friction(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A plain friction that was found against one that differs by direction, in its place.

    A search that goes on from a plain one never tries it beside that. A load that stays is the
    rest of the same law; what a channel makes of it goes with it.
    """
    old = next((t for t in best.terms if t.label == 'coulomb_friction'), None)
    uneven = next((t for t in fits.model.terms if t.name == 'asymmetric_friction'), None)
    if old is None or uneven is None or old in fits.baseline.terms:
        return best
    load = next((t for t in best.terms if t.name == 'offset' and not t.output), None)
    size = best.values[key(old, old.numbers[0])]
    pull = 0.0 if load is None else best.values[key(load, load.numbers[0])]
    rest = tuple(t for t in best.terms if t not in (old, load))
    least = 0.01 * size
    ways = [n for n in uneven.numbers if n.name.startswith('force')]
    shares = [(size * f, size * b) for f, b in (UNEVEN, UNEVEN[::-1])]
    if load is not None:
        shares = [(max(size - pull, least), max(size + pull, least)), shares[0]]
    first, last = (
        {key(uneven, n): value for n, value in zip(ways, values, strict=True)} for values in shares
    )
    quick = tuple(t for t in rest if not (t.output and t.name in SLOW))
    for others in (rest,) if quick == rest else (rest, quick):
        if all(uneven.stands_with(t) for t in others):
            fits.make(best, (*others, uneven), first, last)
    return _best(fits, judge)


def other_asymmetry(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A friction that differs by direction against an even one and a load that stays."""
    old = next((t for t in best.terms if t.name == 'asymmetric_friction'), None)
    even = next((t for t in fits.model.terms if t.label == 'coulomb_friction'), None)
    if old is None or even is None:
        return best
    forces = [best.values[key(old, n)] for n in old.numbers if n.name.startswith('force')]
    mean, load = sum(forces) / len(forces), 0.5 * (forces[-1] - forces[0])
    rest = tuple(t for t in best.terms if t is not old)
    stiffness = best.values.get('stiffness', 1.0)
    for offset in fits.model.terms:
        if offset.name == 'offset' and all(offset.stands_with(t) for t in (*rest, even)):
            size = load / stiffness if offset.output else load
            initial = {key(even, even.numbers[0]): mean, key(offset, offset.numbers[0]): size}
            fits.make(best, (*rest, even, offset), initial)
    return _best(fits, judge)


def other_levels(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """Offset, drift and coupling of a channel against each other, alone and two at a time.

    What a coupling still holds from before a recording looks like any of them, and beside it an
    offset like a drift.
    """
    old = [t for t in best.terms if t.output and t.name in SLOW]
    if not old or old == [t for t in old if t.name != 'ac_coupling'][:1]:
        return best
    rest = tuple(t for t in best.terms if t not in old)
    corner = next(
        (best.values[key(t, n)] for t in old for n in t.numbers if n.name == 'corner'), 0.0
    )
    slow = [
        t for t in fits.model.terms if t.output and t.name in SLOW and t.channel == old[0].channel
    ]
    for count in (1, 2):
        for chosen in itertools.combinations(slow, count):
            together = (*rest, *chosen)
            if not all(a.stands_with(b) for a, b in itertools.combinations(together, 2)):
                continue
            starts = {
                key(t, n): corner if n.name == 'corner' and corner > 0.0 else n.starts[0]
                for t in chosen
                if t not in old
                for n in t.numbers
            }
            fits.make(best, together, starts)
    return _best(fits, judge)


def other_zero(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A channel with another zero in the place of a load and a spring that is uneven about it.

    A spring whose stiffness goes evenly with the displacement does so about the place where it is
    at rest; counted from elsewhere it is under a load, and softer to one side.
    """
    load = next((t for t in best.terms if t.name == 'offset' and not t.output), None)
    uneven = next((t for t in best.terms if t.name == 'asymmetric_spring'), None)
    stiffness = best.values.get('stiffness', 0.0)
    if load is None or uneven is None or not stiffness > 0.0:
        return best
    rest = tuple(t for t in best.terms if t not in (load, uneven))
    size = best.values[key(load, load.numbers[0])] / stiffness
    for zero in fits.model.terms:
        if zero.name == 'offset' and zero.output and all(zero.stands_with(t) for t in rest):
            fits.make(best, (*rest, zero), {key(zero, zero.numbers[0]): size})
    return _best(fits, judge)


def spring_of_position(fits: Fits, best: Fit, judge: Judge) -> Fit:
    """A weak spring in the place of a coupling of a position that fades within no recording.

    Of a mass with a damper they are one law, and what reads positions is not coupled. Whichever
    the search has found, both are held against each other.
    """
    position = fits.model.drifts and all(s.unit in ('m', 'rad') for s in fits.segments)
    coupling = next((t for t in fits.model.terms if t.label == 'ac_coupling/output'), None)
    spring = next((t for t in fits.model.terms if t.label == 'restoring_force'), None)
    if coupling is None or spring is None or not position:
        return best
    turn = 2.0 * math.pi * best.values['damping']  # stiffness over corner
    fades = 2.0 * math.pi * max(s.measured.size * s.period for s in fits.segments)
    corner, stiffness = (key(t, t.numbers[0]) for t in (coupling, spring))
    found = labels_of(best.terms)
    if spring.label in found and abs(best.values[stiffness]) * fades <= turn:
        _instead(fits, best, spring, coupling, best.values[stiffness] / turn)
    if coupling.label not in found or best.values[corner] * fades > 1.0:
        return best
    made = _instead(fits, best, coupling, spring, turn * best.values[corner])
    if made is None:
        return best
    worse = judge.criterion(made, fits.baseline) - judge.criterion(best, fits.baseline)
    return made if worse < AS_GOOD else best


def _instead(fits: Fits, best: Fit, old: Term, new: Term, number: float) -> Fit | None:
    """A fit with another term, of one number, in the place of an old one; None if it cannot be."""
    rest = tuple(t for t in best.terms if t.label != old.label)
    if not all(new.stands_with(t) for t in rest):
        return None
    return fits.polish(fits.once_more(best, (*rest, new), {key(new, new.numbers[0]): number}))


def _plain_size(made: Fit, friction: Term) -> float | None:
    """The force of a plain friction about as strong; None where a friction has no force."""
    told = {n.name: made.values[key(friction, n)] for n in friction.numbers}
    sliding = [told[name] for name in SLIDING if name in told]
    if not sliding:
        return None
    return sum(sliding) / len(sliding) + 0.5 * told.get('excess_force', 0.0)


def _best(fits: Fits, judge: Judge) -> Fit:
    return min(fits.known.values(), key=lambda f: judge.criterion(f, fits.baseline))
