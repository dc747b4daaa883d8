"""Campaigns on disk."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from impactscope.campaign_files import load_campaign, read_channels, save_model
from impactscope.configuration import bags_folder
from impactscope.discrepancy.answer import Answer, Mismatch
from impactscope.errors import ConfigurationError, RecordingError
from impactscope.recordings import RecordingWriter
from impactscope.records import SampleBlock

START = 1_700_000_000_000_000_000
TEXT = """
version: 1
bench: {kind: chain, input: force, output: acceleration.plate}
baseline: []
recordings: [{file: one.mcap}]
"""


def block(channel, rate, first, values, offset_ns=0):
    stamp = START + offset_ns + round(first / rate * 1e9)
    return SampleBlock(channel, 'N', rate, stamp, first, np.asarray(values, np.float32))


@pytest.fixture
def folder(tmp_path):
    with RecordingWriter(tmp_path / 'one.mcap') as writer:
        for item in (
            block('force', 100.0, 0, [1, 2, 3]),
            block('acceleration.plate', 50.0, 0, [7, 8], offset_ns=5_000_000),
            block('force', 100.0, 5, [6, 7]),
        ):
            writer.write_block(item)
    (tmp_path / 'campaign.yaml').write_text(TEXT, encoding='utf-8')
    return tmp_path


def test_channels_are_joined_and_losses_stay_open(folder):
    channels = read_channels(folder / 'one.mcap')
    assert set(channels) == {'force', 'acceleration.plate'}
    np.testing.assert_array_equal(channels['force'].values, [1, 2, 3, np.nan, np.nan, 6, 7])
    assert channels['force'].start == 0.0
    assert channels['acceleration.plate'].start == pytest.approx(0.005)
    assert channels['acceleration.plate'].sample_rate == 50.0


def test_one_late_stamp_does_not_move_a_channel(tmp_path):
    with RecordingWriter(tmp_path / 'late.mcap') as writer:
        for first in range(0, 50, 5):
            late = 20_000_000 if first == 0 else 0
            writer.write_block(block('force', 100.0, first, np.arange(5), offset_ns=late))
    assert read_channels(tmp_path / 'late.mcap')['force'].start == pytest.approx(-0.02)


def test_a_folder_is_loaded_with_its_samples(folder):
    campaign = load_campaign(folder)
    assert campaign.name == folder.name
    assert campaign.recordings[0].channels['force'].values.size == 7
    assert load_campaign(folder, samples=False).recordings[0].channels == {}


def test_a_recording_elsewhere_is_refused(folder):
    text = TEXT.replace('one.mcap', '../one.mcap')
    (folder / 'campaign.yaml').write_text(text, encoding='utf-8')
    with pytest.raises(ConfigurationError, match='outside'):
        load_campaign(folder)


@pytest.mark.parametrize('linked', ['file', 'folder'])
def test_a_link_to_a_recording_elsewhere_is_called_one(folder, tmp_path_factory, linked):
    elsewhere = tmp_path_factory.mktemp('elsewhere')
    (folder / 'one.mcap').rename(elsewhere / 'one.mcap')
    if linked == 'file':
        name = 'one.mcap'
        (folder / name).symlink_to(elsewhere / 'one.mcap')
    else:
        name = 'sub/one.mcap'
        (folder / 'sub').symlink_to(elsewhere)
    (folder / 'campaign.yaml').write_text(TEXT.replace('one.mcap', name), encoding='utf-8')
    with pytest.raises(ConfigurationError, match=f"'{name}' is a link that points outside"):
        load_campaign(folder)


def test_a_link_to_a_recording_of_the_campaign_is_read(folder):
    (folder / 'one.mcap').rename(folder / 'two.mcap')
    (folder / 'one.mcap').symlink_to('two.mcap')
    assert load_campaign(folder).recordings[0].channels['force'].values.size == 7


def test_missing_files_are_named(folder, tmp_path):
    (folder / 'one.mcap').unlink()
    with pytest.raises(RecordingError, match=r'one\.mcap'):
        load_campaign(folder)
    with pytest.raises(ConfigurationError, match='none'):
        load_campaign(tmp_path / 'none')


def test_broken_yaml_is_refused(folder):
    (folder / 'campaign.yaml').write_text('a: [', encoding='utf-8')
    with pytest.raises(ConfigurationError, match='not YAML'):
        load_campaign(folder)


def test_a_number_may_be_written_as_programs_print_it(folder):
    text = TEXT.replace('baseline', 'gain_std: {force: 1e-03}\nbaseline')
    (folder / 'campaign.yaml').write_text(text, encoding='utf-8')
    assert load_campaign(folder).gain_std == {'force': 1e-3}


def test_the_extended_model_is_saved_as_a_baseline(folder):
    model = {'baseline': ['linear_sensor', {'name': 'offset', 'values': {'value': 0.1}}]}
    answer = Answer('bench', 'chain', Mismatch(True, 0.0), model=model)
    save_model(folder, answer, folder / 'next.yaml')
    saved = yaml.safe_load((folder / 'next.yaml').read_text(encoding='utf-8'))
    assert saved['baseline'] == model['baseline']
    assert saved['recordings'] == [{'file': 'one.mcap'}]


def test_what_was_stated_wrong_is_saved_where_it_stands(folder):
    file = folder / 'campaign.yaml'
    stated = {
        'version': 1,
        'bench': {'kind': 'impact', 'orientation': 'vertical'},
        'sensor': {'stiffness': {'value': 69.0, 'std': 0.5, 'unit': 'N/mm'}},
        'damper': {'parallel_stiffness': 4e4, 'branches': [{'stiffness': 2e4, 'damping': 1e3}]},
        'baseline': ['linear_sensor'],
        'recordings': [
            {'file': 'one.mcap', 'kind': 'pendulum', 'release_angle_deg': 10.0},
            {'file': 'two.mcap', 'kind': 'drop', 'drop_height': 0.1},
        ],
    }
    file.write_text(yaml.safe_dump(stated), encoding='utf-8')
    corrected = {
        'sensor.stiffness': 70000.0,
        'damper.branches.0.stiffness': 21000.0,
        'bench.orientation': 'horizontal',
        'recordings.0.release_angle_deg': 12.0,
        'recordings.1.speed': 1.5,
        'gain.force': 1.02,  # has no place in the description
    }
    answer = Answer('bench', 'impact', Mismatch(True, 0.0), model={'corrected': corrected})
    save_model(folder, answer, folder / 'next.yaml')
    saved = yaml.safe_load((folder / 'next.yaml').read_text(encoding='utf-8'))
    assert saved['sensor']['stiffness'] == {'value': 70.0, 'std': 0.5, 'unit': 'N/mm'}
    assert saved['damper']['branches'] == [{'stiffness': 21000.0, 'damping': 1e3}]
    assert saved['bench']['orientation'] == 'horizontal'
    assert saved['recordings'][0]['release_angle_deg'] == 12.0
    assert saved['recordings'][1] == {**stated['recordings'][1], 'speed': 1.5}
    assert 'gain' not in saved
    (folder / 'two.mcap').write_bytes((folder / 'one.mcap').read_bytes())
    file.write_text(yaml.safe_dump(saved), encoding='utf-8')
    assert load_campaign(folder, samples=False).sensor['stiffness'].value == 70000.0


def test_file_of_another_name_is_a_campaign_too(folder):
    (folder / 'campaign.yaml').rename(folder / 'monday.yaml')
    assert load_campaign(folder / 'monday.yaml').name == 'monday'
    with pytest.raises(ConfigurationError, match='is no text'):
        load_campaign(folder / 'one.mcap')


def test_shipped_campaign_names_recordings_that_are_there():
    campaign = load_campaign(bags_folder() / 'pendulum_campaign.yaml')
    assert campaign.name == 'pendulum_campaign'
    assert len(campaign.recordings) == 3
    assert all('displacement.angle' in r.channels for r in campaign.recordings)
