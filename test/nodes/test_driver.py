import itertools

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from graph_tools import Ear, eventually, options, ros, spinning
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from impactscope import msg
from impactscope.configuration import bags_folder
from impactscope.errors import ConfigurationError
from impactscope.nodes import qos
from impactscope.nodes.accelerometer_driver import AccelerometerDriver
from impactscope.nodes.force_driver import ForceDriver
from impactscope.records import Quality

pytestmark = pytest.mark.ros
BAG = str(bags_folder() / 'hammer_blow_1.mcap')


def ear():
    return Ear(
        force_samples=(msg.SampleBlock, qos.SAMPLES),
        acceleration_samples=(msg.SampleBlock, qos.SAMPLES),
    )


class Diagnoses(Ear):
    def __init__(self):
        super().__init__()
        self.statuses = []
        self.create_subscription(
            DiagnosticArray,
            '/diagnostics',
            lambda message: self.statuses.extend(message.status),
            qos.DIAGNOSTICS,
        )


def test_each_driver_plays_its_own_channels():
    with ros():
        listener = ear()
        given = options(source='replay', replay__bag=BAG, replay__rate=8.0)
        with spinning(listener, ForceDriver(**given), AccelerometerDriver(**given)):
            heard = listener.heard
            assert eventually(lambda: all(b and not b[-1].values for b in heard.values()))
    for topic, channel in (
        ('force_samples', 'force.hammer'),
        ('acceleration_samples', 'acceleration.structure'),
    ):
        blocks = heard[topic]
        assert {block.channel for block in blocks} == {channel}
        assert sum(len(block.values) for block in blocks) == 25_600
        ends = [block.first_index + len(block.values) for block in blocks]
        assert [b.first_index for b in blocks[1:]] == ends[:-1]


def test_a_manager_can_lead_it_through_its_states():
    with ros():
        driver = ForceDriver(
            **options(source='replay', replay__bag=BAG, autostart=False, replay__rate=0.5)
        )
        listener = ear()
        client = listener.create_client(ChangeState, 'force_driver/change_state')
        state = listener.create_client(GetState, 'force_driver/get_state')
        with spinning(listener, driver):
            assert client.wait_for_service(10.0)

            def change(transition):
                future = client.call_async(
                    ChangeState.Request(transition=Transition(id=transition))
                )
                assert eventually(future.done)
                return future.result().success

            def current():
                future = state.call_async(GetState.Request())
                assert eventually(future.done)
                return future.result().current_state.id

            assert current() == State.PRIMARY_STATE_UNCONFIGURED
            assert listener.heard['force_samples'] == []
            assert change(1)  # configure
            assert change(3)  # activate
            assert current() == State.PRIMARY_STATE_ACTIVE
            assert eventually(lambda: len(listener.heard['force_samples']) > 3)
            assert change(4)  # deactivate
            count = len(listener.heard['force_samples'])
            assert change(3)
            assert eventually(lambda: len(listener.heard['force_samples']) > count + 3)
            assert change(4)
            assert change(2)  # clean up
            assert current() == State.PRIMARY_STATE_UNCONFIGURED
    epochs = [block.epoch for block in listener.heard['force_samples']]
    assert sorted(set(epochs)) == [0, 1]
    assert epochs == sorted(epochs)


def test_a_wrong_option_fails_to_configure_and_says_why():
    with ros():
        with pytest.raises(ConfigurationError, match=r'replay\.bag is empty'):
            ForceDriver(**options(source='replay'))
        with pytest.raises(ConfigurationError, match="source 'oracle'; known are simulated"):
            ForceDriver(**options(source='oracle'))
        with pytest.raises(ConfigurationError, match='unknown parameter sorce'):
            ForceDriver(**options(sorce='replay'))
        with pytest.raises(ConfigurationError, match=r'retry_time is -1\.0'):
            ForceDriver(**options(retry_time=-1.0))
        with pytest.raises(ConfigurationError, match='decimal point'):
            ForceDriver(**options(retry_time=1))


def test_a_device_that_misbehaves_recovers_and_tells():
    faults = ['stall@0.1:0.4', 'drop@0.2:0.05', 'nan@0.4:0.02', 'jump@0.5:0.2', 'die@0.7']
    with ros():
        listener, doctor = ear(), Diagnoses()
        doctor.get_logger().set_level(50)
        driver = ForceDriver(
            **options(
                source='replay', replay__bag=BAG, replay__rate=1.0, faults=faults, retry_time=0.1
            )
        )
        with spinning(listener, doctor, driver):
            blocks = listener.heard['force_samples']
            assert eventually(lambda: blocks and not blocks[-1].values)

            def mine():
                return [s for s in doctor.statuses if s.name == '/bench/force_driver']

            assert eventually(
                lambda: any(
                    v.key == 'recoveries' and v.value == '1' for s in mine() for v in s.values
                )
            )
    flags = Quality.NONE
    for block in blocks:
        flags |= Quality(block.quality)
    assert {Quality.GAP_BEFORE, Quality.NOT_FINITE} <= set(flags)
    assert [epoch for epoch, _ in itertools.groupby(b.epoch for b in blocks)] == [0, 1]
    lost = 25_600 - sum(len(block.values) for block in blocks)
    assert 0 < lost < 25_600 * 0.2
    assert any(s.level in (DiagnosticStatus.WARN, DiagnosticStatus.ERROR) for s in mine())
