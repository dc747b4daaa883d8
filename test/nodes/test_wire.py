import pytest
from geometry_msgs.msg import AccelStamped, PointStamped, WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from impactscope.errors import ConfigurationError, InputError
from impactscope.nodes.wire import StampedValueReader

pytestmark = pytest.mark.ros

PATHS = [
    ('wrench', WrenchStamped, 'wrench', 'force'),
    ('wrench', WrenchStamped, 'wrench', 'torque'),
    ('accel', AccelStamped, 'accel', 'linear'),
    ('accel', AccelStamped, 'accel', 'angular'),
    ('point', PointStamped, '', 'point'),
    ('imu', Imu, '', 'linear_acceleration'),
    ('imu', Imu, '', 'angular_velocity'),
]


@given(
    st.sampled_from(PATHS),
    st.sampled_from('xyz'),
    st.text(st.characters(codec='ascii', exclude_characters='\x00'), max_size=40),
    st.floats(allow_nan=False),
    st.integers(0, 2**31 - 1),
    st.integers(0, 10**9 - 1),
)
def test_reads_what_was_serialised(path, letter, frame, value, sec, nanosec):
    kind, message_type, outer, part = path
    message = message_type()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    inner = getattr(message, outer) if outer else message
    setattr(getattr(inner, part), letter, value)
    data = serialize_message(message)
    assert StampedValueReader(kind, f'{part}.{letter}')(data) == (sec * 10**9 + nanosec, value)


@pytest.mark.parametrize(
    ('kind', 'axis'), [('wrench', 'force.w'), ('wrench', 'linear.x'), ('twist', 'linear.x')]
)
def test_unknown_kind_or_axis(kind, axis):
    with pytest.raises(ConfigurationError, match='known are'):
        StampedValueReader(kind, axis)


def test_a_message_cut_short():
    data = serialize_message(WrenchStamped())
    for size in range(len(data)):
        if size < 4 + 16 + 24:
            with pytest.raises(InputError, match='cut short'):
                StampedValueReader('wrench', 'force.z')(data[:size])
