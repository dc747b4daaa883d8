import math
from pathlib import Path

import yaml

from impactscope.physics.sensor_model import SensorModel, bandwidth_ratio

CATALOGUE = Path(__file__).parents[2] / 'config' / 'devices.yaml'
FIELDS = {
    'maker': str,
    'model': str,
    'spring_stiffness_range': list,
    'force_range': list | None,
    'least_sampling_rate': float | None,
    'bandwidth': float | None,
}


def test_every_device_has_every_field_in_si_units():
    devices = yaml.safe_load(CATALOGUE.read_text())['devices']
    assert len(devices) >= 4
    for name, device in devices.items():
        assert set(device) - {'identified'} == set(FIELDS), name
        for field, kind in FIELDS.items():
            assert isinstance(device[field], kind), (name, field)
        low, high = device['spring_stiffness_range']
        assert 1e3 <= low <= high <= 1e6


def test_what_was_identified_agrees_with_itself():
    device = yaml.safe_load(CATALOGUE.read_text())['devices']['paper_bench']
    found = device['identified']
    sensor = SensorModel.from_modal(
        found['natural_frequency'], found['damping_ratio'], found['stiffness']
    )
    assert math.isclose(sensor.mass, found['moving_mass'], rel_tol=2e-3)
    assert math.isclose(device['bandwidth'], 32.37 * bandwidth_ratio(0.07), rel_tol=1e-3)
