import dataclasses
import math
import time

import numpy as np
import pytest
from geometry_msgs.msg import AccelStamped, WrenchStamped
from graph_tools import Ear, eventually, options, ros, spinning
from rclpy.node import Node
from sensor_msgs.msg import Imu

from impactscope import msg, srv
from impactscope.nodes import qos
from impactscope.nodes.compliance import ComplianceNode
from impactscope.nodes.conversions import time_message, to_message, to_record
from impactscope.nodes.fitter import FitterNode
from impactscope.nodes.impact_detector import Detector
from impactscope.nodes.synchroniser import SynchroniserNode
from impactscope.nodes.test_points import TestPoints as TestPointsNode
from impactscope.nodes.warm_up import warm_up_detector
from impactscope.records import SampleBlock, Verdict

pytestmark = pytest.mark.ros
START = 1_700_000_000 * 10**9
RATE = 1000.0


def force_at(t):
    """A tap at 1 s and its ring-down, N."""
    s = t - 1.0
    return 60.0 * math.exp(-14.0 * s) * math.sin(202.0 * s) if s > 0 else 0.0


def test_stamped_samples_of_three_kinds_come_onto_one_grid():
    with ros():
        node = SynchroniserNode(
            **options(
                channels=['force', 'acceleration.plate', 'acceleration.base'],
                inputs=[
                    'wrench ft/wrench force.z force',
                    'accel plate/accel linear.x acceleration.plate',
                    'imu base/imu linear_acceleration.y acceleration.base',
                ],
                input_rate=RATE,
                idle_time=1.0,
            )
        )
        ear = Ear(
            synced=(msg.SyncedBlock, qos.SAMPLES),
            mirror__force=(WrenchStamped, qos.MIRROR),
            mirror__acceleration_plate=(AccelStamped, qos.MIRROR),
        )
        player = Node('player', namespace='bench')
        wrench = player.create_publisher(WrenchStamped, 'ft/wrench', qos.WRENCH_IN)
        accel = player.create_publisher(AccelStamped, 'plate/accel', qos.WRENCH_IN)
        imu = player.create_publisher(Imu, 'base/imu', qos.WRENCH_IN)
        with spinning(node, ear):
            assert eventually(
                lambda: all(p.get_subscription_count() for p in (wrench, accel, imu))
            )
            for index in range(1500):
                stamp = time_message(START + index * 10**6)
                first = WrenchStamped()
                first.header.stamp = stamp
                first.wrench.force.z = force_at(index / RATE)
                wrench.publish(first)
                second = AccelStamped()
                second.header.stamp = stamp
                second.accel.linear.x = float(index)
                accel.publish(second)
                third = Imu()
                third.header.stamp = stamp
                third.linear_acceleration.y = -float(index)
                imu.publish(third)
                if index % 50 == 0:
                    time.sleep(0.01)
            heard = ear.heard['synced']
            assert eventually(lambda: heard and heard[-1].samples == 0)  # ended by silence
        player.destroy_node()
    blocks = [to_record(block) for block in heard if block.samples]
    values = np.hstack([block.values for block in blocks])
    assert values.shape == (3, 1500)
    index = np.arange(1500.0)
    expected = [[force_at(i / RATE) for i in index], index, -index]
    np.testing.assert_array_equal(values, np.array(expected, np.float32))
    assert blocks[0].stamp_ns == START
    assert [c.unit for c in blocks[0].channels] == ['N', 'm/s^2', 'm/s^2']
    forces = [m.wrench.force.z for m in ear.heard['mirror__force']]
    assert max(forces) == np.float32(max(expected[0]))
    assert len(forces) < 1500
    assert ear.heard['mirror__acceleration_plate']


def block(index, count=20, value=0.0, **changes):
    made = SampleBlock(
        'force', 'N', RATE, START + index * 10**6, index, np.full(count, value, np.float32)
    )
    return dataclasses.replace(made, **changes)


def test_blocks_lost_doubled_and_refused_are_counted_and_the_node_lives():
    with ros():
        node = SynchroniserNode(**options(channels=['force']))
        ear = Ear(synced=(msg.SyncedBlock, qos.SAMPLES))
        player = Node('player', namespace='bench')
        out = player.create_publisher(msg.SampleBlock, 'force_samples', qos.SAMPLES)
        with spinning(node, ear):
            assert eventually(out.get_subscription_count)
            out.publish(to_message(block(0)))
            out.publish(to_message(block(0)))
            out.publish(to_message(block(20, unit='lbf')))
            out.publish(to_message(dataclasses.replace(block(60), sample_rate=math.nan)))
            for index in range(60, 600, 20):
                out.publish(to_message(block(index)))
            out.publish(to_message(block(600, count=0)))
            heard = ear.heard['synced']
            assert eventually(lambda: heard and heard[-1].samples == 0)
            notes = ' '.join(node.notes())
        player.destroy_node()
    values = np.hstack([to_record(item).values for item in heard])[0]
    assert values.size == 600
    assert np.isnan(values[20:60]).all()
    assert np.isfinite(values[60:]).all()
    assert '40 samples were lost' in notes
    assert 'came twice' in notes
    assert 'refused' in notes


def test_a_test_point_is_opened_and_closed_by_service():
    with ros():
        node = TestPointsNode(**options())
        ear = Ear()
        start = ear.create_client(srv.StartTestPoint, 'start_test_point')
        end = ear.create_client(srv.EndTestPoint, 'end_test_point')
        with spinning(node, ear):

            def call(client, request):
                assert client.wait_for_service(10.0)
                future = client.call_async(request)
                assert eventually(future.done)
                return future.result()

            point = msg.TestPoint(id='hand 1', body_region='hands_fingers')
            assert not call(end, srv.EndTestPoint.Request()).success
            assert 'needs an id' in call(start, srv.StartTestPoint.Request()).message
            assert call(start, srv.StartTestPoint.Request(test_point=point)).success
            assert 'already' in call(start, srv.StartTestPoint.Request(test_point=point)).message
            other = msg.TestPoint(id='hand 2')
            assert (
                'end it first' in call(start, srv.StartTestPoint.Request(test_point=other)).message
            )
            assert not call(end, srv.EndTestPoint.Request(id='hand 2')).success
            assert call(end, srv.EndTestPoint.Request(id='hand 1')).success
            late = Ear(test_point=(msg.TestPoint, qos.LATCHED))
            with spinning(late):
                heard = late.heard['test_point']
                assert eventually(lambda: len(heard) == 2)
    opened, closed = (to_record(item) for item in heard)
    assert opened.id == closed.id == 'hand 1'
    assert opened.end_ns == 0 < opened.start_ns == closed.start_ns < closed.end_ns


def test_a_blow_is_judged_without_a_fitter_and_who_comes_late_sees_it():
    event = warm_up_detector()[0]
    with ros():
        node = ComplianceNode(**options())
        player = Node('player', namespace='bench')
        out = player.create_publisher(msg.ImpactEvent, 'events', qos.EVENTS)
        with spinning(node):
            assert eventually(out.get_subscription_count)
            out.publish(to_message(event))
            assert eventually(lambda: node.published == 1)
            late = Ear(verdict=(msg.ComplianceVerdict, qos.LATCHED))
            with spinning(late):
                assert eventually(lambda: late.heard['verdict'])
        player.destroy_node()
    verdict = to_record(late.heard['verdict'][0])
    assert verdict.verdict is Verdict.INCOMPLETE
    assert 'body region' in verdict.reasons[0]


def test_detector_and_fitter_in_a_row():
    with ros():
        nodes = Detector(**options()), FitterNode(**options(spring_stiffness=69_000.0))
        ear = Ear(sensor_parameters=(msg.SensorParameters, qos.LATCHED))
        player = Node('player', namespace='bench')
        out = player.create_publisher(msg.SyncedBlock, 'synced', qos.SAMPLES)
        t = np.arange(3000) / RATE
        clean = np.array([force_at(s) for s in t])
        values = (clean + np.random.default_rng(5).normal(0, 0.3, t.size)).astype(np.float32)
        channel = msg.Channel(
            name='force', unit='N', native_rate=RATE, range_min=math.nan, range_max=math.nan
        )
        with spinning(*nodes, ear):
            assert eventually(out.get_subscription_count)
            assert eventually(lambda: nodes[0].count_subscribers('/bench/events'))
            for first in range(0, 3000, 20):
                out.publish(
                    msg.SyncedBlock(
                        header=to_message(block(first)).header,
                        sample_rate=RATE,
                        first_index=first,
                        oversampling=1,
                        channels=[channel],
                        samples=20,
                        values=values[first : first + 20].tolist(),
                    )
                )
            heard = ear.heard['sensor_parameters']
            assert eventually(lambda: heard)
        player.destroy_node()
    found = to_record(heard[0])
    assert found.valid
    damped = 202.0 / (2 * math.pi)
    assert abs(found.damped_frequency.value - damped) < 4 * found.damped_frequency.std
