import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp, trapezoid

from impactscope.errors import ConfigurationError, InputError
from impactscope.physics.damper_layer import (
    PAPER_LAYER_RATE,
    PAPER_LAYER_SH10,
    DamperLayer,
    MaxwellBranch,
    cyclic_ramp,
)

TWO = DamperLayer(30e3, (MaxwellBranch(10e3, 20e3), MaxwellBranch(40e3, 100.0)))


def test_the_papers_constants_give_166_newton_at_4_mm():
    # The paper says 175 N at "about 4 mm"; that takes 4.23 mm.
    for displacement, force in ((4e-3, 166.2), (4.23e-3, 175.0)):
        time = displacement / PAPER_LAYER_RATE
        ramp = PAPER_LAYER_SH10.ramp_response(time, PAPER_LAYER_RATE)
        assert ramp == pytest.approx(force, abs=0.1)
    assert PAPER_LAYER_SH10.branches[0].relaxation_time == pytest.approx(4.135, abs=1e-3)


def test_the_papers_layer_is_a_spring_at_impact_rate():
    stiffness = PAPER_LAYER_SH10.dynamic_stiffness(30.0)
    assert stiffness.real == pytest.approx(57.16e3, rel=1e-4)
    assert PAPER_LAYER_SH10.loss_factor(30.0) < 1e-3


@given(st.floats(1e-4, 1e4))
def test_dynamic_stiffness_stays_between_its_limits(frequency):
    stiffness = TWO.dynamic_stiffness(frequency)
    assert TWO.equilibrium_stiffness <= stiffness.real <= TWO.instantaneous_stiffness
    assert stiffness.imag > 0


def test_dynamic_stiffness_is_the_transform_of_relaxation():
    f, horizon = 2.0, 60.0
    t = np.linspace(0, horizon, 2_000_001)
    decay = TWO.relaxation(t) - TWO.equilibrium_stiffness
    s = 2j * np.pi * f
    transform = s * trapezoid(decay * np.exp(-s * t), t)
    assert abs(TWO.dynamic_stiffness(f) - TWO.equilibrium_stiffness - transform) < 20.0
    assert TWO.relaxation(0.0) == pytest.approx(TWO.instantaneous_stiffness)


def test_cycles_agree_with_an_integrated_model():
    time, u = cyclic_ramp((1e-3, 2e-3), 2e-3, 100.0)
    response = TWO.response(time, u)
    speed = np.diff(u) / np.diff(time)

    def rates(t, f):
        v = speed[min(np.searchsorted(time, t, side='right') - 1, speed.size - 1)]
        return [
            b.stiffness * v - x / b.relaxation_time for b, x in zip(TWO.branches, f, strict=True)
        ]

    solved = solve_ivp(
        rates,
        (0, time[-1]),
        [0.0, 0.0],
        t_eval=time,
        method='LSODA',
        rtol=1e-8,
        atol=1e-8,
        max_step=2e-3,
    )
    np.testing.assert_allclose(response.branch_forces, solved.y, atol=0.05)
    np.testing.assert_allclose(response.surface, u)


def test_first_ramp_is_the_closed_form_at_any_step():
    time = np.array([0.0, 0.1, 1.7, 1.9, 30.0])
    response = TWO.response(time, 1e-4 * time)
    np.testing.assert_allclose(response.force, TWO.ramp_response(time, 1e-4), rtol=1e-12)
    half = TWO.response(time[:3], 1e-4 * time[:3])
    rest = TWO.response(time[2:], 1e-4 * time[2:], branch_forces=tuple(half.branch_forces[:, -1]))
    np.testing.assert_allclose(rest.force, response.force[2:], rtol=1e-12)


def test_pushing_only_the_layer_lags_behind_and_never_pulls():
    time, u = cyclic_ramp((2e-3, 3e-3, 4e-3), PAPER_LAYER_RATE, 20.0)
    glued = PAPER_LAYER_SH10.response(time, u)
    pushed = PAPER_LAYER_SH10.response(time, u, unilateral=True)
    assert glued.force.min() < -5
    assert pushed.force.min() == 0.0
    assert (pushed.surface >= u - 1e-12).all()
    apart = pushed.surface > u + 1e-9
    assert apart.any()
    assert (pushed.force[apart] == 0).all()
    touching = ~apart
    np.testing.assert_allclose(pushed.surface[touching], u[touching], atol=1e-9)


def test_free_surface_creeps_back_as_the_closed_form():
    # One branch, let go: k2 s + f = 0, so s decays with tau (1 + k1/k2).
    layer = PAPER_LAYER_SH10
    time = np.concatenate(([0.0, 10.0, 10.0 + 1e-6], np.arange(10.05, 40, 0.05)))
    u = np.where(time <= 10.0, 3e-3 * np.minimum(time / 10, 1), -1e-3)
    surface = layer.response(time, u, unilateral=True).surface[3:]
    creep = layer.branches[0].relaxation_time * (1 + 18.84 / 38.32)
    expected = surface[0] * np.exp(-(time[3:] - time[3]) / creep)
    np.testing.assert_allclose(surface, expected, rtol=1e-4)


@given(st.floats(0.2, 5.0), st.floats(0.5, 2.0))
def test_response_is_linear_in_displacement(scale, speed):
    time, u = cyclic_ramp((1e-3,), speed * 1e-3, 50.0)
    one, many = TWO.response(time, u).force, TWO.response(time, scale * u).force
    np.testing.assert_allclose(many, scale * one, atol=1e-9)


def test_a_closed_cycle_dissipates():
    time, u = cyclic_ramp((1e-3, 1e-3), 1e-3, 200.0)
    force = TWO.response(time, u).force
    work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(u))
    assert work > 0


def test_bad_input_is_refused():
    with pytest.raises(ConfigurationError, match='equilibrium'):
        DamperLayer(0.0)
    with pytest.raises(ConfigurationError, match='viscosity'):
        MaxwellBranch(1.0, math.inf)
    with pytest.raises(InputError, match='rise'):
        TWO.response([0.0, 0.0], [0.0, 1.0])
    with pytest.raises(InputError, match='1-D'):
        TWO.response([0.0, 1.0], [0.0])
    with pytest.raises(InputError, match='1 branch forces for 2'):
        TWO.response([0.0, 1.0], [0.0, 1.0], branch_forces=(1.0,))
    with pytest.raises(InputError, match='branch forces'):
        TWO.ramp_response(0.0, 1.0, branch_forces=(1.0,))
    with pytest.raises(ConfigurationError, match='cyclic ramp'):
        cyclic_ramp((), 1.0, 1.0)
