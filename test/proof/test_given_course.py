"""Prescribed motions and bare chains against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import ConfigurationError
from impactscope.proof.bench import BENCH
from impactscope.proof.conditions import draw_scenario
from impactscope.proof.detectability import Freedom
from impactscope.proof.draw import KINDS, differences, draw, look_alikes, solve_strength
from impactscope.proof.effects import EFFECTS, effect
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


BRANCH = 'rate_dependent_damper:prescribed'


def branch_force(stiffness, time, t, x, v):
    """Force of a branch alone, N; time: its relaxation time, s."""
    alone = BENCH._replace(
        stiffness=0.0, damping=0.0, second_stiffness=stiffness, second_damping=stiffness * time
    )
    return device_force(alone, t, x, v)


@pytest.mark.parametrize('rate', [1e3, 5e3, 40e3])
@pytest.mark.parametrize('slowness', [0.01, 0.1, 1.0, 20.0, 1e4])
def test_a_branch_under_a_sine_answers_as_it_must(slowness, rate):
    """From rest: k X s / (1 + s²) (s sin wt + cos wt - exp(-t/T)), s = w T."""
    reach, omega, stiffness = 0.01, 2 * np.pi * 12, 5e3
    t = 0.1 + np.arange(round(2 * rate)) / rate  # when the recording begins does not matter
    since = t - 0.1
    x, v = reach * np.sin(omega * since), reach * omega * np.cos(omega * since)
    fading = np.exp(-since * omega / slowness)
    shape = slowness * np.sin(omega * since) + np.cos(omega * since) - fading
    expected = stiffness * reach * slowness / (1 + slowness**2) * shape
    force = branch_force(stiffness, slowness / omega, t, x, v)
    bar = 1e-9 + 0.01 * (omega / rate) ** 3  # a cubic course between samples
    assert np.abs(force - expected).max() < bar * np.abs(expected).max()


def test_a_branch_is_a_dashpot_in_a_long_ramp_and_relaxes_where_it_stands():
    t = np.linspace(0, 1, 1001)
    speed, stiffness, time = 0.02, 4e3, 0.05
    force = branch_force(stiffness, time, t, speed * t, np.full(t.size, speed))
    assert force == pytest.approx(stiffness * time * speed * (1 - np.exp(-t / time)), abs=1e-12)
    stands = branch_force(stiffness, time, t, np.full(t.size, 0.01), np.zeros(t.size))
    assert np.all(stands == 0)
    begun = t >= 0.2  # 0.2 s of standing, a short smooth move, and standing again
    course_of = [Wave(0.01, 0.5, 0.2, rise=0.1, decay=20.0)]
    moved = branch_force(stiffness, time, t, *course(course_of, t))
    assert np.all(moved[~begun] == 0)
    late = slice(900, None)
    assert np.abs(moved[late]).max() < 1e-3 * np.abs(moved).max()


def test_a_glide_is_fastest_at_its_end():
    assert Wave(1.0, 2.0, start=0.5).fastest(3.0) == pytest.approx(4 * np.pi)
    assert Wave(1.0, 2.0, start=0.5, glide=1.0).fastest(3.0) == pytest.approx(9 * np.pi)
    assert Wave(1.0, 2.0, start=0.5, glide=-0.5).fastest(3.0) == pytest.approx(4 * np.pi)


@pytest.mark.parametrize('seed', range(5))
def test_a_device_stands_before_its_motion_begins(seed):
    """So that a branch is at rest where the recording begins."""
    scenario = draw_scenario(np.random.default_rng(seed), 'prescribed')
    for blow in scenario.blows:
        assert not input_channel(blow, 1000.0)[:90].any()


@pytest.mark.parametrize('wanted', [0.5, 5.0, 60.0])
def test_a_branch_beside_the_device_is_as_visible_as_asked_for(wanted):
    scenario = draw_scenario(np.random.default_rng(3), 'prescribed')
    freedom, chosen = Freedom(scenario), effect(BRANCH)
    assert [e.key for e in EFFECTS if e.name == chosen.name and e.fits(scenario)] == [BRANCH]
    assert chosen.subsystem == 'damper'
    fastest = max(w.fastest(b.duration) for b in scenario.blows for w in b.waves)
    for seed in range(4):
        aux = chosen.setup(np.random.default_rng(seed), scenario)
        strength, size = solve_strength(freedom, chosen, aux, wanted)
        assert size == pytest.approx(wanted, rel=0.1)
        truth = chosen.apply(scenario, strength, aux)
        assert freedom.detectability(truth) == pytest.approx(size, rel=1e-6)
        told, bench = chosen.parameters(strength, aux), truth.blows[0].bench
        assert (told['stiffness'], told['damping']) == (
            bench.second_stiffness,
            bench.second_damping,
        )
        assert 0.1 <= told['damping'] / told['stiffness'] * fastest < 60  # of all recordings


def test_what_the_device_has_already_is_not_a_branch():
    """So fast that it is a dashpot, so slow that it is a spring: the baseline re-tunes it."""
    scenario = draw_scenario(np.random.default_rng(3), 'prescribed')
    freedom, chosen = Freedom(scenario), effect(BRANCH)
    stiffness = 0.01 * scenario.blows[0].bench.stiffness
    sizes = [
        freedom.detectability(
            chosen.apply(scenario, 1.0, {'stiffness': stiffness, 'damping': stiffness * time})
        )
        for time in (1e-6, 0.05, 1e6)
    ]
    assert sizes[1] > 20
    assert max(sizes[0], sizes[2]) < 0.1


@pytest.mark.parametrize('category', ['single', 'pair'])
def test_a_branch_is_drawn_where_the_motion_is_prescribed(category):
    for seed in range(60):
        drawn = draw(
            np.random.default_rng(seed), category=category, kind='prescribed', classes=False
        )
        hidden = [p for p in drawn.parts if p.key == BRANCH]
        if hidden:
            break
    assert hidden
    assert hidden[0].detectability > 0
    assert {'stiffness', 'damping'} == set(hidden[0].parameters)
    assert drawn.truth.blows[0].bench.second_stiffness == hidden[0].parameters['stiffness']
    assert drawn.stated.blows[0].bench.second_stiffness == 0


def test_a_fast_branch_and_a_low_pass_look_alike_and_a_slow_one_does_not():
    """Far below its corner either adds a force in phase with the acceleration."""
    scenario = draw_scenario(np.random.default_rng(0), 'prescribed')
    blows = [b for b in scenario.blows if b.role == 'fit'][:2]
    scenario = replace(scenario, blows=tuple(blows))
    freedom, branch, low_pass = Freedom(scenario), effect(BRANCH), effect('low_pass_filter')
    few = branch.shapes(scenario)
    assert len(few) > 4

    def alike(chosen, aux):
        strength, size = solve_strength(freedom, chosen, aux, 10.0)
        truth = chosen.apply(scenario, strength, aux)
        found = differences(np.random.default_rng(0), freedom, truth, {chosen.key})
        return look_alikes(found, size)

    filtered = {'channel': 'force.damper', 'order': 2, 'zero_phase': 0}
    assert branch.name in alike(low_pass, filtered)
    assert low_pass.name in alike(branch, few[0])
    assert low_pass.name not in alike(branch, few[len(few) // 2])


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
