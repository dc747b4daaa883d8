"""Campaigns with concealed effects: what is hidden is in the samples, and nowhere else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from impactscope.campaign_files import load_campaign
from impactscope.discrepancy.campaign import Role
from impactscope.drivers.simulated_campaign import describe_effects, parse_effect, write_campaign
from impactscope.errors import ConfigurationError


def make(folder: Path, *effects: str, **options: object) -> Path:
    write_campaign(
        folder,
        [parse_effect(text) for text in effects],
        blows=2,
        sample_rate=1000.0,
        duration=0.4,
        **options,  # type: ignore[arg-type]
    )
    return folder


def test_effect_is_read_with_values_and_channel() -> None:
    hum = parse_effect('mains_hum@force:amplitude=0.7,frequency=60')
    assert (hum.name, hum.channel) == ('mains_hum', 'force')
    assert hum.values == {'amplitude': 0.7, 'frequency': 60.0, 'phase': 0.0}


@pytest.mark.parametrize(
    ('text', 'word'),
    [
        ('ghost', 'ghost'),
        ('mains_hum:amplitude=1', 'mains_hum@CHANNEL'),
        ('mains_hum@sound:amplitude=1', 'acceleration.plate'),
        ('coulomb_friction@force:force=1', 'does not act on a channel'),
        ('coulomb_friction', 'force is not given'),
        ('coulomb_friction:force=much', 'force=much'),
        ('coulomb_friction:force=-1', '-1'),
        ('coulomb_friction:farce=1', 'farce'),
    ],
)
def test_wrong_effect_is_refused_with_its_place(text: str, word: str) -> None:
    with pytest.raises(ConfigurationError, match=word):
        parse_effect(text)


def test_campaign_is_read_and_last_blow_is_held_out(tmp_path: Path) -> None:
    campaign = load_campaign(make(tmp_path))
    assert [r.file for r in campaign.recordings] == [
        'tap_1.mcap',
        'tap_2.mcap',
        'blow_1.mcap',
        'blow_2.mcap',
    ]
    assert [r.file for r in campaign.of_role(Role.HOLD_OUT)] == ['blow_2.mcap']


def test_only_samples_differ_where_something_is_hidden(tmp_path: Path) -> None:
    plain, hidden = make(tmp_path / 'a'), make(tmp_path / 'b', 'coulomb_friction:force=2')
    assert (plain / 'campaign.yaml').read_bytes() == (hidden / 'campaign.yaml').read_bytes()
    for file in hidden.iterdir():
        assert b'friction' not in file.read_bytes()
    before, after = (load_campaign(f).recordings[2].channels for f in (plain, hidden))
    assert np.abs(before['force'].values - after['force'].values).max() > 1.0  # N


def test_same_seed_gives_the_same_recordings(tmp_path: Path) -> None:
    first, second = make(tmp_path / 'a', seed=3), make(tmp_path / 'b', seed=3)
    assert (first / 'blow_1.mcap').read_bytes() == (second / 'blow_1.mcap').read_bytes()
    third = make(tmp_path / 'c', seed=4)
    assert (first / 'blow_1.mcap').read_bytes() != (third / 'blow_1.mcap').read_bytes()


def test_effect_of_a_layer_needs_the_layer(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match='needs damper'):
        make(tmp_path, 'stiffening_damper:coefficient=100', layered=False)


def test_every_mechanism_is_listed_with_its_units() -> None:
    rows = {name: parameters for name, parameters, _, _ in describe_effects()}
    laws = {name: law for name, _, _, law in describe_effects()}
    assert 'gap' in laws['clearance']
    assert rows['coulomb_friction'] == 'force N'
    assert 'frequency Hz (50)' in rows['mains_hum']
