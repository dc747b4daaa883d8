"""Prescribed motions and bare chains against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import ConfigurationError
from impactscope.proof.bench import BENCH
from impactscope.proof.conditions import draw_scenario
from impactscope.proof.detectability import Freedom
from impactscope.proof.draw import KINDS, draw
from impactscope.proof.given_course import Wave, course, device_force
from impactscope.proof.measurement import INPUTS, input_channel, measure, noise_free

WAVES = (
    Wave(0.01, 2.0, 0.1, rise=0.1),
    Wave(0.004, 3.0, 0.3, phase=0.4, decay=2.0, rise=0.05, glide=1.5),
)


def test_the_rate_of_a_course_is_its_derivative():
    t = np.linspace(0, 2, 200_001)
    x, v = course(WAVES, t)
    assert np.abs(np.gradient(x, t)[1:-1] - v[1:-1]).max() < 1e-5
    assert np.all(x[t < 0.1] == 0)


def test_work_over_a_cycle_is_what_each_law_takes():
    """Viscous pi c w X^2, dry 4 F X, quadratic 8/3 c2 w^2 X^3; springs none."""
    reach, omega = 0.01, 2 * np.pi * 2
    t = np.linspace(0, 0.5, 200_001)
    x, v = reach * np.sin(omega * t), reach * omega * np.cos(omega * t)

    def work(**fields):
        bench = BENCH._replace(**({'stiffness': 5e3, 'damping': 0.0} | fields))
        return np.trapezoid(device_force(bench, t, x, v), x)

    assert work() == pytest.approx(0, abs=1e-8)
    assert work(cubic=1e7, clearance=1e-3, stop_travel=8e-3, stop_stiffness=1e4) == pytest.approx(
        0, abs=1e-6
    )
    assert work(damping=30.0) == pytest.approx(np.pi * 30 * omega * reach**2, rel=1e-6)
    dry = work(friction_forward=2.0, friction_backward=3.0)
    assert dry == pytest.approx((2.0 + 3.0) * 2 * reach, rel=1e-4)
    drag = work(quadratic_forward=7.0, quadratic_backward=7.0)
    assert drag == pytest.approx(8 / 3 * 7 * omega**2 * reach**3, rel=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.05, 3.0), st.floats(0.1, 1.0))
def test_hysteresis_follows_its_law_and_forgets_the_sampling(reach, share):
    """Loading z = y (1 - exp(-x/y)); a closed loop takes work; samples do not matter."""
    t = np.linspace(0, 1.5, 3001)
    x = 1e-3 * np.sin(2 * np.pi * t)
    bench = BENCH._replace(
        stiffness=1e4, damping=0.0, hysteretic_share=share, yield_displacement=reach * 1e-3
    )
    force = device_force(bench, t, x, np.gradient(x, t))
    held = (force / 1e4 - (1 - share) * x) / share
    rising = t <= 0.25
    expected = reach * 1e-3 * (1 - np.exp(-x[rising] / (reach * 1e-3)))
    assert held[rising] == pytest.approx(expected, abs=1e-12)
    assert np.abs(held).max() <= reach * 1e-3 * (1 + 1e-9)
    coarse = device_force(bench, t[::10], x[::10], np.gradient(x, t)[::10])
    assert np.abs(coarse - force[::10]).max() < 0.02 * np.abs(force).max()
    last = slice(1000, None)
    assert np.trapezoid(force[last], x[last]) > 0


@pytest.mark.parametrize('kind', ['prescribed', 'chain'])
def test_a_clean_campaign_is_its_baseline(kind):
    scenario = draw_scenario(np.random.default_rng(3), kind)
    assert Freedom(scenario).detectability(scenario) == 0
    blow = scenario.blows[0]
    samples = measure(blow, scenario, np.random.default_rng(1))
    assert set(samples) == {*scenario.channels, INPUTS[kind]}
    name = scenario.channels[0]
    spread = np.std(samples[name] - noise_free(blow, scenario)[name])
    assert spread == pytest.approx(scenario.noise[name], rel=0.1)
    if kind == 'chain':
        given = input_channel(blow, scenario.rates[name])
        assert noise_free(blow, scenario)[name] == pytest.approx(given)


@pytest.mark.parametrize('kind', list(KINDS))
@pytest.mark.parametrize('category', ['single', 'pair', 'outside'])
def test_every_kind_of_campaign_can_conceal(kind, category):
    drawn = draw(np.random.default_rng(17), category=category, kind=kind, classes=False)
    assert drawn.truth.kind == kind
    assert len(drawn.parts) == (2 if category == 'pair' else 1)
    assert drawn.detectability > 0


def test_a_kind_without_labels_cannot_have_a_wrong_one():
    with pytest.raises(ConfigurationError, match='chain'):
        draw(np.random.default_rng(0), category='label', kind='chain')
