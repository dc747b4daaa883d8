"""Section 2 of the paper: devices (Table 1), set-up, eq. 1 to 6, models (eq. 7 to 25)."""

from __future__ import annotations

import math

import numpy as np

from impactscope.paper import published
from impactscope.paper.device_catalogue import load_devices
from impactscope.paper.row import Basis, PaperRow, row
from impactscope.physics.damper_layer import PAPER_LAYER_RATE, PAPER_LAYER_SH10
from impactscope.physics.device_model import DeviceModel
from impactscope.physics.pendulum import Orientation, Pendulum
from impactscope.physics.sensor_model import PAPER_SENSOR
from impactscope.physics.twin.campaigns import MASS_DISTANCES, RELEASE_ANGLE
from impactscope.physics.twin.simulate import CHANNELS

__all__ = ['bench_rows', 'device_rows', 'model_rows', 'pendulum_rows']

_TABLE_1 = (
    # catalogue entry, springs N/mm, force N, sampling rate kHz; '' where "Not provided"
    ('gte_cobosafe_cbsf_300', ('10', '150'), ('10', '300'), '1'),
    ('gte_cobosafe_cbsf_500', ('10', '150'), ('20', '500'), '1'),
    ('gte_cobosafe_cbsf_basic', ('75', '75'), ('20', '500'), '1'),
    ('pilz_prms', ('10', '150'), ('0', '500'), ''),
)


def device_rows() -> list[PaperRow]:
    """Table 1, held against the device catalogue."""
    devices = load_devices()
    rows = []
    for name, springs, forces, rate in _TABLE_1:
        device = devices[name]
        title = f'{device.model} ({forces[0]} to {forces[1]} N)'

        def add(
            key: str, what: str, unit: str, printed: str, value: float, *, of: tuple[str, str]
        ) -> None:
            rows.append(
                row(
                    f'Table 1:{of[0]}.{key}', f'{of[1]}: {what}', unit, printed, value,
                    'catalogue entry', basis=Basis.GIVEN,
                )
            )  # fmt: skip

        entry = (name, title)
        stiffness, force = device.spring_stiffness_range, device.force_range
        add('spring_min', 'softest spring', 'N/mm', springs[0], stiffness[0] / 1e3, of=entry)
        add('spring_max', 'stiffest spring', 'N/mm', springs[1], stiffness[1] / 1e3, of=entry)
        add('force_min', 'least force', 'N', forces[0], force[0], of=entry)
        add('force_max', 'largest force', 'N', forces[1], force[1], of=entry)
        if rate:
            least = device.least_sampling_rate / 1e3
            add('rate', 'least sampling rate', 'kHz', rate, least, of=entry)
    return rows


def bench_rows() -> list[PaperRow]:
    """Section 2.1: the set-up."""
    pendulum = Pendulum()
    given = (
        ('rod_mass', 'rod, mass m_b', 'kg', '0.698', pendulum.rod_mass, ''),
        ('moving_mass', 'adjustable mass M', 'kg', '1', pendulum.moving_mass, ''),
        ('rod_length', 'rod, length L', 'm', '0.29', pendulum.rod_length, ''),
        ('contact_distance', 'hinge to contact, l', 'm', '0.26', pendulum.contact_distance, ''),
        ('distance_min', 'hinge to mass, least d', 'm', '0', min(MASS_DISTANCES), ''),
        ('distance_max', 'hinge to mass, greatest d', 'm', '0.25', max(MASS_DISTANCES), ''),
        (
            'accelerometers',
            'accelerometers',
            '1',
            '3',
            sum(name.startswith('acceleration.') for name in CHANNELS),
            'section 2.1 leaves them out of the analysis, section 3.2 says that they were '
            'analysed; only the force enters the estimates printed',
        ),
    )
    rows = [
        row(f'2.1:{key}', what, unit, printed, value, remark, basis=Basis.GIVEN)
        for key, what, unit, printed, value, remark in given
    ]
    light, heavy = (Pendulum(mass_distance=d) for d in (0.0, 0.25))
    plate = PAPER_SENSOR.mass
    rows += [
        row(
            '2.1:equivalent_mass_min',
            'equivalent mass, d = 0',
            'kg',
            '1.67',
            light.equivalent_mass,
            f'eq. 4 with the stated geometry; 1.67 kg is the mass of the plate (3.1.1). Plate and '
            f'pendulum together: {plate + light.equivalent_mass:.2f} kg',
        ),
        row(
            '2.1:equivalent_mass_max',
            'equivalent mass, d = 0.25 m',
            'kg',
            '2.68',
            heavy.equivalent_mass,
            f'eq. 4 with the stated geometry. Plate and pendulum together: '
            f'{plate + heavy.equivalent_mass:.2f} kg; 2.68 follows from neither',
        ),
        row(
            '2.1:spring_nominal',
            'nominal spring of the sensor',
            'N/mm',
            '75',
            load_devices()['paper_bench'].spring_stiffness_range[0] / 1e3,
            'measured: 69 N/mm (3.1.1)',
            basis=Basis.GIVEN,
        ),
    ]
    return rows


def pendulum_rows() -> list[PaperRow]:
    """Section 2.2: eq. 1 to 6 with the stated geometry; the paper prints no numbers there."""
    rows = []
    for d in published.MASS_DISTANCES:
        pendulum, label, key = (
            Pendulum(mass_distance=d),
            f'd = {1e3 * d:.0f} mm',
            f'd{1e3 * d:.0f}',
        )
        angle = RELEASE_ANGLE
        energy = pendulum.potential_energy(angle)
        rows += [
            row(f'2.2:energy_{key}', f'E_p at 10°, {label} (eq. 1)', 'J', '', energy),
            row(
                f'2.2:inertia_{key}',
                f'J_0 + M d², {label} (eq. 2)',
                'kg m²',
                '',
                pendulum.inertia,
            ),
            row(
                f'2.2:mass_{key}',
                f'equivalent mass, {label} (eq. 4)',
                'kg',
                '',
                pendulum.equivalent_mass,
            ),
            row(
                f'2.2:speed_vertical_{key}',
                f'impact speed from 10°, vertical, {label} (eq. 5)',
                'm/s',
                '',
                pendulum.impact_speed(angle),
                '' if d else 'g = 9.80665 m/s²; the paper does not print g',
            ),
            row(
                f'2.2:speed_horizontal_{key}',
                f'impact speed from 10°, horizontal, {label} (eq. 6)',
                'm/s',
                '',
                pendulum.impact_speed(angle, Orientation.HORIZONTAL),
                '' if d else 'from the same angle the horizontal bench makes a much softer blow',
            ),
        ]
    return rows


def model_rows() -> list[PaperRow]:
    """Section 2.3: what eq. 7 to 25 give, and where their text and print go astray."""
    sensor, layer = PAPER_SENSOR, PAPER_LAYER_SH10
    device = DeviceModel(sensor, layer)
    a, b, c = device.polynomials()
    branch = layer.branches[0]
    # eq. 23 as printed, lowest power first
    printed = np.array(
        [
            branch.stiffness * (sensor.stiffness + layer.equilibrium_stiffness),
            (sensor.stiffness + branch.stiffness + layer.equilibrium_stiffness) * branch.viscosity
            + branch.stiffness * sensor.damping_constant,
            sensor.mass * branch.stiffness + sensor.damping_constant * branch.viscosity,
            sensor.mass * branch.viscosity,
        ]
    )
    # eq. 25 as printed, k B/(A + B) at rest, in two systems of units
    in_metres = sensor.stiffness * b[0] / (a[0] + b[0])
    mm = 1e-3
    in_millimetres = sensor.stiffness * mm * b[0] * mm**2 / (a[0] * mm + b[0] * mm**2)
    stiffer = type(sensor)(sensor.mass, 2 * sensor.stiffness, sensor.damping_constant)
    text_ratio = sensor.damping_constant / math.sqrt(2 * sensor.stiffness * sensor.mass)
    return [
        row(
            '2.3.1:damping_ratio_text',
            'damping ratio by the text of eq. 10, c/√(2km)',
            '1',
            '0.0692',
            text_ratio,
            "√2 too large: eq. 27's c/(2 m ω_n) = c/(2√(km)) is the one that eq. 10 itself needs",
        ),
        row(
            '2.3.1:damping_ratio',
            'damping ratio by eq. 27, c/(2 m ω_n)',
            '1',
            '0.0692',
            sensor.damping_ratio,
        ),
        row(
            '2.3.3:polynomial_c',
            'eq. 23 against A (k_1 + c_1 s) + B, largest relative deviation',
            '1',
            '0',
            float(np.max(np.abs(printed / c - 1))),
            'eq. 21 to 23 agree with eq. 13 to 15',
            tolerance=1e-12,
        ),
        row(
            '2.3.3:static_stiffness',
            'F_o/W at rest (eq. 16; k B/C)',
            'N/mm',
            '',
            abs(complex(device.displacement_to_force(0.0))) / 1e3,
            'spring and relaxed layer in series, k k_2/(k + k_2), as it must be',
        ),
        row(
            '2.3.3:eq25_metres',
            'F_o/W at rest by eq. 25 as printed, in N, m, s',
            'N/mm',
            '',
            in_metres / 1e3,
            'eq. 25 prints k B/(A + B); from eq. 16 it is k B/C with C = A (k_1 + c_1 s) + B',
        ),
        row(
            '2.3.3:eq25_millimetres',
            'F_o/W at rest by eq. 25 as printed, in N, mm, s',
            'N/mm',
            '',
            in_millimetres,
            'another value in other units: A is a stiffness, B its square; they cannot be added',
        ),
        row(
            '2.3.3:bandwidth_of_stiffer_sensor',
            'bandwidth with the sensor spring doubled, over that without',
            '1',
            '1',
            stiffer.bandwidth / sensor.bandwidth,
            'the text after eq. 24 says that the elastic and viscous characteristics "of the '
            'sensor" do not matter; of the damper layer is meant',
            tolerance=0.01,
        ),
        row(
            '2.3.3:quick_stiffness',
            'F_o/W of a quick push, plate not yet moving against it',
            'N/mm',
            '',
            device.quick_stiffness / 1e3,
            'spring and unrelaxed layer (k_1 + k_2) in series',
        ),
        row(
            '2.3.3:layer_rate',
            'test speed to which the layer constants belong',
            'mm/min',
            '10',
            PAPER_LAYER_RATE * 6e4,
            basis=Basis.GIVEN,
        ),
    ]
