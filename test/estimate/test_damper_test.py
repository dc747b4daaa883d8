import math

import numpy as np
import pytest

from impactscope.errors import InputError
from impactscope.estimate.damper_test import (
    LayerTest,
    analyse_cycles,
    layer_information,
    rank_further_tests,
)
from impactscope.physics.damper_layer import (
    PAPER_LAYER_RATE,
    PAPER_LAYER_SH10,
    DamperLayer,
    MaxwellBranch,
    cyclic_ramp,
)

PEAKS = (0.8e-3, 1.6e-3, 2.4e-3, 3.2e-3, 4.0e-3)
TIME, RAMPS = cyclic_ramp(PEAKS, PAPER_LAYER_RATE, 10.0)
FORCE = PAPER_LAYER_SH10.response(TIME, RAMPS, unilateral=True).force
EXACT = {'force_uncertainty': 0.0, 'displacement_uncertainty': 0.0}


def test_exact_record_gives_the_papers_constants():
    found = analyse_cycles(TIME, RAMPS, FORCE)
    assert found.valid
    assert found.equilibrium_stiffness.value == pytest.approx(38.32e3, rel=1e-5)
    assert found.branches[0].stiffness.value == pytest.approx(18.84e3, rel=1e-4)
    assert found.branches[0].viscosity.value == pytest.approx(77.9e3, rel=1e-4)
    assert found.speed == pytest.approx(PAPER_LAYER_RATE, rel=1e-3)
    assert len(found.cycle_rmse) == 5


def test_uncertainties_are_calibrated():
    rng = np.random.default_rng(1)
    scores = []
    for _ in range(120):
        found = analyse_cycles(TIME, RAMPS, FORCE + rng.normal(0, 0.857, TIME.size), **EXACT)
        branch = found.branches[0]
        scores.append(
            [
                (estimate.value - truth) / estimate.std
                for estimate, truth in (
                    (found.equilibrium_stiffness, 38.32e3),
                    (branch.stiffness, 18.84e3),
                    (branch.viscosity, 77.9e3),
                    (branch.relaxation_time, 77.9 / 18.84),
                )
            ]
        )
    scores = np.array(scores)
    assert (np.mean(np.abs(scores) < 1.96, axis=0) > 0.9).all()
    assert ((scores.std(axis=0) > 0.8) & (scores.std(axis=0) < 1.25)).all()
    assert (np.abs(scores.mean(axis=0)) < 0.3).all()


def test_gains_widen_stiffness_but_not_relaxation():
    rng = np.random.default_rng(2)
    noisy = FORCE + rng.normal(0, 0.857, TIME.size)
    sharp, wide = analyse_cycles(TIME, RAMPS, noisy, **EXACT), analyse_cycles(TIME, RAMPS, noisy)
    gain = math.hypot(0.005, 0.005)
    k = sharp.equilibrium_stiffness
    assert wide.equilibrium_stiffness.std == pytest.approx(math.hypot(k.std, gain * k.value))
    assert wide.branches[0].relaxation_time == sharp.branches[0].relaxation_time


def test_one_slow_rate_comes_with_a_warning():
    warning = analyse_cycles(TIME, RAMPS, FORCE).warning
    assert '10 mm/min' in warning
    assert '57.2 N/mm' in warning
    t = np.arange(0, 1, 1e-3)
    quick = DamperLayer(30e3, (MaxwellBranch(20e3, 20e3 * 0.01),))
    u = 1e-3 * (1 - np.cos(2 * np.pi * 10 * t))
    force = quick.response(t, u, unilateral=True).force
    assert analyse_cycles(t, u, force).warning == ''


def test_two_branches_are_told_when_the_data_hold_them():
    layer = DamperLayer(30e3, (MaxwellBranch(15e3, 15e3 * 1.0), MaxwellBranch(20e3, 20e3 * 30.0)))
    force = layer.response(TIME, RAMPS, unilateral=True).force
    noisy = force + np.random.default_rng(3).normal(0, 0.1, TIME.size)
    found = analyse_cycles(TIME, RAMPS, noisy, branches=None, **EXACT)
    assert found.valid
    assert len(found.branches) == 2
    taus = sorted(b.relaxation_time.value for b in found.branches)
    np.testing.assert_allclose(taus, [1.0, 30.0], rtol=0.1)
    one = analyse_cycles(TIME, RAMPS, noisy, branches=1, **EXACT)
    assert one.rmse > 2 * found.rmse


def test_one_branch_is_enough_where_there_is_one():
    noisy = FORCE + np.random.default_rng(4).normal(0, 0.5, TIME.size)
    assert len(analyse_cycles(TIME, RAMPS, noisy, branches=None, **EXACT).branches) == 1


def test_information_is_what_the_fit_attains():
    rng = np.random.default_rng(5)
    information = layer_information(PAPER_LAYER_SH10, LayerTest(TIME, RAMPS, 0.857))
    bound = np.sqrt(np.diag(np.linalg.inv(information)))
    found = analyse_cycles(TIME, RAMPS, FORCE + rng.normal(0, 0.857, TIME.size), **EXACT)
    branch = found.branches[0]
    stds = [
        e.std / e.value for e in (found.equilibrium_stiffness, branch.stiffness, branch.viscosity)
    ]
    np.testing.assert_allclose(stds, bound, rtol=0.15)


def test_a_quick_branch_needs_a_quick_test():
    layer = DamperLayer(38.32e3, (*PAPER_LAYER_SH10.branches, MaxwellBranch(20e3, 20e3 * 5e-3)))
    slow = LayerTest(TIME, RAMPS)
    quick_time = np.arange(0, 0.5, 1e-3)
    quick = LayerTest(quick_time, 1e-3 * (1 - np.cos(2 * np.pi * 20 * quick_time)))
    ranked = rank_further_tests(layer, (slow,), {'the same again': slow, '20 Hz': quick})
    assert [name for name, _ in ranked] == ['20 Hz', 'the same again']
    assert ranked[0][1]['stiffness of branch 2'] < 0.05
    assert ranked[1][1]['stiffness of branch 2'] > 1.0


def test_a_branch_that_the_test_cannot_tell_is_not_reported():
    spring = 40e3 * RAMPS + np.random.default_rng(6).normal(0, 1.0, TIME.size)
    found = analyse_cycles(TIME, RAMPS, spring)
    assert not found.valid
    assert 'does not tell' in found.reason


def test_what_cannot_be_told_is_unusable():
    rng = np.random.default_rng(7)
    cases = [
        (TIME[:10], RAMPS[:10], FORCE[:10], '10 samples'),
        (TIME[::-1], RAMPS, FORCE, 'rise'),
        (TIME, rng.normal(0, 1e-3, TIME.size), FORCE, 'ramp'),
        (TIME, RAMPS, -FORCE, 'signs'),
        (TIME, RAMPS, rng.normal(0, 1, TIME.size), 'signs'),
        (TIME, 1e3 * RAMPS, 1e-3 * FORCE, 'units'),
        (TIME, np.zeros(TIME.size), FORCE, 'ramp'),
    ]
    for time, displacement, force, reason in cases:
        found = analyse_cycles(time, displacement, force)
        assert not found.valid, reason
        assert reason in found.reason
        assert math.isnan(found.equilibrium_stiffness.value)
    with pytest.raises(InputError, match='damper test'):
        analyse_cycles(TIME, RAMPS[:-1], FORCE)


@pytest.mark.parametrize('level', [0.0, 3.0])
def test_a_force_that_stands_still_is_unusable(level):
    time, u = cyclic_ramp((1e-3, 2e-3), 2e-4, 20.0)
    found = analyse_cycles(time, u, np.full(u.size, level))
    assert not found.valid
    assert 'does not vary' in found.reason
