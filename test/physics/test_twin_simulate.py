"""The twin against closed forms, an independent integrator and the first law."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.integrate import solve_ivp

from impactscope.errors import ConfigurationError
from impactscope.physics.pendulum import Orientation, Pendulum
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.assembly import Effect, assemble, implied_effects
from impactscope.physics.twin.bench import (
    IMPACT_RATE_LAYER,
    PAPER_LAYER,
    BareContact,
    Bench,
    DamperLayer,
    HammerTap,
    MaxwellBranch,
    MeasuredForce,
    PendulumBlow,
    RobotBlow,
    Sensor,
)
from impactscope.physics.twin.simulate import SimulationError, simulate, solve
from impactscope.physics.twin.start import corners

FINE = 1e-10


def half_sine_response(t: np.ndarray, blow: HammerTap, sensor: Sensor) -> np.ndarray:
    """Displacement of plate on spring under a half-sine: particular and free part, exactly."""
    m, k, c = sensor.moving_mass, sensor.stiffness, sensor.damping
    w = math.pi / blow.duration
    wn, zeta = math.sqrt(k / m), sensor.damping_ratio
    wd = wn * math.sqrt(1 - zeta**2)
    gain = blow.peak_force / ((k - m * w**2) ** 2 + (c * w) ** 2)
    a, b = -gain * c * w, gain * (k - m * w**2)  # a cos + b sin

    def free(t: np.ndarray, x0: float, v0: float) -> np.ndarray:
        decay = np.exp(-zeta * wn * t)
        return decay * (x0 * np.cos(wd * t) + (v0 + zeta * wn * x0) / wd * np.sin(wd * t))

    def driven(t: np.ndarray) -> np.ndarray:
        return a * np.cos(w * t) + b * np.sin(w * t) + free(t, -a, -b * w)

    eps = 1e-6
    end = np.array([blow.duration - eps, blow.duration, blow.duration + eps])
    x1 = driven(end)
    after = free(np.maximum(t - blow.duration, 0), x1[1], (x1[2] - x1[0]) / (2 * eps))
    return np.where(t < blow.duration, driven(t), after)


def test_tap_is_the_closed_form_of_a_half_sine():
    blow, sensor = HammerTap(150.0, 0.004), Sensor()
    result = simulate(Bench(damper=None), blow, duration=0.5, tolerance=FINE)
    expected = sensor.stiffness * half_sine_response(result.time, blow, sensor)
    assert np.abs(result['force'] - expected).max() < 1e-6 * expected.max()


def test_default_tolerance_is_good_to_five_digits():
    bench, blow = Bench(), PendulumBlow()
    fine = simulate(bench, blow, duration=0.5, tolerance=1e-12)
    usual = simulate(bench, blow, duration=0.5)
    for name in ('force', 'acceleration.plate'):
        assert np.abs(usual[name] - fine[name]).max() < 5e-5 * np.abs(fine[name]).max()


@pytest.mark.parametrize('turned', [13.0, 15.0])
def test_bounces_of_bare_metal_are_followed_to_a_tenth_of_a_quiet_noise(turned):
    bench = Bench(damper=None, contact=BareContact(1.2e9, restitution=0.8))
    blow = PendulumBlow(Pendulum(mass_distance=0.15), math.radians(turned))
    fine = simulate(bench, blow, duration=0.8, tolerance=1e-12)
    usual = simulate(bench, blow, duration=0.8)
    assert len(fine.contacts) > 50
    for name, noise in (('force', 0.1), ('acceleration.plate', 0.1)):
        assert np.abs(usual[name] - fine[name]).max() < 0.1 * noise


def reference(par: np.ndarray, end: float, large: bool) -> tuple[list[float], np.ndarray]:
    """Plate and impactor with layer and load, written down anew, by DOP853 with events."""
    n = int(par[at.BRANCHES])
    ks, cs = par[at.BRANCH :: 2][:n], par[at.BRANCH + 1 :: 2][:n]
    k2, load = par[at.LAYER_STIFFNESS], par[at.LOAD]
    m, k, c, mass = par[at.PLATE_MASS], par[at.STIFFNESS], par[at.DAMPING], par[at.IMPACTOR_MASS]

    def layer(y: np.ndarray, closed: bool) -> tuple[float, float]:
        u = y[2] - y[0] if closed else float(ks @ y[4:]) / (k2 + ks.sum())
        return u, k2 * u + float(ks @ (u - y[4:]))

    def rate(t: float, y: np.ndarray, closed: bool) -> np.ndarray:
        u, f = layer(y, closed)
        f = f if closed else 0.0
        weight = load * math.cos(y[2] / par[at.LEVER]) if large else load
        return np.array(
            [
                y[1],
                (f - k * y[0] - c * y[1]) / m,
                y[3],
                (weight - f) / mass,
                *(ks * (u - y[4:]) / cs),
            ]
        )

    y = np.array([0.0, 0.0, 0.0, par[at.IMPACT_SPEED], *np.zeros(n)])
    t, closed, changes = 0.0, True, []
    while t < end:

        def leaves(t: float, y: np.ndarray, closed: bool) -> float:
            u, f = layer(y, closed)
            return f if closed else y[0] + u - y[2]

        leaves.terminal, leaves.direction = True, -1
        result = solve_ivp(
            rate, (t, end), y, 'DOP853', rtol=1e-11, atol=1e-13, events=leaves, args=(closed,)
        )
        t, y = float(result.t[-1]), result.y[:, -1]
        if result.status == 1:
            changes.append(t)
            closed = not closed
    return changes, y


@pytest.mark.parametrize(('layer', 'large'), [(PAPER_LAYER, True), (IMPACT_RATE_LAYER, False)])
def test_bouncing_blow_and_its_event_times_against_a_reference_integrator(layer, large):
    bench, blow = Bench(damper=layer), PendulumBlow(large_angles=large)
    par = assemble(bench, blow, implied_effects(bench, blow))
    changes, end_state = reference(par, 0.3, large)
    rows, times, _, _ = solve(par, np.array([0.0, 0.3]), 1e-11)
    assert len(times) == len(changes)
    assert len(changes) >= 5
    np.testing.assert_allclose(times, changes, atol=2e-8)
    assert rows[-1, at.PLATE_POSITION] == pytest.approx(end_state[0], abs=1e-9)
    assert rows[-1, at.IMPACTOR_VELOCITY] == pytest.approx(end_state[3], abs=1e-6)


@pytest.mark.parametrize('restitution', [0.1, 0.5, 0.9, 1.0])
def test_bare_contact_gives_its_restitution_and_keeps_momentum(restitution):
    speed = 0.5
    sensor = Sensor(stiffness=1e-3, moving_mass=2.0, damping_ratio=0.0)
    bench = Bench(sensor, None, BareContact(restitution=restitution, restitution_speed=speed))
    blow = RobotBlow(1.0, speed, push_force=0.0, push_hold=1e6)
    mechanisms = {'unilateral_contact': {}}
    result = simulate(bench, blow, mechanisms=mechanisms, duration=0.05, tolerance=FINE)
    plate, impactor = result.rows[-1, [at.PLATE_VELOCITY, at.IMPACTOR_VELOCITY]]
    assert plate - impactor == pytest.approx(restitution * speed, rel=1e-5)
    assert 2.0 * plate + 1.0 * impactor == pytest.approx(1.0 * speed, rel=1e-6)
    assert len(result.contacts) == 1


@pytest.mark.parametrize('speed', [0.1, 0.8, 2.0])
@pytest.mark.parametrize('loss_of', ['blow', 'contact'])
def test_a_loss_that_goes_by_the_speed_has_one_restitution_at_any(loss_of, speed):
    sensor = Sensor(stiffness=1e-3, moving_mass=1e6, damping_ratio=0.0)
    bench = Bench(sensor, None, BareContact(1e8, restitution=0.6, loss_of=loss_of))
    blow = RobotBlow(1.0, speed, push_force=0.0, push_hold=1e6)
    mechanisms = {'unilateral_contact': {}}
    result = simulate(bench, blow, mechanisms=mechanisms, duration=0.02, tolerance=FINE)
    assert -result.rows[-1, at.IMPACTOR_VELOCITY] == pytest.approx(0.6 * speed, rel=1e-5)


@pytest.mark.parametrize(('loss_of', 'same'), [('contact', True), ('blow', False)])
def test_later_contacts_lose_by_their_own_speed_or_by_that_of_the_blow(loss_of, same):
    sensor = Sensor(stiffness=1e-3, moving_mass=1e6, damping_ratio=0.0)
    bench = Bench(sensor, None, BareContact(1e8, restitution=0.6, loss_of=loss_of))
    blow = RobotBlow(1.0, 1.0, push_force=0.0, push_hold=1e6)
    mechanisms = {'unilateral_contact': {}, 'gravity_load': {'force': 5.0}}
    result = simulate(bench, blow, mechanisms=mechanisms, duration=0.4, tolerance=FINE)
    second = result.contacts[1]
    before, after = np.searchsorted(result.time, [second.start - 1e-4, second.end + 1e-4])
    speeds = result.rows[[before, after], at.IMPACTOR_VELOCITY]
    restitution = -speeds[1] / speeds[0]
    assert bool(abs(restitution - 0.6) < 0.02) is same
    assert same or restitution > 0.65
    # the description is not changed by what a contact has entered
    again = simulate(bench, blow, mechanisms=mechanisms, duration=0.4, tolerance=FINE)
    np.testing.assert_array_equal(again.rows, result.rows)


def test_a_loss_of_nothing_known_is_refused():
    with pytest.raises(ConfigurationError, match='loss_of'):
        BareContact(loss_of='speed')


@pytest.mark.parametrize(('distance', 'share'), [(0.0, 0.85), (0.25, 0.58)])
def test_plastic_blow_loses_the_known_share_of_energy(distance, share):
    bench = Bench(damper=None, contact=BareContact(restitution=0.02))
    blow = PendulumBlow(Pendulum(mass_distance=distance))
    result = simulate(bench, blow, duration=0.002, sample_rate=1e6, tolerance=FINE)
    first = result.contacts[0]
    kinetic = 0.5 * blow.pendulum.equivalent_mass * result.parameters[at.IMPACT_SPEED] ** 2
    moment = np.searchsorted(result.time, min(first.end, 0.001))
    contact_loss = result.rows[moment, at.LOST_ENERGY] / kinetic
    assert contact_loss == pytest.approx(share, abs=0.02)


def test_vertical_pendulum_comes_to_rest_with_its_weight_on_the_sensor():
    for distance, weight in ((0.0, 3.8), (0.25, 13.2)):
        blow = PendulumBlow(Pendulum(mass_distance=distance))
        result = simulate(Bench(), blow, duration=4.0, sample_rate=1000.0)
        assert result['force'][-1] == pytest.approx(weight, abs=0.1)
        assert math.isinf(result.contacts[-1].end)


def test_horizontal_pendulum_comes_back_unless_caught():
    bench = Bench(orientation=Orientation.HORIZONTAL)
    free = simulate(bench, PendulumBlow(), duration=2.0)
    caught = simulate(bench, PendulumBlow(catch_time=0.1), duration=2.0)
    assert any(c.start > 0.3 for c in free.contacts)
    assert all(c.end < 0.1 for c in caught.contacts)
    assert not caught.rows[-1, at.IMPACTOR_VELOCITY]


def test_robot_pushes_on_and_lets_go():
    blow = RobotBlow(push_force=40.0, push_hold=0.7)
    result = simulate(Bench(), blow, duration=2.0)
    held = (result.time > 0.55) & (result.time < 0.7)
    assert result['force'][held].mean() == pytest.approx(40.0, abs=0.5)
    assert abs(result['force'][-1]) < 0.05
    assert result.contacts[-1].end < 1.0


def test_free_body_part_gives_the_free_contact_force():
    """Fully elastic two-body contact: F = v sqrt(mu k) (ISO/TS 15066 eq. A3)."""
    sensor = Sensor(stiffness=1e9, moving_mass=0.3, damping_ratio=0.0)  # as good as rigid
    layer = DamperLayer(75e3)
    blow = RobotBlow(8.9, 0.682, push_force=0.0, push_hold=1e6)
    mechanisms = {'unilateral_contact': {}}
    forces = []
    for body in (0.3, 0.0):
        bench = Bench(sensor, layer, body_mass=body)
        result = simulate(bench, blow, mechanisms=mechanisms, duration=0.08, tolerance=1e-9)
        forces.append(result.contacts[0].peak_force)
    assert forces[0] == pytest.approx(140.0, rel=0.01)
    assert forces[0] / forces[1] == pytest.approx(0.251, abs=0.004)


def test_coulomb_friction_decays_linearly_and_sticks_exactly():
    """Without viscous damping each half-wave loses 2 F/k; at rest the plate does not creep."""
    sensor, friction = Sensor(damping_ratio=0.0), 2.0
    result = simulate(
        Bench(sensor, None),
        HammerTap(100.0, 0.004),
        mechanisms={'coulomb_friction': {'force': friction}},
        duration=1.0,
        tolerance=FINE,
    )
    turns = [e.time for e in result.events if e.kind in ('reverses', 'sticks')]
    at_turns = np.abs(np.interp(turns, result.time, result['force']))
    np.testing.assert_allclose(np.diff(at_turns), -2 * friction, rtol=1e-3)
    half_period = math.pi * math.sqrt(sensor.moving_mass / sensor.stiffness)
    np.testing.assert_allclose(np.diff(turns), half_period, rtol=1e-6)
    stuck = result.time > turns[-1] + 1e-4
    assert result.events[-1].kind == 'sticks'
    assert np.ptp(result['force'][stuck]) == 0.0
    assert abs(result['force'][-1]) <= friction


strength = st.floats(0.0, 1.0)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_energy_never_appears_from_nowhere(data):
    draw = data.draw
    layer = DamperLayer(
        draw(st.floats(1e3, 1e5)),
        tuple(
            MaxwellBranch(draw(st.floats(1e3, 1e5)), draw(st.floats(10.0, 1e5)))
            for _ in range(draw(st.integers(0, 3)))
        ),
    )
    contact = BareContact(
        restitution=draw(st.floats(0.05, 1.0)),
        loss_of=draw(st.sampled_from(['material', 'blow', 'contact'])),
    )
    with_damper = draw(st.booleans())
    bench = Bench(
        Sensor(draw(st.floats(1e4, 2e5)), draw(st.floats(0.1, 5.0)), draw(st.floats(0.0, 0.5))),
        layer if with_damper else None,
        contact,
        draw(st.sampled_from(Orientation)),
    )
    blow = draw(
        st.sampled_from(
            [
                PendulumBlow(Pendulum(mass_distance=0.1)),
                PendulumBlow(catch_time=0.05, large_angles=True),
                RobotBlow(push_hold=0.05),
                RobotBlow(speed=0.6, push_force=0.0),
            ]
        )
    )
    choices = {
        'coulomb_friction': {'force': 8.0 * draw(strength)},
        'quadratic_damping': {'coefficient': 300.0 * draw(strength)},
        'clearance': {'gap': 5e-4 * draw(strength)},
        'hardening_spring': {'cubic': 1e10 * draw(strength)},
        'end_stop': {'travel': 1e-3, 'stiffness': 1e6 * draw(strength)},
        'hysteresis': {'share': 0.5 * draw(strength), 'yield_displacement': 5e-4},
        'added_mass': {'mass': 0.3 * draw(strength)},
        'velocity_squared_contact': {'coefficient': 100.0 * draw(strength)},
        'impactor_flexibility': {'frequency': 80.0, 'mass_share': 0.4 * draw(strength)},
        'base_compliance': {'frequency': 100.0, 'mass': 10.0},
        'stribeck_friction': {'static_force': 6.0, 'kinetic_force': 2.0, 'speed': 0.02},
    }
    if with_damper:
        choices['stiffening_damper'] = {'coefficient': 200.0 * draw(strength)}
    names = draw(st.lists(st.sampled_from(sorted(choices)), unique=True, max_size=4))
    effects = (*implied_effects(bench, blow), *(Effect(n, choices[n]) for n in names))
    result = simulate(
        bench, blow, mechanisms=effects, duration=0.3, sample_rate=4000.0, tolerance=1e-9
    )
    balance, start = result.energy_balance, result.energy[0]
    assert np.ptp(balance) < 1e-5 * (start + np.abs(result.rows[:, at.DONE_WORK]).max())
    lost = result.rows[:, at.LOST_ENERGY]
    if 'stiffening_damper' in names:  # what it stores is booked as lost until given back
        assert lost.min() > -1e-6 * (start + 1e-3)
    else:  # samples inside a step are interpolated
        assert np.diff(lost).min() > -1e-6 * (start + 1e-3)
    assert result.contact_force.min() > -1e-6


@pytest.mark.parametrize(
    'make',
    [
        lambda: Sensor(stiffness=-1.0),
        lambda: Sensor(moving_mass=math.nan),
        lambda: Sensor(reads='voltage'),
        lambda: BareContact(restitution=0.0),
        lambda: Bench(damper=DamperLayer(1e4, (MaxwellBranch(1.0, 1.0),) * 7)),
        lambda: HammerTap(duration=0.0),
        lambda: MeasuredForce(np.array([1.0, math.nan]), 1000.0),
        lambda: Sensor(damping_constant=-1.0),
        lambda: RobotBlow(effective_mass=0.0),
        lambda: simulate(Bench(), PendulumBlow(), duration=0.0),
        lambda: simulate(Bench(), PendulumBlow(), mechanisms={'gremlins': {}}),
        lambda: simulate(Bench(), PendulumBlow(), mechanisms={'coulomb_friction': {'f': 1.0}}),
        lambda: simulate(
            Bench(), PendulumBlow(), mechanisms={'coulomb_friction': {'force': -1.0}}
        ),
        lambda: simulate(Bench(), HammerTap(), mechanisms={'added_mass': {'mass': 1.0}}),
        lambda: simulate(
            Bench(damper=None),
            PendulumBlow(),
            mechanisms={'stiffening_damper': {'coefficient': 1.0}},
        ),
    ],
)
def test_impossible_descriptions_are_refused(make):
    with pytest.raises(ConfigurationError):
        make()


def test_measured_force_drives_the_plate_as_an_exact_first_order_hold():
    """Against scipy's exact discretisation (lsim) of the same linear system."""
    sensor, rate = Sensor(), 2000.0
    force = 50.0 * np.random.default_rng(4).standard_normal(400)
    blow = MeasuredForce(force, rate)
    result = simulate(Bench(sensor, None), blow, duration=0.19, sample_rate=rate, tolerance=1e-10)
    m, c, k = sensor.moving_mass, sensor.damping, sensor.stiffness
    system = signal.StateSpace([[0, 1], [-k / m, -c / m]], [[0], [1 / m]], [[k, 0]], [[0]])
    _, expected, _ = signal.lsim(system, force[:380], np.arange(380) / rate)
    np.testing.assert_allclose(result['force'], expected, atol=1e-6 * np.abs(expected).max())


def test_a_driven_mass_without_spring_slides_as_coulomb_says():
    """Constant drive 10 N on 2 kg with 4 N friction from rest: x = a t^2 / 2, a = 3 m/s^2."""
    sensor = Sensor(0.0, 2.0, 0.0, damping_constant=0.0)
    blow = MeasuredForce(np.full(101, 10.0), 100.0)
    friction = {'coulomb_friction': {'force': 4.0}}
    result = simulate(Bench(sensor, None), blow, mechanisms=friction, duration=3.0)
    position, time = result.rows[:, at.PLATE_POSITION], result.time
    driven = time < 1.0
    np.testing.assert_allclose(position[driven], 1.5 * time[driven] ** 2, atol=1e-9)
    # the drive falls to zero in 0.01 s, a = 3 - 500 t, then the mass coasts at -2 m/s^2 and stays
    speed = 3.0 + 3.0 * 0.01 - 250.0 * 0.01**2
    way = 1.5 + 3.0 * 0.01 + 1.5 * 0.01**2 - 500.0 / 6 * 0.01**3 + speed**2 / 4
    assert result.events[-1].kind == 'sticks'
    assert result.events[-1].time == pytest.approx(1.01 + speed / 2, abs=1e-9)
    assert position[-1] == pytest.approx(way, abs=1e-9)


def test_a_free_robot_flies_on_after_its_blow():
    free = simulate(Bench(), RobotBlow(push_force=0.0), duration=2.0)
    assert free.rows[-1, at.IMPACTOR_VELOCITY] < -0.01


def test_runaway_parameters_end_in_one_clear_error():
    softening = {'softening_spring': {'cubic': -1e13}}
    with pytest.raises(SimulationError, match='finite'):
        simulate(Bench(damper=None), HammerTap(2000.0), mechanisms=softening)


def test_results_are_smooth_in_the_parameters():
    """Central differences with small and smaller steps agree: fits can use them."""
    bench, blow = Bench(), PendulumBlow()
    par = assemble(bench, blow, implied_effects(bench, blow))
    times = np.arange(800) / 2000.0

    def slope(step: float) -> np.ndarray:
        change = []
        for sign in (1.0, -1.0):
            moved = par.copy()
            moved[at.STIFFNESS] *= 1 + sign * step
            change.append(solve(moved, times, lean=True)[0][:, at.READING])
        return (change[0] - change[1]) / (2 * step)

    coarse, fine = slope(3e-4), slope(1e-4)
    assert np.abs(coarse - fine).max() < 0.01 * np.abs(fine).max()


def test_a_lean_run_gives_the_same_channels():
    bench, blow = Bench(), PendulumBlow()
    par = assemble(bench, blow, implied_effects(bench, blow))
    times = np.arange(500) / 1000.0
    full, lean = solve(par, times, 1e-12)[0], solve(par, times, lean=True)[0]
    assert lean.shape == (500, at.N_LEAN_COLUMNS)
    size = np.max(np.abs(full[:, : at.N_LEAN_COLUMNS]), axis=0)
    apart = np.max(np.abs(full[:, : at.N_LEAN_COLUMNS] - lean), axis=0)
    np.testing.assert_array_less(apart, 1e-7 * size + 1e-15)


def test_a_run_ends_at_the_last_of_the_times():
    bench, blow = Bench(), PendulumBlow()
    par = assemble(bench, blow, implied_effects(bench, blow))
    times = np.arange(-50, 450) / 1000.0
    full, events, _, steps = solve(par, times, lean=True)
    for count, ends in ((0, 0.0), (30, 0.0), (300, times[299])):
        part, seen, _, taken = solve(par, times[:count], lean=True)
        np.testing.assert_allclose(part, full[:count], rtol=1e-6, atol=1e-6)
        assert seen.size == np.count_nonzero(events < ends)
        assert taken < steps


def test_corners_of_drives_rise_and_count_once():
    par = at.blank()
    assert corners(par).size == 0
    par[at.PUSH_FORCE], par[at.PUSH_START], par[at.PUSH_RISE] = 10.0, 0.1, 0.02
    par[at.PUSH_HOLD], par[at.PUSH_FALL] = 0.0, 0.03
    par[at.LIFT_START], par[at.LIFT_RISE] = 0.125, 0.4
    np.testing.assert_allclose(corners(par), [0.1, 0.12, 0.125, 0.15, 0.525])
    measured = np.concatenate((par, [0.0, 1.0, 0.5, 0.0]))
    measured[at.EXCITATION_RATE] = 10.0
    np.testing.assert_allclose(corners(measured), [0.1, 0.12, 0.125, 0.15, 0.2, 0.3, 0.525])


def test_the_bench_says_what_it_assumes():
    assert 'assumption' in Bench().notes[0]
    assert '10 mm/min' in Bench(damper=PAPER_LAYER).notes[0]
    assert 'restitution of 0.5' in Bench(damper=None).notes[0]
    losses = [IMPACT_RATE_LAYER.loss_factor(f) for f in (8, 15, 30, 60, 150)]
    assert losses == pytest.approx([0.4] * 5, abs=0.04)
    assert PAPER_LAYER.loss_factor(30.0) < 1e-3


def test_reading_is_the_springs_force_or_the_displacement_times_k():
    hardening = {'hardening_spring': {'cubic': 1e10}}
    found = {}
    for reads in ('spring_force', 'displacement'):
        bench = Bench(Sensor(reads=reads), None)
        found[reads] = simulate(bench, HammerTap(300.0), mechanisms=hardening, duration=0.1)
    position = found['displacement'].rows[:, at.PLATE_POSITION]
    linear = Sensor().stiffness * position
    np.testing.assert_allclose(found['displacement']['force'], linear, atol=1e-9)
    np.testing.assert_allclose(
        found['spring_force']['force'], linear + 1e10 * position**3, atol=1e-6
    )


def test_a_hammer_with_a_mass_gives_a_pulse_of_its_momentum():
    """A hammer of 0.1 kg at 1 m/s on the bare plate: the impulse is m v (1 + e) of a free blow."""
    bench = Bench(damper=None, contact=BareContact(5e7, restitution=0.4, restitution_speed=1.0))
    blow = RobotBlow(0.1, 1.0, push_force=0.0)
    result = simulate(bench, blow, duration=0.01, sample_rate=200_000.0)
    first = result.contacts[0]
    inside = result.time <= first.end
    impulse = result.contact_force[inside].sum() / 200_000.0
    reduced = 0.1 * 1.671 / (0.1 + 1.671)
    assert impulse == pytest.approx(reduced * 1.4, rel=0.02)


@pytest.mark.parametrize('rate', [500.0, 1000.0, 10_000.0])
def test_peaks_of_bare_contacts_do_not_depend_on_the_sampling(rate):
    """A bare contact lasts 0.9 ms: between samples of 1 kHz nothing of it need be seen."""
    blow = PendulumBlow(Pendulum(mass_distance=0.25), math.radians(10))
    bench = Bench(damper=None)
    fine = simulate(bench, blow, duration=0.2, sample_rate=1e6)
    coarse = simulate(bench, blow, duration=0.2, sample_rate=rate)
    assert len(coarse.contacts) == len(fine.contacts) > 3
    for span, truth in zip(coarse.contacts[:4], fine.contacts[:4], strict=True):
        inside = (fine.time >= truth.start) & (fine.time <= truth.end)
        assert span.peak_force == pytest.approx(fine.contact_force[inside].max(), rel=5e-4)
