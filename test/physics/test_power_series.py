"""Blows that are followed by power series against the Runge-Kutta pair with a far finer tolerance.

Where energies matter the pair alone is used, so that one checks the other.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.physics.twin import layout as at
from impactscope.physics.twin.assembly import Effect, assemble, implied_effects
from impactscope.physics.twin.bench import BareContact, Bench, HammerTap, PendulumBlow, RobotBlow
from impactscope.physics.twin.simulate import CHANNELS, SimulationError, solve

FINEST = 1e-12
TIMES = np.arange(-100, 3000) / 5000.0

SWUNG = PendulumBlow(release_angle=math.radians(30.0), large_angles=True)
CAUGHT = PendulumBlow(release_angle=math.radians(20.0), lift_time=0.11, catch_time=0.11)
PUSHED = RobotBlow(3.0, 0.25, push_force=30.0, push_hold=0.15, push_fall=0.05)
LOOSE = RobotBlow(5.7, 0.3, push_force=0.0)
BLOWS = (HammerTap(), PendulumBlow(), SWUNG, CAUGHT, PUSHED, LOOSE)
EFFECTS: tuple[tuple[Effect, ...], ...] = (
    (),
    (Effect('coulomb_friction', {'force': 0.4}),),
    (Effect('asymmetric_friction', {'force_forward': 0.6, 'force_backward': 0.2}),),
    (Effect('stribeck_friction', {'static_force': 2.0, 'kinetic_force': 0.4, 'speed': 0.01}),),
    (Effect('hardening_spring', {'cubic': 1e9}),),
    (Effect('softening_spring', {'cubic': -3e8}), Effect('coulomb_friction', {'force': 0.2})),
    (
        Effect('base_compliance', {'mass': 30.0, 'frequency': 60.0}),
        Effect('coulomb_friction', {'force': 0.5}),
    ),
    (Effect('impactor_flexibility', {'frequency': 120.0, 'mass_share': 0.3}),),
    (Effect('gravity_load', {'force': 6.0}), Effect('coulomb_friction', {'force': 0.5})),
    (Effect('quadratic_damping', {'coefficient': 50.0}),),  # no series
)


def _names(effects):
    return '+'.join(e.name for e in effects) or 'none'


def _vector(bench, blow, effects):
    there = {'damper'} if bench.damper is not None else {'bare'}
    there |= set() if isinstance(blow, HammerTap) else {'impactor'}
    meant = [e for e in effects if e.mechanism.needs <= there]
    given_names = {e.name for e in meant}
    implied = [e for e in implied_effects(bench, blow) if e.name not in given_names]
    normal = [Effect(e.name, e.mechanism.values(e.values), e.channel) for e in meant]
    return assemble(bench, blow, [*implied, *normal])


def _apart(par, times=TIMES):
    """Largest difference of each channel from the finest run, over its largest value."""
    quick = solve(par, times, lean=True)[0]
    finest = solve(par, times, FINEST)[0]
    columns = [column for _, column in CHANNELS.values()]
    size = np.max(np.abs(finest[:, columns]), axis=0)
    apart = np.max(np.abs(quick[:, columns] - finest[:, columns]), axis=0)
    return float(np.max(apart / np.maximum(size, 1e-3)))


@pytest.mark.parametrize('effects', EFFECTS, ids=_names)
@pytest.mark.parametrize(
    'blow', BLOWS, ids=('tap', 'pendulum', 'swing', 'caught', 'robot', 'free')
)
@pytest.mark.parametrize('damper', [True, False], ids=('layer', 'bare'))
def test_a_blow_is_the_same_by_series(damper, blow, effects):
    bench = Bench() if damper else Bench(damper=None)
    assert _apart(_vector(bench, blow, effects)) < 2e-5


@given(
    bare=st.booleans(),
    blow=st.integers(0, len(BLOWS) - 1),
    effects=st.integers(0, len(EFFECTS) - 1),
    stiffness=st.floats(3e4, 2e5),
    hardness=st.floats(7.5, 9.5),
    restitution=st.floats(0.05, 0.95),
    loss_of=st.sampled_from(('material', 'contact')),
)
@settings(max_examples=40, deadline=None)
def test_any_blow_is_the_same_by_series(
    bare, blow, effects, stiffness, hardness, restitution, loss_of
):
    sensor = Bench().sensor
    bench = Bench(
        sensor=type(sensor)(stiffness=stiffness),
        damper=None if bare else Bench().damper,
        contact=BareContact(10.0**hardness, restitution=restitution, loss_of=loss_of),
    )
    # bounces amplify: the first tenth of a second holds many of them
    times = TIMES[TIMES < 0.1]
    par = _vector(bench, BLOWS[blow], EFFECTS[effects])
    try:
        solve(par, times)
    except SimulationError:  # a spring that softens may let go for good
        with pytest.raises(SimulationError):
            solve(par, times, lean=True)
    else:
        assert _apart(par, times) < 1e-4


def test_what_rings_down_is_the_closed_form():
    bench, tap = Bench(), HammerTap(150.0, 0.004)
    par = assemble(bench, tap, ())
    times = np.concatenate(([tap.duration], np.linspace(0.01, 1.0, 400)))
    rows = solve(par, times, lean=True)[0]
    x0, v0 = rows[0, at.PLATE_POSITION], rows[0, at.PLATE_VELOCITY]
    m, k, c = par[at.PLATE_MASS], par[at.STIFFNESS], par[at.DAMPING]
    omega, decay = math.sqrt(k / m), 0.5 * c / m
    damped = math.sqrt(omega**2 - decay**2)
    t = times - tap.duration
    exact = np.exp(-decay * t) * (
        x0 * np.cos(damped * t) + (v0 + decay * x0) / damped * np.sin(damped * t)
    )
    np.testing.assert_allclose(rows[:, at.READING], k * exact, atol=1e-10 * k * abs(x0) * 100)


@pytest.mark.parametrize('effects', [*EFFECTS[:3], EFFECTS[4]], ids=_names)
@pytest.mark.parametrize('damper', [True, False], ids=('layer', 'bare'))
def test_series_take_few_steps(damper, effects):
    bench = Bench() if damper else Bench(damper=None)
    par = _vector(bench, LOOSE, effects)
    assert solve(par, TIMES, lean=True)[3] < 0.4 * solve(par, TIMES)[3]


def test_a_peak_of_friction_is_not_passed_over():
    # far above its speed the peak leaves no trace in a series: the step has to end before it
    sharp = Effect(
        'stribeck_friction', {'static_force': 3.0, 'kinetic_force': 0.1, 'speed': 0.002}
    )
    par = _vector(Bench(), HammerTap(500.0, 0.004), (sharp,))
    assert _apart(par) < 2e-5
    plain = _vector(
        Bench(), HammerTap(500.0, 0.004), (Effect('coulomb_friction', {'force': 0.1}),)
    )
    far = solve(par, TIMES, lean=True)[0] - solve(plain, TIMES, lean=True)[0]
    assert np.max(np.abs(far[:, at.READING])) > 0.1  # N: the peak is felt


def test_a_contact_that_its_loss_ends_early_is_the_same_by_series():
    bench = Bench(damper=None, contact=BareContact(1e8, restitution=0.02))
    par = _vector(bench, LOOSE, ())
    rows = solve(par, TIMES, lean=True)[0]
    pressed = rows[:, at.IMPACTOR_POSITION] > rows[:, at.PLATE_POSITION]
    assert np.any(pressed & (rows[:, at.CONTACT_FORCE] == 0.0) & (TIMES > 0.0))
    assert _apart(par) < 2e-5


def test_an_impactor_at_rest_on_the_plate_stays_there():
    load = Effect('gravity_load', {'force': 8.0})
    par = _vector(Bench(damper=None), LOOSE, (load, Effect('coulomb_friction', {'force': 0.5})))
    times = np.append(TIMES, np.linspace(1.0, 3.0, 200))
    rows, _, _, steps = solve(par, times, lean=True)
    assert rows[-1, at.CONTACT_FORCE] == pytest.approx(8.0, rel=1e-3)
    assert steps < 6000
