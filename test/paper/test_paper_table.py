"""Every row is there and finite; what has a closed form is held against one typed here anew."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from impactscope.paper import Basis, Standing, rows
from impactscope.paper.blow_rows import contact_keeping_angle, coupled_masses
from impactscope.paper.recordings import pendulum_blow
from impactscope.physics.pendulum import Pendulum

G = 9.80665
MB, L, LC, M = 0.698, 0.29, 0.26, 1.0
WN, ZETA, K = 203.2, 0.0692, 69e3
POSITIONS = (0.0, 0.05, 0.10, 0.15, 0.20, 0.25)


@pytest.fixture(scope='module')
def table():
    return {item.id: item for item in rows()}


def equivalent_mass(d):
    return (MB * L**2 + 3 * M * d**2) / (3 * LC**2)


def eq28(fn, zeta):
    return fn * math.sqrt((1 - 2 * zeta**2) + math.sqrt((2 * zeta**2 - 1) ** 2 + 1))


def test_every_row_is_finite_named_once_and_sectioned(table):
    assert len(table) > 200
    for item in table.values():
        assert math.isfinite(item.computed), item.id
        assert item.id.startswith(f'{item.section}:')
        assert item.quantity
        assert item.unit


def test_all_sections_are_there(table):
    sections = {item.section for item in table.values()}
    assert sections >= {
        'Table 1', '2.1', '2.2', '2.3.1', '2.3.3', '3.1.1', 'Fig. 8', 'Fig. 9', '3.2', 'Fig. 10',
        'Fig. 11', '3.3', '4', 'A',
    }  # fmt: skip


@pytest.mark.parametrize(
    'printed',
    [
        '0.698', '1', '0.29', '0.26', '0.25', '1.67', '2.68', '75', '0.0692', '203.2', '32.37',
        '202.0', '32.15', '0.07', '0.5', '0.953', '1.14', '32.85', '69', '32.1', '50.12', '20.83',
        '0.01', '203', '10', '50', '100', '150', '200', '250', '1.5', '77.9', '18.84', '38.32',
        '175', '4', '0.857', '6.1', '5', '300', '500', '20',
    ],
)  # fmt: skip
def test_every_printed_number_has_its_row(table, printed):
    assert any(item.printed == printed for item in table.values())


@pytest.mark.parametrize(
    ('identity', 'value'),
    [
        ('2.1:equivalent_mass_min', equivalent_mass(0.0)),
        ('2.1:equivalent_mass_max', equivalent_mass(0.25)),
        ('2.3.1:damping_ratio_text', math.sqrt(2) * ZETA),
        ('2.3.1:damping_ratio', ZETA),
        ('2.3.3:static_stiffness', 69 * 38.32 / (69 + 38.32)),
        ('2.3.3:quick_stiffness', 69 * 57.16 / (69 + 57.16)),
        ('2.3.3:eq25_millimetres', 69 * (18.84 * 38.32) / (69 + 18.84 * 38.32)),
        ('3.1.1:f_n', WN / (2 * math.pi)),
        ('3.1.1:omega_d', WN * math.sqrt(1 - ZETA**2)),
        ('3.1.1:f_d', WN * math.sqrt(1 - ZETA**2) / (2 * math.pi)),
        ('3.1.1:implied_spread', 1.14 / math.sqrt(0.047)),
        ('3.1.1:mass', K / WN**2),
        ('3.1.1:damping_constant', 2 * ZETA * K / WN),
        ('Fig. 8:peak_frequency', WN / (2 * math.pi) * math.sqrt(1 - 2 * ZETA**2)),
        ('Fig. 8:peak_height', -20 * math.log10(2 * ZETA * math.sqrt(1 - ZETA**2))),
        ('3.1.1:bandwidth', eq28(32.37, 0.07)),
        ('3.1.1:bandwidth_critical', eq28(32.37, 1.0)),
        ('3.1.1:tau', 2 / 203),
        ('3.1.1:decay_time', 1 / (ZETA * WN)),
        ('Fig. 9:contact_below_tau', 0.01 * 203 / 2),
        ('3.3:relaxation_time', 77.9 / 18.84),
        ('3.3:strain', 100 * 4 / 24.62),
        ('3.3:modulus', 38.32 * 24.62 / (math.pi * 25**2)),
        ('3.3:relaxed_share', 4 * 38.32),
        ('A:reduced_mass', 0.6 * 8.9 / 9.5),
        ('A:energy', 140**2 / (2 * 75e3)),
        ('A:permitted_free', 140 / math.sqrt(75e3 * 0.6 * 8.9 / 9.5)),
        ('A:permitted_clamped', 140 / math.sqrt(75e3 * 8.9)),
        ('A:contact_time', 1e3 * math.pi * math.sqrt(equivalent_mass(0.25) / K)),
    ],
)
def test_closed_forms(table, identity, value):
    assert table[identity].computed == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize('d', POSITIONS)
def test_pendulum_at_each_position(table, d):
    key, mass = f'd{1e3 * d:.0f}', equivalent_mass(d)
    alpha = math.radians(10)
    moment = (MB * L + 2 * M * d) * G
    inertia = MB * L**2 + 3 * M * d**2
    plate = K / WN**2
    expected = {
        f'2.2:energy_{key}': (MB * L / 2 + M * d) * G * math.sin(alpha),
        f'2.2:inertia_{key}': inertia / 3,
        f'2.2:mass_{key}': mass,
        f'2.2:speed_vertical_{key}': LC * math.sqrt(3 * moment * math.sin(alpha) / inertia),
        f'2.2:speed_horizontal_{key}': LC
        * math.sqrt(3 * moment * (1 - math.cos(alpha)) / inertia),
        f'3.2:frequency_{key}': math.sqrt(K / (plate + mass)) / (2 * math.pi),
        f'3.2:weight_{key}': moment / 2 / LC,
        f'3.2:energy_loss_{key}': 100 * plate / (plate + mass),
        f'Fig. 10:equation_{key}': plate + mass,
    }
    for identity, value in expected.items():
        assert table[identity].computed == pytest.approx(value, rel=1e-9), identity


@pytest.mark.parametrize(
    ('identity', 'value', 'within'),
    [
        ('Fig. 9:ratio_5ms', 0.57, 0.005),
        ('Fig. 9:ratio_8.6ms', 0.93, 0.005),
        ('Fig. 9:ratio_15ms', 1.39, 0.005),
        ('Fig. 9:ratio_30ms', 1.59, 0.005),
        ('Fig. 9:ratio_50ms', 1.34, 0.005),
        ('Fig. 9:ratio_100ms', 1.09, 0.005),
        ('Fig. 9:worst_ratio', 1.60, 0.005),
        ('Fig. 9:unity_contact', 9.4, 0.05),
        ('Fig. 9:peak_zeta1_10ms', 0.43, 0.005),
        ('3.2:energy_loss_d0', 85, 0.5),
        ('3.2:energy_loss_d250', 58, 0.5),
        ('3.3:peak_displacement', 4.23, 0.005),
        ('3.3:peak_force', 166, 0.5),
    ],
)
def test_against_an_independent_integration_of_the_same(table, identity, value, within):
    assert table[identity].computed == pytest.approx(value, abs=within)


def test_step_overshoots_as_the_logarithmic_decrement_says(table):
    overshoot = math.exp(-math.pi * 0.07 / math.sqrt(1 - 0.07**2))
    assert table['Fig. 9:peak_zeta007_50ms'].computed == pytest.approx(1 + overshoot, abs=1e-5)


@pytest.mark.parametrize(
    'identity',
    [
        '2.1:equivalent_mass_min',
        '2.1:equivalent_mass_max',
        '2.3.1:damping_ratio_text',
        '3.1.1:f_n',
        '3.1.1:omega_d',
        '3.1.1:f_d',
        '3.1.1:decay_time',
        '3.3:peak_force',
        '3.3:peak_displacement',
        'Fig. 8:peak_frequency',
        'Fig. 9:contact_below_tau',
        'Fig. 9:unity_contact',
        '2.3.3:bandwidth_of_stiffer_sensor',
        'A:energy_absorbed',
    ],
)
def test_contradictions_of_the_paper_are_rows_with_a_remark(table, identity):
    item = table[identity]
    assert item.standing is Standing.DIFFERS
    assert item.remark


def test_contradictions_that_are_no_number_are_said_in_remarks(table):
    assert 'three tests' in table['3.1.1:repetitions'].remark
    assert 'k B/C' in table['2.3.3:eq25_metres'].remark
    # as printed, eq. 25 depends on the units: that is what makes it inconsistent
    printed = [table[f'2.3.3:eq25_{unit}'].computed for unit in ('metres', 'millimetres')]
    assert abs(printed[0] / printed[1] - 1) > 0.05
    assert table['2.3.3:polynomial_c'].computed < 1e-12


def test_a_high_r_squared_conceals_friction(table):
    for key in ('soft', 'hard'):
        assert table[f'3.1.1:friction_r_squared_{key}'].computed > 0.953
        assert table[f'3.1.1:friction_zeta_{key}'].computed > 1.15 * ZETA
    soft, hard = (table[f'3.1.1:friction_zeta_{key}'].computed for key in ('soft', 'hard'))
    assert soft > 1.2 * hard  # and depends on how hard the plate is hit


def test_simulated_procedures_recover_what_was_put_in(table):
    assert table['3.1.1:omega_n'].computed == pytest.approx(WN, rel=3e-4)
    assert table['3.1.1:zeta'].computed == pytest.approx(ZETA, rel=3e-3)
    assert table['3.1.1:spring_compression'].computed == pytest.approx(69, abs=0.02)
    assert table['3.3:k2'].computed == pytest.approx(38.32, rel=1e-3)
    assert table['3.3:k1'].computed == pytest.approx(18.84, rel=2e-3)
    assert table['3.3:c1'].computed == pytest.approx(77.9, rel=2e-3)


def test_simulated_rows_are_marked(table):
    marked = [item for item in table.values() if item.basis is Basis.SIMULATED]
    assert len(marked) > 30
    assert all('simulated' in item.remark for item in marked)


@pytest.mark.parametrize('d', POSITIONS)
def test_equivalent_mass_is_right_only_while_contact_is_kept(d):
    found = coupled_masses(d)
    assert found.kept == pytest.approx(found.equation, rel=0.006)
    assert found.late == pytest.approx(found.equation, rel=0.006)
    assert len(pendulum_blow(d).contacts) > 5


@pytest.mark.parametrize('d', POSITIONS)
def test_mass_found_in_the_reading_alone_covers_the_true_one_or_is_refused(d):
    found = coupled_masses(d).by_reading
    if found.valid:
        assert abs(found.mass.value - equivalent_mass(d)) < 2 * found.mass.std
    else:
        assert found.reason


def test_neglecting_the_loss_of_contact_is_a_bias_that_repeats():
    worst = max((coupled_masses(d) for d in POSITIONS), key=lambda c: abs(c.bias))
    assert abs(worst.bias) > 0.2
    assert worst.scatter < 0.015  # below the paper's own scatter: repeating does not show it


@pytest.mark.parametrize('d', [0.0, 0.1, 0.25])
def test_contact_is_kept_up_to_the_angle_and_not_beyond(d):
    """Glued plate and pendulum, integrated: the force between them must just reach zero."""
    pendulum = Pendulum(mass_distance=d)
    mass, plate = pendulum.equivalent_mass, K / WN**2
    weight = pendulum.contact_weight()
    speed = pendulum.impact_speed(contact_keeping_angle(pendulum)) * mass / (mass + plate)

    def motion(_, state):
        x, v = state
        return v, (weight - K * x) / (mass + plate)

    times = np.linspace(0, 0.2, 20_001)
    solution = solve_ivp(motion, (0, 0.2), (0.0, speed), t_eval=times, rtol=1e-10, atol=1e-14)
    acceleration = (weight - K * solution.y[0]) / (mass + plate)
    assert float(np.min(weight - mass * acceleration)) == pytest.approx(0.0, abs=1e-4 * weight)
