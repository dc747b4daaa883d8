import json

import pytest
import yaml
from graph_tools import Ear, eventually, options, ros, spinning
from rclpy.node import Node

from impactscope import msg, srv
from impactscope.detect import ImpactDetector
from impactscope.errors import ConfigurationError
from impactscope.nodes import qos
from impactscope.nodes.conversions import to_message
from impactscope.nodes.discrepancy import Discrepancy
from impactscope.physics.twin.bench import Bench, HammerTap
from impactscope.physics.twin.stream import Campaign, ScheduledBlow, stream
from impactscope.synchronise import Synchroniser, SynchroniserSettings

pytestmark = [pytest.mark.ros, pytest.mark.slow]
TAPS = (80.0, 160.0)


def events():
    """Two taps on the simulated bench, cut out by the stages."""
    campaign = Campaign(
        'taps',
        'two taps',
        tuple(ScheduledBlow(1.0 + 2.0 * i, HammerTap(f, 0.004)) for i, f in enumerate(TAPS)),
        5.0,
        bench=Bench(damper=None),
    )
    simulated = stream(campaign, seed=3, start_ns=10**18)
    first, second = Synchroniser(SynchroniserSettings(tuple(simulated.channels))), ImpactDetector()
    found = []
    for block in simulated.blocks():
        for synced in first.push(block):
            found += second.push(synced)
    return found


def description(path, count):
    path.write_text(
        yaml.safe_dump(
            {
                'version': 1,
                'bench': {'kind': 'impact', 'orientation': 'vertical'},
                'sensor': {'stiffness': {'value': 69000, 'std': 500, 'unit': 'N/m'}},
                'damper': None,
                'baseline': ['linear_sensor'],
                'recordings': [{'file': f'tap{i}.mcap', 'kind': 'tap'} for i in range(count)],
            }
        ),
        encoding='utf-8',
    )
    return path


def test_blows_are_collected_and_the_answer_is_latched(tmp_path):
    found = events()
    assert len(found) == len(TAPS)
    with ros():
        node = Discrepancy(**options(campaign=str(description(tmp_path / 'campaign.yaml', 2))))
        player = Node('player', namespace='bench')
        out = player.create_publisher(msg.ImpactEvent, 'events', qos.EVENTS)
        ear = Ear()
        client = ear.create_client(srv.ExplainCampaign, 'explain_campaign')
        with spinning(node, ear):
            assert client.wait_for_service(10.0)

            def ask():
                future = client.call_async(srv.ExplainCampaign.Request())
                assert eventually(future.done)
                return future.result()

            assert 'no blow' in ask().message
            assert eventually(out.get_subscription_count)
            for event in found:
                out.publish(to_message(event))
            assert eventually(lambda: node.received == len(TAPS))
            assert ask().success
            assert eventually(lambda: node.published == 1, timeout=150.0)
            late = Ear(model_mismatch=(msg.ModelMismatch, qos.LATCHED))
            with spinning(late):
                heard = late.heard['model_mismatch']
                assert eventually(lambda: heard)
        player.destroy_node()
    answer = heard[0]
    assert list(answer.event_ids) == [1, 2]
    assert answer.summary
    assert json.loads(answer.json)['kind'] == 'impact'


def test_without_a_description_it_does_not_start(tmp_path):
    with ros():
        with pytest.raises(ConfigurationError, match='name a campaign'):
            Discrepancy(**options())
        with pytest.raises(ConfigurationError, match='cannot be read'):
            Discrepancy(**options(campaign=str(tmp_path / 'none.yaml')))
