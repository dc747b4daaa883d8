"""The compiled oscillator against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.discrepancy.driven.models import parameter_layout as at
from impactscope.discrepancy.driven.models.equation_of_motion import (
    lost_motion,
    run,
    run_on_base,
    slider_force,
)
from impactscope.discrepancy.driven.models.oscillator_model import inside_samples

PERIOD = 1e-3


def parameters(**values: float) -> np.ndarray:
    p = np.zeros(at.SIZE)
    p[at.MASS] = 1.0
    p[at.STRIBECK_SPEED] = 1.0
    for name, value in values.items():
        p[getattr(at, name)] = value
    return p


def simulate(p, force, x=0.0, v=0.0, steps=2, *, held=True):
    out = np.zeros((force.size, 4))
    assert run(p, inside_samples(force, steps, held=held), PERIOD, x, v, out)
    return out


def test_free_decay_is_the_closed_form():
    omega, ratio, x0 = 2 * math.pi * 12.0, 0.03, 0.01
    p = parameters(STIFFNESS=omega**2, DAMPING=2 * ratio * omega)
    out = simulate(p, np.zeros(1000), x=x0)
    t = PERIOD * np.arange(1000)
    turn = omega * math.sqrt(1 - ratio**2)
    lag = ratio * omega / turn * np.sin(turn * t)
    expected = x0 * np.exp(-ratio * omega * t) * (np.cos(turn * t) + lag)
    np.testing.assert_allclose(out[:, 0], expected, atol=2e-6 * x0)


@given(st.floats(5.0, 60.0), st.floats(0.002, 0.03))
@settings(max_examples=25, deadline=None)
def test_dry_friction_shrinks_each_half_swing_by_the_same_step(frequency, share):
    """Each half swing loses 2 F / k, and the mass rests where friction holds it."""
    stiffness = (2 * math.pi * frequency) ** 2
    x0 = 1e-2
    friction = share * stiffness * x0
    p = parameters(STIFFNESS=stiffness, KINETIC_FORWARD=friction, KINETIC_BACKWARD=friction)
    out = simulate(p, np.zeros(4000), x=x0, steps=4)
    x, v = out[:, 0], out[:, 1]
    turns = np.flatnonzero(v[1:-1] * v[2:] < 0) + 1
    peaks = np.array([x0, *np.abs(x[turns])])[:6]
    # a sample may miss the turn by half a period of sampling
    miss = x0 * (2 * math.pi * frequency * PERIOD) ** 2 / 2 + 2e-5 * x0
    steps = -np.diff(peaks)
    np.testing.assert_allclose(steps, 2 * friction / stiffness, atol=miss)
    rest = v == 0.0
    if rest[-1]:
        assert np.all(stiffness * np.abs(x[rest][-10:]) <= friction * (1 + 1e-9))
        assert np.ptp(x[rest][-10:]) == 0.0  # no creep


def test_held_by_friction_until_the_load_exceeds_it():
    ramp = np.linspace(0.0, 2.0, 2001)
    p = parameters(KINETIC_FORWARD=1.0, KINETIC_BACKWARD=1.0)
    out = simulate(p, ramp, held=False)
    assert np.all(out[:1000, 0] == 0.0)
    t = PERIOD * (2000 - 1000)
    assert out[-1, 1] == pytest.approx(t**2 / 2, rel=2e-3)  # a = t after breaking away at 1 N
    assert out[-1, 0] == pytest.approx(t**3 / 6, rel=2e-3)


@pytest.mark.parametrize('friction', [0.0, 0.4])
@pytest.mark.parametrize('held', [True, False])
def test_a_linear_mass_goes_the_way_of_the_general_law(friction, held):
    """A cube too small to act makes the same motion go through the general step."""
    rng = np.random.default_rng(4)
    force = np.convolve(rng.normal(size=2000), np.hanning(60) / 10.0, 'same')
    numbers = {'STIFFNESS': 900.0, 'DAMPING': 2.0, 'INPUT_OFFSET': 0.1}
    numbers |= {'KINETIC_FORWARD': friction, 'KINETIC_BACKWARD': 0.7 * friction}
    quick = simulate(parameters(**numbers), force, 1e-3, -0.02, held=held)
    usual = simulate(parameters(**numbers, CUBIC=1e-30), force, 1e-3, -0.02, held=held)
    if friction:
        assert np.any(quick[:, 1] == 0.0)  # it sticks now and then
    np.testing.assert_allclose(quick, usual, rtol=0.0, atol=1e-11 * np.max(np.abs(usual)))


def test_hardening_spring_keeps_its_energy():
    p = parameters(STIFFNESS=1000.0, CUBIC=1e7)
    out = simulate(p, np.zeros(3000), x=0.02, steps=6)
    x, v = out[:, 0], out[:, 1]
    energy = 0.5 * v**2 + 500.0 * x**2 + 0.25e7 * x**4
    np.testing.assert_allclose(energy, energy[0], rtol=2e-4)


@pytest.mark.parametrize(('closing', 'leaning'), [(2500.0, 0.0), (1250.0, 1250.0)])
def test_a_yielding_spring_is_followed_where_it_yields_within_a_step(closing, leaning):
    """A step of motion is a few times as long as the way in which the spring yields."""
    omega = 2 * math.pi * 25.0
    p = parameters(
        STIFFNESS=omega**2,
        DAMPING=6.0,
        HYSTERESIS_STIFFNESS=0.05 * omega**2,
        HYSTERESIS_CLOSING=closing,
        HYSTERESIS_LEANING=leaning,
    )
    force = 100.0 * np.sin(2 * math.pi * 24.0 * PERIOD * np.arange(1000))
    coarse, fine = (simulate(p, force, steps=n, held=False)[:, 0] for n in (1, 64))
    assert np.max(np.abs(np.diff(fine))) > 2.0 / (closing + leaning)
    assert np.max(np.abs(coarse - fine)) < 1e-3 * np.max(np.abs(fine))


def test_a_runaway_is_told():
    p = parameters(STIFFNESS=-1e6)
    out = np.zeros((4000, 4))
    assert not run(p, inside_samples(np.zeros(4000), 1, held=True), PERIOD, 1.0, 0.0, out)


@given(st.floats(-1.0, 1.0), st.floats(0.0, 1.0))
def test_lost_motion_is_continuous_odd_and_never_longer(x, gap):
    assert lost_motion(-x, gap) == -lost_motion(x, gap)
    assert abs(lost_motion(x, gap)) <= abs(x)
    assert abs(lost_motion(x + 1e-9, gap) - lost_motion(x, gap)) <= 1.1e-9


@given(st.floats(0.1, 3.0), st.floats(0.1, 3.0), st.floats(0.0, 0.5))
@settings(deadline=None)
def test_slider_holds_its_limits_and_its_loop_has_the_known_area(forward, backward, gap):
    stiffness, size = 50.0, 1.0
    t = np.linspace(0.0, 3.0, 60_001)
    x = size * np.sin(2 * math.pi * t)
    force = np.zeros_like(x)
    slider_force(x, stiffness, forward, backward, gap, 0.0, force)
    assert force.max() <= forward + 1e-12
    assert force.min() >= -backward - 1e-12
    last = t >= 2.0
    area = float(np.sum(0.5 * (force[last][1:] + force[last][:-1]) * np.diff(x[last])))
    # over one cycle it slides the stroke less what the spring and the play give back
    travel = 2 * size - gap - (forward + backward) / stiffness
    assert area == pytest.approx((forward + backward) * travel, rel=2e-3, abs=2e-3)


def test_band_limited_input_between_samples():
    t = np.arange(400)
    sine = np.sin(2 * math.pi * 0.21 * t)
    fine = inside_samples(sine, 2, held=False)
    exact = np.sin(2 * math.pi * 0.21 * (t[:-1, None] + np.arange(5) / 4))
    np.testing.assert_allclose(fine[40:-40], exact[40:-40], atol=2e-3)
    held = inside_samples(sine, 2, held=True)
    assert np.all(held == sine[:-1, None])


@pytest.mark.parametrize('reacts', [False, True])
@pytest.mark.parametrize('friction', [0.0, 2.0, 6.0])
def test_friction_on_a_base_that_gives_way(friction, reacts):
    """Against tiny steps in which friction is an impulse that is cut off (Moreau)."""
    mass, damping, stiffness, base, ratio = 1.0, 3.0, 4000.0, 8.0, 0.03
    turn, dt, steps, n, tiny = 2.0 * math.pi * 40.0, 1.0 / 2000.0, 2, 300, 100
    p = np.zeros(at.SIZE)
    p[at.MASS], p[at.DAMPING], p[at.STIFFNESS] = mass, damping, stiffness
    p[at.BASE_MASS], p[at.BASE_STIFFNESS] = base, base * turn**2
    p[at.BASE_DAMPING], p[at.BASE_REACTS] = 2.0 * ratio * turn * base, float(reacts)
    p[at.KINETIC_FORWARD] = p[at.KINETIC_BACKWARD] = friction

    def push(t):
        blow = np.where(t < 0.02, np.sin(math.pi * t / 0.02) ** 2, 0.0)
        return 100.0 * blow + 0.3 * friction * np.sin(2.0 * math.pi * 3.0 * t)

    inside = np.arange(2 * steps + 1) / (2 * steps)
    out = np.zeros((n, 4))
    assert run_on_base(p, push(dt * (np.arange(n - 1)[:, None] + inside)), dt, 0.0, 0.0, out)
    x = v = xb = vb = 0.0
    h, together = dt / tiny, 1.0 / (1.0 / mass + 1.0 / base)
    places, speeds = np.zeros(n), np.zeros(n)
    forces = push(dt * (np.arange(n)[:, None] + (np.arange(tiny) + 0.5) / tiny)).tolist()
    for i in range(n):
        places[i], speeds[i] = x, v
        for u in forces[i]:
            load = u - damping * v - stiffness * x
            pull = -load if reacts else u - load
            moved = (pull - p[at.BASE_DAMPING] * vb - p[at.BASE_STIFFNESS] * xb) / base
            free = v + h * (load / mass - moved)
            held = min(max(-free * together, -friction * h), friction * h)
            v = free + held / together
            vb += h * moved - held / base
            x, xb = x + h * v, xb + h * vb
    assert out[:, 0] == pytest.approx(places, abs=3e-4 * np.max(np.abs(places)))
    assert out[:, 1] == pytest.approx(speeds, abs=3e-4 * np.max(np.abs(speeds)))


@pytest.mark.parametrize('reacts', [0.0, 1.0])
@pytest.mark.parametrize('rubs', [0.0, 0.3])
@settings(max_examples=12, deadline=None)
@given(
    frequency=st.floats(15.0, 300.0),
    ratio=st.floats(0.005, 0.2),
    offset=st.floats(-0.2, 0.2),
    speed=st.sampled_from([0.0, 0.05]),
    steps=st.integers(1, 3),
)
def test_a_linear_mass_on_its_base_steps_as_any_other(
    reacts, rubs, frequency, ratio, offset, speed, steps
):
    """Its steps are taken at once; those of a spring not quite straight one by one."""
    omega, mass = 2 * math.pi * frequency, 12.0
    values = {
        'MASS': 1.7, 'STIFFNESS': 5e4, 'DAMPING': 30.0, 'INPUT_OFFSET': offset,
        'KINETIC_FORWARD': 1.3 * rubs, 'KINETIC_BACKWARD': rubs, 'BASE_MASS': mass,
        'BASE_STIFFNESS': mass * omega**2, 'BASE_DAMPING': 2 * ratio * mass * omega,
        'BASE_REACTS': reacts,
    }  # fmt: skip
    force = np.zeros(600)
    force[50:70] = 50.0 * np.sin(np.pi * np.arange(20) / 20)
    drive = inside_samples(force, steps, held=False)
    made = []
    for cubic in (0.0, 1e-30):
        out = np.zeros((force.size, 4))
        assert run_on_base(parameters(CUBIC=cubic, **values), drive, PERIOD, 0.0, speed, out)
        made.append(out)
    size = np.max(np.abs(made[1]), axis=0) + 1e-300
    assert np.all(np.abs(made[0] - made[1]) < 1e-9 * size)


def broadband(count, highest, seed):
    """A force of many sines up to ``highest`` Hz, that begins slowly; a function of time."""
    rng = np.random.default_rng(seed)
    turn, phase = 2 * math.pi * rng.uniform(1.0, highest, count), rng.uniform(0.0, 6.28, count)

    def force(t):
        made = sum(np.sin(w * t + p) for w, p in zip(turn, phase, strict=True))
        return made * np.clip(20.0 * t, 0.0, 1.0)

    return force


def inside(force, count, steps):
    """The force inside each sampling period, where all of it is known, (count - 1, 2 s + 1)."""
    t = PERIOD * np.arange(count - 1)[:, None] + PERIOD * np.linspace(0.0, 1.0, 2 * steps + 1)
    return np.ascontiguousarray(force(t))


@pytest.mark.parametrize('based', [False, True])
@pytest.mark.parametrize('steps', [1, 3])
def test_friction_of_next_to_nothing_does_nothing(based, steps):
    """Under a force that turns within a step speeds vanish where no chord finds them."""
    u = inside(broadband(60, 230.0, 1), 3000, steps)
    base = {'BASE_MASS': 3.0, 'BASE_STIFFNESS': 5e4, 'BASE_DAMPING': 10.0} if based else {}
    found = []
    for friction in (0.0, 1e-9):
        p = parameters(STIFFNESS=1500.0, DAMPING=4.0, **base)
        p[at.KINETIC_FORWARD] = p[at.KINETIC_BACKWARD] = friction
        out = np.zeros((3000, 4))
        assert (run_on_base if based else run)(p, u, PERIOD, 0.0, 0.0, out)
        found.append(out[:, 0])
    assert np.linalg.norm(found[1] - found[0]) < 1e-4 / steps * np.linalg.norm(found[0])


def test_what_sets_off_and_comes_back_within_a_step_moves_on():
    """The load exceeds friction for a moment, and then friction holds no more the other way."""
    period = PERIOD
    p = parameters(KINETIC_FORWARD=1.0, KINETIC_BACKWARD=1.0)
    u = np.array([[1.2, 0.2, -8.0]])
    out = np.zeros((2, 4))
    assert run(p, u, period, 0.0, 0.0, out)
    fine = np.zeros((4001, 4))
    s = np.linspace(0.0, 1.0, 8001)
    parabola = 1.2 + s * (4 * 0.2 - 3 * 1.2 + 8.0 + s * (2 * 1.2 - 4 * 0.2 - 2 * 8.0))
    rows = np.stack([parabola[:-2:2], parabola[1:-1:2], parabola[2::2]], axis=1)
    assert run(p, np.ascontiguousarray(rows), period / 4000, 0.0, 0.0, fine)
    assert out[1, 1] == pytest.approx(fine[-1, 1], rel=1e-3)
    assert out[1, 1] < -1e-3
