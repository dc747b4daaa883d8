import math

import pytest

from impactscope.errors import ConfigurationError
from impactscope.paper.device_catalogue import load_devices


def test_catalogue_holds_table_1():
    devices = load_devices()
    assert devices['gte_cobosafe_cbsf_500'].force_range == (20.0, 500.0)
    assert devices['pilz_prms'].spring_stiffness_range == (10e3, 150e3)
    assert math.isnan(devices['pilz_prms'].bandwidth)
    assert devices['paper_bench'].identified['moving_mass'] == 1.67
    assert devices['gte_cobosafe_cbsf_basic'].offers(75e3)
    assert not devices['gte_cobosafe_cbsf_basic'].offers(60e3)


def test_a_users_file_extends_it(tmp_path):
    own = tmp_path / 'own.yaml'
    own.write_text(
        'schema_version: 1\ndevices:\n  mine:\n    model: M\n    force_range: [0, 200]\n'
    )
    devices = load_devices(own)
    assert devices['mine'].force_range == (0.0, 200.0)
    assert devices['mine'].maker == 'not stated'
    assert not devices['mine'].offers(1e3)
    assert 'pilz_prms' in devices


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('devices: {}', 'schema_version'),
        ('schema_version: 1\ndevices: [1]', 'mapping'),
        ('schema_version: 1\ndevices: {a: {maker: x}}', 'model'),
        ('schema_version: 1\ndevices: {a: {model: x, colour: red}}', 'colour'),
        ('schema_version: 1\ndevices: {a: {model: x, bandwidth: fast}}', 'fast'),
        ('schema_version: 1\ndevices: {a: {model: x, bandwidth: true}}', 'bandwidth'),
        ('schema_version: 1\ndevices: {a: {model: x, force_range: [5, 1]}}', 'low exceeds'),
        ('schema_version: 1\ndevices: {a: {model: x, force_range: [1]}}', 'force_range'),
        ('schema_version: 1\ndevices: {a: {model: x, identified: {colour: 1}}}', 'identified'),
    ],
)
def test_a_wrong_file_is_refused_with_the_reason(tmp_path, text, words):
    own = tmp_path / 'own.yaml'
    own.write_text(text)
    with pytest.raises(ConfigurationError, match=words):
        load_devices(own)
