"""The recordings in bags/: sound, with provenance, in SI units."""

from pathlib import Path

import numpy as np
import pytest

from impactscope.recordings import open_recording, read_streams
from impactscope.records import SampleBlock

BAGS = Path(__file__).parents[2] / 'bags'
EPOCH_NS = 1_704_067_200_000_000_000


def channels(path):
    values = {}
    with open_recording(path) as recording:
        for record in read_streams(recording):
            if isinstance(record, SampleBlock):
                values.setdefault(record.channel, []).append(record)
    return values


@pytest.mark.parametrize('number', range(1, 6))
def test_hammer_blows(number):
    found = channels(BAGS / f'hammer_blow_{number}.mcap')
    assert set(found) == {'force.hammer', 'acceleration.structure'}
    force = np.concatenate([b.values for b in found['force.hammer']])
    assert len(force) == 25_600
    assert found['force.hammer'][0].stamp_ns == EPOCH_NS
    assert {b.unit for b in found['acceleration.structure']} == {'m/s^2'}
    # The blow comes at once: the peak within 1 ms, so that there is no quiet before it.
    assert np.argmax(force) / 25_600 < 1e-3
    assert 60 < force.max() < 100  # N
    assert found['force.hammer'][-1].is_end


@pytest.mark.parametrize('number', range(1, 4))
def test_pendulum_swings(number):
    (blocks,) = channels(BAGS / f'pendulum_swing_{number:02d}.mcap').values()
    angle = np.concatenate([b.values for b in blocks])
    assert blocks[0].channel == 'displacement.angle'
    assert len(angle) == 5_000
    assert 1 < np.abs(angle).max() < np.pi  # rad, not degrees


def test_every_recording_states_where_it_comes_from():
    paths = sorted(BAGS.glob('*.mcap'))
    assert len(paths) >= 8
    for path in paths:
        with open_recording(path) as recording:
            provenance = recording.info.provenance
            assert not recording.info.damage
        assert provenance.get('kind') in ('measured', 'simulated'), path.name
        if provenance['kind'] == 'measured':
            assert {'origin', 'licence', 'source_sha256'} <= set(provenance)
