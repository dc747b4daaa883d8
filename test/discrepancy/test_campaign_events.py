"""A campaign whose recordings are blows that a live graph took."""

from __future__ import annotations

import numpy as np
import pytest

from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.errors import ConfigurationError
from impactscope.records import Channel, ImpactEvent

CAMPAIGN = {
    'version': 1,
    'bench': {'kind': 'chain', 'input': 'force', 'output': 'acceleration.plate'},
    'baseline': [],
    'recordings': [{'file': 'one.mcap'}, {'file': 'two.mcap'}],
}


def event(event_id: int) -> ImpactEvent:
    values = np.array([[1, 2, np.nan], [4, 5, 6]], dtype=np.float32)
    channels = (Channel('force', 'N', range_max=500.0), Channel('acceleration.plate', 'm/s^2'))
    return ImpactEvent(
        event_id, 0, 0, 1000.0, channels, values, (), 0.0, 0.0, 0.0, (0.0, 0.0), (0.1, 0.1)
    )


def test_each_blow_fills_the_recording_of_its_turn():
    campaign = parse_campaign(CAMPAIGN).with_events([event(1)])
    assert [r.file for r in campaign.recordings] == ['one.mcap']
    force = campaign.recordings[0].channels['force']
    np.testing.assert_array_equal(force.values, [1, 2, np.nan])
    assert (force.unit, force.sample_rate, force.range_max) == ('N', 1000.0, 500.0)


def test_more_blows_than_recordings_are_refused():
    with pytest.raises(ConfigurationError, match='3 blows were taken, but campaign describes 2'):
        parse_campaign(CAMPAIGN).with_events([event(i) for i in range(3)])
