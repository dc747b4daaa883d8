"""Both drivers with a source that is no device: a simulated campaign, or a recording."""

import time

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    share = FindPackageShare('impactscope')
    options = {
        'source': LaunchConfiguration('source'),
        'simulated.campaign': LaunchConfiguration('campaign'),
        'simulated.seed': ParameterValue(LaunchConfiguration('seed'), value_type=int),
        'replay.bag': LaunchConfiguration('bag'),
        'replay.rate': ParameterValue(LaunchConfiguration('rate'), value_type=float),
        # Both devices begin together, when everybody has had the time to start.
        'start_at': time.time() + 8.0,
        'wait_for_subscribers': ['synced', 'events'],
    }
    clock = ParameterValue(LaunchConfiguration('publish_clock'), value_type=bool)
    drivers = [
        LifecycleNode(
            package='impactscope',
            executable=name,
            name=name,
            namespace=LaunchConfiguration('bench'),
            parameters=[LaunchConfiguration('params_file'), options, own],
        )
        for name, own in (
            ('force_driver', {'publish_test_points': True, 'replay.publish_clock': clock}),
            ('accelerometer_driver', {}),
        )
    ]
    return LaunchDescription(
        [
            DeclareLaunchArgument('bench', default_value='bench', description='namespace'),
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution([share, 'config', 'bench.yaml']),
                description='parameters of all nodes of the bench',
            ),
            DeclareLaunchArgument('source', default_value='simulated', description='or replay'),
            DeclareLaunchArgument(
                'campaign', default_value='hand_pass', description='which blows are simulated'
            ),
            DeclareLaunchArgument('seed', default_value='1', description='of the noise'),
            DeclareLaunchArgument(
                'bag',
                default_value=PathJoinSubstitution([share, 'bags', 'simulated_hand_pass.mcap']),
                description='recording to play',
            ),
            DeclareLaunchArgument(
                'rate',
                default_value='1.0',
                description='of time; 0: as fast as the consumers take it',
            ),
            DeclareLaunchArgument('publish_clock', default_value='false'),
            *drivers,
        ]
    )
