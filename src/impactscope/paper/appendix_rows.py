"""Appendix A of the paper: the contact model of ISO/TS 15066 (eq. A1 to A3)."""

from __future__ import annotations

from impactscope.measurement_profile import MeasurementProfile
from impactscope.paper import published
from impactscope.paper.recordings import pendulum_blow
from impactscope.paper.row import Basis, PaperRow, row
from impactscope.physics.contact_model import (
    contact_time,
    deformation_energy,
    energy_loss_share,
    peak_force,
    permitted_speed,
    reduced_mass,
)
from impactscope.physics.pendulum import Pendulum
from impactscope.physics.sensor_model import PAPER_SENSOR

__all__ = ['appendix_rows']

_HAND = (140.0, 75e3, 0.6)  # N quasi-static, N/m, kg: hands and fingers (ISO/TS 15066, Table A)
_ROBOT = 8.9  # kg, effective mass of the example


def appendix_rows() -> list[PaperRow]:
    """Eq. A1 to A3 for a hand and for the paper's own pendulum."""
    limit, stiffness, body = _HAND
    mu = reduced_mass(_ROBOT, body)
    free = permitted_speed(limit, mu, stiffness)
    clamped = permitted_speed(limit, _ROBOT, stiffness)
    pendulum = Pendulum(mass_distance=0.25)
    speed = pendulum.impact_speed(published.RELEASE_ANGLE)
    k = PAPER_SENSOR.stiffness
    ideal = peak_force(speed, pendulum.equivalent_mass, k)
    blow = pendulum_blow(0.25)
    reading = float(blow['force'].max())
    lost = energy_loss_share(PAPER_SENSOR.mass, pendulum.equivalent_mass)
    example = f'hand (75 N/mm, 0.6 kg) and robot of {_ROBOT:g} kg'
    return [
        row(
            'A:transient_window',
            'transient phase',
            's',
            '0.5',
            MeasurementProfile().transient_window,
            'default measurement profile',
            basis=Basis.GIVEN,
        ),
        row('A:reduced_mass', f'μ by eq. A1, {example}', 'kg', '', mu),
        row(
            'A:energy',
            'deformation energy by eq. A2 at 140 N',
            'J',
            '',
            deformation_energy(limit, stiffness),
        ),
        row(
            'A:energy_balance',
            'kinetic over deformation energy at F_max (eq. A3)',
            '1',
            '1',
            0.5 * mu * free**2 / deformation_energy(peak_force(free, mu, stiffness), stiffness),
            'eq. A2 and A3 agree with each other',
            tolerance=1e-12,
        ),
        row(
            'A:permitted_free',
            f'speed at which eq. A3 reaches 140 N, free contact, {example}',
            'm/s',
            '',
            free,
        ),
        row(
            'A:permitted_clamped',
            'the same with the hand clamped',
            'm/s',
            '',
            clamped,
            f'eq. A1 is for a body that can move away; a fixed sensor measures the clamped '
            f'contact: {clamped / free:.3f} of that speed',
        ),
        row(
            'A:pendulum_force',
            'F_max by eq. A3, pendulum from 10° with d = 250 mm on the bare sensor',
            'N',
            '',
            ideal,
            'massless plate, all energy into the spring',
        ),
        row(
            'A:pendulum_reading',
            'largest reading of that blow',
            'N',
            '',
            reading,
            f'{100 * (reading / ideal - 1):+.0f} % against eq. A3: the plate has 1.67 kg',
            basis=Basis.SIMULATED,
        ),
        row(
            'A:energy_absorbed',
            'share of the kinetic energy that goes into the spring, plastic blow on the plate',
            '%',
            '100',
            100 * (1 - lost),
            '"the deformed body region absorbs the entire kinetic energy" holds where the plate '
            'is light against the impactor; the device has a plate that the model has not',
        ),
        row(
            'A:contact_time',
            'contact time of eq. A3, that pendulum',
            'ms',
            '',
            1e3 * contact_time(pendulum.equivalent_mass, k),
            'π √(μ/k)',
        ),
    ]
