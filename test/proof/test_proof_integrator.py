import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from impactscope.errors import InputError
from impactscope.proof.bench import BENCH, Bench, Pendulum, Pulse
from impactscope.proof.integrator import COLUMNS, integrate

FORCE, PLATE, IMPACTOR = (
    COLUMNS.index(n) for n in ('force', 'acceleration.plate', 'acceleration.impactor')
)
SPEED, CONTACT = COLUMNS.index('velocity.plate'), COLUMNS.index('contact')
LAYER = {'layer_stiffness': 38320.0, 'branch_stiffness': 18840.0, 'branch_damping': 77900.0}


def times(end: float, step: float = 1e-4) -> np.ndarray:
    return np.arange(round(end / step)) * step


@given(
    speed=st.floats(0.2, 1.5),
    damping=st.floats(0.05, 1.0),
    stiffness=st.floats(1e7, 1e9),
)
@settings(max_examples=15)
def test_rebound_of_hunt_and_crossley(speed, damping, stiffness):
    """Rebound speed w: L v - ln(1 + L v) = -L w - ln(1 - L w), whatever the stiffness."""
    bench = Bench(
        mass=1e9,
        stiffness=0.0,
        damping=0.0,
        impactor_mass=1.0,
        speed=speed,
        hertz_stiffness=stiffness,
        hertz_damping=damping,
    )
    motion = integrate(bench, times(0.02, 2e-6))
    change = -np.sum(motion[:, IMPACTOR]) * 2e-6
    level = damping * speed - math.log1p(damping * speed)
    z = brentq(lambda z: -z - math.log1p(-z) - level, 0, 1 - 1e-12)
    assert change - speed == pytest.approx(z / damping, rel=2e-3)


@given(
    friction=st.floats(0.01, 20),
    ratio=st.floats(1.0, 2.0),
    x0=st.floats(-6e-3, 6e-3),
)
@settings(max_examples=25)
def test_dry_friction_only_takes_energy_and_ends_in_the_dead_band(friction, ratio, x0):
    bench = BENCH._replace(
        friction_forward=friction,
        friction_backward=friction,
        static_ratio=ratio,
        stribeck_speed=0.02,
    )
    motion = integrate(bench, times(1.2, 1e-3), displacement=x0)
    x, v = motion[:, COLUMNS.index('displacement.plate')], motion[:, SPEED]
    energy = 0.5 * bench.mass * v**2 + 0.5 * bench.stiffness * x**2
    assert np.all(np.diff(energy) <= 1e-9 * energy[0] + 1e-15)
    if friction > 0.5:
        assert v[-1] == 0
        assert abs(motion[-1, FORCE]) <= friction * ratio * (1 + 1e-9)


def test_a_plate_at_rest_under_little_force_does_not_creep():
    bench = BENCH._replace(friction_forward=5.0, friction_backward=5.0)
    motion = integrate(bench, times(1.0, 1e-3), displacement=4.9 / bench.stiffness)
    assert np.ptp(motion[:, COLUMNS.index('displacement.plate')]) == 0
    assert not motion[:, PLATE].any()


def test_a_shaken_plate_follows_the_closed_form():
    bench, cycles, length, peak = BENCH, 11.0, 0.4, 20.0
    t = times(0.35, 1e-4)
    motion = integrate(bench, t, pulses=(Pulse(0.0, length, peak, cycles=cycles),))
    drive = 2j * np.pi * cycles / length  # the force is the imaginary part of peak exp(drive t)
    own = np.roots([bench.mass, bench.damping, bench.stiffness])
    reach = peak / (bench.mass * drive**2 + bench.damping * drive + bench.stiffness)
    begin = [-reach.imag, -(drive * reach).imag]  # the free motion that starts from rest
    free = np.linalg.solve(np.vstack([own**0, own]), begin)
    exact = (reach * drive**2 * np.exp(drive * t)).imag
    exact += (np.exp(np.outer(t, own)) @ (free * own**2)).real
    assert motion[1:, PLATE] == pytest.approx(exact[1:], abs=1e-6 * np.ptp(exact))


def test_impulse_equals_change_of_momentum():
    pendulum = Pendulum()
    bench = BENCH._replace(
        impactor_mass=pendulum.effective_mass(0.2),
        speed=0.8,
        friction_forward=2.0,
        friction_backward=2.0,
        base_mass=15.0,
        base_frequency=120.0,
        **LAYER,
    )
    motion = integrate(bench, times(0.08, 1e-5))
    lost = np.cumsum(motion[:, CONTACT]) * 1e-5 / bench.impactor_mass
    gone = np.cumsum(motion[:, IMPACTOR]) * -1e-5
    assert gone == pytest.approx(lost, abs=1e-9)
    assert motion[:, CONTACT].min() == 0


def test_unilateral_contact_never_pulls_and_bilateral_does():
    bench = BENCH._replace(impactor_mass=0.5, speed=1.0, **LAYER)
    assert integrate(bench, times(0.1))[:, CONTACT].min() >= 0
    assert integrate(bench._replace(unilateral=0.0), times(0.1))[:, CONTACT].min() < -10


@pytest.mark.parametrize(
    'extra',
    [
        {'quadratic_forward': 40.0, 'quadratic_backward': 25.0},
        {'cubic': 3e9, 'flexible_share': 0.2, 'flexible_frequency': 250.0},
        {'base_mass': 12.0, 'base_frequency': 90.0, 'restoring': 50.0, 'gravity_load': 9.0},
        {'second_stiffness': 9e3, 'second_damping': 40.0, 'stiffening': 80.0},
    ],
)
def test_smooth_motion_agrees_with_a_general_solver(extra):
    """Before the contact is lost, against a reference of another family, at tight tolerance."""
    from impactscope.proof.equations import FREE, TOUCHING, derivatives

    bench = BENCH._replace(impactor_mass=1.2, speed=0.9, **LAYER, **extra)
    nothing, dy, forces = np.empty(0), np.zeros(11), np.zeros(3)

    def rhs(t, y):
        derivatives(t, y, bench, TOUCHING, FREE, np.empty((0, 4)), nothing, nothing, dy, forces)
        return dy.copy()

    start = np.zeros(11)
    start[5] = start[7] = bench.speed
    t = times(0.01)
    reference = solve_ivp(rhs, (0, 0.01), start, 'Radau', t, rtol=1e-10, atol=1e-13, max_step=1e-4)
    motion = integrate(bench, t)
    assert motion[:, SPEED] == pytest.approx(reference.y[1], abs=3e-8)


def test_the_ladder_acts_as_a_fractional_derivative():
    """Gain and phase of C (i w)^a over the bench's band."""
    from impactscope.proof.equations import ladder

    bench = BENCH._replace(fractional=7.0, fractional_order=0.4)
    springs, dashpots, quick = ladder(bench)
    for frequency in (10.0, 30.0, 60.0):
        s = 2j * np.pi * frequency
        made = np.sum(springs * s / (s + springs / dashpots)) + quick * s
        assert made == pytest.approx(7.0 * s**0.4, rel=0.04)


@pytest.mark.parametrize('bad', [[-1e-3, 0.0], [0.0, 2e-3, 1e-3]])
def test_sample_times_must_ascend_from_zero(bad):
    with pytest.raises(InputError):
        integrate(BENCH, np.array(bad))


def test_geometry_of_the_pendulum():
    pendulum = Pendulum()
    assert pendulum.effective_mass(0.25) == pytest.approx(
        (0.698 * 0.29**2 + 3 * 0.25**2) / (3 * 0.26**2)
    )
    g, angle = 9.80665, math.radians(10)
    rate = math.sqrt(
        3 * (0.698 * 0.29 + 2 * 0.25) * g * math.sin(angle) / (0.698 * 0.29**2 + 3 * 0.25**2)
    )
    assert pendulum.speed(0.25, 10, 'vertical') == pytest.approx(0.26 * rate)
    assert pendulum.speed(0.25, 10, 'horizontal') < pendulum.speed(0.25, 10, 'vertical')
