"""What a shorter window was about to find is fitted again in a longer one."""

import dataclasses

import numpy as np
import pytest

from impactscope.discrepancy.impact.baseline import baseline_model
from impactscope.discrepancy.impact.candidates import candidates
from impactscope.discrepancy.impact.data import prepare
from impactscope.discrepancy.impact.fit import fit
from impactscope.discrepancy.impact.follow import fit_baseline
from impactscope.discrepancy.impact.joint_fits import JointFits
from impactscope.discrepancy.impact.outcome import weigh
from impactscope.physics.twin.assembly import Effect


@pytest.fixture(scope='module')
def windows(make_campaign):
    """A baseline over whole recordings, and friction as the first 0.1 s tell it."""
    campaign = make_campaign(71, [Effect('coulomb_friction', {'force': 0.05})])
    whole = fit_baseline(baseline_model(campaign, prepare(campaign)))
    friction = next(c for c in candidates(whole, ()) if c.label == 'coulomb_friction')
    layout = whole.model.layout(whole.layout.blows, 0.1)
    short = fit(whole.model, layout, whole.x)
    joint = fit(friction.extend(whole.model), layout, np.append(short.x, 0.03))
    return whole, weigh(friction, joint, short, 40)


def test_it_is_weighed_by_what_the_longer_window_tells(windows):
    whole, before = windows
    doubtful = dataclasses.replace(before, p_value=0.01)
    (found,) = JointFits._with_suspected(whole, [], [doubtful], 40)
    assert found.candidate is before.candidate
    assert found.fit.layout.size == whole.layout.size
    assert found.gain > before.gain
    force = found.fit.values['coulomb_friction.force']
    assert abs(force - 0.05) < 4.0 * found.fit.std('coulomb_friction.force')


def test_neither_what_chance_gives_nor_what_was_fitted_is_fitted_again(windows):
    whole, before = windows
    by_chance = dataclasses.replace(before, p_value=0.5)
    assert JointFits._with_suspected(whole, [], [by_chance], 40) == []
    doubtful = dataclasses.replace(before, p_value=0.01)
    assert JointFits._with_suspected(whole, [before], [doubtful], 40) == [before]
