"""How a pendulum's weight acts while it swings: a choice of simulations, no missing physics.

Many take it for a constant load, or a linear spring, as it is at the contact. A pendulum that
bounces by several degrees feels the cosine of that, and the sine. A baseline that names the
weight means either.
"""

from __future__ import annotations

from impactscope.discrepancy.impact.fit import Fit, fit
from impactscope.discrepancy.impact.follow import fit_baseline, follows_all, further
from impactscope.discrepancy.impact.model import LARGE_ANGLES, ImpactModel

__all__ = ['weight_matters', 'with_likelier_weight', 'with_other_weight', 'with_weight_of']

_WEIGHTS = ('gravity_load', 'restoring_force')
_SOUND = 1.5  # reduced chi-square of a baseline that lacks nothing large
_SEEN = 4.0  # chi-square of the difference, below which nobody can tell


def weight_matters(found: Fit) -> bool:
    """Whether a fit would be seen to differ with its weight taken the other way."""
    model = found.model
    kinds = {b.recording.kind for b in model.data.blows}
    if 'pendulum' not in kinds or all(e.name not in _WEIGHTS for e in model.effects):
        return False
    moved = with_other_weight(model).residuals(found.x, found.layout) - found.residuals
    return float(moved @ moved) > _SEEN


def with_other_weight(model: ImpactModel) -> ImpactModel:
    """A model with its weight as it is not taken there: as it swings, or as it is at contact."""
    swings = model.constants.get(LARGE_ANGLES, 0.0) > 0.0
    return model.extended(constants={LARGE_ANGLES: 0.0 if swings else 1.0})


def with_likelier_weight(baseline: Fit) -> Fit:
    """A baseline with its weight taken the way that leaves less.

    A weight that acts otherwise bends the numbers of a baseline until the later bounces are met
    somehow. From there no fit may lead back: then the other way has a cold start of its own, and
    is taken if it leaves little. Where much else is missing nobody can tell yet.
    """
    model = with_other_weight(baseline.model)
    near = fit(model, baseline.layout, baseline.x)
    if near.chi_square < baseline.chi_square:
        return near
    if follows_all(baseline):
        return baseline
    other = fit_baseline(model)
    return further(baseline, other) if other.reduced < _SOUND else baseline


def with_weight_of(model: ImpactModel, other: ImpactModel | None) -> ImpactModel:
    """A model with its weight taken as another model takes it; as it is without one."""
    if other is None or LARGE_ANGLES not in other.constants:
        return model
    return model.extended(constants={LARGE_ANGLES: other.constants[LARGE_ANGLES]})
