"""What the names of a baseline leave open: choices of simulations, no missing physics.

A pendulum's weight: many take it for a constant load, or a linear spring, as it is at the contact.
A pendulum that bounces by several degrees feels the cosine of that, and the sine.

The loss of a bare contact: Hunt and Crossley's constant belongs to the material, so that the
restitution falls with the speed. Others take it from the speed of the blow, or of each contact,
so that the restitution is a number of its own.

A baseline that names the weight or the contact means any of these. The one that leaves least is
taken, first for the baseline and again where something was found.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping

from impactscope.discrepancy.impact.fits.growing_windows import (
    begun,
    fit_baseline,
    follow,
    followed,
    follows_all,
    further,
)
from impactscope.discrepancy.impact.fits.least_squares import Fit, fit
from impactscope.discrepancy.impact.models.bench_model import ImpactModel
from impactscope.discrepancy.impact.models.bench_parameters import LARGE_ANGLES, LOSS_OF
from impactscope.discrepancy.impact.search.outcome import QUIET
from impactscope.discrepancy.processes import in_processes
from impactscope.discrepancy.time_limit import time_left
from impactscope.errors import ImpactscopeError
from impactscope.physics.twin.bench import LOSSES

__all__ = ['conventions_told', 'other_conventions', 'with_conventions_of', 'with_likelier']

_WEIGHTS = ('gravity_load', 'restoring_force')
_SOUND = 1.5  # reduced chi-square of a baseline that lacks nothing large
_FIRST_BOUNCES = (0.25, 0.1)  # s after the onset
_TELLING = 25.0  # chi-square of these, from which they tell which choice is meant
_SEEN = 4.0  # chi-square of the difference, below which nobody can tell
_TOLD = {
    'blow': 'goes by the speed of each blow',
    'contact': 'goes by the speed of each contact',
}


def other_conventions(found: Fit) -> list[ImpactModel]:
    """A fit's model with what its names leave open taken otherwise, one choice at a time.

    Only choices that would be seen to differ, be it where the fit does not follow any more.
    """
    model = found.model
    constants = model.constants
    choices: list[dict[str, float]] = []
    kinds = {model.data.blows[i].recording.kind for i in found.layout.blows}
    if 'pendulum' in kinds and any(e.name in _WEIGHTS for e in model.effects):
        choices.append({LARGE_ANGLES: 0.0 if constants.get(LARGE_ANGLES, 0.0) > 0.0 else 1.0})
    if 'contact.stiffness' in found.values and kinds != {'tap'}:
        taken = constants.get(LOSS_OF, 0.0)
        choices += [{LOSS_OF: float(i)} for i in range(len(LOSSES)) if i != taken]
    others = [model.extended(constants=choice) for choice in choices]
    return [other for other in others if _differs(found, other)]


def _differs(found: Fit, other: ImpactModel) -> bool:
    whole = found.model.layout(found.layout.blows)
    try:
        moved = other.residuals(found.x, whole) - found.model.residuals(found.x, whole)
    except ImpactscopeError:
        return True
    return float(moved @ moved) > _SEEN


def with_likelier(baseline: Fit) -> Fit:
    """A baseline with what its names leave open taken in the way that leaves least.

    A choice that is not the recordings' bends the numbers of a baseline until the later bounces
    are met somehow. From there no fit may lead back: then the others have a cold start of their
    own, and are taken if they leave little. Where much else is missing nobody can tell yet; and
    one that leaves more of the first milliseconds than the baseline leaves of all is not followed.
    """
    others = other_conventions(baseline)
    best = baseline
    most = baseline.chi_square
    for near in in_processes(
        lambda model: fit(model, baseline.layout, baseline.x, most=most), others
    ):
        # steep contacts that are not met at all are met no better by chance
        told = near.reduced < _SOUND or _same_contact(near.model, baseline.model)
        if told and near.chi_square < best.chi_square:
            best = near
    if follows_all(best):
        return best
    most = max(_SOUND, best.reduced)
    begins = in_processes(_begun_or_none, others)
    known = [short for short in begins if short is not None]
    for other in in_processes(lambda short: _followed(short, most), known):
        if other.reduced < _SOUND:
            best = further(best, other)
    if best.reduced < QUIET:
        return best
    return _by_first_bounces(best, {_choices(short.model): short for short in known})


def _by_first_bounces(best: Fit, known: Mapping[tuple[float, ...], Fit]) -> Fit:
    """A baseline with what its names leave open as the first bounces have it.

    Where late ones amplify something that is missing, either choice may be bent to meet them.
    ``known``: fits to the first milliseconds, by their choices.
    """
    models = [best.model, *other_conventions(best)]
    if len(models) < 2 or not time_left('conventions by the first bounces'):
        return best
    short = in_processes(lambda m: known.get(_choices(m)) or _begun_or_none(m), models)
    for window in _FIRST_BOUNCES:
        grown = in_processes(functools.partial(_follow, window=window), short)
        sound = [g for g in grown if g is not None and g.layout.window >= window]
        sound.sort(key=lambda g: g.reduced)
        if not sound or sound[0].reduced > QUIET:
            continue
        first = sound[0]
        mine = grown[0]
        behind = math.inf if mine is None else (mine.reduced - first.reduced) * first.layout.size
        if first is mine or behind < _TELLING:
            return best
        return followed(first, window)[0]
    return best


def _begun_or_none(model: ImpactModel) -> Fit | None:
    try:
        return begun(model)
    except ImpactscopeError:
        return None


def _follow(short: Fit | None, window: float) -> Fit | None:
    return None if short is None else follow(short, window)


def _choices(model: ImpactModel) -> tuple[float, ...]:
    return tuple(model.constants.get(key, 0.0) for key in (LARGE_ANGLES, LOSS_OF))


def _followed(short: Fit, most: float) -> Fit:
    """A baseline from its first milliseconds on; these alone where they leave too much."""
    return short if short.reduced > most else fit_baseline(short.model, short)


def _same_contact(model: ImpactModel, other: ImpactModel) -> bool:
    return model.constants.get(LOSS_OF, 0.0) == other.constants.get(LOSS_OF, 0.0)


def with_conventions_of(model: ImpactModel, other: ImpactModel | None) -> ImpactModel:
    """A model with what its names leave open taken as in another; as it is without one."""
    if other is None:
        return model
    known = {k: other.constants[k] for k in (LARGE_ANGLES, LOSS_OF) if k in other.constants}
    return model.extended(constants=known)


def conventions_told(model: ImpactModel) -> list[str]:
    """What was taken otherwise than the names say first, a sentence each."""
    told = []
    if model.constants.get(LARGE_ANGLES, 0.0) > 0.0:
        told.append('The weight is taken with the swing: cosine and sine of its angle.')
    loss = LOSSES[round(model.constants.get(LOSS_OF, 0.0))]
    if loss in _TOLD:
        told.append(
            f'The loss of the contact {_TOLD[loss]}, so that its restitution does not fall with '
            'the speed.'
        )
    return told
