import numpy as np
import pytest
from numpy.polynomial import polynomial

from impactscope.physics.damper_layer import PAPER_LAYER_SH10, DamperLayer, MaxwellBranch
from impactscope.physics.device_model import DeviceModel
from impactscope.physics.sensor_model import PAPER_SENSOR

PAPER = DeviceModel(PAPER_SENSOR, PAPER_LAYER_SH10)
TWO = DeviceModel(
    PAPER_SENSOR, DamperLayer(30e3, (MaxwellBranch(10e3, 20e3), MaxwellBranch(40e3, 100.0)))
)
FREQUENCY = np.geomspace(1e-3, 1e3, 40)
S = 2j * np.pi * FREQUENCY


def test_polynomials_of_one_branch_are_the_printed_ones():
    m, c, k = PAPER_SENSOR.mass, PAPER_SENSOR.damping_constant, PAPER_SENSOR.stiffness
    k1, c1, k2 = 18.84e3, 77.9e3, 38.32e3
    a, b, whole = PAPER.polynomials()
    np.testing.assert_allclose(a, [k, c, m])
    np.testing.assert_allclose(b, [k1 * k2, (k1 + k2) * c1])
    printed = [k1 * (k + k2), (k + k1 + k2) * c1 + k1 * c, m * k1 + c * c1, m * c1]
    np.testing.assert_allclose(whole, printed)


@pytest.mark.parametrize('device', [PAPER, TWO])
def test_transfer_functions_are_those_of_the_polynomials(device):
    a, b, c = (polynomial.polyval(S, p) for p in device.polynomials())
    k = device.sensor.stiffness
    np.testing.assert_allclose(device.displacement_to_plate(FREQUENCY), b / c)
    np.testing.assert_allclose(device.displacement_to_force(FREQUENCY), k * b / c)
    np.testing.assert_allclose(device.displacement_to_contact_force(FREQUENCY), a * b / c)


def test_the_layer_does_not_enter_force_to_force():
    ratio = PAPER.displacement_to_force(FREQUENCY) / PAPER.displacement_to_contact_force(FREQUENCY)
    np.testing.assert_allclose(PAPER.force_to_force(FREQUENCY), ratio)


def test_spring_and_dashpot_share_the_layers_deformation_and_force():
    spring, dashpot = TWO.displacement_to_branch(FREQUENCY)
    plate = TWO.displacement_to_plate(FREQUENCY)
    for i, branch in enumerate(TWO.layer.branches):
        np.testing.assert_allclose(plate + spring[i] + dashpot[i], 1.0)
        np.testing.assert_allclose(
            branch.stiffness * spring[i], branch.viscosity * S * dashpot[i], rtol=1e-6
        )


def test_eq_19_and_20_with_one_branch():
    spring, dashpot = PAPER.displacement_to_branch(FREQUENCY)
    a, _, c = (polynomial.polyval(S, p) for p in PAPER.polynomials())
    np.testing.assert_allclose(spring[0], 77.9e3 * a * S / c, rtol=1e-6)
    np.testing.assert_allclose(dashpot[0], 18.84e3 * a / c, rtol=1e-6)


def test_limits_and_stability():
    assert PAPER.displacement_to_force(1e-9).real == pytest.approx(PAPER.static_stiffness)
    assert PAPER.static_stiffness == pytest.approx(1 / (1 / 69e3 + 1 / 38.32e3))
    assert PAPER.quick_stiffness == pytest.approx(1 / (1 / 69e3 + 1 / 57.16e3))
    assert TWO.poles().size == 4
    assert (TWO.poles().real < 0).all()
